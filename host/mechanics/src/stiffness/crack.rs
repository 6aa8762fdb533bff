//! A crack from the root of one tooth: the material beside it no longer carries bending and shear.
//!
//! A straight crack of depth q at angle v to the tooth's centre line ends `q sin v` below the root's surface, at
//! half thickness `hc = h_root - q sin v` from the centre line (negative once it has passed the line). A section
//! of half thickness h keeps the thickness `h + min(h, limit)`, where the limit is hc all along (straight rule:
//! Tian 2004, Wu, Zuo and Parey 2008) or a parabola from the crack's end to the tip (Mohammed; Chen and Shao
//! 2011; the straight rule while the crack ends farther out than the tip's half thickness, where such a parabola
//! would cut sound material). The same thickness enters bending, shear and axial terms. Contact and body stay
//! healthy, so real losses are larger; the crack does not breathe (the flank is loaded on one side only).

use super::pair::{PairModel, event_knots, fit_adaptive};
use super::tooth::{Tooth, ToothCompliance};
use crate::machine::{Crack, CrackRule};
use crate::piecewise::PiecewisePolynomial;
use crate::{Error, Result};

/// Deviation of a cracked pair's fitted curve; the dead zone's kinks cost pieces.
const TOLERANCE: f64 = 1e-8;
/// Least thickness that must be left anywhere for a beam to make sense, as a share of the root's.
const MIN_THICKNESS_SHARE: f64 = 0.05;

/// The section that is left at every height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrackedSection {
    /// Half thickness that the crack leaves at its end, m; negative beyond the centre line.
    pub limit_m: f64,
    crack_height: f64,
    tip: (f64, f64),
    rule: CrackRule,
}

impl CrackedSection {
    /// Section of a tooth with a crack.
    ///
    /// # Errors
    /// A crack that leaves less than a twentieth of the root's thickness somewhere.
    pub fn new(tooth: &Tooth, crack: &Crack) -> Result<Self> {
        let [tip, root] = tooth.ends();
        let angle = crack.angle_deg.to_radians();
        let limit_m = root.1 - crack.depth_m * angle.sin();
        // The straight rule cuts every section at the same line, the narrow ones near the tip too.
        let narrowest = match crack.rule {
            CrackRule::Straight => tip.1 + limit_m.min(tip.1),
            CrackRule::Parabolic => root.1 + limit_m.min(root.1),
        };
        if narrowest < MIN_THICKNESS_SHARE * 2.0 * root.1 {
            let deepest = match crack.rule {
                CrackRule::Straight => root.1 * (1.0 - 2.0 * MIN_THICKNESS_SHARE) + tip.1,
                CrackRule::Parabolic => 2.0 * root.1 * (1.0 - MIN_THICKNESS_SHARE),
            };
            return Err(Error::invalid(
                "[crack] depth_m",
                format!(
                    "{} m breaks the tooth off: its root is {:.6} m thick, this rule bears at most {:.6} m",
                    crack.depth_m,
                    2.0 * root.1,
                    deepest / angle.sin()
                ),
            ));
        }
        let crack_height = root.0 + crack.depth_m * angle.cos();
        Ok(Self { limit_m, crack_height, tip, rule: crack.rule })
    }

    /// Thickness left at height `x` where the tooth's half thickness is `half`, m.
    pub fn thickness(&self, x: f64, half: f64) -> f64 {
        let limit = match self.rule {
            CrackRule::Straight => self.limit_m,
            CrackRule::Parabolic => {
                let along = ((x - self.crack_height) / (self.tip.0 - self.crack_height)).clamp(0.0, 1.0);
                self.limit_m + (self.tip.1 - self.limit_m).max(0.0) * along.sqrt()
            }
        };
        half + half.min(limit)
    }
}

impl PairModel {
    /// Compliance of the cracked tooth at a load angle, m/N.
    pub fn cracked_tooth(&self, crack: &Crack, load_angle: f64) -> Result<ToothCompliance> {
        let tooth = &self.teeth[crack.side.index()];
        let section = CrackedSection::new(tooth, crack)?;
        Ok(tooth.compliance_with(load_angle, &|x, half| section.thickness(x, half)))
    }

    /// Stiffness of the pair that holds the cracked tooth, N/m, at `s` base pitches.
    pub fn cracked_at(&self, crack: &Crack, s: f64) -> Result<f64> {
        let (index, angle) = (crack.side.index(), self.geometry.load_angle(s)[crack.side.index()]);
        let healthy = self.teeth[index].compliance(angle).total();
        Ok(1.0 / (self.compliance(s) - healthy + self.cracked_tooth(crack, angle)?.total()))
    }

    /// The curve of the pair that holds the cracked tooth, over the theoretical path.
    pub fn cracked_curve(&self, crack: &Crack) -> Result<PiecewisePolynomial> {
        self.cracked_at(crack, 0.5)?;
        let value = |s: f64| self.cracked_at(crack, s).expect("the crack was checked");
        let kink = self.crack_kink(crack)?;
        Ok(fit_adaptive(event_knots(self.geometry.contact_ratio, kink.as_slice()), TOLERANCE, value))
    }

    /// Path position where the contact passes from the full into the reduced part of the flank, if it does.
    fn crack_kink(&self, crack: &Crack) -> Result<Option<f64>> {
        let index = crack.side.index();
        let limit = CrackedSection::new(&self.teeth[index], crack)?.limit_m;
        let excess = |s: f64| self.teeth[index].half_thickness_at_contact(self.geometry.load_angle(s)[index]) - limit;
        let (mut low, mut high) = (0.0, self.geometry.contact_ratio);
        if excess(low).signum() == excess(high).signum() {
            return Ok(None);
        }
        let rising = excess(high) > 0.0;
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if (excess(middle) > 0.0) == rising { high = middle } else { low = middle }
        }
        Ok(Some(high))
    }
}
