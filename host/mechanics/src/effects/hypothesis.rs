//! What the loop and its campaigns make of an effect, said in the effect's own file: where it acts on the linear
//! machine, under which name, how a fit goes back to the simulator, and what a campaign hides.
//!
//! A [`Seat`] is the place where the physics of the effect, linearised, enters the machine or its measuring path; its
//! response is computed once for all effects that share it (`closed_loop::library`). The strong effect is never
//! linearised twice: what is simulated at a finite strength, and what `loop --apply` writes, are the tables that
//! [`Hypothesis::carry`] gives.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Where an external force acts on the linear machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Site {
    /// Torque on the motor.
    Motor,
    /// Torque on the load.
    Load,
    /// Force on body 0 or 1 along the line of action.
    Along(usize),
}

/// What of the machine varies sinusoidally, at an order of the pinion or a fixed frequency.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wave {
    /// Displacement between the flanks, m.
    Displacement,
    /// The same, which also rolls the contact along its path by as much.
    RollingDisplacement,
    /// Force or torque that goes with these powers of speed (rad/s of the wave) and of the mean torque at its place.
    Force {
        /// Where.
        at: Site,
        /// Power of speed.
        speed: i32,
        /// Power of torque.
        torque: i32,
    },
    /// Stiffness of the bearing of body 0 or 1, as a share.
    BearingStiffness(usize),
    /// Stiffness of the mesh, as a share.
    MeshStiffness,
    /// Place of all contacts on their path, base pitches.
    Position,
}

/// What of one tooth is not as declared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tooth {
    /// Its place, m.
    Displaced,
    /// The stiffness of its pair, share lost.
    Softened,
}

/// What of a channel's path is not as declared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// A mode beside the direct path, complex gain.
    Mode,
    /// A delay within 200 us.
    Delay,
    /// The signal once more, later.
    Echo,
    /// A gain that changes linearly over the run.
    Drift,
    /// A response with the square of the signal.
    Square,
    /// A response with its cube.
    Cube,
    /// No filter against folding: the share that folds.
    Folding,
    /// A tone at a multiple of the line frequency.
    LineTone,
}

/// Where an effect enters the linear machine or its measuring path.
#[derive(Debug, Clone, Copy)]
pub enum Seat {
    /// A sinusoid.
    Wave(Wave),
    /// One tooth of body 0 or 1.
    OneTooth(usize, Tooth),
    /// Every tooth of body 0 or 1 displaced by its own amount.
    EveryTooth(usize),
    /// Every pair displaced in this shape over its path (0 to 1).
    EveryPair(fn(f64) -> f64),
    /// Every pair relieved at both ends of its path, over a share of it and with an exponent that are searched.
    Ends,
    /// Every pair displaced at this many mesh orders, each free.
    MeshOrders(usize),
    /// Friction of the flanks, reversing at the pitch point.
    Sliding,
    /// The stiffness of every pair changing linearly over the run.
    MeshDrift,
    /// The path of a channel.
    Path(Path),
    /// The record as a whole, judged before the library is searched.
    Record,
}

impl Seat {
    /// Whether every pair carries it alike.
    pub fn is_of_every_pair(self) -> bool {
        matches!(self, Self::EveryPair(_) | Self::Ends | Self::MeshOrders(_))
    }
}

/// Where a seat earns the name; elsewhere it is a plain description.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Where {
    /// At this multiple of the rate of body 0 or 1.
    Multiple(usize, f64),
    /// At whole orders of either shaft above this order of the pinion.
    WholeOrdersAbove(f64),
    /// At orders of neither shaft, or at those and fixed frequencies.
    NeitherShaft {
        /// Also at fixed frequencies.
        fixed: bool,
    },
    /// At any order and any fixed frequency; all seats that are no sinusoid.
    Everywhere,
    /// Nowhere: it is no cause but a description.
    Nowhere,
}

