//! The whole node, in QEMU, against the f64 reference: measured records, a simulated rig, real aliasing, a run-up.

use meshband::config::TrainGear;
use meshband_host::dynamics::simulate::Acquisition;
use meshband_host::import::{ImportOptions, Reading, TachChoice, Unit as SourceUnit, import};
use meshband_host::machine::Machine;
use meshband_host::record::Record;
use meshband_host::virtual_node::setup::configuration;
use meshband_host::virtual_node::signal::{Operation, Signal, Unit};
use meshband_host::virtual_node::trial::{self, Trial};
use meshband_host::{effects, record};
use meshband_tests::qemu_node::machine;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Measured files, or `None` after saying why the test is skipped.
pub fn measured(test: &str, names: &[&str]) -> Option<Vec<PathBuf>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let files: Vec<PathBuf> = names.iter().map(|name| folder.join(name)).collect();
    if files.iter().all(|file| file.is_file()) {
        return Some(files);
    }
    println!("skipped {test}: ../shared/data is absent");
    None
}

pub fn imported(files: &[PathBuf], teeth: [u32; 2], rate_hz: f64, unit: SourceUnit) -> Record {
    let options = ImportOptions {
        title: "measured".into(),
        reading: Reading::default(),
        override_rate: false,
        rate_hz: Some(rate_hz),
        teeth: Some(teeth),
        mesh_guess_hz: None,
        units: vec![unit],
        channel_names: None,
        full_scale: None,
        files_are_runs: false,
        tach: TachChoice::Virtual,
        remove_mean: false,
        ..ImportOptions::default()
    };
    import(files, &options).expect("readable files").0
}

/// Worst errors against the reference, for the log.
fn measured_errors(trial: &Trial) -> String {
    let text = |worst: trial::Worst| {
        format!("{} within {:.4} % and {:.3} dB", worst.lines, 100.0 * worst.frequency_error, worst.amplitude_error_db)
    };
    format!("harmonics: {}; sidebands: {}", text(trial.worst_harmonics), text(trial.worst_sidebands))
}

fn assert_sound(trial: &Trial) {
    let i = &trial.integrity;
    assert_eq!((i.blocks_lost, i.edges_lost, i.frames_lost), (0, 0, 0), "{i:?}");
    for kind in ["BlocksLost", "Overrun", "TimeJump", "UnexpectedPeriod", "MessagesDropped", "Saturated"] {
        assert!(!i.events.contains_key(kind), "{i:?}");
    }
}

#[test]
fn ref_mesh_harmonics_of_gear0_are_those_of_the_f64_reference_with_sidebands_resolved() {
    let Some(machine) = machine("gear0") else { return };
    let names = ["1", "2", "3", "4"].map(|n| format!("gear0/3027_217_Data_Chan{n}.mat"));
    let Some(files) = measured("gear0", &names.each_ref().map(String::as_str)) else { return };
    let record = imported(&files, [23, 46], 25_600.0, SourceUnit::MetrePerSecondSquared);
    for channel in ["0", "1", "2", "3"] {
        let signal = Signal::of_record(&record, 0, (channel, None), 1.0, Some(3.5)).expect("a channel");
        let config = configuration(&signal, None).expect("accepted");
        let trial = trial::run(&signal, &config, &machine, 1).expect("runs");
        assert_sound(&trial);
        assert!(trial.integrity.identical_to_host && trial.integrity.identical_codes);
        let outside = trial.rates.iter().filter(|r| r.flags.iter().any(|f| f.contains("outside the law")));
        assert!(outside.count() > 0, "33.3 Hz lies outside the law's domain, and the node says so");
        assert!(trial.spectra.len() >= 2, "{} spectra", trial.spectra.len());
        println!("channel {}: {}", signal.channel, measured_errors(&trial));
        for spectrum in &trial.spectra {
            let harmonics: Vec<_> = spectrum.lines.iter().filter(|l| l.sideband == 0).collect();
            assert_eq!(harmonics.len(), 5);
            for line in harmonics {
                let mesh_hz = 766.6 * f64::from(line.harmonic);
                assert!((line.frequency_hz / mesh_hz - 1.0).abs() < 5e-4, "channel {channel}: {line:?}");
                assert!(line.frequency_error.abs() < 5e-4, "channel {channel}: {line:?}");
                assert!(line.amplitude_error_db.abs() < 0.5, "channel {channel}: {line:?}");
            }
            // Sidebands of the slower shaft, 16.665 Hz apart: eight bins between neighbours, four times a line's width.
            assert!(spectrum.resolution_hz * 7.9 < 16.665, "{} Hz per bin", spectrum.resolution_hz);
            let clear: Vec<_> = spectrum.lines.iter().filter(|l| l.shaft == "gear" && l.is_clear()).collect();
            assert!(clear.len() >= 5, "channel {channel}: {} clear sidebands", clear.len());
            for line in clear {
                let expected = 766.6 * f64::from(line.harmonic) + 16.665 * f64::from(line.sideband);
                assert!((line.frequency_hz - expected).abs() < 2.0 * spectrum.resolution_hz, "{line:?}");
                // A dozen decibels above the noise, two ways to read a line differ by this much.
                assert!(line.amplitude_error_db.abs() < 2.0, "channel {channel}: {line:?}");
            }
        }
    }
}

