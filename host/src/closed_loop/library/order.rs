//! Effects seated at one order of the pinion or at one fixed frequency: eccentricity, imbalance, ghost order, torque ripple, load
//! fluctuation, misalignment, bearing and mesh stiffness modulation, speed fluctuation, tones.

use super::{Bench, Excitation};
use crate::closed_loop::base_fit::RunState;
use crate::closed_loop::candidate::{Candidate, Claim, Finite, Parameter, Template, Tuning, quadrature};
use crate::closed_loop::detect::Found;
use crate::closed_loop::least_squares::Data;
use crate::machine::{Freedom, Hunting};
use crate::model::harmonic_balance::{Comb, DOF, GEAR_Y, LOAD, Line, MOTOR, Machine, PINION_Y};
use rustfft::num_complex::Complex64 as C;
use std::f64::consts::TAU;

#[derive(Clone, Copy, PartialEq)]
enum Seat {
    Displacement,
    /// Displacement that also rolls the contact along its path by as much.
    RollingDisplacement,
    /// Force or torque with exponents of speed and torque.
    Force {
        dof: usize,
        speed: i32,
        torque: i32,
    },
    BearingModulation(usize),
    MeshModulation,
    PositionModulation,
}

const SEATS: [Seat; 16] = [
    Seat::Displacement,
    Seat::Force { dof: PINION_Y, speed: 2, torque: 0 },
    Seat::Force { dof: GEAR_Y, speed: 2, torque: 0 },
    Seat::Force { dof: PINION_Y, speed: 0, torque: 0 },
    Seat::Force { dof: GEAR_Y, speed: 0, torque: 0 },
    Seat::Force { dof: PINION_Y, speed: 0, torque: 1 },
    Seat::Force { dof: GEAR_Y, speed: 0, torque: 1 },
    Seat::Force { dof: MOTOR, speed: 0, torque: 0 },
    Seat::Force { dof: MOTOR, speed: 0, torque: 1 },
    Seat::Force { dof: LOAD, speed: 0, torque: 0 },
    Seat::Force { dof: LOAD, speed: 0, torque: 1 },
    Seat::BearingModulation(0),
    Seat::BearingModulation(1),
    Seat::MeshModulation,
    Seat::PositionModulation,
    Seat::RollingDisplacement,
];

