//! Foreign formats and the virtual tach: closed-form signals first, measured records where they are at hand.

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use meshband_host::import::virtual_tach::{Options, VirtualTach, virtual_tach};
use meshband_host::import::{ImportOptions, Reading, TachChoice, Unit, import, read};
use meshband_host::record::{Record, npy};
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use std::f64::consts::TAU;
use std::io::Write;
use std::path::{Path, PathBuf};

fn data(file: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(file);
    if !path.exists() {
        println!("skipped: ../shared/data/{file} is absent");
    }
    path.exists().then_some(path)
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// One little-endian MAT-file element with padding.
fn element(kind: u32, data: &[u8]) -> Vec<u8> {
    let mut out = [kind.to_le_bytes(), (data.len() as u32).to_le_bytes()].concat();
    out.extend(data);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

fn mat_array(name: &str, class: u32, kind: u32, data: &[u8], rows: u32, columns: u32) -> Vec<u8> {
    let mut body = element(6, &[class.to_le_bytes(), [0; 4]].concat());
    body.extend(element(5, &[rows.to_le_bytes(), columns.to_le_bytes()].concat()));
    body.extend(element(1, name.as_bytes()));
    body.extend(element(kind, data));
    element(14, &body)
}

fn mat_file(elements: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"MATLAB 5.0 MAT-file, made for a test".to_vec();
    bytes.resize(124, b' ');
    bytes.extend([0, 1, b'I', b'M']);
    bytes.extend(elements.concat());
    bytes
}

#[test]
fn theory_mat_takes_the_last_array_that_is_not_zero_plain_and_compressed() {
    let folder = tempfile::tempdir().unwrap();
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let zeros = mat_array("Data1", 7, 7, &floats(&[0.0; 5]), 1, 5);
    let real = mat_array("Data1", 7, 7, &floats(&[1.0, -2.5, 3.0, 4.0, 5.5]), 1, 5);
    let path = write(folder.path(), "twice.mat", &mat_file(&[zeros.clone(), real.clone()]));
    let columns = read(&path).unwrap();
    assert_eq!(columns.channels, vec![vec![1.0, -2.5, 3.0, 4.0, 5.5]]);
    assert!(columns.remarks[0].contains("more than once"));
    let again = read(&write(folder.path(), "other.mat", &mat_file(&[real.clone(), zeros.clone()]))).unwrap();
    assert_eq!(again.channels, columns.channels);

    let mut zlib = ZlibEncoder::new(Vec::new(), Compression::default());
    zlib.write_all(&real).unwrap();
    let packed = zlib.finish().unwrap();
    let mut compressed = [15_u32.to_le_bytes(), (packed.len() as u32).to_le_bytes()].concat();
    compressed.extend(&packed);
    // int16 storage of a double matrix, two columns.
    let shorts: Vec<u8> = [1_i16, 2, 3, 5, 4, -1, -2, -3, -5, -4].iter().flat_map(|v| v.to_le_bytes()).collect();
    let matrix = mat_array("xy", 6, 3, &shorts, 5, 2);
    let columns = read(&write(folder.path(), "packed.mat", &mat_file(&[compressed, matrix]))).unwrap();
    assert_eq!(columns.channels.len(), 3);
    assert_eq!(columns.channels[0][1], -2.5);
    assert_eq!(columns.channels[2], vec![-1.0, -2.0, -3.0, -5.0, -4.0]);

    assert!(read(&write(folder.path(), "zero.mat", &mat_file(&[zeros]))).unwrap_err().to_string().contains("zero"));
    let cut = mat_file(&[real]);
    let error = read(&write(folder.path(), "cut.mat", &cut[..cut.len() - 9])).unwrap_err();
    assert!(error.to_string().contains("truncated"), "{error}");
}

#[test]
fn theory_delimited_text_in_its_common_shapes() {
    let folder = tempfile::tempdir().unwrap();
    let plain = read(&write(folder.path(), "a.csv", b"a1,a2\n1.5,2\n-3e2,4\n")).unwrap();
    assert_eq!(plain.names, ["a1", "a2"]);
    assert_eq!(plain.channels, vec![vec![1.5, -300.0], vec![2.0, 4.0]]);
    let ragged = b"0;1;2;3 ;9 ;9 \n5e-005;4 ;5 ;6 \n0.0001;7;8;9 \n0.00015;1;1;1\n";
    let timed = read(&write(folder.path(), "b.csv", ragged)).unwrap();
    assert_eq!(timed.rate_hz, Some(20_000.0));
    assert_eq!(timed.channels[2], vec![3.0, 6.0, 9.0, 1.0]);
    let single = read(&write(folder.path(), "c.csv", b"-0.5\n0.25\n1\n")).unwrap();
    assert_eq!((single.channels.len(), single.rate_hz), (1, None));
    let mut gz = GzEncoder::new(Vec::new(), Compression::default());
    gz.write_all(b"x,y\n1,2\n3,4\n").unwrap();
    let gz = gz.finish().unwrap();
    assert_eq!(read(&write(folder.path(), "d.csv.gz", &gz)).unwrap().channels[1], vec![2.0, 4.0]);
    for (name, bytes, expected) in [
        ("e.csv", b"a,b\n1,2\n3\n".to_vec(), "e.csv:3"),
        ("f.csv", b"a,b\n1,2\nx,3\n".to_vec(), "'x' is no number"),
        ("g.csv", b"a,b\n1,2\n3,nan\n".to_vec(), "NaN"),
        ("h.csv", Vec::new(), "no signal"),
        ("i.csv.gz", gz[..gz.len() - 12].to_vec(), "gzip"),
        ("j.bin", vec![1, 2, 3], "is not mat"),
    ] {
        let error = read(&write(folder.path(), name, &bytes)).unwrap_err().to_string();
        assert!(error.contains(expected) && !error.contains('\n'), "{error}");
    }
}

#[test]
fn theory_npy_and_wav_and_uff58() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.npy");
    std::fs::write(&path, npy::bytes_f32(&[1.0, 2.0, 3.0, 4.0], 2)).unwrap();
    assert_eq!(read(&path).unwrap().channels, vec![vec![1.0, 3.0], vec![2.0, 4.0]]);

    let path = folder.path().join("w.wav");
    let spec = hound::WavSpec {
        channels: 2,
        sample_rate: 48_000,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut writer = hound::WavWriter::create(&path, spec).unwrap();
    for value in [16_384_i16, -32_768, 8192, 0] {
        writer.write_sample(value).unwrap();
    }
    writer.finalize().unwrap();
    let wav = read(&path).unwrap();
    assert_eq!(wav.rate_hz, Some(48_000.0));
    assert_eq!(wav.channels, vec![vec![0.5, 0.25], vec![-1.0, 0.0]]);

    let text = concat!(
        "    -1\n    58\npinion bearing\nNONE\nNONE\nNONE\nNONE\n",
        "    1         0    0         0       NONE         1   1       NONE         0   0\n",
        "         2         5         1  0.00000E+00  1.00000E-03  0.00000E+00\n",
        "        17    0    0    0                 NONE                 NONE\n",
        "        12    0    0    0                 NONE                 NONE\n",
        "         0    0    0    0                 NONE                 NONE\n",
        "         0    0    0    0                 NONE                 NONE\n",
        "  1.00000E+00-2.00000E+00  3.00000E+00\n -4.00000D+00  5.00000E-01\n    -1\n"
    );
    let uff = read(&write(folder.path(), "u.uff", text.as_bytes())).unwrap();
    assert_eq!(uff.names, ["pinion bearing 1+X"]);
    assert_eq!(uff.rate_hz, Some(1000.0));
    assert_eq!(uff.channels, vec![vec![1.0, -2.0, 3.0, -4.0, 0.5]]);
    let cut = text.replace(" -4.00000D+00  5.00000E-01\n", "");
    let error = read(&write(folder.path(), "v.uff", cut.as_bytes())).unwrap_err();
    assert!(error.to_string().contains("5 points announced, 3 found"), "{error}");
}

const RATE_HZ: f64 = 12_800.0;
const TEETH: [u32; 2] = [23, 46];

/// Mesh harmonics with shaft sidebands of a pinion whose speed swings slowly, in white noise.
/// Returns the signal and the true turns as a function of time.
fn gear_signal(seconds: f64, noise: f64, seed: u64) -> (Vec<f64>, impl Fn(f64) -> f64) {
    // 33.3 Hz, +-0.3 % at 0.7 Hz.
    let turns = |t: f64| 33.3 * t + 0.1 / (TAU * 0.7) * (TAU * 0.7 * t).sin() + 0.013;
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let normal = Normal::new(0.0, noise).unwrap();
    let signal = (0..(seconds * RATE_HZ) as usize)
        .map(|n| {
            let pinion = TAU * turns(n as f64 / RATE_HZ);
            let mesh = 23.0 * pinion;
            let swing = 1.0 + 0.3 * (0.5 * pinion + 0.4).cos() + 0.2 * (pinion + 1.0).cos();
            let wave = swing * (2.0 * mesh.cos() + 0.8 * (2.0 * mesh + 0.5).cos() + 0.3 * (3.0 * mesh).sin());
            wave + 0.3 * pinion.cos() + 1.5 * (TAU * 171.6 * n as f64 / RATE_HZ).cos() + normal.sample(&mut random)
        })
        .collect();
    (signal, turns)
}

/// Standard deviation of the pulses' timing about the true turns (a constant angle is free), s.
fn timing_error(tach: &VirtualTach, turns: impl Fn(f64) -> f64, skip: usize) -> f64 {
    let inner = &tach.edges_s[skip..tach.edges_s.len() - skip];
    let off: Vec<f64> = inner.iter().enumerate().map(|(k, &t)| turns(t) - k as f64).collect();
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    (off.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / off.len() as f64).sqrt() / 33.3
}

#[test]
fn theory_virtual_tach_follows_a_swinging_speed() {
    let (signal, turns) = gear_signal(8.0, 0.2, 3);
    for guess in [Some(760.0), Some(780.0), None] {
        let options = Options { teeth: TEETH, mesh_guess_hz: guess };
        let tach = virtual_tach("test", std::slice::from_ref(&signal), RATE_HZ, &options).unwrap();
        let q = &tach.quality;
        assert!((q.mesh_hz / (23.0 * 33.3) - 1.0).abs() < 2e-4, "{q:?}");
        let error = timing_error(&tach, &turns, 5);
        println!("guess {guess:?}: timing error {:.2} us, {q:?}", 1e6 * error);
        assert!(error < 1e-5, "{error}");
        // 0.3 % of 1998 rpm over sqrt 2.
        assert!((q.speed_std_rpm / (60.0 * 0.1 / 2.0_f64.sqrt()) - 1.0).abs() < 0.05, "{q:?}");
        assert!((q.mesh_over_pinion_line.unwrap() - 23.0).abs() < 0.05, "{q:?}");
    }
}

#[test]
fn theory_virtual_tach_predicts_its_own_jitter() {
    // Steady speed: what remains is noise. The estimate must be right within a factor of two.
    for (noise, seed) in [(0.5, 1), (2.0, 2)] {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let normal = Normal::new(0.0, noise).unwrap();
        let signal: Vec<f64> = (0..(10.0 * RATE_HZ) as usize)
            .map(|n| 2.0 * (TAU * 23.0 * 33.3 * n as f64 / RATE_HZ).cos() + normal.sample(&mut random))
            .collect();
        let options = Options { teeth: TEETH, mesh_guess_hz: Some(766.0) };
        let tach = virtual_tach("test", &[signal], RATE_HZ, &options).unwrap();
        let error = timing_error(&tach, |t| 33.3 * t, 5);
        let ratio = error / tach.quality.jitter_s;
        println!("noise {noise}: measured {:.3} us, predicted {:.3} us", 1e6 * error, 1e6 * tach.quality.jitter_s);
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
    }
}

#[test]
fn fault_virtual_tach_refuses_noise_foreign_lines_and_short_records() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(5);
    let normal = Normal::new(0.0, 1.0).unwrap();
    let noise: Vec<f64> = (0..80_000).map(|_| normal.sample(&mut random)).collect();
    for guess in [Some(766.0), None] {
        let options = Options { teeth: TEETH, mesh_guess_hz: guess };
        let error = virtual_tach("noise", std::slice::from_ref(&noise), RATE_HZ, &options).unwrap_err().to_string();
        assert!(error.contains("no trustworthy mesh line"), "{error}");
    }
    let options = Options { teeth: TEETH, mesh_guess_hz: Some(766.0) };
    let (signal, _) = gear_signal(0.5, 0.1, 1);
    assert!(virtual_tach("short", &[signal], RATE_HZ, &options).unwrap_err().to_string().contains("too short"));
    assert!(virtual_tach("tiny", &[vec![0.0; 100]], RATE_HZ, &options).is_err());
    let beyond = Options { teeth: TEETH, mesh_guess_hz: Some(6300.0) };
    assert!(virtual_tach("beyond", &[noise], RATE_HZ, &beyond).unwrap_err().to_string().contains("cannot be seen"));
}

fn options(title: &str) -> ImportOptions {
    ImportOptions {
        title: title.into(),
        reading: Reading::default(),
        override_rate: false,
        rate_hz: None,
        teeth: None,
        mesh_guess_hz: None,
        units: vec![Unit::MetrePerSecondSquared],
        channel_names: None,
        full_scale: None,
        files_are_runs: false,
        tach: TachChoice::Virtual,
        remove_mean: false,
        ..ImportOptions::default()
    }
}

#[test]
fn ref_gear0_imports_with_a_virtual_tach() {
    let files: Vec<Option<PathBuf>> = (1..=4).map(|n| data(&format!("gear0/3027_217_Data_Chan{n}.mat"))).collect();
    let Some(files) = files.into_iter().collect::<Option<Vec<_>>>() else { return };
    for guess in [Some(766.7), None] {
        let options =
            ImportOptions { rate_hz: Some(25_600.0), teeth: Some([23, 46]), mesh_guess_hz: guess, ..options("gear0") };
        let (record, summary) = import(&files, &options).unwrap();
        assert_eq!((record.runs[0].channels(), record.runs[0].samples()), (4, 282_624));
        let q = &summary.tach[0];
        println!("gear0, guess {guess:?}: {q:?}, quantisation {:?} dB", summary.quantisation_snr_db);
        // The line peaks at 766.600 Hz; the speed drifts, so the mean lies a little lower.
        assert!((q.mesh_line_hz - 766.600).abs() < 0.01, "{q:?}");
        assert!((q.mesh_hz / 766.600 - 1.0).abs() < 5e-5, "{q:?}");
        assert!((q.mesh_over_pinion_line.unwrap() - 23.0).abs() < 0.01, "{q:?}");
        assert!((0.05..0.9).contains(&q.speed_std_rpm), "{q:?}");
        let folder = tempfile::tempdir().unwrap();
        record.write(folder.path()).unwrap();
        let again = Record::read(folder.path()).unwrap();
        assert!(again.declaration.tach.as_ref().unwrap().is_virtual());
        assert_eq!(again.runs[0].codes(), record.runs[0].codes());
    }
}

#[test]
fn ref_gfd_imports_with_a_virtual_tach() {
    for (name, mesh) in [("h30hz0", 952.13), ("h30hz90", 948.06), ("b30hz50", 949.62)] {
        let Some(file) = data(&format!("gfd/{name}.csv.gz")) else { return };
        let options = ImportOptions {
            rate_hz: Some(12_800.0),
            teeth: Some([32, 80]),
            mesh_guess_hz: Some(950.0),
            units: vec![Unit::Unknown],
            ..options(name)
        };
        let (record, summary) = import(&[file], &options).unwrap();
        let q = &summary.tach[0];
        println!("{name}: {q:?}");
        assert_eq!(record.declaration.acquisition.channels, ["a1", "a2", "a3", "a4"]);
        assert!((q.mesh_hz / mesh - 1.0).abs() < 3e-4, "{q:?}");
    }
}

#[test]
fn ref_adi_and_paderborn_import_without_tach() {
    let Some(file) = data("adi/3000_GoB_GS_VHIL_WA_00lb.Wfm.csv") else { return };
    let volts =
        ImportOptions { tach: TachChoice::None, remove_mean: true, units: vec![Unit::Volt(None)], ..options("adi") };
    let (record, summary) = import(&[file], &volts).unwrap();
    assert_eq!(summary.sample_rate_hz, 20_000.0);
    assert_eq!(record.runs[0].channels(), 3);
    assert_eq!(record.declaration.acquisition.unit.as_deref(), Some("V"));
    // Unbalance at 1x: 41.8 mV.
    let line = meshband_host::spectral::line_near(&record.runs[0].signal_m_s2(0), 20_000.0, 50.0, 1.0).unwrap();
    assert!((line.amplitude - 0.0418).abs() < 0.0015, "{line:?}");
    let Some(file) = data("paderborn/N15_M07_F10_K001_1.csv") else { return };
    let (record, _) = import(
        std::slice::from_ref(&file),
        &ImportOptions { tach: TachChoice::None, rate_hz: Some(64_000.0), ..options("paderborn") },
    )
    .unwrap();
    assert_eq!(record.runs[0].channels(), 1);
    let error =
        import(&[file], &ImportOptions { tach: TachChoice::None, ..options("no rate") }).unwrap_err().to_string();
    assert!(error.contains("--rate"), "{error}");
}
