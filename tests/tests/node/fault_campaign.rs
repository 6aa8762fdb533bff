//! Faults on the host's plant: no panic, a defined state, every fault counted, recovery without a restart.

use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::frame::{MAX_FRAME, Packet, encode};
use meshband::message::{Message, Reply, Request};
use meshband::node::State;
use meshband::store::{Origin, Store};
use meshband::tach::Validity;
use meshband::units::TicksPerSecond;
use meshband_tests::mock_flash::MockFlash;
use meshband_tests::plant::{CLOCK_HZ, Fault, Plant, TEETH, configuration};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const SPEED_HZ: f64 = 15.0;

/// A plant that has measured steadily for a while.
fn healthy(seed: u64) -> Plant {
    let mut plant = Plant::new(configuration(), seed);
    plant.run(4.0, |_| SPEED_HZ, Fault::None);
    assert_measures(&plant, 0, SPEED_HZ, "before the fault");
    plant
}

/// State, speed and a right spectrum among the frames from number `from` on.
fn assert_measures(plant: &Plant, from: usize, speed_hz: f64, when: &str) {
    let node = plant.session.node();
    assert_eq!(node.state(), State::Measuring, "{when}");
    let spectrum = plant.spectrum_since(from).unwrap_or_else(|| panic!("no spectrum {when}"));
    let expected = speed_hz * f64::from(TEETH);
    let frequency = f64::from(spectrum.bands[0].line.frequency_hz);
    assert!((frequency / expected - 1.0).abs() < 5e-4, "{frequency} for {expected} Hz {when}");
    let amplitude = f64::from(spectrum.bands[0].line.amplitude);
    assert!((amplitude / 10.0 - 1.0).abs() < 0.06, "{amplitude} m/s2 for 10 {when}");
    assert_eq!(spectrum.tag.validity, Validity::Locked);
}

/// Steady speed after the fault: products come again and are right.
fn assert_recovers(plant: &mut Plant, speed_hz: f64) {
    // What was recorded during the fault may still come out; then only new things.
    plant.run(2.5, |_| speed_hz, Fault::None);
    let from = plant.frames.len();
    plant.run(3.5, |_| speed_hz, Fault::None);
    assert_measures(plant, from, speed_hz.abs(), "after the fault");
    assert_eq!(plant.session.unsent(), 0);
}

#[test]
fn fault_tach_noise_is_counted_and_leaves_the_speed_right_or_flagged() {
    for rate in [5.0, 40.0, 400.0] {
        let mut plant = healthy(1);
        let from = plant.frames.len();
        plant.run(4.0, |_| SPEED_HZ, Fault::Pulses(rate));
        let spurious = plant.session.node().statistics().pulses_spurious;
        assert!(f64::from(spurious) > 0.5 * rate * 4.0, "{spurious} of about {} extra pulses counted", rate * 4.0);
        for frame in &plant.frames[from..] {
            if let Packet::Message(Message::Status(status)) = &frame.packet
                && status.validity == Validity::Locked
            {
                assert!((f64::from(status.speed_hz) / SPEED_HZ - 1.0).abs() < 0.05, "{rate}/s: {}", status.speed_hz);
            }
        }
        assert_recovers(&mut plant, SPEED_HZ);
    }
}

#[test]
fn fault_a_tach_that_drops_out_is_an_event_and_the_safe_rate() {
    let mut plant = healthy(2);
    // An overdue pulse makes the speed doubtful; the slowest believable shaft (0.25 Hz) is waited for before it stands.
    plant.run(2.0, |_| SPEED_HZ, Fault::NoPulses);
    assert_eq!(plant.count(EventKind::TachDoubtful), 1);
    let from = plant.frames.len();
    plant.run(12.0, |_| SPEED_HZ, Fault::NoPulses);
    assert!(plant.spectrum_since(from).is_none(), "no spectrum without a speed");
    assert_eq!(plant.session.node().state(), State::WaitingForTach);
    assert!(plant.status().expect("statuses go on").safe_rate);
    assert_recovers(&mut plant, SPEED_HZ);
}

