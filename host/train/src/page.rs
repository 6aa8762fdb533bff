//! What `meshband machine check` says of a train: shafts, gears, lines with owners, coincidences, warnings; as text
//! and as page.

use super::coincidences::{self, Coincidence};
use super::declaration::{Declaration, Stage};
use super::fraction::Fraction;
use super::kinematics::{Role, Train};
use super::lines::{self, Line};
use super::phasing::{self, SymmetryClass};
use super::picture;
use crate::Result;
use crate::report::Report;
use crate::terminal::table;
use serde::Serialize;

/// Mesh harmonics whose planet phasing is listed.
const HARMONICS: u32 = 6;
/// Carrier orders on each side whose standing is listed.
const SIDES: i64 = 6;
/// Coincidences shown in the text.
const MAX_SHOWN_COINCIDENCES: usize = 24;

/// A shaft, for people and machines.
#[derive(Debug, Clone, Serialize)]
pub struct ShaftRow {
    /// Number.
    pub shaft: usize,
    /// What is on it.
    pub carries: String,
    /// Order, exact.
    pub order: Fraction,
    /// Nearest double.
    pub value: f64,
    /// Whether no belt lies before it.
    pub exact: bool,
}

/// A gear.
#[derive(Debug, Clone, Serialize)]
pub struct GearRow {
    /// "pinion of stage 2".
    pub gear: String,
    /// Teeth.
    pub teeth: u32,
    /// Its turns against the centres of its mesh, exact.
    pub rate: Fraction,
    /// Nearest double.
    pub value: f64,
    /// Mesh order, exact.
    pub mesh: Fraction,
    /// How often a tooth meets another gear.
    pub tooth_passage: Fraction,
}

/// What the phasing of a set makes of a mesh harmonic.
#[derive(Debug, Clone, Serialize)]
pub struct PhasingRow {
    /// Stage, from 1.
    pub stage: usize,
    /// Harmonic.
    pub harmonic: u32,
    /// Motion that it excites, of evenly spaced planets.
    pub class: Option<SymmetryClass>,
    /// Carrier orders from the harmonic at which a sound set has lines.
    pub stands_at: Vec<i64>,
}

/// Everything.
#[derive(Debug, Clone, Serialize)]
pub struct Explained {
    /// Title of the file.
    pub title: String,
    /// Turns of the input that coincidences are judged for.
    pub turns: f64,
    /// Shafts.
    pub shafts: Vec<ShaftRow>,
    /// Gears.
    pub gears: Vec<GearRow>,
    /// Lines of a sound train.
    pub lines: Vec<Line>,
    /// Planet phasing.
    pub phasing: Vec<PhasingRow>,
    /// Lines that such a record cannot tell apart.
    pub coincidences: Vec<Coincidence>,
    /// What is wrong, or makes diagnosis harder.
    pub warnings: Vec<String>,
}

/// Works everything out for a record of `turns` turns of the input.
///
/// # Errors
/// Orders beyond 128 bits.
pub fn explain(train: &Train, turns: f64) -> Result<Explained> {
    let shafts = (0..train.shafts.len()).map(|shaft| ShaftRow {
        shaft,
        carries: train.shaft_words(shaft),
        order: train.shaft_order(shaft),
        value: train.shaft_order(shaft).value(),
        exact: train.exact[shaft],
    });
    let gear = |gear: &super::kinematics::Gear| -> Result<GearRow> {
        let rate = gear.rate.magnitude();
        Ok(GearRow {
            gear: gear.words(),
            teeth: gear.teeth,
            rate,
            value: rate.value(),
            mesh: train.mesh(gear.stage).map_or(Fraction::ZERO, |mesh| mesh.order),
            tooth_passage: rate.multiple(gear.contacts.into())?,
        })
    };
    let coincidences = coincidences::of(train, turns)?;
    Ok(Explained {
        title: train.declaration.title.clone(),
        turns,
        shafts: shafts.collect(),
        gears: train.gears.iter().map(gear).collect::<Result<_>>()?,
        lines: lines::table(train)?,
        phasing: phasing_rows(train),
        warnings: warnings(train, &coincidences, turns)?,
        coincidences,
    })
}

