//! The closed loop: its forward model against records with nothing undeclared.

use meshband_host::closed_loop::base_fit::Base;
use meshband_host::closed_loop::detect::Found;
use meshband_host::closed_loop::frame::Frame;
use meshband_host::closed_loop::generate::{Effect, Scenario, record};
use meshband_host::closed_loop::judge::Split;
use meshband_host::closed_loop::least_squares::chi_square;
use meshband_host::closed_loop::library::Bench;
use meshband_host::machine::{Pair, Shafts};
use meshband_host::model::harmonic_balance::Machine;
use meshband_host::observation::angle::Angle;
use meshband_host::observation::input;
use meshband_host::observation::spectrum::Analyser;
use meshband_host::stiffness::pair_curve::PairCurve;
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

/// Share of an effect's own power (noise-free record less the record without it) that each candidate explains, best first.
fn explained(effects: &[Effect], order: Option<f64>, hz: Option<f64>) -> Vec<(String, f64)> {
    let pair = pair_19_48();
    // A parabola between ramps, sampled as the tables of records are.
    let length = 1.6456;
    let u: Vec<f64> = (0..=400).map(|i| length * f64::from(i) / 400.0).collect();
    let shape = |u: f64| (u.min(length - u) / 0.06).min(1.0) * (2.05e8 - 1.0e8 * (u / length - 0.5).powi(2));
    let curve = PairCurve { k: u.iter().map(|&u| shape(u)).collect(), u };
    let shafts = shafts();
    let mut scenario = Scenario::null(&shafts, 5);
    scenario.noise_rms = 0.0;
    scenario.duration_s = 1.0;
    scenario.within_one_turn = true;
    scenario.speeds_hz = vec![9.1, 16.3, 24.2];
    let without = record(&pair, &shafts, &curve, &scenario);
    scenario.effects = effects.to_vec();
    let with = record(&pair, &shafts, &curve, &scenario);
    let base = Base::new(&without);
    let mut data = base.data();
    for (r, run) in with.runs.iter().enumerate() {
        for c in 0..2 {
            let bins = base.analyser.bins_of(&run.channels[c]);
            data.residual[r][c] = bins.iter().zip(&base.runs[r].measured[c]).map(|(a, b)| a - b).collect();
            data.weight[r][c] = (0..bins.len()).map(|b| if b < 8 { 0.0 } else { 1.0 }).collect();
        }
    }
    let bench = Bench::new(&base);
    let all: Vec<usize> = (0..with.runs.len()).collect();
    let split = Split { fit: all.clone(), select: Vec::new(), held_out: Vec::new() };
    let found = |at: Option<f64>| {
        at.map(|at| Found { at, statistic: 1e3, places: 1.0, modulation: false }).into_iter().collect::<Vec<_>>()
    };
    let mut shares: Vec<(String, f64)> = bench
        .candidates(&data, &split, &found(order), &found(hz), None)
        .iter()
        .map(|candidate| {
            let frame = Frame::new(&data, &[]);
            let border = frame.border(&candidate.templates);
            let gain = frame.estimate(&all, Some(&border)).gain;
            (candidate.name.clone(), gain / chi_square(&data, &all))
        })
        .collect();
    shares.sort_by(|a, b| b.1.total_cmp(&a.1));
    shares
}

fn pair_19_48() -> Pair {
    let text = "teeth = [19, 48]\nmodule_m = 0.003175\npressure_angle_deg = 20.0\nface_width_m = 0.016\n\
                bore_radius_m = [0.0096, 0.0265]\nyoungs_modulus_pa = 206.8e9\npoisson = 0.3\nmesh_damping_s = 4.0565e-6\n";
    toml::from_str(text).expect("pair")
}

fn shafts() -> Shafts {
    let text = "inertia_motor_kg_m2 = 0.0021\ninertia_pinion_kg_m2 = 0.00043659\ninertia_gear_kg_m2 = 0.0083602\n\
                inertia_load_kg_m2 = 0.0105\ncoupling_stiffness_n_m_per_rad = [44000.0, 44000.0]\n\
                coupling_damping_n_m_s_per_rad = [6.0, 20.0]\nmass_kg = [0.96, 2.88]\n\
                bearing_stiffness_n_per_m = [65.6e6, 65.6e6]\nbearing_damping_n_s_per_m = [600.0, 1000.0]\n";
    toml::from_str(text).expect("shafts")
}

