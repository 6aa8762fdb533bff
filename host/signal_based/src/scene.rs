//! What signal-based inference sees of a record: every channel at equal angles, and which turns are whose.
//!
//! The angle and its grid are the analysis' ([`Angle`]). A channel that does not move is left out and said; so is a
//! run without enough turns. Cost: eight bytes per point at equal angles and channel, a few copies of it while the
//! loop works ([`GRID`]).

use super::basis::State;
use super::clipping_detector::at_limit;
use super::gearing::Gearing;
use super::shaft::Shaft;
use super::split::Split;
use crate::analysis::angle::Angle;
use crate::analysis::explained::Explained;
use crate::analysis::lines::LOBE_BINS;
use crate::analysis::mesh_phase as phase;
use crate::budget::GRID;
use crate::record::{Record, Run, Tach};
use crate::spectral::AngleMap;
use crate::train::Train;
use crate::{Error, Result};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use std::f64::consts::PI;

/// A channel that is used.
#[derive(Debug, Clone)]
pub struct Channel {
    /// Index in the record, from 0.
    pub index: usize,
    /// Name.
    pub name: String,
}

/// A run with its channels.
#[derive(Debug, Clone)]
pub struct SceneRun {
    /// Index in the record, from 0.
    pub index: usize,
    /// Angle and grid.
    pub angle: Angle,
    /// Sampling rate, Hz.
    pub rate_hz: f64,
    /// Whether pulses of a shaft give the angle, not the mesh lines.
    pub has_pulses: bool,
    /// Which turns are fitted.
    pub split: Split,
    /// How the pinion turns in each turn of the grid.
    pub states: Vec<State>,
    /// Samples over time, channel by channel, record's unit.
    pub signals: Vec<Vec<f64>>,
    /// Samples at equal angles less their mean, channel by channel.
    pub samples: Vec<Vec<f64>>,
    /// Samples that stand at a limit, channel by channel.
    pub at_limit: Vec<usize>,
}

/// The record.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Title of the record.
    pub title: String,
    /// Unit of the channels.
    pub unit: String,
    /// Teeth of pinion and gear.
    pub teeth: [u32; 2],
    /// Turns of the gear per turn of the pinion; of a train those of its slowest shaft per turn of the input.
    pub gear_order: f64,
    /// The train, where it is one: orders are then those of its input.
    pub gearing: Option<Gearing>,
    /// Channels used, those that families are searched on first.
    pub channels: Vec<Channel>,
    /// Channels that families are searched on; the rest are held out.
    pub searched: usize,
    /// Runs used.
    pub runs: Vec<SceneRun>,
    /// Highest order that every run holds.
    pub highest_order: f64,
    /// What was left out, in sentences.
    pub notes: Vec<String>,
}

/// Channels from which every second one is held out.
const MANY_CHANNELS: usize = 6;
/// Bins beside a shaft's order within which another line is not told from it: the window's lobe is down by 23 dB.
const BESIDE_BINS: f64 = 2.5;
/// Shares of the turns between which a speed is usual.
const USUAL_SPEED_QUANTILES: (f64, f64) = (0.1, 0.9);
/// Rounds of taking the angle from the mesh lines.
const ANGLE_ROUNDS: usize = 3;
/// Multiple of the highest order beyond which nothing passes.
const STOPBAND_RATIO: f64 = 1.03;

impl Scene {
    /// Of a record with tach and tooth counts.
    ///
    /// # Errors
    /// No run with enough turns, no channel that moves, more points than the budget.
    pub fn of(record: &Record, tach: &Tach, teeth: [u32; 2]) -> Result<Self> {
        let angle = |run: &Run, place: &str| Angle::of(run, tach, teeth, place);
        let scene = Self::seen(record, tach, teeth, f64::from(teeth[0]), &angle)?;
        Ok(Self { gear_order: f64::from(teeth[0]) / f64::from(teeth[1]), ..scene })
    }

