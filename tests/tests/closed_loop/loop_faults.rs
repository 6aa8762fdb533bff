//! The whole loop on short generated records, one undeclared effect each: what is said of it, and that nothing is said of nothing.

use meshband_host::closed_loop::generate::{self, Effect, Scenario};
use meshband_host::closed_loop::outcome::Effect as Found;
use meshband_host::closed_loop::{Options, Outcome, close_loop};
use meshband_host::observation::input;
use std::path::Path;

fn outcome(effects: Vec<Effect>, seed: u64) -> Outcome {
    outcome_without(effects, seed, &[])
}

/// The same with names taken out of the library.
fn outcome_without(effects: Vec<Effect>, seed: u64, withheld: &[&str]) -> Outcome {
    let declared = input::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48")).unwrap();
    let mut scenario = Scenario::null(&declared.shafts, seed);
    scenario.duration_s = 1.5;
    scenario.effects = effects;
    let record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario);
    let withheld = withheld.iter().map(|name| (*name).to_string()).collect();
    close_loop(&record, &Options { withheld, ..Options::default() }).unwrap()
}

/// The only effect of an outcome, which must be named.
fn only_named<'a>(outcome: &'a Outcome, name: &str) -> &'a Found {
    print!("{}", outcome.summary());
    assert_eq!(outcome.effects.len(), 1, "{:?}", outcome.effects);
    let effect = &outcome.effects[0];
    assert_eq!((effect.verdict.as_str(), effect.name.as_str()), ("named", name));
    effect
}

fn value(effect: &Found, start: &str) -> f64 {
    effect.parameters.iter().find(|(name, _)| name.starts_with(start)).unwrap().1.value
}

#[test]
fn loop_says_nothing_of_the_declared_machine() {
    let outcome = outcome(vec![], 31);
    assert!(outcome.effects.is_empty(), "{}", outcome.summary());
}

#[test]
fn loop_names_a_torque_ripple_of_any_strength_at_its_order() {
    for share in [0.08, 0.4] {
        let hidden = Effect::TorqueRipple { at: 0, order: 5.0, share, phase_rad: 0.7 };
        let outcome = outcome(vec![hidden], 32);
        let ripple = only_named(&outcome, "torque-ripple");
        assert_eq!(ripple.order_of_pinion, Some(5.0));
        assert!((value(ripple, "share_of_torque") / share - 1.0).abs() < 0.02);
        let held_out = outcome.error.held_out_runs.shaft_synchronous;
        assert!(held_out.corrected < 1.3 * held_out.noise_floor && held_out.declared > 2.0 * held_out.corrected);
        // The effect's own worth: parameters alone do not explain it.
        assert!(held_out.calibrated > 2.0 * held_out.corrected, "{held_out:?}");
    }
}

#[test]
fn loop_places_mains_hum_at_its_frequency() {
    let outcome = outcome(vec![Effect::Tone { hz: 100.0, amplitude: [0.2, 0.12] }], 33);
    let hum = only_named(&outcome, "mains-hum");
    assert!((hum.frequency_hz.unwrap() - 100.0).abs() < 0.05);
    assert!((value(hum, "acceleration") / 0.2 - 1.0).abs() < 0.1);
}

#[test]
fn loop_gives_impacts_their_own_order_and_no_multiple_of_it() {
    let hidden = Effect::Impacts { channel: 0, order: 3.052, jitter: 0.01, hz: 4000.0, damping: 0.05, peak: 6.0 };
    let outcome = outcome(vec![hidden], 34);
    let impacts = only_named(&outcome, "bearing-impacts");
    assert!((impacts.order_of_pinion.unwrap() - 3.052).abs() < 0.03, "{:?}", impacts.order_of_pinion);
}

