//! Whole commands on ordinary inputs: processor seconds, wall seconds, peak memory.

use crate::shell::{Outcome, capture, command, root, timed};
use std::ffi::OsString;
use std::fmt::Write;
use std::path::Path;

/// Name, arguments and the input whose bytes count, if any. A word that begins with `@` is a path of the folder.
const COMMANDS: [(&str, &str, Option<&str>); 6] = [
    (
        "simulate 8 x 2 s",
        "simulate MACHINE --speed 20,22,24,26,28,30,32,34 --torque 10 --duration 2 --rate 25600 --noise 0.1 --seed 1 \
         -o @record",
        None,
    ),
    ("analyse 8 x 2 s", "analyse @record", None),
    ("check 8 x 2 s", "check @record", None),
    ("import npy, 16 MB", "import @signal.npy --rate 50000 --no-tach -o @from-npy", Some("signal.npy")),
    ("import wav, 16 MB", "import @signal.wav --no-tach -o @from-wav", Some("signal.wav")),
    ("import csv, 15 MB", "import @signal.csv --rate 50000 --no-tach -o @from-csv", Some("signal.csv")),
];

/// Files of a measurement on eight channels.
const CHANNELS: &str =
    "@channel0.mat @channel1.mat @channel2.mat @channel3.mat @channel4.mat @channel5.mat @channel6.mat @channel7.mat";
/// How often each of import and disk is timed, in turns.
const TURNS: usize = 5;

/// Goals of the loop's medians: processor seconds and MB.
const LOOP: (f64, f64) = (15.0, 300.0);
/// Machine and layout of the loop's records, the same as the first command's, with runs started anywhere.
const LOOP_RECORD: &str =
    "--speed 20,22,24,26,28,30,32,34 --torque 10 --duration 2 --rate 25600 --noise 0.1 --random-start";
/// What is hidden in the loop's records: nothing, one effect of each place, two strong ones at once.
const HIDDEN_EFFECTS: [(&str, &str); 10] = [
    ("nothing", ""),
    ("runout of the gear", "gear-eccentricity:amplitude=3e-5"),
    ("cracked tooth", "pinion-tooth-crack:loss=0.1,tooth=5"),
    ("friction", "friction:coefficient=0.06"),
    ("ghost order", "gear-ghost-order:amplitude=5e-7,order=31"),
    ("bearing stiffness", "pinion-bearing-stiffness-modulation:share=0.05,order=3.05"),
    ("path resonance", "transfer-path-resonance:gain=0.3,frequency=4100,damping=0.02"),
    ("torque ripple", "torque-ripple:depth=0.1,order=2"),
    (
        "runout and path",
        "gear-eccentricity:amplitude=3e-5 transfer-path-resonance:gain=0.3,frequency=4100,damping=0.02",
    ),
    ("crack and runout", "pinion-tooth-crack:loss=0.1,tooth=5 pinion-eccentricity:amplitude=2e-5"),
];

/// Python, the script that measures, and the program measured.
struct Bench<'a> {
    python: &'a str,
    script: &'a str,
    program: &'a Path,
}

impl Bench<'_> {
    /// Processor seconds, wall seconds and peak memory (MB) of one command.
    fn cost(&self, name: &str, arguments: impl Iterator<Item = OsString>) -> Outcome<[f64; 3]> {
        let mut measured = command(&[self.python, self.script]);
        let said = timed(name, || capture(measured.arg(self.program).args(arguments)))?;
        let figures: Vec<f64> = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        figures.try_into().map_err(|_| format!("{name}: {said}"))
    }
}

/// Words as arguments: `@name` is a path of the folder, `MACHINE` the machine's file.
fn arguments<'a>(words: &'a str, folder: &'a Path) -> impl Iterator<Item = OsString> + 'a {
    words.split_whitespace().map(move |word| match word.strip_prefix('@') {
        Some(path) => folder.join(path).into_os_string(),
        None if word == "MACHINE" => root().join("machines/19-48.toml").into_os_string(),
        None => word.into(),
    })
}

