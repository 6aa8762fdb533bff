//! A part of a recording instead of the whole: seconds from its first sample, and where they lie in it.

use crate::{Error, Result, text};
use std::ops::Range;

/// Share of a sample by which a second may miss it.
const ROUNDING: f64 = 1e-6;

/// What is taken of a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// First second.
    pub from_s: f64,
    /// Second behind the last sample; infinite for the end.
    pub to_s: f64,
}

impl Part {
    /// The part that `--from` and `--to` name; `None` where neither is given.
    ///
    /// # Errors
    /// Seconds below 0, and an end that does not lie behind the beginning.
    pub fn new(from_s: Option<f64>, to_s: Option<f64>) -> Result<Option<Self>> {
        let part = Self { from_s: from_s.unwrap_or(0.0), to_s: to_s.unwrap_or(f64::INFINITY) };
        if !(part.from_s >= 0.0 && part.from_s.is_finite()) {
            return Err(Error::invalid("--from", format!("{} is not a second from 0 on", part.from_s)));
        }
        if part.to_s <= part.from_s || part.to_s.is_nan() {
            return Err(Error::invalid("--to", format!("{} s does not lie behind {} s", part.to_s, part.from_s)));
        }
        Ok((from_s.is_some() || to_s.is_some()).then_some(part))
    }

    /// Its samples of a recording, and where they lie in it.
    ///
    /// # Errors
    /// A recording that ends before the part begins.
    pub fn of(&self, place: impl std::fmt::Display, samples: usize, rate_hz: f64) -> Result<(Range<usize>, Cut)> {
        let whole_s = samples as f64 / rate_hz;
        let first = first_sample(self.from_s, rate_hz);
        let end = first_sample(self.to_s, rate_hz).min(samples);
        if first + 1 >= end {
            let what = format!("lasts {} s: --from {} --to {} holds no signal", shown(whole_s), self.from_s, self.to_s);
            return Err(Error::invalid(place, what));
        }
        Ok((first..end, Cut { from_s: first as f64 / rate_hz, to_s: end as f64 / rate_hz, whole_s }))
    }
}

/// Where a part lies in its recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cut {
    /// First sample, s from the recording's first.
    pub from_s: f64,
    /// Behind the last sample, s.
    pub to_s: f64,
    /// Length of the whole recording, s.
    pub whole_s: f64,
}

impl Cut {
    /// For the record and its reader.
    pub fn described(&self) -> String {
        format!("{} s to {} s of {} s", shown(self.from_s), shown(self.to_s), shown(self.whole_s))
    }

    /// Edges from the recording's first sample as edges from the part's, without those outside.
    pub fn moved(&self, edges_s: Vec<f64>) -> Vec<f64> {
        edges_s
            .into_iter()
            .filter(|edge| (self.from_s..=self.to_s).contains(edge))
            .map(|edge| edge - self.from_s)
            .collect()
    }
}

/// The first sample that does not lie before a second.
pub fn first_sample(second: f64, rate_hz: f64) -> usize {
    (second * rate_hz - ROUNDING).ceil().max(0.0) as usize
}

fn shown(seconds: f64) -> String {
    text::number((1e6 * seconds).round() / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_a_part_holds_the_samples_from_its_first_second_up_to_its_last() {
        let part = |from, to| Part::new(from, to).unwrap().unwrap();
        let range = |part: Part| part.of("a", 1000, 100.0).unwrap().0;
        assert_eq!(range(part(Some(1.0), Some(2.5))), 100..250);
        assert_eq!(range(part(None, Some(0.1))), 0..10);
        assert_eq!(range(part(Some(9.0), None)), 900..1000);
        assert_eq!(range(part(Some(0.015), Some(99.0))), 2..1000);
        assert!(part(Some(10.0), None).of("a", 1000, 100.0).unwrap_err().to_string().contains("lasts 10 s"));
        assert!(Part::new(None, None).unwrap().is_none());
        assert!(Part::new(Some(-1.0), None).is_err() && Part::new(Some(2.0), Some(2.0)).is_err());
    }

    #[test]
    fn theory_edges_of_the_whole_recording_become_the_part_s() {
        let cut = Cut { from_s: 1.0, to_s: 3.0, whole_s: 10.0 };
        assert_eq!(cut.moved(vec![0.5, 1.0, 2.25, 3.0, 3.5]), [0.0, 1.25, 2.0]);
    }
}
