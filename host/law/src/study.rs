//! The paper's studies on a declared machine: what the bandwidth of its engagement edges depends on.
//!
//! Every study changes one thing and keeps the rest. Rows hold both edges of the full simulation, the exit edge
//! of one engagement alone (the law's), and the 99 % occupied bandwidth, which is what a spectrum analyser
//! would call the width of the signal: 0.35 / t_r is a property of one edge, not of the spectrum.
//! Operating points run in parallel; a row takes one to ten milliseconds.

use super::derive::{bandwidth_hz, study_torque};
use super::operating::{Bench, Event, Periodic};
use super::paper;
use crate::machine::{Crack, CrackRule, Engagement, EngagementKind, Machine, Side};
use crate::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;

/// Points of one mesh period in the occupied bandwidth's spectrum.
const SPECTRUM_POINTS: usize = 1 << 15;

/// One operating point.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// What was set, for people.
    pub label: String,
    /// What was set, in the sweep's unit.
    pub value: f64,
    /// Bandwidth of the exit edge (the pinion's positive pulse) in the full simulation, Hz.
    pub exit_hz: Option<f64>,
    /// Bandwidth of the entry edge (negative pulse), Hz.
    pub entry_hz: Option<f64>,
    /// Bandwidth of the exit edge of one engagement alone, Hz.
    pub alone_hz: Option<f64>,
    /// 99 % occupied bandwidth of the periodic acceleration, Hz.
    pub occupied_hz: f64,
    /// Rise time of the exit edge in the full simulation, s.
    pub exit_rise_s: Option<f64>,
}

/// One thing changed.
#[derive(Debug, Clone, Serialize)]
pub struct Sweep {
    /// What was changed.
    pub name: &'static str,
    /// Unit of [`Row::value`].
    pub unit: &'static str,
    /// The rows.
    pub rows: Vec<Row>,
}

impl Sweep {
    /// (largest - smallest) / mean of the exit edge's bandwidth: the paper's "difference".
    pub fn spread(&self) -> f64 {
        let b: Vec<f64> = self.rows.iter().filter_map(|r| r.exit_hz).collect();
        let mean = b.iter().sum::<f64>() / b.len().max(1) as f64;
        let (low, high) = b.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), &b| (l.min(b), h.max(b)));
        (high - low) / mean
    }
}

/// 99 % occupied bandwidth, Hz: half a per cent of the power lies below it and half a per cent above.
pub fn occupied_hz(response: &Periodic) -> f64 {
    let n = SPECTRUM_POINTS;
    let step = response.mesh_period_s / n as f64;
    let mut signal: Vec<f64> = (0..n).map(|i| response.value(i as f64 * step)).collect();
    let forward = realfft::RealFftPlanner::new().plan_fft_forward(n);
    let mut lines = forward.make_output_vec();
    forward.process(&mut signal, &mut lines).expect("lengths come from the plan");
    let power: Vec<f64> = lines.iter().skip(1).map(|c| c.norm_sqr()).collect();
    let total: f64 = power.iter().sum();
    let border = |share: f64| {
        let mut sum = 0.0;
        power
            .iter()
            .position(|p| {
                sum += p;
                sum >= share * total
            })
            .unwrap_or(0)
            + 1
    };
    // Lines, not a continuum: a single line occupies one mesh frequency.
    (border(0.995) - border(0.005) + 1) as f64 / response.mesh_period_s
}

/// The row of an operating point.
///
/// # Errors
/// What stops the simulation.
pub fn row(bench: &Bench, label: String, value: f64, shaft_hz: f64, torque_n_m: f64) -> Result<Row> {
    let response = bench.healthy(shaft_hz, torque_n_m)?;
    let exit = response.edge(0, Event::Exit);
    let alone = bench.isolated(Event::Exit, shaft_hz, torque_n_m)?;
    let seen = exit.filter(|e| alone.is_none_or(|a| e.height() > a.height() / 3.0));
    Ok(Row {
        label,
        value,
        exit_hz: seen.as_ref().map(bandwidth_hz),
        entry_hz: response.edge(0, Event::Entry).as_ref().map(bandwidth_hz),
        alone_hz: alone.as_ref().map(bandwidth_hz),
        occupied_hz: occupied_hz(&response),
        exit_rise_s: seen.map(|e| e.rise_time_s),
    })
}

/// A machine changed and made sound again.
fn changed(machine: &Machine, change: impl FnOnce(&mut Machine)) -> Result<Machine> {
    let mut other = machine.clone();
    if other.pair.mesh_damping_ratio.is_some() {
        // Follows from the ratio and the new stiffness.
        other.pair.mesh_damping_s = 0.0;
    }
    change(&mut other);
    let folder = other.folder.clone();
    other.prepared("law study", &folder)
}

