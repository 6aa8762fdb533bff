//! The library's kernels (criterion, `tests/benches/dynamics.rs`) beside SciPy and ROSS, with what bounds each.

use super::peers::Solver;
use crate::shell::{Outcome, cargo, root, run, timed};
use std::fmt::Write;

/// Benches, with what one iteration holds: simulated seconds, or one.
const BENCHES: [(&str, f64); 5] = [
    ("integrate", 0.1),
    ("integrate_table", 0.1),
    ("steady_state", 1.0),
    ("channel_100_mhz", 0.01),
    ("stiffness_curve", 1.0),
];

/// Seconds per unit of each bench, in the order of [`BENCHES`].
pub struct Kernels {
    integrate: f64,
    integrate_table: f64,
    steady: f64,
    channel: f64,
    curve: f64,
}

/// Builds and runs the benches in the profile that users run.
pub fn measure() -> Outcome<Kernels> {
    timed("our kernels", || {
        let bench = ["bench", "--profile", "release", "--quiet", "--bench", "dynamics"];
        run(&mut cargo(&bench))
    })?;
    let mut seconds = [0.0; BENCHES.len()];
    for (place, (name, unit)) in seconds.iter_mut().zip(BENCHES) {
        *place = median_s(name)? / unit;
    }
    let [integrate, integrate_table, steady, channel, curve] = seconds;
    Ok(Kernels { integrate, integrate_table, steady, channel, curve })
}

/// Median time of one iteration, from criterion's estimates.
fn median_s(name: &str) -> Outcome<f64> {
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root().join("target"), Into::into);
    let path = target.join("criterion").join(name).join("new/estimates.json");
    let text = std::fs::read_to_string(&path).map_err(|e| format!("{}: {e}", path.display()))?;
    let value = text.split("\"median\"").nth(1).and_then(|rest| rest.split("\"point_estimate\":").nth(1));
    let number = value.and_then(|rest| rest.split([',', '}']).next()).and_then(|n| n.trim().parse::<f64>().ok());
    number.map(|ns| 1e-9 * ns).ok_or_else(|| format!("{}: no median", path.display()))
}

/// Goal and figure in words: met or not is arithmetic, not opinion.
fn against(value: f64, limit: f64, at_least: bool) -> &'static str {
    if (value >= limit) == at_least { "met" } else { "NOT met" }
}

/// The table, ratios first.
pub fn table(ours: &Kernels, scipy: &[Solver], ross: Option<f64>) -> String {
    let mut text = String::from(
        "\n## Kernels beside peers\n\nThe 19/48 pair at 30 turns/s, 8 coordinates, 1140 jumps of the stiffness per \
         second, relative tolerance 1e-9. \
         Peers: `tests/compare/scipy_gear_baseline.py --brief` (compiled right-hand side, restarted at every jump), \
         `tests/compare/ross_compare.py`. Our error against the matrix exponential is asserted below 1e-9 by \
         `cargo test --release --test simulator dynamics::`.\n\n| figure | measured | goal | |\n| --- | --- | --- | \
         --- |\n",
    );
    for solver in scipy {
        let ratio = solver.seconds / ours.integrate;
        let goal = if solver.name == "DOP853" { ("3000", against(ratio, 3000.0, true)) } else { ("", "") };
        let _ = writeln!(text, "| SciPy {} / ours | {ratio:.0} | {} | {} |", solver.name, goal.0, goal.1);
    }
    if let Some(ross) = ross {
        let ratio = ross / ours.curve;
        let _ =
            writeln!(text, "| ROSS / ours, stiffness curve | {ratio:.0} | 1000 | {} |", against(ratio, 1000.0, true));
    }
    let figures = [
        ("integration, s per simulated second", ours.integrate, 0.0),
        ("integration over a table of 800 rows, s per simulated second", ours.integrate_table, 0.0),
        ("periodic steady state, ms", 1e3 * ours.steady, 0.1),
        ("one channel at 100 MHz, s per simulated second", ours.channel, 0.12),
        ("stiffness curve, 1000 points with components, ms", 1e3 * ours.curve, 0.0),
    ];
    for (name, value, goal) in figures {
        let (goal, met) = if goal > 0.0 { (goal.to_string(), against(value, goal, false)) } else { Default::default() };
        let _ = writeln!(text, "| {name} | {value:.4} | {goal} | {met} |");
    }
    for solver in scipy {
        let _ = writeln!(
            text,
            "| SciPy {}, s per simulated second (error {}) | {:.2} | | |",
            solver.name, solver.error, solver.seconds
        );
    }
    if let Some(ross) = ross {
        let _ = writeln!(text, "| ROSS, stiffness curve of the 19/48 pair, s | {ross:.2} | | |");
    }
    text.push_str(LIMITS);
    text
}

const LIMITS: &str = "
Physical limits, for a core of 3 GHz with two units each for sums and for products of four lanes, not fused (so that \
figures do not depend on the processor): an order of the recurrence
of 8 coordinates is about 90 products and 80 sums, 11 cycles; 45 orders make a step, 3 400 steps a simulated second: \
0.0006 s. But each order waits for the one before: elastic forces (12 cycles), scalar
product (12), mesh force and next coefficient (9), of which a third overlaps: about 24 cycles, 0.0012 s. The rest up \
to the figure above is what a step costs beside its orders (setting up, end state, step
length: a third) and loads and stores of what does not fit into 16 registers. The 18 columns of a periodic state, \
four abreast, are bound by the units: 5 groups of 45 orders in some 6 steps,
45 cycles each, 0.02 ms, and its solution of 17 equations. A sample at 100 MHz is half a pair of 8 terms, 8 \
operations: 1 cycle, 0.03 s per simulated second, and writing it as much again.
";
