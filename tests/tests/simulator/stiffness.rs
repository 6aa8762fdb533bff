//! Mesh stiffness against closed forms, an independent code, ROSS, ISO 6336 and its own limits.

use meshband_host::machine::{
    Crack, CrackRule, Engagement, EngagementKind, Geometry, Machine, Pair, RootAngle, RootShape, Side, involute,
};
use meshband_host::stiffness::{
    PairModel, Table, Tooth, engage, gap_curvature_per_m, gap_m, hertz_stiffness, iso6336, mesh,
};
use rand::{RngExt, SeedableRng};
use serde_json::Value;
use std::path::Path;

fn vectors() -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("vectors/mesh_stiffness.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn pair(teeth: [u32; 2], module_mm: f64, width_mm: f64, e_gpa: f64, bore_mm: [f64; 2]) -> Pair {
    let mut pair = Pair::spur(teeth, module_mm * 1e-3, width_mm * 1e-3, bore_mm.map(|d| 0.5e-3 * d));
    pair.youngs_modulus_pa = e_gpa * 1e9;
    pair
}

fn from_vector(entry: &Value) -> Pair {
    let two = |key: &str| [0, 1].map(|i| entry[key][i].as_f64().unwrap());
    let teeth = two("teeth").map(|z| z as u32);
    let number = |key: &str| entry[key].as_f64().unwrap();
    pair(teeth, number("module_mm"), number("width_mm"), number("E_gpa"), two("bore_diameter_mm"))
}

fn close(what: &str, got: f64, want: f64, relative: f64) {
    let error = (got / want - 1.0).abs();
    println!("{what}: {got:.6e} against {want:.6e}, off by {error:.1e}");
    assert!(error <= relative, "{what}: {got:e} against {want:e}, off by {error:.2e} > {relative:e}");
}

#[test]
fn ref_independent_code_pair_stiffness_along_the_path() {
    let entry = &vectors()["pair_19_48"];
    let mut pair = from_vector(entry);
    for (body, key) in [(true, "pair_at_path_fraction"), (false, "without_body")] {
        pair.body = body;
        let model = PairModel::new(&pair).unwrap();
        for (fraction, want) in entry["independent"][key].as_object().unwrap() {
            let s = fraction.parse::<f64>().unwrap() * model.geometry.contact_ratio;
            close(&format!("{key} {fraction}"), model.at(s), want.as_f64().unwrap(), 1e-3);
        }
    }
}

#[test]
fn ref_ross_tooth_components_with_the_trochoid_root() {
    let entries = vectors();
    let check = |name: &str, entry: &Value, index: usize, angle_deg: Option<f64>, want: [f64; 3]| {
        let mut pair = from_vector(entry);
        pair.root = RootShape::Trochoid;
        let geometry = Geometry::new(&pair).unwrap();
        let tooth = Tooth::new(&pair, &geometry, index).unwrap();
        let angle =
            angle_deg.map_or(tooth.tip_load_angle(), |a| a.to_radians().tan() - geometry.base_half_angle[index]);
        let c = tooth.compliance(angle);
        for (part, got, want) in [("kb", c.bending, want[0]), ("ks", c.shear, want[1]), ("ka", c.axial, want[2])] {
            close(&format!("{name} {part}"), 1.0 / got, want, 1e-3);
        }
    };
    let entry = &entries["pair_19_48"];
    for (index, name) in ["z19", "z48"].iter().enumerate() {
        let tooth = &entry["tooth_at_pitch_point"][name];
        check(name, entry, index, Some(20.0), ["kb", "ks", "ka"].map(|k| tooth[k].as_f64().unwrap()));
    }
    check("z48 at addendum", entry, 1, None, [7.62804e8, 8.30304e8, 1.22700e10]);
    check("z62", &entries["pair_62_62"], 0, Some(20.0), [1.14979e10, 2.23803e9, 6.20220e10]);
}

#[test]
fn ref_sainsot_body_stiffness_at_the_pitch_point() {
    let entry = &vectors()["pair_19_48"];
    let pair = from_vector(entry);
    let model = PairModel::new(&pair).unwrap();
    for (index, name) in ["z19", "z48"].iter().enumerate() {
        let tooth = &entry["tooth_at_pitch_point"][name];
        let angle = 20f64.to_radians().tan() - model.geometry.base_half_angle[index];
        close(&format!("{name} kf"), 1.0 / model.body(index, angle), tooth["kf_sainsot_u"].as_f64().unwrap(), 1e-3);
    }
}

