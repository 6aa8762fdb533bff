//! Dynamics against independent numbers: golden vector, natural frequencies, records of another simulator.

use super::golden_pair;

use golden_pair::{Golden, companion, golden, golden_machine, number, vectors};
use meshband_host::dynamics::assembly::{Damping, Model, Options as AssemblyOptions};
use meshband_host::dynamics::energy::Meter;
use meshband_host::dynamics::mesh::MeshDamping;
use meshband_host::dynamics::steady::{Balance, steady_state};
use meshband_host::dynamics::taylor::Options;
use meshband_host::dynamics::{Mesh, Solver, State, System};
use meshband_host::effects;
use meshband_host::predict::Predictor;
use meshband_host::record::Record;

#[test]
fn ref_natural_frequencies_of_eight_coordinates() {
    let g = golden();
    let found = g.system.natural_frequencies_hz(g.k[0]);
    let expected = vectors();
    for (found, expected) in found.iter().zip(expected["modes_at_double_hz"].as_array().expect("list")) {
        let expected = number(expected);
        let allowed = if expected == 0.0 { 1e-2 } else { 1e-6 * expected };
        assert!((found - expected).abs() <= allowed, "{found} Hz instead of {expected} Hz");
    }
}

#[test]
fn ref_golden_acceleration_at_segment_ends() {
    let g = golden();
    let force = &g.system.torque * g.torque;
    let mean = (g.k[0] * g.double + g.k[1] * (g.period - g.double)) / g.period;
    let start = g.system.static_deflection(&force, mean).expect("solvable");
    let mut state = State::<8> { q: std::array::from_fn(|i| start[i]), v: [0.0; 8] };
    let solver = Solver::<8>::new(&g.system, &force);
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let y1 = g.system.sensor(0).expect("y1");
    let mut ends = Vec::new();
    let options = Options { tolerance: 1e-13, ..Default::default() };
    let statistics = solver
        .integrate(&mut mesh, &mut state, (0.0, 28.0 * g.period), &options, |step| {
            ends.push((step.start_s + step.end * step.length_s, step.acceleration(y1).value(step.end)));
        })
        .expect("integrates");
    println!("{statistics:?}");
    let expected = vectors();
    for (segment, value) in expected["y1_acceleration_at_segment_end_m_s2"].as_object().expect("table") {
        let n: u32 = segment.parse().expect("number");
        let t = f64::from((n - 1) / 2) * g.period + if n % 2 == 1 { g.double } else { g.period };
        let (_, found) = ends.iter().find(|(end, _)| (end - t).abs() < 1e-9).expect("a step ends there");
        let error = (found / number(value) - 1.0).abs();
        println!("segment {n}: {found} error {error:.1e}");
        assert!(error < 1e-9, "segment {n}: {found} instead of {value}");
    }
}

/// What remains of `measured - predicted` below 15 kHz, relative to the measured AC RMS below 15 kHz.
fn remaining(measured: &[f64], predicted: &[f64], rate_hz: f64) -> f64 {
    let n = measured.len();
    let fft = rustfft::FftPlanner::<f64>::new().plan_fft_forward(n);
    let power = |signal: Vec<f64>| {
        let mut line: Vec<_> = signal.into_iter().map(|x| rustfft::num_complex::Complex::new(x, 0.0)).collect();
        fft.process(&mut line);
        let last = (15_000.0 * n as f64 / rate_hz) as usize;
        line[1..=last].iter().map(|c| c.norm_sqr()).sum::<f64>()
    };
    let difference = measured.iter().zip(predicted).map(|(a, b)| a - b).collect();
    (power(difference) / power(measured.to_vec())).sqrt()
}

#[test]
fn ref_records_of_an_independent_simulator_are_predicted_to_a_thousandth() {
    for name in ["check-19-48", "check-55-75"] {
        let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors").join(name);
        let record = Record::read(&folder).expect("a sound record");
        let predictor = Predictor::new(&record, Model::BendingTorsional, Damping::Declared).expect("a machine");
        for (index, run) in record.runs.iter().enumerate() {
            let (channels, statistics) = predictor.predict(run, &[]).expect("predicts");
            for (channel, predicted) in channels.iter().enumerate() {
                let left = remaining(&run.signal_m_s2(channel), predicted, run.sample_rate_hz());
                println!("{name} run {index} channel {channel}: {:.4} % left, {statistics:?}", 100.0 * left);
                assert!(left < 1e-3, "{name} run {index} channel {channel}: {left:.2e} of the AC RMS left");
            }
        }
    }
}

