//! A planetary set: sun, ring and carrier with three coordinates each, and as many for every planet.
//!
//! Model of Lin and Parker (J. Vib. Acoust. 121, 1999, doi 10.1115/1.2893982) in the frame of the carrier, in which the
//! directions of all meshes stand still; gyroscopic and centripetal terms are left out, so supports act alike in all
//! directions. Each planet hangs on the carrier by its pin. Mesh phases follow from teeth and places of the planets
//! (Parker and Lin, J. Vib. Acoust. 126, 2004): with the sun turning counter-clockwise against the carrier a planet at
//! `psi` meets the sun `zs psi / 2 pi` pairs late and the ring `zr psi / 2 pi` early; between a planet's two meshes lie
//! `(zp - 1) / 2` pairs from pitch point to pitch point, because opposite flanks of its teeth are loaded; a profile
//! shift changes the tooth's thickness and with it this constant.

use crate::assembly::{MeshLine, Part};
use crate::builder::{Builder, Damper, Line, place};
use crate::machine::{Set, Toothing};
use crate::stiffness::{Form, Gears, MeshStiffness};
use crate::{Error, Result};
use meshband_mechanics::machine::involute;
use meshband_train::declaration::{Member, Stage};
use meshband_train::phasing::can_be_assembled;
use meshband_train::{Fraction, Role};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Circle on which the planets' centres go round.
///
/// Where `zr = zs + 2 zp` it is that of the reference circles. Other sets are profile-shifted: the circle lies halfway
/// between what either mesh would have, sun and planet share the shift of theirs, the ring takes that of its own.
struct Circle {
    radius_m: f64,
    /// Working pressure angles of sun and planet, and of planet and ring, rad.
    pressure_angles: [f64; 2],
    /// Profile shift of sun and planet, and of the ring, transverse modules.
    shifts: [f64; 2],
    /// Thickness of a planet's tooth, half of it on either working circle, in pitches.
    tooth_pitches: f64,
}

impl Circle {
    fn of(toothing: &Toothing, teeth: [u32; 3]) -> Self {
        let alpha = toothing.transverse_pressure_angle();
        let [sun, planet, ring] = teeth.map(f64::from);
        let (outside, inside) = (sun + planet, ring - planet);
        let middle = 0.5 * (outside + inside);
        if outside == inside {
            let radius_m = toothing.radius_m(teeth[0] + teeth[1]);
            return Self { radius_m, pressure_angles: [alpha; 2], shifts: [0.0; 2], tooth_pitches: 0.5 };
        }
        let pressure_angles = [outside, inside].map(|teeth| (teeth / middle * alpha.cos()).acos());
        let excess = pressure_angles.map(|working| involute(working) - involute(alpha));
        let own = 0.25 * excess[0] * outside / alpha.tan();
        let half = |excess: f64| (FRAC_PI_2 + 2.0 * own * alpha.tan()) / planet - excess;
        Self {
            radius_m: 0.5 * toothing.transverse_module_m() * middle,
            pressure_angles,
            shifts: [own, own + 0.5 * excess[1] * inside / alpha.tan()],
            tooth_pitches: (half(excess[0]) + half(excess[1])) * planet / (2.0 * PI),
        }
    }
}

/// Working pressure angles of a set that can be cut, degrees.
const WORKING_ANGLES_DEG: std::ops::RangeInclusive<f64> = 10.0..=35.0;

/// A set's declaration with what follows from it.
struct Plan<'m> {
    stage: usize,
    toothing: &'m Toothing,
    set: Set,
    teeth: [u32; 3],
    circle: Circle,
    gears: [usize; 3],
    fixed: Member,
    /// Places of the planets, turns of the carrier.
    places: Vec<f64>,
    order: f64,
    carrier_turns: f64,
    /// Way of the sun's torque, counter-clockwise positive.
    sun_torque: f64,
    /// Way in which the sun turns against the carrier.
    sun_way: f64,
}

/// Adds the set of a stage.
pub(crate) fn add_set(builder: &mut Builder, stage: usize) -> Result<()> {
    let Some(plan) = Plan::of(builder, stage) else { return Ok(()) };
    plan.check(builder)?;
    let [sun, ring, carrier] = plan.add_members(builder);
    let curves = plan.curves()?.map(|curve| builder.add_stiffness(curve));
    for (number, &turns) in plan.places.iter().enumerate() {
        let planet = plan.add_planet(builder, carrier, number, turns);
        plan.add_meshes(builder, curves, [sun, planet, ring], (number, turns));
    }
    Ok(())
}

