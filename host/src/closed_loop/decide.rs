//! The loop itself: split by run, centre the declared machine, add effects strongest first, judge each, confirm on the held-out runs.
//!
//! Faults that distort every line (a clipped channel, a moving speed) come first and are mended ([`distortion`](super::distortion)); then the library is searched ([`search`](super::search)),
//! from the declared parameters as fitted and, where much is left, from the declaration; what is significant but follows no law gets a
//! plain description.
//!
//! Before all of this the record itself is checked ([`check`]), and after it the held-out runs and the check may
//! contradict the verdict ([`Outcome::checked`]).
//!
//! Held-out runs take no part in any fit or choice between candidates, but for their own start ([`start`](super::start)): one number per run and effect. They have one veto: a term that does not lower their error goes
//! (`confirm`); the error printed for them is therefore not wholly independent of what was kept.

use super::accept::{self, Adopted};
use super::base_fit::{Base, TOLERANCES};
use super::bootstrap::{NullRecords, null_record};
use super::candidate::Candidate;
use super::distortion::{fitted, mended};
use super::impulsive::impacts;
use super::judge::{Split, corrected, joint};
use super::least_squares::{Data, chi_square, normal, solve};
use super::library::Bench;
use super::limits::limits;
use super::next_measurement::deciding;
use super::options::Options;
use super::outcome::{Effect, Outcome};
use super::remainder::{power_and_noise, remainder};
use super::search::{Found, Memory, Search, search};
use super::start::Start;
use super::tables::{predicted, report};
use super::verdict::{undetermined, verdicts};
use crate::check;
use crate::effects::hypotheses;
use crate::effects::hypothesis::{Hypothesis, Seat};
use crate::observation::input::Record;
use crate::observation::spectrum::Bins;
use crate::{Error, Result};
use rand::{RngExt, SeedableRng};

/// Groups runs by speed; one inner speed is held out, another selects, the rest fit.
fn split(base: &Base, seed: u64) -> Result<Split> {
    let groups = base.speeds(&(0..base.runs.len()).collect::<Vec<_>>());
    if groups.len() < 3 {
        return Err(Error::invalid("record.toml: run", "the closed loop needs runs at three or more speeds"));
    }
    let mut inner: Vec<usize> = (1..groups.len() - 1).collect();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let held = inner.swap_remove((rng.random::<u32>() as usize) % inner.len());
    let select = if inner.is_empty() { groups.len() - 1 } else { inner[(rng.random::<u32>() as usize) % inner.len()] };
    let sorted = |pick: &dyn Fn(usize) -> bool| {
        let mut runs: Vec<usize> =
            groups.iter().enumerate().filter(|(g, _)| pick(*g)).flat_map(|(_, runs)| runs.clone()).collect();
        runs.sort_unstable();
        runs
    };
    Ok(Split {
        fit: sorted(&|g| g != held && g != select),
        select: sorted(&|g| g == select),
        held_out: sorted(&|g| g == held),
    })
}

/// Finds what the declared machine of `record` lacks, after a check of the record itself.
///
/// # Errors
/// A record that the check refuses, fewer than three speeds, runs shorter than half a second, a result that is none.
pub fn close_loop(record: &Record, options: &Options) -> Result<Outcome> {
    let checked = check::mended(record);
    checked.findings.require_usable()?;
    close_checked(&checked.record, options)?.checked(checked.findings, &checked.runs)
}

/// The loop on a record that passed its check.
fn close_checked(record: &Record, options: &Options) -> Result<Outcome> {
    let start = std::time::Instant::now();
    let say = |what: &str| {
        if options.progress {
            crate::remark!("{:6.1} s  {what}", start.elapsed().as_secs_f64());
        }
    };
    if record.runs.iter().any(|r| (r.channels[0].len() as f64) < 0.5 * record.sample_rate_hz) {
        return Err(Error::invalid("record.toml: run", "every run must last at least half a second"));
    }
    say("predicting the declared machine");
    let mut base = Base::new(record);
    let declared = base.data();
    let split = split(&base, options.seed)?;
    let mut fitted = base.fit(&split.fit, 2);
    if !fitted {
        say("no declared parameters within tolerance explain the record: searching from the declaration");
        base = Base::new(record);
    }
    let calibrated = predicted(&base, &base.data(), &split.seen(), &[]);
    let mended = mended(record, &base, &split);
    let (mended, mut whole, gain) = match mended {
        Some(mended) => {
            say("what distorts every line is mended, and the search goes on behind it");
            (base, fitted) = (mended.base, true);
            (Some(mended.record), mended.effects, mended.gain)
        }
        None => (None, Vec::new(), 0.0),
    };
    describe_withheld(&mut whole, &options.withheld);
    let scene = Scene { record: mended.as_ref().unwrap_or(record), split, options, gain, say: &say };
    let null_base = (options.null_records > 0).then(|| scene.calibrated(base.change.clone()));
    let explained = scene.explained(base, fitted, &declared);
    let score = explained.first_score;
    let mut outcome = scene.answer(explained, &declared, calibrated, whole);
    if let Some(base) = null_base {
        say("records without any effect");
        outcome.null = Some(scene.null_records(&base, score));
    }
    say("done");
    Ok(outcome)
}

