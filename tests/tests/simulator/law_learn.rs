//! A law measured on a record: known bandwidths come out, noise adds none, edges agree with the simulated law, and
//! what cannot be measured is refused.

use meshband_host::dynamics::simulate::Acquisition as Sampling;
use meshband_host::law::derive::edge_bandwidth_hz;
use meshband_host::law::file::{LawFile, Measured};
use meshband_host::law::learn::{Learned, Wanted, learn};
use meshband_host::law::operating::Bench;
use meshband_host::machine::Machine;
use meshband_host::record::{Declaration, Record, Run, RunDeclaration};
use meshband_host::virtual_node::signal::{Operation, Signal};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

const TEETH: [u32; 2] = [20, 31];
const RATE_HZ: f64 = 40_000.0;

/// One channel per record, one pulse per turn of the pinion.
fn record(teeth: [u32; 2], rate_hz: f64, runs: &[(Vec<f64>, Vec<f64>)]) -> Record {
    let largest = runs.iter().flat_map(|(s, _)| s).fold(1e-9_f64, |l, x| l.max(x.abs()));
    let text = format!(
        "title = \"learned\"\n[acquisition]\nsample_rate_hz = {rate_hz}\nchannels = [\"housing\"]\nfull_scale_m_s2 = \
         {:e}\n\
         [pair]\nteeth = [{}, {}]\n[tach]\nshaft = \"pinion\"\npulses_per_rev = 1\n",
        1.01 * largest,
        teeth[0],
        teeth[1]
    );
    let mut declaration = Declaration::parse(&text, "record.toml").expect("a declaration");
    declaration.runs = (0..runs.len()).map(|i| RunDeclaration::numbered(i, true, None)).collect();
    let runs = runs
        .iter()
        .zip(&declaration.runs)
        .map(|((signal, edges), run)| {
            Run::from_signals(run.clone(), &declaration.acquisition, std::slice::from_ref(signal), edges.clone())
                .expect("a run")
        })
        .collect();
    Record { folder: PathBuf::from("learned"), declaration, runs }
}

/// Mesh harmonics up to `highest(speed)` Hz, all of the same power, in noise; the turn is the integral of `speed_hz`.
fn run(seconds: f64, speed_hz: impl Fn(f64) -> f64, highest_hz: f64, noise: f64, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let (mut turns, mut edges) = (0.0_f64, Vec::new());
    let signal = (0..(seconds * RATE_HZ) as usize)
        .map(|n| {
            let time_s = n as f64 / RATE_HZ;
            let (speed, before) = (speed_hz(time_s), turns);
            turns += speed / RATE_HZ;
            if turns.floor() > before.floor() {
                edges.push(time_s + (turns.floor() - before) / speed);
            }
            let mesh_hz = f64::from(TEETH[0]) * speed;
            let harmonics = (1..).take_while(|k| f64::from(*k) * mesh_hz <= highest_hz);
            let draw: f64 = StandardNormal.sample(&mut random);
            noise * draw
                + harmonics
                    .map(|k| (TAU * f64::from(TEETH[0] * k) * before + 0.7 * f64::from(k * k)).cos())
                    .sum::<f64>()
        })
        .collect();
    (signal, edges)
}

fn nearest(learned: &Learned, speed_hz: f64) -> (f64, f64) {
    let apart = |k: &&meshband_host::law::learn::knots::Knot| (k.speed_hz / speed_hz).ln().abs();
    let knot = learned.knots.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))).expect("a knot");
    (knot.bandwidth_hz, knot.relative_error)
}

#[test]
fn theory_known_bandwidths_come_out_of_noise_ten_times_the_harmonics_and_noise_adds_none() {
    let speeds = [8.0, 12.0, 18.0, 25.0];
    let runs: Vec<_> = speeds.iter().zip(1..).map(|(&f, seed)| run(96.0 / f, |_| f, 6000.0, 10.0, seed)).collect();
    let learned = learn(&record(TEETH, RATE_HZ, &runs), 0, Wanted::Auto).expect("learned");
    assert_eq!((learned.measured, learned.knots.len()), (Measured::Occupied, 4), "{}", learned.reason);
    for speed in speeds {
        // All harmonics have the same power: 99 % of it needs the last one.
        let last_hz = (6000.0 / (20.0 * speed)).floor() * 20.0 * speed;
        let (bandwidth_hz, error) = nearest(&learned, speed);
        println!("{speed} turns/s: {bandwidth_hz:.0} Hz of {last_hz:.0}, standard error {:.2} %", 100.0 * error);
        assert!((bandwidth_hz / last_hz - 1.0).abs() < 0.01 + 2.0 * error, "{bandwidth_hz} of {last_hz} at {speed}");
    }
    let file = learned.file(None);
    let law = file.for_node().expect("a node takes it");
    assert_eq!(law.ramp, meshband::law::RampDescription::Measured);
    assert_eq!(LawFile::from_toml(&file.to_toml(), "law.toml").expect("reads back"), file);
}

