//! The loop itself: split by run, centre the declared machine, add effects strongest first, judge each, confirm on
//! the held-out runs.
//!
//! Faults that distort every line (a clipped channel, a moving speed) come first; then the library is searched
//! ([`search`](super::search)), from the declared parameters as fitted and, where much is left, from the declaration;
//! what is significant but follows no law gets a plain description.
//!
//! Before all of this the record itself is checked ([`tach_delay`]), and after it the held-out runs and the check may
//! contradict the verdict ([`Outcome::checked`]).
//!
//! Held-out runs take no part in any fit or choice between candidates, but for starts ([`start`](super::start)): one
//! number per run and effect. They have one veto: a term that does not lower their error goes (`confirm`); the error
//! printed for them is therefore not wholly independent of what was kept.

use super::accept::{self, Adopted};
use super::base_fit::Base;
use super::bootstrap::best_scores;
use super::calibrate::calibrate;
use super::candidate::Candidate;
use super::entrained::entrain;
use super::held_out;
use super::impulsive::impacts;
use super::judge::{Split, corrected, joint};
use super::least_squares::{Data, chi_square};
use super::library::Bench;
use super::limits::limits;
use super::next_measurement::advise;
use super::null_records::NullRecords;
use super::options::Options;
use super::outcome::{Effect, Outcome};
use super::remainder::{power_and_noise, remainder};
use super::rivals::rivals;
use super::search::{Found, Memory, search};
use super::start::Start;
use super::tables::{predicted, report};
use super::tach_delay;
use super::together::fitted;
use super::verdict::{undetermined, verdicts};
use super::waveform::{clipping, speed_fluctuation};
use crate::effects::hypotheses;
use crate::effects::hypothesis::{Hypothesis, Seat};
use crate::observation::input::Record;
use crate::{Error, Result};
use rand::{RngExt, SeedableRng};

/// Groups runs by speed; one inner speed is held out, another selects, the rest fit.
fn split(base: &Base, seed: u64) -> Result<Split> {
    let groups = base.speeds();
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
    let checked = tach_delay::checked(record);
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
    let seen = split.seen();
    calibrate(&mut base, &seen);
    let plain = base.data();
    let calibrated = predicted(&base, &plain, &seen, &[]);
    let mut whole: Vec<Effect> = clipping(&mut base, record, &plain, &split.held_out).into_iter().collect();
    if whole.is_empty() {
        whole.extend(speed_fluctuation(&mut base, record, &plain, &split.held_out));
    }
    if whole.iter().any(|e| e.family == "non-stationary") {
        // Smeared lines may have led the declared parameters astray: the declaration itself may do better.
        let mut unfitted = Base::new(record);
        let again = speed_fluctuation(&mut unfitted, record, &plain, &split.held_out);
        let left =
            |base: &Base| chi_square(&Data { residual: base.data().residual, weight: plain.weight.clone() }, &seen);
        if let Some(again) = again
            && left(&unfitted) < left(&base)
        {
            whole = vec![again];
            base = unfitted;
        }
    }
    describe_withheld(&mut whole, &options.withheld);
    // These distort every line: what is left of them is no second effect.
    let distorted = !whole.is_empty();
    let rounds = if whole.is_empty() { options.most } else { 0 };
    let asked = options.null_records > 0 && !distorted;
    let null_scores = asked.then(|| best_scores(record, &base, &plain, &split, options, &say));
    let (at_first, _) = power_and_noise(&base, &declared.residual, &seen);
    let mut explained = explain(base, &split, options, rounds, 0, &plain, &say);
    if rounds > 0 && accept::search_again(explained.power, explained.noise, at_first) {
        // Parameters that were fitted before the effect was known may have been led too far astray to find back.
        say("much is left: searching again from the declaration as it stands");
        let again = explain(Base::new(record), &split, options, rounds, explained.tried, &plain, &say);
        let (tried, first_score) = (again.tried, explained.first_score);
        if again.left < explained.left {
            explained = again;
        }
        (explained.tried, explained.first_score) = (tried, first_score);
    }
    say(&format!("left over noise, power: {:.3}", explained.power / explained.noise));
    let Explained { mut base, found, tried, first_score, .. } = explained;
    let Found { mut accepted, pool, strongest, data } = found;
    say("verdicts");
    let rivals = rivals(&base, &data, &split, &accepted, &pool);
    let of_machine = base.nuisances.clone();
    let with_effects = |base: &mut Base, accepted: &[Candidate]| {
        base.nuisances.clone_from(&of_machine);
        let x = fitted(base, &data, &seen, accepted);
        entrain(base, accepted, &x);
    };
    with_effects(&mut base, &accepted);
    let mut effects = verdicts(&base, &data, &split, &accepted, rivals, &pool, tried);
    // Next to the others and with the final weights a term must still stand.
    let figures: Vec<_> = effects.iter().map(|e| (e.evidence.left_at_its_lines, e.evidence.chance)).collect();
    if keep(&mut effects, &accepted.stand(&figures)) {
        with_effects(&mut base, &accepted);
    }
    if whole.is_empty() {
        let hammering = |base: &Base, accepted: &[Candidate]| {
            let terms: Vec<&Candidate> = accepted.iter().collect();
            let rest = corrected(base, &data, &joint(base, &data, &seen, &terms).x, &terms);
            impacts(base, &rest, &split)
        };
        let mut found = hammering(&base, &accepted);
        if let Some(order) = found.as_ref().filter(|e| e.verdict == "named").and_then(|e| e.order_of_pinion) {
            let stay = accepted.give_to_impacts(order, |t| matches!(t.start, Start::Phases(_)));
            if keep(&mut effects, &stay) {
                with_effects(&mut base, &accepted);
                found = hammering(&base, &accepted).or(found);
            }
        }
        whole.extend(found.filter(|e| effects.is_empty() || e.verdict == "named"));
        describe_withheld(&mut whole, &options.withheld);
    }
    if whole.is_empty()
        && effects.is_empty()
        && let Some(found) = strongest
        && much_is_there(&base, &data, &seen)
    {
        say("nothing holds from run to run, but much is there: a plain description of what comes closest");
        effects.extend(undetermined(&base, &data, &split, &found, &pool, tried));
    }
    if whole.is_empty() && effects.is_empty() {
        effects.extend(remainder(&base, &corrected(&base, &data, &joint(&base, &data, &seen, &[]).x, &[]), &seen));
    }
    advise(record, (&base, &data, &split), &accepted, &pool, &mut effects);
    let calibrated = (distorted || !accepted.is_empty()).then_some(calibrated);
    let mut outcome = report(record, &declared, calibrated, &base, &data, &split, &accepted, effects);
    outcome.candidates_tried = tried;
    outcome.null_records = null_scores.map(|others| NullRecords::of(first_score, &others));
    outcome.effects.extend(whole);
    if options.limits && !distorted {
        say("limits of what was not found");
        // As large as what the limits need.
        drop(pool);
        outcome.state(limits(&Bench::new(&base), &data, &split, &accepted, tried));
    }
    say("done");
    Ok(outcome)
}

