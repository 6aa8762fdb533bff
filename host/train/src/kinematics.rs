//! Shafts, gears and meshes of a train with their speeds, in exact fractions of the input's.
//!
//! A pair turns its driven gear the other way (an internal one the same way, every idler once more). A planetary set
//! follows Willis: `ws zs + wr zr = wc (zs + zr)`; a planet turns against its carrier at `-(ws - wc) zs / zp`. Signs
//! say which way; orders are magnitudes. Limit: behind a belt the fractions are those of its declared slip, which no
//! belt keeps.

use super::declaration::{Declaration, Member, Stage};
use super::fraction::Fraction;
use crate::Result;

/// What a gear is in its stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Role {
    /// Driver of a pair.
    Pinion,
    /// Driven gear of a pair.
    Gear,
    /// Idler, by number from 1.
    Idler(u8),
    /// Sun of a set.
    Sun,
    /// Any planet of a set.
    Planet,
    /// Ring of a set.
    Ring,
}

impl Role {
    /// In words.
    pub fn word(self) -> String {
        match self {
            Self::Pinion => "pinion".into(),
            Self::Gear => "gear".into(),
            Self::Idler(number) => format!("idler {number}"),
            Self::Sun => "sun".into(),
            Self::Planet => "planet".into(),
            Self::Ring => "ring".into(),
        }
    }
}

/// One gear.
#[derive(Debug, Clone, PartialEq)]
pub struct Gear {
    /// Stage, from 0.
    pub stage: usize,
    /// What it is there.
    pub role: Role,
    /// Teeth.
    pub teeth: u32,
    /// Its shaft; none of an idler, a planet and what stands still.
    pub shaft: Option<usize>,
    /// Speed in the housing.
    pub speed: Fraction,
    /// Speed against the centres of its mesh: its own of a pair, that against the carrier of a set.
    pub rate: Fraction,
    /// Times that one of its teeth meets another gear per turn of `rate`.
    pub contacts: u32,
}

impl Gear {
    /// "pinion of stage 2".
    pub fn words(&self) -> String {
        format!("{} of stage {}", self.role.word(), self.stage + 1)
    }
}

/// The carrier of a set.
#[derive(Debug, Clone, PartialEq)]
pub struct Carrier {
    /// Speed in the housing.
    pub speed: Fraction,
    /// Speed against the ring.
    pub against_ring: Fraction,
    /// Planets.
    pub planets: u32,
    /// Teeth of the ring.
    pub ring: u32,
    /// Places of the planets, turns of the carrier; none where evenly spaced.
    pub spacing: Option<Vec<f64>>,
}

/// One mesh line: all meshes of a stage have it.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// Stage, from 0.
    pub stage: usize,
    /// Order.
    pub order: Fraction,
    /// Its gears, by index.
    pub gears: Vec<usize>,
    /// Carrier, of a planetary set.
    pub carrier: Option<Carrier>,
    /// Helix angle, degrees.
    pub helix_angle_deg: f64,
    /// Whether its order is exact: no belt before it.
    pub exact: bool,
}

/// A train with everything that follows from its declaration.
#[derive(Debug, Clone, PartialEq)]
pub struct Train {
    /// What it is made of.
    pub declaration: Declaration,
    /// Signed speed of every shaft.
    pub shafts: Vec<Fraction>,
    /// Whether it is exact.
    pub exact: Vec<bool>,
    /// All gears.
    pub gears: Vec<Gear>,
    /// One per stage with teeth.
    pub meshes: Vec<Mesh>,
}

/// Parts into which diameters and slips are taken: micrometres, millionths.
const PARTS: f64 = 1000.0;
const MILLIONTHS: f64 = 1e6;

impl Train {
    /// Reads a train file.
    ///
    /// # Errors
    /// As [`Declaration::read`] and [`Train::of`].
    pub fn read(path: &std::path::Path) -> Result<Self> {
        Self::of(Declaration::read(path)?)
    }

