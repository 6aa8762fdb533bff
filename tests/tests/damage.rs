//! A bounded part of the damage campaign (`cargo xtask damage` makes the whole): no attack may succeed. And the judge
//! itself: every kind of failure, shown by a script in the command's place, is seen, and sound endings are not.
#![cfg(unix)]

use meshband_tests::damage::attack::{Attack, Kind, Target, copy_tree, words};
use meshband_tests::damage::oracle::{Failure, judge};
use meshband_tests::damage::process::{self, Ended, Invocation, Sink, When};
use meshband_tests::damage::snapshot::Snapshot;
use meshband_tests::damage::{Campaign, FAMILIES, report, run};
use rustix::process::Signal;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime};

/// The command as it is now. `cargo test` builds it with the workspace; where only this test is built, it may be
/// missing or older than its sources and is made here.
fn program() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), |folder| root.join(folder));
    let program = std::path::absolute(target.join("release/meshband")).expect("a path");
    let built = program.metadata().and_then(|about| about.modified()).ok();
    let newest = ["host", "shared/src"].iter().filter_map(|folder| newest(&root.join(folder))).max();
    if built.is_none_or(|built| newest.is_some_and(|newest| newest > built)) {
        let status = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--release", "--package", "meshband-host", "--bin", "meshband"])
            .current_dir(&root)
            .status();
        assert!(status.is_ok_and(|status| status.success()), "the command is built");
    }
    program
}

/// When anything below a folder was last changed.
fn newest(folder: &Path) -> Option<SystemTime> {
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    entries
        .filter_map(|entry| {
            let path = entry.path();
            if path.is_dir() { newest(&path) } else { entry.metadata().ok()?.modified().ok() }
        })
        .max()
}

fn campaign(program: PathBuf, seed: u64, cases: usize) -> Campaign {
    let workers = std::thread::available_parallelism().map_or(2, usize::from);
    Campaign { program, seed, cases, only: None, keep: None, workers }
}

#[test]
fn fault_no_attack_panics_hangs_loses_a_file_or_leaves_a_mixture() {
    let campaign = campaign(program(), 1, 300);
    let outcome = run(&campaign, |_, _| {}).expect("sound inputs are accepted");
    let families: Vec<&str> = FAMILIES.iter().map(|family| family.name).collect();
    assert!(families.iter().all(|name| *name == "small-disk" || outcome.made.iter().any(|m| m.family == *name)));
    assert!(outcome.made.len() + outcome.impossible >= 300, "{} attacks", outcome.made.len());
    if outcome.impossible > 0 {
        println!("skipped: {} attacks need a small file system, which cannot be mounted here", outcome.impossible);
    }
    let failed: Vec<String> = report::failed(&outcome)
        .iter()
        .map(|made| {
            format!("{}\n  {}: {:?}", report::again(campaign.seed, made), made.lines.join(" & "), made.findings)
        })
        .collect();
    assert!(failed.is_empty(), "{} attacks succeed:\n{}", failed.len(), failed.join("\n"));
}

/// What the judge finds after `script` has run as the command, with a file and a record as inputs.
fn found(script: &str, prepare: impl FnOnce(&mut Attack)) -> Vec<Failure> {
    let place = tempfile::tempdir().expect("a temporary folder");
    let (folder, said) = (place.path().join("work"), place.path().join("said"));
    for inner in [folder.join("in"), folder.join("out"), said.clone()] {
        std::fs::create_dir_all(inner).expect("writable");
    }
    std::fs::write(folder.join("in/a"), "a user's\n").expect("writable");
    std::fs::write(folder.join("out/old"), "{}\n").expect("writable");
    copy_tree(&Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48"), &folder.join("in/record"));
    let program = place.path().join("program");
    std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).expect("writable");
    std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).expect("our own file");
    let mut attack = Attack::new("a script", Invocation::new(words("import in/a")));
    prepare(&mut attack);
    let before = Snapshot::of(&folder);
    let ended = process::run(&program, &folder, &said, &attack.commands);
    let mut kinds: Vec<Failure> = judge(&attack, &ended, &folder, &before).into_iter().map(|(kind, _)| kind).collect();
    kinds.dedup();
    kinds
}

const REFUSAL: &str = "echo 'meshband: in/a: is no signal' >&2; exit 2";

