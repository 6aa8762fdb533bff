//! The analysis of records against signals whose truth is known: amplitudes, modulation, teeth, passages, families,
//! noise.

use crate::common;
use meshband::gear_condition;
use meshband::indicators::RunEnsemble;
use meshband_host::analysis::families::Kind;
use meshband_host::analysis::{self, ChannelOutcome, Choice, Outcome, unexplained::Found};
use meshband_host::record::{Acquisition, Declaration, Record, Run, RunDeclaration, Tach, suggested_full_scale};
use meshband_host::spectral::AngleMap;
use rand_chacha::ChaCha12Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use std::f64::consts::{PI, TAU};

const RATE_HZ: f64 = 12_800.0;
const SPEED_HZ: f64 = 24.0;
const TEETH: [u32; 2] = [19, 48];
const GEAR: f64 = 19.0 / 48.0;

/// A machine whose speed swings by 3 % either way, slowly.
#[derive(Clone, Copy)]
struct Bench {
    seconds: f64,
    swing: f64,
    tach_on_gear: bool,
}

/// Writes a record and gives its folder as an argument.
fn written(record: &Record, name: &str) -> String {
    let path = common::folder(&format!("analyse-{name}")).join("record");
    record.write(&path).expect("written");
    common::text(&path)
}

const BENCH: Bench = Bench { seconds: 9.0, swing: 0.03, tach_on_gear: false };
const SWING_HZ: f64 = 0.4;

impl Bench {
    fn turns(&self, t: f64) -> f64 {
        let rate = TAU * SWING_HZ;
        SPEED_HZ * (t + self.swing * (1.0 - (rate * t).cos()) / rate)
    }

    fn time(&self, turns: f64) -> f64 {
        let mut t = turns / SPEED_HZ;
        for _ in 0..20 {
            let speed = SPEED_HZ * (1.0 + self.swing * (TAU * SWING_HZ * t).sin());
            t -= (self.turns(t) - turns) / speed;
        }
        t
    }

    fn signal(&self, of: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let count = (self.seconds * RATE_HZ) as usize;
        (0..count).map(|i| i as f64 / RATE_HZ).map(|t| of(self.turns(t), t)).collect()
    }

    fn edges(&self) -> Vec<f64> {
        let per_edge = if self.tach_on_gear { 1.0 / GEAR } else { 1.0 };
        let last = (self.turns(self.seconds) / per_edge) as usize;
        (0..=last).map(|i| self.time(i as f64 * per_edge)).collect()
    }

    fn record(&self, signals: &[Vec<f64>]) -> Record {
        let tach = Tach {
            shaft: if self.tach_on_gear { "gear" } else { "pinion" }.into(),
            pulses_per_rev: 1,
            turns_per_pinion_turn: None,
            jitter_s: None,
            source: None,
            other: Default::default(),
        };
        let acquisition = Acquisition {
            sample_rate_hz: RATE_HZ,
            channels: (0..signals.len()).map(|c| format!("channel {c}")).collect(),
            full_scale_m_s2: suggested_full_scale(signals),
            code_bits: 16,
            unit: None,
            other: Default::default(),
        };
        let declaration = RunDeclaration::numbered(0, true, None);
        let run = Run::from_signals(declaration, &acquisition, signals, self.edges()).expect("a sound run");
        let mut declared = Declaration::of_import("bench", Some(TEETH), acquisition, Some(tach));
        declared.runs = vec![run.declaration.clone()];
        Record { folder: "bench".into(), declaration: declared, runs: vec![run] }
    }

    fn analysed(&self, signal: Vec<f64>) -> ChannelOutcome {
        let outcome = analysis::record(&self.record(&[signal]), Choice::default()).expect("analysed");
        outcome.runs.into_iter().next().expect("a run").channels.into_iter().next().expect("a channel")
    }
}

fn noise(seed: u64, level: f64) -> impl FnMut() -> f64 {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    move || {
        let value: f64 = StandardNormal.sample(&mut random);
        level * value
    }
}

fn with_noise(mut signal: Vec<f64>, seed: u64, level: f64) -> Vec<f64> {
    let mut noise = noise(seed, level);
    signal.iter_mut().for_each(|x| *x += noise());
    signal
}

