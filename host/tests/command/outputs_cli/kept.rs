//! What is read and what is somebody's stays as it is.

use super::{
    accepted, command, content, edit, fresh, is_refusal, machine, names, record_at, refused, simulation, text,
};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

#[test]
fn fault_predict_into_its_own_record_is_refused_and_keeps_the_signals() {
    let folder = fresh("predict-own");
    let record = folder.join("r");
    record_at(&record);
    let before = content(&record);
    refused(&["predict", &text(&record), "-o", &text(&record)], "r: ");
    refused(&["predict", &text(&record), "-o", &text(&record), "--force"], "r: ");
    let link = folder.join("link");
    std::os::unix::fs::symlink(&record, &link).expect("a link");
    refused(&["predict", &text(&record), "-o", &text(&link), "--force"], "r: ");
    let other = folder.join("other");
    record_at(&other);
    refused(&["predict", &text(&record), "-o", &text(&other), "--force"], "is a record");
    assert_eq!(content(&record), before);
    assert_eq!(content(&other), before);
}

#[test]
fn fault_names_that_lead_out_of_a_record_are_refused_and_the_files_there_kept() {
    let folder = fresh("confined");
    let victim = folder.join("victim.npy");
    for (case, name) in [("up", "../victim.npy".to_string()), ("absolute", text(&victim)), ("link", "out.npy".into())] {
        let record = folder.join(case);
        record_at(&record);
        let signal = std::fs::read(record.join("run00.npy")).expect("a signal");
        std::fs::write(&victim, &signal).expect("written");
        if case == "link" {
            std::os::unix::fs::symlink(&victim, record.join("out.npy")).expect("a link");
        }
        edit(&record.join("record.toml"), "signal = \"run00.npy\"", &format!("signal = \"{name}\""));
        refused(&["predict", &text(&record), "-o", &text(&folder.join("p"))], "out");
        assert_eq!(std::fs::read(&victim).expect("still there"), signal, "{case}");
    }
    for (case, from, to) in [
        ("tach", "tach = \"run00.tach.csv\"", "tach = \"../r.csv\""),
        ("table", "pair_stiffness = \"check-19-48.csv\"", "pair_stiffness = \"/k.csv\""),
    ] {
        let record = folder.join(case);
        record_at(&record);
        edit(&record.join("record.toml"), from, to);
        refused(&["predict", &text(&record), "-o", &text(&folder.join("p"))], "not a file of the record's own folder");
    }
    let simulate = ["simulate", &text(&folder.join("table")), "--speed", "20", "-o", &text(&folder.join("s"))];
    refused(&simulate, "not a file of the record's own folder");
}

#[test]
fn fault_a_pipe_in_the_place_of_a_file_is_refused_at_once() {
    let record = fresh("fifo").join("r");
    record_at(&record);
    for name in ["run00.npy", "run00.tach.csv", "record.toml"] {
        std::fs::remove_file(record.join(name)).expect("removed");
        assert!(Command::new("mkfifo").arg(record.join(name)).status().expect("mkfifo").success());
        let mut child = command(&["predict", &text(&record), "-o", &text(&record.with_file_name("p"))])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("starts");
        let start = Instant::now();
        while child.try_wait().expect("a child").is_none() && start.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = child.kill();
        is_refusal(&child.wait_with_output().expect("ended"), "regular file");
    }
}

#[test]
fn fault_simulate_and_import_replace_nothing_unasked() {
    let folder = fresh("unasked");
    let (record, machine) = (text(&folder.join("r")), machine("check-19-48.toml"));
    record_at(Path::new(&record));
    let before = content(Path::new(&record));
    refused(&simulation(&machine, &record, "2"), "--force");
    let source = folder.join("s.csv");
    std::fs::write(&source, "1\n2\n-1\n".repeat(500)).expect("written");
    let import = ["import", &text(&source), "--rate", "1000", "--no-tach", "-o", &record];
    refused(&import, "--force");
    assert_eq!(content(Path::new(&record)), before);
    let json = folder.join("a.json");
    std::fs::write(&json, "mine").expect("written");
    refused(&["alias", "--mesh", "10", "--rate", "100", "--json", &text(&json)], "--force");
    assert_eq!(std::fs::read_to_string(&json).expect("kept"), "mine");
    accepted(&[&simulation(&machine, &record, "2")[..], &["--force"]].concat());
    assert_ne!(content(Path::new(&record)), before);
    accepted(&[&import[..], &["--force"]].concat());
    assert_eq!(names(Path::new(&record)), ["record.toml", "run00.npy"], "nothing of the former record stays");
    assert_eq!(names(&folder), ["a.json", "r", "s.csv"]);
}

