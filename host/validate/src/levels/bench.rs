//! A machine that can run for hours: its steady states, put together by angle.
//!
//! The simulator is run to its periodic steady state at `SPEEDS` speeds and two torques, sound and with each fault in
//! `STEPS` steps of severity. What the bearing does in one turn of the pinion is kept, cut off at the pass edge, and
//! interpolated in speed, torque and severity while the angle runs on. In torque that is exact for a linear mesh, in
//! severity nearly; in speed it leaves out transients of run-ups and the phase of resonances between two speeds.
//! Everything has the period of the pinion's turn: the gear is without errors. Half a minute to prepare; from then on
//! an hour of the machine is its noise and a table look-up per sample.

use crate::dynamics::assembly::{Damping, Model};
use crate::dynamics::{Effect, Motion, Rig};
use crate::effects;
use crate::machine::Machine;
use crate::{Error, Result};
use rayon::prelude::*;
use realfft::RealFftPlanner;

/// Points per turn of the pinion.
pub const POINTS: usize = 4096;
/// Speeds at which the machine is simulated.
const SPEEDS: usize = 24;
/// Steps of severity beside none.
pub const STEPS: usize = 3;
/// Torques, as shares of the nominal one.
pub const LOADS: [f64; 2] = [0.7, 1.3];
/// Nothing above this reaches the converter, Hz.
pub const PASS_HZ: f64 = 5000.0;
/// What a sound machine has: tooth errors and runout of a ground gear of quality 5 or so.
const SOUND_EFFECTS: [&str; 2] = ["pitch-error:random=2e-6", "eccentricity:amplitude=4e-6"];

/// A fault that grows.
pub struct Fault {
    /// For tables.
    pub name: &'static str,
    /// What it is at severity 1.
    pub full: &'static str,
    /// The effect at a severity.
    effect: fn(f64) -> String,
}

/// The faults.
pub const FAULTS: [Fault; 3] = [
    Fault {
        name: "crack",
        full: "one tooth of the pinion, 30 % of its pair's stiffness lost",
        effect: |s| format!("tooth-crack:loss={}", 0.3 * s),
    },
    Fault { name: "runout", full: "pinion, 40 um more", effect: |s| format!("eccentricity:amplitude={}", 40e-6 * s) },
    Fault { name: "wear", full: "10 um at both ends of the flanks", effect: |s| format!("wear:depth={}", 10e-6 * s) },
];

/// Waves at both loads, for every speed.
type Waves = Vec<[Vec<f32>; 2]>;

/// The machine, ready to run.
pub struct Bench {
    /// Speeds simulated, Hz, at equal ratios.
    pub speeds_hz: Vec<f64>,
    /// Teeth of pinion and gear.
    pub teeth: [u32; 2],
    sound: Waves,
    /// By fault and step.
    faulty: Vec<Vec<Waves>>,
}

impl Bench {
    /// Simulates all steady states.
    ///
    /// # Errors
    /// A speed range that is none, a machine without nominal torque, and what the simulator refuses.
    pub fn new(machine: &Machine, (lowest_hz, highest_hz): (f64, f64)) -> Result<Self> {
        if !(lowest_hz >= 1.0 && highest_hz > 1.1 * lowest_hz && highest_hz <= 60.0) {
            let what = format!("{lowest_hz} to {highest_hz} Hz is no range within 1 to 60 Hz");
            return Err(Error::invalid("--speeds", what));
        }
        let missing = || Error::invalid("[nominal]", "torque_n_m is needed: it is what the load wanders about");
        let torque = machine.nominal.ok_or_else(missing)?.torque_n_m;
        let rig = Rig::new(machine, Model::BendingTorsional, Damping::Declared)?;
        let ratio = (highest_hz / lowest_hz).powf(1.0 / (SPEEDS - 1) as f64);
        let speeds_hz: Vec<f64> = (0..SPEEDS).map(|n| lowest_hz * ratio.powi(n as i32)).collect();
        let waves = |extra: Option<String>| -> Result<Waves> {
            let at = |&speed: &f64| {
                let [light, heavy] = LOADS.map(|load| wave(&rig, speed, load * torque, extra.as_deref()));
                Ok([light?, heavy?])
            };
            speeds_hz.par_iter().map(at).collect()
        };
        let step = |fault: &Fault, n: usize| waves(Some((fault.effect)(n as f64 / STEPS as f64)));
        let steps = |fault: &Fault| (1..=STEPS).map(|n| step(fault, n)).collect::<Result<Vec<Waves>>>();
        let faulty = FAULTS.iter().map(steps).collect::<Result<_>>()?;
        let sound = waves(None)?;
        Ok(Self { speeds_hz, teeth: machine.pair.teeth, sound, faulty })
    }