#[test]
fn theory_true_root_angle_is_where_the_generated_fillet_ends() {
    let mut pair = Pair::spur([24, 62], 2e-3, 0.02, [8e-3, 20e-3]);
    pair.root = RootShape::Trochoid;
    pair.root_angle = RootAngle::Fillet;
    let model = PairModel::new(&pair).unwrap();
    for i in 0..2 {
        let (x, h) = model.teeth[i].ends()[1];
        close("root angle", model.bodies[i].root_half_angle, (h / x).atan(), 1e-12);
        close("root radius", x.hypot(h), model.geometry.root_radius_m[i], 1e-12);
    }
    // The customary formula, with the tooth's addendum in the cutter's place, is 6 % smaller.
    pair.root_angle = RootAngle::Literature;
    let customary = PairModel::new(&pair).unwrap().bodies[1].root_half_angle;
    close("62 teeth, as published", customary, 0.0457, 2e-3);
    close("ratio", customary / model.bodies[1].root_half_angle, 0.94, 2e-3);
}

#[test]
fn fault_body_fit_outside_its_range_is_flagged_per_gear() {
    let model = PairModel::new(&Pair::spur([62, 62], 2e-3, 0.02, [17.5e-3, 5e-3])).unwrap();
    assert!(model.bodies[0].warnings().is_empty());
    assert!(model.bodies[1].warnings()[0].contains("hub radius"));
    let model = PairModel::new(&Pair::spur([19, 48], 3.175e-3, 0.016, [9.6e-3, 26.5e-3])).unwrap();
    assert!(model.bodies[0].warnings()[0].contains("half angle"));
}

#[test]
fn regress_every_shipped_machine_is_read_and_has_a_curve() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../machines");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        // Trains are read by their own crate's tests.
        let is_train = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("train-"));
        if path.extension().is_some_and(|e| e == "toml") && !is_train {
            let machine = Machine::read(&path).unwrap();
            let curve = machine.pair_stiffness().unwrap();
            let total = mesh::total(&curve);
            assert!((0..400).all(|i| total.value((f64::from(i) + 0.5) / 400.0) > 1e6), "{}", path.display());
            assert!(machine.pair.mesh_damping_s > 0.0);
            seen += 1;
        }
    }
    assert!(seen >= 7);
}

#[test]
fn fault_random_geometry_is_refused_or_gives_a_sound_curve() {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let (mut sound, mut refused) = (0, 0);
    for _ in 0..1000 {
        let teeth = [random.random_range(6..120), random.random_range(6..200)];
        let module = random.random_range(0.5e-3..8e-3);
        let bore = teeth.map(|z| module * f64::from(z) * random.random_range(0.05..0.45));
        let mut pair = Pair::spur(teeth, module, 0.02, bore);
        pair.pressure_angle_deg = random.random_range(12.0..32.0);
        pair.addendum_coefficient = random.random_range(0.5..1.4);
        pair.clearance_coefficient = random.random_range(0.05..0.5);
        pair.profile_shift = [random.random_range(-0.6..0.9), random.random_range(-0.6..0.9)];
        pair.root = [RootShape::RadialStub, RootShape::Trochoid, RootShape::BaseCircle][random.random_range(0..3)];
        let Ok(model) = PairModel::new(&pair) else {
            refused += 1;
            continue;
        };
        sound += 1;
        let curve = model.curve();
        let total = mesh::total(&curve);
        for i in 0..50 {
            let s = (f64::from(i) + 0.5) / 50.0;
            let (one, all) = (model.at(s * model.geometry.contact_ratio), total.value(s));
            assert!(one.is_finite() && one > 0.0 && all >= 0.0 && all.is_finite(), "{pair:?} at {s}: {one} {all}");
            let fitted = curve.value(s * model.geometry.contact_ratio);
            assert!((fitted / one - 1.0).abs() < 1e-6, "{pair:?} at {s}: {fitted:e} against {one:e}");
        }
        mesh::square_wave(&curve, model.geometry.contact_ratio);
    }
    println!("{sound} sound, {refused} refused");
    assert!(sound > 100 && refused > 100);
}

