//! Every key of a machine file, with unit and meaning: for the key reference and for unknown keys, all of which are
//! named at once.
//!
//! A test compares the list with what the reader takes, so that neither grows alone.

use crate::terminal::table;
use toml::{Table, Value};

/// A key of a machine file.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// Table; empty for the top level.
    pub table: &'static str,
    /// Name.
    pub name: &'static str,
    /// Unit; empty for none.
    pub unit: &'static str,
    /// What stands for it where it is absent; "needed" where nothing does.
    pub default: &'static str,
    /// Meaning.
    pub meaning: &'static str,
}

const fn key(
    table: &'static str,
    name: &'static str,
    unit: &'static str,
    default: &'static str,
    meaning: &'static str,
) -> Key {
    Key { table, name, unit, default, meaning }
}

/// All keys, in the order of the tables.
pub const KEYS: &[Key] = &[
    key("", "title", "", "needed", "short name for reports"),
    key("pair", "teeth", "", "needed", "numbers of teeth of pinion and gear"),
    key("pair", "module_m", "m", "needed", "module"),
    key("pair", "pressure_angle_deg", "degrees", "20", "pressure angle at the reference circle"),
    key("pair", "face_width_m", "m", "needed", "common face width"),
    key("pair", "bore_radius_m", "m", "needed", "bore (hub) radii"),
    key("pair", "youngs_modulus_pa", "Pa", "needed", "Young's modulus"),
    key("pair", "poisson", "", "needed", "Poisson's ratio"),
    key("pair", "addendum_coefficient", "modules", "1", "tooth addendum"),
    key("pair", "clearance_coefficient", "modules", "0.25", "tip clearance"),
    key("pair", "profile_shift", "modules", "[0, 0]", "profile shift coefficients"),
    key("pair", "root", "", "radial-stub", "shape below the involute: radial-stub, trochoid, base-circle"),
    key("pair", "root_angle", "", "literature", "half angle for the body's compliance: literature, fillet"),
    key("pair", "body", "", "true", "whether the gear bodies' compliance is included"),
    key(
        "pair",
        "pair_stiffness",
        "file",
        "from the geometry",
        "table of one pair's stiffness along the path of contact",
    ),
    key(
        "pair",
        "total_stiffness",
        "file",
        "from the geometry",
        "table of the total mesh stiffness over one base pitch",
    ),
    key("pair", "mesh_damping_s", "s", "0", "damping of each pair: this time times its stiffness"),
    key("pair", "mesh_damping_ratio", "", "none", "damping ratio of the gears on their mesh instead of the time"),
    key("shafts", "inertia_motor_kg_m2", "kg m2", "needed", "moment of inertia of the motor"),
    key("shafts", "inertia_pinion_kg_m2", "kg m2", "needed", "moment of inertia of the pinion"),
    key("shafts", "inertia_gear_kg_m2", "kg m2", "needed", "moment of inertia of the gear"),
    key("shafts", "inertia_load_kg_m2", "kg m2", "needed", "moment of inertia of the load"),
    key(
        "shafts",
        "coupling_stiffness_n_m_per_rad",
        "N m/rad",
        "needed",
        "torsional stiffness motor-pinion and gear-load",
    ),
    key(
        "shafts",
        "coupling_damping_n_m_s_per_rad",
        "N m s/rad",
        "5 % of critical",
        "torsional damping motor-pinion and gear-load",
    ),
    key("shafts", "mass_kg", "kg", "needed", "masses of the gear bodies with their share of the shaft"),
    key("shafts", "bearing_stiffness_n_per_m", "N/m", "needed", "bearing stiffness of each shaft"),
    key("shafts", "bearing_damping_n_s_per_m", "N s/m", "4 % of critical", "bearing damping of each shaft"),
    key("engagement", "kind", "", "needed", "none, paper, linear, raised-cosine, tip-relief, loaded"),
    key("engagement", "width_rad", "rad", "by kind", "pinion rotation over which the ramp lies"),
    key("engagement", "relief_m", "m", "by kind", "relief at the tips of pinion and gear"),
    key(
        "engagement",
        "relief_length_base_pitches",
        "base pitches",
        "by kind",
        "length of the relief on the path of contact",
    ),
    key("engagement", "relief_exponent", "", "by kind", "1 linear, 2 parabolic"),
    key("engagement", "torque_n_m", "N m", "nominal", "pinion torque at which load-dependent ramps are evaluated"),
    key("crack", "side", "", "needed", "pinion or gear"),
    key("crack", "tooth", "", "0", "cracked tooth, from the pair in contact at angle zero"),
    key("crack", "depth_m", "m", "needed", "depth along the crack"),
    key("crack", "angle_deg", "degrees", "70", "angle between crack and tooth centre line"),
    key("crack", "rule", "", "straight", "border of the unloaded zone: straight, parabolic"),
    key("motor", "line_frequency_hz", "Hz", "needed", "line frequency"),
    key("motor", "pole_pairs", "", "needed", "pole pairs"),
    key("motor", "breakdown_torque_n_m", "N m", "needed", "breakdown torque"),
    key("motor", "breakdown_slip", "", "needed", "slip at breakdown"),
    key(
        "load",
        "speed_exponent",
        "",
        "needed",
        "torque grows with this power of speed: 0 constant, 1 generator, 2 fan",
    ),
    key("casing", "mass_kg", "kg", "needed", "mass of the housing"),
    key("casing", "stiffness_n_per_m", "N/m", "needed", "mounts across and along the line of action"),
    key("casing", "damping_n_s_per_m", "N s/m", "needed", "mounts across and along the line of action"),
    key("nominal", "speed_hz", "Hz", "needed", "pinion speed"),
    key("nominal", "torque_n_m", "N m", "needed", "pinion torque"),
];

