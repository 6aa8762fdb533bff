//! Faults on the real image in QEMU: no panic, no hang, a defined state, every fault counted, recovery without a
//! restart.
//!
//! The same faults as in `fault_campaign.rs`, here through timers, interrupts, queues and UART of a board. A panic,
//! fault or hang would end QEMU with an error ([`meshband_host::virtual_node::qemu`]). Times are those of the record,
//! that is of the node.

use meshband::events::EventKind;
use meshband::law::LawForm;
use meshband::node::State;
use meshband::self_test::{NOISE, RAILS};
use meshband::tach::Validity;
use meshband::units::Hertz;
use meshband_host::virtual_node::frames::Received;
use meshband_host::virtual_node::qemu::{Finished, Qemu};
use meshband_host::virtual_node::simulation;
use meshband_tests::plant::configuration;
use meshband_tests::qemu_node::{check_stack, machine};
use meshband_tests::script::{Account, Disturbance, Script, is_right};

const SPEED_HZ: f64 = 15.0;

/// The first message that is another one.
fn first_difference(found: &[u8], expected: &[u8]) -> String {
    let [found, expected] = [found, expected].map(Received::decode);
    let pair = found.messages().zip(expected.messages()).find(|(found, expected)| {
        // By text: what is no number differs from itself.
        format!("{found:?}") != format!("{expected:?}")
    });
    pair.map_or("equal messages, other bytes\n".into(), |(found, expected)| format!("{found:?}\nfor {expected:?}\n"))
}

/// Runs a record to its end and compares every byte with the host's node on the same blocks.
fn run(machine: &Qemu, image: &[u8]) -> (Finished, Account) {
    let finished = machine.run(image).expect("the firmware ends well");
    let followed = simulation::follow(image, &finished.blocks().expect("a whole log")).expect("runs");
    assert!(
        finished.link == followed.link,
        "QEMU and host differ: {}{}",
        first_difference(&finished.link, &followed.link),
        finished.console
    );
    assert_eq!(finished.count("edges_lost"), 0, "{}", finished.console);
    let account = Account::of(&finished.link);
    assert_eq!((account.received.refused, account.received.lost), (0, 0));
    let (boot, operation) = check_stack(&finished);
    let wall = finished.wall_time.as_secs_f64();
    let sent = finished.link.len();
    println!("{wall:.1} s of host time; {sent} bytes sent; stack: {boot} bytes at start, {operation} in operation");
    (finished, account)
}

#[test]
fn fault_tach_noise_drop_out_reversal_and_a_tenfold_step_of_speed() {
    let Some(machine) = machine("tach faults") else { return };
    let mut script = Script::new(1);
    let steady = |_: f64| SPEED_HZ;
    let before = script.run(5.0, steady, Disturbance::None);
    let noisy = script.run(4.0, steady, Disturbance::Pulses(40.0));
    let after_noise = script.run(5.0, steady, Disturbance::None);
    // The slowest believable shaft, 0.25 Hz, is waited for before it counts as standing.
    let silent = script.run(11.0, steady, Disturbance::NoPulses);
    let after_silence = script.run(6.0, steady, Disturbance::None);
    let turning = script.run(3.0, |t| SPEED_HZ * (1.0 - t / 1.5), Disturbance::None);
    let after_reversal = script.run(6.0, |_| -SPEED_HZ, Disturbance::None);
    let slow = script.run(8.0, |_| 2.0, Disturbance::None);
    let fast = script.run(5.0, |_| 20.0, Disturbance::None);
    let (finished, account) = run(&machine, &script.image(Some(&configuration()), |header| header));
    assert_eq!(finished.count("lost") + finished.count("missed"), 0);
    assert_eq!(finished.count("blocks"), account.statistics().blocks);

    account.assert_measures(before, SPEED_HZ);
    let spurious = account.statistics().pulses_spurious;
    assert!(spurious > 80, "{spurious} of 160 extra pulses counted");
    for status in account.statuses(noisy.0, noisy.1) {
        let right = (f64::from(status.speed_hz) / SPEED_HZ - 1.0).abs() < 0.05;
        assert!(right || status.validity != Validity::Locked, "{status:?}");
    }
    account.assert_measures(after_noise, SPEED_HZ);

    let kinds = |(from_s, to_s): (f64, f64)| account.events(from_s, to_s).iter().map(|e| e.kind).collect::<Vec<_>>();
    assert!(kinds(silent).contains(&EventKind::TachDoubtful), "{:?}", kinds(silent));
    let last = account.statuses(silent.0, silent.1).pop().expect("statuses go on");
    assert_eq!((last.state, last.safe_rate), (State::WaitingForTach, true));
    assert!(account.spectra(silent.0, silent.1).is_empty(), "no spectrum without a speed");
    account.assert_measures(after_silence, SPEED_HZ);

    let lost =
        |kinds: &[EventKind]| kinds.iter().any(|k| matches!(k, EventKind::TachStalled | EventKind::TachDoubtful));
    assert!(lost(&kinds((turning.0, turning.1 + 1.0))), "standstill is no measured speed: {:?}", kinds(turning));
    account.assert_measures(after_reversal, SPEED_HZ);

    let last = account.statuses(slow.0, slow.1).pop().expect("statuses go on");
    assert!((last.speed_hz - 2.0).abs() < 0.01 && last.validity == Validity::Locked, "{last:?}");
    account.assert_measures(fast, 20.0);
    assert!(account.statistics().relocks >= 4, "{:?}", account.statistics());
}

