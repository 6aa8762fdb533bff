//! The configuration in flash survives power cuts at any byte, and damage is noticed.

use meshband::config::Configuration;
use meshband::store::{HEADER, Origin, SLOT, Store, StoreError};
use meshband::units::{Hertz, TicksPerSecond};
use meshband_tests::mock_flash::{MockError, MockFlash, TornErase};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const CLOCK_HZ: u32 = 84_000_000;
/// Two slots per sector, so that every other write erases.
type Flash = MockFlash<4096, 4>;

fn flash(seed: u64) -> Flash {
    MockFlash::new(2, ChaCha8Rng::seed_from_u64(seed))
}

/// Configurations that differ, in length too.
fn configuration(number: u32) -> Configuration {
    let mut config = Configuration::default();
    config.gears.pinion_teeth = 12 + (number % 900) as u16;
    config.law.machine_hash = u64::from(number).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    config.tach.highest = Hertz(20.0 + (number % 7) as f32);
    config
}

fn stored(flash: &Flash) -> (Configuration, Origin) {
    Store::new(flash.clone(), 0).load(TicksPerSecond(CLOCK_HZ))
}

#[test]
fn theory_a_stored_configuration_is_loaded_again_over_many_turns_of_the_log() {
    let mut store = Store::new(flash(1), 0);
    assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (Configuration::default(), Origin::Blank));
    for number in 0..40 {
        store.save(&configuration(number)).expect("there is room");
        assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (configuration(number), Origin::Stored), "{number}");
    }
}

#[test]
fn theory_the_layout_suits_the_flash_of_the_boards() {
    // STM32F405 (bytes, 128 KiB sectors), STM32G4 (8 bytes, 2 KiB), STM32H7 (32 bytes, 128 KiB).
    fn turns<const SECTOR: usize, const WORD: usize>() {
        let mut store = Store::new(MockFlash::<SECTOR, WORD>::new(3, ChaCha8Rng::seed_from_u64(2)), SECTOR as u32);
        for number in 0..5 {
            store.save(&configuration(number)).expect("there is room");
            assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (configuration(number), Origin::Stored));
        }
        assert!(store.flash_mut().bytes[..SECTOR].iter().all(|&b| b == 0xff), "wrote outside its sectors");
    }
    turns::<0x2_0000, 1>();
    turns::<2048, 8>();
    turns::<0x2_0000, 32>();
    let mut small = Store::new(MockFlash::<1024, 4>::new(2, ChaCha8Rng::seed_from_u64(2)), 0);
    assert_eq!(small.save(&configuration(1)), Err(StoreError::Geometry));
    assert_eq!(small.load(TicksPerSecond(CLOCK_HZ)), (Configuration::default(), Origin::Unreadable));
}

/// Saves configuration `number` with a power cut after `bytes`; gives whether the save got through.
fn cut_save(flash: &mut Flash, number: u32, bytes: u64) -> bool {
    flash.bytes_until_shutoff = Some(bytes);
    let mut store = Store::new(flash.clone(), 0);
    let result = store.save(&configuration(number));
    *flash = store.flash_mut().clone();
    flash.bytes_until_shutoff = None;
    match result {
        Ok(()) => true,
        Err(StoreError::Flash(MockError::PowerCut)) => false,
        Err(other) => panic!("{other:?} after {bytes} bytes"),
    }
}

#[test]
fn fault_a_power_cut_after_every_byte_of_a_write_leaves_the_old_or_the_new_configuration() {
    let mut cuts = 0;
    for torn_erase in [TornErase::FromFront, TornErase::Everywhere] {
        // One to six records before the write under test: blank slots, an erase ahead, both sectors in use.
        for before in 1..=6 {
            let mut start = flash(u64::from(before));
            start.torn_erase = torn_erase;
            for number in 0..before {
                assert!(cut_save(&mut start, number, u64::MAX));
            }
            for bytes in 0.. {
                let mut flash = start.clone();
                let through = cut_save(&mut flash, before, bytes);
                let (config, origin) = stored(&flash);
                if through {
                    assert_eq!((config, origin), (configuration(before), Origin::Stored));
                    break;
                }
                cuts += 1;
                let old = config == configuration(before - 1);
                // Whole but for the padding or the reading back.
                let new = config == configuration(before) && origin == Origin::Stored;
                assert!(old || new, "{before} records, cut after {bytes} bytes: neither old nor new, {origin:?}");
                assert!(matches!(origin, Origin::Stored | Origin::Former), "{origin:?}");
                // The node recovers by itself: the next write gets through and is the one found.
                assert!(cut_save(&mut flash, 500, u64::MAX));
                assert_eq!(stored(&flash), (configuration(500), Origin::Stored), "after a cut at {bytes} bytes");
            }
        }
    }
    println!("{cuts} cut points");
    assert!(cuts > 10_000);
}

