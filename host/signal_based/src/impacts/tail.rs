//! The probability that a spectrum's background stands as high as a line, beyond its highest peak as well.
//!
//! Within the background it is a rank, which needs no distribution. Above its highest peak the rank alone says one in
//! the number of bins, however high the line. There the tail goes on with the slope of the background's own `k`
//! highest peaks: with a Pareto tail their log-distances are exponential (Renyi; Hill 1975), and a further one beyond
//! the highest has the survival `(1 + y / S)^-k` of an F variable, `S` the sum of the `k` log-excesses over the next
//! peak: the error of the slope is in it. A Pareto tail is heavier than the exponential one of noise, so this errs to
//! the careful side; tones and other combs among the peaks flatten the slope further.

use super::thresholds::TAIL;

/// Background of one spectrum.
pub struct Background {
    ascending: Vec<f64>,
    /// Peaks that the slope is of, and the sum of their log-excesses.
    peaks: f64,
    excess: f64,
}

impl Background {
    /// Of the values but for those left out.
    pub fn of(values: &[f64], is_left_out: impl Fn(usize) -> bool) -> Self {
        let mut ascending: Vec<f64> = (0..values.len()).filter(|i| !is_left_out(*i)).map(|i| values[i]).collect();
        ascending.sort_unstable_by(f64::total_cmp);
        let (peaks, excess) = slope(peaks(values, is_left_out));
        Self { ascending, peaks, excess }
    }

    /// Minus the logarithm of the probability of a value as high.
    pub fn nats(&self, value: f64) -> f64 {
        let count = self.ascending.len();
        let above = count - self.ascending.partition_point(|x| *x < value);
        let rank = ((count as f64 + 1.0) / (above as f64 + 1.0)).ln();
        match self.ascending.last() {
            Some(highest) if above == 0 && self.excess > 0.0 => {
                rank + self.peaks * ((value / highest).ln() / self.excess).ln_1p()
            }
            _ => rank,
        }
    }
}

/// Values that their neighbours do not exceed, each plateau once, the highest first.
fn peaks(values: &[f64], is_left_out: impl Fn(usize) -> bool) -> Vec<f64> {
    let value = |i: usize| values.get(i).copied().unwrap_or(0.0);
    let is_peak = |i: usize| !is_left_out(i) && (i == 0 || value(i) > value(i - 1)) && value(i) >= value(i + 1);
    let mut peaks: Vec<f64> = (0..values.len()).filter(|i| is_peak(*i)).map(value).collect();
    peaks.sort_unstable_by(|a, b| b.total_cmp(a));
    peaks
}

/// Number of the highest peaks and the sum of their log-excesses over the next; zero where there are too few.
fn slope(peaks: Vec<f64>) -> (f64, f64) {
    let count = ((TAIL.0 * peaks.len() as f64) as usize).max(TAIL.1);
    match peaks.get(count) {
        Some(next) if *next > 0.0 => (count as f64, peaks[..count].iter().map(|x| (x / next).ln()).sum()),
        _ => (0.0, 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn theory_within_the_background_it_is_the_share_that_stands_as_high() {
        let values: Vec<f64> = (0..99).map(f64::from).collect();
        let background = Background::of(&values, |_| false);
        assert!((background.nats(98.0) - 50.0_f64.ln()).abs() < 1e-12);
        assert!(background.nats(-1.0).abs() < 1e-12);
        // One peak has no slope: the rank is all there is.
        assert!((background.nats(1e9) - 100.0_f64.ln()).abs() < 1e-12);
    }

    /// Shares of backgrounds of 400 bins in which one further bin has more than so many nats, over what they should be.
    fn exceeded(nats: [f64; 3], of: impl Fn(f64) -> f64) -> [f64; 3] {
        const TRIALS: usize = 20_000;
        let mut random = rand::rngs::StdRng::seed_from_u64(1);
        let mut trial = || {
            let values: Vec<f64> = (0..401).map(|_| of(random.random::<f64>().max(1e-300))).collect();
            Background::of(&values[..400], |_| false).nats(values[400])
        };
        let all: Vec<f64> = (0..TRIALS).map(|_| trial()).collect();
        nats.map(|nats| all.iter().filter(|own| **own >= nats).count() as f64 / TRIALS as f64 / (-nats).exp())
    }

    #[test]
    fn theory_a_probability_beyond_the_highest_peak_is_kept_by_pareto_tails_and_careful_with_noise() {
        let nats = [5.0, 6.0, 7.0];
        for share in exceeded(nats, |u| u.powf(-0.5)) {
            assert!(share < 1.6, "of a Pareto tail: {share} times too often");
        }
        for share in exceeded(nats, |u| -u.ln()) {
            assert!(share < 1.2, "of noise: {share} times too often");
        }
    }

    #[test]
    fn theory_a_line_a_thousand_times_the_noise_has_more_than_its_rank_and_less_beside_tones() {
        let noise = |i: usize| -((i as f64 * 0.618_033_988_75).fract().max(1e-9)).ln();
        let clean: Vec<f64> = (0..2000).map(noise).collect();
        let toned: Vec<f64> = (0..2000).map(|i| if i % 250 == 7 { 300.0 } else { noise(i) }).collect();
        let [clean, toned] = [clean, toned].map(|values| Background::of(&values, |_| false).nats(1000.0));
        assert!(clean > 15.0 && toned > 7.6 && toned < clean - 5.0, "{clean} {toned}");
    }
}