#[test]
fn loop_names_a_strong_rolling_eccentricity_and_a_strong_crack() {
    let hidden = Effect::Eccentricity { shaft: 0, amplitude_m: 60e-6, phase_rad: 1.1 };
    let found = outcome(vec![hidden], 35);
    let eccentricity = only_named(&found, "pinion-eccentricity");
    assert!((value(eccentricity, "amplitude") / 60e-6 - 1.0).abs() < 0.02);
    // Which tooth of the gear it is holds against the first run only: runs start anywhere in the hunting period.
    let found = outcome(vec![Effect::Crack { shaft: 1, tooth: 11, share: 0.5 }], 36);
    let crack = only_named(&found, "gear-tooth-crack");
    assert!((value(crack, "stiffness_loss of tooth") - 0.5).abs() < 0.01);
}

#[test]
fn loop_fits_two_eccentricities_whose_product_matters_together() {
    // Alone on the declared machine either comes out a third too small.
    let of = |shaft, phase_rad| Effect::Eccentricity { shaft, amplitude_m: 60e-6, phase_rad };
    let found = outcome(vec![of(0, 1.1), of(1, 0.3)], 38);
    print!("{}", found.summary());
    assert_eq!(found.effects.len(), 2, "{:?}", found.effects);
    for name in ["pinion-eccentricity", "gear-eccentricity"] {
        let effect = found.effects.iter().find(|e| e.verdict == "named" && e.name == name).expect(name);
        assert!((value(effect, "amplitude") / 60e-6 - 1.0).abs() < 0.01, "{name}: {:?}", effect.parameters);
    }
}

#[test]
fn loop_names_faults_of_the_measuring_path() {
    let found = outcome(vec![Effect::Clipping { channel: 0, share_of_peak: 0.75 }], 37);
    only_named(&found, "clipping");
    let found = outcome(vec![Effect::Folding { share: 1.0 }], 38);
    let aliasing = only_named(&found, "aliasing");
    assert!((value(aliasing, "share_folded") - 1.0).abs() < 0.15);
    let found = outcome(vec![Effect::Delay { channel: 1, seconds: 8e-6 }], 39);
    only_named(&found, "channel-delay");
}

#[test]
fn loop_describes_what_it_has_no_name_for() {
    let describes = |hidden: Effect, seed: u64, name: &str, families: &[&str]| {
        let found = outcome_without(vec![hidden], seed, &[name]);
        print!("{}", found.summary());
        assert!(!found.effects.is_empty(), "{name}: silence");
        for effect in &found.effects {
            assert_ne!(effect.verdict, "named", "{name}: {}", effect.name);
            assert!(families.is_empty() || families.contains(&effect.family.as_str()), "{name}: {}", effect.family);
        }
        let held_out = found.error.held_out_runs.shaft_synchronous;
        (held_out.declared, held_out.corrected, held_out.noise_floor)
    };
    let square = Effect::Nonlinearity { channel: 0, per_m_s2: 0.004, per_m2_s4: 0.0 };
    for (before, after, floor) in [
        describes(Effect::Wear { depth_m: 1e-6 }, 41, "wear", &["mesh-order"]),
        describes(Effect::Drift { channel: 1, share: 0.2 }, 42, "thermal-drift", &["non-stationary"]),
        describes(square, 43, "sensor-nonlinearity", &["path"]),
    ] {
        assert!(after < 0.9 * before && after < 2.0 * floor, "{before} -> {after}, noise {floor}");
    }
}

#[test]
fn loop_is_not_silent_about_an_effect_that_comes_and_goes() {
    let declared = input::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/check-19-48")).unwrap();
    let mut scenario = Scenario::null(&declared.shafts, 44);
    scenario.duration_s = 1.0;
    let quiet = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario);
    scenario.effects = vec![Effect::Ghost { order: 31.0, amplitude_m: 3e-6, phase_rad: 0.4 }];
    let mut record = generate::record(&declared.pair, &declared.shafts, &declared.curve, &scenario);
    // Of each speed's two runs one is without it: no law over speed, torque or time holds.
    for (i, run) in quiet.runs.into_iter().enumerate() {
        if i / 2 % 2 == i % 2 {
            record.runs[i] = run;
        }
    }
    let found = close_loop(&record, &Options::default()).unwrap();
    print!("{}", found.summary());
    assert!(!found.effects.is_empty());
    assert!(found.effects.iter().all(|e| e.verdict != "named"), "{:?}", found.effects);
}
