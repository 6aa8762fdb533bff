//! What the declared parameters do to the responses of the effects found.
//!
//! A force reaches a sensor through the same masses, bearings and couplings that are declared within tolerance only:
//! with 3 % open of a coupling's stiffness, a ripple's response near that coupling's mode is open by many times that.
//! A fit whose sensitivities are those of the mesh's vibration alone knows nothing of this, gives such a strength too
//! narrow an interval, and has no use for what the effect's lines say of the parameters. So, once the effects are
//! known, each parameter's sensitivity gets the share of the effects' responses at their fitted strength: one step of
//! Gauss and Newton in strengths and parameters together.
//!
//! Cost: one comb per effect, run and parameter. Limits: sinusoids at an order (forces, displacements, stiffnesses)
//! and what every pair has, to first order in their strength; single teeth and the path keep the sensitivities of the
//! machine alone.

use super::base_fit::{Base, TOLERANCES};
use super::candidate::Candidate;
use super::library::{Responses, mesh, order};

/// Change of a parameter for a derivative, as a share of its tolerance.
const STEP: f64 = 0.1;

/// Adds to the sensitivities of `base` what its parameters do to `accepted` at their `unknowns`.
pub fn entrain(base: &mut Base, accepted: &[Candidate], unknowns: &[Vec<f64>]) {
    let here = Responses::new(base);
    let waves: Vec<(Candidate, &Candidate, &[f64])> =
        accepted.iter().zip(unknowns).filter_map(|(term, x)| Some((on(&here, term)?, term, x.as_slice()))).collect();
    if waves.is_empty() {
        return;
    }
    let mut nuisances = base.nuisances.clone();
    for (parameter, (_, tolerance)) in TOLERANCES.iter().enumerate() {
        let mut delta = vec![0.0; TOLERANCES.len()];
        delta[parameter] = STEP * tolerance;
        let moved = base.alone(base.tried(&delta, 0.0));
        let there = Responses::new(&moved);
        for (first, term, x) in &waves {
            let Some(second) = on(&there, term) else { continue };
            for ((a, b), x) in first.templates.iter().zip(&second.templates).zip(*x) {
                let change = b.mixed(x / delta[parameter], a, -x / delta[parameter]);
                nuisances[parameter] = nuisances[parameter].mixed(1.0, &change, 1.0);
            }
        }
    }
    base.nuisances = nuisances;
}

/// The first-order response of this machine to the same effect, where it is one of those that are taken along.
fn on(machine: &Responses<'_>, term: &Candidate) -> Option<Candidate> {
    order::on(machine, term).or_else(|| mesh::on(machine, term))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidate::Template;
    use crate::observation::spectrum::Bins;
    use meshband_analysis::drawn;
    use meshband_analysis::generate::{self, Scenario};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;
    use rustfft::num_complex::Complex64 as C;

    /// Dense bins of templates at `x` in one run and channel.
    fn dense(templates: &[Template], x: &[f64], run: usize, channel: usize, bins: usize) -> Bins {
        let mut sum = vec![C::ZERO; bins];
        for (template, x) in templates.iter().zip(x) {
            template.runs[run][channel].iter().for_each(|(bin, value)| sum[bin] += value * *x);
        }
        sum
    }

    fn power(bins: &[C]) -> f64 {
        bins.iter().map(|x| x.norm_sqr()).sum()
    }

    #[test]
    fn ref_sensitivities_hold_what_a_parameter_does_to_a_ripple() {
        let mut random = ChaCha8Rng::seed_from_u64(1003);
        let declared = drawn::machine(&mut random).unwrap();
        let mut scenario = Scenario::null(&declared.shafts, 7);
        scenario.duration_s = 0.5;
        drawn::layout(&declared, &mut scenario, &mut random);
        let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario).unwrap();
        let mut base = Base::new(&record);
        let of_machine = base.nuisances.clone();
        let term = order::at_order(&Responses::new(&base), 7.0, 1.0).into_iter().find(|c| c.name == "torque-ripple");
        let (term, x) = (term.unwrap(), vec![0.3, -0.2]);
        let bins = base.analyser.bins;
        entrain(&mut base, std::slice::from_ref(&term), std::slice::from_ref(&x));
        let mut changed = 0;
        for (parameter, (name, tolerance)) in TOLERANCES.iter().enumerate() {
            let mut delta = vec![0.0; TOLERANCES.len()];
            // To the other side than the derivative's step: what is missed is curvature.
            delta[parameter] = -STEP * tolerance;
            let moved = base.alone(base.tried(&delta, 0.0));
            let there = on(&Responses::new(&moved), &term).unwrap();
            for run in 0..base.runs.len() {
                let at = |templates: &[Template], x: &[f64]| dense(templates, x, run, 0, bins);
                let change: Bins =
                    at(&there.templates, &x).iter().zip(at(&term.templates, &x)).map(|(a, b)| a - b).collect();
                let with = std::slice::from_ref(&base.nuisances[parameter]);
                let predicted = at(with, &[delta[parameter]]);
                let machine = at(std::slice::from_ref(&of_machine[parameter]), &[delta[parameter]]);
                let missed: Bins = predicted.iter().zip(&machine).zip(&change).map(|((a, b), c)| a - b - c).collect();
                // Smaller ones are lost in the single precision of the machine's own.
                if power(&change) > 1e-6 * power(&at(&term.templates, &x)) {
                    changed += 1;
                    let share = (power(&missed) / power(&change)).sqrt();
                    assert!(share < 0.1, "{name}, run {run}: {share:.3} missed");
                }
            }
        }
        assert!(changed > 5 * base.runs.len(), "{changed}");
    }
}
