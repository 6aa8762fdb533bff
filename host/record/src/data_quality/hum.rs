//! Lines of the mains: at 50 or 60 Hz and its multiples, whatever turns.

use super::thresholds::{HUM_DB, HUM_NEAR, HUM_SHARE};
use super::{Kind, Remark};
use crate::spectral::{Window, power_density};
use crate::text;

/// Grids' frequencies, Hz, and the multiples that are looked at.
const GRIDS_HZ: [f64; 2] = [50.0, 60.0];
const MULTIPLES: [f64; 3] = [1.0, 2.0, 3.0];
/// Longest segment, s: lines are 0.5 Hz wide.
const SEGMENT_S: f64 = 4.0;

/// A remark where at least two multiples of one grid's frequency stand out of a channel.
pub fn remark(index: usize, name: &str, signal: &[f64], rate_hz: f64) -> Option<Remark> {
    let segment = ((SEGMENT_S * rate_hz) as usize).min(signal.len());
    if (segment as f64) < rate_hz {
        return None;
    }
    let density = power_density(signal, rate_hz, segment, Window::Hann);
    let total: f64 = density.values.iter().sum::<f64>() * density.bin;
    let line = |hz: f64| {
        let width = (HUM_NEAR * hz).max(1.5 * density.bin);
        let peak = density.peak_between(hz - width, hz + width)?;
        // A line's top: a slope towards another line is none.
        let top = |i: usize| density.values.get(i).copied().unwrap_or(0.0);
        let is_top = top(peak) > top(peak + 2) && top(peak) > top(peak.saturating_sub(2));
        let floor = density.median_between(hz - 5.0, hz + 5.0);
        let stands = is_top && top(peak) > floor * 10.0_f64.powf(0.1 * HUM_DB);
        let power: f64 = (peak.saturating_sub(2)..=peak + 2).map(top).sum::<f64>() * density.bin;
        stands.then_some(power)
    };
    let found = GRIDS_HZ.iter().filter_map(|grid| {
        let lines: Vec<(f64, f64)> =
            MULTIPLES.iter().map(|m| m * grid).filter_map(|hz| Some((hz, line(hz)?))).collect();
        let share = (lines.iter().map(|(_, power)| power).sum::<f64>() / total.max(f64::MIN_POSITIVE)).sqrt();
        (lines.len() > 1 && share > HUM_SHARE).then_some((lines, share))
    });
    let (lines, share) = found.max_by(|a, b| a.1.total_cmp(&b.1))?;
    let list = lines.iter().map(|(hz, _)| format!("{hz:.0}")).collect::<Vec<_>>().join(", ");
    let text = format!(
        "channel {} ({}) has lines at {list} Hz, {:.1} % of its rms: mains, or a motor's field; a ground loop where \
          they come with the cable",
        index + 1,
        text::name(name),
        100.0 * share
    );
    Some(Remark::new(Kind::Hum, Some(index), text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn theory_mains_is_said_and_a_mesh_beside_it_is_not() {
        let mut state = 9_u64;
        let mut draw = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 31) - 0.5
        };
        let floor: Vec<f64> = (0..20_000).map(|_| draw()).collect();
        let with = |lines: &[(f64, f64)]| -> Vec<f64> {
            let at = |i: usize| lines.iter().map(|(hz, a)| a * (TAU * hz * i as f64 / 2000.0).sin()).sum::<f64>();
            floor.iter().enumerate().map(|(i, x)| x + at(i)).collect()
        };
        assert!(remark(0, "a", &with(&[(50.01, 0.3), (150.03, 0.2)]), 2000.0).is_some());
        assert!(remark(0, "a", &with(&[(51.5, 0.3), (103.0, 0.3)]), 2000.0).is_none());
        assert!(remark(0, "a", &floor, 2000.0).is_none());
    }
}
