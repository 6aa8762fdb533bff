//! Machines, effects and options that make no sense or would run for ever: refused at once, with key and figure.

use crate::common::{accepted, altered, folder, machine, refused, text};
use std::path::{Path, PathBuf};

/// The check machine with its table in a folder of its own, with one text replaced.
fn changed(folder: &Path, from: &str, to: &str) -> String {
    std::fs::copy(machine("check-19-48.csv"), folder.join("check-19-48.csv")).expect("copied");
    let target = folder.join("machine.toml");
    altered(&machine("check-19-48.toml"), &target, from, to);
    text(&target)
}

fn simulate<'a>(machine: &'a str, out: &'a str, options: &[&'a str]) -> Vec<&'a str> {
    let mut arguments = vec!["simulate", machine, "-o", out, "--duration", "0.3"];
    arguments.extend(options);
    arguments
}

fn out(folder: &Path) -> String {
    text(&folder.join("out"))
}

#[test]
fn regress_effects_on_teeth_that_are_not_there_are_refused() {
    let folder = folder("teeth");
    let (machine, out) = (text(&machine("check-19-48.toml")), out(&folder));
    for (effect, expected) in [
        ("tooth-crack:tooth=19", ["tooth-crack: tooth", "19 on a pinion with teeth 0 to 18"]),
        ("gear-tooth-crack:tooth=48", ["tooth-crack: tooth", "48 on a gear with teeth 0 to 47"]),
        ("pitch-error:single=1e-5,tooth=19", ["pitch-error: tooth", "19 on a pinion"]),
        ("tooth-crack:tooth=1.5", ["tooth-crack: tooth", "1.5 is not a whole number"]),
        ("eccentricity:gear=0.5", ["eccentricity: gear", "0.5 is not a whole number"]),
        ("noise:channel=0.4", ["noise: channel", "0.4 is not a whole number"]),
        ("tip-relief:exponent=1.6", ["tip-relief: exponent", "1.6 is not a whole number"]),
        ("gear-eccentricity:gear=0", ["eccentricity: gear", "0 contradicts 1"]),
        ("tooth-crack:tooth=3,tooth=4", ["tooth-crack: tooth", "4 contradicts 3"]),
        ("torque-ripple:depth=0.3", ["torque-ripple: order", "changes nothing"]),
        ("load-fluctuation", ["load-fluctuation: order", "changes nothing"]),
        ("speed-fluctuation", ["speed-fluctuation: order", "changes nothing"]),
        ("pitch-error:tooth=3", ["pitch-error: single", "changes nothing"]),
    ] {
        refused(&simulate(&machine, &out, &["--effect", effect]), &expected);
    }
    let file = folder.join("effects.toml");
    std::fs::write(&file, "[[effect]]\nname = \"tooth-crack\"\ntooth = 19\n").expect("written");
    refused(&simulate(&machine, &out, &["--effects", &text(&file)]), &["tooth-crack: tooth"]);
    accepted(&simulate(&machine, &out, &["--effect", "tooth-crack:tooth=18", "--effect", "gear-eccentricity:gear=1"]));
}

#[test]
fn regress_lists_of_the_wrong_length_are_refused() {
    let folder = folder("lists");
    let out = out(&folder);
    let three = changed(&folder, "teeth = [19, 48]", "teeth = [19, 48, 99]");
    refused(&simulate(&three, &out, &[]), &["machine.toml", "[pair] teeth", "3 entries where 2 are meant"]);
    let three = changed(&folder, "mass_kg = [0.96, 2.88]", "mass_kg = [0.96, 2.88, 1.0]");
    refused(&["stiffness", &three], &["machine.toml", "[shafts] mass_kg", "3 entries where 2 are meant"]);
    let record = record(&folder);
    let toml = record.join("record.toml");
    altered(&toml, &toml, "mass_kg = [0.96, 2.88]", "mass_kg = [0.96, 2.88, 1.0]");
    refused(&["loop", &text(&record)], &["record.toml", "[shafts] mass_kg", "3 entries where 2 are meant"]);
}

