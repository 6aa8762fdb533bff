//! The proof campaign: same seed same records, and a stopped campaign goes on where it was.

use meshband_validate::campaign::{Plan, Scored, run, summarise};
use std::path::{Path, PathBuf};

fn machine(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors").join(name)
}

#[test]
fn theory_summary_counts_false_terms_and_right_families() {
    let scored = |id: &str, part: &str, reported: usize, result: &[&str], wrong_names: usize| Scored {
        id: id.into(),
        part: part.into(),
        machine: "m".into(),
        runs: 8,
        duration_s: 2.0,
        coloured: false,
        parameters_off: false,
        hidden: result.iter().map(|_| "pinion-eccentricity".to_string()).collect(),
        truth: String::new(),
        level: 2.0,
        reported: vec![["named".into(), "x".into(), "path".into()]; reported],
        result: result.iter().map(|r| r.to_string()).collect(),
        wrong_names,
        surplus: 0,
        covered: Some(true),
        estimate_over_truth: None,
        held_out: [[0.4, 0.1, 0.1], [0.4, 0.2, 0.1]],
        calibrated: Some([0.2, 0.3]),
        true_floor: None,
        bootstrap: None,
        seconds: 1.0,
    };
    let all = [
        scored("null-0", "null", 0, &[], 0),
        scored("null-1", "null", 1, &[], 1),
        scored("power-0", "power", 1, &["named"], 0),
        scored("power-1", "power", 1, &["generic"], 0),
        scored("power-2", "power", 1, &["other-family"], 1),
        scored("power-3", "power", 0, &["missed"], 0),
    ];
    let summary = summarise(&all);
    let null = summary.null.last().unwrap();
    assert_eq!((null.records, null.found), (2, 0.5));
    let power = summary.power.iter().find(|r| r.group.starts_with('2')).unwrap();
    assert_eq!((power.found, power.named, power.right_family, power.wrong), (0.75, 0.25, 0.5, 0.25));
    assert!((power.corrected_over_floor - 1.0).abs() < 1e-12);
}

#[test]
fn regress_a_campaign_resumes_from_its_log() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |null: usize, log: &str| Plan {
        machines: vec![machine("check-19-48")],
        null,
        bootstrap: 0,
        power: 0,
        leave_one_out: 0,
        two: 0,
        limits: 0,
        levels: vec![2.0],
        only: Vec::new(),
        duration_s: 1.0,
        seed: 3,
        log: folder.path().join(log),
        verbose: false,
    };
    let first = run(&plan(1, "a")).unwrap();
    let started = std::fs::read_to_string(folder.path().join("a")).unwrap();
    // Nothing left to do: the log is read, not written.
    let again = run(&plan(1, "a")).unwrap();
    assert_eq!(std::fs::read_to_string(folder.path().join("a")).unwrap(), started);
    // The JSON reader is right to the last digit but one.
    assert_eq!((&first[0].id, &first[0].reported), (&again[0].id, &again[0].reported));
    assert!((first[0].held_out[0][1] / again[0].held_out[0][1] - 1.0).abs() < 1e-12);
    assert!(first[0].wrong_names == 0);
}

/// Without declared machines every record has its own, with its own layout, and the same seed draws the same.
#[test]
fn a_machine_is_drawn_for_every_record_and_its_true_floor_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let plan = |log: &str| Plan {
        machines: Vec::new(),
        null: 2,
        bootstrap: 1,
        power: 0,
        leave_one_out: 0,
        two: 0,
        limits: 0,
        levels: vec![2.0],
        only: Vec::new(),
        duration_s: 0.6,
        seed: 3,
        log: folder.path().join(log),
        verbose: false,
    };
    let [first, again] = ["a", "b"].map(|log| run(&plan(log)).unwrap());
    assert_eq!(first.len(), 2);
    assert_ne!(first[0].machine, first[1].machine);
    for (one, same) in first.iter().zip(&again) {
        assert_eq!((&one.machine, one.runs, &one.reported), (&same.machine, same.runs, &same.reported));
        assert!((3..=10).contains(&one.runs), "{} runs", one.runs);
        assert_eq!(one.bootstrap, same.bootstrap);
        assert_eq!(one.bootstrap.map(|[_, records]| records), Some(1));
        let (found, truth) = (one.held_out[1][2], one.true_floor.unwrap());
        assert!((found / truth - 1.0).abs() < 0.3, "floor {found}, true {truth}");
    }
}