    /// Of a record with a tach on any shaft of a train.
    ///
    /// # Errors
    /// As [`Scene::of`].
    pub fn of_train(record: &Record, tach: &Tach, train: &Train) -> Result<Self> {
        let angle = |run: &Run, place: &str| Angle::of_train(run, tach, train, place);
        let mesh = Gearing::leading_mesh(train);
        let teeth = Gearing::leading_teeth(train);
        let scene = Self::seen(record, tach, teeth, mesh, &angle)?;
        let slower = scene.runs.iter().map(|run| run.angle.gear_order).fold(0.0, f64::max);
        let turns = scene.runs.iter().map(|run| run.angle.turns as f64).fold(0.0, f64::max);
        let gearing = Gearing::of(train, scene.highest_order, slower);
        let notes = [scene.notes.clone(), gearing.notes(turns)].concat();
        Ok(Self { gear_order: slower, gearing: Some(gearing), notes, ..scene })
    }

    fn seen(
        record: &Record,
        tach: &Tach,
        teeth: [u32; 2],
        mesh: f64,
        angle: &dyn Fn(&Run, &str) -> Result<Angle>,
    ) -> Result<Self> {
        let acquisition = &record.declaration.acquisition;
        let (mut runs, mut notes, mut refused) = (Vec::new(), Vec::new(), None);
        let (order, searched) = channels(record, &mut notes)?;
        for (index, run) in record.runs.iter().enumerate() {
            match angle(run, &format!("run {index}")) {
                Ok(angle) => runs.push((index, run, angle)),
                Err(error) => {
                    notes.push(format!("left out: {error}"));
                    refused.get_or_insert(error);
                }
            }
        }
        if let (true, Some(error)) = (runs.is_empty(), refused) {
            return Err(error);
        }
        let points: f64 = runs.iter().map(|(_, _, a)| (a.turns * a.per_turn[0] * order.len()) as f64).sum();
        let remedy = "take a part with --from and --to, or leave channels out at import";
        GRID.check(record.folder.display(), points, remedy)?;
        let highest_order = runs.iter().map(|(_, _, a)| a.highest_order).fold(f64::INFINITY, f64::min);
        let mut runs: Vec<SceneRun> =
            runs.into_iter().map(|own| seen(own, !tach.is_virtual(), &order, highest_order)).collect();
        for run in &mut runs {
            // Where a run-up begins and ends its speed has kinks, which smoothing would turn into swings.
            if !tach.is_virtual() && !run.runs_up() {
                run.settle(highest_order);
            }
            if run.sharpen(mesh, highest_order, tach.is_virtual()) {
                notes.push(format!(
                    "run {}: the tach does not follow the speed; the angle is that of the mesh lines",
                    run.index
                ));
            }
        }
        if let Some(run) = runs.iter().find(|run| run.split.held_out.is_empty()) {
            notes.push(format!("run {} is too short to hold a stretch of it out", run.index));
        }
        Ok(Self {
            title: record.declaration.title().to_owned(),
            unit: acquisition.unit.clone().unwrap_or_else(|| "m/s2".into()),
            teeth,
            gear_order: 1.0,
            gearing: None,
            channels: order.iter().map(|&index| Channel { index, name: acquisition.channels[index].clone() }).collect(),
            searched,
            highest_order,
            runs,
            notes,
        })
    }

    /// Whether the rig has gears: a shaft alone is a pair of one tooth.
    pub fn has_gears(&self) -> bool {
        self.teeth[0] > 1
    }

    /// Teeth of the pinion: the mesh's order; of a train that of the mesh that leads.
    pub fn mesh_order(&self) -> f64 {
        self.gearing.as_ref().map_or(f64::from(self.teeth[0]), |gearing| gearing.leading)
    }

    /// Orders of all meshes.
    pub fn meshes(&self) -> Vec<f64> {
        self.gearing.as_ref().map_or_else(|| vec![f64::from(self.teeth[0])], |gearing| gearing.meshes.clone())
    }

    /// Order of a shaft: 0 is the pinion's, 1 the gear's, from 2 on those of a train.
    pub fn shaft_order(&self, shaft: usize) -> f64 {
        match (shaft, &self.gearing) {
            (0, _) => 1.0,
            (1, _) => self.gear_order,
            (of_train, Some(gearing)) => gearing.shafts.get(of_train - 2).copied().unwrap_or(1.0),
            _ => 1.0,
        }
    }