#[test]
fn ref_the_same_works_on_the_spectraquest_box() {
    let Some(machine) = machine("gfd") else { return };
    let Some(files) = measured("gfd", &["gfd/h30hz0.csv.gz"]) else { return };
    let record = imported(&files, [32, 80], 12_800.0, SourceUnit::Unknown);
    let signal = Signal::of_record(&record, 0, ("a2", None), 0.0, Some(4.0)).expect("a channel");
    assert_eq!(signal.unit, Unit::Other("unknown".into()));
    let config = configuration(&signal, None).expect("accepted");
    let trial = trial::run(&signal, &config, &machine, 1).expect("runs");
    assert_sound(&trial);
    assert!(trial.integrity.identical_to_host);
    assert!(trial.worst_harmonics.lines >= 10, "{:?}", trial.worst_harmonics);
    // Mesh lines hold a tenth of this box's power. Those that the reference itself has within 12 dB of the noise, or
    // off the shaft's order, do not count ([`trial::LineRow::is_clear`]); on gear0 above no line is left out.
    println!("channel {}: {}", signal.channel, measured_errors(&trial));
    assert!(trial.worst_harmonics.frequency_error < 5e-4, "{:?}", trial.worst_harmonics);
    assert!(trial.worst_harmonics.amplitude_error_db < 0.5, "{:?}", trial.worst_harmonics);
}

/// Mesh harmonics 1, 2, 35 and 36 at a steady speed.
fn folding_signal() -> Signal {
    let (mesh_hz, teeth, rate_hz, seconds) = (293.303, 55, 102_400.0, 4.5);
    let shaft_hz = mesh_hz / f64::from(teeth);
    let value = |n: usize| {
        let phase = TAU * mesh_hz * n as f64 / rate_hz;
        [(1.0, 1.0), (2.0, 0.7), (35.0, 1.5), (36.0, 1.2)].iter().map(|(h, a)| a * (h * phase).cos()).sum()
    };
    Signal {
        title: "harmonics 1, 2, 35, 36".into(),
        place: "test".into(),
        channel: "synthetic".into(),
        unit: Unit::Acceleration,
        samples: (0..(seconds * rate_hz) as usize).map(value).collect(),
        second: None,
        rate_hz,
        edges_s: (0..(seconds * shaft_hz * 8.0) as usize).map(|n| (n as f64 + 0.5) / (8.0 * shaft_hz)).collect(),
        pulses_per_turn: 8,
        pinion_per_tach: 1.0,
        teeth: [teeth, 75],
        train: Vec::new(),
        machine_hash: None,
        notes: Vec::new(),
    }
}

/// Four stages of 20 and 40 teeth, down and up in turns, 25 turns/s at the first: every average takes 16 turns, and a
/// round fits the 8 s that the board's memory holds.
fn four_stages() -> Signal {
    let (rate_hz, seconds, shaft_hz) = (6_400.0, 8.3, 25.0);
    let shafts = [1.0, 0.5, 1.0, 0.5];
    let value = |n: usize| {
        let turns = shaft_hz * n as f64 / rate_hz;
        let tone = |order: f64| (TAU * (order * turns).fract()).cos();
        shafts.iter().map(|shaft| tone(20.0) + 0.3 * tone(20.0 + shaft)).sum()
    };
    let gear = |stage, teeth, pinion_turns| TrainGear { stage, teeth, mate_teeth: 60 - teeth, turns: 1, pinion_turns };
    Signal {
        title: "four stages".into(),
        place: "test".into(),
        channel: "synthetic".into(),
        unit: Unit::Acceleration,
        samples: (0..(seconds * rate_hz) as usize).map(value).collect(),
        second: None,
        rate_hz,
        edges_s: (0..(seconds * shaft_hz) as usize).map(|n| (n as f64 + 0.5) / shaft_hz).collect(),
        pulses_per_turn: 1,
        pinion_per_tach: 1.0,
        teeth: [20, 40],
        train: vec![gear(1, 40, 2), gear(2, 40, 2), gear(3, 20, 1), gear(4, 40, 2)],
        machine_hash: None,
        notes: Vec::new(),
    }
}