/// Curve means of three codes and ours: mean over the double and the single zone.
#[test]
fn ref_curve_means_lie_within_the_spread_of_the_codes() {
    let all = vectors();
    let means = |name: &str, root: RootShape| {
        let mut pair = from_vector(&all[name]);
        pair.root = root;
        let model = PairModel::new(&pair).unwrap();
        mesh::summary(&model.curve(), model.geometry.contact_ratio)
    };
    let number = |name: &str, block: &str, key: &str| all[name][block][key].as_f64().unwrap();
    for root in [RootShape::RadialStub, RootShape::Trochoid] {
        for name in ["pair_19_48", "pair_62_62"] {
            let got = means(name, root);
            close(&format!("{name} double"), got.double_mean, number(name, "ross_2_3_0", "double_mean"), 0.08);
            close(&format!("{name} single"), got.single_mean, number(name, "ross_2_3_0", "single_mean"), 0.08);
            close(&format!("{name} cycle"), got.mean, number(name, "ross_2_3_0", "cycle_mean"), 0.08);
        }
        let got = means("pair_17_38", root);
        for code in ["ross", "independent"] {
            close(&format!("17/38 double, {code}"), got.double_mean, number("pair_17_38", code, "double"), 0.08);
            close(&format!("17/38 single, {code}"), got.single_mean, number("pair_17_38", code, "single"), 0.08);
        }
    }
    let got = means("pair_19_48", RootShape::RadialStub);
    close("19/48 double, independent", got.double_mean, number("pair_19_48", "independent", "double_mean"), 1e-4);
    close("19/48 single, independent", got.single_mean, number("pair_19_48", "independent", "single_mean"), 1e-4);
    let got = means("pair_17_38", RootShape::RadialStub);
    close("17/38 double, independent", got.double_mean, number("pair_17_38", "independent", "double"), 1e-3);
    close("17/38 single, independent", got.single_mean, number("pair_17_38", "independent", "single"), 1e-3);
}

#[test]
fn theory_contact_ratios() {
    let table = [
        ([19, 48], 1.6456),
        ([16, 48], 1.6231),
        ([20, 40], 1.6352),
        ([62, 62], 1.7898),
        ([55, 75], 1.7940),
        ([17, 38], 1.6091),
        ([18, 35], 1.6082),
    ];
    for (teeth, want) in table {
        let geometry = Geometry::new(&Pair::spur(teeth, 2e-3, 0.02, [1e-3; 2])).unwrap();
        assert!((geometry.contact_ratio - want).abs() < 5.1e-5, "{teeth:?}: {}", geometry.contact_ratio);
    }
}

#[test]
fn theory_profile_shift_keeps_the_base_pitch_and_the_zero_backlash_condition() {
    let mut pair = Pair::spur([17, 40], 3e-3, 0.02, [5e-3; 2]);
    pair.profile_shift = [0.4, -0.1];
    let g = Geometry::new(&pair).unwrap();
    // Tooth thicknesses on the working circles fill the working pitch exactly.
    let thickness = |i: usize| {
        let r = g.base_radius_m[i] / g.working_pressure_angle.cos();
        2.0 * r * (g.base_half_angle[i] - involute(g.working_pressure_angle))
    };
    let pitch = 2.0 * std::f64::consts::PI * g.base_radius_m[0] / g.working_pressure_angle.cos() / 17.0;
    assert!((thickness(0) + thickness(1) - pitch).abs() < 1e-12);
    let radii = (g.base_radius_m[0] + g.base_radius_m[1]) / g.working_pressure_angle.cos();
    assert!((radii - g.centre_distance_m).abs() < 1e-15);
    // Equal and opposite shifts leave the centre distance alone.
    pair.profile_shift = [0.3, -0.3];
    let g = Geometry::new(&pair).unwrap();
    assert!((g.centre_distance_m - 0.5 * 3e-3 * 57.0).abs() < 1e-15);
}

