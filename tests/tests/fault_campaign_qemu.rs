//! Faults on the real image in QEMU: no panic, no hang, a defined state, every fault counted, recovery without a restart.
//!
//! The same faults as in `fault_campaign.rs`, here through timers, interrupts, queues and UART of a board. A panic, fault
//! or hang would end QEMU with an error ([`meshband_host::qemu`]). Times are those of the record, that is of the node.

use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::law::LawForm;
use meshband::message::{Message, Spectrum};
use meshband::node::State;
use meshband::self_test::{NOISE, RAILS, SAMPLE_COUNT, TACH};
use meshband::tach::Validity;
use meshband::units::Hertz;
use meshband_host::qemu::{Finished, Qemu};
use meshband_host::virtual_node::simulation;
use meshband_tests::gear_signal::FIRST_HARMONIC_M_S2;
use meshband_tests::plant::{TEETH, configuration};
use meshband_tests::qemu_node::{check_stack, machine};
use meshband_tests::script::{Account, Disturbance, Script, seconds};

const SPEED_HZ: f64 = 15.0;

/// Runs a record to its end and compares every byte with the host's node on the same blocks.
fn run(machine: &Qemu, image: &[u8]) -> (Finished, Account) {
    let finished = machine.run(image).expect("the firmware ends well");
    let followed = simulation::follow(image, &finished.blocks().expect("a whole log")).expect("runs");
    assert!(finished.link == followed.link, "QEMU and host differ: {}", finished.console);
    assert_eq!(finished.count("edges_lost"), 0, "{}", finished.console);
    let account = Account::of(&finished.link);
    assert_eq!((account.received.refused, account.received.lost), (0, 0));
    let (boot, operation) = check_stack(&finished);
    let wall = finished.wall_time.as_secs_f64();
    let sent = finished.link.len();
    println!("{wall:.1} s of host time; {sent} bytes sent; stack: {boot} bytes at start, {operation} in operation");
    (finished, account)
}

fn counted(account: &Account, kind: EventKind) -> u32 {
    account.statistics().events[kind as usize]
}

fn is_right(spectrum: &Spectrum, speed_hz: f64) -> bool {
    let line = spectrum.bands[0].line;
    let frequency = f64::from(line.frequency_hz) / (speed_hz * f64::from(TEETH)) - 1.0;
    let amplitude = f64::from(line.amplitude) / FIRST_HARMONIC_M_S2 - 1.0;
    frequency.abs() < 5e-4 && amplitude.abs() < 0.06
}

/// In the last part of a stretch the node measures and its spectra are right.
fn assert_measures(account: &Account, (from_s, to_s): (f64, f64), speed_hz: f64) {
    // Records that reach into the next part are none of this one's.
    let ends_s = |s: &Spectrum| seconds(s.tag.first_tick) + f64::from(s.turns) / f64::from(s.tag.speed_hz);
    let mut spectra = account.spectra(from_s + 0.5, to_s);
    spectra.retain(|s| ends_s(s) < to_s);
    assert!(!spectra.is_empty(), "no spectrum from {from_s} s to {to_s} s");
    for spectrum in spectra {
        let what = (spectrum.bands[0].line, spectrum.tag.speed_hz);
        assert!(is_right(spectrum, speed_hz), "{what:?} between {from_s} s and {to_s} s");
    }
    let statuses = account.statuses(from_s, to_s);
    let last = statuses.last().expect("statuses come each second");
    assert_eq!((last.state, last.validity, last.safe_rate), (State::Measuring, Validity::Locked, false), "{to_s} s");
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

    assert_measures(&account, before, SPEED_HZ);
    let spurious = account.statistics().pulses_spurious;
    assert!(spurious > 80, "{spurious} of 160 extra pulses counted");
    for status in account.statuses(noisy.0, noisy.1) {
        let right = (f64::from(status.speed_hz) / SPEED_HZ - 1.0).abs() < 0.05;
        assert!(right || status.validity != Validity::Locked, "{status:?}");
    }
    assert_measures(&account, after_noise, SPEED_HZ);

    let kinds = |(from_s, to_s): (f64, f64)| account.events(from_s, to_s).iter().map(|e| e.kind).collect::<Vec<_>>();
    assert!(kinds(silent).contains(&EventKind::TachDoubtful), "{:?}", kinds(silent));
    let last = account.statuses(silent.0, silent.1).pop().expect("statuses go on");
    assert_eq!((last.state, last.safe_rate), (State::WaitingForTach, true));
    assert!(account.spectra(silent.0, silent.1).is_empty(), "no spectrum without a speed");
    assert_measures(&account, after_silence, SPEED_HZ);

    let lost =
        |kinds: &[EventKind]| kinds.iter().any(|k| matches!(k, EventKind::TachStalled | EventKind::TachDoubtful));
    assert!(lost(&kinds((turning.0, turning.1 + 1.0))), "standstill is no measured speed: {:?}", kinds(turning));
    assert_measures(&account, after_reversal, SPEED_HZ);

    let last = account.statuses(slow.0, slow.1).pop().expect("statuses go on");
    assert!((last.speed_hz - 2.0).abs() < 0.01 && last.validity == Validity::Locked, "{last:?}");
    assert_measures(&account, fast, 20.0);
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
    assert!(counted(&account, EventKind::Stuck) > 80, "{}", counted(&account, EventKind::Stuck));
    assert!(counted(&account, EventKind::Saturated) > 160, "{}", counted(&account, EventKind::Saturated));
    for part in [before, after_stuck, after_saturation, after_all] {
        // What was recorded during the fault may still come out.
        assert_measures(&account, (part.0 + 0.5, part.1), SPEED_HZ);
    }
}

