//! Effects seated at one order of the pinion or at one fixed frequency: the response to every sinusoid that an effect
//! of the registry names as its seat, under that effect's name where it earns it.

use super::{Excitation, Responses};
use crate::base_fit::RunState;
use crate::candidate::{Candidate, Claim, Parameter, Template, Tuning, quadrature};
use crate::detect::Found;
use crate::effects::hypotheses;
use crate::effects::hypothesis::{Hypothesis, Path, Seat, Site, Wave, is_whole};
use crate::least_squares::Data;
use crate::machine::{Freedom, Hunting};
use crate::model::forward::Line;
use crate::model::harmonic_balance::{Comb, DOF, LOAD, MOTOR, Machine, PINION_Y};
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;
use std::sync::OnceLock;

/// Every sinusoid that an effect of the registry has as its seat, in the registry's order.
fn waves() -> &'static [Wave] {
    static WAVES: OnceLock<Vec<Wave>> = OnceLock::new();
    WAVES.get_or_init(|| {
        let mut all = Vec::new();
        for seat in hypotheses().flat_map(|h| h.seats) {
            if let Seat::Wave(wave) = *seat
                && !all.contains(&wave)
            {
                all.push(wave);
            }
        }
        all
    })
}

/// The effect that a sinusoid is at an order of the pinion or a fixed frequency (none), and whether it earns its name
/// there.
fn effect_of(wave: Wave, order: Option<f64>, ratio: f64) -> (&'static Hypothesis, bool) {
    let own = |h: &&Hypothesis| h.seats.iter().any(|seat| matches!(seat, Seat::Wave(w) if *w == wave));
    let named = hypotheses().filter(own).find(|h| h.at.holds(order, ratio));
    let any = || hypotheses().find(own).expect("every sinusoid is some effect's");
    named.map_or_else(|| (any(), false), |h| (h, true))
}

/// Whether a sinusoid is worth a trial: of an effect's forces that only the power of torque tells apart, the first
/// alone where the runs' torques cannot.
fn is_told_apart(bench: &Responses<'_>, wave: Wave, order: Option<f64>) -> bool {
    let Wave::Force { at, speed, .. } = wave else { return true };
    let effect = |wave| effect_of(wave, order, bench.ratio()).0.name;
    let same = |other: &&Wave| {
        matches!(**other, Wave::Force { at: a, speed: s, .. } if a == at && s == speed)
            && effect(**other) == effect(wave)
    };
    bench.torques_differ() || waves().iter().find(same) == Some(&wave)
}

fn excite(wave: Wave, machine: &Machine, run: &RunState, comb: &Comb, order: f64) -> Excitation {
    let size = comb.orders.len();
    let centre = comb.centre as i64;
    let omega = TAU * run.angle.shaft_hz * order;
    match wave {
        Wave::Displacement => {
            let rate = -C::new(1.0, omega * machine.tau_s);
            (Vec::new(), (0..size).map(|n| machine.stiffness(n as i64 - centre) * rate).collect())
        }
        Wave::Force { at, speed, torque } => {
            let dof = dof(at);
            let mut forces = vec![[C::ZERO; DOF]; size];
            let mean = if dof == LOAD {
                run.torque_n_m * f64::from(machine.teeth[1]) / f64::from(machine.teeth[0])
            } else {
                run.torque_n_m
            };
            forces[comb.centre][dof] = C::new(omega.powi(speed) * mean.powi(torque), 0.0);
            (forces, Vec::new())
        }
        Wave::BearingStiffness(side) => {
            let k = machine.shafts.bearing_stiffness_n_per_m[side];
            let forces = (0..size)
                .map(|n| {
                    let mut f = [C::ZERO; DOF];
                    f[PINION_Y + side] = run.inner.translation[n][side] * -k;
                    f
                })
                .collect();
            (forces, Vec::new())
        }
        Wave::MeshStiffness => (Vec::new(), run.inner.force.clone()),
        Wave::Position => (Vec::new(), rolled(machine, run, size as i64)),
        Wave::RollingDisplacement => {
            let base_pitch = TAU * machine.base_radius_m[0] / f64::from(machine.teeth[0]);
            let (_, mut contact) = excite(Wave::Displacement, machine, run, comb, order);
            for (g, roll) in contact.iter_mut().zip(rolled(machine, run, size as i64)) {
                *g += roll / base_pitch;
            }
            (Vec::new(), contact)
        }
    }
}

