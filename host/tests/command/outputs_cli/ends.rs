//! However a command ends: the old state or the new one, results before text.

use super::{
    accepted, command, content, fresh, is_refusal, long_simulation, machine, names, program, record_at, refused,
    signal, simulation, stderr, text, wait_for,
};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::Instant;

#[test]
fn fault_a_full_disk_leaves_the_old_record() {
    let folder = fresh("full");
    let record = folder.join("r");
    record_at(&record);
    let before = content(&record);
    // Blocks of 512 bytes or of 1024: less than a signal of 0.12 s has, more than its edges and its declaration.
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"";
    let machine = machine("check-19-48.toml");
    let simulate = [&simulation(&machine, record.to_str().unwrap(), "2")[..], &["--force"]].concat();
    let output = Command::new("sh").args(["-c", script]).arg(program()).args(&simulate).output().expect("sh");
    is_refusal(&output, "too large");
    assert_eq!(content(&record), before);
    let json = folder.join("e.json");
    std::fs::write(&json, "old").expect("written");
    let effects = ["effects", "--json", &text(&json), "--force"];
    let output = Command::new("sh").args(["-c", script]).arg(program()).args(effects).output().expect("sh");
    is_refusal(&output, "e.json: File too large");
    assert_eq!(std::fs::read_to_string(&json).expect("kept"), "old");
    assert_eq!(names(&folder), ["e.json", "r"]);
}

#[test]
fn fault_options_refused_late_leave_the_old_record() {
    let folder = fresh("late");
    let (record, machine) = (folder.join("r"), machine("check-19-48.toml"));
    record_at(&record);
    let before = content(&record);
    let simulate = simulation(&machine, record.to_str().unwrap(), "2");
    refused(&[&simulate[..], &["--pulses", "10001", "--force"]].concat(), "10001");
    assert_eq!(content(&record), before);
    assert_eq!(names(&folder), ["r"]);
}

/// Runs `words` again and again, interrupted ever later; every state found is `old` or the one that an undisturbed
/// run leaves.
fn interrupted(words: &[&str], target: &Path, restore: impl Fn()) {
    restore();
    let old = content(target);
    let start = Instant::now();
    accepted(words);
    let whole = start.elapsed();
    let new = content(target);
    assert_ne!(old, new, "the two states can be told apart");
    let parent = target.parent().expect("a folder");
    let kept = names(parent);
    for step in 0..8 {
        restore();
        let child = command(words).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
        // Most of them near the end, where the writing is.
        std::thread::sleep(whole.mul_f64(1.1 * (f64::from(step) / 7.0).sqrt()));
        signal(&child, ["INT", "TERM"][step as usize % 2]);
        let output = child.wait_with_output().expect("ended");
        let code = output.status.code();
        // Without a code: before the program had begun.
        assert!(matches!(code, None | Some(0 | 130)), "{words:?}, step {step}: {code:?} {}", stderr(&output));
        assert_eq!(stderr(&output), "", "an interrupt is no error");
        let found = content(target);
        assert!(found == old || code.is_some(), "step {step}: {:?}", names(target));
        assert!(found == old || found == new, "{words:?}, step {step}: a mixture of {:?}", names(target));
        assert_eq!(names(parent), kept, "step {step} leaves nothing beside it");
    }
}

#[test]
fn fault_interrupts_leave_the_old_record_or_the_new_one() {
    let folder = fresh("interrupt-simulate");
    let (record, machine) = (folder.join("r"), machine("check-19-48.toml"));
    let words = [&simulation(&machine, record.to_str().unwrap(), "5")[..], &["--force"]].concat();
    let restore = || {
        let _ = std::fs::remove_dir_all(&record);
        record_at(&record);
    };
    interrupted(&words, &record, restore);
    // Nothing that could be taken for a record where none was.
    std::fs::remove_dir_all(&record).expect("removed");
    let mut child = command(&long_simulation(&machine, record.to_str().unwrap())).spawn().expect("starts");
    wait_for("the writer's lock", || !names(&folder).is_empty());
    signal(&child, "INT");
    assert_eq!(child.wait().expect("ended").code(), Some(130));
    assert!(names(&folder).is_empty(), "{:?}", names(&folder));
}

#[test]
fn fault_interrupts_leave_old_or_new_predictions_and_imports() {
    let folder = fresh("interrupt-others");
    let (record, predicted) = (folder.join("r"), folder.join("p"));
    record_at(&record);
    let words = ["predict", &text(&record), "-o", &text(&predicted), "--force"];
    accepted(&words[..4]);
    let old = content(&predicted).into_iter().next().expect("a prediction");
    let restore = || {
        std::fs::remove_dir_all(&predicted).expect("removed");
        std::fs::create_dir(&predicted).expect("a folder");
        std::fs::write(predicted.join("before.npy"), &old.1).expect("written");
    };
    interrupted(&words, &predicted, restore);
    let (source, imported) = (folder.join("s.csv"), folder.join("i"));
    std::fs::write(&source, "1.5\n2.5\n-1\n0.25\n".repeat(40_000)).expect("written");
    record_at(&imported);
    let words = ["import", &text(&source), "--rate", "9000", "--no-tach", "-o", &text(&imported), "--force"];
    let restore = || {
        std::fs::remove_dir_all(&imported).expect("removed");
        record_at(&imported);
    };
    interrupted(&words, &imported, restore);
}

