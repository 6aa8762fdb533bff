//! Cost of the solver on the golden 19/48 pair at 30 turns/s, one thread: integration at 1e-9 over the square wave and
//! over a table of 800 rows, the periodic steady state of one operating point, one channel sampled at 100 MHz; and
//! the stiffness curve of 1000 points. `cargo xtask bench` runs it beside peers; simulated time per iteration is
//! 0.1 s, 0.01 s for the sampled channel. The clock is the thread's
//! processor time, so that other programs on the machine do not count.

#[path = "../tests/simulator/golden_pair.rs"]
mod golden_pair;

use criterion::measurement::{Measurement, ValueFormatter, WallTime};
use criterion::{Criterion, criterion_group, criterion_main};
use golden_pair::golden;
use meshband_host::dynamics::sample::Sampler;
use meshband_host::dynamics::steady::{Balance, steady_state};
use meshband_host::dynamics::taylor::Options;
use meshband_host::dynamics::{Mesh, Solver, State};
use meshband_host::machine::Machine;
use meshband_host::stiffness::Table;
use meshband_host::stiffness::report::Report;
use rustix::time::{ClockId, clock_gettime};
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Simulated time of one integration, s; `xtask/src/bench/kernels.rs` divides by the same.
const INTEGRATED_S: f64 = 0.1;
/// Simulated time of one sampled channel, s.
const SAMPLED_S: f64 = 0.01;

/// Processor time of the calling thread.
struct ThreadTime;

impl Measurement for ThreadTime {
    type Intermediate = Duration;
    type Value = Duration;

    fn start(&self) -> Duration {
        let now = clock_gettime(ClockId::ThreadCPUTime);
        Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
    }

    fn end(&self, start: Duration) -> Duration {
        self.start() - start
    }

    fn add(&self, a: &Duration, b: &Duration) -> Duration {
        *a + *b
    }

    fn zero(&self) -> Duration {
        Duration::ZERO
    }

    fn to_f64(&self, value: &Duration) -> f64 {
        value.as_nanos() as f64
    }

    fn formatter(&self) -> &dyn ValueFormatter {
        WallTime.formatter()
    }
}

fn machines() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines")
}

fn dynamics(criterion: &mut Criterion<ThreadTime>) {
    let g = golden();
    let force = &g.system.torque * g.torque;
    let options = Options { tolerance: 1e-9, ..Default::default() };
    let start = g.system.static_deflection(&force, g.k[0]).expect("solvable");
    let state = State::<8> { q: std::array::from_fn(|i| start[i]), v: [0.0; 8] };
    let solver = Solver::<8>::new(&g.system, &force);
    let mesh = || Mesh::new(&g.system, &g.stiffness, g.damping, &g.motion, &[], g.facts);
    criterion.bench_function("integrate", |b| {
        b.iter(|| {
            let mut state = state;
            solver.integrate(&mut mesh(), &mut state, (0.0, INTEGRATED_S), &options, |_| {}).expect("integrates");
            black_box(state)
        });
    });
    let table = Table::read(&machines().join("check-19-48.csv")).expect("a table").linear();
    criterion.bench_function("integrate_table", |b| {
        b.iter(|| {
            let mut state = state;
            let mut mesh = Mesh::new(&g.system, &table, g.damping, &g.motion, &[], g.facts);
            solver.integrate(&mut mesh, &mut state, (0.0, INTEGRATED_S), &options, |_| {}).expect("integrates");
            black_box(state)
        });
    });
    criterion.bench_function("stiffness_curve", |b| {
        let machine = Machine::read(&machines().join("19-48.toml")).expect("a sound machine");
        b.iter(|| black_box(Report::new(&machine, 1000).expect("a curve")));
    });
    criterion.bench_function("steady_state", |b| {
        b.iter(|| {
            let steady = steady_state::<8>(&g.system, &mut mesh(), &force, (0.0, g.period), Balance::Load, &options);
            black_box(steady.expect("stable").state)
        });
    });
    let y1 = g.system.sensor(0).expect("y1");
    criterion.bench_function("channel_100_mhz", |b| {
        b.iter(|| {
            let mut state = state;
            let mut sampler = Sampler::new(100e6, (SAMPLED_S * 100e6) as usize);
            let mut sum = 0.0;
            solver
                .integrate(&mut mesh(), &mut state, (0.0, SAMPLED_S), &options, |step| {
                    sampler.take(step, &[y1], |_, _, values| sum += values[values.len() - 1]);
                })
                .expect("integrates");
            black_box(sum)
        });
    });
}

criterion_group! {
    name = benches;
    config = Criterion::default().with_measurement(ThreadTime);
    targets = dynamics
}
criterion_main!(benches);
