//! What the phasing of planets lets a sound planetary set show.
//!
//! Planet `i` at angle `psi_i` on the carrier meshes with phase `zr psi_i` and passes a place on the housing with
//! phase `psi_i`. Harmonic `k` of the mesh modulated `n` times by the carrier is the sum over planets of
//! `exp(j (k zr + n) psi_i)`: of `N` alike, evenly spaced planets only `k zr + n` a multiple of `N` stands (McFadden
//! and Smith 1985; Inalpolat and Kahraman 2009). Without the carrier's turning the same sum with `k zs` says which
//! modes a harmonic excites: 0 rotational, 1 and N-1 translational, the rest planet modes (Parker 2000).

use super::fraction::Fraction;
use super::kinematics::{Carrier, Mesh};
use crate::Result;
use std::f64::consts::TAU;

/// Share of the sum over all planets below which a line does not stand of a sound set.
const LEAST_SHARE: f64 = 0.02;

/// Motion that a mesh harmonic of a symmetric set excites.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum SymmetryClass {
    /// Sun, ring and carrier turn; forces across cancel.
    Rotational,
    /// They are pushed across; torques cancel.
    Translational,
    /// Planets alone move.
    Planet,
}

/// Class of mesh harmonic `k` of a set of `planets` about a sun of `sun` teeth.
pub fn symmetry_class(sun: u32, planets: u32, k: u32) -> SymmetryClass {
    match (k * sun) % planets.max(1) {
        0 => SymmetryClass::Rotational,
        rest if rest == 1 || rest + 1 == planets => SymmetryClass::Translational,
        _ => SymmetryClass::Planet,
    }
}

/// Share, 0 to 1, of a sideband's full strength that a sound set shows: harmonic `k` of the mesh, `n` times the
/// carrier above it.
pub fn share(carrier: &Carrier, k: i64, n: i64) -> f64 {
    let number = (k * i64::from(carrier.ring) + n) as f64;
    let place = |i: u32| match &carrier.spacing {
        Some(spacing) => spacing[i as usize],
        None => f64::from(i) / f64::from(carrier.planets),
    };
    let turns = (0..carrier.planets).map(|i| number * place(i));
    let (re, im) = turns.fold((0.0, 0.0), |(re, im), t| (re + (TAU * t).cos(), im + (TAU * t).sin()));
    f64::hypot(re, im) / f64::from(carrier.planets)
}

/// Whether it stands.
pub fn stands(carrier: &Carrier, k: i64, n: i64) -> bool {
    share(carrier, k, n) > LEAST_SHARE
}

/// Order of harmonic `k` of the mesh, `n` times the carrier above it in the sense in which the phasing counts.
///
/// # Errors
/// Beyond 128 bits.
pub fn order(mesh: &Mesh, carrier: &Carrier, k: i64, n: i64) -> Result<Fraction> {
    let way = carrier.speed.sign() * carrier.against_ring.sign();
    mesh.order.multiple(k)?.plus(carrier.speed.magnitude().multiple(n * way)?)
}

/// Whether evenly spaced planets can be put in: `zs + zr` is a multiple of their number; of declared places, each
/// must be a whole number of teeth.
pub fn can_be_assembled(sun: u32, carrier: &Carrier) -> bool {
    let both = f64::from(sun + carrier.ring);
    match &carrier.spacing {
        None => (sun + carrier.ring).is_multiple_of(carrier.planets),
        // A hundredth of a tooth: declared degrees are rounded.
        Some(spacing) => spacing.iter().all(|place| {
            let teeth = (place - spacing[0]) * both;
            (teeth - teeth.round()).abs() < 0.01
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::super::kinematics::tests::{set, train};
    use super::*;

    fn numbers(carrier: &Carrier, k: i64) -> Vec<i64> {
        (-6..=6).filter(|n| stands(carrier, k, *n)).collect()
    }

    #[test]
    fn theory_a_sound_set_shows_multiples_of_the_planet_pass_only() {
        // 95 teeth of the ring, three planets: the first harmonic itself is not among its own lines (McFadden and
        // Smith's example in kind).
        let train = set("ring", "sun");
        let carrier = train.meshes[0].carrier.as_ref().unwrap();
        assert_eq!(numbers(carrier, 1), [-5, -2, 1, 4]);
        assert_eq!(numbers(carrier, 3), [-6, -3, 0, 3, 6]);
        for (k, n) in [(1, 1), (1, -2), (2, 2), (4, -2)] {
            let order = order(&train.meshes[0], carrier, k, n).unwrap();
            let pass = carrier.speed.magnitude().multiple(3).unwrap();
            assert_eq!(order.over(pass).unwrap().denominator(), 1, "{order} is no multiple of the planet pass");
        }
    }

    #[test]
    fn theory_symmetry_classes_are_those_of_parker() {
        use SymmetryClass::{Planet, Rotational, Translational};
        let classes = |sun, planets| (1..=4).map(|k| symmetry_class(sun, planets, k)).collect::<Vec<_>>();
        assert_eq!(classes(24, 4), [Rotational; 4], "in phase");
        assert_eq!(classes(31, 3), [Translational, Translational, Rotational, Translational]);
        assert_eq!(classes(25, 4), [Translational, Planet, Translational, Rotational]);
        assert_eq!(classes(27, 5), [Planet, Translational, Translational, Planet]);
    }

    #[test]
    fn theory_the_sense_of_sidebands_turns_where_the_ring_drives() {
        let of = |fixed: &str, input: &str| {
            let train = set(fixed, input);
            let mesh = &train.meshes[0];
            let order = order(mesh, mesh.carrier.as_ref().unwrap(), 1, 1).unwrap();
            order.minus(mesh.order).unwrap().sign()
        };
        assert_eq!([of("ring", "sun"), of("ring", "carrier"), of("sun", "ring"), of("carrier", "sun")], [1, 1, -1, 0]);
    }

    #[test]
    fn theory_uneven_planets_show_what_even_ones_hide_and_assembly_is_checked() {
        let even = set("ring", "sun");
        assert!(can_be_assembled(31, even.meshes[0].carrier.as_ref().unwrap()));
        let text = "[[stage]]\nkind = \"planetary\"\nsun = 30\nplanet = 33\nring = 96\nplanets = 4\nfixed \
            = \"ring\"\ninput = \"sun\"\n";
        let cannot = train(text);
        assert!(!can_be_assembled(30, cannot.meshes[0].carrier.as_ref().unwrap()));
        // Opposite pairs, 32 and 31 teeth of 126 apart.
        let placed = |deg: f64| train(&format!("{text}spacing_deg = [0, {deg}, 180, {}]\n", 180.0 + deg));
        let uneven = placed(360.0 * 32.0 / 126.0);
        let carrier = uneven.meshes[0].carrier.as_ref().unwrap();
        assert!(can_be_assembled(30, carrier));
        let even = share(cannot.meshes[0].carrier.as_ref().unwrap(), 1, 2);
        let shown = share(carrier, 1, 2);
        assert!(even < 1e-9 && (shown - 0.9397).abs() < 1e-3, "{even} {shown}");
        assert!(!can_be_assembled(30, placed(91.0).meshes[0].carrier.as_ref().unwrap()));
    }
}
