//! Commands that are disturbed while they write: signals, a file that may not grow, a disk that fills, a second writer.
//!
//! Afterwards the target is the old state or what one undisturbed command leaves, byte for byte. The old state is the
//! result of another command with another number of runs, so that a mixture shows.

use crate::damage::attack::{Attack, Kind, Scene, Target, copy_tree, words};
use crate::damage::process::{FILE_STEP, Invocation, When, has_small_disks};
use rand::RngExt;
use rustix::process::Signal;
use std::sync::OnceLock;
use std::time::Duration;

/// A job over the other's result (with `--force`), or where nothing is yet.
fn prepared(scene: &mut Scene) -> (Attack, Duration) {
    let pair = &scene.originals.jobs[scene.random.random_range(0..scene.originals.jobs.len())];
    let first = scene.random.random_range(0..2);
    let (job, other) = (&pair[first], &pair[1 - first]);
    inputs(scene);
    let replaces = scene.chance(0.6);
    if replaces {
        copy_tree(&scene.originals.path(&other.result), &scene.folder.join("out/r"));
    }
    let mut arguments = words(job.arguments);
    arguments.extend(words("-o out/r"));
    if replaces {
        arguments.push("--force".into());
    }
    let what = if replaces { "over another's result" } else { "into a new folder" };
    let mut attack = Attack::new(what, Invocation::new(arguments));
    attack.forced = replaces;
    attack.targets.push(Target { path: "out/r".into(), kind: job.kind, whole: vec![job.whole] });
    if scene.chance(0.3) {
        attack = attack.writing("out/j.json", Kind::Json).writing("out/p.html", Kind::Page);
        attack.commands[0].arguments.extend(words("--json out/j.json --report out/p.html"));
    }
    (attack, job.time)
}

fn inputs(scene: &Scene) {
    for name in [
        "machine.toml",
        "table-machine.toml",
        "stiffness.csv",
        "record",
        "third-record",
        "tone.csv",
        "tone.wav",
        "tone.npy",
        "two.npy",
    ] {
        scene.copy(name, &format!("in/{name}"));
    }
}

/// A signal at a random time of the run, or shortly after something changes beside the target.
pub fn signals(scene: &mut Scene) -> Option<Attack> {
    let (mut attack, time) = prepared(scene);
    let signal = *scene.pick(&[Signal::INT, Signal::TERM, Signal::KILL]);
    let when = if scene.chance(0.4) {
        When::After(time.mul_f64(1.3 * scene.random.random::<f64>()))
    } else {
        // Writing takes a few milliseconds: a random time would hardly ever meet it.
        When::Change(Duration::from_micros(scene.random.random_range(0..4000)))
    };
    attack.commands[0].signal = Some((signal, when));
    Some(attack)
}

/// Two commands that write one target at the same time.
pub fn writers(scene: &mut Scene) -> Option<Attack> {
    let pair = &scene.originals.jobs[scene.random.random_range(0..scene.originals.jobs.len())];
    inputs(scene);
    let replaces = scene.chance(0.6);
    if replaces {
        let old = scene.random.random_range(0..2);
        copy_tree(&scene.originals.path(&pair[old].result), &scene.folder.join("out/r"));
    }
    let order = if scene.chance(0.5) { [0, 1] } else { [1, 0] };
    let command = |i: usize| {
        let mut arguments = words(pair[i].arguments);
        arguments.extend(words("-o out/r"));
        if replaces {
            arguments.push("--force".into());
        }
        Invocation::new(arguments)
    };
    let mut commands: Vec<Invocation> = order.map(command).into();
    if scene.chance(0.3) {
        commands.push(command(order[0]));
    }
    let whole = pair.iter().map(|job| job.whole).collect();
    let target = Target { path: "out/r".into(), kind: pair[0].kind, whole };
    let targets = vec![target];
    Some(Attack { what: "several writers".into(), commands, targets, forced: replaces, must_write: false })
}

/// Files that may not grow beyond a random size.
pub fn file_limit(scene: &mut Scene) -> Option<Attack> {
    let (mut attack, _) = prepared(scene);
    // Tach files and the declaration are below two kilobytes, signals at eight and more, pages at hundreds.
    let largest = if scene.chance(0.7) { 40 } else { 1000 };
    attack.commands[0].file_limit = Some(FILE_STEP * scene.random.random_range(0..largest));
    Some(attack)
}

/// A file system with room for a part of the target.
pub fn small_disk(scene: &mut Scene) -> Option<Attack> {
    static DISK_SUPPORT: OnceLock<bool> = OnceLock::new();
    if !*DISK_SUPPORT.get_or_init(|| has_small_disks(&scene.folder.with_extension("probe"))) {
        return None;
    }
    let (mut attack, _) = prepared(scene);
    let used: u64 = if attack.forced { 100 } else { 0 };
    attack.commands[0].disk_kb = Some(used + scene.random.random_range(4..200));
    Some(attack)
}