impl<'m> Plan<'m> {
    fn of(builder: &Builder<'m>, stage: usize) -> Option<Self> {
        let machine = builder.machine;
        let train = &machine.train;
        let Stage::Planetary { sun, planet, ring, planets, fixed, input, .. } = &train.declaration.stages[stage] else {
            return None;
        };
        let mesh = train.mesh(stage)?;
        let carrier = mesh.carrier.as_ref()?;
        let gear = |role: Role| mesh.gears.iter().copied().find(|&gear| train.gears[gear].role == role);
        let gears = [gear(Role::Sun)?, gear(Role::Planet)?, gear(Role::Ring)?];
        let speeds = |gear: usize| train.gears[gear].speed;
        // Power enters at the driven member, whose torque turns with it; a ring's turns as the sun's, a carrier's not.
        let sun_torque = match input {
            Member::Sun => speeds(gears[0]).sign(),
            Member::Ring => speeds(gears[2]).sign(),
            Member::Carrier => -carrier.speed.sign(),
        };
        let even = |number: u32| f64::from(number) / f64::from(*planets);
        Some(Self {
            stage,
            toothing: &machine.toothings[stage],
            set: machine.sets[stage]?,
            teeth: [*sun, *planet, *ring],
            circle: Circle::of(&machine.toothings[stage], [*sun, *planet, *ring]),
            gears,
            fixed: *fixed,
            places: carrier.spacing.clone().unwrap_or_else(|| (0..*planets).map(even).collect()),
            order: mesh.order.value(),
            carrier_turns: carrier.speed.value(),
            sun_torque: sun_torque as f64,
            sun_way: train.gears[gears[0]].rate.sign() as f64,
        })
    }

    /// Whether the planets can be put in.
    fn check(&self, builder: &Builder) -> Result<()> {
        let refuse = |key: &str, what: String| Err(Error::invalid(format!("[[stage]] {} {key}", self.stage + 1), what));
        let mesh = builder.machine.train.mesh(self.stage);
        let carrier = mesh.and_then(|mesh| mesh.carrier.as_ref());
        let [sun, planet, ring] = self.teeth;
        if carrier.is_some_and(|carrier| !can_be_assembled(sun, carrier)) {
            let what = format!("{sun} + {ring} teeth leave no room for planets at these places");
            return refuse("planets", what);
        }
        let angles = self.circle.pressure_angles.map(f64::to_degrees);
        if let Some(angle) = angles.iter().find(|angle| !WORKING_ANGLES_DEG.contains(*angle)) {
            let what =
                format!("{ring} teeth about {sun} + 2 x {planet} need a working pressure angle of {angle:.1} degrees");
            return refuse("ring", what);
        }
        Ok(())
    }

    /// Whether the sun drives the planets against the carrier, and they the ring.
    fn sun_drives(&self) -> bool {
        self.sun_torque == self.sun_way
    }

    /// Sun, ring and carrier with their supports; the fixed one is kept from turning.
    fn add_members(&self, builder: &mut Builder) -> [usize; 3] {
        let machine = builder.machine;
        let frame = self.carrier_turns;
        let gear = |index: usize| &machine.train.gears[index];
        let carrier_shaft = self.carrier_shaft(builder);
        let value = |speed: Fraction| speed.value();
        let all = [
            (Member::Sun, Part::Gear(self.gears[0]), gear(self.gears[0]).shaft, value(gear(self.gears[0]).speed)),
            (Member::Ring, Part::Gear(self.gears[2]), gear(self.gears[2]).shaft, value(gear(self.gears[2]).speed)),
            (Member::Carrier, Part::Carrier(self.stage), carrier_shaft, frame),
        ];
        let mut index = 0;
        all.map(|(member, part, shaft, turns)| {
            let inertia = match part {
                Part::Gear(gear) => machine.gears[gear],
                _ => self.set.carrier,
            };
            let body = builder.add_body(part, shaft, inertia, [turns, frame]);
            builder.support(body, [self.set.support_n_per_m[index]; 2], Damper::Ratio(self.set.damping_ratio));
            if member == self.fixed {
                let stiffness = self.set.fixed_torsion_n_m_per_rad;
                let damping = 2.0 * self.set.damping_ratio * (stiffness * inertia.inertia_kg_m2).sqrt();
                let at = builder.at(body);
                builder.add_spring(vec![(at, 1.0)], stiffness, damping);
            }
            index += 1;
            body
        })
    }

