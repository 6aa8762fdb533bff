//! `cargo xtask bench-node`: instructions of the node's stages in QEMU against the committed counts.
//!
//! `--overwrite` writes the counts instead. Counts repeat exactly; a change beyond the tolerance is a change of code or
//! compiler and wants a look. The table sets resolving the mesh bands against one full-band FFT
//! (book/src/adr/0026-mesh-bands.md).

use crate::setup::TARGET;
use crate::shell::{Outcome, cargo, root, run, say};
use std::collections::BTreeMap;
use std::process::Stdio;

const SNAPSHOT: &str = "tests/snapshots/instructions.txt";
/// Relative change that is reported as an error.
const TOLERANCE: f64 = 0.03;
/// Instructions per second the complete chain may take: half of a 168 MHz Cortex-M4F at two cycles each.
const BUDGET: u64 = 42_000_000;
/// CMSIS-DSP's `arm_rfft_fast_f32` of 4096 points, instructions.
const CMSIS_4096: f64 = 229_520.0;

type Counts = BTreeMap<String, u64>;

/// The committed counts beside the literature's, for the page of benchmarks.
pub fn page() -> Outcome<String> {
    let text = std::fs::read_to_string(root().join(SNAPSHOT)).map_err(|e| format!("{SNAPSHOT}: {e}"))?;
    let counts = pairs(text.lines());
    let get = |name: &str| counts.get(name).copied().unwrap_or(0);
    let chain = get("chain-highest-rate-per-s@25");
    Ok(format!(
        "\n## Node, instructions\n\nFrom `{SNAPSHOT}`, kept by `cargo xtask bench-node` (QEMU, Cortex-M4F, exact \
         counts).\n\n\
         | stage | instructions |\n| --- | --- |\n\
         | real FFT of 4096 points, with its window's copy | {} |\n\
         | CMSIS-DSP `arm_rfft_fast_f32` of 4096 points (counted once with GCC 12 -O3, not in this run) | \
         {CMSIS_4096:.0} |\n\
         | one decimation stage, per input sample | {:.1} |\n\
         | tach, per pulse | {:.0} |\n\
         | complete chain at the highest rate, per second | {:.1} M of {:.0} M |\n",
        get("fft-4096@0"),
        get("decimate-per-4096-samples@1") as f64 / 4096.0,
        get("tach-per-967-pulses@25") as f64 / 967.0,
        chain as f64 / 1e6,
        BUDGET as f64 / 1e6,
    ))
}

/// Builds, runs, prints, compares.
pub fn run_task(arguments: &[String]) -> Outcome {
    let build = ["build", "--quiet", "--package", "meshband-node", "--target", TARGET, "--profile", "firmware"];
    run(cargo(&build).args(["--bin", "bench", "--features", "board-an386"]))?;
    let image = crate::node_build::image("bench");
    let mut qemu = crate::shell::command(&["qemu-system-arm", "-machine", "mps2-an386", "-nodefaults"]);
    qemu.args(["-display", "none", "-monitor", "none", "-icount", "shift=6,sleep=off"]);
    qemu.args(["-semihosting-config", "enable=on,target=native", "-kernel"]).arg(&image);
    let output = qemu.stdin(Stdio::null()).output().map_err(|e| format!("qemu-system-arm: {e}"))?;
    // The image's console is QEMU's standard error.
    let console = String::from_utf8_lossy(&output.stderr);
    if !(output.status.success() && console.lines().any(|line| line == "node: finished")) {
        return Err(format!("the bench image did not finish:\n{console}"));
    }
    let counts = parse(&console);
    table(&counts);
    let path = root().join(SNAPSHOT);
    if arguments.iter().any(|a| a == "--overwrite") {
        let text: String = counts.iter().map(|(name, value)| format!("{name} {value}\n")).collect();
        let folder = path.parent().unwrap_or(&path);
        std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&path, text)).map_err(|e| e.to_string())?;
        say(format_args!("written: {SNAPSHOT}"));
        return Ok(());
    }
    let committed = std::fs::read_to_string(&path).map_err(|e| format!("{SNAPSHOT}: {e}"))?;
    compare(&counts, &pairs(committed.lines()))
}

fn parse(text: &str) -> Counts {
    pairs(text.lines().filter_map(|line| line.trim().strip_prefix("bench: ")))
}

fn pairs<'a>(lines: impl Iterator<Item = &'a str>) -> Counts {
    lines.filter_map(|line| line.rsplit_once(' ')).filter_map(|(n, v)| Some((n.to_owned(), v.parse().ok()?))).collect()
}

fn compare(counts: &Counts, committed: &Counts) -> Outcome {
    let mut complaints = Vec::new();
    for (name, &old) in committed {
        let Some(&new) = counts.get(name) else {
            complaints.push(format!("{name}: no longer reported"));
            continue;
        };
        let change = new as f64 / old.max(1) as f64 - 1.0;
        if change.abs() > TOLERANCE {
            complaints.push(format!("{name}: {new} instead of {old} ({:+.1} %)", 100.0 * change));
        }
    }
    if complaints.is_empty() { Ok(()) } else { Err(complaints.join("\n")) }
}

fn table(counts: &Counts) {
    for (name, value) in counts {
        println!("{name:40} {value:>12}");
    }
    let get = |name: String| counts.get(&name).copied().unwrap_or(0) as f64;
    let stage = |stages: f64| get(format!("decimate-per-4096-samples@{stages}")) / 4096.0;
    let beside = get("window-and-power-2048@0".to_owned()) / 2048.0;
    println!(
        "\nmesh bands against one full-band FFT at the law's rate over the same 16 turns, gap-free; M instructions \
         per second\n\
         reference: CMSIS-DSP's transform (N log2 N beyond 4096 points), window and power average ({beside:.1} per \
         sample)"
    );
    println!(
        "{:>5} {:>9} {:>9} {:>7} | {:>9} {:>9} | {:>12} {:>16}",
        "Hz", "law rate", "its filter", "FFT", "filter", "chain", "FFT/chain", "both with filter"
    );
    for speed in [1, 2, 5, 10, 15, 20, 25] {
        let rate = get(format!("law-rate-hz@{speed}"));
        let adc = get(format!("adc-rate-hz@{speed}"));
        // Not rounded to a power of two: in the reference's favour.
        let log_points = (16.0 * rate / f64::from(speed)).log2();
        let fft = (CMSIS_4096 / 4096.0 * log_points / 12.0 + beside) * rate;
        let stages = get(format!("law-stages@{speed}"));
        let filter_to_law = if stages == 0.0 { 0.0 } else { stage(if stages == 4.0 { 5.0 } else { stages }) * adc };
        let filter = get(format!("mesh-decimation-per-s@{speed}"));
        let chain = get(format!("mesh-order-domain-per-s@{speed}"));
        println!(
            "{speed:5} {:9.0} {:9.2} {:8.2} | {:9.2} {:9.2} | {:12.2} {:16.2}",
            rate,
            filter_to_law / 1e6,
            fft / 1e6,
            filter / 1e6,
            chain / 1e6,
            fft / chain,
            (fft + filter_to_law) / (chain + filter)
        );
    }
    for name in ["chain-per-s@25", "chain-highest-rate-per-s@25"] {
        let spent = get(name.to_owned()) as u64;
        let verdict = if spent <= BUDGET { "within" } else { "BEYOND" };
        println!("{name}: {:.1} M, {verdict} the budget of {:.0} M", spent as f64 / 1e6, BUDGET as f64 / 1e6);
    }
}