fn near(value: f64, truth: f64, share: f64, what: &str) {
    assert!((value - truth).abs() <= share * truth.abs(), "{what}: {value}, not {truth} within {share}");
}

fn mesh(turn: f64) -> f64 {
    let gear = TAU * GEAR * turn;
    let c = TAU * 19.0 * turn;
    2.0 * (1.0 + 0.1 * (TAU * turn + 0.3).cos() + 0.06 * gear.sin()) * c.cos() + 0.7 * (2.0 * c + 0.4).cos()
}

#[test]
fn ref_amplitudes_and_sidebands_are_right_under_a_wandering_speed() {
    for tach_on_gear in [false, true] {
        let bench = Bench { tach_on_gear, ..BENCH };
        let signal = bench.signal(|turn, _| mesh(turn));
        // The wander smears what a plain spectrum shows of the second harmonic to less than half.
        let plain = meshband_host::spectral::amplitude_spectrum(
            &signal,
            RATE_HZ,
            meshband_host::spectral::Window::BlackmanHarris,
        );
        let smeared = plain.values[plain.peak_between(850.0, 980.0).expect("bins")];
        assert!(smeared < 0.35, "a plain spectrum must fail here: {smeared}");
        let channel = bench.analysed(with_noise(signal, 1, 0.05));
        let [first, second] = [&channel.mesh[0], &channel.mesh[1]];
        near(first.line.amplitude, 2.0, 0.02, "first harmonic");
        near(second.line.amplitude, 0.7, 0.02, "second harmonic");
        near(first.pinion[0].lower.amplitude, 0.1, 0.02, "lower sideband of the pinion");
        near(first.pinion[0].upper.amplitude, 0.1, 0.02, "upper sideband of the pinion");
        near(first.gear[0].lower.amplitude, 0.06, 0.02, "lower sideband of the gear");
        near(first.gear[0].upper.amplitude, 0.06, 0.02, "upper sideband of the gear");
        near(first.gear[0].level_db, 20.0 * 0.03_f64.log10(), 0.01, "level of the gear's sidebands, dB");
        assert!(channel.unexplained.spectrum.is_empty(), "{:?}", channel.unexplained.spectrum);
    }
}

#[test]
fn ref_a_modulation_by_the_gear_is_read_with_its_index_and_kind() {
    let amplitude =
        BENCH.signal(|turn, _| (1.0 + 0.2 * (TAU * GEAR * turn + 1.0).cos()) * (TAU * 19.0 * turn + 0.5).cos());
    let pair = BENCH.analysed(with_noise(amplitude, 2, 0.05)).mesh[0].gear[0];
    near(pair.amplitude_index.expect("stands"), 0.2, 0.02, "amplitude index");
    assert!(pair.phase_index.expect("stands") < 0.004, "{pair:?}");
    let phase = BENCH.signal(|turn, _| (TAU * 19.0 * turn + 0.2 * (TAU * GEAR * turn).sin()).cos());
    let pair = BENCH.analysed(with_noise(phase, 3, 0.05)).mesh[0].gear[0];
    near(pair.phase_index.expect("stands"), 0.2, 0.02, "phase index");
    assert!(pair.amplitude_index.expect("stands") < 0.004, "{pair:?}");
}

#[test]
fn ref_a_bump_at_one_tooth_shows_at_that_tooth_of_its_gear() {
    for (shaft, order, teeth, tooth) in [(0, 1.0, 19.0, 7), (1, GEAR, 48.0, 31)] {
        let bump = |turn: f64| {
            let place = (order * turn).fract() * teeth - (tooth as f64 + 0.5);
            2.0 * (-(place / 0.25).powi(2)).exp()
        };
        let channel = BENCH.analysed(with_noise(BENCH.signal(|turn, _| mesh(turn) + bump(turn)), 4, 0.3));
        let average = &channel.averages[shaft];
        assert!(average.whole_hunting_periods && average.turns.is_multiple_of([48, 19][shaft]));
        assert_eq!(average.strongest_tooth, tooth, "of the {}", average.shaft);
        assert!(average.strongest_tooth_over_median > 10.0, "{}", average.strongest_tooth_over_median);
        assert!(average.indicators.fm4 > 6.0, "{:?}", average.indicators);
        assert!(channel.averages[1 - shaft].indicators.fm4 < 6.0, "the other gear is sound");
    }
}

