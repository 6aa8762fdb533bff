//! A picture of a train as engineers sketch one: shafts as lines, gears as bars of their size across them, sets as
//! sun, planet and ring above one axis.
//!
//! SVG text for reports; a gear says its teeth and order under the pointer. Heights are radii by tooth counts, stage
//! by stage; nothing is to scale between stages.

use super::declaration::Stage;
use super::kinematics::{Gear, Role, Train};
use crate::report::escape;
use std::fmt::Write;

/// Pixels: width of a stage, of a gear, height of a pair's centre distance, margins.
const STAGE: f64 = 150.0;
const GEAR: f64 = 26.0;
const PAIR: f64 = 110.0;
const MARGIN: f64 = 60.0;
const INK: &str = "#1B1F24";
const BLUE: &str = "#0072B2";

/// Where shafts lie and how far the picture reaches.
struct Layout {
    /// Height of each shaft, and where it begins and ends.
    shafts: Vec<(f64, f64, f64)>,
}

impl Layout {
    fn of(train: &Train) -> Self {
        let mut shafts = vec![(MARGIN + PAIR, MARGIN * 0.4, MARGIN + STAGE)];
        for (i, stage) in train.declaration.stages.iter().enumerate() {
            let from = stage.driven_from(i);
            let x = centre(i);
            shafts[from].2 = f64::max(shafts[from].2, x + GEAR);
            let below = match stage {
                Stage::Planetary { .. } => 0.0,
                // A second branch from one shaft goes the other way.
                _ if from != i => -PAIR,
                _ => PAIR,
            };
            let y = shafts[from].0 + below;
            shafts.push((y, if below == 0.0 { x } else { x - GEAR }, x + STAGE * 0.8));
        }
        let highest = shafts.iter().map(|s| s.0).fold(f64::INFINITY, f64::min);
        shafts.iter_mut().for_each(|s| s.0 += (MARGIN + PAIR - highest).max(0.0));
        Self { shafts }
    }
}

fn centre(stage: usize) -> f64 {
    MARGIN + STAGE * (stage as f64 + 0.5)
}

/// The picture.
pub fn svg(train: &Train) -> String {
    let layout = Layout::of(train);
    let width = MARGIN * 2.0 + STAGE * (train.declaration.stages.len() as f64 + 0.6);
    let height = layout.shafts.iter().map(|s| s.0).fold(0.0, f64::max) + PAIR + MARGIN;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"sans-serif\" \
         font-size=\"12\">"
    );
    for (shaft, (y, from, to)) in layout.shafts.iter().enumerate() {
        let _ = write!(
            out,
            "<line x1=\"{from:.1}\" y1=\"{y:.1}\" x2=\"{to:.1}\" y2=\"{y:.1}\" stroke=\"{INK}\" stroke-width=\"4\"/>"
        );
        let order = train.shaft_order(shaft);
        let at = if shaft == 0 { *from } else { to - 4.0 };
        let _ = write!(
            out,
            "<text x=\"{at:.1}\" y=\"{:.1}\" fill=\"{INK}\" text-anchor=\"{}\">shaft {shaft}: {:.4}</text>",
            y - 8.0,
            if shaft == 0 { "start" } else { "end" },
            order.value()
        );
    }
    for (stage, declared) in train.declaration.stages.iter().enumerate() {
        let (from, to) = (layout.shafts[declared.driven_from(stage)].0, layout.shafts[stage + 1].0);
        match declared {
            Stage::Pair { .. } => pair(&mut out, train, stage, from, to),
            Stage::Planetary { planets, .. } => set(&mut out, train, stage, from, *planets),
            Stage::Belt { .. } => {
                let x = centre(stage);
                let _ = write!(
                    out,
                    "<line x1=\"{x}\" y1=\"{from}\" x2=\"{x}\" y2=\"{to}\" stroke=\"{BLUE}\" stroke-dasharray=\"6 \
                     4\" stroke-width=\"3\"/>"
                );
            }
        }
        let words = escape(&format!("stage {}", stage + 1));
        let _ = write!(
            out,
            "<text x=\"{:.1}\" y=\"18\" fill=\"{INK}\" text-anchor=\"middle\">{words}</text>",
            centre(stage)
        );
    }
    out + "</svg>"
}