#[test]
fn fault_a_processor_too_slow_for_the_rate_loses_whole_blocks_and_counts_them() {
    let Some(machine) = machine("overrun") else { return };
    // A law that asks for 77 kHz at 5 Hz, which 62 million instructions per second carry, and for 384 kHz at 25 Hz, which
    // they do not.
    let mut config = configuration();
    config.law.form = LawForm::Quadratic { a_per_hz: 0.0, b: 6_000.0, c_hz: 0.0 };
    config.limits.highest_adc = Hertz(500_000.0);
    let mut script = Script::new(3);
    let before = script.run(6.0, |_| 5.0, Disturbance::None);
    let fast = script.run(3.0, |_| 25.0, Disturbance::None);
    let after = script.run(9.0, |_| 5.0, Disturbance::None);
    let (finished, account) = run(&Qemu { icount_shift: 4, ..machine }, &script.image(Some(&config), |header| header));
    let lost = finished.count("lost") + finished.count("missed");
    println!("{lost} of {} blocks lost", finished.count("blocks") + lost);
    assert!(lost > 20, "the processor kept up: nothing is proven");
    assert_eq!(account.statistics().blocks_lost, lost);
    assert!(counted(&account, EventKind::BlocksLost) > 0 && counted(&account, EventKind::Overrun) > 0);
    let seen = account.events(fast.0, fast.1 + 0.5);
    assert!(seen.iter().any(|e| e.kind == EventKind::BlocksLost), "{seen:?}");
    // Nothing is spliced: whatever spectrum came out is right, at whichever of the two speeds.
    for spectrum in account.spectra(0.0, after.1) {
        assert!(is_right(spectrum, 5.0) || is_right(spectrum, 25.0), "{:?}", spectrum.bands[0].line);
    }
    assert_measures(&account, before, 5.0);
    assert_measures(&account, (after.0 + 1.0, after.1), 5.0);
}

/// The link faults need a socket that stalls.
#[cfg(unix)]
mod link {
    use super::*;
    use meshband::frame::{Decoder, Frame, MAX_FRAME, Packet, encode};
    use meshband::message::{Reply, Request};
    use meshband_host::virtual_node::frames::Received;
    use meshband_tests::qemu_node::power_up_on_socket;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::io::{Read, Write};
    use std::os::unix::net::UnixStream;
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
    use std::time::Duration;

    /// The host's end, by hand: what it reads and when is the fault.
    struct Wire {
        stream: UnixStream,
        decoder: Decoder,
        frames: Vec<Frame>,
        sequence: u16,
    }

    impl Wire {
        fn new(stream: UnixStream) -> Self {
            stream.set_read_timeout(Some(Duration::from_secs(30))).expect("a socket");
            Self { stream, decoder: Decoder::new(), frames: Vec::new(), sequence: 0 }
        }

