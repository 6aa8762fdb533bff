//! A node's first day, in QEMU, over its link: self-test, configuration, law, run-up, restart, steady operation.

use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::law::{Law, LawForm};
use meshband::message::{Message, Reply, SelfTest};
use meshband::node::State;
use meshband::replay::Header;
use meshband::self_test::MATHEMATICS;
use meshband::tach::Validity;
use meshband_host::law::file::LawFile;
use meshband_host::link::setup::{Installation, Sources};
use meshband_host::link::view::View;
use meshband_host::link::{Client, Losses};
use meshband_host::machine::{EngagementKind, Machine};
use meshband_host::virtual_node::image::{Image, Source};
use meshband_host::virtual_node::qemu::Qemu;
use meshband_tests::gear_signal::{Course, FIRST_HARMONIC_M_S2};
use meshband_tests::qemu_node::{check_stack, machine, power_up_with_client};
use std::path::{Path, PathBuf};
use std::time::Duration;

const RATE_HZ: f64 = 50_000.0;
/// Of machines/19-48.toml; the node's default is another.
const TEETH: [u16; 2] = [19, 48];

fn image(course: Course) -> Image {
    let (samples, edges) = course.sample(RATE_HZ, TEETH[0]);
    let source = Source { samples: &samples, rate_hz: RATE_HZ, edges_s: &edges };
    let waits = |header: Header| Header { waits_for_start: true, ..header };
    Image::new(source, &Configuration::default(), waits).expect("a sound signal")
}

fn machine_file() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/19-48.toml")
}

/// A law file for that machine: 500 Hz of bandwidth per hertz of speed.
fn law_file(folder: &Path) -> PathBuf {
    let machine = Machine::read(&machine_file()).expect("our own machine");
    let file = LawFile {
        machine: machine.title.clone(),
        machine_hash: format!("{:#018x}", machine.hash()),
        ramp: EngagementKind::Loaded,
        measured: None,
        domain_hz: [1.0, 25.0],
        relative_uncertainty: 0.02,
        law: meshband_host::law::forms::Law::Quadratic { a: 0.0, b: 500.0, c: 0.0 },
    };
    let path = folder.join("law.toml");
    std::fs::write(&path, file.to_toml()).expect("writable");
    path
}

/// Every message until the link ends, and the closing statistics.
fn listen(client: &mut Client) -> (Vec<Message>, Option<Reply>) {
    let mut messages = Vec::new();
    while let Some(message) = client.next_message(Duration::from_secs(30)).expect("the link works") {
        messages.push(message);
    }
    assert!(client.has_ended(), "the node fell silent");
    (messages, client.take_replies().pop())
}

fn events(messages: &[Message]) -> Vec<EventKind> {
    messages.iter().filter_map(|m| if let Message::Event(event) = m { Some(event.kind) } else { None }).collect()
}

