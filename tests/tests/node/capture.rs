//! Waveforms before and behind an alarm: what is held, how exactly, and what the node says where it is not whole.

use super::node_alarms::{Watch, configuration};
use meshband::config::{CaptureConfig, CaptureRate, Configuration};
use meshband::events::EventKind;
use meshband::message::{Reply, Request};
use meshband::sample_ring::{BLOCK, BLOCKS, decode, encode};
use meshband::units::Hertz;
use meshband::waveform::{CaptureEnd, CaptureHead, CapturePhase, CaptureReport, PART_BYTES, Trigger};
use meshband_host::link::capture::{Waveform, await_held, fetch};
use meshband_host::link::client::Client;
use meshband_host::link::transport::Transport;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;
use std::time::Duration;

fn keeping() -> Configuration {
    Configuration { capture: CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(0.0) }, ..configuration() }
}

fn ask(watch: &mut Watch, request: Request) -> CaptureReport {
    match watch.session.node_mut().on_request(request) {
        Reply::Capture(report) => report,
        other => panic!("{other:?}"),
    }
}

fn read(watch: &mut Watch, head: &CaptureHead) -> Vec<u8> {
    let mut bytes = Vec::new();
    for offset in (0..head.bytes).step_by(PART_BYTES) {
        let request = Request::ReadCapture { number: head.facts.number, offset };
        let Reply::CapturePart(part) = watch.session.node_mut().on_request(request) else { panic!("a part") };
        bytes.extend_from_slice(&part.bytes);
    }
    bytes
}

fn waveform(watch: &mut Watch) -> Waveform {
    let head = ask(watch, Request::GetCapture).head.expect("held");
    let bytes = read(watch, &head);
    Waveform::of_bytes(&head, &bytes).expect("whole")
}

/// A block's error against its largest sample, over loud and quiet blocks.
#[test]
fn theory_a_sample_is_held_within_a_127th_of_its_block_s_largest_and_a_32nd_of_a_code() {
    let mut random = ChaCha8Rng::seed_from_u64(17);
    for n in 0..2000 {
        let amplitude = 32_768.0 * 0.99f32.powi(n);
        let samples: [f32; BLOCK] = std::array::from_fn(|_| random.random_range(-amplitude..=amplitude));
        let largest = samples.iter().fold(0.0f32, |largest, sample| largest.max(sample.abs()));
        let bound = largest / 127.0 + 1.0 / 31.0;
        for (sample, unit) in samples.iter().zip(decode(&encode(&samples))) {
            let error = (sample - unit as f32 / 16.0).abs();
            assert!(error <= bound, "block {n}: {sample} became {}", unit as f32 / 16.0);
        }
    }
}

#[test]
fn ref_a_waveform_asked_for_is_the_sine_of_its_instants_for_two_seconds_at_ten_kilohertz() {
    let mut watch = Watch::new(keeping());
    watch.run(5.0, 3.0);
    assert_eq!(ask(&mut watch, Request::TriggerCapture).phase, CapturePhase::Collecting);
    watch.run(1.0, 3.0);
    let held = waveform(&mut watch);
    assert_eq!((held.facts.trigger, held.facts.end), (Trigger::Request, CaptureEnd::Full));
    assert!(held.rate_hz() >= 10_000.0 && held.duration_s() >= 1.92, "{}", held.summary());
    assert_eq!(held.samples.len(), BLOCK * BLOCKS);
    let after_s = held.duration_s() - held.trigger_s();
    assert!((after_s / held.duration_s() - 0.25).abs() < 0.01, "a quarter follows: {}", held.summary());
    let clock = f64::from(held.facts.ticks_per_second);
    // The node counts from a whole wrap of the board's counter.
    let first = f64::from(held.facts.first_tick as u32);
    for (n, sample) in held.samples.iter().enumerate() {
        let tick = first + n as f64 * f64::from(held.facts.period_ticks);
        let sine = 3.0 * (TAU * (400.0 * tick / clock).fract()).sin();
        assert!((sample - sine).abs() < 0.035, "sample {n}: {sample} for {sine}");
    }
    let spacing: Vec<u32> = held.marks.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(spacing.iter().all(|&ticks| ticks.abs_diff(25_000_000 / 20) < 100), "{spacing:?}");
    assert!(held.facts.marks_whole && held.marks.len() >= 38, "{}", held.summary());
}