#[test]
fn fault_a_reversal_loses_the_speed_and_finds_it_again() {
    let mut plant = healthy(3);
    let lost = |plant: &Plant| plant.count(EventKind::TachStalled) + plant.count(EventKind::TachDoubtful);
    let before = lost(&plant);
    plant.run(3.0, |t| SPEED_HZ * (1.0 - t / 1.5), Fault::None);
    assert!(lost(&plant) > before, "passing standstill is not a measured speed");
    assert_recovers(&mut plant, -SPEED_HZ);
}

#[test]
fn fault_a_tenfold_step_of_speed_is_followed_both_ways() {
    let mut plant = Plant::new(configuration(), 4);
    plant.run(12.0, |_| 2.0, Fault::None);
    let locks = plant.session.node().statistics().relocks;
    plant.run(0.5, |_| 20.0, Fault::None);
    assert!(plant.session.node().statistics().relocks > locks, "a new speed is a new lock");
    assert_recovers(&mut plant, 20.0);
    plant.run(8.0, |_| 2.0, Fault::None);
    let status = plant.status().expect("statuses go on");
    assert!((status.speed_hz - 2.0).abs() < 0.01 && status.validity == Validity::Locked, "{status:?}");
}

#[test]
fn fault_a_stuck_saturated_or_disconnected_converter_is_an_event() {
    let stuck: fn(u16, &mut ChaCha8Rng) -> u16 = |_, _| 0x8123;
    let saturated: fn(u16, &mut ChaCha8Rng) -> u16 = |code, _| {
        let amplified = (i32::from(code) - 0x8000) * 12 + 0x8000;
        amplified.clamp(0, 0xffff) as u16
    };
    // A sensor with a bias, off its wire: the input goes to the rail.
    let disconnected: fn(u16, &mut ChaCha8Rng) -> u16 = |_, random| 0xffff - random.random_range(0..4u16);
    for (fault, kind) in
        [(stuck, EventKind::Stuck), (saturated, EventKind::Saturated), (disconnected, EventKind::Saturated)]
    {
        let mut plant = healthy(5);
        plant.run(2.0, |_| SPEED_HZ, Fault::Codes(fault));
        assert!(plant.count(kind) > 10, "{kind:?}: {}", plant.count(kind));
        assert_recovers(&mut plant, SPEED_HZ);
    }
}

#[test]
fn fault_overruns_and_lost_blocks_are_counted_and_never_spliced() {
    let mut plant = healthy(6);
    let from = plant.frames.len();
    plant.run(2.0, |_| SPEED_HZ, Fault::Overrun);
    assert!(plant.count(EventKind::Overrun) >= 5);
    plant.run(2.0, |_| SPEED_HZ, Fault::LostBlocks);
    let statistics = plant.session.node().statistics();
    assert!(statistics.blocks_lost >= 5 && statistics.blocks_lost == plant.count(EventKind::BlocksLost));
    // Ten blocks are too few for a mesh-band record: a splice would show as a spectrum.
    let spectra = plant.frames[from..]
        .iter()
        .filter(|f| matches!(&f.packet, Packet::Message(Message::Spectrum(s)) if s.bands[0].line.amplitude < 9.0));
    assert_eq!(spectra.count(), 0);
    assert_recovers(&mut plant, SPEED_HZ);
}

#[test]
fn fault_a_link_that_stalls_costs_whole_frames_that_are_counted_exactly() {
    let mut plant = healthy(7);
    assert_eq!(plant.decoder.lost(), 0);
    plant.request(&Request::Snapshot);
    plant.run(3.0, |_| SPEED_HZ, Fault::Stall);
    for _ in 0..200 {
        plant.request(&Request::Identify);
    }
    let dropped = plant.ring.dropped();
    assert!(dropped > 20, "{dropped} frames dropped");
    assert_eq!(plant.session.node().state(), State::Measuring, "the measurement goes on");
    plant.drain();
    assert_recovers(&mut plant, SPEED_HZ);
    assert_eq!(plant.decoder.lost(), plant.ring.dropped(), "the host counts what the node dropped");
    assert_eq!(plant.decoder.refused(), 0, "only whole frames");
    let reported: u32 = plant
        .frames
        .iter()
        .filter_map(|f| match &f.packet {
            Packet::Message(Message::Event(e)) if e.kind == EventKind::MessagesDropped => Some(e.detail * e.count),
            _ => None,
        })
        .sum();
    assert_eq!(reported, plant.ring.dropped());
}