    /// From a declaration.
    ///
    /// # Errors
    /// Ratios beyond 128 bits, a stage that does not turn.
    pub fn of(declaration: Declaration) -> Result<Self> {
        let mut train = Self {
            shafts: vec![Fraction::ONE],
            exact: vec![true],
            gears: Vec::new(),
            meshes: Vec::new(),
            declaration: Declaration::default(),
        };
        for (index, stage) in declaration.stages.iter().enumerate() {
            let from = stage.driven_from(index);
            let (input, exact) = (train.shafts[from], train.exact[from]);
            match stage {
                Stage::Pair { .. } => train.add_pair(index, stage, (from, input), exact)?,
                Stage::Planetary { .. } => train.add_set(index, stage, (from, input), exact)?,
                Stage::Belt { pulleys_mm, slip, .. } => {
                    let whole = |x: f64| Fraction::whole(x.round() as i64);
                    let ratio = whole(pulleys_mm[0] * PARTS).over(whole(pulleys_mm[1] * PARTS))?;
                    let kept = whole(MILLIONTHS * (1.0 - slip)).over(whole(MILLIONTHS))?;
                    train.shafts.push(input.times(ratio)?.times(kept)?);
                    train.exact.push(false);
                }
            }
        }
        Ok(Self { declaration, ..train })
    }

    fn add_pair(&mut self, index: usize, stage: &Stage, (from, input): (usize, Fraction), exact: bool) -> Result<()> {
        let Stage::Pair { teeth, idlers, internal, helix_angle_deg, .. } = stage else { return Ok(()) };
        let order = input.magnitude().multiple(teeth[0].into())?;
        let first = self.gears.len();
        let gear =
            |role, teeth, shaft, speed| Gear { stage: index, role, teeth, shaft, speed, rate: speed, contacts: 1 };
        self.gears.push(gear(Role::Pinion, teeth[0], Some(from), input));
        let mut way = input.sign();
        for (i, z) in idlers.iter().enumerate() {
            way = -way;
            let speed = order.multiple(way)?.over(Fraction::whole((*z).into()))?;
            let idler = gear(Role::Idler(i as u8 + 1), *z, None, speed);
            // An idler's tooth meets both neighbours.
            self.gears.push(Gear { contacts: 2, ..idler });
        }
        way = if *internal { way } else { -way };
        let output = order.multiple(way)?.over(Fraction::whole(teeth[1].into()))?;
        self.gears.push(gear(Role::Gear, teeth[1], Some(index + 1), output));
        self.shafts.push(output);
        self.exact.push(exact);
        self.meshes.push(Mesh {
            stage: index,
            order,
            gears: (first..self.gears.len()).collect(),
            carrier: None,
            helix_angle_deg: *helix_angle_deg,
            exact,
        });
        Ok(())
    }

    fn add_set(&mut self, index: usize, stage: &Stage, (from, input): (usize, Fraction), exact: bool) -> Result<()> {
        let Stage::Planetary { sun, planet, ring, planets, fixed, input: driven, spacing_deg, helix_angle_deg, .. } =
            stage
        else {
            return Ok(());
        };
        let output_member = output(*fixed, *driven);
        let [sun_speed, ring_speed, carrier_speed] = willis([*sun, *ring], (*fixed, *driven), input)?;
        let shaft_of = |member: Member| {
            if member == *driven { Some(from) } else { (member == output_member).then_some(index + 1) }
        };
        let [sun_rate, ring_rate] = [sun_speed.minus(carrier_speed)?, ring_speed.minus(carrier_speed)?];
        let planet_rate = sun_rate.multiple(-i64::from(*sun))?.over(Fraction::whole((*planet).into()))?;
        let order = sun_rate.magnitude().multiple((*sun).into())?;
        let first = self.gears.len();
        let gear = |role, teeth, shaft, speed, rate, contacts| Gear {
            stage: index,
            role,
            teeth,
            shaft,
            speed,
            rate,
            contacts,
        };
        self.gears.push(gear(Role::Sun, *sun, shaft_of(Member::Sun), sun_speed, sun_rate, *planets));
        self.gears.push(gear(Role::Planet, *planet, None, planet_rate.plus(carrier_speed)?, planet_rate, 2));
        self.gears.push(gear(Role::Ring, *ring, shaft_of(Member::Ring), ring_speed, ring_rate, *planets));
        self.shafts.push(match output_member {
            Member::Sun => sun_speed,
            Member::Ring => ring_speed,
            Member::Carrier => carrier_speed,
        });
        self.exact.push(exact);
        self.meshes.push(Mesh {
            stage: index,
            order,
            gears: (first..self.gears.len()).collect(),
            carrier: Some(Carrier {
                speed: carrier_speed,
                against_ring: carrier_speed.minus(ring_speed)?,
                planets: *planets,
                ring: *ring,
                spacing: spacing_deg.as_ref().map(|all| all.iter().map(|deg| deg / 360.0).collect()),
            }),
            helix_angle_deg: *helix_angle_deg,
            exact,
        });
        Ok(())
    }