    /// The shafts.
    pub fn shafts(&self) -> &'static [Shaft] {
        match &self.gearing {
            Some(gearing) => &Shaft::TRAIN_SHAFTS[..gearing.shafts.len().min(Shaft::TRAIN_SHAFTS.len())],
            None => &Shaft::PAIR_SHAFTS,
        }
    }

    /// Harmonics of the mesh up to the highest order; of a train all lines that its meshes have, what
    /// unequal load shares leave of a set included.
    pub fn mesh_lines(&self) -> Vec<f64> {
        if let Some(gearing) = &self.gearing {
            return gearing.uneven.clone();
        }
        let z = self.mesh_order();
        (1..=(self.highest_order / z) as usize).map(|k| k as f64 * z).collect()
    }

    /// What orders the gears explain in a run.
    pub fn explained(&self, angle: &Angle, highest: f64) -> Explained {
        match &self.gearing {
            Some(gearing) => Explained::of_train(&gearing.owned, self.teeth[0], angle, highest),
            None => Explained::new(self.teeth[0], angle, highest),
        }
    }

    /// Orders between lines that a fit stretch keeps apart: the main lobes' width.
    pub fn resolution(&self) -> f64 {
        LOBE_BINS * self.bin()
    }

    /// Orders beside a shaft's order within which no other line is read: its own lobe reaches over to it.
    pub fn beside_a_shaft(&self) -> f64 {
        BESIDE_BINS * self.bin()
    }

    /// Width of a bin of the shortest fitted stretch, orders; zero where there is none.
    pub fn bin(&self) -> f64 {
        let turns = self.runs.iter().flat_map(|run| &run.split.fit).map(|s| s.turns).min();
        turns.map_or(0.0, |turns| 1.0 / turns as f64)
    }
}

/// Channels that move: those to search on (every second of four or more), then the others.
fn channels(record: &Record, notes: &mut Vec<String>) -> Result<(Vec<usize>, usize)> {
    let names = &record.declaration.acquisition.channels;
    let moves = |c: usize| record.runs.iter().all(|run| run.moves(c));
    let (moving, still): (Vec<usize>, Vec<usize>) = (0..names.len()).partition(|&c| moves(c));
    notes.extend(
        still.iter().map(|&c| format!("channel {c} ({}) does not move and is left out", crate::text::name(&names[c]))),
    );
    if moving.is_empty() {
        return Err(Error::invalid(record.folder.display(), "no vibration in the record: no channel moves"));
    }
    if moving.len() < MANY_CHANNELS {
        return Ok((moving.clone(), moving.len()));
    }
    let searched: Vec<usize> = moving.iter().copied().step_by(2).collect();
    let others: Vec<usize> = moving.iter().copied().skip(1).step_by(2).collect();
    let count = searched.len();
    Ok(([searched, others].concat(), count))
}

fn seen(
    (index, run, angle): (usize, &Run, Angle),
    has_pulses: bool,
    channels: &[usize],
    highest_order: f64,
) -> SceneRun {
    let rate_hz = run.sample_rate_hz();
    let standing = |&c: &usize| at_limit(&run.channel_codes(c));
    let mut seen = SceneRun {
        index,
        rate_hz,
        has_pulses,
        split: Split::new(angle.turns, angle.slower_order(), angle.speed.fastest_hz / angle.speed.slowest_hz),
        states: Vec::new(),
        at_limit: channels.iter().map(standing).collect(),
        signals: channels.iter().map(|&c| run.signal_m_s2(c)).collect(),
        samples: Vec::new(),
        angle,
    };
    seen.read(highest_order);
    seen
}