    /// The shaft that turns with the carrier: the driving or driven one that has no gear of this set.
    fn carrier_shaft(&self, builder: &Builder) -> Option<usize> {
        let train = &builder.machine.train;
        let shafts = [train.declaration.stages[self.stage].driven_from(self.stage), self.stage + 1];
        let has_gear = |shaft: usize| self.gears.iter().any(|&gear| train.gears[gear].shaft == Some(shaft));
        (self.fixed != Member::Carrier).then(|| shafts.into_iter().find(|&shaft| !has_gear(shaft)))?
    }

    /// Stiffness of the meshes of sun and planet, and of planet and ring.
    fn curves(&self) -> Result<[MeshStiffness; 2]> {
        let [sun, planet, ring] = self.teeth;
        let [sun_bore, planet_bore] = self.toothing.bore_radius_m;
        let drives = self.sun_drives();
        let place = place(self.stage);
        let (teeth, bores) = match drives {
            true => ([sun, planet], [sun_bore, planet_bore]),
            false => ([planet, sun], [planet_bore, sun_bore]),
        };
        let [own, ring_shift] = self.circle.shifts;
        let outside = Gears { form: Form::External(teeth), bores_m: bores, profile_shift: [own; 2] };
        let form = Form::Internal { pinion: planet, ring, pinion_drives: drives };
        let profile_shift = if drives { [own, ring_shift] } else { [ring_shift, own] };
        let inside = Gears { form, bores_m: [planet_bore; 2], profile_shift };
        Ok([MeshStiffness::new(self.toothing, &outside, &place)?, MeshStiffness::new(self.toothing, &inside, &place)?])
    }

    /// One planet on its pin.
    fn add_planet(&self, builder: &mut Builder, carrier: usize, number: usize, turns: f64) -> usize {
        let gear = self.gears[1];
        let (inertia, speed) = (builder.machine.gears[gear], builder.machine.train.gears[gear].speed.value());
        let body = builder.add_body(Part::Planet(gear, number), None, inertia, [speed, self.carrier_turns]);
        let radius = self.circle.radius_m;
        let (sin, cos) = (TAU * turns).sin_cos();
        let (own, base) = (builder.at(body), builder.at(carrier));
        let damping = 2.0 * self.set.damping_ratio * (self.set.pin_n_per_m * inertia.mass_kg).sqrt();
        for (axis, lever) in [-radius * sin, radius * cos].into_iter().enumerate() {
            let along = vec![(own + 1 + axis, 1.0), (base + 1 + axis, -1.0), (base, -lever)];
            builder.add_spring(along, self.set.pin_n_per_m, damping);
        }
        builder.carry(body, [-radius * sin * self.carrier_turns, radius * cos * self.carrier_turns]);
        body
    }

    /// The two meshes of a planet.
    fn add_meshes(&self, builder: &mut Builder, curves: [usize; 2], bodies: [usize; 3], (number, turns): (usize, f64)) {
        let alpha = self.toothing.transverse_pressure_angle();
        let base = self.teeth.map(|z| self.toothing.radius_m(z) * alpha.cos());
        let [sun, planet, ring] = self.teeth.map(f64::from);
        // Sun and ring turn about the planet together: a planet's tooth comes to the ring this many pairs later.
        let passed = (self.sun_way * (sun + ring) * turns).round();
        // From pitch point to pitch point half a turn of the planet less its tooth, whose flanks stand for each other.
        let tooth = self.circle.tooth_pitches;
        let between = if self.sun_drives() { tooth - 0.5 * planet } else { -tooth - 0.5 * planet };
        let passages = [-self.sun_way * sun * turns, self.sun_way * ring * turns + between];
        for side in 0..2 {
            let (a, b) = (side, side + 1);
            let sense = if side == 0 { self.sun_torque } else { -self.sun_torque };
            let line = Line { angle: TAU * turns, sense, is_internal: side == 1 };
            builder.add_mesh(MeshLine {
                stage: self.stage,
                planet: Some(number),
                bodies: [bodies[a], bodies[b]],
                directions: line.directions(self.circle.pressure_angles[side], [base[a], base[b]]),
                gears: [self.gears[a], self.gears[b]],
                teeth: [self.teeth[a], self.teeth[b]],
                first_pairs: if side == 0 { [0, 0] } else { [passed as i64, 0] },
                order: self.order,
                phase: passages[side] + builder.pitch_point(curves[side]),
                stiffness: curves[side],
                damping_s: 0.0,
                transmission_error_m: Vec::new(),
            });
        }
    }
}