fn excite(seat: Seat, machine: &Machine, run: &RunState, comb: &Comb, order: f64) -> Excitation {
    let size = comb.orders.len();
    let centre = comb.centre as i64;
    let omega = TAU * run.angle.shaft_hz * order;
    match seat {
        Seat::Displacement => {
            let rate = -C::new(1.0, omega * machine.tau_s);
            (Vec::new(), (0..size).map(|n| machine.stiffness(n as i64 - centre) * rate).collect())
        }
        Seat::Force { dof, speed, torque } => {
            let mut forces = vec![[C::ZERO; DOF]; size];
            let mean = if dof == LOAD {
                run.torque_n_m * f64::from(machine.teeth[1]) / f64::from(machine.teeth[0])
            } else {
                run.torque_n_m
            };
            forces[comb.centre][dof] = C::new(omega.powi(speed) * mean.powi(torque), 0.0);
            (forces, Vec::new())
        }
        Seat::BearingModulation(side) => {
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
        Seat::MeshModulation => (Vec::new(), run.inner.force.clone()),
        Seat::PositionModulation => (Vec::new(), rolled(machine, run, size as i64)),
        Seat::RollingDisplacement => {
            let base_pitch = TAU * machine.base_radius_m[0] / f64::from(machine.teeth[0]);
            let (_, mut contact) = excite(Seat::Displacement, machine, run, comb, order);
            for (g, roll) in contact.iter_mut().zip(rolled(machine, run, size as i64)) {
                *g += roll / base_pitch;
            }
            (Vec::new(), contact)
        }
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

fn whole(x: f64) -> bool {
    x > 0.5 && (x - x.round()).abs() < 0.01
}

fn label(seat: Seat, order: f64, ratio: f64, fixed: bool) -> Label {
    let (pinion, gear) = (whole(order) && !fixed, whole(order / ratio) && !fixed);
    let is = |o: f64, k: f64| !fixed && (o - k).abs() < 0.01;
    let shaft = if fixed {
        "none"
    } else if pinion {
        "pinion"
    } else if gear {
        "gear"
    } else {
        "none"
    };
    let family = if fixed {
        "fixed-frequency"
    } else if pinion || gear {
        "shaft-order"
    } else {
        "non-integer-order"
    };
    let where_to = if fixed { "a fixed frequency" } else { "a fixed order" };
    let text = match seat {
        Seat::Displacement | Seat::RollingDisplacement => format!("displacement error at {where_to}"),
        Seat::BearingModulation(side) => {
            format!("bearing stiffness of the {} varying at {where_to}", ["pinion", "gear"][side])
        }
        Seat::MeshModulation => format!("mesh stiffness varying at {where_to}"),
        Seat::PositionModulation => format!("contact position varying at {where_to}"),
        Seat::Force { dof, speed, torque } => {
            let body = match dof {
                PINION_Y => "radial force on the pinion",
                GEAR_Y => "radial force on the gear",
                MOTOR => "torque on the motor",
                _ => "torque on the load",
            };
            format!("{body} at {where_to}, speed exponent {speed}, torque exponent {torque}")
        }
    };
    let named = |name: &str, quantity, unit| {
        let (name, plain) = (name.into(), text.clone());
        Label { name, plain, claim: Claim::Named, family, shaft, quantity, unit }
    };
    let plain = |quantity, unit| {
        let (name, plain) = (text.clone(), text.clone());
        Label { name, plain, claim: Claim::Generic, family, shaft, quantity, unit }
    };
    match seat {
        Seat::Displacement | Seat::RollingDisplacement if is(order, 1.0) => {
            named("pinion-eccentricity", "amplitude", "m")
        }
        Seat::Displacement | Seat::RollingDisplacement if is(order, ratio) => {
            named("gear-eccentricity", "amplitude", "m")
        }
        Seat::Displacement if (pinion || gear) && order > 3.5 => named("ghost-order", "amplitude", "m"),
        Seat::Displacement | Seat::RollingDisplacement => plain("amplitude", "m"),
        Seat::Force { dof: PINION_Y, speed: 2, .. } if is(order, 1.0) => named("pinion-imbalance", "unbalance", "kg m"),
        Seat::Force { dof: GEAR_Y, speed: 2, .. } if is(order, ratio) => named("gear-imbalance", "unbalance", "kg m"),
        Seat::Force { dof: PINION_Y, speed: 0, .. } if is(order, 2.0) => {
            named("coupling-misalignment", "radial_force", "N")
        }
        Seat::Force { dof: GEAR_Y, speed: 0, .. } if is(order, 2.0 * ratio) => {
            named("coupling-misalignment", "radial_force", "N")
        }
        Seat::Force { dof: MOTOR, speed: 0, torque: 1 } => named("torque-ripple", "share_of_torque", "1"),
        Seat::Force { dof: MOTOR, speed: 0, torque: 0 } => named("torque-ripple", "torque", "N m"),
        Seat::Force { dof: LOAD, speed: 0, torque: 1 } => named("load-fluctuation", "share_of_torque", "1"),
        Seat::Force { dof: LOAD, speed: 0, torque: 0 } => named("load-fluctuation", "torque", "N m"),
        Seat::BearingModulation(side) if family == "non-integer-order" => Label {
            shaft: ["pinion", "gear"][side],
            ..named("bearing-stiffness-modulation", "share_of_stiffness", "1")
        },
        Seat::BearingModulation(_) => plain("share_of_stiffness", "1"),
        Seat::MeshModulation => plain("share_of_stiffness", "1"),
        // At a whole order of a shaft the contact is carried by that shaft's geometry, not by its speed.
        Seat::PositionModulation if pinion || gear => plain("contact_position", "base pitch"),
        Seat::PositionModulation => named("speed-fluctuation", "contact_position", "base pitch"),
        Seat::Force { .. } => plain("amplitude", "SI"),
    }
}

fn exponents(seat: Seat) -> [f64; 2] {
    match seat {
        Seat::Displacement | Seat::RollingDisplacement => [0.0, 0.0],
        Seat::Force { speed, torque, .. } => [f64::from(speed), f64::from(torque)],
        _ => [0.0, 1.0],
    }
}

fn finite(seat: Seat, order: f64) -> Option<Finite> {
    match seat {
        Seat::RollingDisplacement => Some(Finite::RollingDisplacement { order }),
        Seat::PositionModulation => Some(Finite::PositionModulation { order }),
        Seat::BearingModulation(shaft) => Some(Finite::BearingModulation { shaft, order }),
        Seat::MeshModulation => Some(Finite::MeshModulation { order }),
        _ => None,
    }
}

/// Every excitation seated at `order` of the pinion.
pub fn at_order(bench: &Bench<'_>, order: f64, searched: f64) -> Vec<Candidate> {
    seated(bench, 0..SEATS.len(), order, searched)
}

/// A candidate of [`Tuning::Order`] at another order.
pub fn moved(bench: &Bench<'_>, candidate: &Candidate, seat: usize, order: f64) -> Candidate {
    let mut all = seated(bench, seat..seat + 1, order, candidate.searched);
    Candidate { name: candidate.name.clone(), claim: candidate.claim, scanned: candidate.scanned, ..all.remove(0) }
}

fn seated(bench: &Bench<'_>, seats: std::ops::Range<usize>, order: f64, searched: f64) -> Vec<Candidate> {
    let machine = &bench.base.machine;
    let list = &SEATS[seats.clone()];
    let responses = bench
        .respond(|_| order, |run, comb| list.iter().map(|&seat| excite(seat, machine, run, comb, order)).collect());
    let free = Hunting::of(machine.teeth).freedom(&[order]) == Freedom::Phase;
    seats
        .zip(list)
        .zip(&responses)
        .map(|((index, &seat), lines)| {
            let l = label(seat, order, bench.ratio(), false);
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
                exponents: exponents(seat),
                finite: finite(seat, order),
                pair_orders: vec![order],
                tuning: free.then_some(Tuning::Order { seat: index }),
                ..Candidate::default()
            }
        })
        .collect()
}

/// Every excitation at a fixed frequency, phase free in every run: forces on the machine, and a tone added by the acquisition.
pub fn at_frequency(bench: &Bench<'_>, data: &Data, fit: &[usize], found: Found) -> Vec<Candidate> {
    let base = bench.base;
    let machine = &base.machine;
    let hz = if found.modulation { found.at } else { refine(bench, data, fit, found.at) };
    let hz = line_frequency(hz, base.analyser.duration_s()).unwrap_or(hz);
    let seats: Vec<Seat> = SEATS
        .iter()
        .copied()
        .filter(|s| matches!(s, Seat::Force { speed: 0, .. } | Seat::MeshModulation | Seat::PositionModulation))
        .collect();
    let mut responses = bench.respond(
        |run| hz / run.angle.shaft_hz,
        |run, comb| seats.iter().map(|&s| excite(s, machine, run, comb, hz / run.angle.shaft_hz)).collect(),
    );
    // The offset angle only turns the free phase; templates are built with the run's own angle all the same.
    let mains = line_frequency(hz, base.analyser.duration_s()).is_some();
    let mut labels: Vec<(Label, [f64; 2])> = seats
        .iter()
        .map(|&s| {
            let mut l = label(s, 0.3, bench.ratio(), true);
            l.claim = if matches!(s, Seat::Force { dof: MOTOR | LOAD, .. } | Seat::PositionModulation) {
                l.claim
            } else {
                Claim::Generic
            };
            (l, exponents(s))
        })
        .collect();
    let ratio = channel_pattern(bench, data, fit, hz);
    responses
        .push(base.runs.iter().map(|run| vec![Line { order: hz / run.angle.shaft_hz, amplitude: ratio }]).collect());
    let (name, claim) =
        if mains { ("mains-hum", Claim::Named) } else { ("additive tone at a fixed frequency", Claim::Generic) };
    let tone = Label {
        name: name.into(),
        plain: "additive tone at a fixed frequency".into(),
        claim,
        family: "fixed-frequency",
        shaft: "none",
        quantity: "acceleration_of_the_larger_channel",
        unit: "m/s2",
    };
    labels.push((tone, [0.0, 0.0]));
    labels
        .into_iter()
        .zip(&responses)
        .map(|((l, exponents), lines)| {
            let pair = quadrature(&base.analyser, &bench.angles, lines);
            Candidate {
                name: l.name,
                plain: Some(l.plain),
                claim: l.claim,
                family: l.family,
                shaft: l.shaft,
                frequency_hz: Some(hz),
                parameters: vec![Parameter { name: l.quantity.into(), unit: l.unit, first: 0, complex: true }],
                templates: (0..base.runs.len()).flat_map(|r| pair.each_ref().map(|t: &Template| t.only(r))).collect(),
                searched: 2000.0,
                exponents,
                phase_free: true,
                ..Candidate::default()
            }
        })
        .collect()
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
fn refine(bench: &Bench<'_>, data: &Data, fit: &[usize], hz: f64) -> f64 {
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
fn channel_pattern(bench: &Bench<'_>, data: &Data, fit: &[usize], hz: f64) -> [C; 2] {
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
