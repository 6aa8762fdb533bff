//! Damaged measurement files in every format that `meshband import` reads, and options that do not fit them.

use crate::damage::attack::{Attack, Kind, Scene};
use crate::damage::byte_damage::{NASTY_TEXTS, damage, damage_npy, damage_text};
use crate::damage::originals::{mat_array, mat_file, mat_packed};
use crate::damage::process::Invocation;
use crate::damage::special;
use flate2::Compression;
use flate2::write::GzEncoder;
use rand::RngExt;
use std::ffi::OsString;
use std::io::Write;

/// Options of `import` with values that fit.
const OPTIONS: &[(&str, &str)] = &[
    ("--rate", "5120"),
    ("--teeth", "23,46"),
    ("--mesh", "460"),
    ("--unit", "V"),
    ("--volt-per-g", "0.1"),
    ("--channel-names", "a"),
    ("--full-scale", "100"),
    ("--title", "x"),
    ("--runs", ""),
    ("--remove-mean", ""),
];

/// A damaged file, or sound ones with options that do not fit.
pub fn files(scene: &mut Scene) -> Option<Attack> {
    let name = *scene.pick(scene.originals.imports);
    scene.copy(name, &format!("in/{name}"));
    let path = format!("in/{name}");
    let mut options: Vec<OsString> = Vec::new();
    let mut files: Vec<OsString> = vec![(&path).into()];
    let what = match scene.random.random_range(0..20) {
        0..11 => format!("{name}: {}", mutated(scene, name)),
        11..13 => {
            let (made, what) = content(scene);
            files = vec![made.into()];
            what
        }
        13 => {
            let kind = *scene.pick(special::SPECIAL_NAMES);
            special::put(&scene.folder.join(&path), kind);
            format!("{name} is {kind}")
        }
        14 => {
            let other = *scene.pick(scene.originals.imports);
            scene.copy(other, &format!("in/second-{other}"));
            files.push(format!("in/second-{other}").into());
            format!("{name} with {other}")
        }
        15 => {
            let other = *scene.pick(scene.originals.imports);
            std::fs::rename(scene.folder.join(&path), scene.folder.join("in/x")).expect("an original");
            let misnamed = format!("in/misnamed-{other}");
            std::fs::rename(scene.folder.join("in/x"), scene.folder.join(&misnamed)).expect("an original");
            files = vec![misnamed.into()];
            format!("{name} under the name of {other}")
        }
        _ => {
            for _ in 0..scene.random.random_range(1..4) {
                let (option, sound) = *scene.pick(OPTIONS);
                let nasty = scene.chance(0.7) && !sound.is_empty();
                let value = if nasty { (*scene.pick(NASTY_TEXTS)).to_owned() } else { sound.to_owned() };
                options.push(option.into());
                if !sound.is_empty() {
                    options.push(value.replace('\0', "0").into());
                }
            }
            format!("{name} with {options:?}")
        }
    };
    let stated = ["table.csv", "tone.wav", "tone.uff"].contains(&name) && scene.chance(0.5);
    Some(imported(scene, what, files, options, stated))
}

/// The import of files; `stated` where they have their own rate.
fn imported(scene: &mut Scene, what: String, files: Vec<OsString>, options: Vec<OsString>, stated: bool) -> Attack {
    let mut arguments: Vec<OsString> = vec!["import".into()];
    arguments.extend(files);
    // A virtual tach of two seconds takes a tenth of a second: not in every attack.
    let tach = scene.chance(0.3);
    if options.is_empty() {
        arguments.extend(if stated { vec![] } else { vec![OsString::from("--rate"), "5120".into()] });
        arguments.extend(if tach { vec![OsString::from("--teeth"), "23,46".into()] } else { vec![] });
    }
    if !tach {
        arguments.push("--no-tach".into());
    }
    arguments.extend(options);
    arguments.extend(["-o".into(), "out/r".into()]);
    let attack = Attack::new(what, Invocation::new(arguments.clone())).writing("out/r", Kind::Record);
    if scene.chance(0.2) {
        let mut attack = attack.writing("out/i.json", Kind::Json).writing("out/i.html", Kind::Page);
        let more = ["--json", "out/i.json", "--report", "out/i.html"];
        attack.commands[0].arguments.extend(more.map(OsString::from));
        attack
    } else {
        attack
    }
}

