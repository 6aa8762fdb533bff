//! What import did to the pulses of a run, read back from its record: pulses put in and taken out change every angle.

use crate::record::Run;

/// One sentence; none where nothing was put in, taken out or left out of step, or the pulses are not measured.
pub fn of(run: &Run) -> Option<String> {
    let figures = run.declaration.other.get("measured_tach")?.as_table()?;
    let count = |kind: &str| -> i64 {
        let places = figures.get(kind).and_then(|places| places.as_array()).into_iter().flatten();
        places.filter_map(|place| place.get("pulses")?.as_integer()).sum()
    };
    let kinds = [("lost", "lost and put in"), ("doubled", "doubled and taken out"), ("irregular", "out of step")];
    let said = kinds.iter().map(|(kind, words)| (count(kind), words)).filter(|(count, _)| *count > 0);
    let said: Vec<String> = said.map(|(count, words)| format!("{count} {words}")).collect();
    (!said.is_empty()).then(|| {
        let places = "record.toml says where: run.measured_tach";
        format!("the tachometer's pulses at import: {} ({places})", said.join(", "))
    })
}