    /// Order of a shaft.
    pub fn shaft_order(&self, shaft: usize) -> Fraction {
        self.shafts[shaft].magnitude()
    }

    /// Gears on a shaft, by index.
    pub fn gears_on(&self, shaft: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.gears.len()).filter(move |g| self.gears[*g].shaft == Some(shaft))
    }

    /// What a shaft is, in words: "shaft 1 (gear of stage 1, pinion of stage 2)".
    pub fn shaft_words(&self, shaft: usize) -> String {
        let mut on: Vec<String> = self.gears_on(shaft).map(|g| self.gears[g].words()).collect();
        for mesh in self.meshes.iter().filter(|mesh| mesh.carrier.is_some()) {
            let (from, to) = (self.declaration.stages[mesh.stage].driven_from(mesh.stage), mesh.stage + 1);
            let carries = |shaft: usize| mesh.gears.iter().all(|g| self.gears[*g].shaft != Some(shaft));
            if (shaft == from || shaft == to) && carries(shaft) {
                on.push(format!("carrier of stage {}", mesh.stage + 1));
            }
        }
        if on.is_empty() { format!("shaft {shaft}") } else { format!("shaft {shaft} ({})", on.join(", ")) }
    }

    /// The mesh of a stage.
    pub fn mesh(&self, stage: usize) -> Option<&Mesh> {
        self.meshes.iter().find(|mesh| mesh.stage == stage)
    }
}

/// The member that neither stands still nor is driven.
fn output(fixed: Member, driven: Member) -> Member {
    let is_free = |member: &Member| *member != fixed && *member != driven;
    [Member::Sun, Member::Ring, Member::Carrier].into_iter().find(is_free).unwrap_or(Member::Carrier)
}

