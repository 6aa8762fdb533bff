//! Damaged records: keys of `record.toml`, the files beside it, and what its paths lead to.

use crate::damage::attack::{Attack, Kind, Scene, words};
use crate::damage::byte_damage::{NASTY_TEXTS, damage, damage_npy, damage_text};
use crate::damage::process::{Invocation, When};
use crate::damage::special;
use crate::damage::toml_damage;
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::Signal;
use std::os::unix::fs::symlink;
use std::time::Duration;
use toml::{Table, Value};

/// Commands that read a record, by how often they are used out of 20.
const READERS: &[(&str, usize, &str, Kind)] = &[
    ("predict in/record -o out/p", 7, "out/p", Kind::Predictions),
    ("simulate in/record --speed 30 --torque 10 --duration 0.1 --rate 20480 -o out/r", 4, "out/r", Kind::Record),
    ("stiffness in/record --json out/s.json", 4, "out/s.json", Kind::Json),
    ("loop in/record --json out/l.json", 2, "out/l.json", Kind::Json),
    ("check in/record --json out/c.json", 2, "out/c.json", Kind::Json),
    ("loop in/record --report out/l.html", 1, "out/l.html", Kind::Page),
];

/// One of the commands on the record at `in/record`.
fn reader(scene: &mut Scene, what: String) -> Attack {
    let mut number = scene.random.random_range(0..20);
    for (line, weight, path, kind) in READERS {
        if number < *weight {
            return Attack::new(what, Invocation::new(words(line))).writing(*path, *kind);
        }
        number -= weight;
    }
    unreachable!("the weights make 20")
}

/// One of the sound records, as `in/record`.
fn sound(scene: &mut Scene) -> Table {
    let name = *scene.pick(&["record", "record", "third-record", "table-record", "table-record"]);
    scene.copy(name, "in/record");
    declaration(scene)
}

fn declaration(scene: &Scene) -> Table {
    let text = String::from_utf8(scene.read("in/record/record.toml")).expect("our own record");
    toml::from_str(&text).expect("our own record")
}

/// The `index`-th pair of a place and a change, in an order that the seed gives, so that a family meets every pair.
pub fn pair(scene: &Scene, places: usize) -> (usize, usize) {
    let changes = toml_damage::changes();
    let mut order: Vec<usize> = (0..places * changes).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(scene.seed));
    let chosen = order[scene.index % order.len()];
    (chosen / changes, chosen % changes)
}

/// One key of `record.toml`, now and then two.
pub fn keys(scene: &mut Scene) -> Option<Attack> {
    let by_loop = scene.index % 40 == 39;
    scene.copy(if by_loop { "loop-record" } else { "table-record" }, "in/record");
    let mut document = declaration(scene);
    let places = toml_damage::places(&document);
    // Every place and change in turn: a random choice would leave some out.
    let (place, change) = pair(scene, places.len());
    let mut what = toml_damage::apply(&mut document, &places[place], change).unwrap_or_else(|| "unchanged".into());
    if scene.chance(0.1) {
        let places = toml_damage::places(&document);
        let place = scene.random.random_range(0..places.len().max(1));
        let change = scene.random.random_range(0..toml_damage::changes());
        if let Some(more) = places.get(place).and_then(|place| toml_damage::apply(&mut document, place, change)) {
            what += &format!(", {more}");
        }
    }
    scene.write("in/record/record.toml", toml::to_string(&document).unwrap_or_default());
    Some(if by_loop { patient_loop(what) } else { reader(scene, what) })
}

/// The loop works for minutes where the damage leaves a record sound: it has to obey an interrupt then.
fn patient_loop(what: String) -> Attack {
    let mut attack = Attack::new(what, Invocation::new(words("loop in/record --json out/l.json")));
    attack.commands[0].signal = Some((Signal::INT, When::After(Duration::from_secs(5))));
    attack.writing("out/l.json", Kind::Json)
}

/// Signals, edges, the table, and the text of `record.toml`.
pub fn files(scene: &mut Scene) -> Option<Attack> {
    sound(scene);
    let table = scene.folder.join("in/record/stiffness.csv").exists();
    let (file, what) = match scene.random.random_range(0..10) {
        0..3 => {
            let mut bytes = scene.read("in/record/run01.npy");
            let way = if scene.chance(0.6) { damage_npy } else { damage };
            let what = way(&mut bytes, &mut scene.random);
            scene.write("in/record/run01.npy", bytes);
            ("signal", what)
        }
        3..6 => ("tach", tach(scene)),
        6..9 if table => ("stiffness table", stiffness(scene)),
        6..8 => {
            let what = codes(scene);
            ("codes", what)
        }
        _ => {
            let mut bytes = scene.read("in/record/record.toml");
            let way = if scene.chance(0.5) { damage_text } else { damage };
            let what = way(&mut bytes, &mut scene.random);
            scene.write("in/record/record.toml", bytes);
            ("record.toml", what)
        }
    };
    Some(reader(scene, format!("{file}: {what}")))
}

