//! The sensor's supply: levels, settling times on a wrapping counter, failing pins.

use embedded_hal_mock::eh1::MockError;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State as Level, Transaction};
use meshband_drivers::countdown::ticks_of_ms;
use meshband_drivers::sensor_supply::{SensorSupply, State};
use meshband_drivers::switch::Polarity;
use std::io::ErrorKind;

const CLOCK: u32 = 84_000_000;

fn is_settling(state: State) -> bool {
    matches!(state, State::Settling(_))
}

#[test]
fn theory_supply_settles_for_its_time_across_the_wrap() {
    let settling = ticks_of_ms(3000, CLOCK);
    for start in [0, 1, u32::MAX, u32::MAX - CLOCK, u32::MAX - 3 * CLOCK, 0x8000_0000] {
        let mut pin = Pin::new(&[Transaction::set(Level::High)]);
        let mut supply = SensorSupply::new(pin.clone(), Polarity::ActiveHigh, settling);
        assert_eq!(supply.poll(start), State::Off);
        supply.switch_on(start).unwrap();
        for ms in (0..3000).step_by(5) {
            let now = start.wrapping_add(ticks_of_ms(ms, CLOCK) as u32);
            assert!(is_settling(supply.poll(now)), "{ms} ms after {start}");
        }
        assert!(is_settling(supply.poll(start.wrapping_add(3 * CLOCK - 1))));
        assert_eq!(supply.poll(start.wrapping_add(3 * CLOCK)), State::On);
        // It stays so when the counter comes round to where it began.
        for quarter in 1..=8u32 {
            assert_eq!(supply.poll(start.wrapping_add(quarter.wrapping_mul(1 << 30))), State::On);
        }
        pin.done();
    }
}

#[test]
fn theory_settling_may_last_longer_than_the_counter() {
    // Two minutes: more than two wraps of 51 s.
    let settling = ticks_of_ms(120_000, CLOCK);
    assert!(settling > 2 * u64::from(u32::MAX));
    let mut pin = Pin::new(&[Transaction::set(Level::Low)]);
    let mut supply = SensorSupply::new(pin.clone(), Polarity::ActiveLow, settling);
    supply.switch_on(77).unwrap();
    for second in 1..120u32 {
        assert!(is_settling(supply.poll(77u32.wrapping_add(second.wrapping_mul(CLOCK)))), "{second} s");
    }
    assert_eq!(supply.poll(77u32.wrapping_add(120u32.wrapping_mul(CLOCK))), State::On);
    pin.done();
}

#[test]
fn theory_switching_on_twice_does_not_settle_twice() {
    let mut pin =
        Pin::new(&[Transaction::set(Level::High), Transaction::set(Level::Low), Transaction::set(Level::High)]);
    let mut supply = SensorSupply::new(pin.clone(), Polarity::ActiveHigh, 100);
    supply.switch_on(0).unwrap();
    supply.switch_on(60).unwrap();
    assert_eq!(supply.poll(100), State::On);
    supply.switch_off().unwrap();
    assert_eq!(supply.poll(101), State::Off);
    supply.switch_on(200).unwrap();
    assert!(is_settling(supply.poll(299)));
    assert_eq!(supply.poll(300), State::On);
    pin.done();
}

#[test]
fn fault_supply_that_cannot_be_switched_counts_as_off() {
    let fault = MockError::Io(ErrorKind::NotConnected);
    let mut pin = Pin::new(&[
        Transaction::set(Level::High).with_error(fault.clone()),
        Transaction::set(Level::High),
        Transaction::set(Level::Low).with_error(fault.clone()),
        Transaction::set(Level::Low),
    ]);
    let mut supply = SensorSupply::new(pin.clone(), Polarity::ActiveHigh, 100);
    assert_eq!(supply.switch_on(0), Err(fault.clone()));
    assert_eq!(supply.poll(1000), State::Off);
    supply.switch_on(1000).unwrap();
    assert_eq!(supply.poll(1100), State::On);
    assert_eq!(supply.switch_off(), Err(fault));
    assert_eq!(supply.poll(1101), State::Off);
    supply.switch_off().unwrap();
    pin.done();
}

#[test]
fn theory_milliseconds_become_ticks_rounded_up() {
    assert_eq!(ticks_of_ms(1, CLOCK), 84_000);
    assert_eq!(ticks_of_ms(1, 1001), 2);
    assert_eq!(ticks_of_ms(u32::MAX, u32::MAX), (u64::from(u32::MAX) * u64::from(u32::MAX)).div_ceil(1000));
}
