//! What a campaign found: counts per family, every failure with the command that makes it again, as JSON and Markdown.

use super::campaign::{Campaign, End, Made, Outcome};
use super::families::FAMILIES;
use super::oracle::Failure;
use serde_json::{Value, json};

/// Counts of one family.
struct Row {
    name: &'static str,
    meaning: &'static str,
    tried: usize,
    ends: [usize; 3],
    failures: Vec<usize>,
}

fn rows(outcome: &Outcome) -> Vec<Row> {
    let row = |family: &super::families::Family| {
        let made: Vec<&Made> = outcome.made.iter().filter(|made| made.family == family.name).collect();
        let ended = |end: End| made.iter().filter(|made| made.end == end).count();
        let with = |failure: &Failure| made.iter().filter(|m| m.findings.iter().any(|(f, _)| f == failure)).count();
        Row {
            name: family.name,
            meaning: family.meaning,
            tried: made.len(),
            ends: [End::Accepted, End::Refused, End::Ended].map(ended),
            failures: Failure::ALL.iter().map(with).collect(),
        }
    };
    FAMILIES.iter().map(row).filter(|row| row.tried > 0).collect()
}

/// Attacks with failures.
pub fn failed(outcome: &Outcome) -> Vec<&Made> {
    outcome.made.iter().filter(|made| !made.findings.is_empty()).collect()
}

/// The command that makes an attack again.
pub fn again(seed: u64, made: &Made) -> String {
    format!("cargo xtask damage --seed {seed} --only {}:{}", made.family, made.index)
}

/// Everything for machines.
pub fn json(campaign: &Campaign, outcome: &Outcome) -> Value {
    let families: Vec<Value> = rows(outcome)
        .iter()
        .map(|row| {
            let failures: serde_json::Map<String, Value> =
                Failure::ALL.iter().zip(&row.failures).map(|(f, n)| (f.name().to_owned(), json!(n))).collect();
            let [accepted, refused, ended] = row.ends;
            json!({
                "family": row.name, "tried": row.tried, "accepted": accepted, "refused": refused, "ended": ended,
                "failures": failures,
            })
        })
        .collect();
    let failures: Vec<Value> = failed(outcome)
        .iter()
        .map(|made| {
            let findings: Vec<Value> =
                made.findings.iter().map(|(kind, what)| json!({ "kind": kind.name(), "what": what })).collect();
            json!({
                "family": made.family, "index": made.index, "damage": made.what, "commands": made.lines,
                "findings": findings, "again": again(campaign.seed, made),
            })
        })
        .collect();
    json!({
        "seed": campaign.seed, "attacks": outcome.made.len(), "not_possible_here": outcome.impossible,
        "families": families, "failures": failures,
    })
}

/// The page of the documentation.
pub fn markdown(campaign: &Campaign, outcome: &Outcome) -> String {
    let rows = rows(outcome);
    let failed = failed(outcome);
    let mut text = format!(
        "# Damage campaign\n\nAttacks on the command `meshband`, made by `cargo xtask damage --cases {} --seed {}`; \
         what is judged and how is said in\n`tests/src/damage/oracle.rs`. A bounded part runs with the tests \
         (`tests/tests/damage.rs`).\n\n\
         {} attacks, {} with failures{}.\n\n| family | attacked | tried | accepted | refused | ended |",
        campaign.cases,
        campaign.seed,
        outcome.made.len(),
        failed.len(),
        if outcome.impossible > 0 {
            format!("; {} could not be made on this machine", outcome.impossible)
        } else {
            String::new()
        },
    );
    for failure in Failure::ALL {
        text += &format!(" {} |", failure.name());
    }
    text += &format!("\n| --- | --- |{}\n", " ---: |".repeat(4 + Failure::ALL.len()));
    let mut sums = vec![0; 4 + Failure::ALL.len()];
    for row in &rows {
        let cells: Vec<usize> = [row.tried].into_iter().chain(row.ends).chain(row.failures.iter().copied()).collect();
        sums.iter_mut().zip(&cells).for_each(|(sum, cell)| *sum += cell);
        text += &format!("| {} | {} |{}\n", row.name, row.meaning, numbers(&cells));
    }
    text += &format!("| all | |{}\n", numbers(&sums));
    text += "\nAccepted: exit code 0 with a complete result. Refused: exit code 2 with one line. Ended: by the \
        attack's signal or closed pipe.\n";
    if !failed.is_empty() {
        text += "\n## Failures\n\n| attack | damage | found |\n| --- | --- | --- |\n";
        for made in &failed {
            let found: Vec<String> =
                made.findings.iter().map(|(kind, what)| format!("{}: {what}", kind.name())).collect();
            let attack = format!("{}:{}", made.family, made.index);
            text += &format!("| {attack} | {} | {} |\n", cell(&made.what), cell(&found.join("; ")));
        }
    }
    text
}

fn numbers(cells: &[usize]) -> String {
    cells.iter().map(|cell| format!(" {cell} |")).collect()
}

/// Text without control characters.
pub fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() || ('\u{202a}'..='\u{202e}').contains(&c) { '·' } else { c }).collect()
}

/// Text that cannot leave its cell.
fn cell(text: &str) -> String {
    let short: String = printable(text).chars().take(160).collect();
    short.replace('|', "\\|").replace('<', "&lt;")
}