/// Speeds of the turns with their rates of change, over the root mean square of these.
fn states(speeds_hz: &[f64]) -> Vec<State> {
    let rate = |i: usize| {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(speeds_hz.len() - 1));
        (speeds_hz[after] - speeds_hz[before]) * speeds_hz[i] / (after - before).max(1) as f64
    };
    let rates: Vec<f64> = (0..speeds_hz.len()).map(rate).collect();
    let usual = (rates.iter().map(|r| r * r).sum::<f64>() / rates.len().max(1) as f64).sqrt().max(f64::MIN_POSITIVE);
    let state = |(&speed_hz, &sweep_hz_s): (&f64, &f64)| State { speed_hz, sweep_hz_s, swing: sweep_hz_s / usual };
    speeds_hz.iter().zip(&rates).map(state).collect()
}

/// A signal at equal angles, less its mean and what lies above the highest order: what no run holds at every speed is
/// no error of a model.
fn on_grid(angle: &Angle, signal: &[f64], rate_hz: f64, highest_order: f64) -> Vec<f64> {
    let mut samples = angle.resampled(signal, rate_hz);
    let count = samples.len();
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(count), planner.plan_fft_inverse(count));
    let mut spectrum = forward.make_output_vec();
    forward.process(&mut samples, &mut spectrum).expect("matching lengths");
    for (i, bin) in spectrum.iter_mut().enumerate() {
        let over = i as f64 / angle.turns as f64 / highest_order;
        let pass = ((STOPBAND_RATIO - over) / (STOPBAND_RATIO - 1.0)).clamp(0.0, 1.0);
        *bin *= if i == 0 { 0.0 } else { 0.5 - 0.5 * (PI * pass).cos() } / count as f64;
    }
    if let (Some(last), true) = (spectrum.last_mut(), count.is_multiple_of(2)) {
        last.im = 0.0;
    }
    inverse.process(&mut spectrum, &mut samples).expect("matching lengths");
    samples
}

impl SceneRun {
    /// Reads the channels at the run's angle.
    fn read(&mut self, highest_order: f64) {
        let angle = &self.angle;
        let time = |turn: usize| angle.map.time_at(angle.from_turn + turn as f64);
        let speeds: Vec<f64> = (0..angle.turns).map(|i| 1.0 / (time(i + 1) - time(i))).collect();
        self.states = states(&speeds);
        self.samples = self.signals.par_iter().map(|s| on_grid(angle, s, self.rate_hz, highest_order)).collect();
    }

    /// Whether the speed runs up or down: the path then turns the mesh lines, and no phase can be told from one part
    /// of the run for another.
    pub fn runs_up(&self) -> bool {
        self.angle.runs_up()
    }

    /// Speeds that the run has in eight turns of ten, Hz.
    pub fn usual_speeds_hz(&self) -> [f64; 2] {
        let mut speeds: Vec<f64> = self.states.iter().map(|state| state.speed_hz).collect();
        speeds.sort_by(f64::total_cmp);
        let at = |share: f64| speeds.get((share * speeds.len() as f64) as usize).copied().unwrap_or(0.0);
        [at(USUAL_SPEED_QUANTILES.0), at(USUAL_SPEED_QUANTILES.1)]
    }

    /// Takes another angle.
    pub fn turn(&mut self, map: AngleMap, highest_order: f64) {
        self.angle.map = map;
        self.read(highest_order);
    }

    /// Takes the tachometer's jitter out of the angle.
    fn settle(&mut self, highest_order: f64) {
        if let Some(map) = self.angle.settled_map() {
            self.turn(map, highest_order);
        }
    }

    /// Takes the angle from the mesh lines where they get sharper by it; whether they did.
    fn sharpen(&mut self, mesh_order: f64, highest_order: f64, virtual_tach: bool) -> bool {
        if self.runs_up() && !virtual_tach {
            return false;
        }
        let mut sharper = false;
        for _ in 0..ANGLE_ROUNDS {
            let departure = phase::departure(&self.samples, &self.angle, mesh_order, highest_order);
            let Some(map) = departure.and_then(|departure| departure.taken_out(&self.angle)) else { break };
            self.turn(map, highest_order);
            sharper = true;
        }
        sharper
    }

    /// Another signal over the same time as the channels' are seen.
    pub fn on_grid(&self, signal: &[f64], highest_order: f64) -> Vec<f64> {
        on_grid(&self.angle, signal, self.rate_hz, highest_order)
    }
}