/// The machine with another engagement.
///
/// # Errors
/// An engagement that the pair cannot have.
pub fn with_engagement(machine: &Machine, engagement: Engagement) -> Result<Machine> {
    changed(machine, |m| m.engagement = Some(engagement))
}

/// An engagement with nothing but its kind.
pub fn engagement(kind: EngagementKind) -> Engagement {
    Engagement {
        kind,
        width_rad: None,
        relief_m: None,
        relief_length_base_pitches: None,
        relief_exponent: None,
        torque_n_m: None,
    }
}

/// Bandwidth against module (the paper's Table 2); bores scale with it, face width and masses stay.
///
/// # Errors
/// What stops the simulation.
pub fn module_sweep(machine: &Machine, shaft_hz: f64) -> Result<Sweep> {
    from_geometry(machine)?;
    let torque = study_torque(machine)?;
    let rows = [1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0]
        .into_par_iter()
        .map(|module_mm: f64| {
            let scale = module_mm * 1e-3 / machine.pair.module_m;
            let other = changed(machine, |m| {
                m.pair.module_m *= scale;
                m.pair.bore_radius_m = m.pair.bore_radius_m.map(|b| b * scale);
            })?;
            row(&Bench::new(&other)?, format!("{module_mm} mm"), module_mm, shaft_hz, torque)
        })
        .collect::<Result<_>>()?;
    Ok(Sweep { name: "module", unit: "mm", rows })
}

/// Bandwidth against tooth numbers (the paper's Table 3).
///
/// # Errors
/// What stops the simulation.
pub fn teeth_sweep(machine: &Machine, shaft_hz: f64) -> Result<Sweep> {
    from_geometry(machine)?;
    let torque = study_torque(machine)?;
    let own = machine.pair.teeth.map(f64::from);
    let rows = [[25, 35], [35, 48], [45, 61], [55, 75], [65, 89], [75, 102], [95, 130]]
        .into_par_iter()
        .map(|teeth: [u32; 2]| {
            let other = changed(machine, |m| {
                m.pair.teeth = teeth;
                for i in 0..2 {
                    m.pair.bore_radius_m[i] *= f64::from(teeth[i]) / own[i];
                }
            })?;
            row(&Bench::new(&other)?, format!("{}/{}", teeth[0], teeth[1]), f64::from(teeth[0]), shaft_hz, torque)
        })
        .collect::<Result<_>>()?;
    Ok(Sweep { name: "tooth numbers", unit: "pinion teeth", rows })
}

fn from_geometry(machine: &Machine) -> Result<()> {
    if machine.pair.pair_stiffness.is_some() || machine.pair.total_stiffness.is_some() {
        return Err(Error::impossible(
            "law study",
            "module and teeth cannot be varied: the stiffness is a declared table",
        ));
    }
    Ok(())
}

/// Bandwidth against pinion speed, 1 to 25 Hz in whole Hz (the paper's Tables 4 and 5), and 50 Hz.
///
/// # Errors
/// What stops the simulation.
pub fn speed_sweep(machine: &Machine, bench: &Bench) -> Result<Sweep> {
    let torque = study_torque(machine)?;
    let rows = (1..=26)
        .into_par_iter()
        .map(|f| if f == 26 { 50.0 } else { f64::from(f) })
        .map(|f| row(bench, format!("{f} Hz"), f, f, torque))
        .collect::<Result<_>>()?;
    Ok(Sweep { name: "pinion speed", unit: "Hz", rows })
}

/// Bandwidth against torque. A load-dependent ramp is computed at each torque.
///
/// # Errors
/// What stops the simulation.
pub fn torque_sweep(machine: &Machine, shaft_hz: f64) -> Result<Sweep> {
    let nominal = study_torque(machine)?;
    let rows = [0.25, 0.5, 1.0, 2.0, 4.0]
        .into_par_iter()
        .map(|share| {
            let torque = share * nominal;
            let other = changed(machine, |m| {
                if let Some(e) = &mut m.engagement {
                    e.torque_n_m = Some(torque);
                }
            })?;
            row(&Bench::new(&other)?, format!("{torque:.1} N m"), torque, shaft_hz, torque)
        })
        .collect::<Result<_>>()?;
    Ok(Sweep { name: "torque", unit: "N m", rows })
}

/// One ramp over speed.
#[derive(Debug, Clone, Serialize)]
pub struct RampStudy {
    /// For people.
    pub name: String,
    /// Width of the exit ramp, mrad of the pinion.
    pub width_mrad: f64,
    /// Bandwidth over speed.
    pub sweep: Sweep,
    /// Held-out error of the tabulated law on the edge alone.
    pub table_worst: f64,
    /// Held-out error of the quadratic on the edge alone.
    pub quadratic_worst: f64,
    /// Scatter of the full simulation's edges about the edge alone, root mean square.
    pub ring_rms: f64,
    /// Held-out speeds, of 53, at which the ring hides the edge.
    pub hidden: usize,
}

