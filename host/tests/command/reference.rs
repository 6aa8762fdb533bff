//! `book/src/reference/messages.md`: every public name of the node's configuration and messages, with unit, default
//! and meaning, from the code itself.
//!
//! Names, types and meanings are read from the source of `shared` (rustfmt's form is what is understood: one field or
//! variant per line, its documentation above it), beginning with the configuration, the requests, the replies and the
//! messages and following every type that they name. Defaults are those of `Configuration::default()`.
//! `MESHBAND_BLESS=1` writes the page, otherwise a page that is not the present one fails. Units come from the type,
//! the end of the name, or the documentation after a comma, in this order.

use meshband::config::{Configuration, SCHEMA};
use meshband::message::{OLDEST_READER, WIRE_SCHEMA};
use meshband::modbus::MAP_VERSION;
use meshband::modbus::map::{REGISTERS, SAMPLE_REGISTERS, SAMPLES};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

const COMMAND: &str = "MESHBAND_BLESS=1 cargo test --release -p meshband-host --test command reference";
const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../book/src/reference/messages.md");
const SOURCE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/src");

/// Types that carry a unit.
const UNIT_TYPES: [(&str, &str); 3] = [("Hertz", "Hz"), ("Acceleration", "m/s^2"), ("PartsPerMillion", "ppm")];
/// Ends of names that carry one.
const UNIT_ENDS: [(&str, &str); 9] = [
    ("_hz", "Hz"),
    ("_db", "dB"),
    ("_deg", "degrees"),
    ("_ppm", "ppm"),
    ("_ticks", "ticks"),
    ("_tick", "ticks"),
    ("_turns", "turns"),
    ("_per_hz", "1/Hz"),
    ("_s", "s"),
];
/// Units as documentation has them.
const UNITS: [&str; 7] = ["m/s^2 per unit", "m/s^2", "m/s", "Hz per Hz", "Hz", "turns", "s"];

/// A field of a structure or of a variant; variants of one value have no name.
#[derive(Clone, Default)]
struct Field {
    name: String,
    kind: String,
    doc: String,
}

#[derive(Clone, Default)]
struct Variant {
    name: String,
    doc: String,
    fields: Vec<Field>,
}

enum Item {
    Struct(String, Vec<Field>),
    Enum(String, Vec<Variant>),
    /// Written as another type.
    Alias(String),
}

type Items = BTreeMap<String, Item>;

/// Every public type that can be written, by name.
fn items() -> Items {
    let mut all = Items::new();
    let mut folders = vec![Path::new(SOURCE).to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()) {
            if entry.is_dir() {
                folders.push(entry);
            } else {
                collect(&fs::read_to_string(&entry).unwrap(), &mut all);
            }
        }
    }
    all
}

fn collect(source: &str, all: &mut Items) {
    let (mut doc, mut written, mut alias) = (String::new(), false, None);
    let mut lines = source.lines();
    while let Some(line) = lines.next() {
        if let Some(text) = line.strip_prefix("///") {
            join(&mut doc, text);
        } else if line.starts_with("#[") {
            written |= line.contains("derive(") && line.contains("Serialize");
            alias = alias.or_else(|| line.split_once("serde(from = \"")?.1.split('"').next().map(str::to_owned));
        } else if !line.starts_with("//") {
            let head = |word: &str| line.strip_prefix(word).and_then(|rest| rest.strip_suffix(" {")).map(str::to_owned);
            match (written, alias.take(), head("pub struct "), head("pub enum ")) {
                (true, Some(other), Some(name), _) => {
                    assert!(all.insert(name.clone(), Item::Alias(other)).is_none(), "two types are named {name}");
                }
                (true, None, Some(name), _) => {
                    let item = Item::Struct(doc.clone(), fields(&mut lines, "    "));
                    assert!(all.insert(name.clone(), item).is_none(), "two types are named {name}");
                }
                (true, _, None, Some(name)) => {
                    let item = Item::Enum(doc.clone(), variants(&mut lines));
                    assert!(all.insert(name.clone(), item).is_none(), "two types are named {name}");
                }
                _ => {}
            }
            (doc, written) = (String::new(), false);
        }
    }
}