impl Where {
    /// Whether `order` of the pinion, or a fixed frequency (none), is such a place; `ratio`: order of the gear's
    /// rotation.
    pub fn holds(self, order: Option<f64>, ratio: f64) -> bool {
        let near = |o: f64, k: f64| (o - k).abs() < 0.01;
        match (self, order) {
            (Self::Everywhere, _) => true,
            (Self::Nowhere, _) => false,
            (Self::Multiple(body, k), Some(o)) => near(o, k * [1.0, ratio][body]),
            (Self::WholeOrdersAbove(least), Some(o)) => o > least && of_a_shaft(o, ratio),
            (Self::NeitherShaft { .. }, Some(o)) => !of_a_shaft(o, ratio),
            (Self::NeitherShaft { fixed }, None) => fixed,
            (Self::Multiple(..) | Self::WholeOrdersAbove(_), None) => false,
        }
    }
}

fn of_a_shaft(order: f64, ratio: f64) -> bool {
    is_whole(order) || is_whole(order / ratio)
}

/// Whether `x` is a whole number of turns, to a hundredth.
pub fn is_whole(x: f64) -> bool {
    x > 0.5 && (x - x.round()).abs() < 0.01
}

/// One thing that the loop looks for.
#[derive(Debug, Clone, Copy)]
pub struct Hypothesis {
    /// Name of the verdict.
    pub name: &'static str,
    /// Description that stays where the name is withheld; empty: by the seat.
    pub plain: &'static str,
    /// Places that it may act at.
    pub seats: &'static [Seat],
    /// Where that is the named effect.
    pub at: Where,
    /// Name of the strength in the outcome.
    pub quantity: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Whether its response departs from proportionality at strengths that matter: then it is simulated at the
    /// strength found.
    pub bends: bool,
    /// Whether a strength below zero makes no sense: a crack does not stiffen a tooth, wear takes material away,
    /// friction brakes.
    pub never_negative: bool,
    /// Whether the angle that a prediction takes from the tachometer has it already: it is simulated, but not written
    /// by `--apply`.
    pub in_the_angle: bool,
    /// The simulator's effects for a fit; `None` without counterpart.
    pub carry: fn(&Fitted<'_>) -> Option<Carried>,
}

impl Hypothesis {
    /// What most have in common: named everywhere, proportional, without a counterpart.
    pub const DEFAULTS: Self = Self {
        name: "",
        plain: "",
        seats: &[],
        at: Where::Everywhere,
        quantity: "amplitude",
        unit: "1",
        bends: false,
        never_negative: false,
        in_the_angle: false,
        carry: |_| None,
    };
}

/// A hypothesis as fitted, in the loop's conventions: `Re(size exp(i (order angle + phase)))`, angle and order of the
/// pinion.
#[derive(Debug, Clone)]
pub struct Fitted<'a> {
    /// Numbers of teeth.
    pub teeth: [u32; 2],
    /// Working pressure angle, rad.
    pub pressure_angle_rad: f64,
    /// Base pitch, m.
    pub base_pitch_m: f64,
    /// Body 0 or 1 that it sits on.
    pub body: usize,
    /// Order of the pinion.
    pub order: Option<f64>,
    /// Fixed frequency, Hz.
    pub frequency_hz: Option<f64>,
    /// Strength in the unit of the hypothesis.
    pub size: f64,
    /// Phase, rad.
    pub phase_rad: f64,
    /// Tooth, where it sits on one.
    pub tooth: Option<u32>,
    /// Power of torque in the excitation beyond the unit's.
    pub torque_exponent: f64,
    /// Cosine and sine parts of every parameter.
    pub parts: &'a [[f64; 2]],
    /// Channel 0 or 1; 2: both.
    pub channel: f64,
    /// Size in each channel over the larger one.
    pub channel_share: [f64; 2],
    /// Shape found by search, in the seat's own terms: share and exponent of a relief, frequency and damping of a
    /// mode, delay.
    pub shape: [f64; 2],
}

