//! Noise ladder: the same record with ever less noise. Better data must not give a worse answer.
//!
//! Every effect that can be hidden, at one strength, on machines drawn at random; noise, converter and jitter alone
//! differ between the rungs, of which those below the first have float samples and exact edges. Cost: a loop per
//! rung.

use super::{floor, score};
use crate::Result;
use crate::drawn;
use crate::effects;
use crate::effects::hypothesis::{Draw, Hidden};
use crate::generate::{self, Scenario};
use crate::model_based::{Options, close_loop};
use crate::terminal::{self, Progress};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::time::Instant;

/// Strength over the detection floor at the first rung.
const LEVEL: f64 = 20.0;

/// What is climbed.
#[derive(Debug, Clone)]
pub struct Ladder {
    /// Machines drawn.
    pub machines: usize,
    /// Noise of the rungs, RMS, m/s2; strengths are those at the first.
    pub noise_m_s2: Vec<f64>,
    /// Names of hidden effects; empty for all.
    pub only: Vec<String>,
    /// Length of a run, s.
    pub duration_s: f64,
    /// Seed of everything.
    pub seed: u64,
    /// Progress of the loop on every record.
    pub verbose: bool,
}

/// One record.
#[derive(Debug, Clone, Serialize)]
pub struct Rung {
    /// Hidden effect, with every number.
    pub truth: String,
    /// Its name.
    pub effect: &'static str,
    /// Machine.
    pub machine: String,
    /// Noise, m/s2.
    pub noise_m_s2: f64,
    /// named, ambiguous, generic, other-family or missed.
    pub result: String,
    /// Effects reported.
    pub reported: Vec<String>,
    /// Held-out NRMSE of the whole signal, corrected.
    pub corrected: f64,
    /// What the noise put in leaves of it.
    pub true_floor: f64,
    /// Seconds of the loop.
    pub seconds: f64,
}

/// All rungs of all effects on all machines.
///
/// # Errors
/// A machine that cannot be made, a record that the loop refuses.
pub fn climb(ladder: &Ladder) -> Result<Vec<Rung>> {
    let wanted = |h: &&'static Hidden| {
        !h.right_names.is_empty() && (ladder.only.is_empty() || ladder.only.iter().any(|n| n == h.name))
    };
    let all: Vec<&'static Hidden> = effects::hidden().filter(wanted).collect();
    let bar = Progress::new("rungs", (ladder.machines * all.len() * ladder.noise_m_s2.len()) as u64);
    let mut rungs = Vec::new();
    for machine in 0..ladder.machines as u64 {
        for (index, hidden) in all.iter().enumerate() {
            rungs.extend(on_machine(ladder, machine, index as u64, hidden, &bar)?);
        }
    }
    Ok(rungs)
}

fn on_machine(ladder: &Ladder, machine: u64, index: u64, hidden: &'static Hidden, bar: &Progress) -> Result<Vec<Rung>> {
    let mut random = ChaCha8Rng::seed_from_u64(ladder.seed.wrapping_mul(1009).wrapping_add(machine));
    let declared = drawn::machine(&mut random)?;
    let mut scenario = Scenario::null(&declared.shafts, random.random());
    drawn::layout(&declared, &mut scenario, &mut random);
    scenario.duration_s = ladder.duration_s;
    scenario.noise_rms = ladder.noise_m_s2.first().copied().unwrap_or(0.1);
    let mut own = ChaCha8Rng::seed_from_u64(ladder.seed.wrapping_mul(2003).wrapping_add(machine << 32 | index));
    let (floor, peak_m_s2) = floor::strength(&declared, &scenario, hidden, &mut own.clone())?;
    let size = if hidden.has_floor { LEVEL * floor } else { floor };
    let mut draw = Draw { teeth: declared.pair.teeth, peak_m_s2, random: &mut own };
    scenario.effects.extend((hidden.draw)(size, &mut draw));
    let beyond = scenario.effects.iter().find_map(|text| effects::parse(text).err());
    let mut rungs = Vec::new();
    for (i, &noise) in ladder.noise_m_s2.iter().enumerate() {
        bar.step();
        if let Some(why) = &beyond {
            crate::remark!("{} left out on {}: {why}", hidden.name, declared.title);
            continue;
        }
        scenario.noise_rms = noise;
        if i > 0 {
            (scenario.step_m_s2, scenario.jitter_s) = (0.0, 0.0);
        }
        let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario)?;
        let started = Instant::now();
        let outcome = close_loop(&record, &Options { progress: ladder.verbose, ..Options::default() })?;
        let (result, _) = score::judge(&outcome, &[(hidden, size)]);
        rungs.push(Rung {
            truth: scenario.effects.join(" "),
            effect: hidden.name,
            machine: declared.title.clone(),
            noise_m_s2: noise,
            result: result[0].clone(),
            reported: outcome.effects.iter().map(|e| format!("{}: {}", e.verdict, e.name)).collect(),
            corrected: outcome.error.held_out_runs.whole_signal.corrected,
            true_floor: floor::true_floor(&record, &scenario, &outcome.split[2]),
            seconds: started.elapsed().as_secs_f64(),
        });
    }
    Ok(rungs)
}

/// Head of [`cells`].
const HEAD: [&str; 7] = ["effect", "machine", "noise", "result", "terms", "corrected", "over floor"];

fn cells(r: &Rung) -> Vec<String> {
    vec![
        r.effect.into(),
        r.machine.clone(),
        format!("{}", r.noise_m_s2),
        r.result.clone(),
        r.reported.len().to_string(),
        format!("{:.2e}", r.corrected),
        if r.true_floor > 0.0 { format!("{:.2}", r.corrected / r.true_floor) } else { "-".into() },
    ]
}

/// The rungs as a table for the terminal.
pub fn text(rungs: &[Rung]) -> String {
    terminal::table(&HEAD, &rungs.iter().map(cells).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `prove --ladder` in short: what is named in much noise is named in little, by as many terms, down to the
    /// floor.
    #[test]
    fn loop_names_a_runout_at_every_noise() {
        let ladder = Ladder {
            machines: 1,
            noise_m_s2: vec![0.1, 0.01, 0.0],
            only: vec!["pinion-eccentricity".into()],
            duration_s: 1.0,
            seed: 1,
            verbose: false,
        };
        let rungs = climb(&ladder).unwrap();
        for rung in &rungs {
            assert_eq!(rung.reported, ["named: pinion-eccentricity"], "{rung:?}");
        }
        assert!(rungs[1].corrected < 1.2 * rungs[1].true_floor, "{:?}", rungs[1]);
        assert!(rungs[2].corrected < 2e-5, "{:?}", rungs[2]);
    }
}