fn phasing_rows(train: &Train) -> Vec<PhasingRow> {
    let mut rows = Vec::new();
    for mesh in &train.meshes {
        let Some(carrier) = &mesh.carrier else { continue };
        let sun = mesh.gears.iter().map(|g| &train.gears[*g]).find(|gear| gear.role == Role::Sun);
        for k in 1..=HARMONICS {
            rows.push(PhasingRow {
                stage: mesh.stage + 1,
                harmonic: k,
                class: sun
                    .filter(|_| carrier.spacing.is_none())
                    .map(|sun| phasing::symmetry_class(sun.teeth, carrier.planets, k)),
                stands_at: (-SIDES..=SIDES).filter(|n| phasing::stands(carrier, k.into(), *n)).collect(),
            });
        }
    }
    rows
}

fn warnings(train: &Train, coincidences: &[Coincidence], turns: f64) -> Result<Vec<String>> {
    let mut warnings = Vec::new();
    for (i, stage) in train.declaration.stages.iter().enumerate() {
        let number = i + 1;
        match stage {
            Stage::Planetary { sun, planet, ring, planets, .. } => {
                let mesh = train.mesh(i);
                let carrier = mesh.and_then(|mesh| mesh.carrier.as_ref());
                if carrier.is_some_and(|carrier| !phasing::can_be_assembled(*sun, carrier)) {
                    warnings.push(format!(
                        "stage {number}: {planets} planets cannot be put in where they are declared: {sun} + {ring} \
                         teeth are no multiple that fits (assembly condition)"
                    ));
                }
                if *ring != sun + 2 * planet {
                    warnings.push(format!(
                        "stage {number}: {ring} teeth of the ring are not {sun} + 2 x {planet}: profile shifts, or a \
                         slip of the keyboard"
                    ));
                }
                let apart = f64::from(sun + planet) * (std::f64::consts::PI / f64::from(*planets)).sin();
                if *planets > 1 && apart < f64::from(planet + 2) {
                    warnings.push(format!("stage {number}: {planets} planets of {planet} teeth touch each other"));
                }
            }
            Stage::Belt { .. } => warnings.push(format!(
                "stage {number}: a belt slips; what lies behind it as seen from the tachometer has no exact order \
                 and is not judged"
            )),
            Stage::Pair { .. } => {}
        }
    }
    for mesh in &train.meshes {
        for pair in mesh.gears.windows(2) {
            let [a, b] = [&train.gears[pair[0]], &train.gears[pair[1]]];
            let common = lines::common(a.teeth, b.teeth);
            if common > 1 {
                warnings.push(format!(
                    "stage {}: {} and {} teeth have the factor {common} in common: the same teeth meet every {} \
                     turns of the {}, wear is uneven",
                    mesh.stage + 1,
                    a.teeth,
                    b.teeth,
                    b.teeth / common,
                    a.role.word()
                ));
            }
        }
    }
    let exact = coincidences.iter().filter(|c| c.turns.is_none()).count();
    if exact > 0 {
        warnings.push(format!(
            "{exact} pairs of lines of different parts are the same for ever: no record tells whose they are"
        ));
    }
    if coincidences.len() > exact {
        warnings
            .push(format!("{} more cannot be told apart in {turns:.0} turns of the input", coincidences.len() - exact));
    }
    Ok(warnings)
}

type Table = (&'static str, Vec<&'static str>, Vec<Vec<String>>);

