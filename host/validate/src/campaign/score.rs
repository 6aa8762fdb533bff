//! Scoring of single records and the campaign's tables.

use super::uniform::Uniform;
use crate::effects;
use crate::effects::hypothesis::Hidden;
use crate::model_based::Outcome;
use crate::terminal;
use serde::{Deserialize, Serialize};
use statrs::distribution::{Beta, ContinuousCDF};

/// What the loop said of one generated record.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Scored {
    /// `part-number`.
    pub id: String,
    /// null, power, leave-one-out, two, parameter, limit-1, limit-2 or limit-none.
    pub part: String,
    /// Machine.
    pub machine: String,
    /// Number of runs; 0 in logs of the former format.
    #[serde(default)]
    pub runs: usize,
    /// Length of a run, s.
    pub duration_s: f64,
    /// Whether the noise was coloured.
    pub coloured: bool,
    /// Whether declared parameters were wrong within tolerance.
    pub parameters_off: bool,
    /// Hidden effects.
    pub hidden: Vec<String>,
    /// The same with every number.
    pub truth: String,
    /// Strength over the detection floor.
    pub level: f64,
    /// Verdict, name, family of every effect reported.
    pub reported: Vec<[String; 3]>,
    /// Per hidden effect: named, ambiguous, generic (right family), other-family or missed.
    pub result: Vec<String>,
    /// Effects named that are not in the record.
    pub wrong_names: usize,
    /// Effects reported beyond the hidden ones.
    pub surplus: usize,
    /// Whether the interval of the strength covers the truth, where it can be compared.
    pub covered: Option<bool>,
    /// Estimate over truth of the strength, where it can be compared.
    pub estimate_over_truth: Option<f64>,
    /// Held-out NRMSE of the shaft-synchronous part and of the whole signal: declared, corrected, noise floor.
    pub held_out: [[f64; 3]; 2],
    /// The same, calibrated; absent in logs of the former format.
    #[serde(default)]
    pub calibrated: Option<[f64; 2]>,
    /// NRMSE of the whole signal that the noise put in leaves on the held-out runs; absent in logs of the former
    /// format.
    #[serde(default)]
    pub true_floor: Option<f64>,
    /// Records without any effect of the record's own bootstrap whose best score is at least its own, and their number.
    #[serde(default)]
    pub bootstrap: Option<[usize; 2]>,
    /// Seconds.
    pub seconds: f64,
}

/// Whether a reported name (of a single effect, or "a or b") contains one of the right names.
fn has(name: &str, right: &[&str]) -> bool {
    name.split(" or ").any(|part| right.contains(&part.trim()))
}

/// Per hidden effect the best thing said of it, and the number of wrong names.
pub fn judge(outcome: &Outcome, hidden: &[(&Hidden, f64)]) -> (Vec<String>, usize) {
    let of = |kind: &Hidden| {
        let any = |test: &dyn Fn(&crate::model_based::outcome::Effect) -> bool| outcome.effects.iter().any(test);
        if any(&|e| e.verdict == "named" && kind.right_names.contains(&e.name.as_str())) {
            "named"
        } else if any(&|e| e.verdict == "ambiguous" && has(&e.name, kind.right_names)) {
            "ambiguous"
        } else if any(&|e| e.verdict != "named" && kind.families.contains(&e.family.as_str())) {
            "generic"
        } else if outcome.effects.is_empty() {
            "missed"
        } else {
            "other-family"
        }
    };
    let result = hidden.iter().map(|(kind, _)| of(kind).to_string()).collect();
    let wrong = outcome
        .effects
        .iter()
        .filter(|e| e.verdict == "named" && !hidden.iter().any(|(k, _)| k.right_names.contains(&e.name.as_str())))
        .count();
    (result, wrong)
}

