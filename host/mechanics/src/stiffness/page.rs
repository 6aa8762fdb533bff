//! `meshband stiffness` as a page: what a pair's stiffness is made of, curves over the mesh period, ISO 6336 beside
//! them.

use super::mesh::{Summary, total};
use super::pair::PairModel;
use super::report::Report;
use crate::Result;
use crate::machine::Machine;
use crate::piecewise::PiecewisePolynomial;
use crate::report::Report as Page;
use crate::report::plot::{self, Axes, Series};

/// Points of a curve.
const POINTS: u32 = 1200;
/// Rows of the table over the path, at most; all of them are in the JSON.
const ROWS: usize = 41;

/// One self-contained page.
///
/// # Errors
/// A stiffness that cannot be worked out, or a picture that cannot be drawn.
pub fn page(report: &Report, machine: &Machine) -> Result<Page> {
    let iso = report.iso_6336_b.mean_n_per_m;
    let mut page = Page::new(
        &format!("Mesh stiffness of {}", report.title),
        &format!("{} and {} teeth, hash {}", machine.pair.teeth[0], machine.pair.teeth[1], report.machine_hash),
    )
    .figure("Contact ratio", format!("{:.4}", report.contact_ratio))
    .figure("Mean stiffness", format!("{:.1} N/um", 1e-6 * report.used.mean))
    .figure("Against ISO 6336-1 B", format!("{:+.1} %", 100.0 * (report.used.mean / iso - 1.0)))
    .figure("Least to largest", format!("{:.1} to {:.1} N/um", 1e-6 * report.used.least, 1e-6 * report.used.largest))
    .figure("Base pitch", format!("{:.4} mm", 1e3 * report.base_pitch_m));
    if let Some(share) = report.cracked_pair_share {
        page = page.figure("Cracked pair", format!("{:.2} % of a healthy one", 100.0 * share));
    }
    page = report.warnings.iter().fold(page, |page, warning| page.note(warning));
    page = curves(page.section("Over the path of contact"), report, machine)?;
    Ok(tables(page, report))
}

/// One pair, and the sum over the pairs in contact.
fn curves(page: Page, report: &Report, machine: &Machine) -> Result<Page> {
    let used = machine.pair_stiffness()?;
    let mesh = total(&used);
    let hard = PairModel::new(&machine.pair)?.curve();
    let [from, to] = report.support;
    let mut pair = vec![
        sampled("by geometry", from.min(0.0), to.max(report.contact_ratio), |s| hard.value(s)),
        sampled("as used", from, to, |s| used.value(s)),
    ];
    if let Some(cracked) = machine.cracked_pair()? {
        let curve: &PiecewisePolynomial = &cracked.curve;
        pair.push(sampled("with the crack", from, to, |s| curve.value(s)));
    }
    let axes = Axes { x: "base pitches from the start of contact", y: "N/um" };
    let one = format!(
        "One pair. As used, it touches from {:.4} to {:.4} base pitches: the engagement ramp is part of it.",
        report.support[0], report.support[1]
    );
    let sum = [sampled("mesh", 0.0, 2.0, |s| mesh.value(s.rem_euclid(1.0)))];
    let caption = format!("Sum over the pairs in contact, two base pitches; {} zones each.", report.zones);
    Ok(page.picture(&plot::lines(&pair, axes)?, &one).picture(&plot::lines(&sum, axes)?, &caption))
}

/// N/um over base pitches, the borders left out by half a step.
fn sampled(name: &str, from: f64, to: f64, curve: impl Fn(f64) -> f64) -> Series {
    let places = (0..POINTS).map(|i| from + (to - from) * (f64::from(i) + 0.5) / f64::from(POINTS));
    Series::new(name, places.map(|s| (s, 1e-6 * curve(s))).collect())
}

fn tables(page: Page, report: &Report) -> Page {
    let n_per_um = |k: f64| format!("{:.2}", 1e-6 * k);
    let summary = |name: &str, s: &Summary| {
        [&[name.to_owned()][..], &[s.mean, s.double_mean, s.single_mean, s.least, s.largest].map(n_per_um)].concat()
    };
    let iso = &report.iso_6336_b;
    let dash = String::from("-");
    let iso = vec![
        "ISO 6336-1 B".into(),
        n_per_um(iso.mean_n_per_m),
        dash.clone(),
        n_per_um(iso.single_n_per_m),
        dash.clone(),
        dash.clone(),
    ];
    let parts = ["pinion", "gear"].iter().zip(&report.at_pitch_point).map(|(name, tooth)| {
        let body = tooth.body.map_or(dash.clone(), n_per_um);
        vec![(*name).into(), n_per_um(tooth.bending), n_per_um(tooth.shear), n_per_um(tooth.axial), body]
    });
    let step = report.rows.len().div_ceil(ROWS).max(1);
    let rows = report.rows.iter().step_by(step).map(|row| {
        let angle = |i: usize| format!("{:.2}", row.load_angle_deg[i]);
        let stiffness = [row.geometric_pair, row.pair, row.mesh].map(n_per_um);
        [&[format!("{:.4}", row.position), angle(0), angle(1)][..], &stiffness].concat()
    });
    page.section("What it is made of")
        .table(
            &format!("At the pitch point, N/um; contact (Hertz) {} N/um.", n_per_um(report.hertz)),
            &["tooth", "bending", "shear", "axial", "gear body"],
            &parts.collect::<Vec<_>>(),
        )
        .table(
            "The mesh, N/um: mean over the period, in double and single contact, extremes.",
            &["", "mean", "double", "single", "least", "largest"],
            &[summary("by geometry", &report.geometric), summary("as used", &report.used), iso],
        )
        .section("Along the path")
        .table(
            "Positions in base pitches, load angles in degrees, stiffness in N/um.",
            &["position", "pinion's angle", "gear's angle", "pair by geometry", "pair as used", "mesh"],
            &rows.collect::<Vec<_>>(),
        )
}
