//! Dynamics against independent numbers: golden vector, natural frequencies, records of another simulator.

use meshband_host::dynamics::assembly::{Damping, Model, Options as AssemblyOptions};
use meshband_host::dynamics::energy::Meter;
use meshband_host::dynamics::mesh::MeshDamping;
use meshband_host::dynamics::predict::Predictor;
use meshband_host::dynamics::sample::Sampler;
use meshband_host::dynamics::steady::steady_state;
use meshband_host::dynamics::taylor::Options;
use meshband_host::dynamics::{Facts, Mesh, Motion, Solver, State, System};
use meshband_host::effects;
use meshband_host::machine::Machine;
use meshband_host::piecewise::PiecewisePolynomial;
use meshband_host::record::Record;
use serde_json::Value;

fn vectors() -> Value {
    serde_json::from_str(include_str!("../vectors/dynamics.json")).expect("valid JSON")
}

fn number(v: &Value) -> f64 {
    v.as_f64().expect("number")
}

fn golden_machine(v: &Value) -> Machine {
    let inertia = &v["inertia_kg_m2"];
    let text = format!(
        "title = 'golden'\n[pair]\nteeth = [19, 48]\nmodule_m = {}\nface_width_m = 0.016\n\
         bore_radius_m = [0.0096, 0.0265]\nyoungs_modulus_pa = 2.068e11\npoisson = 0.3\nmesh_damping_s = 0.0\n\
         [shafts]\ninertia_motor_kg_m2 = {}\ninertia_pinion_kg_m2 = {}\ninertia_gear_kg_m2 = {}\n\
         inertia_load_kg_m2 = {}\ncoupling_stiffness_n_m_per_rad = {}\ncoupling_damping_n_m_s_per_rad = {}\n\
         mass_kg = {}\nbearing_stiffness_n_per_m = [{bearing}, {bearing}]\nbearing_damping_n_s_per_m = [{damping}, {damping}]\n",
        v["module_m"],
        inertia["motor"],
        inertia["pinion"],
        inertia["gear"],
        inertia["load"],
        v["coupling_stiffness_n_m_per_rad"],
        v["coupling_damping_n_m_s_per_rad"],
        v["mass_kg"],
        bearing = v["bearing_stiffness_n_per_m"],
        damping = v["bearing_damping_n_s_per_m"],
    );
    Machine::from_toml(&text, "golden", std::path::Path::new("")).expect("a sound machine")
}

struct Golden {
    system: System,
    stiffness: PiecewisePolynomial,
    damping: MeshDamping,
    motion: Motion,
    facts: Facts,
    k: [f64; 2],
    period: f64,
    double: f64,
    torque: f64,
}

fn golden() -> Golden {
    let v = vectors();
    let machine = golden_machine(&v);
    let axis_angle_rad = 20.0_f64.to_radians();
    let system = System::assemble(&machine, &AssemblyOptions { axis_angle_rad, ..Default::default() }).expect("sound");
    let square = &v["stiffness_square_wave_n_per_m"];
    let k = [number(&square["double"]), number(&square["single"])];
    let part = number(&v["contact_ratio"]) - 1.0;
    let stiffness = PiecewisePolynomial::new(vec![0.0, part, 1.0], vec![vec![k[0]], vec![k[1]]]);
    let [rb1, rb2] = system.base_radius_m;
    let mass_kg =
        1.0 / (rb1 * rb1 / machine.shafts.inertia_pinion_kg_m2 + rb2 * rb2 / machine.shafts.inertia_gear_kg_m2);
    let facts = Facts {
        teeth: [19, 48],
        base_radius_m: system.base_radius_m,
        base_pitch_m: std::f64::consts::TAU * rb1 / 19.0,
        pressure_angle_rad: axis_angle_rad,
        path_base_pitches: 1.0,
        pitch_point_base_pitches: 0.5,
        mass_kg: machine.shafts.mass_kg,
        input_torque_n_m: 11.9,
        bearing_stiffness_n_per_m: machine.shafts.bearing_stiffness_n_per_m,
    };
    Golden {
        system,
        stiffness,
        damping: MeshDamping::Ratio { ratio: 0.03, mass_kg },
        motion: Motion::Constant { speed_hz: 30.0, turns_at_zero: 0.0 },
        facts,
        k,
        period: number(&v["mesh_period_s"]),
        double: number(&v["double_contact_s"]),
        torque: number(&v["torque_n_m"]),
    }
}

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