#[test]
fn theory_the_judge_sees_every_kind_of_failure() {
    type Prepare = fn(&mut Attack);
    let nothing: Prepare = |_| {};
    let writes_record: Prepare = |a| a.targets.push(Target::new("out/r", Kind::Record));
    let writes_json: Prepare = |a| a.targets.push(Target::new("out/j", Kind::Json));
    let cases: &[(&str, Prepare, Failure)] = &[
        ("exit 101", nothing, Failure::Panic),
        ("kill -SEGV $$", nothing, Failure::Abort),
        ("exit 3", nothing, Failure::Code),
        ("kill -TERM $$", nothing, Failure::Abort),
        ("rm in/a", nothing, Failure::Lost),
        ("echo b > in/a", nothing, Failure::Lost),
        ("echo '{}' > out/j; echo '{ }' > out/old", writes_json, Failure::Lost),
        ("echo x > elsewhere", nothing, Failure::Stray),
        ("echo x > out/.j.tmp; echo '{}' > out/j", writes_json, Failure::Stray),
        ("exit 0", writes_record, Failure::Missing),
        ("mkdir out/r; cp in/record/record.toml out/r", writes_record, Failure::Mixture),
        ("echo '{' > out/j", writes_json, Failure::Mixture),
        ("cp -R in/record out/.r.tmp; cp -R in/record out/r", writes_record, Failure::Temporary),
        ("echo 'ratio NaN'", nothing, Failure::NotFinite),
        ("exit 2", nothing, Failure::Message),
        ("echo 'error: no' >&2; exit 2", nothing, Failure::Message),
        ("echo 'meshband: a' >&2; echo 'b' >&2; exit 2", nothing, Failure::Message),
        ("printf 'meshband: \\033[31m\\n' >&2; exit 2", nothing, Failure::Message),
        ("printf 'meshband: %0500d\\n' 1 >&2; exit 2", nothing, Failure::Message),
        ("echo '{}' > out/j; echo 'meshband: no' >&2; exit 2", writes_json, Failure::Stray),
    ];
    for (script, prepare, failure) in cases {
        let found = found(script, prepare);
        assert!(found.contains(failure), "{script}: {failure:?} not in {found:?}");
    }
    let hung = Ended { hung: true, signal: Some(9), ..Ended::default() };
    let attack = Attack::new("a command that hangs", Invocation::new(words("loop in/record")));
    let nowhere = Path::new("no such folder");
    assert_eq!(judge(&attack, &[hung], nowhere, &Snapshot::of(nowhere))[0].0, Failure::Hang);
    // Of two commands, a complete record that neither of them wrote.
    let foreign = found("cp -R in/record out/r", |a| {
        a.targets.push(Target { path: "out/r".into(), kind: Kind::Record, whole: vec![1] });
    });
    assert_eq!(foreign, [Failure::Mixture]);
}

#[test]
fn theory_the_judge_accepts_sound_endings() {
    let none: [Failure; 0] = [];
    assert_eq!(found(REFUSAL, |_| {}), none);
    assert_eq!(found(&format!("echo 'warning: worn' >&2; echo '   0.0 s  reading' >&2; {REFUSAL}"), |_| {}), none);
    assert_eq!(found("echo 'Nano information'", |_| {}), none);
    let record = |a: &mut Attack| a.targets.push(Target::new("out/r", Kind::Record));
    assert_eq!(found("cp -R in/record out/r", record), none);
    assert_eq!(found(REFUSAL, record), none);
    let replaces = |a: &mut Attack| {
        a.targets.push(Target::new("out/old", Kind::Json));
        a.forced = true;
    };
    assert_eq!(found("echo '[1]' > out/old", replaces), none);
    let interrupted =
        |signal| move |a: &mut Attack| a.commands[0].signal = Some((signal, When::After(Duration::from_millis(100))));
    assert_eq!(found("exec sleep 10", interrupted(Signal::INT)), none);
    assert_eq!(
        found("mkdir out/.r.tmp; exec sleep 10", |a| {
            interrupted(Signal::KILL)(a);
            record(a);
        }),
        none
    );
    let closed = |a: &mut Attack| a.commands[0].stdout = Sink::Pipe(0);
    assert_eq!(found("sleep 0.1; echo x; echo y", closed), none);
}