/// Impacts at every passage of `order`, each off by a random share of it, ringing at 3.1 kHz; `gain` by the turn.
fn passages(bench: &Bench, seed: u64, order: f64, slip: f64, gain: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut random = ChaCha12Rng::seed_from_u64(seed);
    let mut signal = vec![0.0; (bench.seconds * RATE_HZ) as usize];
    let mut turn = 0.2;
    while turn < bench.turns(bench.seconds) {
        let start = bench.time(turn) * RATE_HZ;
        let first = start.ceil() as usize;
        for (i, x) in signal.iter_mut().enumerate().skip(first).take(200) {
            let t = (i as f64 - start) / RATE_HZ;
            *x += gain(turn) * (-t * 900.0).exp() * (TAU * 3100.0 * t).sin();
        }
        let share: f64 = StandardUniform.sample(&mut random);
        turn += (1.0 + slip * (2.0 * share - 1.0)) / order;
    }
    signal
}

fn strongest(found: &[Found]) -> &Found {
    found.first().expect("a family")
}

#[test]
fn ref_a_slipping_passage_is_one_family_of_the_envelope() {
    let mut signal = passages(&BENCH, 5, 3.58, 0.01, |_| 3.0);
    signal.iter_mut().zip(BENCH.signal(|turn, _| mesh(turn))).for_each(|(x, m)| *x += m);
    let channel = BENCH.analysed(with_noise(signal, 6, 0.3));
    let band = channel.envelope.band;
    assert!(band.low_hz < 3100.0 && band.high_hz > 3100.0, "{band:?}");
    let found = strongest(&channel.unexplained.envelope);
    near(found.family.base_order, 3.58, 2e-3, "passage");
    assert_eq!(found.family.kind, Kind::Harmonics, "{found:?}");
    assert!(found.family.members.len() >= 3, "{found:?}");
    let others = &channel.unexplained.envelope[1..];
    assert!(others.iter().all(|o| o.family.rms < 0.2 * found.family.rms), "{others:?}");
}

#[test]
fn ref_a_passage_that_adds_lines_is_found_in_the_spectrum_and_grouped() {
    let lines = |turn: f64| (1..=3).map(|j| 0.05 * (TAU * 3.58 * f64::from(j) * turn).cos()).sum::<f64>();
    let channel = BENCH.analysed(with_noise(BENCH.signal(|turn, _| mesh(turn) + lines(turn)), 7, 0.3));
    let spectrum = &channel.unexplained.spectrum;
    assert_eq!(spectrum.len(), 1, "{spectrum:?}");
    assert_eq!(spectrum[0].family.kind, Kind::Harmonics);
    near(spectrum[0].family.base_order, 3.58, 1e-3, "passage");
    assert_eq!(spectrum[0].family.members.len(), 3);
    near(spectrum[0].family.rms, 0.05 * 1.5_f64.sqrt(), 0.1, "energy of three lines");
}

#[test]
fn ref_a_passage_modulated_by_its_shaft_is_one_family_and_not_five() {
    let load = |turn: f64| 3.0 * (1.0 + 0.8 * (TAU * turn).cos()).max(0.0);
    let signal = passages(&BENCH, 8, 4.93, 0.002, load);
    let channel = BENCH.analysed(with_noise(signal, 9, 0.3));
    let found = strongest(&channel.unexplained.envelope);
    assert_eq!(found.family.kind, Kind::ModulatedByPinion, "{found:?}");
    near(found.family.base_order, 4.93, 2e-3, "passage");
    let has = |order: f64| found.family.members.iter().any(|m| (m.line.order - order).abs() < 0.02);
    for order in [3.93, 4.93, 5.93, 8.86, 9.86, 10.86] {
        assert!(has(order), "{order} in {found:?}");
    }
    let others = &channel.unexplained.envelope[1..];
    assert!(others.iter().all(|o| o.family.rms < 0.2 * found.family.rms), "{others:?}");
}

