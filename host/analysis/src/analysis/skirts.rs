//! What lies at the feet of the pair's own lines: a mesh harmonic whose strength swings with load or speed.
//!
//! A harmonic that passes a resonance while the speed wanders is no single line: its foot is filled up to where the
//! swing ends; jitter of the tach does the same. An average takes off the mean only. The foot of each known order is
//! followed outwards as long as the power over short stretches stays well above the floor, on both sides alike
//! ([`Level::foot`]); it is explained like the order itself and taken off before the envelope. Limit: what is not the
//! pair's and stands within a foot is lost; it ends at one order about the mesh and at half the slower shaft's order
//! elsewhere.

use super::angle::Angle;
use super::search::Level;
use crate::spectral;

/// Sidebands about the mesh that have feet.
const SIDEBANDS: i32 = 2;
/// Shaft orders that have feet.
const SHAFT_ORDERS: usize = 10;

/// Intervals of orders, ascending where they begin.
#[derive(Debug, Clone, Default)]
pub struct Skirts(Vec<(f64, f64)>);

impl Skirts {
    /// About zero, shaft orders, mesh harmonics and their sidebands, in the finest of a residual's spectra.
    pub fn of(level: &Level, angle: &Angle, pinion_teeth: u32, highest: f64) -> Self {
        let (teeth, slower) = (f64::from(pinion_teeth), angle.slower_order());
        let mut intervals = Vec::new();
        let mut add = |centre: f64, reach: f64| {
            if centre >= 0.0 && centre <= highest {
                let foot = level.foot(centre, reach);
                intervals.push((centre - foot, centre + foot));
            }
        };
        add(0.0, 0.5 * slower);
        for n in 1..=SHAFT_ORDERS {
            [1.0, angle.gear_order].iter().for_each(|shaft| add(n as f64 * shaft, 0.5 * slower));
        }
        for k in 1..=(highest / teeth) as usize {
            let mesh = k as f64 * teeth;
            add(mesh, 1.0);
            for n in (-SIDEBANDS..=SIDEBANDS).filter(|n| *n != 0).map(f64::from) {
                [1.0, angle.gear_order].iter().for_each(|shaft| add(mesh + n * shaft, 0.5 * slower));
            }
        }
        intervals.retain(|(from, to)| to > from);
        intervals.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(intervals)
    }

    /// About zero, the first orders of the shafts of a train and its mesh lines, each to half the slowest shaft's
    /// order.
    pub fn of_train(level: &Level, slower: f64, shafts: &[f64], meshes: &[f64]) -> Self {
        let of_shafts = shafts.iter().flat_map(|own| (1..=SHAFT_ORDERS).map(move |n| n as f64 * own));
        let foot = |centre: f64| {
            let foot = level.foot(centre, 0.5 * slower);
            (centre - foot, centre + foot)
        };
        let mut intervals: Vec<(f64, f64)> =
            std::iter::once(0.0).chain(of_shafts).chain(meshes.iter().copied()).map(foot).collect();
        intervals.retain(|(from, to)| to > from);
        intervals.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self(intervals)
    }

    /// Whether an order lies in a foot, or within `half_width` of one.
    pub fn at(&self, order: f64, half_width: f64) -> bool {
        let after = self.0.partition_point(|(from, _)| *from <= order + half_width);
        // Feet hardly overlap: the longest is an order either way.
        self.0[..after]
            .iter()
            .rev()
            .take_while(|(from, _)| *from > order - 3.0)
            .any(|(_, to)| *to >= order - half_width)
    }

    /// The samples without what lies in the feet.
    pub fn removed(&self, mut samples: Vec<f64>, per_turn: usize) -> Vec<f64> {
        if self.0.is_empty() {
            return samples;
        }
        let forward = spectral::forward(samples.len());
        let mut bins = forward.make_output_vec();
        forward.process(&mut samples, &mut bins).expect("buffers have the planned lengths");
        let turns = samples.len() as f64 / per_turn as f64;
        let last = bins.len() - 1;
        for (from, to) in &self.0 {
            let range = ((from.max(0.0) * turns).floor() as usize).min(last)..=((to * turns).ceil() as usize).min(last);
            bins[range].fill(Default::default());
        }
        spectral::backward(samples.len()).process(&mut bins, &mut samples).expect("buffers have the planned lengths");
        let scale = 1.0 / samples.len() as f64;
        samples.iter_mut().for_each(|x| *x *= scale);
        samples
    }
}