#[test]
fn fault_ten_thousand_random_power_cuts_in_a_row_never_leave_neither() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut flash = flash(8);
    assert!(cut_save(&mut flash, 0, u64::MAX));
    let (mut held, mut cuts, mut number) = (configuration(0), 0, 0);
    while cuts < 10_000 {
        number += 1;
        flash.torn_erase = if random.random() { TornErase::FromFront } else { TornErase::Everywhere };
        // Cuts inside the record and inside an erase with equal weight; some writes get through.
        let most = if random.random() { 400 } else { 5_000 };
        let through = cut_save(&mut flash, number, random.random_range(0..most));
        let (config, origin) = stored(&flash);
        assert!(config == configuration(number) || (!through && config == held), "{number}: {origin:?}");
        cuts += u32::from(!through);
        held = config;
    }
    println!("{cuts} cuts in {number} writes");
}

#[test]
fn fault_damage_gives_the_default_or_the_former_configuration_and_a_complaint() {
    // Everything written but the header's padding, which means nothing.
    let used = |flash: &Flash, from: usize| {
        let bytes = &flash.bytes[from..from + SLOT];
        let end = bytes.iter().rposition(|&b| b != 0xff).expect("written") + 1;
        (0..end).filter(|at| !(16..HEADER).contains(at)).map(move |at| from + at).collect::<Vec<_>>()
    };
    let mut store = Store::new(flash(3), 0);
    store.save(&configuration(1)).expect("room");
    let one = store.flash_mut().clone();
    store.save(&configuration(2)).expect("room");
    let two = store.flash_mut().clone();
    for bit in 0..8 {
        for at in used(&one, 0) {
            let mut flash = one.clone();
            flash.bytes[at] ^= 1 << bit;
            assert_eq!(stored(&flash), (Configuration::default(), Origin::Damaged), "byte {at} bit {bit}");
        }
        for at in used(&two, SLOT) {
            let mut flash = two.clone();
            flash.bytes[at] ^= 1 << bit;
            assert_eq!(stored(&flash), (configuration(1), Origin::Former), "byte {at} bit {bit}");
        }
    }
    assert_eq!([Origin::Stored, Origin::Blank].map(Origin::complaint), [None; 2]);
    let complaints = [Origin::Former, Origin::Damaged, Origin::Refused, Origin::Unreadable].map(Origin::complaint);
    assert!(complaints.iter().all(Option::is_some));
}

#[test]
fn fault_random_contents_are_never_a_configuration_and_can_be_written_over() {
    let mut random = ChaCha8Rng::seed_from_u64(4);
    for round in 0..200 {
        let mut flash = flash(round);
        random.fill(&mut flash.bytes[..]);
        assert_eq!(stored(&flash), (Configuration::default(), Origin::Damaged));
        assert!(cut_save(&mut flash, 9, u64::MAX));
        assert_eq!(stored(&flash).0, configuration(9));
    }
}

#[test]
fn fault_another_schema_or_an_invalid_configuration_is_refused() {
    let mut store = Store::new(flash(5), 0);
    store.save(&Configuration { schema: 99, ..configuration(1) }).expect("room");
    assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (Configuration::default(), Origin::Refused));
    let mut unfit = configuration(1);
    unfit.gears.pinion_teeth = 0;
    store.save(&unfit).expect("room");
    assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (Configuration::default(), Origin::Refused));
    store.save(&configuration(2)).expect("room");
    assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (configuration(2), Origin::Stored));
}
