//! Published measurements: what the model lacks, found on one part of the data and scored on the other.

use meshband_host::measured::comb::{Power, Search, mean_excess, refine};
use meshband_host::measured::{adi, gear0, gfd, paderborn, paper};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

fn data(set: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    if !path.join(set).exists() {
        println!("skipped: ../shared/data/{set} is absent");
        return None;
    }
    Some(path)
}

#[test]
fn claim_paper_lines_beside_the_mesh_are_folded_harmonics() {
    let outcome = paper::run().unwrap();
    for case in &outcome.cases {
        let harmonics: Vec<u32> = case.lines.iter().map(|l| l.harmonic).collect();
        assert_eq!(harmonics, if case.case.starts_with("healthy") { [35, 36] } else { [26, 27] }, "{}", case.case);
        for line in &case.lines {
            assert!(line.error_before_hz > 25.0, "{line:?}");
            assert!(line.error_after_hz < 2.0, "{line:?}");
        }
        // Two lines imply one mesh frequency, which was not forced.
        assert!(case.disagreement < if case.case.contains("simulated") { 2e-5 } else { 5e-4 }, "{case:?}");
    }
    // What stays inconsistent: the measured healthy mesh line is quoted 0.14 % above what its folded lines imply.
    let healthy = &outcome.cases[0];
    assert!((healthy.quoted_mesh_hz / healthy.fitted_mesh_hz - 1.0) > 1e-3);
}

#[test]
fn theory_comb_search_finds_a_spacing_in_noise_and_nothing_in_noise_alone() {
    let signal = |strength: f64| -> Vec<f64> {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(5);
        (0..40_960)
            .map(|i| {
                let t = i as f64 / 512.0;
                let noise: f64 = StandardNormal.sample(&mut rng);
                let comb: f64 = [-3.0, -2.0, -1.0, 1.0, 2.0, 3.0]
                    .iter()
                    .map(|j| (TAU * (23.0 + j * 3.217) * t + j).cos() + (TAU * (46.0 + j * 3.217) * t).cos())
                    .sum();
                noise + strength * comb
            })
            .collect()
    };
    let carriers = vec![0.0, 23.0, 46.0];
    let search = Search { spacing: [0.5, 8.0], multiples: 4, carriers: carriers.clone(), top: 200.0 };
    let look = |strength: f64| {
        let power = Power::new(&signal(strength), 512.0);
        let excess = mean_excess(std::slice::from_ref(&power));
        let named = power.mask(&[23.0, 46.0], 3.0 * power.bin);
        let found = search.best(power.bin, &excess, &named).unwrap();
        let chance = search.chance(power.bin, &excess, &named);
        (found.sigma > chance, refine(power.bin, &excess, &carriers, found.spacing, 4))
    };
    let (found, spacing) = look(0.05);
    assert!(found && (spacing - 3.217).abs() < 2e-3, "{found} {spacing}");
    assert!(!look(0.0).0);
}

#[test]
fn loop_gear0_lines_found_on_half_the_record_explain_the_other_half_and_other_channels() {
    let Some(data) = data("gear0") else { return };
    let outcome = gear0::run(&data).unwrap();
    print!("{}", outcome.summary());
    assert!(outcome.fitted_values <= 4);
    assert!(outcome.covered_percent < 4.0);
    for (channel, before, after) in [(2, 82.0, 35.0), (3, 79.0, 40.0), (13, 47.0, 30.0)] {
        let left = outcome.left.iter().find(|l| l.channel == channel).unwrap();
        assert!(left.held_out_channel);
        assert!((left.mesh_only_percent - before).abs() < 5.0, "{left:?}");
        assert!(*left.after_percent.last().unwrap() <= after, "{left:?}");
        assert!(left.control_percent[0] < 1.0, "{left:?}");
    }
    let passage = outcome.combs.iter().find(|c| c.reading.starts_with("outer-ring")).expect("a passage comb");
    assert!((passage.spacing_order - 5.148).abs() < 0.002, "{passage:?}");
    assert!(!outcome.effect.contains("fault"));
}

#[test]
fn loop_gfd_slip_of_some_loads_predicts_the_others() {
    let Some(data) = data("gfd") else { return };
    let outcome = gfd::run(&data).unwrap();
    print!("{}", outcome.summary());
    for p in &outcome.predicted {
        assert!(p.mesh_error_before_percent > 0.7, "{p:?}");
        assert!(p.mesh_error_after_percent.abs() < 0.05 && p.slip_error_percent.abs() < 0.05, "{p:?}");
        assert!(p.electric_hz[1].abs() < 0.05, "{p:?}");
        assert!(p.line_error_hz[1] < 0.1 * p.line_error_hz[0], "{p:?}");
    }
}

#[test]
fn loop_adi_imbalance_line_predicts_the_second_half() {
    let Some(data) = data("adi") else { return };
    let outcome = adi::run(&data).unwrap();
    print!("{}", outcome.summary());
    let [balanced, low, high] = &outcome.cases[..] else { panic!("three files") };
    assert!(low.amplitude_v[0] > 5.0 * balanced.amplitude_v[0] && high.amplitude_v[0] > 2.0 * low.amplitude_v[0]);
    assert!(low.held_out_nrmse[1] < 0.8 && high.held_out_nrmse[1] < 0.8);
    assert!(balanced.held_out_nrmse[2] > 0.8, "nothing is gained where there is no imbalance");
}

#[test]
fn loop_paderborn_envelope_combs_hold_on_the_second_half() {
    let Some(data) = data("paderborn") else { return };
    let outcome = paderborn::run(&data).unwrap();
    print!("{}", outcome.summary());
    let first = |i: usize| &outcome.cases[i].combs[0];
    assert_eq!(first(1).reading, "outer-ring passage");
    assert!((first(1).spacing_hz - 76.25).abs() < 0.2);
    assert_eq!(first(2).reading, "inner-ring passage");
    assert!(first(0).reading.contains("unexplained"), "the bearing called healthy is no clean baseline");
    for case in &outcome.cases {
        let c = &case.combs[0];
        assert!(c.share_percent > 2.0 * c.control_percent[1], "{c:?}");
    }
}
