//! Samples of one channel: flat tops, standstill, blocks that come again.
//!
//! Flat tops are seen by the samples that pile up at the largest or smallest value, wherever that lies: a limit of
//! the sensor is not the full scale of the file. Limits: a channel behind a filter that rounds its tops off is not
//! seen. Cost: linear.

use super::thresholds::{
    BLOCK, BLOCK_VALUES, FLAT_TOP_SAMPLES, LEAST_TOPS, LIMIT_STRIP_SHARE, LOOP_SHARE, MAX_CODE_STEP_SHARE,
    MIN_LIMIT_SAMPLES, MIN_PILE_RATIO, MIN_STANDSTILL_RUN_RATIO, MIN_STANDSTILL_SAMPLES, STANDSTILL_S,
};
use super::{Kind, Remark};
use crate::text;
use std::collections::HashMap;
use std::ops::Range;

/// What the samples of channel `index` say; an empty channel says nothing.
pub fn remarks(index: usize, name: &str, signal: &[f64], rate_hz: f64) -> Vec<Remark> {
    let name = format!("channel {} ({})", index + 1, text::name(name));
    let mut remarks = Vec::new();
    let mut say = |kind, what: String| remarks.push(Remark::new(kind, Some(index), format!("{name} {what}")));
    let Some((low, high)) = range(signal) else { return remarks };
    if low == high {
        say(Kind::Constant, format!("is constant ({low:.4}): it does not move at all"));
        return remarks;
    }
    let still = standstill(signal, rate_hz);
    if let Some(first) = still.first() {
        let samples: usize = still.iter().map(ExactSizeIterator::len).sum();
        let value = signal[first.start];
        let what = if value == 0.0 { "zero".to_string() } else { format!("constant at {value:.4}") };
        say(
            Kind::Constant,
            format!(
                "is {what} for {:.3} s from {:.3} s on{}, {:.1} % of the run: a dead stretch that every average holds",
                first.len() as f64 / rate_hz,
                first.start as f64 / rate_hz,
                if still.len() > 1 {
                    format!(" and stands still at {} more places", still.len() - 1)
                } else {
                    String::new()
                },
                100.0 * samples as f64 / signal.len() as f64
            ),
        );
    }
    for (limit, sign) in [(high, 1.0), (low, -1.0)] {
        if let Some((count, tops, at)) = flat_tops(signal, limit, sign, high - low, &still) {
            say(
                Kind::Clipped,
                format!(
                    "is clipped at {limit:.4}: {count} samples in {tops} flat tops, the first at {:.4} s; \
                      amplitudes are too small",
                    at as f64 / rate_hz
                ),
            );
        }
    }
    if let Some((from, again, length)) = repeated(signal, &still) {
        say(
            Kind::Repeated,
            format!(
                "repeats {length} samples exactly: those from {:.4} s come again at {:.4} s; a buffer was written \
                  twice",
                from as f64 / rate_hz,
                again as f64 / rate_hz
            ),
        );
    }
    remarks
}

fn range(signal: &[f64]) -> Option<(f64, f64)> {
    let first = *signal.first()?;
    Some(signal.iter().fold((first, first), |(low, high), x| (low.min(*x), high.max(*x))))
}

/// Runs of equal samples.
fn equal_runs(signal: &[f64]) -> Vec<Range<usize>> {
    let mut runs = Vec::new();
    let mut from = 0;
    for i in 1..=signal.len() {
        if i == signal.len() || signal[i] != signal[from] {
            runs.push(from..i);
            from = i;
        }
    }
    runs
}

/// Stretches of equal samples that are far longer than the channel's steps make them.
fn standstill(signal: &[f64], rate_hz: f64) -> Vec<Range<usize>> {
    let runs = equal_runs(signal);
    // The length that half of the samples' runs have at most, without those that stand.
    let mut lengths: Vec<usize> = runs.iter().map(ExactSizeIterator::len).collect();
    let middle = lengths.len() / 2;
    let usual = *lengths.select_nth_unstable(middle).1;
    let least = MIN_STANDSTILL_SAMPLES.max(MIN_STANDSTILL_RUN_RATIO * usual).max((STANDSTILL_S * rate_hz) as usize);
    runs.into_iter().filter(|run| run.len() >= least).collect()
}

/// Samples at a limit, flat tops, and the first of them; `None` where no more lie there than beside it.
fn flat_tops(
    signal: &[f64],
    limit: f64,
    sign: f64,
    range: f64,
    still: &[Range<usize>],
) -> Option<(usize, usize, usize)> {
    // Of coarse codes the strip beside the limit holds the next code; of very coarse ones that is no measure.
    let next = signal.iter().map(|x| sign * (limit - x)).filter(|gap| *gap > 0.0).fold(f64::INFINITY, f64::min);
    let width =
        if next.is_finite() { (0.999 * next).max(LIMIT_STRIP_SHARE * range) } else { LIMIT_STRIP_SHARE * range };
    if width > MAX_CODE_STEP_SHARE * range {
        return None;
    }
    let depth = |x: f64| sign * (limit - x) / width;
    let stands = |i: usize| still.iter().any(|run| run.contains(&i));
    let (mut at, mut beside, mut tops, mut row, mut first) = (0, 0, 0, 0, None);
    for (i, x) in signal.iter().enumerate() {
        let depth = depth(*x);
        // Nearly all samples lie far from the limit.
        if depth >= 2.0 {
            row = 0;
            continue;
        }
        beside += usize::from((1.0..2.0).contains(&depth));
        if depth >= 1.0 || stands(i) {
            row = 0;
            continue;
        }
        at += 1;
        row += 1;
        if row == FLAT_TOP_SAMPLES {
            tops += 1;
            first.get_or_insert(i + 1 - FLAT_TOP_SAMPLES);
        }
    }
    let piled_up = at as f64 > MIN_PILE_RATIO * beside.max(1) as f64;
    (at >= MIN_LIMIT_SAMPLES && tops >= LEAST_TOPS && piled_up).then(|| (at, tops, first.unwrap_or(0)))
}

