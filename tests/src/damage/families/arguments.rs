//! Command lines: values that make no sense, options left out, repeated, unknown, in another order, bytes that are no
//! text.

use crate::damage::attack::{Attack, Kind, Scene, words};
use crate::damage::byte_damage::NASTY_TEXTS;
use crate::damage::process::Invocation;
use rand::RngExt;
use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt;

/// Sound command lines and what they write. Commands that take seconds are rare.
const SOUND_COMMANDS: &[(&str, &[(&str, Kind)])] = &[
    (
        "simulate in/machine.toml --speed 30 --torque 10 --effect tooth-crack:tooth=3 --rate 20480 --duration 0.05 \
         --pulses 2 \
         --jitter 1e-6 --noise 0.1 --seed 3 --model bending-torsional -o out/r",
        &[("out/r", Kind::Record)],
    ),
    (
        "simulate in/machine.toml --run-up 20,30,0.1 --torque 10 --rate 20480 --random-start -o out/r --json \
         out/s.json",
        &[("out/r", Kind::Record), ("out/s.json", Kind::Json)],
    ),
    (
        "predict in/record --model bending-torsional --machine in/machine.toml --effects in/effects.toml -o out/p",
        &[("out/p", Kind::Predictions)],
    ),
    ("stiffness in/machine.toml --points 21 --json out/s.json", &[("out/s.json", Kind::Json)]),
    (
        "alias --mesh 460 --rate 5120 --harmonics 60 --lines 100,200.5 --tolerance 0.15 --json out/a.json --report \
         out/a.html",
        &[("out/a.json", Kind::Json), ("out/a.html", Kind::Page)],
    ),
    ("effects --json out/e.json", &[("out/e.json", Kind::Json)]),
    (
        "import in/tone.csv --rate 5120 --teeth 23,46 --mesh 460 --unit V --volt-per-g 0.1 --channel-names a \
         --full-scale 1000 \
         --title x -o out/r",
        &[("out/r", Kind::Record)],
    ),
    ("monitor --replay in/capture.bin --frames 3 --once --patience 1 --json out/m.json", &[("out/m.json", Kind::Json)]),
    (
        "loop in/record --json out/l.json --report out/l.html --seed 1",
        &[("out/l.json", Kind::Json), ("out/l.html", Kind::Page)],
    ),
    (
        "configure in/capture.bin --machine in/machine.toml --law in/law.toml --pulses 2 --missing 1 --ratio 1.5 \
         --sensitivity 0.01 --analogue-stop 20000 --highest-adc 50000 --harmonics 3 --sidebands 2 --volatile",
        &[],
    ),
    ("configure tcp:127.0.0.1:1 --teeth 19 48", &[]),
    ("measured in/cases --data in --json out/m.json", &[("out/m.json", Kind::Json)]),
    (
        "node in/record --run 0 --channel 0 --start 0 --duration 0.05 --rate 20000 --runs 1 --firmware in/capture.bin",
        &[],
    ),
    ("law export in/machine.toml -o out/law.rs", &[("out/law.rs", Kind::Text)]),
];

/// One to three changes to a sound command line.
pub fn fuzzed(scene: &mut Scene) -> Option<Attack> {
    for name in ["machine.toml", "record", "effects.toml", "law.toml", "tone.csv"] {
        scene.copy(name, &format!("in/{name}"));
    }
    scene.write("in/capture.bin", b"no frame of a node");
    // The last takes two seconds where the damage leaves it sound.
    let last = if scene.chance(0.1) { SOUND_COMMANDS.len() } else { SOUND_COMMANDS.len() - 1 };
    let (line, targets) = SOUND_COMMANDS[scene.random.random_range(0..last)];
    let mut arguments = words(line);
    let count = *scene.pick(&[1, 1, 1, 2, 3]);
    let changes: Vec<String> = (0..count).map(|_| change(scene, &mut arguments)).collect();
    let mut attack = Attack::new(changes.join(", "), Invocation::new(arguments));
    for (path, kind) in targets {
        attack = attack.writing(*path, *kind);
    }
    Some(attack)
}

/// Words that stay: outputs, whose places the judge knows, and what would last by its nature.
fn is_fixed(arguments: &[OsString], at: usize) -> bool {
    let is_output = |word: &OsString| ["-o", "--json", "--report", "--patience"].iter().any(|option| word == option);
    is_output(&arguments[at]) || (at > 0 && is_output(&arguments[at - 1]))
}

fn change(scene: &mut Scene, arguments: &mut Vec<OsString>) -> String {
    let free: Vec<usize> = (0..arguments.len()).filter(|&at| !is_fixed(arguments, at)).collect();
    let Some(&at) = free.get(scene.random.random_range(0..free.len().max(1))) else {
        return "nothing to change".into();
    };
    match scene.random.random_range(0..12) {
        0..7 => {
            let is_option = |word: &OsString| word.to_string_lossy().starts_with("--");
            let is_value = |i: usize| i > 0 && is_option(&arguments[i - 1]) && !is_option(&arguments[i]);
            let values: Vec<usize> = free.iter().copied().filter(|&i| is_value(i)).collect();
            let at = values.get(scene.random.random_range(0..values.len().max(1))).copied().unwrap_or(at);
            let value = (*scene.pick(NASTY_TEXTS)).replace('\0', "");
            let what = format!("{:?} = {value:?}", arguments[at.saturating_sub(1)]);
            arguments[at] = value.into();
            what
        }
        7 => format!("without {:?}", arguments.remove(at)),
        8 => {
            arguments.insert(at, arguments[at].clone());
            format!("{:?} twice", arguments[at])
        }
        9 => {
            let option = *scene.pick(&[
                "--no-such-option",
                "-x",
                "--help=1",
                "--version=2",
                "--",
                "--json=",
                "-o",
                "@in/law.toml",
            ]);
            arguments.insert(at, option.into());
            format!("with {option}")
        }
        10 => {
            arguments[at] = OsString::from_vec(vec![b'a', 0xff, 0xfe, b'/', 0x80]);
            "bytes that are no text".into()
        }
        _ => {
            arguments[at] = "x".repeat(5000).into();
            "a word of 5000 letters".into()
        }
    }
}