fn dof(site: Site) -> usize {
    match site {
        Site::Motor => MOTOR,
        Site::Load => LOAD,
        Site::Along(body) => PINION_Y + body,
    }
}

/// Contact force per base pitch of shift of all contacts.
fn rolled(machine: &Machine, run: &RunState, size: i64) -> Vec<C> {
    (0..size)
        .map(|n| {
            (0..size)
                .map(|l| machine.stiffness(n - l) * C::new(0.0, TAU * (n - l) as f64) * run.inner.approach[l as usize])
                .sum()
        })
        .collect()
}

struct Label {
    name: String,
    plain: String,
    claim: Claim,
    family: &'static str,
    shaft: &'static str,
    quantity: &'static str,
    unit: &'static str,
}

/// Words for a sinusoid at `order` of the pinion, or at a fixed frequency (none).
fn label(wave: Wave, order: Option<f64>, ratio: f64) -> Label {
    let of = |per_turn: f64| order.is_some_and(|o| is_whole(o / per_turn));
    let (pinion, gear) = (of(1.0), of(ratio));
    let (hypothesis, named) = effect_of(wave, order, ratio);
    let shaft = match wave {
        Wave::BearingStiffness(body) if named => ["pinion", "gear"][body],
        _ if pinion => "pinion",
        _ if gear => "gear",
        _ => "none",
    };
    let family = match order {
        None => "fixed-frequency",
        Some(_) if pinion || gear => "shaft-order",
        Some(_) => "non-integer-order",
    };
    let plain =
        format!("{} at {}", described(wave), if order.is_none() { "a fixed frequency" } else { "a fixed order" });
    let plain = match wave {
        Wave::Force { speed, torque, .. } => format!("{plain}, speed exponent {speed}, torque exponent {torque}"),
        _ => plain,
    };
    let (name, claim) = if named { (hypothesis.name.into(), Claim::Named) } else { (plain.clone(), Claim::Generic) };
    let (quantity, unit) = match wave {
        Wave::Force { .. } if !named => ("amplitude", "SI"),
        _ => (hypothesis.quantity, hypothesis.unit),
    };
    Label { name, plain, claim, family, shaft, quantity, unit }
}

/// What varies.
fn described(wave: Wave) -> String {
    let text = match wave {
        Wave::Displacement | Wave::RollingDisplacement => "displacement error",
        Wave::BearingStiffness(body) => {
            return format!("bearing stiffness of the {} varying", ["pinion", "gear"][body]);
        }
        Wave::MeshStiffness => "mesh stiffness varying",
        Wave::Position => "contact position varying",
        Wave::Force { at: Site::Along(0), .. } => "radial force on the pinion",
        Wave::Force { at: Site::Along(_), .. } => "radial force on the gear",
        Wave::Force { at: Site::Motor, .. } => "torque on the motor",
        Wave::Force { at: Site::Load, .. } => "torque on the load",
    };
    text.into()
}

fn exponents(wave: Wave) -> [f64; 2] {
    match wave {
        Wave::Displacement | Wave::RollingDisplacement => [0.0, 0.0],
        Wave::Force { speed, torque, .. } => [f64::from(speed), f64::from(torque)],
        _ => [0.0, 1.0],
    }
}

/// Every excitation seated at `order` of the pinion.
pub fn at_order(bench: &Responses<'_>, order: f64, searched: f64) -> Vec<Candidate> {
    seated(bench, 0..waves().len(), order, searched)
}