/// A record whose library search is to be made.
struct Scene<'a> {
    record: &'a Record,
    split: Split,
    options: &'a Options,
    /// Gain of what distorted the record.
    gain: f64,
    say: &'a dyn Fn(&str),
}

impl Scene<'_> {
    /// The machine with these relative changes of its declared parameters.
    fn calibrated(&self, change: Vec<f64>) -> Base {
        let mut base = Base::new(self.record);
        base.adopt(&change);
        base
    }

    /// Searches from the parameters as fitted and, where much is left, from the declaration.
    fn explained(&self, base: Base, fitted: bool, declared: &Data) -> Explained {
        let (seen, say) = (self.split.seen(), self.say);
        let plain = base.data();
        let (at_first, _) = power_and_noise(&base, &declared.residual, &seen);
        let mut explained = explain(base, self, 0, &plain);
        if fitted && self.gain == 0.0 && accept::search_again(explained.power, explained.noise, at_first) {
            // Parameters that were fitted before the effect was known may have been led too far astray to find back.
            say("much is left: searching again from the declaration as it stands");
            let first_score = explained.first_score;
            let again = explain(Base::new(self.record), self, explained.tried, &plain);
            let tried = again.tried;
            if again.left < explained.left {
                explained = again;
            }
            (explained.tried, explained.first_score) = (tried, first_score);
        }
        say(&format!("left over noise, power: {:.3}", explained.power / explained.noise));
        explained
    }

    /// The outcome: verdicts, what no term explains, errors, limits. `whole`: what distorted the record.
    fn answer(
        &self,
        explained: Explained,
        declared: &Data,
        calibrated: Vec<[Bins; 2]>,
        mut whole: Vec<Effect>,
    ) -> Outcome {
        let Explained { base, found, tried, .. } = explained;
        let Found { mut accepted, pool, strongest, data } = found;
        (self.say)("verdicts");
        let distorted = !whole.is_empty();
        let mut effects = verdicts(&base, &data, &self.split, &accepted, &pool, tried);
        // Next to the others and with the final weights a term must still stand.
        let figures: Vec<_> = effects.iter().map(|e| (e.evidence.left_at_its_lines, e.evidence.chance)).collect();
        self.decide_next(&base, &data, &accepted, &pool, &mut effects);
        keep(&mut effects, &accepted.stand(&figures));
        if !distorted {
            whole.extend(self.impacts(&base, &data, &mut accepted, &mut effects));
            describe_withheld(&mut whole, &self.options.withheld);
        }
        if whole.is_empty() && effects.is_empty() {
            effects.extend(self.undescribed(&base, &data, strongest.as_ref(), &pool, tried));
        }
        let calibrated = (distorted || !accepted.is_empty()).then_some(calibrated);
        let mut outcome = report(self.record, declared, calibrated, &base, &data, &self.split, &accepted, effects);
        outcome.candidates_tried = tried;
        outcome.effects.extend(whole);
        if self.options.limits {
            (self.say)("limits of what was not found");
            outcome.limits = limits(&Bench::new(&base), &data, &self.split, &accepted, tried);
        }
        outcome
    }

    /// For every ambiguous verdict the measurement that would decide it.
    fn decide_next(&self, base: &Base, data: &Data, accepted: &Adopted, pool: &[Candidate], effects: &mut [Effect]) {
        let seen = self.split.seen();
        let terms: Vec<&Candidate> = accepted.iter().collect();
        let mut all = joint(base, data, &seen, &terms).x.split_off(base.nuisances.len());
        for (term, effect) in terms.iter().zip(effects) {
            let rest = all.split_off(term.templates.len());
            if effect.verdict == "ambiguous" {
                let names: Vec<&str> = effect.name.split(" or ").filter(|name| *name != term.name).collect();
                let rivals: Vec<&Candidate> =
                    pool.iter().filter(|c| names.contains(&c.name.as_str())).take(3).collect();
                effect.deciding_experiment = deciding(self.record, base, data, &seen, (term, &all), &rivals)
                    .or(effect.deciding_experiment.take());
            }
            all = rest;
        }
    }

    /// Impacts in what the terms leave; single lines that belong to them go.
    fn impacts(&self, base: &Base, data: &Data, accepted: &mut Adopted, effects: &mut Vec<Effect>) -> Option<Effect> {
        let seen = self.split.seen();
        let hammering = |accepted: &[Candidate]| {
            let terms: Vec<&Candidate> = accepted.iter().collect();
            let rest = corrected(base, data, &joint(base, data, &seen, &terms).x, &terms);
            impacts(base, &rest, &self.split)
        };
        let mut found = hammering(accepted);
        if let Some(order) = found.as_ref().filter(|e| e.verdict == "named").and_then(|e| e.order_of_pinion) {
            let stay = accepted.give_to_impacts(order, |t| matches!(t.start, Start::Phases(_)));
            if stay.contains(&false) {
                keep(effects, &stay);
                found = hammering(accepted).or(found);
            }
        }
        found.filter(|e| effects.is_empty() || e.verdict == "named")
    }

    /// A plain description of what is there although nothing was adopted.
    fn undescribed(
        &self,
        base: &Base,
        data: &Data,
        strongest: Option<&Candidate>,
        pool: &[Candidate],
        tried: usize,
    ) -> Option<Effect> {
        let seen = self.split.seen();
        if let Some(found) = strongest
            && much_is_there(base, data, &seen)
        {
            (self.say)("nothing holds from run to run, but much is there: a plain description of what comes closest");
            if let Some(effect) = undetermined(base, data, &self.split, found, pool, tried) {
                return Some(effect);
            }
        }
        remainder(base, &corrected(base, data, &joint(base, data, &seen, &[]).x, &[]), &seen)
    }

    /// Best scores of records without any effect, beside this one's.
    fn null_records(&self, base: &Base, score: f64) -> NullRecords {
        let quiet = |_: &str| {};
        let of = |index: usize| {
            let null = null_record(self.record, base, self.options.seed, index);
            let (machine, _) = fitted(&null, &self.split);
            let bench = Bench::new(&machine);
            let mut memory = Memory::default();
            search(&bench, &self.split, self.options, 1, &mut memory, &quiet);
            memory.first_score.unwrap_or(0.0)
        };
        let others: Vec<f64> = (0..self.options.null_records).map(of).collect();
        NullRecords::of(score, &others)
    }
}

