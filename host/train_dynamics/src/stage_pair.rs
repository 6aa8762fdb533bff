//! One spur stage of a train as a gear pair of its own, the rest of the train rigid.
//!
//! Motor and load of the pair are everything before and behind the stage, their inertias referred to its pinion's and
//! its gear's shaft by the squared ratio of speeds, with the torsional springs of those two shafts. What pairs can do
//! is thus open to a stage: its bandwidth law, the pair's simulator, model-based inference. Limits: natural
//! frequencies of the rest are gone; helical and internal stages and sets are no spur pairs and are refused.

use crate::machine::{MeshDamping, TrainMachine};
use crate::{Error, Result};
use meshband_mechanics::machine::damping::{BEARING, COUPLING, of_bearing, of_coupling};
use meshband_mechanics::machine::{Engagement, EngagementKind, Machine, Nominal, Pair, Shafts};
use meshband_train::{Gear, Role};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// The pair of a stage, counted from 1.
///
/// # Errors
/// A stage that is not there, or is no external spur pair without idlers.
pub fn pair_of_stage(machine: &TrainMachine, stage: usize) -> Result<Machine> {
    let refuse = |what: &str| Err(Error::invalid(format!("stage {stage}"), what));
    let train = &machine.train;
    let index = stage.wrapping_sub(1);
    let Some(mesh) = train.mesh(index) else { return refuse("is no stage with teeth of this train") };
    let gears: Vec<&Gear> = mesh.gears.iter().map(|gear| &train.gears[*gear]).collect();
    let [pinion, gear] = gears.as_slice() else { return refuse("has more than two gears: no pair") };
    if pinion.role != Role::Pinion || pinion.speed.sign() == gear.speed.sign() {
        return refuse("is no external pair: an internal gear and a set have no pair's machine file");
    }
    let toothing = &machine.toothings[index];
    if toothing.helix_angle_deg != 0.0 {
        return refuse("is helical: the pair's model is of spur gears; simulate the train instead");
    }
    let teeth = [pinion.teeth, gear.teeth];
    let mut pair = Pair::spur(teeth, toothing.module_m, toothing.face_width_m, toothing.bore_radius_m);
    pair.pressure_angle_deg = toothing.pressure_angle_deg;
    (pair.youngs_modulus_pa, pair.poisson) = (toothing.youngs_modulus_pa, toothing.poisson);
    match toothing.damping {
        MeshDamping::Ratio(ratio) => pair.mesh_damping_ratio = Some(ratio),
        MeshDamping::Time(time) => pair.mesh_damping_s = time,
    }
    let engagement = Engagement {
        kind: EngagementKind::RaisedCosine,
        // A base pitch is one tooth of the pinion.
        width_rad: Some(toothing.ramp_base_pitches * TAU / f64::from(pinion.teeth)),
        relief_m: None,
        relief_length_base_pitches: None,
        relief_exponent: None,
        torque_n_m: None,
    };
    let nominal = machine.nominal.map(|nominal| Nominal {
        speed_hz: nominal.speed_hz * pinion.rate.magnitude().value(),
        torque_n_m: nominal.load_torque_n_m * train.shaft_order(machine.load.shaft).value()
            / pinion.rate.magnitude().value(),
    });
    let pair = Machine {
        title: format!("{}, stage {stage}", train.declaration.title),
        pair,
        shafts: shafts(machine, index, [mesh.gears[0], mesh.gears[1]]),
        engagement: Some(engagement),
        crack: None,
        motor: None,
        load: None,
        casing: None,
        nominal,
        folder: PathBuf::new(),
    };
    // As a file of it would be read: a ratio of mesh damping becomes a time.
    pair.prepared(&format!("stage {stage}"), Path::new(""))
}

/// The two shafts of a stage with all that turns before and behind it.
fn shafts(machine: &TrainMachine, stage: usize, [pinion, gear]: [usize; 2]) -> Shafts {
    let train = &machine.train;
    let sides = [train.declaration.stages[stage].driven_from(stage), stage + 1];
    let bodies = [pinion, gear].map(|index| machine.gears[index]);
    let own = [pinion, gear].map(|index| train.gears[index].rate.magnitude().value());
    let mut rest = [0.0; 2];
    let mut add = |shaft: usize, inertia: f64, turns: f64| {
        let side = usize::from(is_behind(machine, shaft, stage));
        rest[side] += inertia * (turns / own[side]).powi(2);
    };
    for (index, gear_of) in train.gears.iter().enumerate().filter(|(index, _)| ![pinion, gear].contains(index)) {
        // A planet or idler turns with the shaft behind its stage.
        let count = planets(machine, index);
        let shaft = gear_of.shaft.unwrap_or(gear_of.stage + 1);
        add(shaft, count * machine.gears[index].inertia_kg_m2, gear_of.speed.magnitude().value());
    }
    for (number, set) in machine.sets.iter().enumerate().filter_map(|(n, set)| Some((n, set.as_ref()?))) {
        let carrier = train.mesh(number).and_then(|mesh| mesh.carrier.as_ref());
        let turns = carrier.map_or(0.0, |carrier| carrier.speed.magnitude().value());
        add(number + 1, set.carrier.inertia_kg_m2, turns);
    }
    for end in [&machine.drive, &machine.load] {
        add(end.shaft, end.inertia_kg_m2, train.shaft_order(end.shaft).value());
    }
    let springs = sides.map(|shaft| machine.shafts[shaft].torsion_n_m_per_rad);
    let inertias = bodies.map(|body| body.inertia_kg_m2);
    let bearing = sides.map(|shaft| machine.shafts[shaft].bearing_n_per_m.iter().sum::<f64>() / 2.0);
    let coupling = |side: usize| of_coupling(COUPLING, springs[side], [rest[side], inertias[side]]);
    let support = |side: usize| of_bearing(BEARING, bearing[side], bodies[side].mass_kg);
    Shafts {
        inertia_motor_kg_m2: rest[0],
        inertia_pinion_kg_m2: inertias[0],
        inertia_gear_kg_m2: inertias[1],
        inertia_load_kg_m2: rest[1],
        coupling_stiffness_n_m_per_rad: springs,
        coupling_damping_n_m_s_per_rad: [coupling(0), coupling(1)],
        mass_kg: bodies.map(|body| body.mass_kg),
        bearing_stiffness_n_per_m: bearing,
        bearing_damping_n_s_per_m: [support(0), support(1)],
    }
}

