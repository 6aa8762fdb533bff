//! Everything `meshband stiffness` says of a machine: as data, and as a table of text.

use super::mesh::{Summary, summary, total};
use super::pair::PairModel;
use super::{gap_curvature_per_m, iso6336};
use crate::machine::{Machine, Side};
use crate::{Error, Result};
use serde::Serialize;

/// Stiffness of one tooth, part by part, N/m.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ToothParts {
    /// Bending.
    pub bending: f64,
    /// Shear.
    pub shear: f64,
    /// Axial compression.
    pub axial: f64,
    /// Gear body; none where bodies are left out.
    pub body: Option<f64>,
}

/// One position on the theoretical path of contact.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Row {
    /// Base pitches from the start of contact.
    pub position: f64,
    /// Load angles on pinion and gear, degrees.
    pub load_angle_deg: [f64; 2],
    /// Pinion's and gear's tooth.
    pub teeth: [ToothParts; 2],
    /// The pair by its geometry alone, N/m.
    pub geometric_pair: f64,
    /// The pair as the equations of motion use it (table, engagement), N/m.
    pub pair: f64,
    /// Sum over the pairs in contact, N/m.
    pub mesh: f64,
}

/// The whole report.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// The machine's title.
    pub title: String,
    /// Fingerprint of the machine, as carried by its laws.
    pub machine_hash: String,
    /// Theoretical length of the path of contact, base pitches.
    pub contact_ratio: f64,
    /// Base radii, m.
    pub base_radius_m: [f64; 2],
    /// Centre distance, m.
    pub centre_distance_m: f64,
    /// Base pitch, m.
    pub base_pitch_m: f64,
    /// Pitch point, base pitches from the start of contact.
    pub pitch_point: f64,
    /// Contact stiffness, N/m.
    pub hertz: f64,
    /// Curvature of the approach gap at start and end of the path, 1/m.
    pub approach_curvature_per_m: [f64; 2],
    /// Tooth parts at the pitch point, N/m.
    pub at_pitch_point: [ToothParts; 2],
    /// By geometry, hard engagement.
    pub geometric: Summary,
    /// As used in the equations of motion.
    pub used: Summary,
    /// The pair with the cracked tooth, where one is declared: mean of its curve over the path relative to the
    /// healthy one.
    pub cracked_pair_share: Option<f64>,
    /// First and last contact of the pair in use, base pitches.
    pub support: [f64; 2],
    /// Zones of the total per base pitch.
    pub zones: usize,
    /// ISO 6336-1 method B.
    pub iso_6336_b: iso6336::MethodB,
    /// What deserves attention.
    pub warnings: Vec<String>,
    /// Along the theoretical path.
    pub rows: Vec<Row>,
}