impl Fitted<'_> {
    /// Order of the gear's rotation per turn of the pinion.
    pub fn ratio(&self) -> f64 {
        f64::from(self.teeth[0]) / f64::from(self.teeth[1])
    }

    /// `gear`, as a key.
    pub fn gear(&self) -> (&'static str, f64) {
        ("gear", self.body as f64)
    }

    /// `channel`, as a key.
    pub fn on(&self) -> (&'static str, f64) {
        ("channel", self.channel)
    }

    /// `tooth`, as a key.
    pub fn of_tooth(&self) -> Option<(&'static str, f64)> {
        self.tooth.map(|tooth| ("tooth", f64::from(tooth)))
    }

    /// `phase`, as a key, `turned_rad` ahead of the loop's.
    pub fn phase(&self, turned_rad: f64) -> (&'static str, f64) {
        let rad = self.phase_rad + turned_rad;
        ("phase", rad - TAU * (rad / TAU).round())
    }

    /// `order` per turn of body 0 or 1, or `frequency`, as a key.
    pub fn rate(&self, per_turn_of: usize) -> Option<(&'static str, f64)> {
        let per_turn = |order: f64| ("order", if per_turn_of == 1 { order / self.ratio() } else { order });
        self.order.map(per_turn).or(self.frequency_hz.map(|hz| ("frequency", hz)))
    }
}

/// Name and keys of one effect of the simulator.
pub type Table = (&'static str, Vec<(&'static str, f64)>);

/// The simulator's effects that stand for a fit, to be added together.
#[derive(Debug, Clone, PartialEq)]
pub struct Carried {
    /// Names and keys.
    pub tables: Vec<Table>,
    /// What does not carry over.
    pub remark: Option<String>,
}

/// Remark of what is locked to the gear.
pub const HUNTING: &str = "teeth and phase of the gear count from the pinion turn of the first run's pulse 0, which \
    a tachometer on the pinion cannot tell from another";

/// One effect with these keys.
pub fn one<const N: usize>(name: &'static str, keys: [(&'static str, f64); N]) -> Carried {
    Carried { tables: vec![(name, keys.to_vec())], remark: None }
}

/// One thing that a campaign hides in a record.
pub struct Hidden {
    /// Its own name.
    pub name: &'static str,
    /// Names of verdicts that are right for it; empty where only a description is.
    pub right_names: &'static [&'static str],
    /// Families that are right for it.
    pub families: &'static [&'static str],
    /// Strength at which its lines are measured to find the detection floor, or the strength itself.
    pub reference: f64,
    /// Whether the strength is proportional to what it leaves in the record, so that a detection floor exists.
    pub has_floor: bool,
    /// Start of the outcome's parameter that states the strength; empty where none compares.
    pub parameter: &'static str,
    /// The simulator's effects at a strength, as on the command line.
    pub draw: fn(f64, &mut Draw<'_>) -> Vec<String>,
}

impl Hidden {
    /// What most have in common.
    pub const DEFAULTS: Self = Self {
        name: "",
        right_names: &[],
        families: &["shaft-order", "sideband"],
        reference: 1.0,
        has_floor: true,
        parameter: "",
        draw: |_, _| Vec::new(),
    };
}

/// What is drawn at random for one record.
pub struct Draw<'a> {
    /// Numbers of teeth.
    pub teeth: [u32; 2],
    /// Largest acceleration of each channel without the effect, m/s2.
    pub peak_m_s2: [f64; 2],
    /// The record's stream.
    pub random: &'a mut ChaCha8Rng,
}

impl Draw<'_> {
    /// Between 0 and 1.
    pub fn share(&mut self) -> f64 {
        self.random.random()
    }

    /// A phase, rad.
    pub fn phase(&mut self) -> f64 {
        TAU * self.share()
    }

    /// A whole number below `count`.
    pub fn below(&mut self, count: u32) -> u32 {
        self.random.random::<u32>() % count
    }

    /// Body or channel 0 or 1.
    pub fn side(&mut self) -> usize {
        usize::from(self.random.random::<bool>())
    }

    /// An order of the pinion well away from whole orders of either shaft.
    pub fn odd_order(&mut self) -> f64 {
        let ratio = f64::from(self.teeth[0]) / f64::from(self.teeth[1]);
        let off = |x: f64| (x - x.round()).abs();
        loop {
            let order = 2.0 + 6.0 * self.share();
            if off(order) > 0.1 && off(order / ratio) > 0.1 {
                return order;
            }
        }
    }

    /// `order` of the pinion per turn of `body`.
    pub fn per_turn(&self, order: f64, body: usize) -> f64 {
        if body == 1 { order * f64::from(self.teeth[1]) / f64::from(self.teeth[0]) } else { order }
    }
}
