//! Faults of the link and of the configuration's memory on the real image in QEMU: a host that stops reading, random
//! bytes, commits while measuring, damaged memory.
//!
//! As in `fault_campaign_qemu.rs`, a panic, fault or hang would end QEMU with an error; times are those of the record.
//! The line is a Unix socket where the host's pace is the fault: it holds next to nothing.
#![cfg(unix)]

use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::frame::{Decoder, Frame, MAX_FRAME, Packet, encode};
use meshband::message::{Message, Reply, Request};
use meshband::replay::{Header, IMAGE_CAPACITY};
use meshband_host::virtual_node::frames::Received;
use meshband_host::virtual_node::qemu::{Qemu, Running};
use meshband_tests::plant::configuration;
use meshband_tests::qemu_node::{check_stack, machine, power_up_on_socket, power_up_with_client};
use meshband_tests::script::{Account, Disturbance, Script, is_right, seconds};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

const SPEED_HZ: f64 = 15.0;

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

fn started(machine: &Qemu, script: &Script, folder: &Path) -> (Running, Wire) {
    let image = script.image(Some(&configuration()), |header| Header { waits_for_start: true, ..header });
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
    account.assert_measures((resumed + 2.0, end_s), SPEED_HZ);
}

#[test]
fn fault_a_minute_of_random_bytes_changes_nothing_but_a_counter() {
    let Some(machine) = machine("random bytes") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut script = Script::new(5);
    let (_, end_s) = script.run(86.0, |_| SPEED_HZ, Disturbance::None);
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
    // What noise is still on its way fills the node's queue and takes the bytes behind it along: it must be over.
    assert!(wire.read_until(status_at(66.0)));
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
    let refused = account.counted(EventKind::FramesRefused);
    let sent = sent.into_inner();
    let stack = check_stack(&finished);
    println!("{sent} random bytes in 60 s of the node's time, {refused} pieces refused; stack: {stack:?} bytes");
    // One byte in 256 is a delimiter.
    assert!(sent > 20_000 && refused as usize > sent / 1_000, "{refused} pieces of {sent} bytes");
    assert_eq!(finished.count("lost") + finished.count("missed") + finished.count("dropped"), 0);
    account.assert_measures((4.0, end_s), SPEED_HZ);
}

#[test]
fn fault_commits_while_measuring_do_not_disturb_the_measurement() {
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
        let refused = client.statistics().expect("an answer").count(EventKind::ConfigurationRefused);
        assert_eq!(refused, u32::from(held != wanted), "case {case}: counted where it was not taken");
        defaults += u32::from(held != wanted);
        // Without a restart: a new one over the link, and the measurement.
        client.set_configuration(&wanted).expect("accepted");
        client.commit().expect("stored");
        if case < 5 {
            drop(running);
        } else {
            assert_eq!(client.request(&Request::Start).expect("an answer"), Reply::Done);
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