/// Tables that are a record's own beside the machine's.
const RECORD_TABLES: [&str; 4] = ["acquisition", "tach", "run", "import"];

/// Every unknown key of a machine's source, "[table] key", with the nearest known one; a record's own tables are
/// passed over.
pub fn unknown(source: &Table) -> Vec<String> {
    let mut found = Vec::new();
    for (name, value) in source {
        let known_table = KEYS.iter().any(|key| !key.table.is_empty() && key.table == name);
        match value {
            _ if RECORD_TABLES.contains(&name.as_str()) => {}
            Value::Table(table) if known_table => {
                let unknown =
                    table.keys().filter(|key| !KEYS.iter().any(|known| known.table == name && known.name == *key));
                found.extend(unknown.map(|key| described(name, key)));
            }
            _ if KEYS.iter().any(|key| key.table.is_empty() && key.name == name) => {}
            _ => found.push(crate::text::name(name)),
        }
    }
    found
}

/// An unknown key with the known one of its table that shares most with it.
fn described(table: &str, key: &str) -> String {
    let shown = format!("[{table}] {}", crate::text::name(key));
    if key.contains("helix") {
        return format!("{shown} (helical gears are outside the model)");
    }
    let near =
        KEYS.iter().filter(|known| known.table == table).map(|known| (shared(known.name, key), known.name)).max();
    match near {
        Some((letters, name)) if 2 * letters > key.len() => format!("{shown} ({name}?)"),
        _ => shown,
    }
}

/// Letters that two names share at their beginning and end.
fn shared(a: &str, b: &str) -> usize {
    let front = a.bytes().zip(b.bytes()).take_while(|(a, b)| a == b).count();
    let back = a.bytes().rev().zip(b.bytes().rev()).take_while(|(a, b)| a == b).count();
    (front + back).min(a.len())
}

/// The key reference as aligned text.
pub fn reference() -> String {
    let rows: Vec<Vec<String>> = KEYS
        .iter()
        .map(|key| {
            let table = if key.table.is_empty() { String::new() } else { format!("[{}] ", key.table) };
            vec![format!("{table}{}", key.name), key.unit.into(), key.default.into(), key.meaning.into()]
        })
        .collect();
    table(&["key", "unit", "where absent", "meaning"], &rows)
}

/// The key reference as Markdown, for the documentation.
pub fn markdown() -> String {
    let mut out = "| key | unit | where absent | meaning |\n| --- | --- | --- | --- |\n".to_owned();
    for key in KEYS {
        let table = if key.table.is_empty() { String::new() } else { format!("[{}] ", key.table) };
        out += &format!("| `{table}{}` | {} | {} | {} |\n", key.name, key.unit, key.default, key.meaning);
    }
    out
}