fn bar(out: &mut String, gear: &Gear, y: f64, [top, bottom]: [f64; 2], x: f64) {
    let order = gear.rate.magnitude();
    let title = escape(&format!("{}: {} teeth, order {order} = {:.5}", gear.words(), gear.teeth, order.value()));
    let _ = write!(
        out,
        "<rect x=\"{:.1}\" y=\"{top:.1}\" width=\"{GEAR}\" height=\"{:.1}\" fill=\"#FFFFFF\" stroke=\"{BLUE}\" \
         stroke-width=\"2\"><title>{title}</title></rect><text x=\"{:.1}\" y=\"{:.1}\" fill=\"{INK}\">{}</text>",
        x - 0.5 * GEAR,
        bottom - top,
        x + 0.6 * GEAR,
        y + 4.0,
        gear.teeth
    );
}

fn pair(out: &mut String, train: &Train, stage: usize, from: f64, to: f64) {
    let gears: Vec<&Gear> = train.gears.iter().filter(|gear| gear.stage == stage).collect();
    let x = centre(stage);
    let sum: f64 = gears.iter().map(|gear| gear.diameter_share(&gears)).sum();
    let way = (to - from).signum();
    let scale = (to - from).abs() / sum.max(f64::MIN_POSITIVE);
    let mut at = from;
    for (i, gear) in gears.iter().enumerate() {
        let radius = scale * gear.diameter_share(&gears) / if i == 0 || i + 1 == gears.len() { 1.0 } else { 2.0 };
        let middle = if i == 0 { from } else { at + way * radius };
        bar(out, gear, middle, [middle - radius, middle + radius], x);
        at = middle + way * radius;
    }
}

fn set(out: &mut String, train: &Train, stage: usize, y: f64, planets: u32) {
    let of = |role: Role| train.gears.iter().find(|gear| gear.stage == stage && gear.role == role);
    let (Some(sun), Some(planet), Some(ring)) = (of(Role::Sun), of(Role::Planet), of(Role::Ring)) else { return };
    let scale = PAIR * 0.85 / (f64::from(ring.teeth) * 0.5);
    let [rs, rp, rr] = [sun, planet, ring].map(|gear| scale * 0.5 * f64::from(gear.teeth));
    let x = centre(stage);
    bar(out, sun, y, [y - rs, y + rs], x);
    bar(out, planet, y - rs - rp, [y - rs - 2.0 * rp, y - rs], x);
    bar(out, ring, y - rr - 9.0, [y - rr - 14.0, y - rr - 2.0], x);
    let (axis, end) = (y - rs - rp, x + 1.6 * GEAR);
    let _ = write!(
        out,
        "<path d=\"M{x:.1} {axis:.1} H{end:.1} V{y:.1}\" fill=\"none\" stroke=\"{INK}\" \
         stroke-width=\"3\"><title>carrier of {planets} planets</title></path>"
    );
}

impl Gear {
    /// Its part of the distance between the first and the last axis of its stage: radius of those, diameter of idlers.
    fn diameter_share(&self, gears: &[&Gear]) -> f64 {
        let is_end = gears.first().is_some_and(|g| *g == self) || gears.last().is_some_and(|g| *g == self);
        f64::from(self.teeth) * if is_end { 1.0 } else { 2.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::tests::{set, train};

    #[test]
    fn every_gear_and_shaft_is_drawn_within_the_picture() {
        let text = "[[stage]]\nkind = \"pair\"\nteeth = [20, 40]\nidlers = [30]\n[[stage]]\nkind = \"pair\"\nteeth = \
            [20, 50]\nfrom = 0\n[[stage]]\nkind = \"belt\"\npulleys_mm = [100, 250]\n";
        for train in [train(text), set("ring", "sun")] {
            let svg = super::svg(&train);
            assert_eq!(svg.matches("<rect").count(), train.gears.len());
            for shaft in 0..train.shafts.len() {
                assert!(svg.contains(&format!("shaft {shaft}:")), "{svg}");
            }
            assert!(!svg.contains("NaN") && !svg.contains("=\"-"), "{svg}");
        }
    }
}