/// Ramps compared: widths of the paper's kind, a smooth one, tip relief, loaded contact.
fn ramps_compared(machine: &Machine) -> Vec<(String, Engagement)> {
    let of = |kind, width_rad| Engagement { width_rad: Some(width_rad), ..engagement(kind) };
    let relief = |micrometres: f64, length: f64, exponent: u32| Engagement {
        relief_m: Some([micrometres * 1e-6; 2]),
        relief_length_base_pitches: Some(length),
        relief_exponent: Some(exponent),
        ..engagement(EngagementKind::TipRelief)
    };
    let mut all = vec![
        ("linear, 0.25 mrad".to_string(), of(EngagementKind::Linear, 0.25e-3)),
        ("linear, 0.5 mrad".to_string(), of(EngagementKind::Linear, 0.5e-3)),
        ("linear, 2 mrad".to_string(), of(EngagementKind::Linear, 2e-3)),
        ("raised cosine, 5 mrad".to_string(), of(EngagementKind::RaisedCosine, 5e-3)),
        ("tip relief, 2 um over 0.2 base pitch".to_string(), relief(2.0, 0.2, 1)),
        ("loaded contact".to_string(), engagement(EngagementKind::Loaded)),
    ];
    if let Some(own) = machine.engagement {
        all.insert(0, ("this machine".into(), own));
    }
    all
}

/// Bandwidth against the engagement ramp: what the law is really a property of.
///
/// A ramp that the pair cannot have (too wide, relief beyond the load) is left out.
///
/// # Errors
/// What stops the simulation.
pub fn ramp_study(machine: &Machine, step: &(impl Fn() + Sync)) -> Result<Vec<RampStudy>> {
    let studies: Vec<Option<RampStudy>> = ramps_compared(machine)
        .into_par_iter()
        .map(|(name, engagement)| {
            let Ok(other) = with_engagement(machine, engagement) else { return Ok(None) };
            let bench = Bench::new(&other)?;
            let Ok(laws) = super::derive::derive(&other, &bench, super::domain::Domain::PAPER, &|| ()) else {
                return Ok(None);
            };
            let check = super::derive::check(&laws, &bench, &|| ())?;
            step();
            Ok(Some(RampStudy {
                name,
                width_mrad: 1e3 * laws.ramp_width_rad,
                sweep: speed_sweep(&other, &bench)?,
                table_worst: check.forms[3].worst,
                quadratic_worst: check.forms[0].worst,
                ring_rms: check.ring_rms,
                hidden: check.hidden,
            }))
        })
        .collect::<Result<_>>()?;
    Ok(studies.into_iter().flatten().collect())
}

/// The paper's ramp, found from the one bandwidth of the paper that survives.
#[derive(Debug, Clone, Serialize)]
pub struct Calibration {
    /// Bandwidth aimed at, Hz.
    pub target_hz: f64,
    /// Speed assumed for it, Hz; inferred, not printed.
    pub shaft_hz: f64,
    /// Width of a linear ramp that gives it, rad of the pinion.
    pub width_rad: f64,
    /// (speed assumed, width that follows): sensitivity to the inferred speed.
    pub by_speed: Vec<(f64, f64)>,
    /// (width, bandwidth at the assumed speed): sensitivity to the ramp.
    pub by_width: Vec<(f64, f64)>,
}

/// Width of a linear ramp that gives `target_hz` at `shaft_hz`, rad.
///
/// # Errors
/// What stops the simulation, or no convergence.
pub fn width_for(machine: &Machine, target_hz: f64, shaft_hz: f64) -> Result<f64> {
    let torque = study_torque(machine)?;
    let bandwidth = |width: f64| -> Result<f64> {
        let linear = Engagement { width_rad: Some(width), ..engagement(EngagementKind::Paper) };
        super::derive::edge_bandwidth_hz(&Bench::new(&with_engagement(machine, linear)?)?, shaft_hz, torque)
    };
    // Limited by the ramp, bandwidth times width is constant, so this converges in two or three rounds.
    let mut width = super::forms::RISE_TIME_PRODUCT / target_hz * std::f64::consts::TAU * shaft_hz / 0.8;
    for _ in 0..20 {
        let ratio = bandwidth(width)? / target_hz;
        width *= ratio;
        if (ratio - 1.0).abs() < 1e-7 {
            return Ok(width);
        }
    }
    Err(Error::impossible("calibration", format!("no linear ramp gives {target_hz} Hz at {shaft_hz} Hz")))
}