#[test]
fn theory_bending_shear_axial_closed_forms_in_the_roll_angle() {
    // The integrals in the roll angle as printed (Yang and Lin; Tian), by a plain fine midpoint sum.
    let mut pair = from_vector(&vectors()["pair_19_48"]);
    pair.root = RootShape::BaseCircle;
    let geometry = Geometry::new(&pair).unwrap();
    let tooth = Tooth::new(&pair, &geometry, 1).unwrap();
    let (a2, e, l, nu) = (geometry.base_half_angle[1], pair.youngs_modulus_pa, pair.face_width_m, pair.poisson);
    for a1 in [0.05, 0.2, 0.4f64] {
        let n = 200_000;
        let mut sum = [0.0; 3];
        for i in 0..n {
            let a = -a1 + (a1 + a2) * (i as f64 + 0.5) / n as f64;
            let den = a.sin() + (a2 - a) * a.cos();
            let arm = 1.0 + a1.cos() * ((a2 - a) * a.sin() - a.cos());
            sum[0] += 3.0 * arm * arm * (a2 - a) * a.cos() / (2.0 * e * l * den.powi(3));
            sum[1] += 1.2 * (1.0 + nu) * (a2 - a) * a.cos() * a1.cos().powi(2) / (e * l * den);
            sum[2] += (a2 - a) * a.cos() * a1.sin().powi(2) / (2.0 * e * l * den);
        }
        let c = tooth.compliance(a1);
        for (got, want) in [c.bending, c.shear, c.axial].into_iter().zip(sum) {
            assert!((got / (want * (a1 + a2) / n as f64) - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn theory_hertz_stiffness() {
    close("62/62", hertz_stiffness(206e9, 0.3, 0.02), 3.5559e9, 2e-5);
    close("19/48", hertz_stiffness(206.8e9, 0.3, 0.016), 2.855742e9, 1e-6);
}

#[test]
fn theory_curve_and_sum_reproduce_the_model() {
    for teeth in [[19, 48], [55, 75], [62, 62]] {
        let model = PairModel::new(&Pair::spur(teeth, 2e-3, 0.02, [5e-3, 10e-3])).unwrap();
        let curve = model.curve();
        let ratio = model.geometry.contact_ratio;
        let largest = model.at(0.5 * ratio);
        for i in 0..997 {
            let s = ratio * (i as f64 + 0.3) / 997.0;
            assert!((curve.value(s) - model.at(s)).abs() < 1e-9 * largest, "{teeth:?} at {s}");
        }
        let total = mesh::total(&curve);
        assert_eq!(total.knots().len(), 3, "two zones per base pitch: {:?}", total.knots());
        for i in 0..997 {
            let s = (i as f64 + 0.3) / 997.0;
            let want = curve.value(s) + curve.value(s + 1.0);
            assert!((total.value(s) - want).abs() < 1e-9 * largest);
        }
        close("mean is the pair's integral", total.integral(), curve.integral(), 1e-12);
    }
}

#[test]
fn theory_square_wave_keeps_zone_means() {
    let model = PairModel::new(&from_vector(&vectors()["pair_19_48"])).unwrap();
    let (curve, ratio) = (model.curve(), model.geometry.contact_ratio);
    let (a, b) = (mesh::summary(&curve, ratio), mesh::summary(&mesh::square_wave(&curve, ratio), ratio));
    close("double", b.double_mean, a.double_mean, 1e-12);
    close("single", b.single_mean, a.single_mean, 1e-12);
}

#[test]
fn ref_iso_6336_method_b_worked_case() {
    // 17/103, module 8 mm, x 0.145/0, helix 15.8 degrees, full-depth basic rack (dedendum 1.4).
    let helix = 15.8f64.to_radians();
    let base_helix = (helix.sin() * 20f64.to_radians().cos()).asin();
    let virtual_teeth = [17.0, 103.0].map(|z| z / (base_helix.cos().powi(2) * helix.cos()));
    let theoretical = iso6336::theoretical_single(virtual_teeth, [0.145, 0.0]);
    close("c'th", theoretical / 1e9, 17.856, 1e-3);
    let single = iso6336::single(theoretical, 1.0, iso6336::basic_rack_factor(1.4, 20.0), helix);
    close("c'", single / 1e9, 12.370, 1e-3);
    // Mesh stiffness at the case's transverse contact ratio, and its uneven-load form (factor 0.85).
    let mean = iso6336::mesh(single, 1.5492) / 1e9;
    close("c_gamma_alpha", mean, 17.465, 1e-3);
    close("c_gamma_beta", 0.85 * mean, 14.845, 1e-3);
}

#[test]
fn ref_iso_6336_beside_the_energy_method() {
    let table = [
        ([19, 48], 3.175, 16.0, 206.8, [20.0, 48.0], 2.05e8, 3.05e8),
        ([20, 40], 3.0, 23.0, 206.8, [20.0, 40.0], 2.92e8, 4.31e8),
        ([55, 75], 2.0, 20.0, 206.0, [40.0, 54.0], 2.92e8, 4.65e8),
        ([17, 38], 3.0, 15.0, 210.0, [20.0, 20.0], 1.85e8, 2.70e8),
    ];
    for (teeth, module, width, e, bore, single, mean) in table {
        let mut pair = pair(teeth, module, width, e, bore);
        let model = PairModel::new(&pair).unwrap();
        let iso = iso6336::method_b(&pair, &model.geometry);
        // The printed figures do not scale with the modulus beyond their three digits.
        close(&format!("{teeth:?} c' b"), iso.single_n_per_m, single, 0.025);
        close(&format!("{teeth:?} c_gamma b"), iso.mean_n_per_m, mean, 0.025);
        assert!(iso.warning(mesh::summary(&model.curve(), model.geometry.contact_ratio).mean).is_none(), "{teeth:?}");
        pair.body = false;
        let stiff = PairModel::new(&pair).unwrap();
        let unusual = mesh::summary(&stiff.curve(), stiff.geometry.contact_ratio).mean;
        assert!(iso.warning(unusual).is_some(), "without bodies the mesh is far too stiff");
    }
}

#[test]
fn ref_crack_losses_of_the_base_circle_cantilever() {
    // Depth, mm; loss of the pair's stiffness, per cent: mean over the single zone and worst point, without and
    // with bodies (hub radius 10 mm both).
    let table = [
        (0.25, 0.6, 2.0, 0.1, 0.6),
        (0.5, 1.6, 5.6, 0.3, 1.6),
        (1.0, 3.8, 15.6, 0.9, 4.8),
        (1.5, 6.5, 28.0, 1.5, 9.7),
        (2.0, 9.8, 43.0, 2.3, 17.0),
        (2.5, 13.9, 58.0, 3.4, 27.0),
    ];
    let mut pair = pair([19, 48], 3.175, 16.0, 206.8, [20.0, 20.0]);
    pair.root = RootShape::BaseCircle;
    for (depth, mean, worst, mean_body, worst_body) in table {
        let crack =
            Crack { side: Side::Pinion, tooth: 0, depth_m: depth * 1e-3, angle_deg: 70.0, rule: CrackRule::Straight };
        for (body, mean, worst) in [(false, mean, worst), (true, mean_body, worst_body)] {
            pair.body = body;
            let model = PairModel::new(&pair).unwrap();
            let ratio = model.geometry.contact_ratio;
            let loss = |s: f64| 100.0 * (1.0 - model.cracked_at(&crack, s).unwrap() / model.at(s));
            let n = 200;
            let zone = |i: i32| ratio - 1.0 + (2.0 - ratio) * (f64::from(i) + 0.5) / f64::from(n);
            let got_mean = (0..n).map(|i| loss(zone(i))).sum::<f64>() / f64::from(n);
            let got_worst = (0..=n).map(|i| loss(ratio * f64::from(i) / f64::from(n))).fold(0.0, f64::max);
            println!("{depth} mm, body {body}: mean {got_mean:.2} ({mean}) worst {got_worst:.2} ({worst})");
            assert!((got_mean - mean).abs() < 0.06 + 0.02 * mean, "{depth} mm: mean {got_mean} against {mean}");
            assert!((got_worst - worst).abs() < 0.06 + 0.02 * worst, "{depth} mm: worst {got_worst} against {worst}");
        }
    }
}

#[test]
fn theory_crack_weakens_monotonically_and_the_parabola_takes_less() {
    for root in [RootShape::RadialStub, RootShape::Trochoid] {
        let mut pair = from_vector(&vectors()["pair_19_48"]);
        pair.root = root;
        let model = PairModel::new(&pair).unwrap();
        for side in [Side::Pinion, Side::Gear] {
            let mut before = model.at(0.8);
            for depth in [1e-6, 5e-4, 1e-3, 2e-3, 3e-3] {
                let mut crack = Crack { side, tooth: 0, depth_m: depth, angle_deg: 70.0, rule: CrackRule::Straight };
                let straight = model.cracked_at(&crack, 0.8).unwrap();
                crack.rule = CrackRule::Parabolic;
                let parabolic = model.cracked_at(&crack, 0.8).unwrap();
                let round = 1.0 + 1e-12;
                assert!(
                    straight <= before * round && straight <= parabolic * round,
                    "{root:?} {side:?} {depth}: {before:e} {straight:e} {parabolic:e}"
                );
                assert!(parabolic <= model.at(0.8) * (1.0 + 1e-12));
                let curve = model.cracked_curve(&crack).unwrap();
                close("fitted", curve.value(0.8), parabolic, 1e-6);
                before = straight;
            }
        }
        let crack = Crack { side: Side::Pinion, tooth: 0, depth_m: 8e-3, angle_deg: 70.0, rule: CrackRule::Straight };
        assert!(model.cracked_at(&crack, 0.8).unwrap_err().to_string().contains("[crack] depth_m"));
    }
}

fn engagement(kind: EngagementKind) -> Engagement {
    Engagement {
        kind,
        width_rad: None,
        relief_m: None,
        relief_length_base_pitches: None,
        relief_exponent: None,
        torque_n_m: None,
    }
}

#[test]
fn theory_ramp_presets() {
    let model = PairModel::new(&pair([55, 75], 2.0, 20.0, 206.0, [40.0, 54.0])).unwrap();
    let (g, curve) = (&model.geometry, model.curve());
    // "paper": linear over 1 mrad, i.e. 55/2000 pi base pitches, at both ends.
    let paper = engage(&curve, g, &engagement(EngagementKind::Paper)).unwrap();
    let width = 55.0 / (2000.0 * std::f64::consts::PI);
    for u in [0.1, 0.5, 0.9] {
        close("rise", paper.value(u * width), u * model.at(u * width), 1e-8);
        let s = g.contact_ratio - u * width;
        close("fall", paper.value(s), u * model.at(s), 1e-8);
    }
    close("unchanged inside", paper.value(0.9), model.at(0.9), 1e-9);
    let mut cosine = engagement(EngagementKind::RaisedCosine);
    cosine.width_rad = Some(0.01);
    let smooth = engage(&curve, g, &cosine).unwrap();
    let w = g.base_pitches_per_rotation(0.01);
    close("half way", smooth.value(0.5 * w), 0.5 * model.at(0.5 * w), 1e-8);
    assert!(smooth.value(1e-9) < 1e-9 * model.at(0.0));
    let mut wide = engagement(EngagementKind::Linear);
    wide.width_rad = Some(0.2);
    assert!(engage(&curve, g, &wide).unwrap_err().to_string().contains("[engagement] width_rad"));
}

#[test]
fn theory_approach_gap_is_tangent_and_quadratic() {
    let g = Geometry::new(&pair([19, 48], 3.175, 16.0, 206.8, [19.2, 53.0])).unwrap();
    for side in [Side::Pinion, Side::Gear] {
        let kappa = gap_curvature_per_m(&g, side);
        assert!(kappa > 0.0, "{side:?}: {kappa}");
        for s in [0.01, 0.02, 0.04f64] {
            let gap = gap_m(&g, side, s);
            let quadratic = kappa * (s * g.base_pitch_m).powi(2);
            assert!((gap / quadratic - 1.0).abs() < 4.0 * s, "{side:?} {s}: {gap:e} against {quadratic:e}");
        }
    }
}

#[test]
fn theory_loaded_contact_lengthens_the_path_with_the_root_of_the_load() {
    let model = PairModel::new(&pair([19, 48], 3.175, 16.0, 206.8, [19.2, 53.0])).unwrap();
    let (g, curve) = (&model.geometry, model.curve());
    let mut previous: Option<f64> = None;
    for torque in [1.0, 4.0, 16.0] {
        let mut loaded = engagement(EngagementKind::Loaded);
        loaded.torque_n_m = Some(torque);
        let ramped = engage(&curve, g, &loaded).unwrap();
        let early = -ramped.knots()[0];
        // The border is where the gap equals the deflection that the other pairs set.
        let force = torque / g.base_radius_m[0];
        let others =
            curve.value(1.0 - early) + if 2.0 - early < g.contact_ratio { curve.value(2.0 - early) } else { 0.0 };
        close("gap at the border", gap_m(g, Side::Pinion, early), force / others, 1e-6);
        assert!(ramped.value(-early + 1e-6) < 1e-3 * model.at(0.0), "no step at the border");
        if let Some(before) = previous {
            assert!((early / before - 2.0).abs() < 0.25, "four times the load, about twice as early: {early} {before}");
        }
        previous = Some(early);
    }
}

#[test]
fn theory_relieved_pairs_carry_the_whole_static_force() {
    let model = PairModel::new(&pair([19, 48], 3.175, 16.0, 206.8, [19.2, 53.0])).unwrap();
    let (g, curve) = (&model.geometry, model.curve());
    let mut relief = engagement(EngagementKind::TipRelief);
    relief.relief_m = Some([4e-6, 6e-6]);
    relief.relief_length_base_pitches = Some(0.3);
    relief.torque_n_m = Some(10.0);
    let ramped = engage(&curve, g, &relief).unwrap();
    let (first, last) = (ramped.knots()[0], ramped.knots()[ramped.knots().len() - 1]);
    assert!(first > 0.0 && last < g.contact_ratio && last - first > 1.0, "{first} {last}");
    // Sum of secants times deflection is the force: the deflection from the single-contact formula where alone.
    let alone = 0.5 * (last - 1.0 + first + 1.0);
    close("alone and unrelieved", ramped.value(alone), curve.value(alone), 1e-8);
    // Relief that reaches into single contact is a transmission error, not a stiffness: refused, in words.
    relief.relief_length_base_pitches = Some(0.8);
    relief.relief_m = Some([1e-4, 1e-4]);
    relief.torque_n_m = Some(0.1);
    assert!(engage(&curve, g, &relief).unwrap_err().to_string().contains("single contact"));
}

const MACHINE: &str = r#"
title = "t"
[pair]
teeth = [19, 48]
module_m = 0.003175
face_width_m = 0.016
bore_radius_m = [0.0096, 0.0265]
youngs_modulus_pa = 206.8e9
poisson = 0.3
mesh_damping_s = 4e-6
[shafts]
inertia_motor_kg_m2 = 0.0021
inertia_pinion_kg_m2 = 0.00043659
inertia_gear_kg_m2 = 0.0083602
inertia_load_kg_m2 = 0.0105
coupling_stiffness_n_m_per_rad = [44000.0, 44000.0]
coupling_damping_n_m_s_per_rad = [6.0, 20.0]
mass_kg = [0.96, 2.88]
bearing_stiffness_n_per_m = [65600000.0, 65600000.0]
bearing_damping_n_s_per_m = [600.0, 1000.0]
"#;

fn read(text: &str) -> Result<Machine, String> {
    Machine::from_toml(text, "m.toml", Path::new(".")).map_err(|e| e.to_string())
}

#[test]
fn fault_declarations_without_sense_are_refused_with_table_and_key() {
    let table = [
        ("teeth = [19, 48]", "teeth = [2, 48]", "[pair] teeth"),
        ("teeth = [19, 48]", "teeth = [12, 200]", "interference"),
        ("teeth = [19, 48]", "teeth = [19, 100000]", "[pair] teeth"),
        ("poisson = 0.3", "poisson = nan", "[pair].poisson"),
        ("poisson = 0.3", "poisson = 0.3\naddendum_coefficient = 0.5", "contact ratio"),
        ("poisson = 0.3", "poisson = 0.3\nadendum = 0.5", "[pair]"),
        ("module_m = 0.003175", "module_m = -0.003", "[pair] module_m"),
        ("module_m = 0.003175", "", "module_m"),
        ("module_m = 0.003175", "module_m = \"3\"", "[pair]"),
        ("[0.0096, 0.0265]", "[0.04, 0.0265]", "[pair] bore_radius_m[0]"),
        ("mass_kg = [0.96, 2.88]", "mass_kg = [0.96, -2.88]", "[shafts] mass_kg[1]"),
        ("inertia_motor_kg_m2 = 0.0021", "inertia_motor_kg_m2 = inf", "[shafts].inertia_motor_kg_m2"),
        ("mesh_damping_s = 4e-6", "mesh_damping_s = 4e-6\nmesh_damping_ratio = 0.5", "mesh_damping_ratio"),
        ("title = \"t\"", "title = ", "line 2"),
        ("[shafts]", "[engagement]\nkind = \"linear\"\n[shafts]", "[engagement] width_rad"),
        ("[shafts]", "[engagement]\nkind = \"loaded\"\n[shafts]", "[engagement] torque_n_m"),
        ("[shafts]", "[crack]\nside = \"gear\"\ntooth = 48\ndepth_m = 0.001\n[shafts]", "[crack] tooth"),
        ("[shafts]", "[nominal]\nspeed_hz = 0.0\ntorque_n_m = 1.0\n[shafts]", "[nominal] speed_hz"),
        ("[shafts]", "[gearbox]\nx = 1\n[shafts]", "gearbox"),
    ];
    assert!(read(MACHINE).is_ok());
    for (from, to, expected) in table {
        let text = MACHINE.replacen(from, to, 1);
        assert_ne!(text, MACHINE);
        let message = read(&text).expect_err(to);
        assert!(message.contains(expected), "{to}: {message}");
        assert!(message.starts_with("m.toml: ") && !message.contains('\n'), "one line with the file: {message}");
    }
}

#[test]
fn theory_damping_ratio_becomes_a_time() {
    let machine = read(&MACHINE.replace("mesh_damping_s = 4e-6", "mesh_damping_ratio = 0.03")).unwrap();
    let mean = machine.pair_stiffness().unwrap().integral();
    let me = Geometry::new(&machine.pair).unwrap().equivalent_mass_kg(&machine.shafts);
    close("tau", machine.pair.mesh_damping_s, 2.0 * 0.03 * (me / mean).sqrt(), 1e-12);
}

#[test]
fn regress_hash_follows_values_only() {
    let machine = read(MACHINE).unwrap();
    let same =
        read(&MACHINE.replace("0.003175", "3.175e-3 # module").replace("title = \"t\"", "title = \"u\"")).unwrap();
    assert_eq!(machine.hash(), same.hash());
    let other = read(&MACHINE.replace("0.003175", "0.0031750001")).unwrap();
    assert_ne!(machine.hash(), other.hash());
}

#[test]
fn fault_stiffness_tables_name_the_line() {
    let head = "base_pitches_from_contact_start,pair_stiffness_n_per_m\n";
    let table = [
        ("0,0\n0.1,1e8\nx,2\n0.3,1\n", "line 4"),
        ("0,0\n0.1,1e8\n0.05,2\n0.3,1\n", "line 4"),
        ("0,0\n0.1,-1\n0.2,2\n0.3,1\n", "line 3"),
        ("0,0\n0.1,nan\n0.2,2\n0.3,1\n", "line 3"),
        ("0,0\n0.1,1,2\n0.2,2\n0.3,1\n", "line 3"),
        ("0.1,0\n0.2,1\n0.3,2\n0.4,1\n", "line 2"),
        ("0,0\n0.1,1\n", "at least 4"),
        ("0,0\n0.1,0\n0.2,0\n0.3,0\n", "every stiffness is zero"),
    ];
    for (rows, expected) in table {
        let message = Table::parse(&format!("{head}{rows}"), "t.csv").unwrap_err().to_string();
        assert!(message.starts_with("t.csv: ") && message.contains(expected), "{rows}: {message}");
    }
}

#[test]
fn theory_table_fit_follows_smooth_rows_with_few_pieces_and_keeps_kinks() {
    let value = |s: f64| if s < 0.4 { 1e8 * (s / 0.4) } else { 1e8 + 2e7 * (s - 0.4).sin() };
    let rows: String = (0..=800).map(|i| 1.6 * f64::from(i) / 800.0).map(|s| format!("{s},{}\n", value(s))).collect();
    let table = Table::parse(&rows, "t.csv").unwrap();
    let fit = table.fit(1e-6);
    for (s, k) in table.position.iter().zip(&table.stiffness_n_per_m).take(800) {
        assert!((fit.value(*s) - k).abs() <= 1.1e-6 * 1.02e8, "{s}");
    }
    assert!(fit.knots().len() <= 6, "{:?}", fit.knots());
    assert!(fit.knots().iter().any(|k| (k - 0.4).abs() < 2.1e-3), "a knot at the kink");
    let own = PairModel::new(&from_vector(&vectors()["pair_19_48"])).unwrap();
    let length = own.geometry.contact_ratio;
    let rows: String =
        (0..=800).map(|i| length * f64::from(i) / 800.0).map(|s| format!("{s},{}\n", own.at(s))).collect();
    let fit = Table::parse(&rows, "t.csv").unwrap().fit(1e-6);
    assert!(fit.knots().len() <= 6, "{:?}", fit.knots());
    close("between rows", fit.value(0.7001), own.at(0.7001), 2e-6);
}