#[test]
fn regress_jitter_that_puts_tach_edges_out_of_order_is_refused() {
    let folder = folder("jitter");
    let (machine, out) = (text(&machine("check-19-48.toml")), out(&folder));
    refused(&simulate(&machine, &out, &["--jitter", "0.05", "--pulses", "8"]), &["--jitter", "change places"]);
    assert!(!Path::new(&out).exists());
    accepted(&simulate(&machine, &out, &["--jitter", "1e-5", "--pulses", "8"]));
}

#[test]
fn fault_simulations_beyond_the_budget_are_refused_with_figures() {
    let folder = folder("budget");
    let (machine, out) = (text(&machine("check-19-48.toml")), out(&folder));
    for (options, expected) in [
        (vec!["--duration=1e300"], vec!["--duration", "samples x channels", "the limit is"]),
        (vec!["--duration=1e15"], vec!["--duration", "1.024e20", "the limit is"]),
        (vec!["--duration=1e9"], vec!["--duration", "samples x channels"]),
        (vec!["--rate=1e8", "--duration=1"], vec!["--rate", "2.000e8"]),
        (vec!["--speed=1e300"], vec!["--speed", "6e301 rpm", "1e300Hz"]),
        (vec!["--speed=1e4Hz"], vec!["speed", "10000 turns/s", "the limit is 1000"]),
        (vec!["--run-up=10,1e5,1"], vec!["speed", "turns/s"]),
        (vec!["--torque=1e300"], vec!["torque", "1e300"]),
        (vec!["--pulses=100000000"], vec!["--pulses", "10000"]),
        (vec!["--pulses=10001"], vec!["--pulses", "10000"]),
        (vec!["--pulses=10000", "--speed=900Hz", "--duration=1"], vec!["--pulses", "tach edges", "the limit is"]),
    ] {
        let mut arguments = vec!["simulate", &machine, "-o", &out];
        arguments.extend(options);
        refused(&arguments, &expected);
    }
    assert!(!Path::new(&out).exists());
}

#[test]
fn fault_what_is_no_machine_is_refused_with_its_key_or_its_frequency() {
    let folder = folder("no-machine");
    let out = out(&folder);
    let natural = &["highest natural frequency or decay rate", "times the sampling rate"][..];
    for (from, to, expected) in [
        ("inertia_pinion_kg_m2 = 0.00043659", "inertia_pinion_kg_m2 = 4.3e-10", natural),
        ("mass_kg = [0.96, 2.88]", "mass_kg = [0.96e-6, 2.88]", natural),
        ("[65600000.0, 65600000.0]", "[9223372036854775808.0, 65600000.0]", &["bearing_stiffness_n_per_m[0]"]),
        ("[65600000.0, 65600000.0]", "[9.2e15, 65600000.0]", natural),
        // Overdamped: no frequency, but as fast a motion.
        ("damping_n_s_per_m = [600.0", "damping_n_s_per_m = [600.0e6", natural),
        ("damping_n_s_per_m = [600.0", "damping_n_s_per_m = [9223372036854775808.0", &["bearing_damping_n_s_per_m[0]"]),
        ("damping_n_s_per_m = [600.0", "damping_n_s_per_m = [9e11", natural),
        ("mass_kg = [0.96, 2.88]", "mass_kg = [1e308, 2.88]", &["mass_kg[0]"]),
        ("bore_radius_m = [0.0096", "bore_radius_m = [1e-308", &["bore_radius_m[0]"]),
        ("speed_hz = 12.0", "speed_hz = 1e300", &["[nominal] speed_hz"]),
        ("torque_n_m = 15.0", "torque_n_m = 1e300", &["[nominal] torque_n_m"]),
    ] {
        let machine = changed(&folder, from, to);
        refused(&simulate(&machine, &out, &[]), expected);
    }
    let bore = changed(&folder, "bore_radius_m = [0.0096", "bore_radius_m = [1e-308");
    refused(&["stiffness", &bore], &["bore_radius_m[0]"]);
    assert!(!Path::new(&out).exists());
}