fn join(doc: &mut String, text: &str) {
    if !doc.is_empty() {
        doc.push(' ');
    }
    doc.push_str(text.trim());
}

/// Fields up to the closing brace.
fn fields<'a>(lines: &mut impl Iterator<Item = &'a str>, indent: &str) -> Vec<Field> {
    let (mut fields, mut doc) = (Vec::new(), String::new());
    for line in lines {
        let Some(line) = line.strip_prefix(indent) else { break };
        if let Some(text) = line.strip_prefix("///") {
            join(&mut doc, text);
        } else if let Some((name, kind)) = line.trim_end_matches(',').split_once(": ") {
            let name = name.trim_start_matches("pub ").to_owned();
            fields.push(Field { name, kind: kind.to_owned(), doc: std::mem::take(&mut doc) });
        }
    }
    fields
}

fn variants<'a>(lines: &mut impl Iterator<Item = &'a str>) -> Vec<Variant> {
    let (mut variants, mut doc) = (Vec::new(), String::new());
    while let Some(line) = lines.next() {
        let Some(line) = line.strip_prefix("    ") else { break };
        if let Some(text) = line.strip_prefix("///") {
            join(&mut doc, text);
            continue;
        }
        let doc = if line.starts_with('#') { continue } else { std::mem::take(&mut doc) };
        let (name, fields) = if let Some(name) = line.strip_suffix(" {") {
            (name, self::fields(lines, "        "))
        } else if let Some((name, kind)) = line.trim_end_matches("),").split_once('(') {
            (name, vec![Field { kind: kind.to_owned(), ..Field::default() }])
        } else {
            (line.trim_end_matches(','), Vec::new())
        };
        variants.push(Variant { name: name.to_owned(), doc, fields });
    }
    variants
}

/// The type inside lists and options, and how it is said.
fn inner(kind: &str) -> (&str, String) {
    let inside = |prefix: &str| kind.strip_prefix(prefix).and_then(|rest| rest.strip_suffix('>'));
    if let Some(list) = inside("Vec<") {
        let (of, most) = list.split_once(", ").unwrap_or((list, ""));
        return (of, format!("list of {of}, at most {}", most.trim_matches(['{', '}', ' '])));
    }
    if let Some(text) = inside("String<") {
        return ("String", format!("text, at most {text} letters"));
    }
    if let Some(of) = inside("Option<") {
        let (of, said) = inner(of);
        return (of, format!("{said}, or none"));
    }
    match kind.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).and_then(|rest| rest.split_once("; ")) {
        Some((of, count)) => (of, format!("{count} times {of}")),
        None => (kind, kind.to_owned()),
    }
}

fn unit(field: &Field) -> &'static str {
    let (kind, _) = inner(&field.kind);
    let by_type = UNIT_TYPES.iter().find(|(of, _)| *of == kind);
    let numbers = ["f32", "f64", "u16", "u32", "u64"];
    if !numbers.contains(&kind) {
        return by_type.map_or("", |(_, unit)| unit);
    }
    // Longest end first: what is per hertz is no hertz.
    let ends = UNIT_ENDS.iter().filter(|(end, _)| field.name.ends_with(end) || field.name == end[1..]);
    if let Some((_, unit)) = ends.max_by_key(|(end, _)| end.len()) {
        return unit;
    }
    let says = |unit: &&&str| {
        let after = |start: &str| {
            field.doc.split(start).skip(1).any(|rest| {
                let rest = rest.strip_prefix(**unit);
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['.', ',', ';', ' ']))
            })
        };
        after(", ") || field.doc.starts_with(**unit)
    };
    if kind.starts_with('f') { UNITS.iter().find(says).copied().unwrap_or("") } else { "" }
}

fn plain(kind: &str) -> bool {
    ["f32", "f64", "u8", "u16", "u32", "u64", "i16", "bool", "String"].contains(&kind)
        || UNIT_TYPES.iter().any(|(of, _)| *of == kind)
}

