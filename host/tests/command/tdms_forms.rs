//! TDMS files written byte by byte: scales at channel and group, raw data of DAQmx, rates and starts of their own.

use crate::common::{folder, refused, text};
use meshband_host::import::{Reading, read, read_as};
use std::path::PathBuf;

/// A value of a property.
#[derive(Clone)]
enum Value<'a> {
    Number(f64),
    Whole(u32),
    Text(&'a str),
}

fn string(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

/// One object's metadata: path, index of its raw data, properties.
fn object(path: &str, index: &[u8], properties: &[(&str, Value)]) -> Vec<u8> {
    let mut out = [string(path), index.to_vec(), (properties.len() as u32).to_le_bytes().to_vec()].concat();
    for (name, value) in properties {
        out.extend(string(name));
        match value {
            Value::Number(number) => out.extend([&10_u32.to_le_bytes()[..], &number.to_le_bytes()].concat()),
            Value::Whole(number) => out.extend([7_u32.to_le_bytes(), number.to_le_bytes()].concat()),
            Value::Text(text) => out.extend([0x20_u32.to_le_bytes().to_vec(), string(text)].concat()),
        }
    }
    out
}

/// No raw data.
fn none() -> Vec<u8> {
    u32::MAX.to_le_bytes().to_vec()
}

/// Contiguous numbers of a type.
fn plain(kind: u32, count: u64) -> Vec<u8> {
    [&20_u32.to_le_bytes()[..], &kind.to_le_bytes(), &1_u32.to_le_bytes(), &count.to_le_bytes()].concat()
}

/// One 16-bit scaler at `offset` of rows of `width` bytes.
fn daqmx(count: u64, offset: u32, width: u32) -> Vec<u8> {
    let mut out = [0x1269_u32, u32::MAX, 1].iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    out.extend(count.to_le_bytes());
    out.extend([1, 3, 0, offset, 0, 0, 1, width].iter().flat_map(|word: &u32| word.to_le_bytes()));
    out
}

fn segment(objects: &[Vec<u8>], raw: &[u8], flags: u32) -> Vec<u8> {
    let metadata = [&(objects.len() as u32).to_le_bytes()[..], &objects.concat()].concat();
    let mut out = b"TDSm".to_vec();
    out.extend((0xE | flags).to_le_bytes());
    out.extend(4713_u32.to_le_bytes());
    out.extend(((metadata.len() + raw.len()) as u64).to_le_bytes());
    out.extend((metadata.len() as u64).to_le_bytes());
    [out, metadata, raw.to_vec()].concat()
}

fn written(folder: &str, name: &str, bytes: &[u8]) -> PathBuf {
    let path = self::folder(folder).join(name);
    std::fs::write(&path, bytes).expect("written");
    path
}

fn code(i: usize) -> i16 {
    ((37 * i) % 2001) as i16 - 1000
}

const DAQMX: u32 = 1 << 7;

#[test]
fn regress_scales_without_a_count_and_at_the_group() {
    let raw: Vec<u8> = (0..500).flat_map(|i| code(i).to_le_bytes()).collect();
    let linear = || {
        vec![
            ("NI_Scale[0]_Scale_Type", Value::Text("Linear")),
            ("NI_Scale[0]_Linear_Slope", Value::Number(0.001)),
            ("NI_Scale[0]_Linear_Y_Intercept", Value::Number(0.5)),
        ]
    };
    let own =
        [vec![("wf_increment", Value::Number(1.0 / 12_800.0)), ("unit_string", Value::Text("g"))], linear()].concat();
    let at_channel = segment(&[object("/'g'/'A'", &plain(2, 500), &own)], &raw, 0);
    let at_group = segment(
        &[
            object(
                "/'g'",
                &none(),
                &[linear(), vec![("wf_increment", Value::Number(1.0 / 12_800.0)), ("unit_string", Value::Text("g"))]]
                    .concat(),
            ),
            object("/'g'/'A'", &plain(2, 500), &[]),
        ],
        &raw,
        0,
    );
    for (name, bytes) in [("channel.tdms", at_channel), ("group.tdms", at_group)] {
        let columns = read(&written("tdms-scales", name, &bytes)).expect(name);
        assert_eq!((columns.rate_hz, columns.units[0].as_deref()), (Some(12_800.0), Some("g")), "{name}");
        for (i, x) in columns.channels[0].iter().enumerate() {
            assert!((x - (0.001 * f64::from(code(i)) + 0.5)).abs() < 1e-12, "{name}, {i}: {x}");
        }
    }
}

#[test]
fn theory_raw_data_of_daqmx_pass_their_scalers_and_scales() {
    let rows = 400;
    let raw: Vec<u8> = (0..rows).flat_map(|i| [code(i), code(i + 7)]).flat_map(i16::to_le_bytes).collect();
    let scales = || {
        vec![
            ("NI_Number_Of_Scales", Value::Whole(2)),
            ("NI_Scale[1]_Scale_Type", Value::Text("Polynomial")),
            ("NI_Scale[1]_Polynomial_Coefficients_Size", Value::Whole(3)),
            ("NI_Scale[1]_Polynomial_Coefficients[0]", Value::Number(0.25)),
            ("NI_Scale[1]_Polynomial_Coefficients[1]", Value::Number(2e-3)),
            ("NI_Scale[1]_Polynomial_Coefficients[2]", Value::Number(1e-8)),
            ("NI_Scale[1]_Polynomial_Input_Source", Value::Whole(0)),
            ("wf_increment", Value::Number(1.0 / 51_200.0)),
        ]
    };
    let objects =
        [object("/'m'/'ai0'", &daqmx(100, 0, 4), &scales()), object("/'m'/'ai1'", &daqmx(100, 2, 4), &scales())];
    let bytes = segment(&objects, &raw, DAQMX);
    let columns = read(&written("tdms-daqmx", "raw.tdms", &bytes)).expect("readable");
    assert_eq!(
        (columns.names.as_slice(), columns.rate_hz),
        (&["ai0".to_owned(), "ai1".to_owned()][..], Some(51_200.0))
    );
    for (i, (a, b)) in columns.channels[0].iter().zip(&columns.channels[1]).enumerate() {
        let scaled = |x: i16| 0.25 + 2e-3 * f64::from(x) + 1e-8 * f64::from(x) * f64::from(x);
        assert!((a - scaled(code(i))).abs() < 1e-12 && (b - scaled(code(i + 7))).abs() < 1e-12, "{i}: {a} {b}");
    }
    // A logger that was stopped: the last row is not whole.
    let cut = segment(&objects, &raw[..4 * 250 + 1], DAQMX);
    assert_eq!(read(&written("tdms-daqmx", "cut.tdms", &cut)).expect("readable").channels[0].len(), 250);
    // A scaler beyond its buffer, and a scale of an input that is none.
    let beyond = segment(&[object("/'m'/'ai0'", &daqmx(100, 3, 4), &scales())], &raw, DAQMX);
    let error = read(&written("tdms-daqmx", "beyond.tdms", &beyond)).unwrap_err().to_string();
    assert!(error.contains("outside of its buffer"), "{error}");
}

#[test]
fn regress_signals_of_other_rates_and_starts_are_never_laid_side_by_side() {
    let of = |count: usize| (0..count).flat_map(|i| (0.3 * i as f64).sin().to_le_bytes()).collect::<Vec<u8>>();
    let channel = |name: &str, count: u64, rate: f64, offset: f64| {
        object(
            name,
            &plain(10, count),
            &[("wf_increment", Value::Number(1.0 / rate)), ("wf_start_offset", Value::Number(offset))],
        )
    };
    let rates = [channel("/'g'/'Key'", 4000, 51_200.0, 0.0), channel("/'g'/'A0'", 1000, 12_800.0, 0.0)];
    let file = written("tdms-rates", "rates.tdms", &segment(&rates, &[of(4000), of(1000)].concat(), 0));
    let out = text(&folder("tdms-rates-out").join("record"));
    refused(
        &["import", &text(&file), "-o", &out, "--no-tach"],
        &["not sampled together", "51200 Hz", "12800 Hz", "--columns"],
    );
    let chosen = Reading { columns: vec!["A0".into()], ..Reading::default() };
    assert_eq!(read_as(&file, &chosen).expect("readable").rate_hz, Some(12_800.0));
    let apart = read_as(&file, &Reading { tach: vec!["Key".into()], ..Reading::default() }).expect("readable");
    assert_eq!((apart.names.as_slice(), apart.apart[0].rate_hz), (&["A0".to_owned()][..], Some(51_200.0)));
    let starts = [channel("/'g'/'A0'", 1000, 12_800.0, 0.0), channel("/'g'/'A1'", 1000, 12_800.0, 0.5)];
    let file = written("tdms-rates", "starts.tdms", &segment(&starts, &[of(1000), of(1000)].concat(), 0));
    refused(&["import", &text(&file), "-o", &out, "--no-tach"], &["not sampled together", "from 0.5 s"]);
}