#[test]
fn claim_a_node_is_tested_configured_measures_and_keeps_its_configuration_over_restarts() {
    let Some(machine) = machine("end to end") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let machine = Qemu { memory: Some(folder.path().join("memory.bin")), ..machine };

    // Power up, self-test, configuration over the link.
    let run_up = image(Course { from_hz: 4.0, to_hz: 20.0, change_s: 3.0, hold_s: 3.0 });
    let (running, mut client) = power_up_with_client(&machine, &run_up.bytes);
    let identity = client.identify().expect("an answer");
    assert_eq!((identity.self_test.run & MATHEMATICS, identity.self_test.failed), (MATHEMATICS, 0));
    let begun = SelfTest { run: MATHEMATICS, failed: 0 };
    assert_eq!(client.self_test().expect("an answer"), begun, "a new test has begun");
    let before = client.configuration().expect("an answer");
    let mut config = before.clone();
    let sensitivity = run_up.full_scale_m_s2 as f32 / 32_767.0;
    let installation = Installation {
        acceleration_per_code: Some(sensitivity),
        analogue_stop_hz: Some(20_000.0),
        harmonics: Some(4),
        ..Installation::default()
    };
    let sources = Sources::read(Some(&machine_file()), Some(&law_file(folder.path())), None).expect("sound files");
    sources.apply(&mut config, &installation).expect("applies");
    assert_eq!([config.gears.pinion_teeth, config.gears.gear_teeth], TEETH);
    let mut wrong = config.clone();
    wrong.mesh.harmonics = 0;
    let refusal = client.set_configuration(&wrong).expect_err("refused").to_string();
    assert!(refusal.contains("mesh.harmonics"), "{refusal}");
    client.set_configuration(&config).expect("accepted");
    // A law pushed by itself, then all of it stored.
    let law = Law {
        relative_uncertainty: 0.05,
        form: LawForm::Quadratic { a_per_hz: 0.0, b: 600.0, c_hz: 0.0 },
        ..config.law
    };
    client.put_law(&law).expect("accepted");
    assert_eq!(client.law().expect("an answer"), law);
    client.commit().expect("stored");
    let config = Configuration { law, ..config };
    assert_eq!(client.configuration().expect("an answer"), config);

    // The run-up: the rate follows the law, spectra and indicators come, nothing is lost.
    client.start().expect("starts");
    client.snapshot().expect("will come");
    let (messages, closing) = listen(&mut client);
    let finished = running.finish().expect("the firmware ends well");
    assert_eq!(client.losses(), Losses::default());
    assert_eq!(finished.statistic("lost"), Some("0"), "{}", finished.console);
    println!("stack at start and in operation: {:?} bytes", check_stack(&finished));
    let seen = events(&messages);
    for kind in [EventKind::TachLocked, EventKind::RateChanged] {
        assert!(seen.contains(&kind), "no {kind:?} in {seen:?}");
    }
    assert!(!seen.contains(&EventKind::SelfTestFailed) && !seen.contains(&EventKind::BlocksLost), "{seen:?}");
    let locked: Vec<_> = messages
        .iter()
        .filter_map(|m| if let Message::Status(s) = m { Some(s) } else { None })
        .filter(|s| s.validity == Validity::Locked && !s.safe_rate)
        // Until the blocks sampled at the safe rate have passed, a status still describes those.
        .skip_while(|s| s.requested_hz > 1.25 * 2.56 * s.bandwidth_hz)
        .collect();
    let (first, last) = (locked[0], locked[locked.len() - 1]);
    assert!(first.speed_hz < 12.0 && last.speed_hz > 18.0, "{} to {} Hz", first.speed_hz, last.speed_hz);
    assert!(last.granted_hz > 1.4 * first.granted_hz, "{} to {} Hz", first.granted_hz, last.granted_hz);
    for status in &locked {
        let bandwidth = status.speed_hz * 600.0;
        assert!((status.bandwidth_hz / bandwidth - 1.0).abs() < 1e-5, "the pushed law is in force");
        // Re-planned within 20 % of the speed; 2.56 against the critical 2 covers that.
        assert!(status.granted_hz > 2.0 * bandwidth, "{} for {bandwidth}", status.granted_hz);
    }
    let mut view = View::default();
    messages.iter().cloned().for_each(|message| view.take(message));
    assert!(view.spectrum.is_some() && view.indicators.is_some() && view.peaks.is_some(), "{view:?}");
    assert_eq!(view.snapshot, Some((4096, 4096)), "the whole waveform came");
    assert!(view.text(client.losses()).contains("mesh bands"));
    let Some(Reply::Statistics(statistics)) = closing else { panic!("no closing statistics") };
    assert_eq!((statistics.blocks_lost, statistics.count(EventKind::ConfigurationStored)), (0, 1));

    // A restart, a change that is not stored, and the power goes.
    let steady = image(Course { from_hz: 15.0, to_hz: 15.0, change_s: 0.0, hold_s: 3.0 });
    let (running, mut client) = power_up_with_client(&machine, &steady.bytes);
    assert_eq!(client.configuration().expect("an answer"), config, "the configuration survives a restart");
    client.set_configuration(&before).expect("accepted");
    drop(running);

    // The stored configuration again, and steady operation with it.
    let (running, mut client) = power_up_with_client(&machine, &steady.bytes);
    assert_eq!(client.configuration().expect("an answer"), config, "and a power cut");
    client.start().expect("starts");
    let (messages, _) = listen(&mut client);
    running.finish().expect("the firmware ends well");
    assert_eq!(client.losses(), Losses::default());
    let spectrum = messages.iter().rev().find_map(|m| if let Message::Spectrum(s) = m { Some(s) } else { None });
    let spectrum = spectrum.expect("at least one spectrum");
    assert_eq!(spectrum.bands.len(), 4);
    // The stored sensitivity is that of the other image.
    let scale = run_up.full_scale_m_s2 / steady.full_scale_m_s2;
    for (h, band) in (1..).map(f64::from).zip(&spectrum.bands) {
        let frequency_hz = 15.0 * f64::from(TEETH[0]) * h;
        assert!((f64::from(band.line.frequency_hz) / frequency_hz - 1.0).abs() < 5e-4, "{}", band.line.frequency_hz);
        let expected = FIRST_HARMONIC_M_S2 / h * scale;
        let decibels = 20.0 * (f64::from(band.line.amplitude) / expected).log10();
        assert!(decibels.abs() < 0.5, "harmonic {h}: {decibels} dB");
    }
    let last = messages.iter().rev().find_map(|m| if let Message::Status(s) = m { Some(s) } else { None });
    assert_eq!(last.expect("statuses came").state, State::Measuring);
}