        fn send(&mut self, request: &Request) {
            let mut buffer = [0; MAX_FRAME];
            let frame = encode(request, self.sequence, &mut buffer).expect("fits");
            self.sequence = self.sequence.wrapping_add(1);
            self.stream.write_all(frame).expect("the node takes it");
        }

        /// Reads on until a frame tells enough; false at the link's end.
        fn read_until(&mut self, enough: impl Fn(&Packet) -> bool) -> bool {
            let mut buffer = [0; 1024];
            loop {
                let count = self.stream.read(&mut buffer).expect("the node is not silent");
                if count == 0 {
                    return false;
                }
                let mut reached = false;
                for &byte in &buffer[..count] {
                    if let Some(Ok(frame)) = self.decoder.push(byte) {
                        reached |= enough(&frame.packet);
                        self.frames.push(frame);
                    }
                }
                if reached {
                    return true;
                }
            }
        }

        fn account(self) -> Account {
            let (refused, lost) = (self.decoder.refused(), self.decoder.lost());
            let packets = self.frames.into_iter().map(|frame| frame.packet).collect();
            Account { received: Received { packets, refused, lost } }
        }
    }

    fn status_at(time_s: f64) -> impl Fn(&Packet) -> bool {
        move |packet| matches!(packet, Packet::Message(Message::Status(s)) if seconds(s.tick) >= time_s)
    }

    fn started(machine: &Qemu, script: &Script, folder: &std::path::Path) -> (meshband_host::qemu::Running, Wire) {
        let image =
            script.image(Some(&configuration()), |header| meshband::replay::Header { waits_for_start: true, ..header });
        let (running, stream) = power_up_on_socket(machine, &image, folder);
        let mut wire = Wire::new(stream);
        wire.send(&Request::Start);
        (running, wire)
    }

    #[test]
    fn fault_a_host_that_stops_reading_costs_whole_frames_that_are_counted_exactly() {
        let Some(machine) = machine("link stall") else { return };
        let folder = tempfile::tempdir().expect("a folder");
        let mut script = Script::new(4);
        let (_, end_s) = script.run(60.0, |_| SPEED_HZ, Disturbance::None);
        let (running, mut wire) = started(&machine, &script, folder.path());
        assert!(wire.read_until(status_at(5.0)));
        // More answers than the queue of 8 KiB holds, and a waveform, while nobody reads.
        wire.send(&Request::Snapshot);
        (0..600).for_each(|_| wire.send(&Request::Identify));
        std::thread::sleep(Duration::from_millis(50));
        assert!(wire.read_until(status_at(0.0)), "the node goes on");
        assert!(!wire.read_until(|_| false));
        let account = wire.account();
        let finished = running.finish().expect("the firmware ends well");
        let dropped = finished.count("dropped");
        let resumed = account.statuses(5.1, end_s).first().map_or(end_s, |s| seconds(s.tick));
        println!(
            "{dropped} frames dropped; statuses again from {resumed:.1} s on; stack: {:?} bytes",
            check_stack(&finished)
        );
        assert!(dropped > 20 && resumed < 40.0, "{dropped} frames dropped, statuses again from {resumed} s on");
        assert_eq!(account.received.lost, dropped, "the host counts what the node dropped");
        assert_eq!(account.received.refused, 0, "only whole frames");
        let reported: u32 =
            account.events(0.0, end_s).iter().filter(|e| e.kind == EventKind::MessagesDropped).map(|e| e.detail).sum();
        assert_eq!(reported, dropped, "and the node reports it");
        assert_eq!(finished.count("lost") + finished.count("missed"), 0, "no block is lost for it");
        assert_measures(&account, (resumed + 2.0, end_s), SPEED_HZ);
    }

