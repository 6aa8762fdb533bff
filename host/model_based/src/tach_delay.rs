//! A lag between vibration and tachometer, told from parameters that are a little off.
//!
//! A mode beside its declared frequency turns the phases of the lines around it, and over a band that looks like a
//! lag of some microseconds. The record's check, which knows the declared parameters only, cannot tell the two apart.
//! Here the machine is calibrated both ways, with the tachometer as it is and with a lag as a further unknown: the
//! lag is believed where without it, whatever the parameters, at least twice as much is left at the mesh lines. Cost:
//! two calibrations, in records whose check finds a lag. Limit: a lag together with an effect that moves the mesh
//! lines more than the lag does is not believed, and its phases are left to the search.

use super::base_fit::Base;
use super::calibrate::{calibrate, calibrate_with_lag};
use super::least_squares::{Data, normal, solve, subtract};
use crate::check::{self, Checked, Kind};
use crate::observation::input::Record;

/// Share of what is left at the mesh lines without a lag that may be left with one.
const LARGEST_REST_WITH_LAG: f64 = 0.5;
/// Power of the model over that of noise and slack from which a bin is one of a mesh line.
const LEAST_LINE: f64 = 10.0;
/// Power at the mesh lines over that of noise from which anything is left.
const LEAST_REST: f64 = 1.5;

/// The record as the loop may use it: checked, with a lag of the tachometer only where parameters do not explain it.
pub fn checked(record: &Record) -> Checked {
    let mut checked = check::mended(record);
    let Some(lag_s) = checked.tach_lag_s.filter(|_| !checked.findings.refused()) else { return checked };
    let mut straight = checked.record.clone();
    later(&mut straight, -lag_s);
    let runs: Vec<usize> = (0..straight.runs.len()).collect();
    let mut base = Base::new(&straight);
    calibrate(&mut base, &runs);
    let without = left_at_lines(&base, &runs);
    let mut base = Base::new(&checked.record);
    let more_s = calibrate_with_lag(&mut base, &runs);
    let with = left_at_lines(&base, &runs);
    if without < LEAST_REST || with - 1.0 > LARGEST_REST_WITH_LAG * (without - 1.0) {
        checked.record = straight;
        checked.findings.list.retain(|finding| finding.kind != Kind::TachDelay);
        return checked;
    }
    later(&mut checked.record, more_s);
    let lag_s = lag_s + more_s;
    for finding in checked.findings.list.iter_mut().filter(|finding| finding.kind == Kind::TachDelay) {
        finding.figure = lag_s;
        finding.text = format!(
            "the vibration comes {:+.1} us after the tach in all runs (left at the mesh lines, parameters fitted: \
             {with:.2} times the noise with that lag, {without:.2} without): delay of the tach, or of the channels; \
             the tach is moved by that",
            1e6 * lag_s
        );
    }
    checked
}

fn later(record: &mut Record, by_s: f64) {
    record.runs.iter_mut().flat_map(|run| &mut run.edges_s).for_each(|t| *t += by_s);
}

/// Power at the mesh lines over that of noise and model slack, with the parameters and the runs' own angles and
/// speeds at their best.
fn left_at_lines(base: &Base, runs: &[usize]) -> f64 {
    let mut rest: Data = base.data();
    let columns = base.columns();
    let x: Vec<f64> = solve(&normal(&rest, runs, &columns)).x.iter().copied().collect();
    subtract(&mut rest, &columns, &x);
    let (mut power, mut lines) = (0.0, 1e-300);
    for &r in runs {
        for (channel, residual) in rest.residual[r].iter().enumerate() {
            let levels = base.unexplainable(r, channel, residual);
            for ((x, model), level) in residual.iter().zip(&base.runs[r].model[channel]).zip(levels) {
                if model.norm_sqr() > LEAST_LINE * level {
                    power += x.norm_sqr() / level;
                    lines += 1.0;
                }
            }
        }
    }
    power / lines
}