    /// The wave of one turn at a speed, a load and a severity of a fault, into `turn`.
    pub fn mix(&self, speed_hz: f64, load: f64, fault: Option<(usize, f64)>, turn: &mut [f32]) {
        let steps = (self.speeds_hz.len() - 1) as f64;
        let first = self.speeds_hz[0];
        let at = (steps * (speed_hz / first).ln() / (self.speeds_hz[self.speeds_hz.len() - 1] / first).ln())
            .clamp(0.0, steps);
        let below = (at.floor() as usize).min(self.speeds_hz.len() - 2);
        let speeds = [(below, 1.0 - (at - below as f64)), (below + 1, at - below as f64)];
        let heavy = (load - LOADS[0]) / (LOADS[1] - LOADS[0]);
        let severities: [(&Waves, f64); 2] = match fault {
            None => [(&self.sound, 1.0), (&self.sound, 0.0)],
            Some((fault, severity)) => {
                let along = (severity * STEPS as f64).clamp(0.0, STEPS as f64);
                let step = (along.floor() as usize).min(STEPS - 1);
                let of = |n: usize| if n == 0 { &self.sound } else { &self.faulty[fault][n - 1] };
                [(of(step), 1.0 - (along - step as f64)), (of(step + 1), along - step as f64)]
            }
        };
        turn.fill(0.0);
        for (waves, by_severity) in severities {
            for (speed, by_speed) in speeds {
                for (load, by_load) in [(0, 1.0 - heavy), (1, heavy)] {
                    let share = (by_severity * by_speed * by_load) as f32;
                    if share != 0.0 {
                        turn.iter_mut().zip(&waves[speed][load]).for_each(|(sum, x)| *sum += share * x);
                    }
                }
            }
        }
    }
}

/// One turn of the pinion in the steady state, m/s2 at its bearing, [`POINTS`] points, nothing above the pass edge.
fn wave(rig: &Rig, speed_hz: f64, torque_n_m: f64, extra: Option<&str>) -> Result<Vec<f32>> {
    let texts = SOUND_EFFECTS.into_iter().chain(extra);
    let effects = texts.map(effects::parse).collect::<Result<Vec<Box<dyn Effect>>>>()?;
    let motion = Motion::Constant { speed_hz, turns_at_zero: 0.0 };
    let ([mut samples, _], _) = rig.accelerations(&motion, torque_n_m, &effects, speed_hz * POINTS as f64, POINTS)?;
    let failed = |e: realfft::FftError| Error::impossible("transform", e.to_string());
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(POINTS), planner.plan_fft_inverse(POINTS));
    let mut lines = forward.make_output_vec();
    forward.process(&mut samples, &mut lines).map_err(failed)?;
    let passes = (PASS_HZ / speed_hz) as usize;
    lines.iter_mut().enumerate().filter(|(order, _)| *order == 0 || *order > passes).for_each(|(_, line)| *line *= 0.0);
    inverse.process(&mut lines, &mut samples).map_err(failed)?;
    Ok(samples.iter().map(|x| (x / POINTS as f64) as f32).collect())
}