impl Report {
    /// Works out the report with `points` rows over the path (2 to 100 000).
    pub fn new(machine: &Machine, points: usize) -> Result<Self> {
        if !(2..=100_000).contains(&points) {
            return Err(Error::invalid("--points", format!("{points} is not between 2 and 100000")));
        }
        let model = PairModel::new(&machine.pair)?;
        let g = &model.geometry;
        let used = machine.pair_stiffness()?;
        let mesh = total(&used);
        let geometric = summary(&model.curve(), g.contact_ratio);
        let iso = iso6336::method_b(&machine.pair, g);
        let used_summary = summary(&used, g.contact_ratio);
        let sides = [Side::Pinion, Side::Gear];
        let mut warnings = Vec::new();
        for (body, name) in model.bodies.iter().zip(["pinion", "gear"]).filter(|_| model.with_body) {
            warnings.extend(body.warnings().into_iter().map(|w| format!("{name}: {w}")));
        }
        warnings.extend(iso.warning(used_summary.mean));
        let table_length = used.knots()[used.knots().len() - 1];
        if machine.pair.pair_stiffness.is_some() && (table_length - g.contact_ratio).abs() > 0.02 * g.contact_ratio {
            let what = format!(
                "the table covers {table_length:.4} base pitches, the geometry's contact ratio is {:.4}",
                g.contact_ratio
            );
            warnings.push(what);
        }
        let rows = (0..points)
            .map(|i| g.contact_ratio * i as f64 / (points - 1) as f64)
            .map(|s| Row {
                position: s,
                load_angle_deg: g.load_angle(s).map(f64::to_degrees),
                teeth: parts(&model, s),
                geometric_pair: model.at(s),
                pair: used.value(s),
                mesh: mesh.value(s.rem_euclid(1.0)),
            })
            .collect();
        let cracked_pair_share = machine.cracked_pair()?.map(|c| c.curve.integral() / used.integral());
        Ok(Self {
            title: machine.title.clone(),
            machine_hash: format!("{:016x}", machine.hash()),
            contact_ratio: g.contact_ratio,
            base_radius_m: g.base_radius_m,
            centre_distance_m: g.centre_distance_m,
            base_pitch_m: g.base_pitch_m,
            pitch_point: g.pitch_point(),
            hertz: model.hertz_n_per_m,
            approach_curvature_per_m: sides.map(|side| gap_curvature_per_m(g, side)),
            at_pitch_point: parts(&model, g.pitch_point()),
            geometric,
            used: used_summary,
            cracked_pair_share,
            support: [used.knots()[0], table_length],
            zones: mesh.knots().len() - 1,
            iso_6336_b: iso,
            warnings,
            rows,
        })
    }
}

fn parts(model: &PairModel, s: f64) -> [ToothParts; 2] {
    let angles = model.geometry.load_angle(s);
    [0, 1].map(|i| {
        let c = model.teeth[i].compliance(angles[i]);
        let body = model.with_body.then(|| 1.0 / model.bodies[i].at(angles[i]));
        ToothParts { bending: 1.0 / c.bending, shear: 1.0 / c.shear, axial: 1.0 / c.axial, body }
    })
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(
            f,
            "{}: contact ratio {:.5}, base pitch {:.4} mm",
            self.title,
            self.contact_ratio,
            1e3 * self.base_pitch_m
        )?;
        writeln!(f, "\nAt the pitch point, 1e8 N/m (contact {:.3})", self.hertz / 1e8)?;
        writeln!(f, "tooth     bending     shear     axial      body")?;
        for (name, t) in ["pinion", "gear"].iter().zip(&self.at_pitch_point) {
            let body = t.body.map_or("-".into(), |b| format!("{:.4}", b / 1e8));
            writeln!(f, "{name:8}{:9.4} {:9.4} {:9.4} {body:>9}", t.bending / 1e8, t.shear / 1e8, t.axial / 1e8)?;
        }
        writeln!(f, "\nMesh, 1e8 N/m        mean    double    single     least   largest")?;
        for (name, s) in [("by geometry", &self.geometric), ("as used", &self.used)] {
            let [a, b, c, d, e] = [s.mean, s.double_mean, s.single_mean, s.least, s.largest].map(|k| k / 1e8);
            writeln!(f, "{name:16}{a:9.4} {b:9.4} {c:9.4} {d:9.4} {e:9.4}")?;
        }
        let iso = &self.iso_6336_b;
        writeln!(f, "{:16}{:9.4} {:>9} {:9.4}", "ISO 6336 B", iso.mean_n_per_m / 1e8, "", iso.single_n_per_m / 1e8)?;
        writeln!(
            f,
            "\nContact of one pair from {:.4} to {:.4} base pitches, {} zones per base pitch",
            self.support[0], self.support[1], self.zones
        )?;
        if let Some(share) = self.cracked_pair_share {
            writeln!(f, "Cracked pair: {:.2} % of the healthy pair's stiffness, mean over its contact", 100.0 * share)?;
        }
        writeln!(f, "\nposition  pair by geometry   pair as used          mesh   N/m")?;
        for r in &self.rows {
            writeln!(f, "{:8.4}  {:16.6e} {:14.6e} {:13.6e}", r.position, r.geometric_pair, r.pair, r.mesh)?;
        }
        Ok(())
    }
}