/// Keeps what stays.
fn keep(effects: &mut Vec<Effect>, stay: &[bool]) {
    let mut stay = stay.iter();
    effects.retain(|_| *stay.next().unwrap_or(&true));
}

/// Takes the names of effects that are found outside the library.
fn describe_withheld(effects: &mut [Effect], names: &[String]) {
    for effect in effects.iter_mut().filter(|e| names.contains(&e.name)) {
        let of_record = |h: &&Hypothesis| h.name == effect.name && matches!(h.seats, [Seat::Record]);
        let text = hypotheses().find(of_record).map_or("", |h| h.plain);
        (effect.verdict, effect.name) = ("generic".into(), text.into());
    }
}

/// A search brought to its end.
struct Explained {
    base: Base,
    found: Found,
    /// Trials of this search and those before it.
    tried: usize,
    /// Best score of the first round.
    first_score: f64,
    /// Whitened residual of the runs seen, by weights common to all searches.
    left: f64,
    /// Power of that residual, and of the local noise in it.
    power: f64,
    noise: f64,
}

/// Searches, centring again as often as needed, and confirms on the held-out runs.
fn explain(mut base: Base, scene: &Scene<'_>, tried: usize, plain: &Data) -> Explained {
    let (split, options, say) = (&scene.split, scene.options, scene.say);
    let seen = split.seen();
    let mut memory = Memory { tried, largest_gain: scene.gain, ..Memory::default() };
    let mut found = loop {
        let bench = Bench::new(&base);
        match search(&bench, split, options, options.most, &mut memory, say) {
            Search::Done(found) => break *found,
            Search::Recentre(change) => {
                say("declared parameters moved with the effect: centring again");
                drop(bench);
                let change = base.within_reach(&change);
                base.adopt(&change);
                memory.attempt += 1;
            }
        }
    };
    confirm(&base, &found.data, split, &mut found.accepted);
    let terms: Vec<&Candidate> = found.accepted.iter().collect();
    let rest = corrected(&base, &found.data, &joint(&base, &found.data, &seen, &terms).x, &terms).residual;
    let (power, noise) = power_and_noise(&base, &rest, &seen);
    let left = chi_square(&Data { residual: rest, weight: plain.weight.clone() }, &seen);
    let first_score = memory.first_score.unwrap_or(0.0);
    Explained { base, found, tried: memory.tried, first_score, left, power, noise }
}

/// Whether the declared parameters alone leave more than noise.
fn much_is_there(base: &Base, data: &Data, runs: &[usize]) -> bool {
    let rest = corrected(base, data, &joint(base, data, runs, &[]).x, &[]).residual;
    let (power, noise) = power_and_noise(base, &rest, runs);
    accept::much_is_there(power, noise)
}

/// Asks the held-out runs, predicted from the others, whether every term lowers their whitened error.
fn confirm(base: &Base, data: &Data, split: &Split, accepted: &mut Adopted) {
    let seen = split.seen();
    // The held-out runs' own angle offsets and speeds, with the tachometer's uncertainty as prior, are fitted last: they are no part of a term.
    let own = base.columns().split_off(TOLERANCES.len());
    accepted.confirm(|terms| {
        let mut x = joint(base, data, &seen, terms).x;
        x[TOLERANCES.len()..base.nuisances.len()].fill(0.0);
        let rest = corrected(base, data, &x, terms);
        chi_square(&rest, &split.held_out) - solve(&normal(&rest, &split.held_out, &own)).gain
    });
}