/// Speeds of sun, ring and carrier.
fn willis([sun, ring]: [u32; 2], (fixed, driven): (Member, Member), input: Fraction) -> Result<[Fraction; 3]> {
    let [zs, zr] = [sun, ring].map(|z| Fraction::whole(z.into()));
    let both = zs.plus(zr)?;
    let given = |member: Member| match member {
        m if m == fixed => Some(Fraction::ZERO),
        m if m == driven => Some(input),
        _ => None,
    };
    let (ws, wr, wc) = (given(Member::Sun), given(Member::Ring), given(Member::Carrier));
    Ok(match (ws, wr, wc) {
        (Some(ws), Some(wr), _) => [ws, wr, ws.times(zs)?.plus(wr.times(zr)?)?.over(both)?],
        (Some(ws), _, Some(wc)) => [ws, wc.times(both)?.minus(ws.times(zs)?)?.over(zr)?, wc],
        (_, wr, wc) => {
            let (wr, wc) = (wr.unwrap_or(Fraction::ZERO), wc.unwrap_or(Fraction::ZERO));
            [wc.times(both)?.minus(wr.times(zr)?)?.over(zs)?, wr, wc]
        }
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub fn train(text: &str) -> Train {
        Train::of(Declaration::parse(text, "train.toml").expect("a declaration")).expect("a train")
    }

    pub fn set(fixed: &str, input: &str) -> Train {
        train(&format!(
            "[[stage]]\nkind = \"planetary\"\nsun = 31\nplanet = 32\nring = 95\nplanets = 3\nfixed \
             = \"{fixed}\"\ninput = \"{input}\"\n"
        ))
    }

    #[test]
    fn theory_willis_equation_gives_every_ratio_of_a_planetary_set() {
        // Textbook ratios: 1 + zr/zs for a fixed ring, -zr/zs for a fixed carrier, 1 + zs/zr for a fixed sun.
        let ratios = [
            ("ring", "sun", Fraction::new(31, 126)),
            ("ring", "carrier", Fraction::new(126, 31)),
            ("carrier", "sun", Fraction::new(-31, 95)),
            ("carrier", "ring", Fraction::new(-95, 31)),
            ("sun", "ring", Fraction::new(95, 126)),
            ("sun", "carrier", Fraction::new(126, 95)),
        ];
        for (fixed, input, ratio) in ratios {
            let train = set(fixed, input);
            assert_eq!(train.shafts[1], ratio, "{fixed} fixed, {input} driven");
            let [sun, planet, ring] = [0, 1, 2].map(|g| &train.gears[g]);
            let carrier = train.meshes[0].carrier.as_ref().expect("a carrier");
            // Each gear passes as many teeth against the carrier as the others.
            for gear in [sun, planet, ring] {
                let passed = gear.rate.magnitude().multiple(gear.teeth.into()).unwrap();
                assert_eq!(passed, train.meshes[0].order, "{} with {fixed} fixed", gear.words());
            }
            let left = sun.speed.multiple(31).unwrap().plus(ring.speed.multiple(95).unwrap()).unwrap();
            assert_eq!(left, carrier.speed.multiple(126).unwrap());
        }
    }

    #[test]
    fn theory_exact_fractions_agree_with_doubles_through_four_stages() {
        let text = "[[stage]]\nkind = \"pair\"\nteeth = [29, 74]\n[[stage]]\nkind = \"planetary\"\nsun = 24\nplanet \
            = 30\nring = 84\nplanets = 4\nfixed = \"ring\"\ninput = \"sun\"\n[[stage]]\nkind = \"pair\"\nteeth = \
            [18, 83]\nidlers = [41]\n[[stage]]\nkind = \"pair\"\nteeth = [17, 91]\ninternal = true\n";
        let train = train(text);
        let doubles = [1.0, 29.0 / 74.0, 29.0 / 74.0 * 24.0 / 108.0, 29.0 / 74.0 * 24.0 / 108.0 * 18.0 / 83.0];
        for (shaft, value) in doubles.iter().enumerate() {
            assert!((train.shaft_order(shaft).value() / value - 1.0).abs() < 4.0 * f64::EPSILON, "shaft {shaft}");
        }
        // Directions: a pair turns, a set with a fixed ring keeps, an idler keeps, an internal gear keeps.
        let signs: Vec<i64> = train.shafts.iter().map(|s| s.sign()).collect();
        assert_eq!(signs, [1, -1, -1, -1, -1]);
        assert_eq!(train.shafts[4].denominator() % 83, 0);
        let idler = train.gears.iter().find(|g| g.role == Role::Idler(1)).expect("an idler");
        assert_eq!(idler.rate.magnitude().multiple(41).unwrap(), train.mesh(2).unwrap().order);
    }

    #[test]
    fn parallel_branches_and_belts_are_taken_from_the_shaft_they_name() {
        let train = train(
            "[[stage]]\nkind = \"pair\"\nteeth = [20, 40]\n[[stage]]\nkind = \"pair\"\nteeth = [20, 50]\nfrom = \
             0\n[[stage]]\nkind = \"belt\"\npulleys_mm = [100, 250]\nslip = 0.01\nfrom = 1\n",
        );
        assert_eq!(train.shaft_order(2), Fraction::new(2, 5));
        assert_eq!(train.shaft_order(3), Fraction::new(99, 500));
        assert_eq!(train.exact, [true, true, true, false]);
        assert_eq!(train.shaft_words(0), "shaft 0 (pinion of stage 1, pinion of stage 2)");
    }

    #[test]
    fn fault_declarations_are_refused_with_table_and_key() {
        let refused = |text: &str| Declaration::parse(text, "t.toml").expect_err("refused").to_string();
        let pair = "[[stage]]\nkind = \"pair\"\nteeth = [20, 40]\n";
        for (text, words) in [
            ("title = \"x\"\n".to_owned(), "[[stage]]"),
            ("[[stage]]\nkind = \"pair\"\nteeth = [2, 40]\n".into(), "tooth count"),
            ("[[stage]]\nkind = \"worm\"\n".into(), "[[stage]] 1"),
            (format!("{pair}module = 3\n"), "module"),
            (format!("{pair}[tach]\nshaft = 2\npulses_per_turn = 1\n"), "no shaft"),
            (format!("{pair}from = 1\n"), "from"),
            (format!("{pair}[gearbox]\nname = 1\n"), "gearbox"),
            (
                "[[stage]]\nkind = \"planetary\"\nsun = 30\nplanet = 20\nring = 70\nplanets = 3\nfixed \
                 = \"ring\"\ninput = \"ring\"\n"
                    .into(),
                "cannot be driven",
            ),
        ] {
            let error = refused(&text);
            assert!(error.contains(words) && error.contains("t.toml") && error.lines().count() == 1, "{error}");
        }
    }
}