/// Companion matrix of the golden system at stiffness `k`, with the constant force as last column.
fn companion(g: &Golden, k: f64) -> nalgebra::DMatrix<f64> {
    let n = g.system.len();
    let MeshDamping::Ratio { ratio, mass_kg } = g.damping else { panic!("the golden damping is a ratio") };
    let c = 2.0 * ratio * (k * mass_kg).sqrt();
    let shape = &g.system.mesh * g.system.mesh.transpose();
    let (stiffness, damping) = (&g.system.stiffness + k * &shape, &g.system.damping + c * &shape);
    let mut a = nalgebra::DMatrix::zeros(2 * n + 1, 2 * n + 1);
    for i in 0..n {
        a[(i, n + i)] = 1.0;
        a[(n + i, 2 * n)] = g.system.torque[i] * g.torque / g.system.mass[i];
        for j in 0..n {
            a[(n + i, j)] = -stiffness[(i, j)] / g.system.mass[i];
            a[(n + i, n + j)] = -damping[(i, j)] / g.system.mass[i];
        }
    }
    a
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
    let mut state = State::<8> { q: std::array::from_fn(|i| start[i]), v: [0.0; 8] };
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let (mut next, mut errors) = (0, Vec::new());
    let options = Options { tolerance: 1e-9, ..Default::default() };
    let statistics = solver
        .integrate(&mut mesh, &mut state, (0.0, t), &options, |step| {
            while next < times.len() && times[next] < step.start_s + step.end * step.length_s {
                let tau = (times[next] - step.start_s) / step.length_s;
                errors.push(step.acceleration(y1).value(tau) - truth[next]);
                next += 1;
            }
        })
        .expect("integrates");
    let rms = |x: &[f64]| (x.iter().map(|x| x * x).sum::<f64>() / x.len() as f64).sqrt();
    let error = rms(&errors) / rms(&truth);
    let began = std::time::Instant::now();
    solver.integrate(&mut mesh, &mut state, (t, t + 0.5), &options, |_| {}).expect("integrates");
    let cost = began.elapsed().as_secs_f64() / 0.5;
    let mut sampler = Sampler::spanning(100e6, 0, 10_000_000);
    let mut sum = 0.0_f32;
    let began = std::time::Instant::now();
    solver
        .integrate(&mut mesh, &mut state, (0.0, 0.1), &options, |step| {
            sampler.take(step, &[y1], |_, _, values| sum += values[0] as f32);
        })
        .expect("integrates");
    println!("100 MHz {:.3} s per s (first {sum})", began.elapsed().as_secs_f64() / 0.1);
    println!("error {error:.1e}, {cost:.4} s per s, {statistics:?}");
    assert_eq!(errors.len(), times.len());
    assert!(error < 1e-9, "{error:.1e}");
}

#[test]
fn theory_steady_state_repeats_and_its_energy_balance_closes() {
    let g = golden();
    let force = &g.system.torque * g.torque;
    let options = Options { tolerance: 1e-12, ..Default::default() };
    let mut mesh = Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    let began = std::time::Instant::now();
    let steady = steady_state::<8>(&g.system, &mut mesh, &force, (0.0, g.period), &options).expect("stable");
    println!(
        "steady state in {:.3} ms, largest multiplier {:.4}, load correction {:.2e} N m",
        began.elapsed().as_secs_f64() * 1e3,
        steady.largest_multiplier(),
        steady.load_correction_n_m
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