#[test]
fn ref_sidebands_at_a_passage_about_the_mesh_are_one_family() {
    let swing = |turn: f64| 1.0 + 0.08 * (TAU * 2.71 * turn).cos();
    let channel = BENCH.analysed(with_noise(BENCH.signal(|turn, _| swing(turn) * mesh(turn)), 10, 0.2));
    let found = strongest(&channel.unexplained.spectrum);
    assert_eq!(found.family.kind, Kind::AboutMesh, "{found:?}");
    near(found.family.base_order, 2.71, 2e-3, "passage");
    assert!(found.family.members.len() >= 4);
}

#[test]
fn ref_a_passage_seen_by_itself_and_about_the_mesh_is_one_family() {
    let swing = |turn: f64| 1.0 + 0.08 * (TAU * 3.37 * turn).cos();
    let own = |turn: f64| (1..=3).map(|j| 0.1 * (TAU * 3.37 * f64::from(j) * turn + 1.0).cos()).sum::<f64>();
    let channel = BENCH.analysed(with_noise(BENCH.signal(|turn, _| swing(turn) * mesh(turn) + own(turn)), 13, 0.2));
    let spectrum = &channel.unexplained.spectrum;
    assert_eq!(spectrum.len(), 1, "{spectrum:?}");
    let family = &spectrum[0].family;
    near(family.base_order, 3.37, 1e-3, "passage");
    assert!(family.kind == Kind::AboutMesh || family.also.contains(&Kind::AboutMesh), "{family:?}");
    assert!(family.members.len() >= 7, "{family:?}");
}

#[test]
fn null_white_noise_gives_no_line_but_as_rarely_as_stated() {
    let bench = Bench { seconds: 4.0, ..BENCH };
    let count = 16;
    let with_lines = (0..count).filter(|seed| {
        let channel = bench.analysed(with_noise(bench.signal(|_, _| 0.0), 100 + seed, 1.0));
        let found = &channel.unexplained;
        assert_eq!(found.false_alarm, 0.01);
        !found.spectrum.is_empty() || !found.envelope.is_empty()
    });
    // Two spectra each: 0.32 expected, more than 3 with a probability of 0.04 %.
    let with_lines = with_lines.count();
    assert!(with_lines <= 3, "{with_lines} of {count}");
}

#[test]
fn null_coloured_noise_and_a_swinging_load_give_no_line() {
    let bench = Bench { seconds: 5.0, ..BENCH };
    let mut with_lines = 0;
    for seed in 0..8 {
        let mut white = noise(200 + seed, 1.0);
        // A resonance at 2.4 kHz with 2 % damping, and the mesh swelling with the speed.
        let (w, z) = (TAU * 2400.0 / RATE_HZ, 0.02);
        let radius = (-z * w).exp();
        let (mut a, mut b) = (0.0, 0.0);
        let signal = bench.signal(|turn, t| (1.0 + 0.3 * (TAU * SWING_HZ * t).sin()) * mesh(turn));
        let signal = signal.into_iter().map(|x| {
            let y = 2.0 * radius * w.cos() * a - radius * radius * b + 0.1 * white();
            (a, b) = (y, a);
            x + y + 0.05 * white()
        });
        let found = bench.analysed(signal.collect()).unexplained;
        with_lines += usize::from(!found.spectrum.is_empty() || !found.envelope.is_empty());
    }
    assert!(with_lines <= 1, "{with_lines} of 8");
}

#[test]
fn ref_a_line_that_stands_at_a_frequency_is_said_to() {
    let bench = Bench { swing: 0.002, ..BENCH };
    let hum = |t: f64| 0.1 * (TAU * 731.3 * t).sin();
    let channel = bench.analysed(with_noise(bench.signal(|turn, t| mesh(turn) + hum(t)), 11, 0.1));
    let found = strongest(&channel.unexplained.spectrum);
    near(found.fixed_frequency_hz.expect("said"), 731.3, 1e-3, "frequency");
}

