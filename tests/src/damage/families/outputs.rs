//! Standard output and error that are closed, full, or left by their reader: files are written all the same.

use crate::damage::attack::{Attack, Kind, Scene, Target, words};
use crate::damage::process::{Invocation, Sink};
use rand::RngExt;

/// Commands that print, with what they write beside that.
const COMMANDS: &[(&str, &[(&str, Kind)])] = &[
    ("effects --json out/e.json", &[("out/e.json", Kind::Json)]),
    (
        "alias --mesh 100 --rate 1000 --harmonics 9000 --json out/a.json --report out/a.html",
        &[("out/a.json", Kind::Json), ("out/a.html", Kind::Page)],
    ),
    ("alias --mesh 100 --rate 1000", &[]),
    ("stiffness in/machine.toml --json out/s.json", &[("out/s.json", Kind::Json)]),
    (
        "predict in/record -o out/p --json out/p.json --report out/p.html",
        &[("out/p", Kind::Predictions), ("out/p.json", Kind::Json), ("out/p.html", Kind::Page)],
    ),
    (
        "simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 -o out/r --json out/s.json",
        &[("out/r", Kind::Record), ("out/s.json", Kind::Json)],
    ),
    (
        "import in/tone.csv --rate 5120 --no-tach -o out/r --json out/i.json",
        &[("out/r", Kind::Record), ("out/i.json", Kind::Json)],
    ),
    ("measured in/cases --data in --json out/m.json", &[("out/m.json", Kind::Json)]),
    ("--help", &[]),
    ("simulate --help", &[]),
    ("--version", &[]),
    ("simulate in/absent.toml -o out/r", &[]),
    ("stiffness", &[]),
];

/// A command with one of its outputs disturbed.
pub fn sinks(scene: &mut Scene) -> Option<Attack> {
    for name in ["machine.toml", "record", "tone.csv"] {
        scene.copy(name, &format!("in/{name}"));
    }
    let (line, targets) = COMMANDS[scene.index % COMMANDS.len()];
    let mut invocation = Invocation::new(words(line));
    let sink = match scene.random.random_range(0..4) {
        0 => Sink::Full,
        1 => Sink::Closed,
        2 => Sink::Pipe(0),
        _ => Sink::Pipe(scene.random.random_range(1..2000)),
    };
    match scene.random.random_range(0..6) {
        0 => invocation.stderr = sink,
        1 => (invocation.stdout, invocation.stderr) = (sink, sink),
        _ => invocation.stdout = sink,
    }
    let mut attack = Attack::new("outputs disturbed", invocation);
    attack.targets.extend(targets.iter().map(|(path, kind)| Target::new(*path, *kind)));
    attack.must_write = true;
    Some(attack)
}
