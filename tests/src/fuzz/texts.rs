//! Targets that read text: machine, effects, law, settings. Whatever is refused is refused in one line that names the
//! place; whatever is taken is written and read again as the same, where there is a writer.

use super::files::{input_file, refusal};
use crate::damage::byte_damage::{NASTY_TEXTS, damage, damage_text};
use crate::damage::toml_damage::{apply, changes, places};
use meshband::board::Timing;
use meshband::config::Configuration;
use meshband::frame::{MAX_FRAME, Packet, encode};
use meshband::message::Request;
use meshband_host::effects::{self, REGISTRY};
use meshband_host::law::file::LawFile;
use meshband_host::link::settings::Settings;
use meshband_host::machine::{Geometry, Machine};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};

fn machines() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines")
}

/// One key of a document that is TOML, otherwise lines and bytes.
pub fn change_toml(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let text = std::str::from_utf8(bytes).ok();
    let table = text.and_then(|text| text.parse::<toml::Table>().ok()).filter(|_| random.random_range(0..4) > 0);
    let changed = table.and_then(|mut table| {
        let places = places(&table);
        let place = places.get(random.random_range(0..places.len().max(1)))?;
        apply(&mut table, place, random.random_range(0..changes()))?;
        toml::to_string(&table).ok()
    });
    match changed {
        Some(text) => *bytes = text.into_bytes(),
        None if random.random() => drop(damage_text(bytes, random)),
        None => drop(damage(bytes, random)),
    }
}

/// The project's own machines.
pub fn machine_seeds() -> Vec<Vec<u8>> {
    let names = ["19-48.toml", "62-62.toml", "check-19-48.toml", "paper-rig.toml"];
    names.iter().map(|name| std::fs::read(machines().join(name)).expect("a machine of the project")).collect()
}

/// A machine that is taken has a geometry of finite size.
pub fn machine(bytes: &[u8]) -> String {
    let Ok(text) = std::str::from_utf8(bytes) else { return "no text".into() };
    match Machine::from_toml(text, "machine.toml", &machines()) {
        Ok(machine) => {
            let length = Geometry::new(&machine.pair).map(|geometry| geometry.line_length_m());
            assert!(length.as_ref().is_ok_and(|length| length.is_finite() && *length > 0.0), "taken, but {length:?}");
            let _ = machine.hash();
            format!("a machine, {:?}", machine.engagement.is_some())
        }
        Err(error) => refusal(&error, "machine.toml"),
    }
}

/// Every effect of the registry as an argument, and a file of some.
pub fn effect_seeds() -> Vec<Vec<u8>> {
    let arguments = REGISTRY.iter().map(|entry| match entry.example {
        "" => entry.name.to_owned(),
        example => format!("{}:{example}", entry.name),
    });
    let file = "torque_factor = 1.02\npinion_turns = [1, 2]\n[[effect]]\nname = \"tooth-crack\"\ntooth = \
        3\n\n[[effect]]\nname = \"noise\"\n";
    arguments.chain([file.to_owned()]).map(String::into_bytes).collect()
}

/// One argument's keys and numbers, or a file's.
pub fn change_effect(bytes: &mut Vec<u8>, random: &mut ChaCha8Rng) {
    let text = String::from_utf8_lossy(bytes).into_owned();
    if text.contains('\n') || random.random_range(0..4) == 0 {
        return change_toml(bytes, random);
    }
    let mut parts: Vec<String> = text.split_inclusive([':', '=', ',']).map(str::to_owned).collect();
    if parts.is_empty() {
        parts.push(String::new());
    }
    let entry = REGISTRY[random.random_range(0..REGISTRY.len())];
    let name = entry.parameters.get(random.random_range(0..entry.parameters.len().max(1))).map_or("", |p| p.name);
    let at = random.random_range(0..parts.len());
    let new = match random.random_range(0..5) {
        0 => NASTY_TEXTS[random.random_range(0..NASTY_TEXTS.len())].to_owned(),
        1 => entry.name.to_owned(),
        2 => format!("{},{name}=1", parts[at]),
        3 => format!("{}", random.random_range(-10.0..100.0_f64)),
        _ => name.to_owned(),
    };
    let end = parts[at].chars().last().filter(|c| ":=,".contains(*c)).map_or(String::new(), String::from);
    parts[at] = new + &end;
    *bytes = parts.concat().into_bytes();
}

