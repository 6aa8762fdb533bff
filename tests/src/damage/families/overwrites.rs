//! Outputs over inputs, over each other, and over what exists: an input is never replaced, anything else only by
//! `--force`.

use crate::damage::attack::{Attack, Kind, Scene, Target, words};
use crate::damage::process::Invocation;
use std::os::unix::fs::{MetadataExt, symlink};
use std::path::{Path, PathBuf};

/// Commands with one output to aim, `@` in its place, and what it would hold.
const COMMANDS: &[(&str, Kind)] = &[
    ("simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 -o @", Kind::Record),
    ("simulate in/record --speed 30 --torque 10 --duration 0.05 --rate 20480 -o @", Kind::Record),
    (
        "simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 --effects in/effects.toml -o \
         out/n --json @",
        Kind::Json,
    ),
    ("simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 -o out/n --report @", Kind::Page),
    ("predict in/record -o @", Kind::Predictions),
    ("predict in/record --machine in/machine.toml --effects in/effects.toml -o out/n --json @", Kind::Json),
    ("predict in/record -o out/n --report @", Kind::Page),
    ("import in/record/run00.npy --rate 25600 --no-tach -o @", Kind::Record),
    ("import in/tone.csv --rate 5120 --no-tach -o @", Kind::Record),
    ("import in/tone.csv --rate 5120 --no-tach -o out/n --json @", Kind::Json),
    ("import in/tone.csv in/tone.npy --runs --rate 5120 --no-tach -o out/n --report @", Kind::Page),
    ("stiffness in/machine.toml --json @", Kind::Json),
    ("stiffness in/record --report @", Kind::Page),
    ("stiffness in/table-machine.toml --json @", Kind::Json),
    ("alias --mesh 100 --rate 1000 --json @", Kind::Json),
    ("effects --machine in/machine.toml --json @", Kind::Json),
    ("loop in/record --json @", Kind::Json),
    ("loop in/record --report @", Kind::Page),
    ("measured in/cases --data in --json @", Kind::Json),
    ("law export in/machine.toml -o @", Kind::Text),
];

/// Places that exist; the first ones are inputs of most commands, the rest a user's other files.
const PLACES: &[&str] = &[
    "in/record",
    "in/record/",
    "in/./record",
    "in/record/../record",
    "in/link-to-record",
    "in/record/record.toml",
    "in/record/run00.npy",
    "in/record/run01.tach.csv",
    "in/machine.toml",
    "in/table-machine.toml",
    "in/stiffness.csv",
    "in/effects.toml",
    "in/tone.csv",
    "in/tone.npy",
    "in",
    ".",
    "in/link-to-machine",
    "in/hard-link-to-machine",
    "out",
    "out/other-record",
    "out/notes.txt",
    "out/notes",
    "out/other-record/run00.npy",
    "out/report.html",
    "out/result.json",
    "out/notes.txt/below",
    "",
];

/// An output aimed at what exists, or two outputs at one place.
pub fn over(scene: &mut Scene) -> Option<Attack> {
    for name in
        ["machine.toml", "record", "table-machine.toml", "stiffness.csv", "effects.toml", "tone.csv", "tone.npy"]
    {
        scene.copy(name, &format!("in/{name}"));
    }
    scene.copy("third-record", "out/other-record");
    for (path, text) in
        [("notes.txt", "notes\n"), ("report.html", "<html></html>\n"), ("result.json", "{}\n"), ("notes/a.txt", "a\n")]
    {
        scene.write(&format!("out/{path}"), text);
    }
    let links = [("record", "link-to-record"), ("machine.toml", "link-to-machine")];
    for (from, to) in links {
        symlink(from, scene.folder.join("in").join(to)).expect("the campaign's folder is writable");
    }
    let hard = scene.folder.join("in/hard-link-to-machine");
    std::fs::hard_link(scene.folder.join("in/machine.toml"), hard).expect("the campaign's folder is writable");
    let forced = scene.chance(0.5);
    if scene.chance(0.15) {
        return Some(each_other(scene, forced));
    }
    // Commands over inputs by turns, so that every command meets many places.
    let commands = if scene.chance(0.1) { COMMANDS.len() } else { COMMANDS.len() - 1 };
    let (line, kind) = COMMANDS[scene.index % commands];
    let place = *scene.pick(PLACES);
    let mut arguments = words(line);
    for word in arguments.iter_mut().filter(|word| *word == "@") {
        *word = place.into();
    }
    if forced {
        arguments.push("--force".into());
    }
    let mut attack = Attack::new(format!("over {place:?}, force {forced}"), Invocation::new(arguments));
    attack.forced = forced;
    if forced && may_replace(scene, line, place, kind) {
        attack.targets.push(Target::new(place, kind));
        if let Some(real) = real_path(scene, place).filter(|real| real != Path::new(place)) {
            attack.targets.push(Target::new(real, kind));
        }
    }
    if line.contains("out/n ") {
        let kind = if line.starts_with("predict") { Kind::Predictions } else { Kind::Record };
        attack.targets.push(Target::new("out/n", kind));
    }
    Some(attack)
}

/// What a place is in the scene once links are followed; `None` where there is nothing.
fn real_path(scene: &Scene, place: &str) -> Option<PathBuf> {
    let root = scene.folder.canonicalize().ok()?;
    Some(scene.folder.join(place).canonicalize().ok()?.strip_prefix(root).ok()?.to_owned())
}

/// Whether `--force` may replace a place: a file by a file, a record by a record, and nothing that the command reads.
fn may_replace(scene: &Scene, line: &str, place: &str, kind: Kind) -> bool {
    let Some(real) = real_path(scene, place) else { return false };
    let identity = |path: &Path| std::fs::metadata(scene.folder.join(path)).ok().map(|about| about.ino());
    let table = if line.contains("table-machine") { "in/stiffness.csv" } else { "" };
    let mut inputs = line.split_whitespace().chain([table]).filter(|word| word.starts_with("in/"));
    let is_input = inputs.any(|input| {
        let input = Path::new(input);
        real.starts_with(input) || input.starts_with(&real) || identity(&real) == identity(input)
    });
    let fits = match kind {
        Kind::Record => scene.folder.join(&real).join("record.toml").is_file(),
        Kind::Predictions => false,
        _ => scene.folder.join(&real).is_file(),
    };
    !is_input && fits
}

/// Two outputs of one command at one place, or one inside the other.
fn each_other(scene: &mut Scene, forced: bool) -> Attack {
    let pairs = [
        "alias --mesh 100 --rate 1000 --json out/x --report out/x",
        "alias --mesh 100 --rate 1000 --json out/x --report out/../out/x",
        "stiffness in/machine.toml --json out/x --report out/./x",
        "simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 -o out/x --json out/x",
        "simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 -o out/x --json out/x/run00.npy",
        "simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 -o out/x --json \
         out/x/record.toml",
        "predict in/record -o out/x --json out/x --report out/x",
        "predict in/record -o out/x --report out/x/run00.npy",
        "import in/tone.csv --rate 5120 --no-tach -o out/x --json out/x --report out/x",
        "import in/tone.csv --rate 5120 --no-tach -o out/x --report out/x/record.toml",
    ];
    let line = *scene.pick(&pairs);
    let mut arguments = words(line);
    if forced {
        arguments.push("--force".into());
    }
    let mut attack = Attack::new(format!("two outputs at one place, force {forced}"), Invocation::new(arguments));
    attack.forced = forced;
    attack
}
