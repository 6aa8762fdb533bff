//! Least-squares fit of a law to bandwidths at known speeds, with intervals.
//!
//! Errors that matter are relative (a sampling rate 1 % too low is 1 % too low at every speed), so every
//! form is fitted to the logarithm of the bandwidth by Gauss-Newton with step halving. The parabola is also
//! what the paper fits, but it fits absolute values: `fit_quadratic_absolute` does exactly that for the
//! comparison. Intervals are the linearised 95 % ones: they describe scatter about the form, not the
//! error of the form itself, which only held-out speeds show.

use super::forms::{Law, RISE_TIME_PRODUCT};
use super::point::Point;
use crate::{Error, Result};
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A fitted law with what is known about it.
#[derive(Debug, Clone, serde::Serialize)]
pub struct Fit {
    /// The law.
    pub law: Law,
    /// Half widths of the 95 % intervals of the coefficients, in their order.
    pub half_width_95: Vec<f64>,
    /// Largest relative error over the fitted points.
    pub worst_relative: f64,
    /// Root-mean-square relative error over the fitted points.
    pub rms_relative: f64,
    /// Number of points.
    pub points: usize,
    /// Lowest and highest fitted speed, Hz: the law's domain.
    pub domain_hz: [f64; 2],
}

/// Relative error of `law` at each point: law / point - 1.
pub fn relative_errors(law: &Law, points: &[Point]) -> Vec<f64> {
    points.iter().map(|p| law.bandwidth_hz(p.shaft_hz) / p.bandwidth_hz - 1.0).collect()
}

/// Fits the form of `start` to `points`, beginning at its coefficients.
///
/// # Errors
/// With fewer points than coefficients plus two, or where no step reduces the error from a useless start.
pub fn fit(start: Law, points: &[Point]) -> Result<Fit> {
    let count = start.coefficients().len();
    if points.len() < count + 2 {
        return Err(Error::impossible(
            "law fit",
            format!("{} points for {count} coefficients; {} are needed", points.len(), count + 2),
        ));
    }
    let residual = |law: &Law| -> Option<DVector<f64>> {
        let r: Vec<f64> = points.iter().map(|p| (law.bandwidth_hz(p.shaft_hz) / p.bandwidth_hz).ln()).collect();
        r.iter().all(|r| r.is_finite()).then(|| DVector::from_vec(r))
    };
    let jacobian = |law: &Law| {
        let c = law.coefficients();
        DMatrix::from_fn(points.len(), count, |i, j| {
            let step = 1e-6 * c[j].abs().max(1e-9);
            let moved = |sign: f64| {
                let mut c = c.clone();
                c[j] += sign * step;
                law.with_coefficients(&c).bandwidth_hz(points[i].shaft_hz).ln()
            };
            (moved(1.0) - moved(-1.0)) / (2.0 * step)
        })
    };
    let mut law = start.clone();
    let mut r = residual(&law).ok_or_else(|| Error::impossible("law fit", "the start gives no positive bandwidth"))?;
    for _ in 0..100 {
        let j = jacobian(&law);
        let Ok(step) = scaled_least_squares(&j, &r) else { break };
        let improved = (0..30).find_map(|halvings| {
            let factor = 0.5_f64.powi(halvings);
            let c: Vec<f64> = law.coefficients().iter().zip(step.iter()).map(|(c, s)| c - factor * s).collect();
            let next = law.with_coefficients(&c);
            residual(&next).filter(|n| n.norm_squared() < r.norm_squared()).map(|n| (next, n))
        });
        let Some((next, next_r)) = improved else { break };
        let gain = 1.0 - next_r.norm_squared() / r.norm_squared();
        (law, r) = (next, next_r);
        if gain < 1e-14 {
            break;
        }
    }
    let final_jacobian = jacobian(&law);
    Ok(describe(law, points, &final_jacobian, &r))
}