/// Documentation as it is read on a page: links to items become their names.
fn prose(doc: &str) -> String {
    let mut text = doc.replace('|', "\\|");
    while let Some((before, rest)) = text.split_once("([`").map(|(a, b)| (a.trim_end().to_owned(), b.to_owned())) {
        let after = rest.split_once("`])").map_or("", |(_, after)| after);
        text = before + after;
    }
    for (from, to) in [("[`crate::", "`"), ("[`", "`"), ("`]", "`")] {
        text = text.replace(from, to);
    }
    text
}

struct Page<'a> {
    items: &'a Items,
    text: String,
    /// Types to explain, and those that were.
    wanted: Vec<String>,
    said: BTreeSet<String>,
}

impl Page<'_> {
    fn want(&mut self, kind: &str) {
        let (of, _) = inner(kind);
        let of = match self.items.get(of) {
            Some(Item::Alias(other)) => inner(other).0.to_owned(),
            _ => of.to_owned(),
        };
        if !plain(&of) && !self.said.contains(&of) && !self.wanted.contains(&of) {
            self.wanted.push(of);
        }
    }

    /// How a type is written in a table.
    fn kind(&self, kind: &str) -> String {
        match self.items.get(kind) {
            Some(Item::Alias(other)) => inner(other).1,
            _ => inner(kind).1,
        }
    }

    fn field_rows(&mut self, fields: &[Field], defaults: Option<&Value>) {
        let head = if defaults.is_some() { ("default|", "---|") } else { ("", "") };
        self.text += &format!("\n|name|type|unit|{}meaning|\n|---|---|---|{}---|\n", head.0, head.1);
        for field in fields {
            assert!(!field.doc.is_empty(), "{} has no documentation", field.name);
            let default = defaults.map_or(String::new(), |all| format!("{}|", shown(all.get(&field.name))));
            let (kind, unit, doc) = (self.kind(&field.kind), unit(field), prose(&field.doc));
            self.text += &format!("|`{}`|{kind}|{unit}|{default}{doc}|\n", field.name);
            self.want(&field.kind);
        }
    }

    fn item(&mut self, name: &str, defaults: Option<&Value>) {
        self.said.insert(name.to_owned());
        let items = self.items;
        match items.get(name).unwrap_or_else(|| panic!("{name} is not found in {SOURCE}")) {
            Item::Alias(other) => self.want(other),
            Item::Struct(doc, fields) => {
                self.text += &format!("\n### {name}\n\n{}\n", prose(doc));
                self.field_rows(fields, defaults);
            }
            Item::Enum(doc, variants) => {
                self.text += &format!("\n### {name}\n\n{}\n\n|name|carries|meaning|\n|---|---|---|\n", prose(doc));
                for variant in variants {
                    let carries: Vec<String> = variant
                        .fields
                        .iter()
                        .map(|field| match (field.name.as_str(), unit(field)) {
                            ("", _) => self.kind(&field.kind),
                            (name, "") => format!("`{name}`: {}", prose(&field.doc)),
                            (name, unit) => format!("`{name}` ({unit}): {}", prose(&field.doc)),
                        })
                        .collect();
                    self.text += &format!("|`{}`|{}|{}|\n", variant.name, carries.join(" "), prose(&variant.doc));
                    variant.fields.iter().for_each(|field| self.want(&field.kind));
                }
            }
        }
    }

    fn rest(&mut self) {
        while !self.wanted.is_empty() {
            let name = self.wanted.remove(0);
            self.item(&name, None);
        }
    }
}

/// A default: numbers of single precision as they were written.
fn shown(value: Option<&Value>) -> String {
    match value {
        None => String::new(),
        Some(Value::Number(number)) => match number.as_f64().filter(|_| number.is_f64()) {
            Some(float) => format!("{}", float as f32),
            None => number.to_string(),
        },
        Some(Value::Array(list)) if list.is_empty() => "none".into(),
        Some(Value::Object(_) | Value::Array(_)) => "see there".into(),
        Some(other) => other.to_string().replace('"', ""),
    }
}