/// Calibrates the paper's ramp on this machine.
///
/// # Errors
/// What stops the simulation.
pub fn calibrate(machine: &Machine) -> Result<Calibration> {
    let (target_hz, shaft_hz) = (paper::HEALTHY_HZ, paper::INFERRED_HZ);
    let by_speed = [14.0, 14.5, 15.0, 15.3]
        .into_par_iter()
        .map(|f| Ok((f, width_for(machine, target_hz, f)?)))
        .collect::<Result<Vec<_>>>()?;
    let width_rad = by_speed[1].1;
    let torque = study_torque(machine)?;
    let by_width = [0.9, 0.95, 1.0, 1.05, 1.1]
        .into_par_iter()
        .map(|share| {
            let linear = Engagement { width_rad: Some(share * width_rad), ..engagement(EngagementKind::Paper) };
            let bench = Bench::new(&with_engagement(machine, linear)?)?;
            Ok((share * width_rad, super::derive::edge_bandwidth_hz(&bench, shaft_hz, torque)?))
        })
        .collect::<Result<Vec<_>>>()?;
    Ok(Calibration { target_hz, shaft_hz, width_rad, by_speed, by_width })
}

/// One pulse while the cracked tooth works.
#[derive(Debug, Clone, Serialize)]
pub struct CrackPulse {
    /// Peak (a pair leaves) or trough (a pair enters), and which pair, counted from the cracked one.
    pub label: String,
    /// Bandwidth, Hz.
    pub bandwidth_hz: f64,
    /// Relative difference from the healthy pulse of the same kind.
    pub deviation: f64,
}

/// The six pulses for one depth of the crack.
#[derive(Debug, Clone, Serialize)]
pub struct CrackStudy {
    /// Depth along the crack, m.
    pub depth_m: f64,
    /// Loss of the cracked pair's stiffness in mid path, relative.
    pub stiffness_loss: f64,
    /// Healthy peak and trough, Hz.
    pub healthy_hz: [f64; 2],
    /// Three peaks, then three troughs.
    pub pulses: Vec<CrackPulse>,
}

/// The crack a study uses where the machine declares none: on the pinion, half a module to one module deep.
pub fn crack_of(machine: &Machine, depth_m: f64) -> Crack {
    Crack {
        depth_m,
        ..machine.crack.unwrap_or(Crack {
            side: Side::Pinion,
            tooth: 0,
            depth_m,
            angle_deg: 70.0,
            rule: CrackRule::Straight,
        })
    }
}

/// Pulses of the two mesh periods in which the cracked tooth works, from one entry to the other side of its exit.
///
/// # Errors
/// What stops the simulation.
pub fn crack_study(machine: &Machine, shaft_hz: f64) -> Result<Vec<CrackStudy>> {
    from_geometry(machine)?;
    let torque = study_torque(machine)?;
    let depths = match machine.crack {
        Some(crack) => vec![crack.depth_m],
        None => [0.25, 0.5, 0.75, 1.0].map(|share| share * machine.pair.module_m).to_vec(),
    };
    let mut studies = Vec::new();
    for depth_m in depths {
        let cracked = changed(machine, |m| m.crack = Some(crack_of(machine, depth_m)))?;
        let bench = Bench::new(&cracked)?;
        let (healthy, faulty) = (bench.healthy(shaft_hz, torque)?, bench.cracked(shaft_hz, torque)?);
        let timed = |response: &Periodic, number: i64, event: Event| {
            response.edge(number, event).as_ref().map(bandwidth_hz).ok_or_else(|| {
                Error::impossible("crack study", format!("pulse of pair {number} cannot be timed at {shaft_hz} Hz"))
            })
        };
        let healthy_hz = [timed(&healthy, 0, Event::Exit)?, timed(&healthy, 0, Event::Entry)?];
        let mut pulses = Vec::new();
        for (event, name, numbers) in [(Event::Exit, "peak", [-1, 0, 1]), (Event::Entry, "trough", [0, 1, 2])] {
            for number in numbers {
                let bandwidth_hz = timed(&faulty, number, event)?;
                let reference = healthy_hz[usize::from(event == Event::Entry)];
                let verb = if event == Event::Exit { "leaves" } else { "enters" };
                let pair = if number == 0 { "the cracked pair".into() } else { format!("pair {number:+}") };
                let label = format!("{name}: {pair} {verb}");
                pulses.push(CrackPulse { label, bandwidth_hz, deviation: bandwidth_hz / reference - 1.0 });
            }
        }
        let curve = cracked.cracked_pair()?.expect("just declared").curve;
        let middle = 0.5 * (bench.ramps().entry[1] + bench.ramps().exit[0]);
        let stiffness_loss = 1.0 - curve.value(middle) / cracked.pair_stiffness()?.value(middle);
        studies.push(CrackStudy { depth_m, stiffness_loss, healthy_hz, pulses });
    }
    Ok(studies)
}