/// Runs them in the given folder.
pub fn table(python: &Path, program: &Path, folder: &Path) -> Outcome<String> {
    let script = root().join("tests/compare/cost.py");
    let (python, script) = (python.to_string_lossy(), script.to_string_lossy());
    capture(command(&[&python, &script, "--make"]).arg(folder))?;
    let bench = Bench { python: &python, script: &script, program };
    let mut text = String::from(
        "\n## Commands\n\nEach once, with `tests/compare/cost.py`; the record is that of the first line. Processor \
         time counts all threads.\n\n\
         | command | processor, s | wall, s | peak, MB | input, MB/s |\n| --- | --- | --- | --- | --- |\n",
    );
    for (name, words, input) in COMMANDS {
        let [processor, wall, peak] = bench.cost(name, arguments(words, folder))?;
        let bytes = input.and_then(|file| std::fs::metadata(folder.join(file)).ok()).map(|file| file.len() as f64);
        let pace = bytes.map_or(String::new(), |bytes| format!("{:.0}", 1e-6 * bytes / processor));
        let _ = writeln!(text, "| {name} | {processor:.2} | {wall:.2} | {peak:.0} | {pace} |");
    }
    Ok(text + &beside_disk(&bench, folder)? + &loops(&bench, folder)?)
}

/// Import of eight channels beside what the disk alone takes for the same bytes, in turns; medians.
fn beside_disk(bench: &Bench<'_>, folder: &Path) -> Outcome<String> {
    let (mut imports, mut disks) = (Vec::new(), Vec::new());
    for turn in 0..TURNS {
        let words = format!("import {CHANNELS} --rate 25600 --no-tach -o @from-mat-{turn}");
        imports.push(bench.cost("import of eight channels", arguments(&words, folder))?[1]);
        let mut words = command(&[bench.python, bench.script, "--disk"]);
        words.arg(folder.join(format!("from-mat-{turn}"))).args(arguments(CHANNELS, folder));
        let said = timed("the disk alone", || capture(&mut words))?;
        let wall = said.split_whitespace().nth(1).and_then(|word| word.parse().ok());
        disks.push(wall.ok_or_else(|| format!("cost.py: {said}"))?);
    }
    let [import, disk] = [imports, disks].map(|mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[TURNS / 2]
    });
    let bytes: u64 = arguments(CHANNELS, folder).filter_map(|path| Some(std::fs::metadata(path).ok()?.len())).sum();
    Ok(format!(
        "\nImport of eight MAT-files, {:.0} MB, wall time, median of {TURNS} in turns: {:.0} ms ({:.0} MB/s). The \
         disk alone, the same bytes read past \
         the page cache and the record's written as safely (files, folder and the folder above synced): {:.0} ms. \
         Import over disk: {:.1}.\n",
        1e-6 * bytes as f64,
        1e3 * import,
        1e-6 * bytes as f64 / import,
        1e3 * disk,
        import / disk,
    ))
}

/// The loop on records of 8 runs of 2 s, one for each row.
fn loops(bench: &Bench<'_>, folder: &Path) -> Outcome<String> {
    let mut text = format!(
        "\n## Loop\n\n`meshband loop` on `meshband simulate machines/19-48.toml {LOOP_RECORD}` with seeds 1 to {} \
         and `--effect` as below, each once.\n\n\
         | hidden | processor, s | wall, s | peak, MB |\n| --- | --- | --- | --- |\n",
        HIDDEN_EFFECTS.len()
    );
    let mut costs = Vec::new();
    for (seed, (name, effects)) in (1..).zip(HIDDEN_EFFECTS) {
        let effects: String = effects.split_whitespace().map(|effect| format!(" --effect {effect}")).collect();
        let words = format!("simulate MACHINE {LOOP_RECORD} --seed {seed}{effects} --force -o @loop");
        bench.cost(&format!("record with {name}"), arguments(&words, folder))?;
        let cost = bench.cost(&format!("loop, {name}"), arguments("loop @loop", folder))?;
        let _ = writeln!(text, "| {name}:{effects} | {:.2} | {:.2} | {:.0} |", cost[0], cost[1], cost[2]);
        costs.push(cost);
    }
    let median = |which: usize| {
        let mut all: Vec<f64> = costs.iter().map(|cost| cost[which]).collect();
        all.sort_by(f64::total_cmp);
        0.5 * (all[(all.len() - 1) / 2] + all[all.len() / 2])
    };
    let [processor, wall, peak] = [0, 1, 2].map(median);
    let met = if processor <= LOOP.0 && peak <= LOOP.1 { "met" } else { "NOT met" };
    let _ = writeln!(text, "| median | {processor:.2} | {wall:.2} | {peak:.0} |");
    let _ = writeln!(text, "\nGoal of the medians: at most {} s of one core and {} MB: {met}.", LOOP.0, LOOP.1);
    Ok(text)
}