/// Edges that are no shaft's.
fn tach(scene: &mut Scene) -> String {
    let path = "in/record/run00.tach.csv";
    if scene.chance(0.4) {
        let mut bytes = scene.read(path);
        let way = if scene.chance(0.7) { damage_text } else { damage };
        let what = way(&mut bytes, &mut scene.random);
        scene.write(path, bytes);
        return what;
    }
    type Edges = fn(usize) -> f64;
    let kinds: &[(&str, usize, Edges)] = &[
        ("none", 0, |_| 0.0),
        ("one", 1, |_| 0.0),
        ("two", 2, |i| 0.03 * i as f64),
        ("all equal", 20, |_| 0.01),
        ("descending", 20, |i| 0.1 - 0.003 * i as f64),
        ("1e-17 s apart", 20, |i| 0.01 + 1e-17 * i as f64),
        ("1e-17 s apart from 0", 20, |i| 1e-17 * i as f64),
        ("1 ns apart", 100, |i| 1e-9 * i as f64),
        ("20 us apart", 5000, |i| 2e-5 * i as f64),
        ("1e5 edges", 100_000, |i| 1e-6 * i as f64),
        ("1e6 edges", 1_000_000, |i| 1e-7 * i as f64),
        ("far apart", 5, |i| 1e6 * i as f64),
        ("before the run", 5, |i| -0.1 + 0.01 * i as f64),
        ("in the run, one at the end", 3, |i| [0.0, 0.03, 0.199][i]),
        ("one doubled", 4, |i| [0.0, 0.033, 0.033_000_1, 0.066][i]),
        ("of 1e300 s", 3, |i| 1e300 * i as f64),
    ];
    let (name, count, edge) = kinds[scene.random.random_range(0..kinds.len())];
    let lines: String = (0..count).map(|i| format!("{:e}\n", edge(i))).collect();
    scene.write(path, format!("edge_time_s\n{lines}"));
    format!("edges {name}")
}

/// A stiffness table that is no tooth's.
pub fn stiffness(scene: &mut Scene) -> String {
    let path = if scene.folder.join("in/record").exists() { "in/record/stiffness.csv" } else { "in/stiffness.csv" };
    let text = String::from_utf8(scene.read(path)).expect("our own table");
    if scene.chance(0.4) {
        let mut bytes = text.into_bytes();
        let way = if scene.chance(0.7) { damage_text } else { damage };
        let what = way(&mut bytes, &mut scene.random);
        scene.write(path, bytes);
        return what;
    }
    let head = text.lines().next().unwrap_or_default().to_owned();
    let rows: Vec<[f64; 2]> = text
        .lines()
        .skip(1)
        .filter_map(|line| line.split_once(',').and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?])))
        .collect();
    type Change = fn(Vec<[f64; 2]>) -> Vec<[f64; 2]>;
    let kinds: &[(&str, Change)] = &[
        ("all zero", |r| r.into_iter().map(|[p, _]| [p, 0.0]).collect()),
        ("negative", |r| r.into_iter().map(|[p, k]| [p, -k]).collect()),
        ("three rows", |r| vec![r[0], r[r.len() / 2], r[r.len() - 1]]),
        ("two rows", |r| vec![r[0], r[r.len() - 1]]),
        ("one row", |r| r[..1].to_vec()),
        ("positions x 1e6", |r| r.into_iter().map(|[p, k]| [p * 1e6, k]).collect()),
        ("positions x 1e-6", |r| r.into_iter().map(|[p, k]| [p * 1e-6, k]).collect()),
        ("stiffness x 1e12", |r| r.into_iter().map(|[p, k]| [p, k * 1e12]).collect()),
        ("stiffness x 1e300", |r| r.into_iter().map(|[p, k]| [p, k * 1e300]).collect()),
        ("stiffness x 1e-12", |r| r.into_iter().map(|[p, k]| [p, k * 1e-12]).collect()),
        ("descending", |r| r.into_iter().rev().collect()),
        ("every row twice", |r| r.into_iter().flat_map(|row| [row, row]).collect()),
        ("shifted by 5", |r| r.into_iter().map(|[p, k]| [p + 5.0, k]).collect()),
        ("200 000 rows", |_| (0..200_000).map(|i| [1.6e-5 * f64::from(i) / 2.0, 2e8]).collect()),
        ("a comb", |r| r.into_iter().enumerate().map(|(i, [p, k])| [p, if i % 2 == 0 { k } else { 0.0 }]).collect()),
    ];
    let (name, change) = kinds[scene.random.random_range(0..kinds.len())];
    let lines: String = change(rows).iter().map(|[p, k]| format!("{p:e},{k:e}\n")).collect();
    scene.write(path, format!("{head}\n{lines}"));
    name.to_owned()
}