#[test]
fn fault_import_over_its_own_source_is_refused_even_with_force() {
    let folder = fresh("own-source");
    let record = folder.join("c");
    record_at(&record);
    let before = content(&record);
    let source = text(&record.join("run00.npy"));
    for force in [&[][..], &["--force"]] {
        let import = ["import", &source, "--rate", "51200", "--no-tach", "-o", &text(&record)];
        refused(&[&import[..], force].concat(), "c: ");
    }
    assert_eq!(content(&record), before);
}

#[test]
fn fault_a_folder_with_somebodys_file_in_it_is_refused_even_with_force() {
    let folder = fresh("foreign");
    let machine = machine("check-19-48.toml");
    let record = folder.join("r");
    record_at(&record);
    std::fs::write(record.join("notes.txt"), "mine").expect("written");
    let before = content(&record);
    let simulate = simulation(&machine, record.to_str().unwrap(), "2");
    refused(&[&simulate[..], &["--force"]].concat(), "notes.txt");
    assert_eq!(content(&record), before);
    // Measured codes without a declaration are no predictions.
    let (source, codes) = (folder.join("source"), folder.join("codes"));
    record_at(&source);
    std::fs::create_dir(&codes).expect("a folder");
    std::fs::copy(source.join("run00.npy"), codes.join("run00.npy")).expect("copied");
    let before = content(&codes);
    refused(&["predict", &text(&source), "-o", &text(&codes), "--force"], "run00.npy");
    assert_eq!(content(&codes), before);
}

#[test]
fn regress_predictions_replace_predictions_with_force_and_fill_an_empty_folder() {
    let folder = fresh("predictions");
    let (record, predicted) = (folder.join("r"), folder.join("p"));
    record_at(&record);
    std::fs::create_dir(&predicted).expect("a folder");
    accepted(&["predict", &text(&record), "-o", &text(&predicted)]);
    assert_eq!(names(&predicted), ["run00.npy", "run01.npy"]);
    refused(&["predict", &text(&record), "-o", &text(&predicted)], "--force");
    accepted(&["predict", &text(&record), "-o", &text(&predicted), "--force"]);
    assert_eq!(names(&folder), ["p", "r"]);
}

#[test]
fn fault_a_result_over_an_input_or_over_another_result_is_refused_even_with_force() {
    let folder = fresh("guard");
    let own = folder.join("m.toml");
    std::fs::copy(machine("check-19-48.toml"), &own).expect("copied");
    std::fs::copy(machine("check-19-48.csv"), folder.join("check-19-48.csv")).expect("copied");
    std::fs::hard_link(&own, folder.join("hard.toml")).expect("a hard link");
    std::os::unix::fs::symlink("m.toml", folder.join("soft.toml")).expect("a link");
    let before = content(&folder);
    let path = |name: &str| text(&folder.join(name));
    for target in ["m.toml", "hard.toml", "soft.toml", "check-19-48.csv", "../outputs-guard/m.toml"] {
        refused(&["stiffness", &path("m.toml"), "--json", &path(target), "--force"], "this command");
    }
    let alias = ["alias", "--mesh", "10", "--rate", "100", "--force"];
    let both = ["--json", &path("same"), "--report", &path("./same")];
    refused(&[&alias[..], &both].concat(), "each other's way");
    let simulate = ["simulate", &path("m.toml"), "--speed", "20", "--duration", "0.12", "-o", &path("r")];
    refused(&[&simulate[..], &["--json", &path("r/x.json")]].concat(), "");
    assert_eq!(content(&folder), before);
}

#[test]
fn fault_loop_apply_is_checked_before_the_work() {
    let folder = fresh("apply");
    let (record, other, own) = (folder.join("r"), folder.join("62-62.toml"), folder.join("own.toml"));
    record_at(&record);
    std::fs::copy(machine("62-62.toml"), &other).expect("copied");
    std::fs::copy(machine("check-19-48.toml"), &own).expect("copied");
    std::fs::copy(machine("check-19-48.csv"), folder.join("check-19-48.csv")).expect("copied");
    let effects = folder.join("own.effects.toml");
    std::fs::write(&effects, "mine").expect("written");
    let softer = folder.join("softer.toml");
    std::fs::copy(&own, &softer).expect("copied");
    edit(&softer, "youngs_modulus_pa = 206800000000.0", "youngs_modulus_pa = 196800000000.0");
    let before = names(&folder);
    let apply = |path: &Path, more: &[&str], expected: &str| {
        refused(&[&["loop", &text(&record), "--apply", &text(path)][..], more].concat(), expected);
    };
    apply(&folder.join("none.toml"), &[], "none.toml");
    apply(&other, &["--force"], "62 and 62 teeth");
    apply(&softer, &[], "other values");
    apply(&own, &[], "own.effects.toml");
    apply(&own, &["--force", "--json", &text(&folder.join("own.law.toml"))], "each other's way");
    assert_eq!(names(&folder), before);
    assert_eq!(std::fs::read_to_string(&effects).expect("kept"), "mine");
}