/// Bodies of a gear: its planets, else one.
fn planets(machine: &TrainMachine, gear: usize) -> f64 {
    let gear = &machine.train.gears[gear];
    let carrier = machine.train.mesh(gear.stage).and_then(|mesh| mesh.carrier.as_ref());
    carrier.filter(|_| gear.role == Role::Planet).map_or(1.0, |carrier| f64::from(carrier.planets))
}

/// Whether a shaft is driven through a stage: everything else is before it.
fn is_behind(machine: &TrainMachine, shaft: usize, stage: usize) -> bool {
    let mut at = shaft;
    while at > 0 {
        if at == stage + 1 {
            return true;
        }
        at = machine.train.declaration.stages[at - 1].driven_from(at - 1);
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    const THREE: &str = "title = \"box\"\n[[stage]]\nkind = \"pair\"\nteeth = [20, 60]\n[[stage]]\nkind = \
        \"pair\"\nteeth = [19, 48]\n[[stage]]\nkind = \"pair\"\nteeth = [18, 54]\nhelix_angle_deg = \
        12\n[[mesh]]\nmodule_mm = 2\nface_width_mm = 20\n[[mesh]]\nmodule_mm = 3\nface_width_mm = \
        30\n[[mesh]]\nmodule_mm = 4\nface_width_mm = 40\n[nominal]\nspeed_hz = 24\nload_torque_n_m = 900\n";

    #[test]
    fn theory_a_stage_keeps_energy_speed_and_torque_of_the_train() {
        let machine = TrainMachine::parse(THREE, "box.toml").expect("a machine");
        let pair = pair_of_stage(&machine, 2).expect("a pair");
        assert_eq!(pair.pair.teeth, [19, 48]);
        let nominal = pair.nominal.expect("declared");
        assert!((nominal.speed_hz - 8.0).abs() < 1e-12);
        // 900 N m at the output of 3 to 1 behind 48 to 19.
        assert!((nominal.torque_n_m - 900.0 / 3.0 * 19.0 / 48.0).abs() < 1e-9);
        // Twice the kinetic energy of the whole train at 1 rad/s of the input.
        let turns: Vec<f64> = machine.train.gears.iter().map(|gear| gear.speed.magnitude().value()).collect();
        let bodies: f64 = machine.gears.iter().zip(&turns).map(|(body, w)| body.inertia_kg_m2 * w * w).sum();
        let ends: f64 = [&machine.drive, &machine.load]
            .iter()
            .map(|end| end.inertia_kg_m2 * machine.train.shaft_order(end.shaft).value().powi(2))
            .sum();
        let s = &pair.shafts;
        let (pinion, gear) = (1.0f64 / 3.0, 1.0 / 3.0 * 19.0 / 48.0);
        let of_pair = (s.inertia_motor_kg_m2 + s.inertia_pinion_kg_m2) * pinion * pinion
            + (s.inertia_gear_kg_m2 + s.inertia_load_kg_m2) * gear * gear;
        assert!((of_pair / (bodies + ends) - 1.0).abs() < 1e-12, "{of_pair} {}", bodies + ends);
    }

    #[test]
    fn theory_the_stage_of_a_one_stage_train_is_that_pair() {
        let text = THREE.split("[[stage]]").take(2).collect::<Vec<_>>().join("[[stage]]")
            + "[[mesh]]\nmodule_mm = 2\nface_width_mm = 20\n";
        let machine = TrainMachine::parse(&text, "one.toml").expect("a machine");
        let pair = pair_of_stage(&machine, 1).expect("a pair");
        assert_eq!(pair.shafts.inertia_motor_kg_m2, machine.drive.inertia_kg_m2);
        assert_eq!(pair.shafts.inertia_load_kg_m2, machine.load.inertia_kg_m2);
        let written = toml::to_string(&pair).expect("TOML");
        let folder = std::env::temp_dir().join(format!("meshband-stage-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        let path = folder.join("pair.toml");
        std::fs::write(&path, written).expect("written");
        let read = Machine::read(&path).expect("a machine file");
        assert_eq!((read.pair.teeth, read.shafts.mass_kg), (pair.pair.teeth, pair.shafts.mass_kg));
        std::fs::remove_dir_all(folder).expect("removed");
    }

    #[test]
    fn fault_stages_that_are_no_spur_pair_are_refused_with_the_reason() {
        let machine = TrainMachine::parse(THREE, "box.toml").expect("a machine");
        let refused = |stage: usize| pair_of_stage(&machine, stage).expect_err("refused").to_string();
        assert!(refused(0).contains("no stage") && refused(4).contains("no stage"));
        assert!(refused(3).contains("helical"));
    }
}
