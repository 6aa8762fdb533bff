//! The programmable-gain amplifier: bytes of its data sheet (DS21117B section 5.2), and what is known after a fault.

use embedded_hal::spi::{ErrorKind, ErrorType, Operation, SpiDevice};
use embedded_hal_mock::eh1::spi::{Mock as Spi, Transaction};
use meshband_drivers::gain_keeper::GainKeeper;
use meshband_drivers::programmable_gain::{Gain, ProgrammableGain, Setting};
use std::cell::Cell;
use std::ops::Range;

/// Factors with their codes, as register 5-2 lists them.
const TABLE: [(u8, u8); 8] = [(1, 0), (2, 1), (4, 2), (5, 3), (8, 4), (10, 5), (16, 6), (32, 7)];

/// One word under one chip select.
fn word(first: u8, second: u8) -> [Transaction<u8>; 3] {
    [Transaction::transaction_start(), Transaction::write_vec(vec![first, second]), Transaction::transaction_end()]
}

/// A device some of whose transactions fail, by their numbers, and which counts all; the mock knows no faults.
struct Failing<'r> {
    fails_at: Range<u32>,
    transactions: &'r Cell<u32>,
}

impl ErrorType for Failing<'_> {
    type Error = ErrorKind;
}

impl SpiDevice for Failing<'_> {
    fn transaction(&mut self, _operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let number = self.transactions.replace(self.transactions.get() + 1);
        if self.fails_at.contains(&number) { Err(ErrorKind::ModeFault) } else { Ok(()) }
    }
}

#[test]
fn ref_every_gain_is_the_data_sheets_word() {
    for (factor, code) in TABLE {
        let gain = Gain::of_factor(factor).unwrap();
        let mut bus = Spi::new(&word(0b010 << 5, code));
        let mut amplifier = ProgrammableGain::new(bus.clone());
        amplifier.set_gain(gain).unwrap();
        assert_eq!(amplifier.in_use().map(Gain::factor), Some(factor));
        assert_eq!((gain.code(), Gain::ALL[usize::from(code)]), (code, gain));
        bus.done();
    }
}

#[test]
fn theory_factors_the_amplifier_lacks_are_none() {
    let known = TABLE.map(|(factor, _)| factor);
    for factor in 0..=u8::MAX {
        assert_eq!(Gain::of_factor(factor).is_some(), known.contains(&factor), "{factor}");
    }
}

#[test]
fn ref_shutdown_is_one_word_and_the_next_gain_wakes() {
    let words = [word(0b010 << 5, 3), word(0b001 << 5, 0), word(0b010 << 5, 3)].concat();
    let mut bus = Spi::new(&words);
    let mut amplifier = ProgrammableGain::new(bus.clone());
    assert_eq!((amplifier.setting(), amplifier.in_use()), (Setting::Unwritten, None));
    amplifier.set_gain(Gain::X5).unwrap();
    amplifier.shut_down().unwrap();
    assert_eq!((amplifier.setting(), amplifier.in_use()), (Setting::ShutDown, None));
    assert_eq!(amplifier.last_written(), Some(Gain::X5));
    amplifier.set_gain(Gain::X5).unwrap();
    assert_eq!(amplifier.in_use(), Some(Gain::X5));
    bus.done();
}

#[test]
fn fault_failed_write_leaves_no_gain_to_scale_with() {
    let transactions = Cell::new(0);
    let mut amplifier = ProgrammableGain::new(Failing { fails_at: 0..1, transactions: &transactions });
    assert_eq!(amplifier.set_gain(Gain::X8), Err(ErrorKind::ModeFault));
    assert_eq!((amplifier.setting(), amplifier.in_use(), amplifier.last_written()), (Setting::Doubtful, None, None));
    amplifier.set_gain(Gain::X8).unwrap();
    assert_eq!((amplifier.in_use(), amplifier.last_written()), (Some(Gain::X8), Some(Gain::X8)));
}

#[test]
fn fault_failed_change_remembers_the_last_gain_but_does_not_vouch_for_it() {
    let transactions = Cell::new(0);
    let mut amplifier = ProgrammableGain::new(Failing { fails_at: 1..2, transactions: &transactions });
    amplifier.set_gain(Gain::X2).unwrap();
    assert_eq!(amplifier.set_gain(Gain::X32), Err(ErrorKind::ModeFault));
    assert_eq!(amplifier.last_written(), Some(Gain::X2));
    assert_eq!((amplifier.setting(), amplifier.in_use()), (Setting::Doubtful, None));
    amplifier.set_gain(Gain::X32).unwrap();
    assert_eq!(amplifier.in_use(), Some(Gain::X32));
}

#[test]
fn theory_kept_gain_is_written_once_and_at_each_change() {
    let words = [word(0b010 << 5, 0), word(0b010 << 5, 5)].concat();
    let mut bus = Spi::new(&words);
    let mut keeper = GainKeeper::new(ProgrammableGain::new(bus.clone()), 100);
    assert_eq!(keeper.in_use(), None);
    for (gain, now) in [(Gain::X1, 0), (Gain::X1, 1), (Gain::X1, 5000), (Gain::X10, 5001), (Gain::X10, 5002)] {
        keeper.follow(gain, now).unwrap();
        assert_eq!(keeper.in_use(), Some(gain));
    }
    bus.done();
}

#[test]
fn fault_failing_bus_is_said_once_and_tried_again_after_pauses() {
    let start = u32::MAX - 150;
    let transactions = Cell::new(0);
    let mut keeper =
        GainKeeper::new(ProgrammableGain::new(Failing { fails_at: 0..3, transactions: &transactions }), 100);
    let mut said = Vec::new();
    for after in 0..=320u32 {
        if keeper.follow(Gain::X4, start.wrapping_add(after)).is_err() {
            said.push(after);
        }
        // Tries at 0, 100, 200 fail, the one at 300 does not; the counter wraps in between.
        assert_eq!(transactions.get(), (1 + after / 100).min(4), "{after}");
        assert_eq!(keeper.in_use(), (after >= 300).then_some(Gain::X4), "{after}");
    }
    assert_eq!(said, [0]);
}

#[test]
fn fault_a_second_series_of_failures_is_said_again() {
    let transactions = Cell::new(0);
    let mut keeper =
        GainKeeper::new(ProgrammableGain::new(Failing { fails_at: 1..2, transactions: &transactions }), 100);
    assert_eq!(keeper.follow(Gain::X4, 0), Ok(()));
    assert_eq!(keeper.follow(Gain::X8, 1), Err(ErrorKind::ModeFault));
    assert_eq!(keeper.follow(Gain::X8, 50), Ok(()));
    assert_eq!(keeper.in_use(), None);
    assert_eq!(keeper.follow(Gain::X8, 101), Ok(()));
    assert_eq!(keeper.in_use(), Some(Gain::X8));
}
