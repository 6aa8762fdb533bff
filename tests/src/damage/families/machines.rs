//! Damaged machines and effects: keys of the files, and the effects' keys on the command line.

use super::records::{pair, stiffness};
use crate::damage::attack::{Attack, Kind, Scene, words};
use crate::damage::byte_damage::{NASTY_TEXTS, damage, damage_text};
use crate::damage::process::Invocation;
use crate::damage::toml_damage;
use meshband_host::effects::REGISTRY;
use rand::RngExt;
use toml::Table;

const SIMULATE: &str = "simulate in/machine.toml --speed 30 --torque 10 --duration 0.05 --rate 20480 -o out/r";

/// One key of a machine; the file's text; its table; an effect.
pub fn keys(scene: &mut Scene) -> Option<Attack> {
    match scene.index % 9 {
        0..6 => Some(machine(scene)),
        6 => Some(text(scene)),
        7 => Some(effects_file(scene)),
        _ => Some(effect(scene)),
    }
}

/// Commands that read a machine.
fn user(scene: &mut Scene, what: String) -> Attack {
    match scene.random.random_range(0..12) {
        0..7 => Attack::new(what, Invocation::new(words(SIMULATE))).writing("out/r", Kind::Record),
        7..11 => {
            let line = "stiffness in/machine.toml --json out/s.json --report out/s.html";
            let attack = Attack::new(what, Invocation::new(words(line)));
            attack.writing("out/s.json", Kind::Json).writing("out/s.html", Kind::Page)
        }
        _ => {
            scene.copy("record", "in/record");
            let line = "predict in/record --machine in/machine.toml -o out/p";
            Attack::new(what, Invocation::new(words(line))).writing("out/p", Kind::Predictions)
        }
    }
}

fn machine(scene: &mut Scene) -> Attack {
    let name = if scene.index.is_multiple_of(2) { "machine.toml" } else { "table-machine.toml" };
    scene.copy(name, "in/machine.toml");
    scene.copy("stiffness.csv", "in/stiffness.csv");
    let text = String::from_utf8(scene.read("in/machine.toml")).expect("our own machine");
    let mut document: Table = toml::from_str(&text).expect("our own machine");
    let places = toml_damage::places(&document);
    let (place, change) = pair(scene, places.len());
    let what = toml_damage::apply(&mut document, &places[place], change).unwrap_or_else(|| "unchanged".into());
    scene.write("in/machine.toml", toml::to_string(&document).unwrap_or_default());
    user(scene, format!("{name}: {what}"))
}

fn text(scene: &mut Scene) -> Attack {
    let name = if scene.chance(0.5) { "machine.toml" } else { "table-machine.toml" };
    scene.copy(name, "in/machine.toml");
    scene.copy("stiffness.csv", "in/stiffness.csv");
    let what = if name == "table-machine.toml" && scene.chance(0.6) {
        format!("stiffness table: {}", stiffness(scene))
    } else {
        let mut bytes = scene.read("in/machine.toml");
        let way = if scene.chance(0.5) { damage } else { damage_text };
        let what = way(&mut bytes, &mut scene.random);
        scene.write("in/machine.toml", bytes);
        format!("text of {name}: {what}")
    };
    user(scene, what)
}

fn effects_file(scene: &mut Scene) -> Attack {
    scene.copy("machine.toml", "in/machine.toml");
    let entry = scene.random.random_range(0..REGISTRY.len());
    let mut effect = Table::from_iter([("name".to_owned(), REGISTRY[entry].name.into())]);
    for parameter in REGISTRY[entry].parameters {
        effect.insert(parameter.name.into(), parameter.default.into());
    }
    let mut document = Table::from_iter([("effect".to_owned(), toml::Value::Array(vec![effect.into()]))]);
    document.insert("torque_factor".into(), 1.0.into());
    let places = toml_damage::places(&document);
    let place = scene.random.random_range(0..places.len());
    let change = scene.random.random_range(0..toml_damage::changes());
    let what = toml_damage::apply(&mut document, &places[place], change).unwrap_or_else(|| "unchanged".into());
    scene.write("in/effects.toml", toml::to_string(&document).unwrap_or_default());
    let line = format!("{SIMULATE} --effects in/effects.toml");
    let what = format!("effects of {}: {what}", REGISTRY[entry].name);
    Attack::new(what, Invocation::new(words(&line))).writing("out/r", Kind::Record)
}

fn effect(scene: &mut Scene) -> Attack {
    scene.copy("machine.toml", "in/machine.toml");
    let entry = &REGISTRY[scene.random.random_range(0..REGISTRY.len())];
    let mut text = String::from(entry.name);
    for (i, parameter) in entry.parameters.iter().enumerate() {
        let value =
            if scene.chance(0.5) { (*scene.pick(NASTY_TEXTS)).to_owned() } else { parameter.default.to_string() };
        text += if i == 0 { ":" } else { "," };
        text += &format!("{}={value}", parameter.name);
    }
    if scene.chance(0.2) {
        text += *scene.pick(&[",", ":", ",x=1", "=", ",,", "::"]);
    }
    // A line of a shell cannot hold it.
    text.retain(|c| c != '\0');
    let mut arguments = words(SIMULATE);
    arguments.extend(["--effect".into(), text.clone().into()]);
    Attack::new(format!("--effect {text:?}"), Invocation::new(arguments)).writing("out/r", Kind::Record)
}
