//! The closed loop: its forward model against records with nothing undeclared.

use meshband_host::effects::hypothesis::{Draw, Hidden, Hypothesis, Seat};
use meshband_host::effects::{hidden, hypotheses};
use meshband_host::generate::{Scenario, record};
use meshband_host::machine::{Pair, Shafts};
use meshband_host::model::harmonic_balance::Machine;
use meshband_host::model_based::base_fit::Base;
use meshband_host::model_based::candidate::Claim;
use meshband_host::model_based::detect::Found;
use meshband_host::model_based::frame::Frame;
use meshband_host::model_based::judge::Split;
use meshband_host::model_based::least_squares::{Data, chi_square};
use meshband_host::model_based::library::{Bench, order};
use meshband_host::observation::angle::Angle;
use meshband_host::observation::input::{self, Record};
use meshband_host::observation::spectrum::Analyser;
use meshband_host::stiffness::pair_curve::PairCurve;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rustfft::num_complex::Complex64 as C;
use std::collections::BTreeSet;
use std::path::Path;

/// Harmonic balance predicts the independent simulator's noise-free records.
#[test]
fn ref_harmonic_balance_leaves_a_thousandth_of_the_check_records() {
    for case in ["check-19-48", "check-55-75"] {
        let folder = Path::new("../../shared/vectors").join(case);
        if !folder.exists() {
            println!("skipped: {} is absent", folder.display());
            continue;
        }
        let record = input::read(&folder).expect("record");
        let machine = Machine::new(&record.pair, &record.shafts, &record.curve);
        for run in &record.runs {
            let angle = Angle::fit(run, record.pulses_per_rev, record.jitter_s);
            let analyser = Analyser::new(run.channels[0].len(), record.sample_rate_hz);
            let comb = machine.own_comb(angle.shaft_hz);
            let solution = machine.base(&comb, run.input_torque_n_m);
            for channel in 0..2 {
                let measured = analyser.bins_of(&run.channels[channel]);
                let model = analyser.bins_of_lines(&solution.lines, angle.offset_rad, angle.shaft_hz, channel, 160);
                let power = |bins: &mut dyn Iterator<Item = f64>| bins.skip(8).sum::<f64>().sqrt();
                let all = power(&mut measured.iter().map(|x| x.norm_sqr()));
                let left = power(&mut measured.iter().zip(&model).map(|(m, p)| (m - p).norm_sqr()));
                println!("{case} {:.3} Hz channel {channel}: {:.5}", angle.shaft_hz, left / all);
                assert!(left / all < 3e-3, "{case} channel {channel}: {}", left / all);
            }
        }
    }
}

/// A plain record without noise, and everything that the library makes of its machine.
fn plain() -> (Record, Base) {
    let (pair, shafts) = (pair_19_48(), shafts());
    let mut scenario = Scenario::null(&shafts, 5);
    scenario.noise_rms = 0.0;
    scenario.duration_s = 0.5;
    scenario.within_one_turn = true;
    scenario.speeds_hz = vec![9.1, 16.3, 24.2];
    let record = record(&pair, &shafts, &curve(), &scenario).unwrap();
    let base = Base::new(&record);
    (record, base)
}

/// A parabola between ramps, sampled as the tables of records are.
fn curve() -> PairCurve {
    let length = 1.6456;
    let u: Vec<f64> = (0..=400).map(|i| length * f64::from(i) / 400.0).collect();
    let shape = |u: f64| (u.min(length - u) / 0.06).min(1.0) * (2.05e8 - 1.0e8 * (u / length - 0.5).powi(2));
    PairCurve { k: u.iter().map(|&u| shape(u)).collect(), u }
}

fn pair_19_48() -> Pair {
    let text = "teeth = [19, 48]\nmodule_m = 0.003175\npressure_angle_deg = 20.0\nface_width_m = 0.016\n\
                bore_radius_m = [0.0096, 0.0265]\nyoungs_modulus_pa = 206.8e9\npoisson = 0.3\nmesh_damping_s = \
                4.0565e-6\n";
    toml::from_str(text).expect("pair")
}

fn shafts() -> Shafts {
    let text = "inertia_motor_kg_m2 = 0.0021\ninertia_pinion_kg_m2 = 0.00043659\ninertia_gear_kg_m2 = 0.0083602\n\
                inertia_load_kg_m2 = 0.0105\ncoupling_stiffness_n_m_per_rad = [44000.0, 44000.0]\n\
                coupling_damping_n_m_s_per_rad = [6.0, 20.0]\nmass_kg = [0.96, 2.88]\n\
                bearing_stiffness_n_per_m = [65.6e6, 65.6e6]\nbearing_damping_n_s_per_m = [600.0, 1000.0]\n";
    toml::from_str(text).expect("shafts")
}

