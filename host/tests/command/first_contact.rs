//! Files as people have them: units, time columns, counters, several header rows, blanks, LabVIEW, structures. One
//! test per situation of `book/src/howto/what-i-have.md`, and a campaign of generated files whose content is known.

use crate::common::{accepted, folder, refused, text};

use meshband_host::record::Record;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const RATE_HZ: f64 = 12_800.0;
const GRAVITY: f64 = 9.80665;

/// Sample `i` of channel `c`, m/s2.
fn sample(c: usize, i: usize) -> f64 {
    let t = i as f64 / RATE_HZ;
    (c + 1) as f64 * (3.0 * (500.0 * t * std::f64::consts::TAU).sin() + 0.5 * (0.7 * i as f64 + 1.3 * c as f64).sin())
}

/// Volts of a key at 25 turns per second.
fn key(i: usize) -> f64 {
    if (25.0 * i as f64 / RATE_HZ).fract() < 0.2 { 5.0 } else { 0.0 }
}

/// Text with a head and one line per sample.
fn table(head: &str, rows: usize, row: impl Fn(usize) -> String) -> String {
    (0..rows).fold(head.to_owned(), |mut out, i| {
        let _ = writeln!(out, "{}", row(i));
        out
    })
}

fn write(folder: &Path, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, content).expect("written");
    path
}

/// Imports by the command and gives the summary and the record.
fn imported(folder: &Path, file: &Path, options: &[&str]) -> (serde_json::Value, Record) {
    let (out, json) = (folder.join("out"), folder.join("out.json"));
    let (file, record, summary) = (text(file), text(&out), text(&json));
    let mut arguments = vec!["import", &file, "-o", &record, "--json", &summary, "--force"];
    arguments.extend(options);
    accepted(&arguments);
    (
        serde_json::from_slice(&std::fs::read(&json).expect("json")).expect("valid"),
        Record::read(&out).expect("a record"),
    )
}

fn near(record: &Record, channel: usize, expected: impl Fn(usize) -> f64) {
    let signal = record.runs[0].signal_m_s2(channel);
    for (i, found) in signal.iter().enumerate().take(200) {
        assert!((found - expected(i)).abs() < 2e-3, "channel {channel}, sample {i}: {found} for {}", expected(i));
    }
}

fn refusal(folder: &Path, file: &Path, options: &[&str], expected: &[&str]) {
    let (file, out) = (text(file), text(&folder.join("none")));
    let mut arguments = vec!["import", &file, "-o", &out, "--no-tach"];
    arguments.extend(options);
    refused(&arguments, expected);
}

#[test]
fn regress_time_columns_in_milliseconds_and_microseconds() {
    let folder = folder("contact-time");
    for (head, unit) in
        [("Time (ms)", 1e3), ("time_ms", 1e3), ("Zeit [us]", 1e6), ("t [s]", 1.0), ("timestamp_ns", 1e9)]
    {
        let content = table(&format!("{head},A1,A2\n"), 2000, |i| {
            format!("{:.9},{:.6},{:.6}", unit * i as f64 / RATE_HZ, sample(0, i), sample(1, i))
        });
        let (summary, _) = imported(&folder, &write(&folder, "time.csv", content), &["--no-tach"]);
        assert_eq!(summary["sample_rate_hz"], RATE_HZ, "{head}");
        assert_eq!(summary["channels"], serde_json::json!(["A1", "A2"]), "{head}");
    }
    let bare = table("Time,A1\n", 2000, |i| format!("{:.6},{:.6}", 1e3 * i as f64 / RATE_HZ, sample(0, i)));
    let bare = write(&folder, "bare.csv", bare);
    refusal(&folder, &bare, &[], &["states no unit", "--time-unit"]);
    assert_eq!(imported(&folder, &bare, &["--no-tach", "--time-unit", "ms"]).0["sample_rate_hz"], RATE_HZ);
}

