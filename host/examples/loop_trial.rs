//! One generated record through the closed loop: `loop_trial EFFECT SEED`, for training.
use meshband_host::closed_loop::generate::{Effect, Scenario, record};
use meshband_host::closed_loop::{Options, close_loop, input};
use std::path::Path;

/// `loop_trial EFFECT SEED [WITHHELD] [p]`, or `loop_trial table EFFECT:SEED ...` for one line per record.
fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if arguments[1] == "table" {
        for item in &arguments[2..] {
            let (what, seed) = item.split_once(':').expect("EFFECT:SEED");
            trial(what, seed.parse().expect("seed"), Options::default(), true);
        }
        return;
    }
    let withheld = arguments.get(3).map(|w| w.split(',').map(String::from).collect()).unwrap_or_default();
    let options = Options { progress: arguments.len() > 4, withheld, ..Options::default() };
    trial(&arguments[1], arguments[2].parse().expect("seed"), options, false);
}

fn trial(what: &str, seed: u64, options: Options, compact: bool) {
    let case = if seed.is_multiple_of(2) { "check-19-48" } else { "check-55-75" };
    let source = input::read(&Path::new("../shared/vectors").join(case)).expect("machine");
    let mut scenario = Scenario::null(&source.shafts, seed);
    let phase_rad = seed as f64;
    let z = source.pair.teeth.map(f64::from);
    let ratio = z[0] / z[1];
    let bumps = |n: u32| (0..n).map(|i| 4e-6 * (f64::from(i * i + 3 * i) * 1.7 + phase_rad).sin()).collect();
    scenario.effects = match what {
        "null" => vec![],
        "off" => {
            scenario.actual.bearing_stiffness_n_per_m[0] *= 1.02;
            scenario.stiffness_factor = 0.98;
            scenario.damping_factor = 1.1;
            scenario.noise_colour = 0.8;
            vec![]
        }
        "ecc1" => vec![Effect::Eccentricity { shaft: 0, amplitude_m: 10e-6, phase_rad }],
        "ecc2" => vec![Effect::Eccentricity { shaft: 1, amplitude_m: 20e-6, phase_rad }],
        "imb1" => vec![Effect::Imbalance { shaft: 0, kg_m: 5e-4, phase_rad }],
        "imb2" => vec![Effect::Imbalance { shaft: 1, kg_m: 5e-3, phase_rad }],
        "pitch1" => vec![Effect::PitchError { shaft: 0, offsets_m: bumps(source.pair.teeth[0]) }],
        "pitch2" => vec![Effect::PitchError { shaft: 1, offsets_m: bumps(source.pair.teeth[1]) }],
        "tooth1" => {
            let mut offsets_m = vec![0.0; source.pair.teeth[0] as usize];
            offsets_m[7] = 8e-6;
            vec![Effect::PitchError { shaft: 0, offsets_m }]
        }
        "crack1" => vec![Effect::Crack { shaft: 0, tooth: 5, share: 0.12 }],
        "crack2" => vec![Effect::Crack { shaft: 1, tooth: 9, share: 0.15 }],
        "ghost" => vec![Effect::Ghost { order: 31.0, amplitude_m: 0.4e-6, phase_rad }],
        "ripple" => vec![Effect::TorqueRipple { at: 0, order: 6.0, share: 0.15, phase_rad }],
        "ripple-odd" => vec![Effect::TorqueRipple { at: 3, order: 0.731, share: 0.15, phase_rad }],
        "fixed" => vec![Effect::FixedTorque { at: 0, hz: 137.3, share: 0.1 }],
        "misalign" => vec![Effect::Misalignment { shaft: 0, force_n: 40.0, phase_rad }],
        "bearing" => vec![Effect::BearingModulation { shaft: 0, order: 3.052, share: 0.03, phase_rad }],
        "bearing2" => vec![Effect::BearingModulation { shaft: 1, order: 4.948 * ratio, share: 0.03, phase_rad }],
        "meshmod" => vec![Effect::StiffnessModulation { order: 1.0, share: 0.03, phase_rad }],
        "wear" => vec![Effect::Wear { depth_m: 0.5e-6 }],
        "hum" => vec![Effect::Tone { hz: 50.0, amplitude: [0.5, 0.4] }],
        "path" => vec![Effect::PathMode { channel: 0, hz: 2300.0, damping: 0.02, gain: 0.1 }],
        "drift" => vec![Effect::Drift { channel: 1, share: 0.1 }],
        "square" => vec![Effect::Nonlinearity { channel: 0, per_m_s2: 1e-3 }],
        "clip" => vec![Effect::Clipping { channel: 0, limit_m_s2: 12.0 }],
        "speed" => vec![Effect::SpeedFluctuation { hz: 2.7, angle_rad: 0.01 }],
        "cubic" => vec![Effect::Nonlinearity { channel: 0, per_m_s2: -5e-4 }],
        "impacts" => {
            vec![Effect::Impacts { channel: 0, order: 3.052, jitter: 0.01, hz: 4000.0, damping: 0.03, peak: 8.0 }]
        }
        "two" => vec![
            Effect::Eccentricity { shaft: 1, amplitude_m: 15e-6, phase_rad },
            Effect::BearingModulation { shaft: 0, order: 3.052, share: 0.03, phase_rad },
        ],
        other => panic!("unknown effect {other}"),
    };
    let made = record(&source.pair, &source.shafts, &source.curve, &scenario);
    let start = std::time::Instant::now();
    let outcome = close_loop(&made, &options).expect("loop");
    let seconds = start.elapsed().as_secs_f64();
    if !compact {
        println!("== {what} {case} seed {seed} ({seconds:.1} s)\n{}", outcome.summary());
        return;
    }
    let verdicts: Vec<String> = outcome
        .effects
        .iter()
        .map(|e| {
            let value = e
                .parameters
                .iter()
                .next()
                .map(|(n, v)| format!("{n} {:.3e} [{:.3e}, {:.3e}]", v.value, v.ci95[0], v.ci95[1]));
            let seat = e.order_of_pinion.or(e.frequency_hz).unwrap_or(0.0);
            format!("{} {} @{seat:.4} {}", e.verdict, e.name, value.unwrap_or_default())
        })
        .collect();
    let e = &outcome.error.held_out_runs;
    println!(
        "| {what} {seed} | {} | {:.4} -> {:.4} ({:.4}) | {seconds:.0} s |",
        verdicts.join("; "),
        e.before,
        e.after,
        e.noise_floor
    );
}