#[test]
fn regress_one_reader_of_stiffness_tables_and_it_is_strict() {
    let folder = folder("tables");
    let record = record(&folder);
    let table = record.join("check-19-48.csv");
    let whole = std::fs::read_to_string(&table).expect("a table");
    let lines: Vec<&str> = whole.lines().collect();
    let scaled = |factor: f64, column: usize| -> String {
        let rows = lines[1..].iter().map(|line| {
            let mut cells: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
            cells[column] *= factor;
            format!("{},{}\n", cells[0], cells[1])
        });
        format!("{}\n{}", lines[0], rows.collect::<String>())
    };
    let many: String = (0..1_000_000).map(|i| format!("{},1e8\n", f64::from(i) * 1.6e-6)).collect();
    for (content, expected) in [
        (scaled(0.0, 1), "every stiffness is zero"),
        (format!("{}\n0,1e8\n0.8,2e8\n1.6,1e8\n", lines[0]), "needs at least 4"),
        (scaled(1e6, 0), "no path of contact"),
        (scaled(1e12, 1), "beyond that of any gear"),
        (format!("{}\n{many}", lines[0]), "rows, the limit is"),
        (format!("{}\n0,1e8,7\n", lines[0]), "line 2"),
    ] {
        std::fs::write(&table, content).expect("written");
        for arguments in [vec!["loop", &text(&record)], vec!["predict", &text(&record), "-o", &text(&folder.join("p"))]]
        {
            refused(&arguments, &["check-19-48.csv", expected]);
        }
    }
}

/// A record of the check machine: two runs of 0.6 s.
fn record(folder: &Path) -> PathBuf {
    let record = folder.join("record");
    let machine = text(&machine("check-19-48.toml"));
    accepted(&["simulate", &machine, "-o", &text(&record), "--speed=10,14", "--duration", "0.6", "--pulses", "4"]);
    record
}

#[test]
fn fault_records_that_are_none_are_refused_by_every_command() {
    let folder = folder("records");
    let record = record(&folder);
    let toml = record.join("record.toml");
    let whole = std::fs::read_to_string(&toml).expect("readable");
    let prediction = text(&folder.join("prediction"));
    let path = text(&record);
    for (from, to, expected) in [
        ("sample_rate_hz = 51200.0", "sample_rate_hz = 1e-308", vec!["[acquisition] sample_rate_hz"]),
        ("sample_rate_hz = 51200.0", "sample_rate_hz = 0.0512", vec!["[acquisition] sample_rate_hz"]),
        ("jitter_s = 0.0", "jitter_s = -1.0", vec!["[tach] jitter_s"]),
        ("pulses_per_rev = 4", "pulses_per_rev = 1000000", vec!["[tach] pulses_per_rev"]),
        ("mass_kg = [0.96, 2.88]", "mass_kg = [1e308, 2.88]", vec!["mass_kg[0]"]),
        ("mass_kg = [0.96, 2.88]", "mass_kg = [0.96e-6, 2.88]", vec!["highest natural frequency"]),
        ("inertia_gear_kg_m2 = 0.0083602", "inertia_gear_kg_m2 = 8.3e-9", vec!["highest natural frequency"]),
    ] {
        altered_text(&whole, &toml, from, to);
        refused(&["loop", &path], &expected);
        refused(&["predict", &path, "-o", &prediction], &expected);
    }
    let full_scale = whole.lines().find(|line| line.starts_with("full_scale")).expect("a full scale");
    altered_text(&whole, &toml, full_scale, "full_scale_m_s2 = 1e308");
    refused(&["loop", &path], &["full_scale_m_s2"]);
    refused(&["predict", &path, "-o", &prediction], &["full_scale_m_s2"]);
    refused(&["node", &path], &["full_scale_m_s2"]);
    let without_runs = whole.split("[[run]]").next().expect("a head").replace("run = []", "");
    std::fs::write(&toml, without_runs).expect("written");
    refused(&["predict", &path, "-o", &prediction], &["record", "no [[run]]"]);
}

fn altered_text(whole: &str, target: &Path, from: &str, to: &str) {
    assert!(whole.contains(from), "{from} is not in {whole}");
    std::fs::write(target, whole.replacen(from, to, 1)).expect("written");
}

