//! Sound inputs that attacks damage, and what undisturbed commands make of them; made once per campaign.

use super::attack::{Kind, words};
use super::snapshot::Snapshot;
use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use std::f64::consts::TAU;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// Sampling rate of the signals to import, Hz.
pub const IMPORT_RATE_HZ: f64 = 5120.0;
/// Two seconds: enough for a virtual tach.
const IMPORT_SAMPLES: u32 = 10_240;

/// A command that writes one target, with what it leaves there when nothing disturbs it.
pub struct Job {
    /// Words before the output option; paths begin with `in/`.
    pub arguments: &'static str,
    /// What it writes.
    pub kind: Kind,
    /// Digest of what it writes.
    pub whole: u64,
    /// How long it takes.
    pub time: Duration,
    /// Folder of the originals that holds its result.
    pub result: String,
}

/// Originals in a folder.
pub struct Originals {
    folder: PathBuf,
    /// Pairs of commands that write the same kind of target with different content.
    pub jobs: Vec<[Job; 2]>,
    /// Length of every import file's name, for tables.
    pub imports: &'static [&'static str],
}

/// Files to import, one per format.
const IMPORTS: &[&str] =
    &["tone.csv", "tone.csv.gz", "tone.wav", "tone.npy", "tone.mat", "tone.uff", "table.csv", "two.npy", "plain.mat"];

/// Commands whose targets are watched, two of each kind: different content, and a different number of runs.
const JOBS: [[(&str, Kind); 2]; 4] = [
    [
        (
            "simulate in/machine.toml --speed 30,31,32,33,34,35,36,37 --duration 0.1 --rate 20480 --noise 0.1",
            Kind::Record,
        ),
        (
            "simulate in/machine.toml --speed 40,41,42,43,44 --duration 0.1 --rate 20480 --seed 2 --noise 0.2",
            Kind::Record,
        ),
    ],
    [("predict in/record", Kind::Predictions), ("predict in/third-record", Kind::Predictions)],
    [
        ("import in/tone.csv --rate 5120 --teeth 23,46 --mesh 460 --title one", Kind::Record),
        ("import in/tone.wav in/tone.npy --rate 5120 --no-tach --runs --title two", Kind::Record),
    ],
    [
        ("simulate in/table-machine.toml --speed 30 --torque 10 --duration 0.1 --rate 20480", Kind::Record),
        ("import in/two.npy --rate 5120 --no-tach --title other", Kind::Record),
    ],
];

/// Commands that make the originals.
const ORIGINAL_COMMANDS: &[&str] = &[
    "simulate in/machine.toml --speed 30,31 --torque 10 --duration 0.1 --rate 25600 -o in/record",
    "simulate in/machine.toml --speed 30,32,34 --torque 11 --duration 0.1 --rate 25600 -o in/third-record",
    "simulate in/table-machine.toml --speed 30,31 --torque 10 --duration 0.1 --rate 20480 -o in/table-record",
    "simulate in/table-machine.toml --speed 28,30,32 --torque 10 --duration 0.5 --rate 20480 -o in/loop-record",
    "law fit in/machine.toml -o in/law.toml",
];

const EFFECTS: &str = "[[effect]]\nname = \"tooth-crack\"\ntooth = 3\n\n[[effect]]\nname = \"noise\"\n";

impl Originals {
    /// Makes them below `folder` with the command itself.
    ///
    /// # Errors
    /// A command that fails on sound input: without it there is nothing to damage.
    pub fn make(program: &Path, folder: &Path) -> Result<Self, String> {
        let inputs = folder.join("in");
        let fail = |error: std::io::Error| format!("{}: {error}", inputs.display());
        std::fs::create_dir_all(&inputs).map_err(fail)?;
        machines(&inputs).map_err(fail)?;
        imports(&inputs).map_err(fail)?;
        std::fs::write(inputs.join("effects.toml"), EFFECTS).map_err(fail)?;
        for line in ORIGINAL_COMMANDS {
            undisturbed(program, folder, line)?;
        }
        let job = |number: String, (arguments, kind): (&'static str, Kind)| {
            let result = format!("whole-{number}");
            let start = Instant::now();
            undisturbed(program, folder, &format!("{arguments} -o {result}"))?;
            let whole = Snapshot::of(&folder.join(&result)).digest();
            Ok::<Job, String>(Job { arguments, kind, whole, time: start.elapsed(), result })
        };
        let mut jobs = Vec::new();
        for (i, [first, second]) in JOBS.into_iter().enumerate() {
            jobs.push([job(format!("{i}-0"), first)?, job(format!("{i}-1"), second)?]);
        }
        Ok(Self { folder: folder.to_owned(), jobs, imports: IMPORTS })
    }

    /// Path of an original: of the inputs by its name, of results with the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        if name.starts_with("whole-") { self.folder.join(name) } else { self.folder.join("in").join(name) }
    }
}

fn undisturbed(program: &Path, folder: &Path, line: &str) -> Result<(), String> {
    let output = Command::new(program).current_dir(folder).args(words(line)).output();
    let output = output.map_err(|error| format!("{}: {error}", program.display()))?;
    let said = String::from_utf8_lossy(&output.stderr);
    if output.status.success() { Ok(()) } else { Err(format!("`{line}` fails on sound input: {said}")) }
}

/// A machine of geometry alone and one with a short stiffness table.
fn machines(folder: &Path) -> std::io::Result<()> {
    let machines = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
    std::fs::copy(machines.join("19-48.toml"), folder.join("machine.toml"))?;
    let text = std::fs::read_to_string(machines.join("check-19-48.toml"))?;
    std::fs::write(folder.join("table-machine.toml"), text.replace("check-19-48.csv", "stiffness.csv"))?;
    // The whole table costs four times the computation.
    let table = std::fs::read_to_string(machines.join("check-19-48.csv"))?;
    let kept = table.lines().enumerate().filter(|(i, _)| *i == 0 || (i - 1) % 16 == 0);
    let short: String = kept.map(|(_, line)| format!("{line}\n")).collect();
    std::fs::write(folder.join("stiffness.csv"), short)
}