/// Text of several lines is a file of effects, text of one an argument.
pub fn effects(bytes: &[u8]) -> String {
    let Ok(text) = std::str::from_utf8(bytes) else { return "no text".into() };
    if !text.contains('\n') {
        return match effects::parse(text) {
            Ok(_) => {
                let name = text.split(':').next().unwrap_or_default().trim();
                assert!(effects::entry(name).is_ok(), "an effect without an entry: {name}");
                format!("an effect, {name}")
            }
            Err(error) => refusal(&error, "effect"),
        };
    }
    let file = input_file("effects.toml", bytes);
    let (factor, turns) = (effects::read_torque_factor(&file), effects::read_pinion_turns(&file));
    assert!(factor.as_ref().map_or(true, |factor| (0.5..=2.0).contains(factor)), "{factor:?}");
    match (effects::read(&file), factor, turns) {
        (Ok(list), Ok(_), Ok(turns)) => {
            format!("a file of {} effects, {} turns", list.len().min(9), turns.len().min(9))
        }
        (Err(error), ..) => refusal(&error, "effect"),
        (_, Err(error), _) | (_, _, Err(error)) => refusal(&error, "effects.toml"),
    }
}

/// One law of every form, simulated and measured.
pub fn law_seeds() -> Vec<Vec<u8>> {
    let head = |more: &str, law: &str| {
        format!(
            "machine = \"pair\"\nmachine_hash = \"0x1234567890abcdef\"\nramp = \"paper\"\n{more}domain_hz = [1.0, \
             25.0]\n\
             relative_uncertainty = 0.005\n[law]\n{law}\n"
        )
    };
    [
        head("", "form = \"tabulated\"\nknots = [[1.0, 13000.0], [5.0, 30000.0], [25.0, 72500.0]]"),
        head("", "form = \"quadratic\"\na = -10.0\nb = 3000.0\nc = 10000.0"),
        head("measured = \"edges\"\n", "form = \"root-sum-square\"\na_turns = 0.0002\nt_mode_s = 0.00001"),
        head("measured = \"occupied\"\n", "form = \"ramp-through-mode\"\na_turns = 0.0002\nf_mode_hz = 20000.0"),
    ]
    .map(String::into_bytes)
    .to_vec()
}

/// A law that is taken is written and read again as the same, and its bandwidths in its domain are numbers.
pub fn law(bytes: &[u8]) -> String {
    let Ok(text) = std::str::from_utf8(bytes) else { return "no text".into() };
    match LawFile::from_toml(text, "law.toml") {
        Ok(file) => {
            assert_eq!(LawFile::from_toml(&file.to_toml(), "again").expect("what was written is read"), file);
            let node = file.for_node().expect("was checked");
            for speed in [node.lowest, node.highest] {
                let found = node.bandwidth(speed).bandwidth.0;
                assert!(found.is_finite() && found > 0.0, "{found} Hz at {speed:?}");
            }
            format!("a law, {} {:?}", file.law.name(), file.measured)
        }
        Err(error) => refusal(&error, "law.toml"),
    }
}

/// The settings that the documentation shows, and single tables.
pub fn settings_seeds() -> Vec<Vec<u8>> {
    let whole = "policy = \"Spectrum\"\n[tach]\npulses_per_turn = 60\nmissing = 2\n[sensor]\nacceleration_per_code = \
        0.00494\n[limits]\n\
        analogue_stop = 100000.0\n[front_end]\ntach_edge = \"Falling\"\ngain = \"X4\"\nsensor_supply \
        = \"On\"\n[[alarms]]\nwatched = \"Rms\"\n\
        from = 5.0\nto = 25.0\nraise = 12.0\nclear = 10.0\npersistence = 3\n[holding]\nlatching = \
        true\npersistence_s = 2.0\n\
        watch_signal = true\n[pass]\nanalogue = 40000.0\n\
        [link]\npersonality = \"Modbus\"\naddress = 17\nbits_per_second = 9600\nparity = \"Odd\"\n";
    let waveform = "[policy.Waveform]\nmultiple = 8.0\n[gears]\npinion_teeth = 19\ngear_teeth = \
        48\n[mesh]\nharmonics = 3\nsidebands = 2\n";
    [whole, waveform].map(|text| text.as_bytes().to_vec()).to_vec()
}

/// Settings that are taken apply to a node's configuration as they did when they were read; what is valid then can be
/// sent.
pub fn settings(bytes: &[u8]) -> String {
    let Ok(text) = std::str::from_utf8(bytes) else { return "no text".into() };
    match Settings::from_toml(text, "settings.toml") {
        Ok(settings) => {
            let mut config = Configuration::default();
            settings.apply(&mut config).expect("applied when it was read");
            let valid = config.validate(Timing::STM32F405);
            if valid.is_ok() {
                let mut buffer = [0; MAX_FRAME];
                encode(&Packet::Request(Request::SetConfiguration(config)), 1, &mut buffer).expect("fits a frame");
            }
            format!("settings, {valid:?}")
        }
        Err(error) => refusal(&error, "settings.toml"),
    }
}
