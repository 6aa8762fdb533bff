//! What the loop said of a record, against what was hidden.

use super::hidden::Hidden;
use crate::signal_based::outcome::{Effect, Outcome};
use crate::terminal;
use serde::{Deserialize, Serialize};

/// One record.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Scored {
    /// `null-number` or `effect-number`.
    pub id: String,
    /// Machine, operation, chain.
    pub bench: String,
    /// What was hidden; empty for nothing.
    pub hidden: String,
    /// The same with every number.
    pub truth: String,
    /// Strength over the record's floor.
    pub level: f64,
    /// named, ambiguous, family, other, missed, nothing; refused where no record or no answer came.
    pub result: String,
    /// Verdict, name, family of every effect reported.
    pub reported: Vec<[String; 3]>,
    /// Evidence of each, nats.
    pub nats: Vec<f64>,
    /// Effects named that are not in the record.
    pub wrong_names: usize,
    /// Effects reported that are neither right nor of the right family.
    pub additions: usize,
    /// Waveform error of the held-out turns: declared, calibrated, corrected, the loop's floor, the true noise's share.
    pub held_out: [f64; 5],
    /// Families judged and refused, or the finding that stopped the search.
    pub refused: Vec<String>,
    /// Seconds of the loop.
    pub seconds: f64,
}

/// How an effect reported compares with the one hidden.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Match {
    None,
    Family,
    Ambiguous,
    Named,
}

fn compare(effect: &Effect, hidden: &Hidden) -> Match {
    let named = hidden.right.iter().any(|right| effect.name.contains(right));
    match (named, effect.verdict.as_str()) {
        (true, "named") => Match::Named,
        (true, _) => Match::Ambiguous,
        (false, verdict) if verdict != "named" && hidden.families.contains(&effect.family.as_str()) => Match::Family,
        _ => Match::None,
    }
}

impl Scored {
    /// Scores an outcome; `held_out[4]` is filled by the caller.
    pub fn judge(&mut self, outcome: &Outcome, hidden: Option<&Hidden>) {
        let matches: Vec<Match> =
            outcome.effects.iter().map(|e| hidden.map_or(Match::None, |h| compare(e, h))).collect();
        self.reported = outcome.effects.iter().map(|e| [e.verdict.clone(), e.name.clone(), e.family.clone()]).collect();
        self.nats = outcome.effects.iter().map(|e| e.evidence.ln_bayes.round()).collect();
        self.additions = matches.iter().filter(|m| **m == Match::None).count();
        let is_wrong = |(e, m): &(&Effect, &Match)| **m == Match::None && e.verdict == "named";
        self.wrong_names = outcome.effects.iter().zip(&matches).filter(is_wrong).count();
        let nothing_to_find = hidden.is_none_or(Hidden::is_unseen);
        self.result = match matches.iter().max() {
            Some(Match::Named) => "named",
            Some(Match::Ambiguous) => "ambiguous",
            Some(Match::Family) => "family",
            Some(Match::None) => "other",
            None if nothing_to_find => "nothing",
            None => "missed",
        }
        .into();
        let held = outcome.held_out;
        self.held_out[..4].copy_from_slice(&[held.declared, held.calibrated, held.corrected, held.noise_floor]);
        let refused = outcome.surrogates.iter().filter_map(|j| Some((j, j.refused.as_ref()?)));
        self.refused = refused.map(|(j, why)| format!("{} ({:.1}): {why}", j.family, j.ln_bayes)).collect();
        if outcome.headline.starts_with("abstained") {
            self.refused.insert(0, outcome.headline.clone());
        }
    }

    fn is_found(&self) -> bool {
        ["named", "ambiguous", "family"].contains(&self.result.as_str())
    }
}

/// One group's counts.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Group.
    pub group: String,
    /// Records.
    pub records: usize,
    /// Share whose effect is reported, by name, among others, or by its family.
    pub found: f64,
    /// Share whose effect is named or among the names in question.
    pub right_name: f64,
    /// Share with a wrong name.
    pub wrong: f64,
    /// Share with anything reported that is not hidden.
    pub additions: f64,
    /// Medians of the held-out error over the true noise: declared, calibrated, corrected; of the loop's floor over it.
    pub over_noise: [f64; 4],
    /// Median of the seconds.
    pub seconds: f64,
}