/// A case whose data are not at hand.
const ABSENT_CASE: &str = "title = 'absent'\nsource = 'nowhere'\ncaution = 'none'\nfiles = ['0']\npath = \
    '{}.npy'\nrate_hz = 5120\nunit = 'unknown'\n\
teeth = [23, 46]\n";

/// A mesh tone with harmonics and shaft sidebands over a little noise, in every format that is read, and a case.
fn imports(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder.join("cases"))?;
    std::fs::write(folder.join("cases/absent.toml"), ABSENT_CASE)?;
    import_files(IMPORT_SAMPLES)?.into_iter().try_for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes))
}

/// The tone in every format, by name.
///
/// # Errors
/// None in memory.
pub fn import_files(samples: u32) -> std::io::Result<Vec<(&'static str, Vec<u8>)>> {
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / f64::from(1 << 24) - 0.5
    };
    let mut value = |n: u32| {
        let mesh = TAU * 460.0 * f64::from(n) / IMPORT_RATE_HZ;
        let swing = 1.0 + 0.3 * (mesh / 23.0).cos();
        swing * (mesh.cos() + 0.5 * (2.0 * mesh).cos() + 0.2 * (3.0 * mesh).sin()) + 0.1 * noise()
    };
    let signal: Vec<f64> = (0..samples).map(&mut value).collect();
    let csv: String = signal.iter().map(|x| format!("{x:.6}\n")).collect();
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(csv.as_bytes())?;
    let rows = signal.iter().enumerate().take(500);
    let table: String = rows.map(|(n, x)| format!("{:.9},{x:.6},{:.6}\n", n as f64 / IMPORT_RATE_HZ, -x)).collect();
    let floats: Vec<u8> = signal.iter().flat_map(|x| (*x as f32).to_le_bytes()).collect();
    let codes: Vec<u8> = signal.iter().flat_map(|x| ((x * 1000.0) as i16).to_le_bytes()).collect();
    let array = mat_array("vibration", &floats[..floats.len().min(8000)], 7);
    Ok(vec![
        ("tone.csv", csv.into_bytes()),
        ("tone.csv.gz", packed.finish()?),
        ("table.csv", format!("time,first,second\n{table}").into_bytes()),
        ("tone.wav", wav(&signal)),
        ("tone.npy", npy("<f4", &format!("({},)", signal.len()), &floats)),
        ("two.npy", npy("<i2", &format!("({}, 2)", signal.len() / 2), &codes)),
        ("plain.mat", mat_file(&[&array])),
        ("tone.mat", mat_file(&[&mat_packed(&mat_array("vibration", &floats, 7))?])),
        ("tone.uff", uff58(&signal).into_bytes()),
    ])
}

fn npy(kind: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    while (header.len() + 11) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

fn wav(signal: &[f64]) -> Vec<u8> {
    let data: Vec<u8> = signal.iter().flat_map(|x| ((x * 10_000.0) as i16).to_le_bytes()).collect();
    let mut bytes = b"RIFF".to_vec();
    bytes.extend((36 + data.len() as u32).to_le_bytes());
    bytes.extend(b"WAVEfmt ");
    bytes.extend(16_u32.to_le_bytes());
    bytes.extend([1, 0, 1, 0]);
    bytes.extend((IMPORT_RATE_HZ as u32).to_le_bytes());
    bytes.extend((2 * IMPORT_RATE_HZ as u32).to_le_bytes());
    bytes.extend([2, 0, 16, 0]);
    bytes.extend(b"data");
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(data);
    bytes
}

fn mat_element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    out.extend(data);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

/// A row vector of MATLAB level 5; `kind` 7 for f32, 2 for u8.
pub fn mat_array(name: &str, data: &[u8], kind: u32) -> Vec<u8> {
    let count = data.len() as u32 / if kind == 7 { 4 } else { 1 };
    let mut body = mat_element(6, &[7_u32.to_le_bytes(), [0; 4]].concat());
    body.extend(mat_element(5, &[1_u32.to_le_bytes(), count.to_le_bytes()].concat()));
    body.extend(mat_element(1, name.as_bytes()));
    body.extend(mat_element(kind, data));
    mat_element(14, &body)
}

/// An element, compressed.
///
/// # Errors
/// None in memory.
pub fn mat_packed(element: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(element)?;
    let packed = packed.finish()?;
    Ok([&15_u32.to_le_bytes()[..], &(packed.len() as u32).to_le_bytes(), &packed].concat())
}

/// A MATLAB level 5 file of elements.
pub fn mat_file(elements: &[&[u8]]) -> Vec<u8> {
    let mut bytes = b"MATLAB 5.0 MAT-file".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(elements.concat());
    bytes
}

fn uff58(signal: &[f64]) -> String {
    let mut text = String::from("    -1\n    58\nvibration\nNONE\nNONE\nNONE\nNONE\n");
    text += "    1         0    0         0 NONE               1   1 NONE               0   0\n";
    text +=
        &format!("         2{:>10}         1  0.00000E+00{:>13.5E}  0.00000E+00\n", signal.len(), 1.0 / IMPORT_RATE_HZ);
    for _ in 0..4 {
        text += "        17    0    0    0 NONE                 NONE\n";
    }
    for row in signal.chunks(6) {
        text += &(row.iter().map(|x| format!("{x:>13.5E}")).collect::<String>() + "\n");
    }
    text + "    -1\n"
}
