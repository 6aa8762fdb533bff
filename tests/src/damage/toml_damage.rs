//! Damage to one key of a TOML document: removed, of another size, of another sign, of another type.

use std::rc::Rc;
use toml::{Table, Value};

/// One step of a path: a key or a position in an array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// Key of a table, shared by all paths below it: a long key above a long array would be copied for every entry.
    Key(Rc<str>),
    /// Position in an array.
    At(usize),
}

/// What can be done to a value; `None` where it would change nothing.
pub type Change = fn(&Value) -> Option<Value>;

fn number(value: &Value) -> Option<f64> {
    value.as_float().or_else(|| value.as_integer().map(|i| i as f64))
}

fn scaled(value: &Value, factor: f64) -> Option<Value> {
    number(value).map(|x| Value::Float(x * factor)).or_else(|| {
        let all = value.as_array()?.iter().map(|v| number(v).map(|x| Value::Float(x * factor)));
        all.collect::<Option<Vec<_>>>().map(Value::Array)
    })
}

/// Every change by name; removal stands apart, in [`apply`], as `removed`.
pub const CHANGES: &[(&str, Change)] = &[
    ("negated", |v| match v {
        Value::Integer(i) => Some(Value::Integer(i.wrapping_neg())),
        other => scaled(other, -1.0),
    }),
    ("zero", |_| Some(Value::Integer(0))),
    ("one", |_| Some(Value::Integer(1))),
    ("zero, as a fraction", |_| Some(Value::Float(0.0))),
    ("-0.0", |_| Some(Value::Float(-0.0))),
    ("1e308", |_| Some(Value::Float(1e308))),
    ("-1e308", |_| Some(Value::Float(-1e308))),
    ("largest whole number", |_| Some(Value::Integer(i64::MAX))),
    ("smallest whole number", |_| Some(Value::Integer(i64::MIN))),
    ("2^32 + 1", |_| Some(Value::Integer((1 << 32) + 1))),
    ("1e-308", |_| Some(Value::Float(1e-308))),
    ("NaN", |_| Some(Value::Float(f64::NAN))),
    ("infinite", |_| Some(Value::Float(f64::INFINITY))),
    ("-infinite", |_| Some(Value::Float(f64::NEG_INFINITY))),
    ("x 1e-6", |v| scaled(v, 1e-6)),
    ("x 1e6", |v| scaled(v, 1e6)),
    ("plus a half", |v| number(v).map(|x| Value::Float(x + 0.5))),
    ("a word", |_| Some("word".into())),
    ("no text", |_| Some("".into())),
    ("long text", |_| Some("long ".repeat(2000).into())),
    ("text of several lines and control codes", |_| Some("a\nb\u{1b}[31m\u{7}\u{202e}".into())),
    ("true", |_| Some(Value::Boolean(true))),
    ("empty array", |_| Some(Value::Array(Vec::new()))),
    ("empty table", |_| Some(Value::Table(Table::new()))),
    ("one entry more", |v| {
        let mut list = v.as_array().cloned().unwrap_or_else(|| vec![v.clone()]);
        list.push(list.first().unwrap_or(v).clone());
        Some(Value::Array(list))
    }),
    ("one entry less", |v| v.as_array().map(|list| Value::Array(list[1.min(list.len())..].to_vec()))),
    ("in an array", |v| Some(Value::Array(vec![v.clone()]))),
    ("in a table", |v| Some(Value::Table(Table::from_iter([("value".to_owned(), v.clone())])))),
    ("as text", |v| Some(v.to_string().into())),
    ("many entries", |v| {
        Some(Value::Array(vec![v.clone(); (MANY_BYTES / v.to_string().len().max(1)).clamp(2, 20_000)]))
    }),
];

/// About what many entries are long together: any number of a long table would be the damage's own attack on the
/// memory.
const MANY_BYTES: usize = 1 << 20;

/// Names of all changes, removal first.
pub fn changes() -> usize {
    CHANGES.len() + 1
}

/// Every key, table and array entry of a document.
pub fn places(table: &Table) -> Vec<Vec<Step>> {
    let mut found = Vec::new();
    for (key, value) in table {
        collect(vec![Step::Key(key.as_str().into())], value, &mut found);
    }
    found
}

fn collect(path: Vec<Step>, value: &Value, found: &mut Vec<Vec<Step>>) {
    let with = |step: Step| path.iter().cloned().chain([step]).collect();
    match value {
        Value::Table(table) => {
            table.iter().for_each(|(key, v)| collect(with(Step::Key(key.as_str().into())), v, found))
        }
        Value::Array(list) => list.iter().enumerate().for_each(|(i, v)| collect(with(Step::At(i)), v, found)),
        _ => {}
    }
    found.push(path);
}

/// Applies change `number` (0 removes) at a place; gives its description, `None` where it changes nothing.
pub fn apply(document: &mut Table, place: &[Step], number: usize) -> Option<String> {
    let (last, parents) = place.split_last()?;
    let mut whole = Value::Table(std::mem::take(document));
    let mut at = &mut whole;
    for step in parents {
        at = match step {
            Step::Key(key) => at.get_mut(&**key)?,
            Step::At(i) => at.get_mut(*i)?,
        };
    }
    let name = if number == 0 {
        match (at, last) {
            (Value::Table(table), Step::Key(key)) => drop(table.remove(&**key)),
            (Value::Array(list), Step::At(i)) => drop(list.remove(*i)),
            _ => return None,
        }
        Some("removed")
    } else {
        let (name, change) = CHANGES[number - 1];
        let slot = match last {
            Step::Key(key) => at.get_mut(&**key)?,
            Step::At(i) => at.get_mut(*i)?,
        };
        change(slot).map(|changed| {
            *slot = changed;
            name
        })
    };
    if let Value::Table(table) = whole {
        *document = table;
    }
    name.map(|name| format!("{} {name}", described(place)))
}

fn described(place: &[Step]) -> String {
    let step = |step: &Step| match step {
        Step::Key(key) => key.to_string(),
        Step::At(i) => i.to_string(),
    };
    place.iter().map(step).collect::<Vec<_>>().join(".")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_every_place_is_found_and_every_change_is_written_and_read_again() {
        let text = "title = 'x'\n[pair]\nteeth = [19, 48]\n[[run]]\nsignal = 'a'\n";
        let sound: Table = toml::from_str(text).unwrap();
        let places = places(&sound);
        let names: Vec<String> = places.iter().map(|place| described(place)).collect();
        assert_eq!(
            names,
            ["pair.teeth.0", "pair.teeth.1", "pair.teeth", "pair", "run.0.signal", "run.0", "run", "title"]
        );
        for place in &places {
            for number in 0..changes() {
                let mut table = sound.clone();
                if apply(&mut table, place, number).is_some() {
                    assert!(number == 3 || format!("{table:?}") != format!("{sound:?}"), "{place:?} {number}");
                    let text = toml::to_string(&table).unwrap();
                    assert!(toml::from_str::<Table>(&text).is_ok(), "{text}");
                }
            }
        }
    }

    #[test]
    fn theory_many_entries_of_a_long_table_stay_within_a_few_megabytes() {
        let long = format!("[a]\nx = '{}'\n", "long ".repeat(10_000));
        let mut table: Table = toml::from_str(&long).unwrap();
        let many = CHANGES.iter().position(|(name, _)| *name == "many entries").unwrap() + 1;
        apply(&mut table, &[Step::Key("a".into())], many).unwrap();
        let written = toml::to_string(&table).unwrap().len();
        assert!((2 * long.len()..3 * MANY_BYTES).contains(&written), "{written} bytes");
    }
}