#[test]
fn ref_acceleration_converges_to_the_matrix_exponential() {
    let g = golden();
    let force = &g.system.torque * g.torque;
    let mean = (g.k[0] * g.double + g.k[1] * (g.period - g.double)) / g.period;
    let start = g.system.static_deflection(&force, mean).expect("solvable");
    let y1 = g.system.sensor(0).expect("y1");
    const CELLS: usize = 100;
    let mut exact = nalgebra::DVector::zeros(17);
    (0..8).for_each(|i| exact[i] = start[i]);
    exact[16] = 1.0;
    let lengths = [g.double, g.period - g.double];
    let matrices = [companion(&g, g.k[0]), companion(&g, g.k[1])];
    let half: Vec<_> = (0..2).map(|z| (&matrices[z] * (lengths[z] / (2 * CELLS) as f64)).exp()).collect();
    let (mut times, mut truth, mut t) = (Vec::new(), Vec::new(), 0.0);
    for segment in 0..56 {
        let z = segment % 2;
        let cell = lengths[z] / CELLS as f64;
        for i in 0..CELLS {
            exact = &half[z] * exact;
            times.push(t + (i as f64 + 0.5) * cell);
            truth.push((&matrices[z] * &exact)[8 + y1]);
            exact = &half[z] * exact;
        }
        t += lengths[z];
    }
    let solver = Solver::<8>::new(&g.system, &force);
    let error_at = |tolerance: f64| {
        let mut state = State::<8> { q: std::array::from_fn(|i| start[i]), v: [0.0; 8] };
        let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
        let (mut next, mut errors) = (0, Vec::new());
        let options = Options { tolerance, ..Default::default() };
        let statistics = solver
            .integrate(&mut mesh, &mut state, (0.0, t), &options, |step| {
                while next < times.len() && times[next] < step.start_s + step.end * step.length_s {
                    let tau = (times[next] - step.start_s) / step.length_s;
                    errors.push(step.acceleration(y1).value(tau) - truth[next]);
                    next += 1;
                }
            })
            .expect("integrates");
        assert_eq!(errors.len(), times.len());
        let rms = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
        let error = rms(&errors) / rms(&truth);
        println!("tolerance {tolerance:.0e}: error {error:.1e}, {statistics:?}");
        error
    };
    // Acceleration goes with the tolerance: a thousand times looser, hundreds of times less exact, and not more.
    let [tight, loose] = [1e-9, 1e-6].map(error_at);
    assert!(tight < 1e-9 && loose < 1e-6 && loose > 10.0 * tight, "{tight:.1e} {loose:.1e}");
}

#[test]
fn theory_steady_state_repeats_and_its_energy_balance_closes() {
    let g = golden();
    let force = &g.system.torque * g.torque;
    let options = Options { tolerance: 1e-12, ..Default::default() };
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let began = std::time::Instant::now();
    let steady =
        steady_state::<8>(&g.system, &mut mesh, &force, (0.0, g.period), Balance::Load, &options).expect("stable");
    println!(
        "steady state in {:.3} ms, largest multiplier {:.4}, load correction {:.2e} N m",
        began.elapsed().as_secs_f64() * 1e3,
        steady.largest_multiplier(),
        steady.correction.amax()
    );
    assert!(steady.largest_multiplier() < 1.0);
    let mut state = steady.state;
    let solver = Solver::<8>::new(&g.system, &force);
    let mut meter = Meter::new(&g.system, &force);
    solver.integrate(&mut mesh, &mut state, (0.0, g.period), &options, |step| meter.add(step)).expect("integrates");
    let scale = steady.state.q.iter().fold(0.0_f64, |m, q| m.max(q.abs()));
    for (before, after) in steady.state.q.iter().zip(&state.q) {
        assert!((before - after).abs() < 1e-8 * scale, "{before} became {after}");
    }
    let balance = meter.balance();
    println!("{balance:?} residual {:.1e}", balance.residual());
    assert!(balance.residual() < 1e-6, "{balance:?}");
}