#[test]
fn fault_a_minute_of_random_bytes_changes_nothing_but_a_counter() {
    let mut plant = healthy(8);
    let from = plant.frames.len();
    // 921 600 bit/s, all the line carries.
    plant.run(60.0, |_| SPEED_HZ, Fault::RandomBytes(92_160.0));
    assert_measures(&plant, from, SPEED_HZ, "under random bytes");
    assert!(plant.count(EventKind::FramesRefused) > 10_000, "{}", plant.count(EventKind::FramesRefused));
    assert_eq!(plant.session.node().configuration(), &configuration());
    let answers = |plant: &Plant| plant.frames.iter().filter(|f| matches!(f.packet, Packet::Reply(_))).count();
    assert_eq!(answers(&plant), 0, "noise was never taken for a command");
    plant.request(&Request::Identify);
    plant.drain();
    assert_eq!(answers(&plant), 1, "the first command after it is answered");
    assert_recovers(&mut plant, SPEED_HZ);
}

#[test]
fn fault_damaged_commands_are_carried_out_whole_or_not_at_all() {
    let mut plant = healthy(9);
    let mut random = ChaCha8Rng::seed_from_u64(9);
    let mut held = configuration();
    let (mut accepted, mut buffer) = (0, [0; MAX_FRAME]);
    for number in 0..20_000u32 {
        let mut config = configuration();
        config.gears.gear_teeth = 20 + (number % 500) as u16;
        let frame = encode(&Request::SetConfiguration(config.clone()), number as u16, &mut buffer).expect("fits");
        for byte in frame.iter().copied() {
            let flip = if random.random_bool(0.01) { random.random() } else { 0 };
            plant.receive(byte ^ flip);
        }
        let now = plant.session.node().configuration().clone();
        if now != held {
            assert_eq!(now, config, "a configuration nobody sent");
            accepted += 1;
        }
        held = now;
    }
    assert!(accepted > 1_000 && accepted < 19_000, "{accepted}");
    plant.request(&Request::SetConfiguration(configuration()));
    plant.drain();
    assert_recovers(&mut plant, SPEED_HZ);
}

#[test]
fn fault_a_corrupt_stored_configuration_is_replaced_over_the_link() {
    let mut flash = MockFlash::<4096, 4>::new(2, ChaCha8Rng::seed_from_u64(10));
    let mut store = Store::new(flash.clone(), 0);
    store.save(&configuration()).expect("room");
    flash = store.flash_mut().clone();
    flash.bytes[60] ^= 0x20;
    let mut store = Store::new(flash, 0);
    let (config, origin) = store.load(TicksPerSecond(CLOCK_HZ));
    assert_eq!((&config, origin), (&Configuration::default(), Origin::Damaged));
    let mut plant = Plant::new(config, 10);
    plant.session.node_mut().note(EventKind::ConfigurationRefused, origin.complaint().expect("a complaint"));
    plant.request(&Request::SetConfiguration(configuration()));
    plant.request(&Request::CommitConfiguration);
    assert!(plant.session.take_commit());
    store.save(plant.session.node().configuration()).expect("room");
    plant.session.on_stored(true);
    assert_recovers(&mut plant, SPEED_HZ);
    assert_eq!(plant.count(EventKind::ConfigurationRefused), 1);
    let replies = plant.frames.iter().filter(|f| matches!(f.packet, Packet::Reply(Reply::Done | Reply::Committing)));
    assert_eq!(replies.count(), 2);
    assert_eq!(store.load(TicksPerSecond(CLOCK_HZ)), (configuration(), Origin::Stored));
}