#[test]
fn golden_a_train_of_four_stages_gives_the_hosts_frames_in_qemu() {
    let Some(machine) = machine("train") else { return };
    let signal = four_stages();
    let config = configuration(&signal, None).expect("accepted");
    let trial = trial::run(&signal, &config, &machine, 1).expect("runs");
    println!("{:.1} s, {:?}, {:?}", trial.duration_s, trial.further_spectra, trial.integrity);
    assert_sound(&trial);
    assert!(trial.integrity.identical_to_host && trial.integrity.identical_codes);
    assert_eq!(trial.further_spectra.keys().copied().collect::<Vec<u8>>(), [1, 2, 3, 4]);
}

#[test]
fn claim_at_a_forced_10_khz_harmonics_35_and_36_appear_at_265_6_and_558_9_hz() {
    let Some(machine) = machine("aliasing") else { return };
    let signal = folding_signal();
    let config = configuration(&signal, Some(10_000.0)).expect("accepted");
    let trial = trial::run(&signal, &config, &machine, 1).expect("runs");
    assert_sound(&trial);
    assert!(trial.blocks.iter().all(|(_, rate)| *rate == 10_000.0));
    for (frequency_hz, harmonic, amplitude) in [(265.6, 35, 1.5), (558.9, 36, 1.2)] {
        let near = |p: &&trial::PeakRow| (p.frequency_hz - frequency_hz).abs() < 0.5 * trial.peak_resolution_hz;
        let peak = trial.peaks.iter().find(near).unwrap_or_else(|| panic!("{frequency_hz} Hz: {:?}", trial.peaks));
        assert_eq!((peak.harmonic, peak.folded), (Some(harmonic), true), "{peak:?}");
        assert!((peak.amplitude / amplitude - 1.0).abs() < 0.02, "{peak:?}");
    }
}

#[test]
fn claim_at_the_automatic_rate_the_folded_lines_are_gone_by_60_db() {
    let Some(machine) = machine("aliasing") else { return };
    let signal = folding_signal();
    let config = configuration(&signal, None).expect("accepted");
    let trial = trial::run(&signal, &config, &machine, 1).expect("runs");
    assert_sound(&trial);
    // The four true lines lead; whatever else the list of strongest lines holds is the floor of the whole band.
    assert!(trial.peaks.len() > 6, "{:?}", trial.peaks);
    for (peak, wanted) in trial.peaks.iter().zip([35, 36, 1, 2]) {
        assert_eq!((peak.harmonic, peak.folded), (Some(wanted), false), "{:?}", trial.peaks);
    }
    let next = trial.peaks[4].amplitude / trial.peaks[0].amplitude;
    assert!(20.0 * next.log10() < -60.0, "{:?}", trial.peaks);
    // The list names local maxima only: none of the four lies at the folded places, so those are at most the fifth.
    for frequency_hz in [265.6, 558.9] {
        let clear = trial.peaks[..4].iter().all(|p| (p.frequency_hz - frequency_hz).abs() > trial.peak_resolution_hz);
        assert!(clear, "{:?}", trial.peaks);
    }
}

pub fn paper_rig(speed_hz: f64, final_speed_hz: Option<f64>, duration_s: f64) -> Signal {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/paper-rig.toml");
    let machine = Machine::read(&path).expect("a machine");
    let effects = [effects::parse("eccentricity:amplitude=20e-6").expect("an effect")];
    let acquisition =
        Acquisition { rate_hz: 204_800.0, duration_s, pulses_per_turn: 8, jitter_s: 0.0, noise_m_s2: 0.0, seed: 1 };
    let operation = Operation {
        speed_hz,
        final_speed_hz,
        back_s: None,
        torque_n_m: 12.0,
        effects: &effects,
        acquisition,
        channel: 0,
        second: None,
    };
    Signal::of_machine(&machine, &operation).expect("simulates")
}