/// Reference for contact loss: RK4 with small steps, switches bisected, on delta alone regimes.
struct Flight<'g> {
    g: &'g Golden,
    clearance: f64,
}

impl Flight<'_> {
    fn acceleration(&self, k: f64, regime: i32, x: &[f64; 4]) -> [f64; 4] {
        let s = &self.g.system;
        let MeshDamping::Ratio { ratio, mass_kg } = self.g.damping else { panic!("ratio") };
        let delta = s.mesh[0] * x[0] + s.mesh[1] * x[1];
        let rate = s.mesh[0] * x[2] + s.mesh[1] * x[3];
        let c = 2.0 * ratio * (k * mass_kg).sqrt();
        let force = match regime {
            1 => k * delta + c * rate,
            -1 => k * (delta + self.clearance) + c * rate,
            _ => 0.0,
        };
        let a = |i: usize| (s.torque[i] * self.g.torque - s.mesh[i] * force) / s.mass[i];
        [x[2], x[3], a(0), a(1)]
    }

    fn step(&self, k: f64, regime: i32, x: &[f64; 4], h: f64) -> [f64; 4] {
        let at = |x: &[f64; 4], d: &[f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * d[i]);
        let a = self.acceleration(k, regime, x);
        let b = self.acceleration(k, regime, &at(x, &a, 0.5 * h));
        let c = self.acceleration(k, regime, &at(x, &b, 0.5 * h));
        let d = self.acceleration(k, regime, &at(x, &c, h));
        std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]))
    }

    fn regime(&self, x: &[f64; 4]) -> i32 {
        let delta = self.g.system.mesh[0] * x[0] + self.g.system.mesh[1] * x[1];
        i32::from(delta > 0.0) - i32::from(delta < -self.clearance)
    }

    fn run(&self, mut x: [f64; 4], periods: usize, h: f64) -> ([f64; 4], usize) {
        let mut switches = 0;
        let mut regime = self.regime(&x);
        for segment in 0..2 * periods {
            let z = segment % 2;
            let mut left = [self.g.double, self.g.period - self.g.double][z];
            while left > 0.0 {
                let h = h.min(left);
                let k = self.g.k[z];
                let mut next = self.step(k, regime, &x, h);
                let mut taken = h;
                if self.regime(&next) != regime {
                    let (mut low, mut high) = (0.0, h);
                    for _ in 0..60 {
                        let middle = 0.5 * (low + high);
                        if self.regime(&self.step(k, regime, &x, middle)) == regime {
                            low = middle
                        } else {
                            high = middle
                        }
                    }
                    next = self.step(k, regime, &x, high);
                    taken = high;
                    regime = self.regime(&next);
                    switches += 1;
                }
                x = next;
                left -= taken;
            }
        }
        (x, switches)
    }
}

#[test]
fn ref_contact_loss_agrees_with_an_event_located_runge_kutta() {
    let mut g = golden();
    g.system = System::assemble(
        &golden_machine(&vectors()),
        &AssemblyOptions { model: Model::Torsional, ..Default::default() },
    )
    .expect("sound");
    let force = &g.system.torque * g.torque;
    let start = g.system.static_deflection(&force, g.k[0]).expect("solvable");
    let clearance = 20e-6;
    let x = [start[0], start[1], -20.0, 0.0];
    let periods = 2;

    let (expected, switches) = Flight { g: &g, clearance }.run(x, periods, 1e-7);
    let effects = vec![effects::parse(&format!("backlash:clearance={clearance}")).expect("known")];
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &effects, g.facts);
    let mut state = State::<2> { q: [x[0], x[1]], v: [x[2], x[3]] };
    let solver = Solver::<2>::new(&g.system, &force);
    let end = periods as f64 * g.period;
    let statistics =
        solver.integrate(&mut mesh, &mut state, (0.0, end), &Options::default(), |_| {}).expect("integrates");
    println!("{switches} switches, {statistics:?}\n{expected:?}\n{state:?}");
    assert!(switches > 10, "the case must lose contact");
    assert_eq!(statistics.contact_events as usize, switches);
    for (found, expected) in state.v.iter().zip(&expected[2..]) {
        assert!((found / expected - 1.0).abs() < 1e-6, "{found} instead of {expected}");
    }
}