/// A candidate of [`Tuning::Order`] at another order.
pub fn moved(bench: &Responses<'_>, candidate: &Candidate, seat: usize, order: f64) -> Candidate {
    let mut all = seated(bench, seat..seat + 1, order, candidate.searched);
    Candidate { name: candidate.name.clone(), claim: candidate.claim, scanned: candidate.scanned, ..all.remove(0) }
}

/// The first-order response of this machine to the same sinusoid as that of `candidate`, with its runs started
/// likewise; none where it is no sinusoid at an order.
pub fn on(machine: &Responses<'_>, candidate: &Candidate) -> Option<Candidate> {
    let (Some(Seat::Wave(wave)), Some(order)) = (candidate.seat, candidate.order) else { return None };
    let seat = waves().iter().position(|w| *w == wave)?;
    let same = seated(machine, seat..seat + 1, order, candidate.searched).pop()?;
    Some(same.started(candidate.start.clone()))
}

fn seated(bench: &Responses<'_>, seats: std::ops::Range<usize>, order: f64, searched: f64) -> Vec<Candidate> {
    let machine = &bench.base.machine;
    let (seats, list): (Vec<usize>, Vec<Wave>) =
        seats.map(|seat| (seat, waves()[seat])).filter(|(_, wave)| is_told_apart(bench, *wave, Some(order))).unzip();
    let responses = bench
        .respond(|_| order, |run, comb| list.iter().map(|&wave| excite(wave, machine, run, comb, order)).collect());
    let free = Hunting::of(machine.teeth).freedom(&[order]) == Freedom::Phase;
    seats
        .into_iter()
        .zip(list)
        .zip(&responses)
        .map(|((index, wave), lines)| {
            let l = label(wave, Some(order), bench.ratio());
            Candidate {
                name: l.name,
                plain: Some(l.plain),
                claim: l.claim,
                family: l.family,
                shaft: l.shaft,
                order: Some(order),
                parameters: vec![Parameter { name: l.quantity.into(), unit: l.unit, first: 0, complex: true }],
                templates: quadrature(&bench.base.analyser, &bench.angles, lines).to_vec(),
                searched,
                exponents: exponents(wave),
                hypothesis: Some(effect_of(wave, Some(order), bench.ratio()).0),
                seat: Some(Seat::Wave(wave)),
                pair_orders: vec![order],
                tuning: free.then_some(Tuning::Order { seat: index }),
                ..Candidate::default()
            }
        })
        .collect()
}

/// Every excitation at a fixed frequency, phase free in every run: forces on the machine, and a tone added by the
/// acquisition.
pub fn at_frequency(bench: &Responses<'_>, data: &Data, fit: &[usize], found: Found) -> Vec<Candidate> {
    let base = bench.base;
    let machine = &base.machine;
    let hz = if found.modulation { found.at } else { refine(bench, data, fit, found.at) };
    let hz = line_frequency(hz, base.analyser.duration_s()).unwrap_or(hz);
    let waves: Vec<Wave> = waves()
        .iter()
        .copied()
        .filter(|w| matches!(w, Wave::Force { speed: 0, .. } | Wave::MeshStiffness | Wave::Position))
        .filter(|w| is_told_apart(bench, *w, None))
        .collect();
    let mut responses = bench.respond(
        |run| hz / run.angle.shaft_hz,
        |run, comb| waves.iter().map(|&w| excite(w, machine, run, comb, hz / run.angle.shaft_hz)).collect(),
    );
    // The offset angle only turns the free phase; templates are built with the run's own angle all the same.
    let mains = line_frequency(hz, base.analyser.duration_s()).is_some();
    let of = |&w: &Wave| (label(w, None, bench.ratio()), exponents(w), Some(Seat::Wave(w)));
    let mut labels: Vec<(Label, [f64; 2], Option<Seat>)> = waves.iter().map(of).collect();
    let ratio = channel_pattern(bench, data, fit, hz);
    responses.push(tone_lines(bench, hz, ratio));
    labels.push((tone_label(mains), [0.0, 0.0], None));
    labels.into_iter().zip(&responses).map(|(labelled, lines)| free_in_every_run(bench, hz, labelled, lines)).collect()
}