#[test]
fn regress_counters_are_no_time_and_coarse_stamps_are_no_channel() {
    let folder = folder("contact-counter");
    let content = table(",Time,A1,A2,Tach\n", 8000, |i| {
        format!("{i},{:.8},{:.5},{:.5},{:.1}", i as f64 / RATE_HZ, sample(0, i), sample(1, i), key(i))
    });
    let file = write(&folder, "pandas.csv", content);
    let (summary, _) = imported(&folder, &file, &["--tach", "Tach", "--teeth", "20,40"]);
    assert_eq!((&summary["sample_rate_hz"], &summary["channels"]), (&RATE_HZ.into(), &serde_json::json!(["A1", "A2"])));
    let lost = table("index,A1\n", 300, |i| format!("{},{:.5}", i + if i < 100 { 0 } else { 4 }, sample(0, i)));
    refusal(
        &folder,
        &write(&folder, "lost.csv", lost),
        &["--rate", "12800"],
        &["counter 'index'", "value 101", "4 samples are missing"],
    );
    let coarse =
        table("Time,A1\n", 8000, |i| format!("{:.3},{:.5}", (1e3 * i as f64 / RATE_HZ).floor() / 1e3, sample(0, i)));
    let (summary, _) = imported(&folder, &write(&folder, "coarse.csv", coarse), &["--no-tach", "--rate", "12800"]);
    assert_eq!(summary["channels"], serde_json::json!(["A1"]));
    assert!(summary["remarks"].to_string().contains("too coarse"), "{summary}");
    let angle = table("angle,A1\n", 300, |i| format!("{:.5},{:.5}", 0.7 * i as f64, sample(0, i)));
    let (summary, record) = imported(&folder, &write(&folder, "angle.csv", angle), &["--no-tach", "--rate", "12800"]);
    assert_eq!((&summary["channels"], &summary["beside"]), (&serde_json::json!(["A1"]), &serde_json::json!(["angle"])));
    assert!((record.runs[0].beside[0][10] - 7.0).abs() < 1e-5);
}

#[test]
fn regress_units_of_the_file_hold_and_unknown_ones_are_said() {
    let folder = folder("contact-unit");
    let content = table("Time [s],A1 [g],A2 [mg],Torque [N m],Mic [Pa]\n", 2000, |i| {
        let (a, b) = (sample(0, i) / GRAVITY, 1e3 * sample(1, i) / GRAVITY);
        format!("{:.9},{a:.7},{b:.4},{:.3},{:.3}", i as f64 / RATE_HZ, 20.0 + 0.01 * i as f64, 0.5)
    });
    let file = write(&folder, "units.csv", content);
    let (summary, record) = imported(&folder, &file, &["--no-tach", "--float"]);
    assert_eq!((&summary["unit"], &summary["channels"]), (&"m/s2".into(), &serde_json::json!(["A1", "A2"])));
    near(&record, 0, |i| sample(0, i));
    near(&record, 1, |i| sample(1, i));
    let beside = &record.runs[0].declaration.beside;
    assert_eq!((beside[0].quantity.as_deref(), beside[0].unit.as_str()), (Some("torque"), "N m"));
    assert!((record.runs[0].beside[0][100] - 21.0).abs() < 1e-5);
    refusal(&folder, &file, &["--unit", "V"], &["--unit", "contradicts", "--override-unit"]);
    let rows = table("Time,A1,A2\ns,g,mm/s2\n", 500, |i| {
        format!("{:.9},{:.7},{:.3}", i as f64 / RATE_HZ, sample(0, i) / GRAVITY, 1e3 * sample(1, i))
    });
    let (_, record) = imported(&folder, &write(&folder, "rows.csv", rows), &["--no-tach", "--float"]);
    near(&record, 0, |i| sample(0, i));
    near(&record, 1, |i| sample(1, i));
    let bare = table("A1\n", 500, |i| format!("{:.6}", sample(0, i)));
    let (summary, _) = imported(&folder, &write(&folder, "bare.csv", bare), &["--no-tach", "--rate", "12800"]);
    assert_eq!(summary["unit"], "unknown");
    assert!(summary["remarks"].to_string().contains("--unit"), "{summary}");
}