fn power<'a>(bins: impl IntoIterator<Item = &'a C>) -> f64 {
    bins.into_iter().map(|x| x.norm_sqr()).sum()
}

/// What the library says an effect does in first order is what the simulator's own effect does when it is weak:
/// seats, units, phases, teeth and keys.
#[test]
fn ref_every_template_is_the_simulators_own_effect() {
    let (record, base) = plain();
    let bench = Bench::new(&base);
    let data = base.data();
    let all: Vec<usize> = (0..record.runs.len()).collect();
    let split = Split { fit: all, select: Vec::new(), held_out: Vec::new() };
    let mut candidates = Vec::new();
    bench.candidates(&data, &split, &[], &[], None, |part| candidates.extend(part));
    candidates.extend([31.0, 3.57].into_iter().flat_map(|at| order::at_order(&bench, at, 1.0)));
    let mut seen: BTreeSet<&str> = BTreeSet::new();
    let plain = bench.plain();
    let mut failed = Vec::new();
    // One of every hypothesis and place.
    let mut done = BTreeSet::new();
    for candidate in candidates {
        let Some(hypothesis) = candidate.hypothesis else { continue };
        let key = (candidate.name.clone(), candidate.order.map(|o| (1e3 * o) as i64), candidate.templates.len());
        let is_path = candidate.family == "path" || candidate.family == "non-stationary" && !simulated(hypothesis);
        // Away from its own place a plain force is no effect of the simulator's; what bends is simulated everywhere.
        let is_effect = candidate.claim == Claim::Named || candidate.bends();
        if is_path || candidate.phase_free || !is_effect || !done.insert(key) {
            continue;
        }
        // A direction of the unknowns in which the response is a few thousandths of the machine's own: a record that
        // does not repeat itself folds 5e-5 of a stiffness with kinks.
        let direction: Vec<f64> = (0..candidate.templates.len()).map(|i| (1.0 + i as f64).cos()).collect();
        let bins = base.analyser.bins;
        let response = |x: &[f64]| -> Vec<[Vec<C>; 2]> {
            let one = |r: usize, c: usize| {
                let mut sum = vec![C::ZERO; bins];
                for (template, x) in candidate.templates.iter().zip(x) {
                    template.runs[r][c].iter().for_each(|(b, t)| sum[b] += t * x);
                }
                sum
            };
            (0..record.runs.len()).map(|r| [one(r, 0), one(r, 1)]).collect()
        };
        let whole = power(base.runs.iter().flat_map(|r| r.model.iter().flatten()));
        let scale = 2e-3 * (whole / power(response(&direction).iter().flatten().flatten())).sqrt();
        let x: Vec<f64> = direction.iter().map(|d| d * scale).collect();
        let Some(with) = bench.simulated(&[(&candidate, &x)]) else { continue };
        let expected = response(&x);
        let mut off = 0.0;
        for (r, run) in expected.iter().enumerate() {
            for c in 0..2 {
                let own = with[r][c].iter().zip(&plain[r][c]).map(|(a, b)| a - b);
                off += own.zip(&run[c]).skip(8).map(|(a, b)| (a - b).norm_sqr()).sum::<f64>();
            }
        }
        let error = (off / power(expected.iter().flatten().flatten())).sqrt();
        println!("{} at {:?}: {:.4}", candidate.name, candidate.order, error);
        // A moving contact excites all harmonics, of which the balance keeps those below 16.5 kHz: 3.5 %; others
        // agree to 0.6 %.
        if error > 0.05 {
            failed.push((candidate.name.clone(), candidate.order, error));
        } else {
            seen.insert(hypothesis.name);
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
    let missing: Vec<&str> =
        hypotheses().filter(|h| simulated(h)).map(|h| h.name).filter(|name| !seen.contains(name)).collect();
    assert!(missing.is_empty(), "never compared: {missing:?}");
}

/// Whether an effect acts on the machine and not on its measuring path.
fn simulated(hypothesis: &Hypothesis) -> bool {
    hypothesis.seats.iter().any(|seat| !matches!(seat, Seat::Path(_) | Seat::Record))
}

/// Order of the pinion, or frequency, at which an effect of the command line acts, as far as its text says.
fn place(texts: &[String]) -> (Option<f64>, Option<f64>) {
    let key = |name: &str| {
        let all = texts[0].split_once(':').map_or("", |x| x.1).split(',').filter_map(|item| item.split_once('='));
        all.filter(|(key, _)| *key == name).find_map(|(_, value)| value.parse::<f64>().ok())
    };
    let of_gear = key("gear") == Some(1.0) || texts[0].starts_with("load-fluctuation");
    (key("order").map(|o| if of_gear { o * 19.0 / 48.0 } else { o }), key("frequency"))
}

#[test]
fn loop_template_of_a_hidden_effect_explains_it() {
    templates_explain(5);
}

#[test]
#[ignore = "long: cargo xtask test-long"]
fn loop_template_of_every_hidden_effect_explains_it() {
    templates_explain(1);
}

/// Least change of a record by an effect, as a share of the machine's own signal.
const LEAST_CHANGE: f64 = 2e-4;

/// What a campaign hides, every `step`-th of it, is explained by the library's candidate of a right name.
fn templates_explain(step: usize) {
    let (pair, shafts) = (pair_19_48(), shafts());
    let (record_without, base) = plain();
    let bench = Bench::new(&base);
    let all: Vec<usize> = (0..record_without.runs.len()).collect();
    let split = Split { fit: all.clone(), select: Vec::new(), held_out: Vec::new() };
    let mut scenario = Scenario::null(&shafts, 5);
    (scenario.noise_rms, scenario.duration_s, scenario.within_one_turn) = (0.0, 0.5, true);
    scenario.speeds_hz = vec![9.1, 16.3, 24.2];
    let mut failed = Vec::new();
    let of_record = |name: &str| hypotheses().any(|h| h.name == name && matches!(h.seats, [Seat::Record]));
    let explained = |h: &&Hidden| h.right_names.first().is_some_and(|name| !of_record(name));
    for hidden in hidden().filter(explained).step_by(step) {
        let mut changed = |size: f64| {
            let mut random = ChaCha8Rng::seed_from_u64(7);
            let mut draw = Draw { teeth: pair.teeth, peak_m_s2: [50.0; 2], random: &mut random };
            scenario.effects = (hidden.draw)(size, &mut draw);
            let with = record(&pair, &shafts, &curve(), &scenario).unwrap();
            let mut data = base.data();
            for (r, run) in with.runs.iter().enumerate() {
                for c in 0..2 {
                    let bins = base.analyser.bins_of(&run.channels[c]);
                    data.residual[r][c] = bins.iter().zip(&base.runs[r].measured[c]).map(|(a, b)| a - b).collect();
                    data.weight[r][c] = (0..bins.len()).map(|b| if b < 8 { 0.0 } else { 1.0 }).collect();
                }
            }
            (data, scenario.effects.clone())
        };
        // What folds must not hide a weak one.
        let whole = power(base.runs.iter().flat_map(|r| r.model.iter().flatten()));
        let share = |data: &Data| (chi_square(data, &all) / whole).sqrt();
        let (mut data, mut texts) = changed(hidden.reference);
        let mut size = hidden.reference;
        for _ in 0..3 {
            if share(&data) < LEAST_CHANGE {
                size *= 1.05 * LEAST_CHANGE / share(&data);
                (data, texts) = changed(size);
            }
        }
        let found = |at: Option<f64>| -> Vec<Found> {
            at.map(|at| Found { at, statistic: 1e3, places: 1.0, modulation: false }).into_iter().collect()
        };
        let (order, hz) = place(&texts);
        let mut candidates = Vec::new();
        bench.candidates(&data, &split, &found(order), &found(hz), None, |part| candidates.extend(part));
        let mut shares: Vec<(String, f64)> = candidates
            .iter()
            .map(|candidate| {
                let frame = Frame::new(&data, &[]);
                let border = frame.border(&candidate.templates);
                let gain = frame.estimate(&all, Some(&border)).gain;
                (candidate.name.clone(), gain / chi_square(&data, &all))
            })
            .collect();
        shares.sort_by(|a, b| b.1.total_cmp(&a.1));
        let right = |name: &str| {
            hidden.right_names.contains(&name)
                || hidden.name.starts_with("mesh-stiffness") && name.starts_with("mesh stiffness")
        };
        let own = shares.iter().find(|s| right(&s.0)).map_or(0.0, |s| s.1);
        let next: Vec<String> = shares.iter().take(3).map(|s| format!("{} {:.4}", s.0, s.1)).collect();
        println!("{}: {own:.4} (best: {})", hidden.name, next.join(", "));
        if own < 0.9 {
            failed.push((hidden.name, own));
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}
