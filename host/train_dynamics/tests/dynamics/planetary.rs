//! Planetary sets against Lin and Parker's theory of modes and Parker's of phasing.

use super::{line, machine, rms, waveform};
use meshband_mechanics::dynamics::Motion;
use meshband_train::phasing::{SymmetryClass, order, stands, symmetry_class};
use meshband_train_dynamics::assembly::{Part, System};
use meshband_train_dynamics::integrate::Course;
use meshband_train_dynamics::modes::{Mode, modes};
use meshband_train_dynamics::sensor::Sensor;
use meshband_train_dynamics::{Run, TrainMachine, simulate};

/// A symmetric set; `more` is put into its mesh table.
fn set([sun, planet, planets]: [u32; 3], more: &str) -> TrainMachine {
    let ring = sun + 2 * planet;
    let text = format!(
        "[[stage]]\nkind = \"planetary\"\nsun = {sun}\nplanet = {planet}\nring = {ring}\nplanets = {planets}\nfixed = \
         \"ring\"\ninput = \"sun\"\n[[mesh]]\nmodule_mm = 2\nface_width_mm = 25\n{more}\n[[planetary]]\nstage = \
         1\nsupport_stiffness_n_per_m = [5e7, 4e8, 1e8]\n"
    );
    TrainMachine::parse(&text, "set").expect("a machine")
}

/// Sets that can be put together with evenly spaced planets.
const SETS: [[u32; 3]; 3] = [[27, 27, 3], [25, 25, 4], [25, 25, 5]];

/// Coordinates of sun, ring and carrier: their rotations, and their shifts.
fn central(system: &System) -> (Vec<usize>, Vec<usize>) {
    let members = system.bodies.iter().filter(|body| !matches!(body.part, Part::Planet(..)));
    let at: Vec<usize> = members.map(|body| body.at).collect();
    (at.clone(), at.iter().flat_map(|at| [at + 1, at + 2]).collect())
}

/// What a mode moves: turns of the members in the middle, and their shifts, over all its motion weighted with mass.
fn shares(system: &System, mode: &Mode) -> (f64, f64) {
    let (turns, shifts) = central(system);
    let of = |which: &[usize]| which.iter().map(|&i| system.mass[i] * mode.shape[i].powi(2)).sum::<f64>().sqrt();
    (of(&turns), of(&shifts))
}

#[test]
fn theory_modes_are_rotational_translational_in_pairs_and_planet_modes_by_number() {
    for teeth in SETS {
        let planets = teeth[2] as usize;
        let system = System::assemble(&set(teeth, "")).expect("a system");
        let modes = modes(&system);
        let mut groups: Vec<Vec<&Mode>> = Vec::new();
        for mode in &modes {
            match groups.last_mut() {
                Some(group) if (mode.frequency_hz / group[0].frequency_hz - 1.0).abs() < 1e-7 => group.push(mode),
                _ => groups.push(vec![mode]),
            }
        }
        // Drive and load turn besides sun, ring and carrier.
        let (mut rotational, mut translational, mut planet) = (0, 0, 0);
        for group in &groups {
            let quiet = |of: fn((f64, f64)) -> f64| group.iter().all(|mode| of(shares(&system, mode)) < 1e-7);
            match (quiet(|s| s.0), quiet(|s| s.1), group.len()) {
                (true, true, n) if n == planets - 3 => planet += 1,
                (true, false, 2) => translational += 1,
                (false, true, 1) => rotational += 1,
                (turns, shifts, n) => panic!("{planets} planets: {n} modes, no turns {turns}, no shifts {shifts}"),
            }
        }
        let expected = (8, 6, if planets > 3 { 3 } else { 0 });
        assert_eq!((rotational, translational, planet), expected, "{planets} planets");
        assert_eq!(rotational + 2 * translational + (planets - 3) * planet, system.len());
    }
}