    #[test]
    fn fault_a_minute_of_random_bytes_changes_nothing_but_a_counter() {
        let Some(machine) = machine("random bytes") else { return };
        let folder = tempfile::tempdir().expect("a folder");
        let mut script = Script::new(5);
        let (_, end_s) = script.run(72.0, |_| SPEED_HZ, Disturbance::None);
        let (running, mut wire) = started(&machine, &script, folder.path());
        assert!(wire.read_until(status_at(4.0)));
        let (quiet, sent) = (AtomicBool::new(false), AtomicUsize::new(0));
        let mut line = wire.stream.try_clone().expect("a second handle");
        let before = wire.frames.len();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut random = ChaCha8Rng::seed_from_u64(5);
                let mut bytes = [0; 16];
                while !quiet.load(Ordering::Relaxed) {
                    random.fill_bytes(&mut bytes);
                    line.write_all(&bytes).expect("the node takes it");
                    sent.fetch_add(bytes.len(), Ordering::Relaxed);
                }
            });
            assert!(wire.read_until(status_at(64.0)));
            quiet.store(true, Ordering::Relaxed);
        });
        let noise = wire.frames[before..].iter().filter(|f| matches!(f.packet, Packet::Reply(_))).count();
        assert_eq!(noise, 0, "noise was never taken for a command");
        // The delimiter ends what noise began; the first command after it is answered.
        wire.stream.write_all(&[0]).expect("the node takes it");
        wire.send(&Request::GetConfiguration);
        let mine = |packet: &Packet| matches!(packet, Packet::Reply(Reply::Configuration(_)));
        assert!(wire.read_until(mine), "an answer before the record's end");
        let held = wire
            .frames
            .iter()
            .find_map(|f| if let Packet::Reply(Reply::Configuration(c)) = &f.packet { Some(c.clone()) } else { None });
        assert_eq!(held, Some(configuration()));
        assert!(!wire.read_until(|_| false));
        let account = wire.account();
        let finished = running.finish().expect("the firmware ends well");
        let refused = counted(&account, EventKind::FramesRefused);
        let sent = sent.into_inner();
        let stack = check_stack(&finished);
        println!("{sent} random bytes in 60 s of the node's time, {refused} pieces refused; stack: {stack:?} bytes");
        // One byte in 256 is a delimiter.
        assert!(sent > 20_000 && refused as usize > sent / 1_000, "{refused} pieces of {sent} bytes");
        assert_eq!(finished.count("lost") + finished.count("missed") + finished.count("dropped"), 0);
        assert_measures(&account, (4.0, end_s), SPEED_HZ);
    }
}

#[test]
fn fault_the_self_test_at_boot_names_what_fails() {
    let Some(machine) = machine("self-test") else { return };
    let steady = |_: f64| SPEED_HZ;
    let mut slow = configuration();
    slow.limits.highest_adc = Hertz(500_000.0);
    slow.law.form = LawForm::Quadratic { a_per_hz: 0.0, b: 7_000.0, c_hz: 0.0 };
    for (name, disturbance, config, icount_shift, expected) in [
        ("sound", Disturbance::None, configuration(), 2, 0),
        ("stuck", Disturbance::Codes(|_, _| 291.0), configuration(), 2, NOISE),
        ("at its rail", Disturbance::Codes(|_, _| 32_767.0), configuration(), 2, RAILS | NOISE),
        ("no tach", Disturbance::NoPulses, configuration(), 2, TACH),
        ("loses samples", Disturbance::None, slow, 5, SAMPLE_COUNT),
    ] {
        let mut script = Script::new(7);
        script.run(2.5, steady, disturbance);
        let image = script.image(Some(&config), |header| header);
        let finished = Qemu { icount_shift, ..machine.clone() }.run(&image).expect("the firmware ends well");
        let account = Account::of(&finished.link);
        let events = account.events(0.0, 3.0);
        let failed = events.iter().filter(|e| e.kind == EventKind::SelfTestFailed).map(|e| e.detail).next_back();
        assert_eq!(failed.unwrap_or(0), u32::from(expected), "{name}: {}", finished.console);
    }
}

