//! The light's codes as a person counts them, and its pin.

use embedded_hal_mock::eh1::MockError;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State, Transaction};
use meshband_drivers::status_light::{FlashCode, MOST_FLASHES, StatusLight};
use meshband_drivers::switch::Polarity;
use std::io::ErrorKind;

const CLOCK: u32 = 84_000_000;
/// Ticks between two turns of a main loop.
const TURN: u32 = CLOCK / 200;

/// Flashes between pauses of more than half a second, as counted from `start` on; the last, unfinished group is left
/// out.
fn counted(light: &mut FlashCode, start: u32, turns: u32, flashes: impl Fn(u32) -> u8) -> Vec<u32> {
    let (mut groups, mut group, mut dark, mut was_lit) = (Vec::new(), 0, 0, false);
    for turn in 0..turns {
        let lit = light.is_lit(flashes(turn), start.wrapping_add(turn * TURN));
        group += u32::from(lit && !was_lit);
        dark = if lit { 0 } else { dark + 1 };
        if dark == 100 && group > 0 {
            groups.push(group);
            group = 0;
        }
        was_lit = lit;
    }
    groups
}

#[test]
fn theory_each_code_is_so_many_flashes_in_each_cycle() {
    for flashes in 1..=5 {
        let groups = counted(&mut FlashCode::new(CLOCK), 0, 200 * 24, |_| flashes);
        assert!(groups.len() >= 9, "a cycle of 2.4 s: {groups:?}");
        assert!(groups.iter().all(|group| *group == flashes.into()), "{flashes}: {groups:?}");
    }
}

#[test]
fn fault_wrap_of_the_tick_counter_shows_no_wrong_code() {
    for flashes in 1..=5 {
        for lead in [TURN, CLOCK / 2, CLOCK, 2 * CLOCK, 3 * CLOCK] {
            let groups = counted(&mut FlashCode::new(CLOCK), lead.wrapping_neg(), 200 * 12, |_| flashes);
            assert!(groups.iter().all(|group| *group == flashes.into()), "{flashes}, {lead} before: {groups:?}");
        }
    }
}

#[test]
fn theory_a_change_of_code_never_shows_a_third_one() {
    for change in (0..480).step_by(7) {
        let groups = counted(&mut FlashCode::new(CLOCK), 17, 200 * 12, |turn| if turn < change { 2 } else { 5 });
        assert!(groups.iter().all(|group| [2, 5].contains(group)), "changed at turn {change}: {groups:?}");
        assert_eq!(groups.last(), Some(&5));
    }
}

#[test]
fn theory_a_code_always_leaves_a_pause() {
    let groups = counted(&mut FlashCode::new(CLOCK), 0, 200 * 12, |_| u8::MAX);
    assert!(!groups.is_empty());
    assert!(groups.iter().all(|group| *group == u32::from(MOST_FLASHES)), "{groups:?}");
}

#[test]
fn theory_pin_is_written_only_when_the_light_changes() {
    for (polarity, lit, dark) in
        [(Polarity::ActiveLow, State::Low, State::High), (Polarity::ActiveHigh, State::High, State::Low)]
    {
        let mut pin = Pin::new(&[lit, dark, lit].map(Transaction::set));
        let mut light = StatusLight::new(pin.clone(), polarity);
        for on in [true, true, false, false, false, true] {
            light.set(on).unwrap();
        }
        pin.done();
    }
}

#[test]
fn fault_failed_write_is_reported_and_written_again() {
    let fault = MockError::Io(ErrorKind::NotConnected);
    let mut pin = Pin::new(&[
        Transaction::set(State::High),
        Transaction::set(State::Low).with_error(fault.clone()),
        Transaction::set(State::Low),
    ]);
    let mut light = StatusLight::new(pin.clone(), Polarity::ActiveHigh);
    light.set(true).unwrap();
    assert_eq!(light.set(false), Err(fault));
    light.set(false).unwrap();
    light.set(false).unwrap();
    pin.done();
}