#[test]
fn regress_columns_are_chosen_and_left_out_by_name_and_number() {
    let folder = folder("contact-columns");
    let content = table("speed,torque,x,y\n", 8000, |i| {
        format!("{:.1},{:.4},{:.6},{:.6}", key(i) / 5.0, 10.0, sample(0, i) / GRAVITY, sample(1, i) / GRAVITY)
    });
    let file = write(&folder, "bench.csv", content);
    let base = ["--rate", "12800", "--tach", "speed", "--teeth", "20,40", "--unit", "g"];
    let (summary, record) = imported(&folder, &file, &base);
    assert_eq!(
        (&summary["channels"], &summary["beside"]),
        (&serde_json::json!(["x", "y"]), &serde_json::json!(["torque"]))
    );
    near(&record, 1, |i| sample(1, i));
    for (option, value, left) in
        [("--columns", "y", vec!["y"]), ("--columns", "3,4", vec!["x", "y"]), ("--skip", "torque,3", vec!["y"])]
    {
        let (summary, _) = imported(&folder, &file, &[&base[..], &[option, value]].concat());
        assert_eq!(summary["channels"], serde_json::json!(left), "{option} {value}");
    }
    refusal(&folder, &file, &["--rate", "12800", "--columns", "z"], &["--columns", "'z' is no column", "3 'x'"]);
}