/// The tables, with headings.
fn tables(e: &Explained) -> Vec<Table> {
    let order = |order: &Fraction| vec![order.to_string(), format!("{:.6}", order.value())];
    let shafts = e.shafts.iter().map(|s| {
        let exact = if s.exact { "exact" } else { "slips" };
        [vec![s.carries.clone()], order(&s.order), vec![exact.into()]].concat()
    });
    let gears = e.gears.iter().map(|g| {
        [
            vec![g.gear.clone(), g.teeth.to_string()],
            order(&g.rate),
            vec![format!("{:.6}", g.mesh.value()), format!("{:.6}", g.tooth_passage.value())],
        ]
        .concat()
    });
    let lines = e.lines.iter().map(|l| [vec![l.what.clone(), l.owner.clone()], order(&l.order)].concat());
    let phasing = e.phasing.iter().map(|p| {
        let class = p.class.map_or("uneven planets".into(), |class| format!("{class:?}").to_lowercase());
        let at: Vec<String> = p.stands_at.iter().map(|n| format!("{n:+}")).collect();
        vec![format!("stage {}, {} x mesh", p.stage, p.harmonic), class, at.join(" ")]
    });
    let coincident = e.coincidences.iter().take(MAX_SHOWN_COINCIDENCES).map(|c| {
        let turns = c.turns.map_or("never".into(), |turns| format!("{turns:.0}"));
        vec![c.one.clone(), c.other.clone(), format!("{:.6}", c.order), format!("{:.6}", c.apart), turns]
    });
    vec![
        ("Shafts, per turn of shaft 0", vec!["shaft", "order", "=", "is"], shafts.collect()),
        ("Gears", vec!["gear", "teeth", "rate", "=", "mesh", "tooth passage"], gears.collect()),
        ("Lines of a sound train", vec!["line", "owner", "order", "="], lines.collect()),
        (
            "Planet phasing: carrier orders about each harmonic at which a sound set has lines",
            vec!["harmonic", "excites", "stands at"],
            phasing.collect(),
        ),
        (
            "Lines of different parts that such a record cannot tell apart",
            vec!["line", "other", "order", "apart", "turns that tell"],
            coincident.collect(),
        ),
    ]
}

/// As text.
pub fn text(e: &Explained) -> String {
    let mut out = format!("train {}, {} stages\n", e.title, e.shafts.len() - 1);
    for (heading, head, rows) in tables(e).into_iter().filter(|(_, _, rows)| !rows.is_empty()) {
        out += &format!("\n{heading}\n{}", table(&head, &rows));
    }
    if e.coincidences.len() > MAX_SHOWN_COINCIDENCES {
        out += &format!("and {} more, in the JSON\n", e.coincidences.len() - MAX_SHOWN_COINCIDENCES);
    }
    e.warnings.iter().for_each(|warning| out += &format!("warning: {warning}\n"));
    out
}

/// As page, with the picture of the train.
pub fn report(e: &Explained, train: &Train) -> Report {
    let ratio = e.shafts.last().map_or(1.0, |shaft| shaft.value);
    let mut page =
        Report::new(&format!("Train {}", e.title), "what a sound train shows, in exact fractions of the input's turns")
            .figure("Stages", e.shafts.len() - 1)
            .figure("Turns of the output per turn of the input", format!("{ratio:.6}"))
            .figure("Coincidences", e.coincidences.len())
            .picture(
                &picture::svg(train),
                "Shafts with their orders; a gear says its teeth and rate under the pointer.",
            );
    for warning in &e.warnings {
        page = page.note(warning);
    }
    for (heading, head, rows) in tables(e).into_iter().filter(|(_, _, rows)| !rows.is_empty()) {
        page = page.section(heading).table("", &head, &rows);
    }
    page
}

/// Whether a TOML text declares a train: it has stages.
pub fn declares_train(text: &str) -> bool {
    text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("stage") || table.contains_key("stages"))
}

/// Reads a train from a file, or from the `record.toml` of a folder.
///
/// # Errors
/// As [`Declaration::read`].
pub fn read(place: &str, text: &str) -> Result<Train> {
    let table: toml::Table = text.parse().unwrap_or_default();
    // A record's own tables are its reader's.
    if table.contains_key("acquisition") {
        let mut own = toml::Table::new();
        own.extend(
            table
                .into_iter()
                .filter(|(key, _)| super::declaration::RECORD_KEYS.contains(&key.as_str()) || key == "title"),
        );
        return Train::of(Declaration::of_table(&own, place)?);
    }
    Train::of(Declaration::parse(text, place)?)
}