/// The first block that comes again, where, and for how long it goes on; `None` too where the signal is a loop all
/// along.
fn repeated(signal: &[f64], still: &[Range<usize>]) -> Option<(usize, usize, usize)> {
    if signal.len() < 4 * BLOCK {
        return None;
    }
    // A rolling hash over every block; those at whole multiples of the block are remembered.
    const HASH_SLOTS: usize = 1 << 16;
    const BASE: u64 = 0x9E37_79B9_7F4A_7C15;
    let word = |x: f64| x.to_bits().wrapping_mul(0xD6E8_FEB8_6659_FD93) ^ 0x2545_F491;
    let top = (0..BLOCK - 1).fold(1_u64, |power, _| power.wrapping_mul(BASE));
    let mut hash = signal[..BLOCK].iter().fold(0_u64, |hash, x| hash.wrapping_mul(BASE).wrapping_add(word(*x)));
    let mut known: HashMap<u64, usize> = HashMap::new();
    // Whether any known hash has the same middle bits: nearly every place is told by this table alone.
    let mut seen = vec![false; HASH_SLOTS];
    let slot = |hash: u64| (hash >> 40) as usize % HASH_SLOTS;
    let (mut found, mut covered, mut i) = (None, 0, 0);
    loop {
        if seen[slot(hash)]
            && let Some(&before) = known.get(&hash)
            && i >= before + BLOCK
            && signal[before..before + BLOCK] == signal[i..i + BLOCK]
            && varies(&signal[i..i + BLOCK])
            && !still.iter().any(|run| run.contains(&i))
        {
            covered += 1;
            if found.is_none() {
                let pairs = signal[before..i].iter().zip(&signal[i..]);
                found = Some((before, i, pairs.take_while(|(a, b)| a == b).count()));
            }
        }
        if i.is_multiple_of(BLOCK) {
            known.entry(hash).or_insert(i);
            seen[slot(hash)] = true;
        }
        if i + BLOCK >= signal.len() {
            break;
        }
        let gone = word(signal[i]).wrapping_mul(top);
        hash = hash.wrapping_sub(gone).wrapping_mul(BASE).wrapping_add(word(signal[i + BLOCK]));
        i += 1;
    }
    // One block in so many places is looked at: as many found are the whole signal.
    let share = covered as f64 * BLOCK as f64 / signal.len() as f64;
    found.filter(|_| share < LOOP_SHARE)
}

/// Whether a block has enough different values to be no accident of few codes.
fn varies(block: &[f64]) -> bool {
    let mut values: Vec<u64> = block.iter().map(|x| x.to_bits()).collect();
    values.sort_unstable();
    values.dedup();
    values.len() >= BLOCK_VALUES
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(count: usize) -> Vec<f64> {
        let mut state = 5_u64;
        (0..count)
            .map(|i| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                let u = (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5;
                3.0 * (0.3 * i as f64).sin() + 2.0 * (0.211 * i as f64).cos() + u
            })
            .collect()
    }

    fn kinds(signal: &[f64]) -> Vec<Kind> {
        remarks(0, "a", signal, 1000.0).into_iter().map(|remark| remark.kind).collect()
    }

    #[test]
    fn theory_a_sound_signal_a_sine_and_coarse_codes_say_nothing() {
        let sound = noise(20_000);
        assert_eq!(kinds(&sound), []);
        let coarse: Vec<f64> = sound.iter().map(|x| x.round()).collect();
        assert_eq!(kinds(&coarse), []);
        let sine: Vec<f64> = (0..20_000).map(|i| (0.01234 * f64::from(i)).sin()).collect();
        assert_eq!(kinds(&sine), []);
    }

    #[test]
    fn fault_flat_tops_on_one_side_standstill_and_a_block_written_twice_are_said() {
        let sound = noise(20_000);
        let clipped: Vec<f64> = sound.iter().map(|x| x.min(2.5)).collect();
        assert_eq!(kinds(&clipped), [Kind::Clipped]);
        let both: Vec<f64> = sound.iter().map(|x| x.clamp(-2.5, 2.5)).collect();
        assert_eq!(kinds(&both), [Kind::Clipped, Kind::Clipped]);
        let mut still = sound.clone();
        still[4000..9000].fill(1.25);
        assert_eq!(kinds(&still), [Kind::Constant]);
        let mut dropped = sound.clone();
        dropped[15_000..].fill(0.0);
        assert!(remarks(0, "a", &dropped, 1000.0)[0].text.contains("is zero for 5.000 s from 15.000 s on, 25.0 %"));
        let mut twice = sound;
        let block = twice[6400..7424].to_vec();
        twice[7424..8448].copy_from_slice(&block);
        assert_eq!(kinds(&twice), [Kind::Repeated]);
        assert_eq!(kinds(&[2.0; 500]), [Kind::Constant]);
        assert_eq!(kinds(&[]), []);
    }

    #[test]
    fn theory_few_codes_and_two_levels_are_no_flat_tops() {
        // Codes of 2 m/s2 of a signal of 6.
        let few: Vec<f64> = noise(20_000).iter().map(|x| (x / 2.0).round() * 2.0).collect();
        assert_eq!(kinds(&few), []);
        let pulses: Vec<f64> = (0..20_000).map(|i| if i % 40 < 3 { 5.0 } else { 0.0 }).collect();
        assert!(!kinds(&pulses).contains(&Kind::Clipped));
    }
}