#[test]
fn regress_text_as_programs_write_it() {
    let folder = folder("contact-text");
    let two = |i: usize| (sample(0, i), sample(1, i));
    let blanks = table("", 1000, |i| format!("  {:14.7e}  {:14.7e}", two(i).0, two(i).1));
    let commented = table("# x y\n", 1000, |i| format!("{:.9e} {:.9e}", two(i).0, two(i).1));
    let tabs = table("Title:\tbench 3\nSampling frequency\t12800 Hz\n\nx\ty\n", 1000, |i| {
        format!("{:.6}\t{:.6}", two(i).0, two(i).1)
    });
    let quoted = table("\"x\";\"y\"\n", 1000, |i| format!("\"{:.6}\";\"{:.6}\"", two(i).0, two(i).1).replace('.', ","));
    let rated = table("12800.0,12800.0\n", 1000, |i| format!("{:.6},{:.6}", two(i).0, two(i).1));
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(tabs.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    let empatica =
        table("1550002000.0,1550002000.0\n12800.0,12800.0\n", 1000, |i| format!("{:.6},{:.6}", two(i).0, two(i).1));
    let files = [
        ("savetxt.txt", blanks.clone().into_bytes(), true),
        ("ascii.dat", blanks.into_bytes(), true),
        ("named.txt", commented.into_bytes(), true),
        ("title.txt", tabs.into_bytes(), false),
        ("wide.txt", wide, false),
        ("quoted.csv", quoted.into_bytes(), true),
        ("rated.csv", rated.into_bytes(), false),
        ("wearable.csv", empatica.into_bytes(), false),
    ];
    for (name, content, needs_rate) in files {
        let file = write(&folder, name, content);
        let options: &[&str] = if needs_rate { &["--rate", "12800"] } else { &[] };
        let (summary, record) = imported(&folder, &file, &[&["--no-tach", "--unit", "m/s2"], options].concat());
        assert_eq!(
            (&summary["sample_rate_hz"], &summary["samples"]),
            (&RATE_HZ.into(), &serde_json::json!([1000])),
            "{name}"
        );
        near(&record, 0, |i| sample(0, i));
        near(&record, 1, |i| sample(1, i));
    }
    let clock = table("", 2560, |i| {
        format!("9,20,24,{:.0},{:.3},{:.3}", 212_540.0 + 1e6 * i as f64 / 25_600.0, sample(0, i), sample(1, i))
    });
    let (summary, _) =
        imported(&folder, &write(&folder, "acc_00001.csv", clock), &["--no-tach", "--unit", "g", "--rate", "25600"]);
    assert_eq!(summary["channels"].as_array().map(Vec::len), Some(2));
    let dates = table("Timestamp,A1\n", 1000, |i| {
        format!("2024-03-01 12:00:00.{:06.0},{:.5}", 1e6 * i as f64 / RATE_HZ, sample(0, i))
    });
    assert_eq!(imported(&folder, &write(&folder, "iso.csv", dates), &["--no-tach"]).0["sample_rate_hz"], RATE_HZ);
    let latin = table("Time [s],A1 [m/s\u{b2}]\n", 1000, |i| format!("{:.9},{:.5}", i as f64 / RATE_HZ, sample(0, i)));
    let latin: Vec<u8> = latin.chars().map(|c| c as u8).collect();
    assert_eq!(imported(&folder, &write(&folder, "latin.csv", latin), &["--no-tach"]).0["unit"], "m/s2");
}

#[test]
fn regress_labview_measurement_files() {
    let folder = folder("contact-lvm");
    let head = "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t\
     ,\nMulti_Headings\tNo\nX_Columns\tNo\n\
                Time_Pref\tAbsolute\n***End_of_Header***\t\n\t\nChannels\t2\t\nSamples\t1000\t1000\t\n\
                Y_Unit_Label\tg\tg\t\nX_Dimension\tTime\tTime\t\n\
                X0\t0,0\t0,0\t\nDelta_X\t7,812500E-5\t7,812500E-5\t\n***End_of_Header***\t\t\t\nX_Value\tA1\tA2\t\
                Comment\n";
    let body = table("", 1000, |i| format!("\t{:.7}\t{:.7}", sample(0, i) / GRAVITY, sample(1, i) / GRAVITY))
        .replace('.', ",");
    for name in ["a.lvm", "a.txt"] {
        let (summary, record) =
            imported(&folder, &write(&folder, name, format!("{head}{body}")), &["--no-tach", "--float"]);
        assert_eq!((&summary["sample_rate_hz"], &summary["unit"]), (&RATE_HZ.into(), &"m/s2".into()));
        near(&record, 1, |i| sample(1, i));
    }
    let cut = &head[..200];
    refusal(&folder, &write(&folder, "cut.lvm", cut), &[], &["cut.lvm", "LabVIEW"]);
}

#[test]
fn regress_wav_of_streams_long_files_and_doubles() {
    let folder = folder("contact-wav");
    let codes: Vec<u8> =
        (0..1000).flat_map(|i| ((sample(0, i) / 10.0 * 32_767.0).round() as i16).to_le_bytes()).collect();
    let doubles: Vec<u8> = (0..1000).flat_map(|i| sample(0, i).to_le_bytes()).collect();
    let form = |kind: u16, bits: u16| {
        let block = bits / 8;
        let mut out = b"WAVEfmt ".to_vec();
        out.extend(16_u32.to_le_bytes());
        out.extend([kind.to_le_bytes(), 1_u16.to_le_bytes()].concat());
        out.extend([12_800_u32.to_le_bytes(), (12_800 * u32::from(block)).to_le_bytes()].concat());
        out.extend([block.to_le_bytes(), bits.to_le_bytes()].concat());
        out
    };
    let pipe = [b"RIFF\xff\xff\xff\xff", &form(1, 16)[..], b"data\xff\xff\xff\xff", &codes[..]].concat();
    let long = [
        b"RF64\xff\xff\xff\xffWAVEds64\x1c\0\0\0\0\0\0\0\0\0\0\0",
        &2000_u64.to_le_bytes()[..],
        &1000_u64.to_le_bytes(),
        &[0; 4],
        &form(1, 16)[4..],
        b"data\xff\xff\xff\xff",
        &codes,
    ]
    .concat();
    let double = [b"RIFF\0\0\0\0", &form(3, 64)[..], b"data", &8000_u32.to_le_bytes(), &doubles].concat();
    for (name, bytes, scale) in [("pipe.wav", pipe, 10.0), ("long.wav", long, 10.0), ("double.wav", double, 1.0)] {
        let (summary, record) = imported(&folder, &write(&folder, name, bytes), &["--no-tach", "--float"]);
        assert_eq!((&summary["samples"], &summary["unit"]), (&serde_json::json!([1000]), &"unknown".into()), "{name}");
        near(&record, 0, |i| sample(0, i) / scale);
    }
    let coded = [b"RIFF\0\0\0\0", &form(7, 8)[..], b"data\x08\0\0\0", &[1; 8][..]].concat();
    refusal(&folder, &write(&folder, "mu.wav", coded), &[], &["mu.wav", "mu-law"]);
}

#[test]
fn regress_files_that_are_not_read_say_what_they_are() {
    let folder = folder("contact-foreign");
    for (name, bytes, words) in [
        ("a.dat", &b"MDF     3.30    Target"[..], ["ASAM MDF 3.30", "asammdf"]),
        ("b.mf4", b"UnFinMF 4.10    Target", ["not closed", "asammdf"]),
        ("a.parquet", b"PAR1abcdPAR1", ["Parquet", "not read"]),
        ("a.xlsx", b"PK\x03\x04aaaa", ["spreadsheet", "csv"]),
        ("a.pkl", b"\x80\x04\x95abc", ["pickle", "numpy.save"]),
        ("a.nc", b"CDF\x01abc", ["NetCDF", "nccopy"]),
        ("a.xyz", b"\x01\x02\x03", ["is not mat", "export"]),
    ] {
        refusal(&folder, &write(&folder, name, bytes), &[], &words);
    }
}

#[test]
fn theory_what_is_exported_is_read_back_equal() {
    let folder = folder("contact-export");
    let content = table("Time [s],A1 [g],A2 [g]\n", 3000, |i| {
        format!("{:.9},{:.7},{:.7}", i as f64 / RATE_HZ, sample(0, i) / GRAVITY, sample(1, i) / GRAVITY)
    });
    let (_, record) = imported(&folder, &write(&folder, "source.csv", content), &["--no-tach"]);
    let source = text(&folder.join("source"));
    let _ = std::fs::remove_dir_all(&source);
    std::fs::rename(folder.join("out"), &source).expect("moved");
    for (format, ending, more) in [
        ("csv", "csv", &[][..]),
        ("mat", "mat", &[]),
        ("uff58", "uff", &[]),
        ("wav", "wav", &["--unit", "m/s2"]),
        ("npy", "npy", &["--unit", "m/s2", "--rate", "12800"]),
        ("mf4", "mf4", &[]),
        ("parquet", "parquet", &[]),
    ] {
        let file = folder.join(format!("back.{ending}"));
        accepted(&["export", &source, "--to", format, "-o", &text(&file), "--force"]);
        let full_scale = record.declaration.acquisition.full_scale_m_s2.to_string();
        let (summary, back) = imported(&folder, &file, &[&["--no-tach", "--full-scale", &full_scale], more].concat());
        assert_eq!((&summary["sample_rate_hz"], &summary["unit"]), (&RATE_HZ.into(), &"m/s2".into()), "{format}");
        assert_eq!(back.runs[0].codes(), record.runs[0].codes(), "{format}");
    }
    refused(&["export", &source, "--to", "csv", "-o", &text(&folder.join("x.csv")), "--run", "7"], &["no run 7"]);
}

#[test]
fn regress_rates_in_free_text_are_read_as_people_write_them() {
    let folder = folder("contact-free-text");
    let file = |name: &str, above: &str| {
        let content = table(&format!("{above}\nA1,A2\n"), 2000, |i| format!("{:.6},{:.6}", sample(0, i), sample(1, i)));
        write(&folder, name, content)
    };
    for above in [
        "# dt = 7.8125e-5",
        "Sampling interval: 7.8125E-05 s",
        "sampling_interval_ms: 0.078125",
        "Sampling rate: 12 800 Hz",
        "Sampling rate: 12.800 Hz",
        "Sampling rate: 12.8k",
        "Max. frequency 5000 Hz, sampling rate 2.56 x = 12800 Hz",
    ] {
        let (summary, _) = imported(&folder, &file("rate.csv", above), &["--no-tach"]);
        assert_eq!(summary["sample_rate_hz"], RATE_HZ, "{above}");
    }
    let two = file("two.csv", "# fs: 12800 Hz\n# fs: 51200 Hz");
    refusal(&folder, &two, &[], &["two.csv", "--rate"]);
    let (summary, _) = imported(&folder, &two, &["--no-tach", "--rate", "12800"]);
    assert!(summary["remarks"].to_string().contains("lines 1 and 2 state two sampling rates"), "{summary}");
}

#[test]
fn regress_amounts_per_time_and_directions_are_no_time() {
    let folder = folder("contact-per-time");
    let content = table("Time (s),A1 (g),Wind (km/h),Oil (l/min),Air (kg/h)\n", 2000, |i| {
        let wind = 30.0 + sample(1, i);
        format!("{:.9},{:.7},{wind:.3},{:.3},{:.3}", i as f64 / RATE_HZ, sample(0, i) / GRAVITY, 5.0, 0.01 * i as f64)
    });
    let (summary, record) = imported(&folder, &write(&folder, "flow.csv", content), &["--no-tach", "--float"]);
    assert_eq!((&summary["sample_rate_hz"], &summary["channels"]), (&RATE_HZ.into(), &serde_json::json!(["A1"])));
    assert_eq!(summary["beside"], serde_json::json!(["Wind", "Oil", "Air (kg/h)"]));
    near(&record, 0, |i| sample(0, i));
    let content = table("Time (s),Bearing 1 (V),Bearing 1 (H),Bearing 1 (A)\n", 2000, |i| {
        format!("{:.9},{:.7},{:.7},{:.7}", i as f64 / RATE_HZ, sample(0, i), sample(1, i), sample(2, i))
    });
    let file = write(&folder, "directions.csv", content);
    let (summary, record) = imported(&folder, &file, &["--no-tach", "--float", "--unit", "m/s2"]);
    let names = serde_json::json!(["Bearing 1 (V)", "Bearing 1 (H)", "Bearing 1 (A)"]);
    assert_eq!((&summary["sample_rate_hz"], &summary["channels"]), (&RATE_HZ.into(), &names));
    near(&record, 1, |i| sample(1, i));
}

#[test]
fn regress_dates_with_western_zones_month_names_and_colons() {
    let folder = folder("contact-dates");
    let forms: [fn(usize) -> String; 5] = [
        |i| format!("2024-03-01T12:00:{:012.9}-05:00", i as f64 / RATE_HZ),
        |i| format!("2024-03-01 12:00:{:012.9} -0500", i as f64 / RATE_HZ),
        |i| format!("01-Mar-2024 12:00:{:012.9}", i as f64 / RATE_HZ),
        |i| format!("59:{:012.9}", i as f64 / RATE_HZ),
        |i| format!("12:00:00:{:09}", 78_125 * i),
    ];
    for form in forms {
        let content = table("Time,A1\n", 2000, |i| format!("{},{:.6}", form(i), sample(0, i)));
        let (summary, _) = imported(&folder, &write(&folder, "dates.csv", content), &["--no-tach"]);
        let found = (&summary["sample_rate_hz"], &summary["channels"]);
        assert_eq!(found, (&RATE_HZ.into(), &serde_json::json!(["A1"])), "{}", form(1));
    }
}

#[test]
fn regress_a_first_row_that_counts_the_columns_is_no_sample() {
    let folder = folder("contact-pandas");
    let plain = table("0,1\n", 2000, |i| format!("{:.6},{:.6}", sample(0, i), sample(1, i)));
    let index = table(",0,1\n", 2000, |i| format!("{i},{:.6},{:.6}", sample(0, i), sample(1, i)));
    for (name, content) in [("plain.csv", plain), ("index.csv", index)] {
        let options = ["--no-tach", "--float", "--rate", "12800"];
        let (summary, record) = imported(&folder, &write(&folder, name, content), &options);
        assert_eq!(summary["samples"], serde_json::json!([2000]), "{name}");
        assert_eq!(summary["channels"], serde_json::json!(["column 0", "column 1"]), "{name}");
        near(&record, 1, |i| sample(1, i));
    }
    // Time from 0 beside a cosine begins with the same row.
    let cosine = table("", 2000, |i| format!("{},{}", i as f64 / RATE_HZ, (0.7 * i as f64).cos()));
    let (summary, _) = imported(&folder, &write(&folder, "cosine.csv", cosine), &["--no-tach"]);
    assert_eq!((&summary["sample_rate_hz"], &summary["samples"]), (&RATE_HZ.into(), &serde_json::json!([2000])));
}

#[test]
fn regress_labview_files_with_a_time_column_for_every_channel() {
    let folder = folder("contact-lvm-multi");
    let head = "LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n\
                Multi_Headings\tYes\nX_Columns\tMulti\nTime_Pref\tAbsolute\n***End_of_Header***\t\n\t\n\
                Channels\t2\t\t\t\nSamples\t1000\t\t1000\t\nDate\t2016/08/23\t\t2016/08/23\t\n\
                Y_Unit_Label\tVolts\t\tg\t\nX_Dimension\tTime\t\tTime\t\n\
                X0\t0.0E+0\t\t0.0E+0\t\nDelta_X\t7.8125E-5\t\t7.8125E-5\t\n***End_of_Header***\t\t\t\t\n\
                X_Value\tVoltage\tX_Value\tAcceleration\tComment\n";
    let content = table(head, 1000, |i| {
        let time = i as f64 / RATE_HZ;
        format!("{time:.9}\t{:.1}\t{time:.9}\t{:.7}", key(i), sample(0, i) / GRAVITY)
    });
    let (summary, record) = imported(&folder, &write(&folder, "multi.lvm", content), &["--no-tach", "--float"]);
    assert_eq!((&summary["sample_rate_hz"], &summary["unit"]), (&RATE_HZ.into(), &"m/s2".into()));
    assert_eq!(summary["channels"], serde_json::json!(["Acceleration"]));
    assert_eq!(summary["beside"], serde_json::json!(["Voltage"]));
    near(&record, 0, |i| sample(0, i));
}

#[test]
fn regress_true_and_false_are_one_and_zero() {
    let folder = folder("contact-truth");
    let content = table("Time (s),A1,Key\n", 2000, |i| {
        let on = if key(i) > 2.5 { "True" } else { "False" };
        format!("{:.9},{:.7},{on}", i as f64 / RATE_HZ, sample(0, i))
    });
    let (summary, record) = imported(&folder, &write(&folder, "key.csv", content), &["--no-tach", "--float"]);
    assert_eq!(summary["channels"], serde_json::json!(["A1", "Key"]));
    near(&record, 1, |i| key(i) / 5.0);
}

#[test]
fn fault_a_file_without_a_readable_row_is_refused_at_its_first_row() {
    let folder = folder("contact-unreadable");
    for rows in [50, 2500] {
        let content = table("Time,A1\n", rows, |i| format!("{i}x,{:.5}", sample(0, i)));
        let file = write(&folder, "unreadable.csv", content);
        refusal(&folder, &file, &["--rate", "12800"], &["unreadable.csv:2", "'0x' is no number"]);
    }
}

#[test]
fn regress_sensitivities_and_teeth_are_read_as_they_are_written() {
    let folder = folder("as-written");
    let rows = table("time,a,b,key\n", 20_000, |i| {
        format!("{},{},{},{}", i as f64 / RATE_HZ, sample(0, i), sample(1, i), key(i))
    });
    let file = write(&folder, "own.csv", rows);
    refusal(&folder, &file, &["--volt-per-g", "0.1,0.1"], &["--volt-per-g", "2 values for 3 channels"]);
    let (summary, _) = imported(&folder, &file, &["--no-tach", "--volt-per-g", "100", "--columns", "a,b"]);
    assert!(summary["remarks"].to_string().contains("0.001 to 10 V per g"), "{}", summary["remarks"]);
    let (_, record) = imported(&folder, &file, &["--tach", "key", "--teeth", "23/61", "--unit", "m/s2"]);
    assert_eq!(record.declaration.teeth(), Some([23, 61]));
    refusal(&folder, &file, &["--teeth", "23:61"], &["two tooth counts", "as 21,64"]);
}

#[test]
fn regress_few_steps_of_the_files_own_numbers_are_said() {
    let folder = folder("few-steps");
    // A channel of three steps beside one of many: the record's own codes are finer than the file's.
    let rows = table("time,a,b\n", 20_000, |i| {
        format!("{},{},{}", i as f64 / RATE_HZ, sample(0, i), 0.5 * (2.0 * sample(0, i) / 3.5).round())
    });
    let file = write(&folder, "own.csv", rows);
    let (summary, _) = imported(&folder, &file, &["--no-tach", "--unit", "m/s2"]);
    let remarks = summary["remarks"].to_string();
    assert!(remarks.contains("channel b") && remarks.contains("steps of the file's own numbers"), "{remarks}");
    assert!(!remarks.contains("channel a:"), "{remarks}");
    let figure = |c: usize| summary["quantisation_snr_db"][c].as_f64().expect("a figure");
    assert!(figure(0) > 60.0 && figure(1) < 25.0, "{} and {}", figure(0), figure(1));
}