/// The register map, from the table that requests are answered from.
fn modbus() -> String {
    let mut text = format!(
        "\n## Modbus\n\nRegister map, version {MAP_VERSION}: input registers (function 4; function 3 reads the \
         same), addresses from 0 as they are on the line: manuals that count \
         from 1 or write 3xxxx have one more. `word`: one register; `long` and `float` (IEEE 754 single): two, the \
         high word first unless `modbus.low_word_first` is set. A float that does not exist is not a number, an age \
         without a result is 65535, other words are 0 then. `age`: whole seconds since a group's \
         result was complete, 65535 also where it is older; `number`: how many there were, 0 again behind 65535. \
         Addresses that are not listed are refused.\n"
    );
    let groups: Vec<String> = REGISTERS
        .chunk_by(|a, b| a.group == b.group)
        .map(|rows| format!("{} ({})", rows[0].group, rows[0].address))
        .collect();
    text += &format!(
        "\n`meshband modbus -o map.csv` prints every register and discrete input with its meaning. Groups with their \
         first address: {}; samples of the waveform ({SAMPLES}, {} floats).\n",
        groups.join(", "),
        SAMPLE_REGISTERS / 2
    );
    text
}

fn page() -> String {
    let items = items();
    let defaults = serde_json::to_value(Configuration::default()).unwrap();
    let mut page = Page { items: &items, text: String::new(), wanted: Vec::new(), said: BTreeSet::new() };
    page.text = format!(
        "# Reference of configuration and messages\n\nMade by `{COMMAND}` from the source of `shared`; edit nothing \
         here. What the values mean in use is in \
         [the node's manual](node.md).\n\nSchemas: link {WIRE_SCHEMA} (read by programs from {OLDEST_READER} on), \
         configuration {SCHEMA}. Values without a unit are numbers, \
         counts or names.\n\n## Configuration\n\nTables and keys of `meshband configure --settings`, `--json` and of \
         `GetConfiguration`; `schema`, `law` and `latched` are not set by a settings file.\n"
    );
    let Some(Item::Struct(_, fields)) = items.get("Configuration") else { panic!("no configuration") };
    page.item("Configuration", Some(&defaults));
    // Tables of the configuration with their defaults, before the types inside them.
    for field in fields {
        let table = defaults.get(&field.name).filter(|value| value.is_object());
        if let (Some(table), Some(Item::Struct(..))) = (table, items.get(&field.kind)) {
            page.text += &format!("\n`[{}]`:", field.name);
            page.item(&field.kind, Some(table));
            page.wanted.retain(|name| *name != field.kind);
        }
    }
    page.rest();
    for (title, root) in [("Requests", "Request"), ("Replies", "Reply"), ("Messages", "Message")] {
        page.text += &format!("\n## {title}\n");
        page.wanted.retain(|name| name != root);
        if !page.said.contains(root) {
            page.item(root, None);
        }
        page.rest();
    }
    page.text + &modbus()
}

#[test]
fn regress_the_reference_is_that_of_the_code() {
    let page = page();
    if std::env::var_os("MESHBAND_BLESS").is_some() {
        fs::write(PAGE, &page).unwrap();
    }
    let kept = fs::read_to_string(PAGE).unwrap_or_default();
    let differs = kept
        .lines()
        .zip(page.lines())
        .position(|(a, b)| a != b)
        .map_or("its length".into(), |n| format!("line {}", n + 1));
    assert!(kept == page, "book/src/reference/messages.md is stale ({differs}): {COMMAND}");
}

#[test]
fn theory_every_key_of_a_configuration_is_in_the_reference() {
    fn keys(value: &Value, found: &mut BTreeSet<String>) {
        match value {
            Value::Object(table) => table.iter().for_each(|(key, value)| {
                found.insert(key.clone());
                keys(value, found);
            }),
            Value::Array(list) => list.iter().for_each(|value| keys(value, found)),
            _ => {}
        }
    }
    let mut config = Configuration::default();
    config.levels.push(Default::default()).unwrap();
    let mut found = BTreeSet::new();
    keys(&serde_json::to_value(&config).unwrap(), &mut found);
    let page = page();
    let missing: Vec<&String> = found.iter().filter(|key| !page.contains(&format!("`{key}`"))).collect();
    assert!(found.len() > 40 && missing.is_empty(), "{missing:?}");
}