#[test]
fn fault_a_second_writer_of_a_target_is_told_so_and_a_killed_one_blocks_nobody() {
    let folder = fresh("two");
    let (record, machine) = (folder.join("r"), machine("check-19-48.toml"));
    let target = text(&record);
    let mut first = command(&long_simulation(&machine, &target)).stderr(Stdio::null()).spawn().expect("starts");
    wait_for("the first writer's temporary", || names(&folder).iter().any(|name| name.ends_with("tmp")));
    refused(&simulation(&machine, &target, "1"), "another meshband");
    signal(&first, "KILL");
    let _ = first.wait();
    let left = names(&folder);
    assert!(!record.exists() && left.iter().all(|name| name.starts_with('.')), "{left:?}");
    let temporary = left.iter().find(|name| name.ends_with("tmp")).expect("its temporary");
    let left_over = folder.join(temporary);
    record_at(&left_over);
    refused(&["predict", &text(&left_over), "-o", &text(&folder.join("p"))], "interrupted");
    accepted(&simulation(&machine, &target, "1"));
    assert_eq!(names(&folder), ["r"], "the next writer tidies up");
}

#[test]
fn fault_many_writers_of_one_target_leave_one_whole_record() {
    let folder = fresh("many");
    let (record, machine) = (folder.join("r"), machine("check-19-48.toml"));
    let target = text(&record);
    let seeds = ["1", "2", "3", "4"];
    let each: Vec<_> = seeds
        .map(|seed| {
            let alone = folder.join(seed);
            accepted(&simulation(&machine, &text(&alone), seed));
            content(&alone)
        })
        .into();
    let start = |seed: &&str| {
        let words = [&simulation(&machine, &target, seed)[..], &["--force"]].concat();
        command(&words).stderr(Stdio::piped()).spawn().expect("starts")
    };
    let children: Vec<Child> = seeds.iter().map(start).collect();
    let outputs: Vec<Output> = children.into_iter().map(|c| c.wait_with_output().expect("ended")).collect();
    for output in outputs.iter().filter(|output| !output.status.success()) {
        is_refusal(output, "another meshband");
    }
    assert!(outputs.iter().any(|output| output.status.success()));
    let refused = outputs.iter().filter(|output| !output.status.success()).count();
    println!("{refused} of 4 were told to wait");
    assert!(each.contains(&content(&record)), "the record is one of the four");
    assert_eq!(names(&folder), ["1", "2", "3", "4", "r"]);
}

/// Every kind of command that shows text and is quick.
fn with_json(folder: &Path) -> Vec<Vec<String>> {
    let record = folder.join("r");
    record_at(&record);
    let words = |list: &[&str]| list.iter().map(|word| word.to_string()).collect::<Vec<_>>();
    vec![
        words(&["alias", "--mesh", "10", "--rate", "100"]),
        words(&["effects"]),
        words(&["stiffness", &machine("19-48.toml")]),
        words(&["predict", &text(&record), "-o", &text(&folder.join("p")), "--force"]),
    ]
}

#[test]
fn regress_results_are_whole_when_standard_output_is_closed_or_full() {
    let folder = fresh("stdout");
    let json = folder.join("o.json");
    for words in with_json(&folder) {
        for full in [false, true] {
            let _ = std::fs::remove_file(&json);
            let out: Stdio = if full {
                std::fs::OpenOptions::new().write(true).open("/dev/full").expect("the full device").into()
            } else {
                let (reader, writer) = std::io::pipe().expect("a pipe");
                drop(reader);
                writer.into()
            };
            let mut command = Command::new(program());
            let output = command.args(&words).arg("--json").arg(&json).stdout(out).output().expect("starts");
            let said = stderr(&output);
            if full {
                is_refusal(&output, "standard output");
            } else {
                assert_eq!((output.status.code(), said.as_str()), (Some(141), ""), "{words:?}");
            }
            let written = std::fs::read(&json).expect("written before anything was shown");
            serde_json::from_slice::<serde_json::Value>(&written).expect("JSON");
        }
    }
}

#[test]
fn regress_a_dash_sends_json_to_standard_output_and_text_to_standard_error() {
    let folder = fresh("dash");
    for words in with_json(&folder) {
        let output =
            Command::new(program()).args(&words).args(["--json", "-"]).current_dir(&folder).output().expect("starts");
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).expect("JSON and nothing else");
        assert!(!output.stderr.is_empty(), "the text is still there to read");
        assert!(!folder.join("-").exists());
    }
    let both = ["alias", "--mesh", "10", "--rate", "100", "--json", "-", "--report", "-"];
    refused(&both, "standard output");
}