/// Keeps what stays; says whether anything went.
fn keep(effects: &mut Vec<Effect>, stay: &[bool]) -> bool {
    let mut kept = stay.iter();
    effects.retain(|_| *kept.next().unwrap_or(&true));
    stay.contains(&false)
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
    /// Best score of its first round.
    first_score: f64,
    /// Whitened residual of the runs seen, by weights common to all searches.
    left: f64,
    /// Power of that residual, and of the local noise in it.
    power: f64,
    noise: f64,
}

/// Searches, centring again as often as needed, and confirms on the held-out runs.
fn explain(
    mut base: Base,
    split: &Split,
    options: &Options,
    rounds: usize,
    tried: usize,
    plain: &Data,
    say: &dyn Fn(&str),
) -> Explained {
    let seen = split.seen();
    let mut memory = Memory { tried, ..Memory::default() };
    let mut found = search(&mut base, split, options, rounds, &mut memory, say);
    confirm(&base, &found.data, split, &mut found.accepted);
    let terms: Vec<&Candidate> = found.accepted.iter().collect();
    let rest = corrected(&base, &found.data, &joint(&base, &found.data, &seen, &terms).x, &terms).residual;
    let (power, noise) = power_and_noise(&base, &rest, &seen);
    let left = chi_square(&Data { residual: rest, weight: plain.weight.clone() }, &seen);
    let Memory { tried, first_score, .. } = memory;
    Explained { base, found, tried, first_score, left, power, noise }
}

/// Whether the declared parameters alone leave more than noise.
fn much_is_there(base: &Base, data: &Data, runs: &[usize]) -> bool {
    let rest = corrected(base, data, &joint(base, data, runs, &[]).x, &[]).residual;
    let (power, noise) = power_and_noise(base, &rest, runs);
    accept::much_is_there(power, noise)
}

/// Asks the held-out runs, predicted from the others, whether every term lowers their whitened error.
fn confirm(base: &Base, data: &Data, split: &Split, accepted: &mut Adopted) {
    accepted.confirm(|terms| held_out::error(base, data, split, terms));
}