fn median(mut values: Vec<f64>) -> f64 {
    values.retain(|v| v.is_finite());
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn row(group: impl Into<String>, of: &[&Scored]) -> Row {
    let share = |test: &dyn Fn(&Scored) -> bool| of.iter().filter(|s| test(s)).count() as f64 / of.len().max(1) as f64;
    let over = |i: usize| median(of.iter().map(|s| s.held_out[i] / s.held_out[4]).collect());
    Row {
        group: group.into(),
        records: of.len(),
        found: share(&|s| s.is_found()),
        right_name: share(&|s| ["named", "ambiguous"].contains(&s.result.as_str())),
        wrong: share(&|s| s.wrong_names > 0),
        additions: share(&|s| s.additions > 0),
        over_noise: [over(0), over(1), over(2), over(3)],
        seconds: median(of.iter().map(|s| s.seconds).collect()),
    }
}

/// Tables by title: nothing to find, by level, by effect from four times the floor on.
pub fn tables(all: &[Scored]) -> Vec<(String, Vec<Row>)> {
    let of = |test: &dyn Fn(&Scored) -> bool| all.iter().filter(|s| test(s)).collect::<Vec<_>>();
    let unseen = |s: &Scored| super::hidden::ALL.iter().any(|h| h.name == s.hidden && h.is_unseen());
    let is_power = |s: &Scored| !s.hidden.is_empty() && !unseen(s);
    let mut levels: Vec<f64> = all.iter().filter(|s| is_power(s)).map(|s| s.level).collect();
    levels.sort_by(f64::total_cmp);
    levels.dedup();
    let at_level = |l: &f64| row(format!("{l} x floor"), &of(&|s| is_power(s) && s.level == *l));
    let strong = |s: &Scored| is_power(s) && s.level >= 4.0;
    let by_effect = super::hidden::ALL.iter().filter(|h| !h.is_unseen());
    vec![
        (
            "Nothing to find".into(),
            vec![row("nothing hidden", &of(&|s| s.hidden.is_empty())), row("only mesh lines change", &of(&unseen))],
        ),
        ("One effect, by strength".into(), levels.iter().map(at_level).collect()),
        (
            "Every effect from four times its floor on".into(),
            by_effect
                .map(|h| row(h.name, &of(&|s| strong(s) && s.hidden == h.name)))
                .chain([row("all", &of(&strong))])
                .collect(),
        ),
    ]
}

/// Head of the tables.
pub const HEAD: [&str; 9] = [
    "",
    "records",
    "found %",
    "right name %",
    "wrong name %",
    "additions %",
    "held-out error over noise: declared, calibrated, corrected",
    "loop's floor over noise",
    "s",
];

/// A row as cells.
pub fn cells(row: &Row) -> Vec<String> {
    let percent = |x: f64| format!("{:.1}", 100.0 * x);
    let [declared, calibrated, corrected, floor] = row.over_noise;
    vec![
        row.group.clone(),
        row.records.to_string(),
        percent(row.found),
        percent(row.right_name),
        percent(row.wrong),
        percent(row.additions),
        format!("{declared:.2}, {calibrated:.2}, {corrected:.2}"),
        format!("{floor:.2}"),
        format!("{:.1}", row.seconds),
    ]
}

/// Tables as Markdown.
pub fn markdown(all: &[Scored]) -> String {
    let mut out = String::from("## Tables\n");
    for (title, rows) in tables(all) {
        out += &format!("\n### {title}\n\n| {} |\n|{}\n", HEAD.join(" | "), " --- |".repeat(HEAD.len()));
        for row in rows.iter().filter(|row| row.records > 0) {
            out += &format!("| {} |\n", cells(row).join(" | "));
        }
    }
    out
}

/// Tables as text.
pub fn text(all: &[Scored]) -> String {
    let table = |(title, rows): (String, Vec<Row>)| {
        let rows: Vec<Vec<String>> = rows.iter().filter(|row| row.records > 0).map(cells).collect();
        format!("{title}\n{}", terminal::table(&HEAD, &rows))
    };
    tables(all).into_iter().map(table).collect()
}