#[test]
fn ref_lines_of_the_simulated_rig_are_those_of_the_f64_reference_and_two_runs_send_the_same_bytes() {
    let Some(machine) = machine("simulated rig") else { return };
    let signal = paper_rig(14.5, None, 3.3);
    let config = configuration(&signal, None).expect("accepted");
    let trial = trial::run(&signal, &config, &machine, 2).expect("runs");
    assert_sound(&trial);
    assert_eq!(trial.integrity.identical_runs, Some(true));
    assert!(trial.worst_harmonics.lines >= 5, "{:?}", trial.worst_harmonics);
    assert!(trial.worst_harmonics.frequency_error < 1e-5, "{:?}", trial.worst_harmonics);
    assert!(trial.worst_harmonics.amplitude_error_db < 0.05, "{:?}", trial.worst_harmonics);
    let sidebands = trial.spectra.iter().flat_map(|s| &s.lines).filter(|l| l.sideband != 0 && l.shaft == "pinion");
    let clear: Vec<_> = sidebands.filter(|l| l.is_clear() && l.below_strongest_db < 40.0).collect();
    assert!(clear.len() >= 5, "{} clear sidebands", clear.len());
    for line in clear {
        assert!(line.amplitude_error_db.abs() < 0.2, "{line:?}");
    }
}

#[test]
fn ref_in_a_run_up_the_rate_follows_the_law_at_block_borders_and_no_block_is_lost() {
    let Some(machine) = machine("run-up") else { return };
    let signal = paper_rig(3.0, Some(25.0), 8.0);
    let config = configuration(&signal, None).expect("accepted");
    let trial = trial::run(&signal, &config, &machine, 1).expect("runs");
    // Neither a jump in time nor a block of an unexpected period: the rate changed at borders only.
    assert_sound(&trial);
    assert!(trial.integrity.rate_changes >= 5, "{:?}", trial.integrity);
    let following: Vec<_> = trial.rates.iter().filter(|r| r.flags.is_empty() && r.speed_hz > 0.0).collect();
    let (first, last) = (following.first().expect("locked"), following.last().expect("locked"));
    assert!(first.speed_hz < 3.3 && last.speed_hz > 24.0, "{} to {} Hz", first.speed_hz, last.speed_hz);
    for rates in following {
        let speed_hz = rates.reference_speed_hz.unwrap_or(rates.speed_hz);
        assert!((rates.speed_hz / speed_hz - 1.0).abs() < 0.01, "{rates:?}");
        // Requests may lag the speed by what triggers a new plan, a fifth; the margin of 2.56 against 2 covers it.
        let wanted = 2.56 * rates.bandwidth_hz;
        assert!((0.78..1.25).contains(&(rates.requested_hz / wanted)), "{rates:?}");
        // Never below the law's rate, and less than a tick of 25 MHz above it.
        assert!((-0.5..2.0e4).contains(&rates.residual_ppm), "{rates:?}");
        assert!(rates.adc_hz >= 200_000.0, "the fixed analogue filter stops at 100 kHz: {rates:?}");
    }
}

#[test]
fn fault_a_window_without_two_tach_edges_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let acquisition = record::Acquisition {
        sample_rate_hz: 10_000.0,
        channels: vec!["case".into()],
        full_scale_m_s2: 2.0,
        code_bits: 16,
        unit: None,
        other: toml::Table::new(),
    };
    let tach = record::Tach {
        shaft: "pinion".into(),
        turns_per_pinion_turn: None,
        pulses_per_rev: 1,
        jitter_s: None,
        source: None,
        other: toml::Table::new(),
    };
    let mut declaration = record::Declaration::of_import("stall", Some([20, 30]), acquisition.clone(), Some(tach));
    let table = record::RunDeclaration::numbered(0, true, None);
    declaration.runs.push(table.clone());
    let run = record::Run::from_signals(table, &acquisition, &[vec![1.0; 20_000]], vec![0.1, 0.2, 1.9]).expect("sound");
    let record = Record { folder: folder.path().to_owned(), declaration, runs: vec![run] };
    assert!(Signal::of_record(&record, 0, ("case", None), 0.0, None).is_ok());
    let refused = Signal::of_record(&record, 0, ("case", None), 1.0, None).expect_err("one edge only").to_string();
    assert!(refused.contains("tach"), "{refused}");
}