/// The parabola through absolute bandwidths, as the paper fits its equation (10).
///
/// # Errors
/// With fewer than five points.
pub fn fit_quadratic_absolute(points: &[Point]) -> Result<Fit> {
    if points.len() < 5 {
        return Err(Error::impossible("law fit", format!("{} points for a parabola; 5 are needed", points.len())));
    }
    let rows = |weight: &dyn Fn(&Point) -> f64| {
        DMatrix::from_fn(points.len(), 3, |i, j| points[i].shaft_hz.powi(2 - j as i32) * weight(&points[i]))
    };
    let b = DVector::from_iterator(points.len(), points.iter().map(|p| p.bandwidth_hz));
    let c = scaled_least_squares(&rows(&|_| 1.0), &b).map_err(|what| Error::impossible("law fit", what))?;
    let law = Law::Quadratic { a: c[0], b: c[1], c: c[2] };
    let r = DVector::from_vec(relative_errors(&law, points));
    Ok(describe(law, points, &rows(&|p| 1.0 / p.bandwidth_hz), &r))
}

/// Starting coefficients good enough for Gauss-Newton from the points' ends.
pub fn start_values(points: &[Point]) -> [Law; 3] {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.shaft_hz.total_cmp(&b.shaft_hz));
    let (low, high) = (sorted[0], sorted[sorted.len() - 1]);
    let turns = RISE_TIME_PRODUCT / high.bandwidth_hz * high.shaft_hz;
    let slope = high.bandwidth_hz / high.shaft_hz;
    [
        Law::Quadratic { a: 1e-3 * slope, b: slope, c: 0.1 * low.bandwidth_hz },
        Law::RootSumSquare { a_turns: turns, t_mode_s: 0.1 * RISE_TIME_PRODUCT / high.bandwidth_hz },
        Law::RampThroughMode { ramp_rad: turns * std::f64::consts::TAU / 0.8, mode_hz: 0.7 * low.bandwidth_hz },
    ]
}

/// The tabulated law through greedily chosen points; no intervals, since a knot is a point itself.
///
/// # Errors
/// With fewer than two points.
pub fn fit_table(points: &[Point], most_knots: usize, tolerance: f64) -> Result<Fit> {
    if points.len() < 2 {
        return Err(Error::impossible("law fit", "a table needs two points"));
    }
    let knots = super::table::choose_knots(points, most_knots, tolerance);
    let nothing = vec![0.0; knots.len()];
    let law = Law::Tabulated { knots };
    let errors = relative_errors(&law, points);
    let speeds = points.iter().map(|p| p.shaft_hz);
    Ok(Fit {
        law,
        half_width_95: nothing,
        worst_relative: errors.iter().fold(0.0, |worst, e| worst.max(e.abs())),
        rms_relative: (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt(),
        points: points.len(),
        domain_hz: [speeds.clone().fold(f64::INFINITY, f64::min), speeds.fold(0.0, f64::max)],
    })
}

fn scaled_least_squares(a: &DMatrix<f64>, b: &DVector<f64>) -> std::result::Result<DVector<f64>, &'static str> {
    let scale: Vec<f64> = a.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    let scaled = DMatrix::from_fn(a.nrows(), a.ncols(), |i, j| a[(i, j)] / scale[j]);
    let x = scaled.svd(true, true).solve(b, 1e-13)?;
    Ok(DVector::from_fn(x.len(), |j, _| x[j] / scale[j]))
}

fn describe(law: Law, points: &[Point], jacobian: &DMatrix<f64>, r: &DVector<f64>) -> Fit {
    let freedom = (points.len() - jacobian.ncols()) as f64;
    let variance = r.norm_squared() / freedom;
    let quantile = StudentsT::new(0.0, 1.0, freedom).map_or(f64::NAN, |t| t.inverse_cdf(0.975));
    let scale: Vec<f64> = jacobian.column_iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
    let scaled = DMatrix::from_fn(jacobian.nrows(), jacobian.ncols(), |i, j| jacobian[(i, j)] / scale[j]);
    let half_width_95 = match (scaled.transpose() * scaled).try_inverse() {
        Some(inverse) => (0..scale.len()).map(|j| quantile * (variance * inverse[(j, j)]).sqrt() / scale[j]).collect(),
        None => vec![f64::INFINITY; scale.len()],
    };
    let errors = relative_errors(&law, points);
    let speeds = points.iter().map(|p| p.shaft_hz);
    Fit {
        law,
        half_width_95,
        worst_relative: errors.iter().fold(0.0, |worst, e| worst.max(e.abs())),
        rms_relative: (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt(),
        points: points.len(),
        domain_hz: [speeds.clone().fold(f64::INFINITY, f64::min), speeds.fold(0.0, f64::max)],
    }
}