#[test]
fn fault_tach_edges_of_no_shaft_are_refused() {
    let folder = folder("edges");
    let record = record(&folder);
    let path = text(&record);
    let edges = |times: &mut dyn Iterator<Item = f64>| {
        let rows: String = times.map(|t| format!("{t:e}\n")).collect();
        std::fs::write(record.join("run00.tach.csv"), format!("edge_time_s\n{rows}")).expect("written");
    };
    let prediction = text(&folder.join("prediction"));
    let refused_by_all = |expected: &[&str]| {
        refused(&["predict", &path, "-o", &prediction], expected);
        refused(&["loop", &path], expected);
        refused(&["node", &path], expected);
    };
    edges(&mut [1e-17, 2e-17, 3e-17].into_iter());
    refused_by_all(&["run00.tach.csv", "turns/s", "the limit is 1000"]);
    edges(&mut (0..30_000).map(|i| f64::from(i) * 2e-5));
    refused_by_all(&["run00.tach.csv", "turns/s"]);
    // One edge doubled by a bounce: the loop repairs it, a prediction takes the angle as it is told.
    edges(&mut [0.0, 0.01, 0.010_000_1, 0.02, 0.03].into_iter());
    refused(&["predict", &path, "-o", &prediction], &["turns/s, the limit is 1000"]);
    edges(&mut (0..10_000_000).map(|i| f64::from(i) * 6e-8));
    refused_by_all(&["run00.tach.csv", "tach edges, the limit is"]);
}

#[test]
#[cfg(unix)]
fn fault_signals_and_tables_that_are_pipes_are_refused_at_once() {
    let folder = folder("pipes");
    let record = record(&folder);
    for name in ["run01.npy", "run01.tach.csv", "check-19-48.csv"] {
        let (file, aside) = (record.join(name), folder.join("aside"));
        std::fs::rename(&file, &aside).expect("moved");
        assert!(std::process::Command::new("mkfifo").arg(&file).status().expect("mkfifo starts").success());
        refused(&["loop", &text(&record)], &[name, "regular file"]);
        refused(&["predict", &text(&record), "-o", &text(&folder.join("p"))], &[name, "regular file"]);
        std::fs::rename(&aside, &file).expect("moved back");
    }
}

#[test]
fn fault_wrong_options_are_one_line_and_help_stays_whole() {
    refused(&["simulate"], &["required arguments", "--output", "--help"]);
    refused(&["simulate", "m.toml", "-o", "x", "--nonsense"], &["--nonsense"]);
    refused(&["import", "a.csv", "-o", "x", "--unit", "furlong"], &["furlong", "no unit that is known"]);
    refused(&["frobnicate"], &["frobnicate"]);
    refused(&["monitor", "--replay", "x", "--patience", "1e-300"], &["--patience"]);
    refused(&["simulate", "m.toml", "-o", "x", "--speed", &"9".repeat(100_000)], &["--speed"]);
    assert!(accepted(&["--help"]).lines().count() > 10);
    assert!(accepted(&["simulate", "--help"]).lines().count() > 20);
    assert!(accepted(&["--version"]).starts_with("meshband"));
}

#[test]
fn regress_a_run_at_twice_the_speed_of_another_is_not_taken_for_it() {
    let folder = folder("twice");
    let (machine, out) = (text(&machine("paper-rig.toml")), out(&folder));
    accepted(&["simulate", &machine, "-o", &out, "--speed", "10,20", "--duration", "1"]);
    let said = accepted(&["check", &out]);
    assert!(said.contains("no finding"), "{said}");
}

#[test]
fn claim_a_machine_file_need_not_state_damping() {
    let folder = folder("damping");
    let source = machine("paper-rig.toml");
    let whole = std::fs::read_to_string(&source).expect("a machine");
    let without: Vec<&str> = whole.lines().filter(|l| !l.contains("_damping_n")).collect();
    assert!(without.len() + 2 <= whole.lines().count(), "the machine states damping");
    let own = folder.join("machine.toml");
    std::fs::write(&own, without.join("\n")).expect("written");
    accepted(&["simulate", &text(&own), "-o", &out(&folder), "--speed", "20", "--duration", "0.3"]);
}