#[test]
fn ref_indicators_are_those_of_the_node_on_the_same_average() {
    let channel = BENCH.analysed(with_noise(BENCH.signal(|turn, _| mesh(turn)), 12, 0.5));
    for (average, teeth) in channel.averages.iter().zip(TEETH) {
        let (mut work, mut split) = (vec![0.0; average.samples.len()], vec![0.0; average.samples.len()]);
        let mut ensemble = RunEnsemble::default();
        let node =
            gear_condition::of_average(&average.samples, teeth as u16, |run| ensemble.add(run), &mut work, &mut split)
                .unwrap();
        let own = average.indicators;
        assert_eq!(
            [own.rms, own.crest, own.kurtosis, own.fm0, own.fm4, own.m6a, own.na4],
            [node.rms, node.crest, node.kurtosis, node.fm0, node.fm4, node.m6a, node.na4]
        );
    }
}

#[test]
fn ref_the_average_is_the_pattern_of_its_shaft_alone() {
    let pattern = |turn: f64| (TAU * 3.0 * turn).cos();
    let channel = BENCH.analysed(BENCH.signal(|turn, _| pattern(turn) + 0.5 * (TAU * 2.0 * GEAR * turn).sin()));
    let [pinion, gear] = &channel.averages;
    let worst = |samples: &[f32], truth: &dyn Fn(f64) -> f64| {
        let count = samples.len() as f64;
        let off = |(i, x): (usize, &f32)| (f64::from(*x) - truth(i as f64 / count)).abs();
        samples.iter().enumerate().map(off).fold(0.0, f64::max)
    };
    assert!(worst(&pinion.samples, &pattern) < 2e-3, "{}", worst(&pinion.samples, &pattern));
    let of_gear = |turn: f64| 0.5 * (2.0 * TAU * turn).sin();
    assert!(worst(&gear.samples, &of_gear) < 2e-3, "{}", worst(&gear.samples, &of_gear));
    assert!(channel.locked_share > 0.9999, "{}", channel.locked_share);
}

#[test]
fn ref_lost_and_doubled_edges_are_repaired_and_said() {
    let mut record = BENCH.record(&[BENCH.signal(|turn, _| mesh(turn))]);
    record.runs[0].edges_s.remove(100);
    let double = record.runs[0].edges_s[40] + 0.003;
    record.runs[0].edges_s.insert(41, double);
    let outcome: Outcome = analysis::record(&record, Choice::default()).expect("analysed");
    let run = &outcome.runs[0];
    assert!(run.notes.iter().any(|note| note.contains("repaired") && note.contains("1 lost")), "{:?}", run.notes);
    near(run.channels[0].mesh[0].line.amplitude, 2.0, 0.02, "first harmonic");
}

#[test]
fn ref_the_speed_range_is_that_of_the_turns() {
    let outcome = analysis::record(&BENCH.record(&[BENCH.signal(|turn, _| mesh(turn))]), Choice::default()).unwrap();
    let speed = outcome.runs[0].speed;
    near(speed.slowest_hz, SPEED_HZ * 0.97, 1e-3, "slowest");
    near(speed.fastest_hz, SPEED_HZ * 1.03, 1e-3, "fastest");
    assert!(outcome.runs[0].channels[0].order_spectrum.highest_order < 0.5 * RATE_HZ / (SPEED_HZ * 1.03));
}

#[test]
fn theory_the_angle_at_a_time_inverts_the_time_at_an_angle() {
    let edges: Vec<f64> = (0..200).map(|i| BENCH.time(f64::from(i))).collect();
    let map = AngleMap::new(&edges, 1, 0.0).expect("edges");
    let geared = map.clone().geared(2.5);
    for t in (0..80).map(|i| 0.1 * f64::from(i)) {
        assert!((map.time_at(map.turns_at(t)) - t).abs() < 1e-12, "{t}");
        near(map.turns_at(t) + 1.0, BENCH.turns(t) + 1.0, 1e-4, "turns of a swinging speed");
        near(geared.turns_at(t) + 1.0, 2.5 * map.turns_at(t) + 1.0, 1e-12, "turns of the faster shaft");
    }
}

