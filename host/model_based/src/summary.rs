//! The answer in a few lines of text.

use super::limits::Limit;
use super::outcome::Outcome;
use std::collections::BTreeMap;

impl Outcome {
    /// A few lines for the terminal: what is wrong with the record, the answer, then the figures.
    pub fn summary(&self) -> String {
        let mut text = self.findings.text();
        text += &format!("{}\n", self.headline);
        for (who, e) in [("fit", &self.error.fit_runs), ("held out", &self.error.held_out_runs)] {
            text += &format!("{who:9} NRMSE declared, calibrated, corrected:");
            for (part, s) in [("shaft-synchronous", e.shaft_synchronous), ("whole", e.whole_signal)] {
                let (declared, calibrated, corrected, floor) = (s.declared, s.calibrated, s.corrected, s.noise_floor);
                text += &format!(" {part} {declared:.4}, {calibrated:.4}, {corrected:.4} (noise {floor:.4})");
            }
            text += "\n";
        }
        for e in &self.effects {
            let seat = e
                .order_of_pinion
                .map(|o| format!("order {o:.4}"))
                .or(e.frequency_hz.map(|f| format!("{f:.2} Hz")))
                .unwrap_or_default();
            text += &format!("{} [{}, {}] {seat}\n", e.verdict_and_name(), e.family, e.shaft);
            for (name, v) in e.parameters.iter().take(6) {
                text += &format!("    {name} = {:.4e} [{:.4e}, {:.4e}] {}\n", v.value, v.ci95[0], v.ci95[1], v.unit);
            }
            if let Some(turns) = &e.pinion_turns_of_runs {
                text += &format!("    runs start {turns:?} turns of the pinion later than counted\n");
            }
            let next: Vec<String> = e.evidence.next.iter().map(|(name, drop)| format!("{name} {drop:.1}")).collect();
            text += &format!(
                "    left at its lines {:.4}, p {}, score over the next {} nats, held-out gain {:.4}, speed^{} \
                 torque^{}, next {}\n",
                e.evidence.left_at_its_lines,
                e.evidence.chance.map_or_else(|| "-".into(), |p| p.to_string()),
                or_dash(e.evidence.score_over_next),
                e.evidence.held_out_gain,
                or_dash(e.evidence.speed_exponent),
                or_dash(e.evidence.torque_exponent),
                next.join(", ")
            );
            if let Some(experiment) = &e.deciding_experiment {
                text += &format!("    would decide: {experiment}\n");
            }
        }
        text += &self.null_records.map(|null| null.in_words()).unwrap_or_default();
        text += &limits_in_words(&self.limits);
        for u in &self.unexplained {
            text += &format!("unexplained: {} ({:.3} % of variance)\n", u.description, 100.0 * u.variance_share);
        }
        text
    }
}

/// Limits of the half, by the simulator's key.
fn limits_in_words(limits: &[Limit]) -> String {
    if limits.is_empty() {
        return String::new();
    }
    let mut by_key: BTreeMap<&str, Vec<String>> = BTreeMap::new();
    for limit in limits {
        let strength = limit.found_in_half.map_or_else(|| "none".into(), |s| format!("{s:.2e}"));
        let own = by_key.entry(&limit.strength).or_default();
        own.push(if limit.at.is_empty() { strength } else { format!("{} {strength}", limit.at) });
    }
    let rows: Vec<String> = by_key.iter().map(|(key, all)| format!("{key} {}", all.join(", "))).collect();
    format!("not found; would have been, in half of the places tried, from: {}\n", rows.join("; "))
}

/// A figure that may be unknown.
fn or_dash(value: Option<f64>) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.3}"))
}
