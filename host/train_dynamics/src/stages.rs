//! The stages of a train machine in turn: parallel shafts here, sets in [`planetary`].
//!
//! Idlers run in bearings like those of the driven shaft, all centres on one line. An idler's two meshes are apart by
//! what its tooth count gives, as a planet's; of different stages the first pair of each enters at angle 0.

use crate::assembly::{MeshLine, Part, System};
use crate::builder::{Builder, Damper, Line, place};
use crate::machine::TrainMachine;
use crate::planetary;
use crate::stiffness::{Form, Gears, MeshStiffness};
use crate::{Error, Result};
use meshband_train::declaration::Stage;

/// Damping ratio of a bearing that declares none, on its body's mass.
const BEARING_DAMPING_RATIO: f64 = 0.04;

impl System {
    /// Assembles a machine.
    ///
    /// # Errors
    /// Gears that cannot mesh, by stage.
    pub fn assemble(machine: &TrainMachine) -> Result<Self> {
        let mut builder = Builder::new(machine);
        for stage in 0..machine.toothings.len() {
            match &machine.train.declaration.stages[stage] {
                Stage::Pair { internal, .. } => add_pair(&mut builder, stage, *internal)?,
                Stage::Planetary { .. } => planetary::add_set(&mut builder, stage)?,
                Stage::Belt { .. } => return Err(Error::invalid(place(stage), "a belt cannot be simulated")),
            }
        }
        builder.add_shafts();
        Ok(builder.finish())
    }
}

/// Gears of a stage on parallel shafts, idlers on bearings like those of the driven shaft.
fn add_pair(builder: &mut Builder, stage: usize, internal: bool) -> Result<()> {
    let machine = builder.machine;
    let train = &machine.train;
    let toothing = &machine.toothings[stage];
    let Some(mesh) = train.mesh(stage) else { return Ok(()) };
    let mut chain = Vec::new();
    for &gear in &mesh.gears {
        let own = &train.gears[gear];
        let body = builder.add_body(Part::Gear(gear), own.shaft, machine.gears[gear], [own.speed.value(), 0.0]);
        let shaft = machine.shafts[own.shaft.unwrap_or(stage + 1)];
        let damping = shaft.bearing_damping_n_s_per_m.map_or(Damper::Ratio(BEARING_DAMPING_RATIO), Damper::Own);
        builder.support(body, shaft.bearing_n_per_m, damping);
        chain.push((body, gear));
    }
    let count = chain.len() - 1;
    let bore = |link: usize| if link == count { toothing.bore_radius_m[1] } else { toothing.bore_radius_m[0] };
    // Position of the pitch point's passage, pairs: a driver's tooth passes on to the next mesh of an idler.
    let mut passage = None;
    for link in 0..count {
        let gears = [chain[link].1, chain[link + 1].1];
        let teeth = gears.map(|gear| train.gears[gear].teeth);
        let is_internal = internal && link + 1 == count;
        let form = match is_internal {
            true => Form::Internal { pinion: teeth[0], ring: teeth[1], pinion_drives: true },
            false => Form::External(teeth),
        };
        let gears_in_mesh = Gears::standard(form, [bore(link), bore(link + 1)]);
        let curve = MeshStiffness::new(toothing, &gears_in_mesh, &place(stage))?;
        let stiffness = builder.add_stiffness(curve);
        let pitch = builder.pitch_point(stiffness);
        let at_pitch = passage.map_or(-pitch, |before: f64| before + 0.5 * (1.0 - f64::from(teeth[0])));
        passage = Some(at_pitch);
        let sense = builder.body(chain[link].0).turns.signum();
        let line = Line { angle: toothing.centre_line_rad, sense, is_internal };
        let alpha = toothing.transverse_pressure_angle();
        builder.add_mesh(MeshLine {
            stage,
            planet: None,
            bodies: [chain[link].0, chain[link + 1].0],
            directions: line.directions(alpha, teeth.map(|z| toothing.radius_m(z) * alpha.cos())),
            gears,
            teeth,
            first_pairs: [0; 2],
            order: mesh.order.value(),
            phase: at_pitch + pitch,
            stiffness,
            damping_s: 0.0,
            transmission_error_m: Vec::new(),
        });
    }
    Ok(())
}