#[test]
fn fault_commits_while_measuring_do_not_disturb_the_measurement() {
    use meshband::replay::Header;
    use meshband_tests::qemu_node::power_up_with_client;
    use std::time::Duration;

    let Some(machine) = machine("commits") else { return };
    let mut script = Script::new(8);
    let (_, end_s) = script.run(30.0, |_| SPEED_HZ, Disturbance::None);
    let image = script.image(Some(&configuration()), |header| Header { waits_for_start: true, ..header });
    let (running, mut client) = power_up_with_client(&machine, &image);
    // A sector holds 64 records: the one used first is full when the measurement begins, so the other is erased in it.
    for number in 0..66 {
        if number == 63 {
            client.start().expect("starts");
        }
        client.commit().expect("stored");
    }
    let mut spectra = Vec::new();
    while let Some(message) = client.next_message(Duration::from_secs(30)).expect("the link works") {
        spectra.extend(if let Message::Spectrum(spectrum) = message { Some(spectrum) } else { None });
    }
    let finished = running.finish().expect("the firmware ends well");
    assert_eq!(finished.count("lost") + finished.count("missed"), 0, "{}", finished.console);
    assert!(spectra.iter().all(|spectrum| is_right(spectrum, SPEED_HZ)));
    assert!(spectra.len() as f64 > 0.6 * end_s, "{} spectra in {end_s} s", spectra.len());
    check_stack(&finished);
}

#[test]
fn fault_a_damaged_configuration_memory_gives_the_default_and_takes_a_new_one() {
    use meshband::message::Request;
    use meshband::replay::{Header, IMAGE_CAPACITY};
    use meshband_tests::qemu_node::power_up_with_client;
    use rand::{Rng, RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use std::time::Duration;

    let Some(machine) = machine("damaged configuration") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let memory = folder.path().join("memory.bin");
    let machine = Qemu { memory: Some(memory.clone()), ..machine };
    let mut script = Script::new(6);
    script.run(4.0, |_| SPEED_HZ, Disturbance::None);
    let image = script.image(None, |header| Header { waits_for_start: true, ..header });
    let wanted = configuration();
    let store = |config: &Configuration| {
        let (running, mut client) = power_up_with_client(&machine, &image);
        client.set_configuration(config).expect("accepted");
        client.commit().expect("stored");
        drop(running);
    };
    store(&wanted);
    let sound = std::fs::read(&memory).expect("the memory is kept");
    let used = (IMAGE_CAPACITY..sound.len()).filter(|&at| sound[at] != 0xff).max().expect("something is stored") + 1;
    println!("{} bytes of the memory are in use", used - IMAGE_CAPACITY);
    let mut random = ChaCha8Rng::seed_from_u64(6);
    let mut defaults = 0;
    for case in 0..8 {
        let mut damaged = sound.clone();
        match case {
            0..=4 => damaged[random.random_range(IMAGE_CAPACITY..used)] ^= 1 << random.random_range(0..8),
            5 => random.fill_bytes(&mut damaged[IMAGE_CAPACITY..]),
            6 => damaged[IMAGE_CAPACITY..used].fill(0),
            _ => damaged[(IMAGE_CAPACITY + used) / 2..used].fill(0xff),
        }
        std::fs::write(&memory, &damaged).expect("writable");
        let (running, mut client) = power_up_with_client(&machine, &image);
        let held = client.configuration().expect("an answer");
        assert!(held == wanted || held == Configuration::default(), "case {case}: neither stored nor default");
        let refused = client.statistics().expect("an answer").events[EventKind::ConfigurationRefused as usize];
        assert_eq!(refused, u32::from(held != wanted), "case {case}: counted where it was not taken");
        defaults += u32::from(held != wanted);
        // Without a restart: a new one over the link, and the measurement.
        client.set_configuration(&wanted).expect("accepted");
        client.commit().expect("stored");
        if case < 5 {
            drop(running);
        } else {
            assert_eq!(client.request(&Request::Start).expect("an answer"), meshband::message::Reply::Done);
            let mut spectra = 0;
            while let Some(message) = client.next_message(Duration::from_secs(30)).expect("the link works") {
                spectra += u32::from(matches!(message, Message::Spectrum(s) if is_right(&s, SPEED_HZ)));
            }
            let finished = running.finish().expect("the firmware ends well");
            assert!(spectra > 0, "case {case}: {}", finished.console);
            check_stack(&finished);
        }
        let (running, mut client) = power_up_with_client(&machine, &image);
        assert_eq!(client.configuration().expect("an answer"), wanted, "case {case}: the new one is kept");
        drop(running);
    }
    println!("{defaults} of 8 damages were refused and replaced by the default");
    assert!(defaults >= 3);
}
