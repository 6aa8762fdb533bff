//! Sharp and smooth edges: the same machine recorded twice, once with tachometer edges over a few samples and once
//! with edges within one, as a logic signal has them.
//!
//! What is sampled of a sharp edge is its time to a whole sample: a uniform error that lays skirts about high orders
//! and lowers their lines. Both records must show the same families and the same mesh lines; what a record shows
//! beyond what is hidden is counted. Every second pair hides an effect at twenty times its floor. Cost: two
//! records, two analyses and two searches per pair, some ten seconds.

use super::bench::Bench;
use super::campaign::stream;
use super::hidden::{ALL, Hidden, Source};
use super::make;
use super::score::Scored;
use crate::analysis::{self, Choice};
use crate::record::Record;
use crate::signal_based::{self, preflight::Preflight};
use crate::terminal::{Progress, table};
use crate::{Error, Result};
use rand::RngExt;
use serde::Serialize;

/// Strength of what is hidden, times its floor.
const LEVEL: f64 = 20.0;
/// Samples of a smooth edge, and the share of the distance of two pulses that it takes at most.
const SMOOTH_SAMPLES: f64 = 3.0;
const SMOOTH_SHARE: f64 = 0.1;
/// Share of the rate up to which mesh lines are compared.
const PASS_SHARE: f64 = 0.4;
/// Height over the noise from which a mesh line is compared, times its floor's amplitude: its own noise is then below
/// a twentieth of a decibel.
const MIN_FLOOR_RATIO: f64 = 200.0;

/// What one of the two records shows.
#[derive(Debug, Clone, Serialize)]
pub struct Seen {
    /// Verdict and family of every effect, sorted.
    pub families: Vec<[String; 2]>,
    /// Effects that are not what is hidden.
    pub additions: usize,
    /// Effects named that are not hidden.
    pub wrong_names: usize,
    /// Orders that `analyse` lists as unexplained, in all channels.
    pub unexplained: usize,
    /// Jitter of the edges as declared by the import, s.
    pub jitter_s: f64,
}

/// A pair of records.
#[derive(Debug, Clone, Serialize)]
pub struct Pair {
    /// Number, which with the seed draws it.
    pub number: u64,
    /// Machine, operation, chain.
    pub bench: String,
    /// What was hidden; empty for nothing.
    pub hidden: String,
    /// With smooth edges, with sharp ones.
    pub seen: [Seen; 2],
    /// Mesh lines compared.
    pub lines: usize,
    /// The largest difference of their amplitudes, dB.
    pub worst_db: f64,
}

impl Pair {
    /// Whether both show the same families.
    pub fn agrees(&self) -> bool {
        self.seen[0].families == self.seen[1].families
    }
}

/// Draws, records and compares `count` pairs.
///
/// # Errors
/// A record that cannot be made or read.
pub fn pairs(count: usize, seed: u64) -> Result<Vec<Pair>> {
    let bar = Progress::new("pairs", count as u64);
    let mut pairs = Vec::new();
    let mut number = 0;
    while pairs.len() < count {
        if let Some(pair) = pair(number, seed, pairs.len())? {
            pairs.push(pair);
            bar.step();
        }
        number += 1;
    }
    Ok(pairs)
}

/// The pair of a number; none where what is drawn has no tachometer.
fn pair(number: u64, seed: u64, place: usize) -> Result<Option<Pair>> {
    let mut random = stream(seed, number);
    let mut bench = Bench::drawn(&mut random)?;
    let Some(wheel) = bench.field.tach else { return Ok(None) };
    let own: Vec<&Hidden> =
        ALL.iter().filter(|h| !matches!(h.source, Source::Clipping | Source::Unseen(_) | Source::Tone(_))).collect();
    let hidden = (place % 2 == 1).then(|| own[place / 2 % own.len()]);
    let record_seed = random.random();
    let between_pulses_s = 1.0 / (f64::from(wheel.pulses) * bench.speeds_hz[1]);
    let smooth_s = (SMOOTH_SAMPLES / bench.rate_hz).min(SMOOTH_SHARE * between_pulses_s);
    let mut recorded = |rise_s: f64| -> Result<Record> {
        bench.field.tach = Some(crate::field::Wheel { rise_s, ..wheel });
        Ok(make::record(&bench, hidden.map(|h| (h, LEVEL)), record_seed)?.record)
    };
    let records = [recorded(smooth_s)?, recorded(0.0)?];
    let [smooth, sharp] = [seen(&records[0], hidden)?, seen(&records[1], hidden)?];
    let (lines, worst_db) = compared(&smooth.1, &sharp.1, bench.rate_hz)?;
    Ok(Some(Pair {
        number,
        bench: bench.words(),
        hidden: hidden.map_or_else(String::new, |h| h.name.to_owned()),
        seen: [smooth.0, sharp.0],
        lines,
        worst_db,
    }))
}