#[test]
fn fault_sets_that_cannot_be_put_together_are_refused_with_the_key() {
    let refused = |sun: u32, ring: u32, planets: u32| {
        let text = format!(
            "[[stage]]\nkind = \"planetary\"\nsun = {sun}\nplanet = 27\nring = {ring}\nplanets = {planets}\nfixed = \
             \"ring\"\ninput = \"sun\"\n[[mesh]]\nmodule_mm = 2\nface_width_mm = 25\n"
        );
        let machine = TrainMachine::parse(&text, "set").expect("a machine");
        System::assemble(&machine).expect_err("refused").to_string()
    };
    assert!(refused(27, 81, 5).contains("[[stage]] 1 planets"), "{}", refused(27, 81, 5));
    assert!(refused(27, 96, 3).contains("[[stage]] 1 ring"), "{}", refused(27, 96, 3));
}

#[test]
fn theory_a_mesh_harmonic_moves_the_modes_of_its_symmetry_class_only() {
    for teeth in SETS {
        for harmonic in 1..=4 {
            let errors = (1..=harmonic).map(|k| if k == harmonic { "10.0" } else { "0.0" }).collect::<Vec<_>>();
            let machine = set(teeth, &format!("transmission_error_um = [{}]", errors.join(", ")));
            let system = System::assemble(&machine).expect("a system").averaged();
            let motion = Motion::Constant { speed_hz: 20.0, turns_at_zero: 0.0 };
            let course = Course { system: &system, motion: &motion, load_torque_n_m: 10.0, effects: &[] };
            let signals = waveform(&course, -0.05, (20e3, 400), &|step, i| step.acceleration(i), system.len());
            // Turns are weighed as shifts at a radius of 30 mm.
            let level =
                |which: &[usize], scale: f64| which.iter().map(|&i| scale * rms(&signals[i])).fold(0.0, f64::max);
            let (turns, shifts) = central(&system);
            let (turns, shifts) = (level(&turns, 0.03), level(&shifts, 1.0));
            let planets: Vec<usize> = (0..system.len()).filter(|i| *i > 10).collect();
            let planets = level(&planets, 0.03);
            assert!(planets > 1e-3, "{teeth:?}, harmonic {harmonic}: nothing moves");
            let class = symmetry_class(teeth[0], teeth[2], harmonic);
            let expected = match class {
                SymmetryClass::Rotational => turns > 1e-4 && shifts < 1e-9 * turns,
                SymmetryClass::Translational => shifts > 1e-4 && turns < 1e-9 * shifts,
                SymmetryClass::Planet => turns < 1e-9 * planets && shifts < 1e-9 * planets,
            };
            assert!(expected, "{teeth:?}, harmonic {harmonic}, {class:?}: turns {turns:e} shifts {shifts:e}");
        }
    }
}

#[test]
fn theory_a_sound_set_shows_the_sidebands_that_phasing_lets_stand() {
    let machine = machine("train-planetary");
    let mesh = machine.train.mesh(0).expect("a mesh").clone();
    let carrier = mesh.carrier.clone().expect("a carrier");
    // A whole number of turns of the carrier, whose 95 ring teeth make the mesh's line its 95th.
    let speed_hz = 126.0 / 4.0;
    let turns_s = 126.0 / 31.0 / speed_hz;
    let rate_hz = 16_384.0 / turns_s;
    let sensor = Sensor::Ring { stage: 0, place_turns: 0.0 };
    let run = Run::steady(speed_hz, 100.0, vec![sensor], rate_hz, 2.0 * turns_s);
    let signal = &simulate(&machine, &run).expect("a run").channels[0];
    let amplitude = |k: i64, n: i64| {
        let hz = order(&mesh, &carrier, k, n).expect("an order").value() * speed_hz;
        line(signal, rate_hz, hz)
    };
    for k in 1..=3 {
        let all: Vec<(i64, f64)> = (-4..=4).map(|n| (n, amplitude(k, n))).collect();
        let largest = all.iter().map(|(_, a)| *a).fold(0.0, f64::max);
        for (n, a) in all {
            match stands(&carrier, k, n) {
                // The window of three planets has no third harmonic and little beyond.
                true => assert!(n.abs() > 2 || a > 1e-3 * largest, "{k} {n}: {a:e} of {largest:e}"),
                false => assert!(a < 1e-4 * largest, "{k} {n}: {a:e} of {largest:e}"),
            }
        }
        assert!(largest > 1e-3, "harmonic {k}");
    }
}
