//! The tabulated law between its knots, against the monotone cubic in logarithms worked out in double precision.

use meshband::law::{Law, LawForm, LawKnot, LawTable};
use meshband::units::Hertz;

/// Knots that rise, fall and stay, at uneven distances.
const KNOTS: [[f64; 2]; 6] =
    [[0.5, 9000.0], [1.1, 9400.0], [4.0, 21_000.0], [6.5, 17_000.0], [20.0, 60_000.0], [50.0, 61_000.0]];

/// Fritsch and Butland 1984: weighted harmonic means as slopes, secants at the ends.
fn slopes(x: &[f64], y: &[f64]) -> Vec<f64> {
    let secant: Vec<f64> = (0..x.len() - 1).map(|k| (y[k + 1] - y[k]) / (x[k + 1] - x[k])).collect();
    let inner = |k: usize| {
        let (left, right) = (x[k] - x[k - 1], x[k + 1] - x[k]);
        let (before, after) = (secant[k - 1], secant[k]);
        let harmonic = 3.0 * (left + right) / ((2.0 * right + left) / before + (right + 2.0 * left) / after);
        if before * after > 0.0 { harmonic } else { 0.0 }
    };
    let inner: Vec<f64> = (1..x.len() - 1).map(inner).collect();
    [&secant[..1], &inner, &secant[secant.len() - 1..]].concat()
}

fn reference(speed: f64) -> f64 {
    let [x, y] = [0, 1].map(|i| KNOTS.map(|knot| knot[i].ln()).to_vec());
    let slopes = slopes(&x, &y);
    let k = x.iter().rposition(|x| *x <= speed.ln()).expect("within").min(x.len() - 2);
    let h = x[k + 1] - x[k];
    let t = (speed.ln() - x[k]) / h;
    let value = y[k] * (2.0 * t.powi(3) - 3.0 * t * t + 1.0)
        + h * slopes[k] * (t.powi(3) - 2.0 * t * t + t)
        + y[k + 1] * (3.0 * t * t - 2.0 * t.powi(3))
        + h * slopes[k + 1] * (t.powi(3) - t * t);
    value.exp()
}

#[test]
fn ref_a_table_is_the_monotone_cubic_through_its_knots() {
    let knots =
        KNOTS.map(|[speed, bandwidth]| LawKnot { speed: Hertz(speed as f32), bandwidth: Hertz(bandwidth as f32) });
    let form = LawForm::Tabulated(LawTable::new(&knots).expect("sound knots"));
    let law = Law { form, lowest: Hertz(0.2), highest: Hertz(60.0), ..Law::PROVISIONAL };
    for step in 0..1000 {
        let speed = 0.5 * 100.0_f64.powf(f64::from(step) / 1000.0);
        let ours = f64::from(law.bandwidth(Hertz(speed as f32)).bandwidth.0);
        assert!((ours / reference(speed) - 1.0).abs() < 1e-5, "{speed} Hz: {ours} for {}", reference(speed));
    }
}