#[test]
fn theory_nothing_folds_onto_orders_that_are_looked_at() {
    // A line at 92 % of the Nyquist frequency: above what is looked at, and its images stay 80 dB below it.
    let hz = 0.46 * RATE_HZ;
    let channel = BENCH.analysed(BENCH.signal(|_, t| (TAU * hz * t + PI / 3.0).sin()));
    let spectrum = &channel.order_spectrum.spectrum;
    let top = spectrum.peak_between(1.0, channel.order_spectrum.highest_order).expect("bins");
    assert!(spectrum.values[top] < 1e-4, "{} at {}", spectrum.values[top], spectrum.frequency(top));
}

#[test]
fn hostile_records_that_cannot_be_analysed_are_refused_in_one_line() {
    let short = Bench { seconds: 1.0, ..BENCH };
    let good = short.record(&[short.signal(|turn, _| mesh(turn))]);
    let mut no_tach = good.clone();
    no_tach.declaration.tach = None;
    no_tach.runs[0].declaration.tach = None;
    no_tach.runs[0].edges_s.clear();
    let mut no_teeth = good.clone();
    no_teeth.declaration.rest.remove("pair");
    let brief = Bench { seconds: 0.4, ..BENCH };
    let brief = brief.record(&[brief.signal(|turn, _| mesh(turn))]);
    let mut irregular = good.clone();
    irregular.runs[0].edges_s =
        (0..24).map(|i| (f64::from(i * i * i % 97) + 98.0 * f64::from(i % 3)) / 300.0).collect();
    irregular.runs[0].edges_s.sort_by(f64::total_cmp);
    irregular.runs[0].edges_s.dedup();
    let good = written(&good, "good");
    common::refused(&["analyse", &written(&no_tach, "no-tach")], &["[tach]", "virtual tach", "import"]);
    common::refused(&["analyse", &written(&no_teeth, "no-teeth")], &["record.toml", "[pair] teeth"]);
    common::refused(&["analyse", &written(&brief, "brief")], &["run 0", "whole turns", "at least 6"]);
    common::refused(&["analyse", &written(&irregular, "irregular")], &["run 0", "irregular"]);
    common::refused(&["analyse", &good, "--run", "3"], &["has no run 3", "0 to 0"]);
    common::refused(&["analyse", &good, "--channel", "1"], &["has no channel 1"]);
    common::refused(&["analyse", "nowhere"], &["nowhere"]);
    let inside = format!("{good}/record.toml");
    common::refused(&["analyse", &good, "--json", &inside, "--force"], &["record.toml"]);
}

#[test]
fn ref_one_channel_in_volts_gives_text_json_and_a_page() {
    let bench = Bench { seconds: 4.0, ..BENCH };
    let signal = bench.signal(|turn, _| 0.01 * (mesh(turn) + 0.3 * (TAU * 4.56 * turn).cos()));
    let mut record = bench.record(&[with_noise(signal, 20, 0.001)]);
    record.declaration.acquisition.unit = Some("V".into());
    record.declaration.tach.as_mut().expect("a tach").source = Some("virtual".into());
    let path = written(&record, "volts");
    let (json, page) = (format!("{path}.json"), format!("{path}.html"));
    let shown = common::accepted(&["analyse", &path, "--json", &json, "--report", &page]);
    for part in ["peak, V", "no acceleration", "tach is virtual", "4.56", "the same teeth meet every 48 turns"] {
        assert!(shown.contains(part), "'{part}' in {shown}");
    }
    let json: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(json["schema"], 1);
    assert_eq!(json["unit"], "V");
    let channel = &json["runs"][0]["channels"][0];
    near(channel["mesh"][0]["line"]["amplitude"].as_f64().unwrap(), 0.02, 0.02, "first harmonic, V");
    near(channel["unexplained"]["spectrum"][0]["base_order"].as_f64().unwrap(), 4.56, 1e-3, "line");
    let page = std::fs::read_to_string(page).unwrap();
    assert_eq!(page.matches("<figure>").count(), 9, "findings, spectrum, map, two averages twice, envelope, coherence");
    assert!(page.contains("data:image/png;base64,") && !page.contains("<script"));
}
