//! Whether the mesh stands at teeth x speed, before anything is built on it.
//!
//! The comb of mesh harmonics in the record's own order spectra is scored where the declaration puts it, with other
//! tooth counts, and with a clock that is off by up to 2 %. Where another place speaks clearly more, the angle or the
//! teeth are wrong and every family would be named after a wrong shaft: nothing is named then. Limit: the gear's
//! teeth cannot be seen this way; a tach that is off by less than a bin neither.

use super::evidence::of_family;
use super::scene::Scene;
use super::spectra::Spectra;
use super::split::{Split, Stretch};

/// Mesh harmonics scored.
const HARMONICS: usize = 5;
/// Most teeth by which the declaration may be off.
const MOST_TEETH: i32 = 4;
/// Widest clock ratio tried, either way.
const WIDEST_CLOCK: f64 = 0.02;
/// Logarithm of the Bayes factor by which another place must exceed the declared one's.
const MIN_EXCESS_LN_BAYES: f64 = 15.0;
/// Share of the other place's score from which the declared comb is the mesh and the other its sidebands.
const SIDEBANDS: f64 = 0.5;
/// Logarithm of the Bayes factor below which there is no mesh.
const MIN_LN_BAYES: f64 = 5.0;

/// Order spectra of the record itself on the stretches that `stretches` chooses.
pub fn spectra(scene: &Scene, stretches: impl Fn(&Split) -> &[Stretch] + Sync) -> Spectra {
    let samples: Vec<Vec<Vec<f64>>> = scene.runs.iter().map(|run| run.samples.clone()).collect();
    Spectra::over_orders(scene, &samples, |r| stretches(&scene.runs[r].split).to_vec())
}

/// What is wrong with the place of the mesh, in words; `None` where it stands as declared.
pub fn finding(scene: &Scene, spectra: &Spectra) -> Option<String> {
    if let Some(gearing) = &scene.gearing {
        let stands = |own: &Vec<f64>| of_lines(spectra, own) >= MIN_LN_BAYES;
        return (!gearing.first_lines().iter().any(stands)).then(|| {
            "no mesh line of any stage stands where the train has it: tach, teeth or channels are wrong".into()
        });
    }
    let z = scene.mesh_order();
    let declared = comb(spectra, z);
    let teeth = (-MOST_TEETH..=MOST_TEETH).filter(|d| *d != 0).map(|d| (z + f64::from(d), z + f64::from(d)));
    let step = 0.5 * spectra.bin(0) / (HARMONICS as f64 * z);
    let steps = (WIDEST_CLOCK / step) as i32;
    let clocks = (-steps..=steps).map(|i| z * (1.0 + step * f64::from(i)));
    let far = |order: &f64| (order - z).abs() > 4.0 * spectra.bin(0);
    let best = |a: (f64, f64), b: (f64, f64)| if b.1 > a.1 { b } else { a };
    let by_teeth = teeth.map(|(order, _)| (order, comb(spectra, order))).fold((z, f64::NEG_INFINITY), best);
    let by_clock = clocks.filter(far).map(|order| (order, comb(spectra, order))).fold((z, f64::NEG_INFINITY), best);
    let other = by_teeth.1.max(by_clock.1);
    if other > declared.max(0.0) + MIN_EXCESS_LN_BAYES && declared < SIDEBANDS * other {
        return Some(if by_teeth.1 + MIN_EXCESS_LN_BAYES > by_clock.1 {
            format!("the mesh does not stand at {z:.0} x speed but as {:.0} teeth would have it", by_teeth.0)
        } else {
            format!("the mesh stands at {:.4} of teeth x speed: tach or sampling clock is off", by_clock.0 / z)
        });
    }
    (declared < MIN_LN_BAYES)
        .then(|| format!("no mesh line stands at {z:.0} x speed or near it: tach, teeth or channels are wrong"))
}

fn comb(spectra: &Spectra, order: f64) -> f64 {
    of_lines(spectra, &(1..=HARMONICS).map(|k| k as f64 * order).collect::<Vec<_>>())
}

fn of_lines(spectra: &Spectra, orders: &[f64]) -> f64 {
    let mut all = Vec::new();
    for (r, channels) in spectra.levels.iter().enumerate() {
        for c in 0..channels.len() {
            let readings = orders.iter().filter_map(|order| spectra.reading(r, c, 0, *order, 1));
            all.extend(readings.map(|reading| reading.ln_bayes()));
        }
    }
    if all.is_empty() { 0.0 } else { of_family(&all) }
}