/// Coverage and relative size of the strength of a named effect.
pub fn strength(outcome: &Outcome, kind: &Hidden, truth: f64) -> Option<(bool, f64)> {
    if kind.parameter.is_empty() {
        return None;
    }
    let effect =
        outcome.effects.iter().find(|e| e.verdict == "named" && kind.right_names.contains(&e.name.as_str()))?;
    let (_, value) = effect.parameters.iter().find(|(name, _)| name.starts_with(kind.parameter))?;
    let covered = value.ci95[0] <= truth && truth <= value.ci95[1];
    Some((covered, value.value / truth))
}

/// One group's counts.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    /// Group.
    pub group: String,
    /// Records.
    pub records: usize,
    /// Share with at least one effect reported.
    pub found: f64,
    /// Share whose hidden effects are all named.
    pub named: f64,
    /// Share whose hidden effects are at least ambiguous or of the right family.
    pub right_family: f64,
    /// Share with a wrong name.
    pub wrong: f64,
    /// Share whose held-out error, corrected, is below the calibrated one (below the declared one where the log has
    /// no calibrated one).
    pub error_fell: f64,
    /// Median of the corrected held-out error over the noise floor (shaft-synchronous; whole signal for fixed
    /// frequencies).
    pub corrected_over_floor: f64,
    /// Medians of the held-out NRMSE: declared, calibrated (not a number where the log has none), corrected.
    pub stages: [f64; 3],
}

/// The campaign's tables.
#[derive(Debug, Clone, Serialize)]
pub struct Summary {
    /// Records with nothing hidden: share with any term is `found`.
    pub null: Vec<Row>,
    /// Power by level over the detection floor.
    pub power: Vec<Row>,
    /// The same per effect, all at twice its floor.
    pub power_by_effect: Vec<Row>,
    /// Intervals that cover the truth, and how many were compared.
    pub coverage: (f64, usize),
    /// The true effect's name withheld.
    pub leave_one_out: Vec<Row>,
    /// Two effects at once; one effect and a wrong parameter.
    pub two: Vec<Row>,
    /// Effects at the limit stated for their record (half of the places), and at twice it; then by effect.
    pub limits: Vec<Row>,
    /// Corrected held-out error over floor, all single effects at twice the floor and above: named and not named,
    /// medians.
    pub corrected_over_floor: [f64; 2],
    /// Upper end of the 95 % interval of the share of false terms (Clopper and Pearson).
    pub false_at_most: f64,
    /// Whether the own probabilities of records with nothing hidden are uniform; none where they were not asked.
    pub uniform: Option<Uniform>,
    /// Corrected held-out error of the whole signal over the true floor, medians: single effects rightly named, and
    /// two effects.
    pub over_true_floor: [f64; 2],
    /// Seconds per record, median and largest.
    pub seconds: [f64; 2],
}

fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Part of the signal that fits the hidden effect: 1, the whole, for what is not tied to the shafts.
fn part_of(s: &Scored) -> usize {
    let free = ["mains-hum", "fixed-frequency-tone", "bearing-impacts", "load-fluctuation"];
    usize::from(s.hidden.iter().any(|h| free.contains(&h.as_str()) || h.contains("modulation")))
}

/// Declared, corrected, noise floor of that part.
fn error(s: &Scored) -> [f64; 3] {
    s.held_out[part_of(s)]
}

/// Calibrated error of that part.
fn calibrated(s: &Scored) -> Option<f64> {
    s.calibrated.map(|parts| parts[part_of(s)])
}

fn row(group: impl Into<String>, of: &[&Scored]) -> Row {
    let share = |test: &dyn Fn(&Scored) -> bool| of.iter().filter(|s| test(s)).count() as f64 / of.len().max(1) as f64;
    let right = |r: &String| ["named", "ambiguous", "generic"].contains(&r.as_str());
    Row {
        group: group.into(),
        records: of.len(),
        found: share(&|s| !s.reported.is_empty()),
        named: share(&|s| !s.result.is_empty() && s.result.iter().all(|r| r == "named")),
        right_family: share(&|s| !s.result.is_empty() && s.result.iter().all(right)),
        wrong: share(&|s| s.wrong_names > 0),
        error_fell: share(&|s| error(s)[1] < calibrated(s).unwrap_or(error(s)[0])),
        corrected_over_floor: median(of.iter().map(|s| error(s)[1] / error(s)[2]).collect()),
        stages: [
            median(of.iter().map(|s| error(s)[0]).collect()),
            median(of.iter().filter_map(|s| calibrated(s)).collect()),
            median(of.iter().map(|s| error(s)[1]).collect()),
        ],
    }
}