#[test]
fn theory_a_run_up_gives_a_law_over_its_speeds() {
    let up = run(40.0, |t| 8.0 + 0.3 * t, 5000.0, 0.5, 7);
    let learned = learn(&record(TEETH, RATE_HZ, &[up]), 0, Wanted::Occupied).expect("learned");
    assert!(learned.knots.len() >= 6, "{:?}", learned.notes);
    let [first, last] = [&learned.knots[0], &learned.knots[learned.knots.len() - 1]];
    assert!(first.speed_hz < 9.5 && last.speed_hz > 17.5, "{} to {}", first.speed_hz, last.speed_hz);
    for knot in &learned.knots {
        // Within a knot's speeds the last harmonic below 5 kHz may be another one.
        assert!((0.88..1.02).contains(&(knot.bandwidth_hz / 5000.0)), "{knot:?}");
    }
}

#[test]
fn ref_edges_of_a_simulated_machine_give_its_simulated_law() {
    let machine =
        Machine::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines/paper-rig.toml")).expect("reads");
    let bench = Bench::new(&machine).expect("a bench");
    let torque_n_m = machine.nominal.expect("declared").torque_n_m;
    let speeds = [8.0, 10.0, 12.0];
    let rate_hz = 800_000.0;
    let runs: Vec<_> = speeds
        .iter()
        .map(|&speed_hz| {
            let acquisition = Sampling {
                rate_hz,
                duration_s: 27.0 / speed_hz,
                pulses_per_turn: 1,
                jitter_s: 0.0,
                noise_m_s2: 0.0,
                seed: 1,
            };
            let operation = Operation {
                speed_hz,
                final_speed_hz: None,
                back_s: None,
                torque_n_m,
                effects: &[],
                acquisition,
                channel: 0,
                second: None,
            };
            let signal = Signal::of_machine(&machine, &operation).expect("simulates");
            (signal.samples, signal.edges_s)
        })
        .collect();
    let learned = learn(&record(machine.pair.teeth, rate_hz, &runs), 0, Wanted::Auto).expect("learned");
    assert_eq!(learned.measured, Measured::Edges, "{}", learned.reason);
    for speed in speeds {
        let (measured_hz, error) = nearest(&learned, speed);
        let law_hz = edge_bandwidth_hz(&bench, speed, torque_n_m).expect("timed");
        println!(
            "{speed} turns/s: {measured_hz:.0} Hz measured, {law_hz:.0} Hz simulated, standard error {:.2} %",
            100.0 * error
        );
        assert!((measured_hz / law_hz - 1.0).abs() < 0.04, "{measured_hz} of {law_hz} at {speed}");
    }
}

#[test]
fn fault_one_speed_noise_alone_and_a_band_that_ends_too_early_are_refused_with_the_reason() {
    let refused = |runs: &[(Vec<f64>, Vec<f64>)], wanted: Wanted| {
        learn(&record(TEETH, RATE_HZ, runs), 0, wanted).expect_err("refused").to_string()
    };
    let one = refused(&[run(8.0, |_| 12.0, 6000.0, 0.1, 1)], Wanted::Occupied);
    assert!(one.contains("measured at 1 speed") && one.contains("a law needs two"), "{one}");
    let noise = refused(&[run(8.0, |_| 10.0, 0.0, 1.0, 1), run(8.0, |_| 14.0, 0.0, 1.0, 2)], Wanted::Occupied);
    assert!(noise.contains("nothing repeats with the pinion above the noise"), "{noise}");
    let band = refused(&[run(8.0, |_| 10.0, 19_000.0, 0.1, 1), run(8.0, |_| 14.0, 19_000.0, 0.1, 2)], Wanted::Occupied);
    assert!(band.contains("the record's band ends before the vibration does"), "{band}");
    let tones = refused(&[run(8.0, |_| 10.0, 250.0, 0.0, 1), run(8.0, |_| 14.0, 300.0, 0.0, 2)], Wanted::Edges);
    assert!(tones.contains("edges could be timed in 0 of"), "a tone is no edge: {tones}");
}