/// A tone at a multiple of the line frequency with these complex amplitudes in the channels, phase free in every run.
pub fn line_tone(bench: &Responses<'_>, hz: f64, amplitude: [C; 2]) -> Candidate {
    free_in_every_run(bench, hz, (tone_label(true), [0.0, 0.0], None), &tone_lines(bench, hz, amplitude))
}

fn tone_lines(bench: &Responses<'_>, hz: f64, amplitude: [C; 2]) -> Vec<Vec<Line>> {
    bench.base.runs.iter().map(|run| vec![Line { order: hz / run.angle.shaft_hz, amplitude }]).collect()
}

/// Words for a tone added by the acquisition; `mains`: at a multiple of the line frequency.
fn tone_label(mains: bool) -> Label {
    let line_tone = super::on_path(Path::LineTone);
    let (name, claim) = if mains { (line_tone.name, Claim::Named) } else { (line_tone.plain, Claim::Generic) };
    Label {
        name: name.into(),
        plain: line_tone.plain.into(),
        claim,
        family: "fixed-frequency",
        shaft: "none",
        quantity: line_tone.quantity,
        unit: line_tone.unit,
    }
}

/// The candidate of lines at a fixed frequency.
fn free_in_every_run(
    bench: &Responses<'_>,
    hz: f64,
    (l, exponents, seat): (Label, [f64; 2], Option<Seat>),
    lines: &[Vec<Line>],
) -> Candidate {
    let pair = quadrature(&bench.base.analyser, &bench.angles, lines);
    let runs = 0..bench.base.runs.len();
    Candidate {
        name: l.name,
        plain: Some(l.plain),
        claim: l.claim,
        family: l.family,
        shaft: l.shaft,
        frequency_hz: Some(hz),
        parameters: vec![Parameter { name: l.quantity.into(), unit: l.unit, first: 0, complex: true }],
        templates: runs.flat_map(|r| pair.each_ref().map(|t: &Template| t.only(r))).collect(),
        searched: 2000.0,
        exponents,
        seat,
        phase_free: true,
        ..Candidate::default()
    }
}

/// The multiple of the line frequency that `hz` cannot be told from over a run.
fn line_frequency(hz: f64, duration_s: f64) -> Option<f64> {
    let within = (0.15 / duration_s).max(0.1);
    [50.0, 60.0].iter().find_map(|m| {
        let n = (hz / m).round();
        ((1.0..=12.0).contains(&n) && (hz - n * m).abs() < within).then_some(n * m)
    })
}

/// Frequency of the largest summed line power within one and a half bins of `hz`.
fn refine(bench: &Responses<'_>, data: &Data, fit: &[usize], hz: f64) -> f64 {
    let power = |f: f64| -> f64 {
        fit.iter()
            .flat_map(|&r| [0, 1].map(|c| (r, c)))
            .map(|(r, c)| bench.base.analyser.amplitude(&data.residual[r][c], f).0.norm_sqr())
            .sum()
    };
    let step = 0.01 / bench.base.analyser.duration_s();
    (-150..=150).map(|i| hz + f64::from(i) * step).max_by(|a, b| power(*a).total_cmp(&power(*b))).unwrap_or(hz)
}

/// Complex amplitude ratio of the channels of a tone, from all fit runs, the larger channel taken as 1.
fn channel_pattern(bench: &Responses<'_>, data: &Data, fit: &[usize], hz: f64) -> [C; 2] {
    let (mut first, mut second, mut cross) = (0.0, 0.0, C::ZERO);
    for &r in fit {
        let a = [0, 1].map(|c| bench.base.analyser.amplitude(&data.residual[r][c], hz).0);
        first += a[0].norm_sqr();
        second += a[1].norm_sqr();
        cross += a[1] * a[0].conj();
    }
    let total = first.max(second).sqrt().max(1e-30);
    let turn = if cross.norm() > 0.0 { cross / cross.norm() } else { C::ONE };
    [C::new(first.sqrt() / total, 0.0), turn * (second.sqrt() / total)]
}