/// Every effect of the time-domain generator is reproduced by the library's template of the same name.
#[test]
fn loop_template_of_every_generated_effect_explains_it() {
    let bumps = |n: u32| (0..n).map(|i| 4e-6 * (f64::from(i * i + 3 * i) * 1.7).sin()).collect::<Vec<f64>>();
    let mut one = vec![0.0; 19];
    one[7] = 8e-6;
    let phase_rad = 0.7;
    // Name, least explained share, effect, order of the pinion, frequency in Hz.
    type Case = (&'static str, f64, Effect, Option<f64>, Option<f64>);
    let cases: Vec<Case> = vec![
        // The rolling contact modulates the mesh's phase; a template of first order leaves the second order of that.
        ("pinion-eccentricity", 0.9, Effect::Eccentricity { shaft: 0, amplitude_m: 50e-6, phase_rad }, None, None),
        ("gear-eccentricity", 0.7, Effect::Eccentricity { shaft: 1, amplitude_m: 100e-6, phase_rad }, None, None),
        ("pinion-imbalance", 0.99, Effect::Imbalance { shaft: 0, kg_m: 5e-2, phase_rad }, None, None),
        ("gear-imbalance", 0.99, Effect::Imbalance { shaft: 1, kg_m: 1.0, phase_rad }, None, None),
        ("pinion-pitch-error", 0.99, Effect::PitchError { shaft: 0, offsets_m: bumps(19) }, None, None),
        ("gear-pitch-error", 0.99, Effect::PitchError { shaft: 1, offsets_m: bumps(48) }, None, None),
        ("pinion-pitch-error", 0.99, Effect::PitchError { shaft: 0, offsets_m: one }, None, None),
        ("pinion-tooth-crack", 0.97, Effect::Crack { shaft: 0, tooth: 5, share: 0.1 }, None, None),
        ("gear-tooth-crack", 0.97, Effect::Crack { shaft: 1, tooth: 9, share: 0.1 }, None, None),
        ("ghost-order", 0.99, Effect::Ghost { order: 31.0, amplitude_m: 0.4e-6, phase_rad }, Some(31.0), None),
        ("torque-ripple", 0.99, Effect::TorqueRipple { at: 0, order: 6.0, share: 0.1, phase_rad }, Some(6.0), None),
        (
            "load-fluctuation",
            0.99,
            Effect::TorqueRipple { at: 3, order: 0.731, share: 0.1, phase_rad },
            Some(0.731),
            None,
        ),
        ("torque-ripple", 0.99, Effect::FixedTorque { at: 0, hz: 137.3, share: 0.1 }, None, Some(137.3)),
        ("coupling-misalignment", 0.99, Effect::Misalignment { shaft: 0, force_n: 400.0, phase_rad }, None, None),
        (
            "bearing-stiffness-modulation",
            0.98,
            Effect::BearingModulation { shaft: 0, order: 3.052, share: 0.03, phase_rad },
            Some(3.052),
            None,
        ),
        (
            "mesh stiffness varying at a fixed order",
            0.98,
            Effect::StiffnessModulation { order: 1.0, share: 0.03, phase_rad },
            None,
            None,
        ),
        ("wear", 0.99, Effect::Wear { depth_m: 0.5e-6 }, None, None),
        ("mains-hum", 0.99, Effect::Tone { hz: 50.0, amplitude: [0.5, 0.4] }, None, Some(50.0)),
        (
            "transfer-path-resonance",
            0.98,
            Effect::PathMode { channel: 0, hz: 2300.0, damping: 0.02, gain: 0.1 },
            None,
            None,
        ),
        ("thermal-drift", 0.99, Effect::Drift { channel: 1, share: 0.1 }, None, None),
        ("sensor-nonlinearity", 0.98, Effect::Nonlinearity { channel: 0, per_m_s2: 1e-4, per_m2_s4: 0.0 }, None, None),
    ];
    let mut failed = Vec::new();
    for (name, least, effect, order, hz) in cases {
        let shares = explained(&[effect], order, hz);
        let own = shares.iter().find(|s| s.0 == name).map_or(0.0, |s| s.1);
        let next: Vec<String> = shares.iter().take(4).map(|s| format!("{} {:.4}", s.0, s.1)).collect();
        println!("{name}: {own:.4} (best: {})", next.join(", "));
        if own < least {
            failed.push((name, own));
        }
    }
    assert!(failed.is_empty(), "{failed:?}");
}
