//! Mesh stiffness against closed forms, an independent code, ROSS, ISO 6336 and its own limits.

use meshband_host::machine::{Pair, RootShape};
use meshband_host::stiffness::{Geometry, PairModel, Tooth};
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