/// Tables of all records scored so far.
pub fn summarise(all: &[Scored]) -> Summary {
    let part = |name: &'static str| all.iter().filter(move |s| s.part == name);
    let null = [("white", false), ("coloured", true)].map(|(name, coloured)| {
        row(format!("{name} noise"), &part("null").filter(|s| s.coloured == coloured).collect::<Vec<_>>())
    });
    let mut null = null.to_vec();
    null.push(row("all", &part("null").collect::<Vec<_>>()));
    let mut levels: Vec<f64> = part("power").map(|s| s.level).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let power = levels
        .iter()
        .map(|&l| row(format!("{l} x floor"), &part("power").filter(|s| s.level == l).collect::<Vec<_>>()))
        .collect();
    let by_kind = |name: &'static str, level: Option<f64>| -> Vec<Row> {
        effects::hidden()
            .map(|k| {
                let at = |s: &&Scored| level.is_none_or(|l| s.level == l);
                let own: Vec<&Scored> = part(name).filter(at).filter(|s| s.hidden[0] == k.name).collect();
                row(k.name, &own)
            })
            .filter(|r| r.records > 0)
            .collect()
    };
    let compared: Vec<bool> = part("power").filter_map(|s| s.covered).collect();
    let mut leave_one_out = by_kind("leave-one-out", None);
    leave_one_out.push(row("all", &part("leave-one-out").collect::<Vec<_>>()));
    let two = vec![
        row("two effects", &part("two").collect::<Vec<_>>()),
        row("effect and parameter", &part("parameter").collect::<Vec<_>>()),
    ];
    let mut limits = Vec::new();
    for (name, group) in [("limit-1", "at the limit"), ("limit-2", "at twice the limit")] {
        limits.push(row(group, &part(name).collect::<Vec<_>>()));
        let of_kind = by_kind(name, None).into_iter();
        limits.extend(of_kind.map(|r| Row { group: format!("{group}: {}", r.group), ..r }));
    }
    let ratio = |named: bool| {
        let own = part("power").filter(|s| s.level >= 2.0 && !s.reported.is_empty());
        median(own.filter(|s| (s.result[0] == "named") == named).map(|s| error(s)[1] / error(s)[2]).collect())
    };
    let over_true_floor = |name: &'static str, is_right: &dyn Fn(&Scored) -> bool| {
        let own = part(name).filter(|s| is_right(s));
        median(own.filter_map(|s| Some(s.held_out[1][1] / s.true_floor?)).collect())
    };
    let false_at_most = {
        let all = null.last().map_or((0, 0.0), |r| (r.records, r.found));
        at_most((all.1 * all.0 as f64).round() as usize, all.0)
    };
    let seconds: Vec<f64> = all.iter().map(|s| s.seconds).collect();
    Summary {
        null,
        power,
        power_by_effect: by_kind("power", Some(2.0)),
        coverage: (compared.iter().filter(|c| **c).count() as f64 / compared.len().max(1) as f64, compared.len()),
        leave_one_out,
        two,
        limits,
        corrected_over_floor: [ratio(true), ratio(false)],
        false_at_most,
        uniform: uniform(part("null")),
        over_true_floor: [
            over_true_floor("power", &|s| s.result.first().is_some_and(|r| r == "named")),
            over_true_floor("two", &|_| true),
        ],
        seconds: [median(seconds.clone()), seconds.into_iter().fold(0.0, f64::max)],
    }
}