fn mutated(scene: &mut Scene, name: &str) -> String {
    let path = format!("in/{name}");
    let mut bytes = scene.read(&path);
    let way = match name.rsplit('.').next() {
        Some("csv" | "uff") if scene.chance(0.7) => damage_text,
        Some("npy") if scene.chance(0.6) => damage_npy,
        _ => damage,
    };
    let mut what = way(&mut bytes, &mut scene.random);
    if scene.chance(0.15) {
        what += &format!(", {}", damage(&mut bytes, &mut scene.random));
    }
    scene.write(&path, bytes);
    what
}

fn packed(text: &[u8]) -> Vec<u8> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(text).and_then(|()| packed.finish()).expect("in memory")
}

/// Files that are sound by their format and senseless, or far larger than they look.
fn content(scene: &mut Scene) -> (&'static str, String) {
    let table = |cell: fn(usize) -> String| (0..500).map(|i| cell(i) + "\n").collect::<String>();
    let kinds: &[&str] = &[
        "a decimal comma in one column",
        "zeros",
        "a constant",
        "a spike",
        "huge values",
        "tiny values",
        "text",
        "one value",
        "a gzip bomb of 1 GiB",
        "a gzip of many parts",
        "a zlib bomb",
        "a variable's name of 1 MB",
        "1000 columns",
        "ragged",
        "a time column with a gap",
        "gzip in gzip",
        "NaN at the end",
        "blank lines",
        "a MATLAB time vector",
        "no rows",
    ];
    let name = *scene.pick(kinds);
    let bytes: Vec<u8> = match name {
        "a decimal comma in one column" => table(|i| format!("0,{}", i % 100)).into(),
        "zeros" => table(|_| "0".into()).into(),
        "a constant" => table(|_| "3.5".into()).into(),
        "a spike" => table(|i| if i == 250 { "1e9".into() } else { format!("{}", (i % 7) as f64 * 0.1) }).into(),
        "huge values" => table(|i| format!("{}e307", i % 17)).into(),
        "tiny values" => table(|i| format!("{}e-310", i % 17)).into(),
        "text" => table(|_| "lorem ipsum".into()).into(),
        "one value" => b"1\n".to_vec(),
        "a gzip bomb of 1 GiB" => {
            // Many members of 4 MiB: made in a moment, and as large when read.
            let part = packed("1\n2\n".repeat(1 << 20).as_bytes());
            part.repeat(256)
        }
        "a gzip of many parts" => packed(b"1\n2\n3\n").repeat(100),
        "a zlib bomb" => {
            let packed = mat_packed(&mat_array("x", &vec![1; 200 << 20], 2)).expect("in memory");
            mat_file(&[&packed])
        }
        "a variable's name of 1 MB" => mat_file(&[&mat_array(&"n".repeat(1 << 20), &[0, 0, 128, 63].repeat(500), 7)]),
        "1000 columns" => (0..20).map(|_| vec!["1"; 1000].join(",") + "\n").collect::<String>().into(),
        "ragged" => table(|i| if i % 3 == 0 { "1,2".into() } else { "1,2,3".into() }).into(),
        "a time column with a gap" => {
            table(|i| format!("{:.6},{}", if i < 250 { i as f64 } else { i as f64 + 40.0 } / 5120.0, i % 13)).into()
        }
        "gzip in gzip" => packed(&packed(b"1\n2\n3\n")),
        "NaN at the end" => (table(|i| format!("{}", i % 9)) + "nan\n").into(),
        "blank lines" => table(|i| if i % 2 == 0 { String::new() } else { format!("{}", i % 9) }).into(),
        "a MATLAB time vector" => {
            let vector = |f: fn(u32) -> f32| (0..4000).flat_map(|i| f(i).to_le_bytes()).collect::<Vec<u8>>();
            let time = mat_array("t", &vector(|i| i as f32 / 5120.0), 7);
            mat_file(&[&time, &mat_array("x", &vector(|i| (i as f32 * 0.56).sin()), 7)])
        }
        _ => b"a,b,c\n".to_vec(),
    };
    let path = match &bytes[..] {
        [0x1f, 0x8b, ..] => "in/made.csv.gz",
        [b'M', b'A', b'T', ..] => "in/made.mat",
        _ => "in/made.csv",
    };
    scene.write(path, bytes);
    (path, name.to_owned())
}