#[test]
fn fault_a_stuck_saturated_or_disconnected_converter() {
    let Some(machine) = machine("converter faults") else { return };
    let mut script = Script::new(2);
    let steady = |_: f64| SPEED_HZ;
    let before = script.run(5.0, steady, Disturbance::None);
    let stuck = script.run(2.0, steady, Disturbance::Codes(|_, _| 291.0));
    let after_stuck = script.run(5.0, steady, Disturbance::None);
    let saturated = script.run(2.0, steady, Disturbance::Codes(|code, _| 12.0 * code));
    let after_saturation = script.run(5.0, steady, Disturbance::None);
    // A sensor with a bias, off its wire: the input goes to the rail.
    let off = script.run(
        2.0,
        steady,
        Disturbance::Codes(|_, random| 32_767.0 - f64::from(rand::RngExt::random_range(random, 0..4u8))),
    );
    let after_all = script.run(6.0, steady, Disturbance::None);
    let (finished, account) = run(&machine, &script.image(Some(&configuration()), |header| header));
    assert_eq!(finished.count("lost") + finished.count("missed"), 0);
    for (part, kind) in [(stuck, EventKind::Stuck), (saturated, EventKind::Saturated), (off, EventKind::Saturated)] {
        let seen = account.events(part.0 - 0.1, part.1);
        assert!(seen.iter().any(|e| e.kind == kind), "{kind:?}: {seen:?}");
    }
    // Every block of it is counted: 24 to 48 kHz in blocks of 512.
    assert!(account.counted(EventKind::Stuck) > 80, "{}", account.counted(EventKind::Stuck));
    assert!(account.counted(EventKind::Saturated) > 160, "{}", account.counted(EventKind::Saturated));
    for part in [before, after_stuck, after_saturation, after_all] {
        // What was recorded during the fault may still come out.
        account.assert_measures((part.0 + 0.5, part.1), SPEED_HZ);
    }
}

#[test]
fn fault_a_processor_too_slow_for_the_rate_loses_whole_blocks_and_counts_them() {
    let Some(machine) = machine("overrun") else { return };
    // A law that asks for 64 kHz at 5 Hz, which 62 million instructions per second carry, and for 320 kHz at 25 Hz,
    // which they do not once there is a speed; at rest they do, and the self-test finds its samples.
    let mut config = configuration();
    config.law.form = LawForm::Quadratic { a_per_hz: 0.0, b: 5_000.0, c_hz: 0.0 };
    config.limits.highest_adc = Hertz(500_000.0);
    let mut script = Script::new(3);
    let before = script.run(6.0, |_| 5.0, Disturbance::None);
    let fast = script.run(6.0, |_| 25.0, Disturbance::None);
    let after = script.run(9.0, |_| 5.0, Disturbance::None);
    let (finished, account) = run(&Qemu { icount_shift: 4, ..machine }, &script.image(Some(&config), |header| header));
    let lost = finished.count("lost") + finished.count("missed");
    println!("{lost} of {} blocks lost", finished.count("blocks") + lost);
    assert!(lost > 10, "the processor kept up: nothing is proven");
    assert_eq!(account.statistics().blocks_lost, lost);
    assert!(account.counted(EventKind::BlocksLost) > 0 && account.counted(EventKind::Overrun) > 0);
    let seen = account.events(fast.0, fast.1 + 0.5);
    assert!(seen.iter().any(|e| e.kind == EventKind::BlocksLost), "{seen:?}");
    // Nothing is spliced: whatever spectrum came out is right, at whichever of the two speeds.
    for spectrum in account.spectra(0.0, after.1) {
        assert!(is_right(spectrum, 5.0) || is_right(spectrum, 25.0), "{:?}", spectrum.bands[0].line);
    }
    account.assert_measures(before, 5.0);
    account.assert_measures((after.0 + 1.0, after.1), 5.0);
}

#[test]
fn fault_the_self_test_at_boot_names_what_fails() {
    let Some(machine) = machine("self-test") else { return };
    let steady = |_: f64| SPEED_HZ;
    let mut slow = configuration();
    slow.limits.highest_adc = Hertz(500_000.0);
    slow.law.form = LawForm::Quadratic { a_per_hz: 0.0, b: 7_000.0, c_hz: 0.0 };
    // A sensor may settle for five seconds.
    for (name, disturbance, config, icount_shift, length_s, expected) in [
        ("sound", Disturbance::None, configuration(), 2, 2.5, 0),
        ("stuck", Disturbance::Codes(|_, _| 291.0), configuration(), 2, 6.0, NOISE),
        ("at its rail", Disturbance::Codes(|_, _| 32_767.0), configuration(), 2, 6.0, RAILS | NOISE),
        ("standing", Disturbance::NoPulses, configuration(), 2, 2.5, 0),
        // Blocks lost by a processor far too slow were sampled all the same: the converter is sound.
        ("loses blocks", Disturbance::None, slow, 5, 2.5, 0),
    ] {
        let mut script = Script::new(7);
        script.run(length_s, steady, disturbance);
        let image = script.image(Some(&config), |header| header);
        let finished = Qemu { icount_shift, ..machine.clone() }.run(&image).expect("the firmware ends well");
        let account = Account::of(&finished.link);
        let events = account.events(0.0, 7.0);
        let failed = events.iter().filter(|e| e.kind == EventKind::SelfTestFailed).map(|e| e.detail).next_back();
        assert_eq!(failed.unwrap_or(0), u32::from(expected), "{name}: {}", finished.console);
    }
}
