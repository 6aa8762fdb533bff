//! Whole commands on ordinary inputs: processor seconds, wall seconds, peak memory.

use crate::shell::{Outcome, capture, command, root, timed};
use std::fmt::Write;
use std::path::Path;

/// Name, arguments and the input whose bytes count, if any. A word that begins with `@` is a path of the folder.
const COMMANDS: [(&str, &str, Option<&str>); 7] = [
    (
        "simulate 8 x 2 s",
        "simulate MACHINE --speed 20,22,24,26,28,30,32,34 --torque 10 --duration 2 --rate 25600 --noise 0.1 --seed 1 -o @record",
        None,
    ),
    ("analyse 8 x 2 s", "analyse @record", None),
    ("check 8 x 2 s", "check @record", None),
    ("loop 8 x 2 s", "loop @record", None),
    ("import npy, 16 MB", "import @signal.npy --rate 50000 --no-tach -o @from-npy", Some("signal.npy")),
    ("import wav, 16 MB", "import @signal.wav --no-tach -o @from-wav", Some("signal.wav")),
    ("import csv, 15 MB", "import @signal.csv --rate 50000 --no-tach -o @from-csv", Some("signal.csv")),
];

/// Goals of the loop: processor seconds and MB.
const LOOP: (f64, f64) = (15.0, 300.0);

/// Runs them in the given folder.
pub fn table(python: &Path, program: &Path, folder: &Path) -> Outcome<String> {
    let script = root().join("tests/compare/cost.py");
    let (python, script) = (python.to_string_lossy(), script.to_string_lossy());
    capture(command(&[&python, &script, "--make"]).arg(folder))?;
    let mut text = String::from(
        "\n## Commands\n\nEach once, with `tests/compare/cost.py`; the record is that of the first line. Processor time counts all threads.\n\n\
         | command | processor, s | wall, s | peak, MB | input, MB/s |\n| --- | --- | --- | --- | --- |\n",
    );
    let mut verdict = String::new();
    for (name, words, input) in COMMANDS {
        let machine = root().join("machines/19-48.toml");
        let arguments = words.split(' ').map(|word| match word.strip_prefix('@') {
            Some(path) => folder.join(path).into_os_string(),
            None if word == "MACHINE" => machine.clone().into_os_string(),
            None => word.into(),
        });
        let said = timed(name, || capture(command(&[&python, &script]).arg(program).args(arguments)))?;
        let figures: Vec<f64> = said.split_whitespace().filter_map(|word| word.parse().ok()).collect();
        let [processor, wall, peak] = figures[..] else { return Err(format!("{name}: {said}")) };
        let bytes = input.and_then(|file| std::fs::metadata(folder.join(file)).ok()).map(|file| file.len() as f64);
        let pace = bytes.map_or(String::new(), |bytes| format!("{:.0}", 1e-6 * bytes / processor));
        let _ = writeln!(text, "| {name} | {processor:.2} | {wall:.2} | {peak:.0} | {pace} |");
        if name.starts_with("loop") {
            let met = if processor <= LOOP.0 && peak <= LOOP.1 { "met" } else { "NOT met" };
            verdict =
                format!("\nGoal of the loop, one record: at most {} s of one core and {} MB: {met}.\n", LOOP.0, LOOP.1);
        }
    }
    Ok(text + &verdict)
}