fn seen(record: &Record, hidden: Option<&Hidden>) -> Result<(Seen, analysis::Outcome)> {
    let analysed = analysis::record(record, Choice { run: None, channel: None })?;
    let found = signal_based::run(record, &Preflight::of(record))?;
    let mut scored = Scored::default();
    scored.judge(&found, hidden);
    let mut families: Vec<[String; 2]> =
        found.effects.iter().map(|effect| [effect.verdict.clone(), effect.family.clone()]).collect();
    families.sort();
    let channels = analysed.runs.iter().flat_map(|run| &run.channels);
    let unexplained = channels.map(|own| own.unexplained.spectrum.len() + own.unexplained.envelope.len()).sum();
    let jitter_s = record.declaration.tach.as_ref().and_then(|tach| tach.jitter_s).unwrap_or(0.0);
    let seen = Seen { families, additions: scored.additions, wrong_names: scored.wrong_names, unexplained, jitter_s };
    Ok((seen, analysed))
}

/// Mesh lines of both analyses that stand far over the noise: how many, and the largest difference, dB.
fn compared(smooth: &analysis::Outcome, sharp: &analysis::Outcome, rate_hz: f64) -> Result<(usize, f64)> {
    let lines = |outcome: &analysis::Outcome| -> Vec<(f64, f64, f64)> {
        let channels = outcome.runs.iter().flat_map(|run| &run.channels);
        let of = |own: &analysis::ChannelOutcome| {
            let floor = own.order_spectrum.spectrum.clone();
            let line = |h: &analysis::sidebands::Harmonic| {
                (h.frequency_hz, h.line.amplitude, near_floor(&floor, h.line.order))
            };
            own.mesh.iter().map(line).collect::<Vec<_>>()
        };
        channels.flat_map(of).collect()
    };
    let (smooth, sharp) = (lines(smooth), lines(sharp));
    if smooth.len() != sharp.len() {
        return Err(Error::invalid("pair", "the two records hold different numbers of mesh harmonics"));
    }
    let stands = |line: &(f64, f64, f64)| line.0 < PASS_SHARE * rate_hz && line.1 > MIN_FLOOR_RATIO * line.2;
    let all = smooth.iter().zip(&sharp).filter(|(a, _)| stands(a));
    let differences: Vec<f64> = all.map(|(a, b)| 20.0 * (b.1 / a.1).log10().abs()).collect();
    Ok((differences.len(), differences.iter().copied().fold(0.0, f64::max)))
}

/// Median amplitude of the spectrum about an order, half a mesh order to each side at most.
fn near_floor(spectrum: &crate::spectral::Spectrum, order: f64) -> f64 {
    const BINS: usize = 400;
    let at = (order / spectrum.bin) as usize;
    let mut near = spectrum
        .values
        .get(at.saturating_sub(BINS)..(at + BINS).min(spectrum.values.len()))
        .map_or_else(Vec::new, <[f64]>::to_vec);
    near.sort_by(f64::total_cmp);
    near.get(near.len() / 2).copied().unwrap_or(f64::INFINITY)
}

/// The pairs as a table, and what they say together.
pub fn text(pairs: &[Pair], seed: u64) -> String {
    let row = |pair: &Pair| {
        let of = |f: &dyn Fn(&Seen) -> usize| format!("{} / {}", f(&pair.seen[0]), f(&pair.seen[1]));
        vec![
            pair.number.to_string(),
            pair.bench.clone(),
            if pair.hidden.is_empty() { "nothing".into() } else { pair.hidden.clone() },
            if pair.agrees() { "same".into() } else { "differ".into() },
            of(&|seen| seen.additions),
            of(&|seen| seen.unexplained),
            format!("{:.1}", 1e6 * pair.seen[1].jitter_s),
            pair.lines.to_string(),
            format!("{:.3}", pair.worst_db),
        ]
    };
    let head = ["pair", "bench", "hidden", "families", "false", "unexplained", "jitter, us", "lines", "worst, dB"];
    let rows: Vec<Vec<String>> = pairs.iter().map(row).collect();
    let count = |test: &dyn Fn(&Pair) -> bool| pairs.iter().filter(|pair| test(pair)).count();
    let worst = pairs.iter().map(|pair| pair.worst_db).fold(0.0, f64::max);
    format!(
        "{}\nseed {seed}: {} pairs, smooth / sharp edges; same families {}; with a false family {} / {}, with a wrong \
         name {} / {}; mesh lines within 0.1 dB in {}, worst {worst:.3} dB\n",
        table(&head, &rows),
        pairs.len(),
        count(&Pair::agrees),
        count(&|pair| pair.seen[0].additions > 0),
        count(&|pair| pair.seen[1].additions > 0),
        count(&|pair| pair.seen[0].wrong_names > 0),
        count(&|pair| pair.seen[1].wrong_names > 0),
        count(&|pair| pair.worst_db < 0.1),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Short form of `meshband-validate prove --field --edges 50`: a wheel of eight marks on the gear.
    #[test]
    fn claim_sharp_edges_of_a_wheel_show_what_smooth_ones_show() {
        let pair = pair(2, 3, 0).expect("a pair").expect("with a tachometer");
        let [smooth, sharp] = &pair.seen;
        assert!(sharp.jitter_s > 1e-5 && smooth.jitter_s < 1e-5, "{:e}, {:e}", smooth.jitter_s, sharp.jitter_s);
        assert!(pair.agrees() && smooth.additions + sharp.additions == 0, "{pair:?}");
        assert_eq!(smooth.unexplained + sharp.unexplained, 0, "{pair:?}");
        assert!(pair.lines > 10 && pair.worst_db < 0.1, "{pair:?}");
    }
}