#[test]
fn claim_an_alarm_s_waveform_shows_what_came_before_it_and_a_second_trigger_is_counted() {
    let mut watch = Watch::new(keeping());
    watch.run(4.0, 3.0).run(5.0, 12.0);
    assert_eq!(watch.said(EventKind::AlarmRaised), [0]);
    assert_eq!(watch.said(EventKind::CaptureHeld), [1]);
    let held = waveform(&mut watch);
    assert_eq!(held.facts.trigger, Trigger::Alarm { index: 0 });
    let before = held.samples.iter().take(1000).fold(0.0f64, |most, sample| most.max(sample.abs()));
    println!("{}; first samples up to {before:.2} m/s2", held.summary());
    assert!(held.trigger_s() > 1.0);
    let report = ask(&mut watch, Request::TriggerCapture);
    assert_eq!((report.phase, report.missed), (CapturePhase::Held, 1));
    watch.run(0.1, 12.0);
    assert_eq!(watch.said(EventKind::CaptureMissed), [1]);
    let other = ask(&mut watch, Request::ReleaseCapture { number: 7 });
    assert_eq!(other.phase, CapturePhase::Held, "another waveform is not this one");
    assert_eq!(ask(&mut watch, Request::ReleaseCapture { number: 1 }).phase, CapturePhase::Watching);
    watch.run(3.0, 12.0);
    ask(&mut watch, Request::TriggerCapture);
    watch.run(1.0, 12.0);
    assert_eq!(waveform(&mut watch).facts.number, 2);
}

#[test]
fn fault_a_lost_block_ends_a_waveform_that_has_been_triggered_and_it_says_so() {
    let mut watch = Watch::new(keeping());
    watch.run(4.0, 3.0);
    ask(&mut watch, Request::TriggerCapture);
    watch.run(0.1, 3.0).lose_block().run(0.5, 3.0);
    let held = waveform(&mut watch);
    assert_eq!(held.facts.end, CaptureEnd::SamplesLost);
    assert!(held.duration_s() > 1.0, "{}", held.summary());
}

#[test]
fn theory_a_node_that_keeps_none_says_off_and_is_the_same_node() {
    let mut watch = Watch::new(configuration());
    watch.run(2.0, 3.0);
    assert_eq!(ask(&mut watch, Request::TriggerCapture), CaptureReport::default());
}

/// A damaged byte anywhere is refused.
#[test]
fn fault_a_waveform_with_one_wrong_bit_is_refused() {
    let mut watch = Watch::new(keeping());
    watch.run(4.0, 3.0);
    ask(&mut watch, Request::TriggerCapture);
    watch.run(1.0, 3.0);
    let head = ask(&mut watch, Request::GetCapture).head.expect("held");
    let bytes = read(&mut watch, &head);
    for place in (0..bytes.len()).step_by(997) {
        let mut wrong = bytes.clone();
        wrong[place] ^= 1;
        assert!(Waveform::of_bytes(&head, &wrong).is_err(), "byte {place}");
    }
    let short = &bytes[..bytes.len() - 1];
    assert!(Waveform::of_bytes(&head, short).is_err(), "a byte short");
}

/// The node behind a line that loses every so manieth frame in each direction.
struct LossyLine {
    watch: Watch,
    answers: Vec<u8>,
    frames: usize,
    every: usize,
}

impl Transport for LossyLine {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        let count = self.answers.len().min(buffer.len());
        buffer[..count].copy_from_slice(&self.answers[..count]);
        self.answers.drain(..count);
        if count == 0 {
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(Some(count))
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        self.frames += 1;
        let request_lost = self.frames.is_multiple_of(2 * self.every);
        let answer_lost = self.frames.is_multiple_of(self.every);
        if request_lost {
            return Ok(());
        }
        let mut answers = Vec::new();
        for &byte in bytes {
            self.watch.session.on_byte(byte, &mut |frame| answers.extend_from_slice(frame));
        }
        if !answer_lost {
            self.answers.extend(answers);
        }
        Ok(())
    }
}

#[test]
fn fault_a_waveform_arrives_whole_over_a_line_that_loses_requests_and_answers() {
    let mut watch = Watch::new(keeping());
    watch.run(4.0, 3.0).run(5.0, 12.0);
    let expected = waveform(&mut watch);
    let line = LossyLine { watch, answers: Vec::new(), frames: 0, every: 17 };
    let mut client = Client::new(Box::new(line));
    let head = await_held(&mut client, false, Duration::from_secs(5)).expect("held");
    let fetched = fetch(&mut client, &head).expect("whole");
    assert_eq!(fetched, expected);
    assert_eq!(client.release_capture(head.facts.number).expect("answered").phase, CapturePhase::Watching);
    let record = fetched.record("test").expect("a record");
    assert_eq!((record.runs.len(), record.runs[0].edges_s.len()), (1, expected.marks.len()));
}