/// A signal file that is sound and whose codes are not.
fn codes(scene: &mut Scene) -> String {
    let path = "in/record/run01.npy";
    let mut bytes = scene.read(path);
    let start = bytes.iter().position(|&byte| byte == b'\n').map_or(0, |at| at + 1);
    let name = *scene.pick(&["all zero", "all at the rail", "lowest code", "noise"]);
    for pair in bytes[start..].as_chunks_mut::<2>().0 {
        *pair = match name {
            "all zero" => [0, 0],
            "all at the rail" => i16::MAX.to_le_bytes(),
            "lowest code" => i16::MIN.to_le_bytes(),
            _ => scene.random.random::<i16>().to_le_bytes(),
        };
    }
    scene.write(path, bytes);
    name.to_owned()
}

/// Paths that lead elsewhere, and special files in place of ordinary ones.
pub fn paths(scene: &mut Scene) -> Option<Attack> {
    let mut document = sound(scene);
    scene.copy("record/run00.npy", "in/victim.npy");
    scene.copy("record/run00.tach.csv", "in/victim.tach.csv");
    scene.copy("stiffness.csv", "in/victim.csv");
    scene.write("out/victim.npy", "another's\n");
    let file = *scene.pick(&["run00.npy", "run00.tach.csv", "record.toml", "run01.npy"]);
    let what = if scene.chance(0.4) {
        let kind = *scene.pick(special::SPECIAL_NAMES);
        special::put(&scene.folder.join("in/record").join(file), kind);
        format!("{file} is {kind}")
    } else if scene.chance(0.2) {
        let inside = scene.folder.join("in/record").join(file);
        std::fs::remove_file(&inside).expect("our own record");
        scene.copy(&format!("record/{file}"), "in/elsewhere");
        symlink("../elsewhere", inside).expect("the campaign's folder is writable");
        format!("{file} is a link out of the record")
    } else {
        led_astray(scene, &mut document)
    };
    let mut attack = reader(scene, what);
    if scene.chance(0.3) {
        attack = Attack::new(attack.what, Invocation::new(words("predict in/record -o out/q")));
        attack = attack.writing("out/q", Kind::Predictions);
    }
    Some(attack)
}

/// A path of the declaration that leads elsewhere.
fn led_astray(scene: &mut Scene, document: &mut Table) -> String {
    let absolute = scene.folder.join("in/victim.npy").display().to_string();
    let long = "x".repeat(300);
    let deep = "d/".repeat(3000);
    let mut tricks = vec![
        "../victim.npy",
        "../../in/victim.npy",
        "/dev/zero",
        "/dev/stdin",
        "/etc/passwd",
        "/proc/self/exe",
        "..",
        ".",
        "run00.npy/",
        "./run00.npy",
        "sub/../run00.npy",
        "run01.npy",
        "record.toml",
        "run00.tach.csv",
        "RUN00.NPY",
        "~/run00.npy",
        "file:///etc/passwd",
        "-",
        "|cat",
        "a\0b",
        "../../out/victim.npy",
    ];
    tricks.extend([absolute.as_str(), &long, &deep]);
    tricks.extend(NASTY_TEXTS.iter().take(60).skip(44));
    let trick = (*scene.pick(&tricks)).to_owned();
    let key = *scene.pick(&["signal", "signal", "tach", "pair_stiffness"]);
    let table = match key {
        "pair_stiffness" => document.get_mut("pair"),
        _ => document.get_mut("run").and_then(|runs| runs.get_mut(0)),
    };
    if let Some(Value::Table(table)) = table {
        table.insert(key.into(), trick.clone().into());
    }
    scene.write("in/record/record.toml", toml::to_string(document).expect("a document"));
    format!("{key} = {:?}", trick.chars().take(60).collect::<String>())
}