/// The test of the records' own probabilities, of as many bootstrap records as the first has.
fn uniform<'a>(null: impl Iterator<Item = &'a Scored>) -> Option<Uniform> {
    let own: Vec<[usize; 2]> = null.filter_map(|s| s.bootstrap).collect();
    let records = own.first()?[1];
    let at_least: Vec<usize> = own.iter().filter(|o| o[1] == records).map(|o| o[0]).collect();
    Uniform::of(&at_least, records)
}

/// Upper end of the two-sided 95 % interval of a share, `found` of `all`.
fn at_most(found: usize, all: usize) -> f64 {
    if found >= all {
        return 1.0;
    }
    let beta = Beta::new(found as f64 + 1.0, (all - found) as f64);
    beta.map_or(1.0, |beta| beta.inverse_cdf(0.975))
}

/// Head of [`cells`].
pub const HEAD: [&str; 8] = [
    "",
    "records",
    "found %",
    "named %",
    "right family %",
    "wrong name %",
    "corrected / floor",
    "declared > calibrated > corrected",
];

/// A row as table cells.
pub fn cells(r: &Row) -> Vec<String> {
    let percent = |x: f64| format!("{:.1}", 100.0 * x);
    vec![
        r.group.clone(),
        r.records.to_string(),
        percent(r.found),
        percent(r.named),
        percent(r.right_family),
        percent(r.wrong),
        format!("{:.3}", r.corrected_over_floor),
        r.stages.map(|x| if x.is_finite() { format!("{x:.4}") } else { "-".into() }).join(" > "),
    ]
}

impl Summary {
    /// Titled tables.
    pub fn tables(&self) -> [(&'static str, &[Row]); 6] {
        [
            ("Nothing hidden (found = false terms)", &self.null),
            ("One effect, by level over its detection floor", &self.power),
            ("Every effect at twice its floor", &self.power_by_effect),
            ("The true effect withheld from the library", &self.leave_one_out),
            ("Two at once", &self.two),
            ("Effects at the limit that the loop states for the record without them", &self.limits),
        ]
    }

    /// The tables as Markdown.
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let mut text = String::new();
        for (title, rows) in self.tables() {
            let rows: Vec<&Row> = rows.iter().filter(|r| r.records > 0).collect();
            if rows.is_empty() {
                continue;
            }
            text += &format!("### {title}\n\n");
            text += &line(&HEAD.map(String::from));
            text += &line(&HEAD.map(|_| "---".to_string()));
            rows.iter().for_each(|r| text += &line(&cells(r)));
            text += "\n";
        }
        text += &self.closing();
        text
    }

    /// What is said below the tables.
    fn closing(&self) -> String {
        let ([named, not_named], [one, two]) = (self.corrected_over_floor, self.over_true_floor);
        let text = format!(
            "False terms: at most {:.2} % with 97.5 % confidence. Intervals that cover the truth: {:.1} % of {}. \
             Corrected held-out error over the noise floor that \
             the loop finds, median at twice the floor and above: named {named:.3}, not named {not_named:.3}; over \
             the true one: named {one:.3}, two effects {two:.3}. \
             Seconds per record, generation included: median {:.1}, largest {:.1}.\n",
            100.0 * self.false_at_most,
            100.0 * self.coverage.0,
            self.coverage.1,
            self.seconds[0],
            self.seconds[1]
        );
        text + &self.uniform.as_ref().map(uniform_in_words).unwrap_or_default()
    }

    /// Text for the terminal.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for (title, rows) in self.tables() {
            if rows.iter().any(|r| r.records > 0) {
                let rows: Vec<Vec<String>> = rows.iter().filter(|r| r.records > 0).map(cells).collect();
                text += &format!("{title}\n{}\n", terminal::table(&HEAD, &rows));
            }
        }
        text += &self.closing();
        text
    }
}

/// The test's figures in a sentence.
fn uniform_in_words(test: &Uniform) -> String {
    let Uniform { records, bootstrap, distance, chance, .. } = test;
    format!(
        "The record's own probability by {bootstrap} bootstrap records, on {records} with nothing hidden: \
         Kolmogorov-Smirnov distance from uniform {distance:.3}, \
         probability {chance:.2}.\n"
    )
}
