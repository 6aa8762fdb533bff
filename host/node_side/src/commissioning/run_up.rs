//! Third step: the machine goes through its speeds, and what the node says of each is kept.
//!
//! Nothing has to be reached in a certain order or held for a certain time: classes of speed fill with values of good
//! quality until each has enough. A ramp fills them as well as steady speeds do, as long as the tach stays locked and
//! a value, of a second at least, lies in one class mostly.

use super::coverage::Coverage;
use super::ear::{Ear, Operator};
use super::step::{Finding, Step, StepRecord};
use crate::law::domain::Domain;
use crate::levels::observe::Observations;
use crate::{Error, Result};
use meshband::alarm::Watched;
use meshband::events::EventKind;
use meshband::message::{Indicators, Message};
use meshband::tach::Validity;
use meshband_common::speed::Speed;
use serde::Serialize;

/// Between two lines that say how far it is, s of the node.
const TELL_EVERY_S: f64 = 30.0;

/// Ratio about a machine's one speed: slip of an induction motor over its loads.
const SLIP_RATIO: f64 = 1.03;
/// Speeds of a pinion that a node can follow, Hz.
const POSSIBLE_HZ: [f64; 2] = [0.25, 100.0];

/// A bandwidth as the node timed it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TimedEdge {
    /// Pinion rate, Hz.
    pub speed_hz: f64,
    /// 0.35 over the rise time, Hz.
    pub bandwidth_hz: f64,
    /// The law's at that speed, Hz.
    pub law_hz: f64,
}

/// A value of a quantity that hardly depends on the level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShapeValue {
    /// Which.
    pub watched: Watched,
    /// Pinion rate, Hz.
    pub speed_hz: f64,
    /// Value.
    pub value: f64,
}

/// Everything that one way through the speeds gave.
#[derive(Debug, Clone)]
pub struct Heard {
    /// Levels.
    pub levels: Observations,
    /// Kurtosis, sideband energy ratio, FM4.
    pub shapes: Vec<ShapeValue>,
    /// Bandwidths.
    pub edges: Vec<TimedEdge>,
    /// Speeds.
    pub coverage: Coverage,
    /// Values refused for their quality.
    pub bad: usize,
    /// Times the tach was lost or doubtful.
    pub tach_lost: usize,
    /// A sideband ratio without a mesh band says nothing.
    has_bands: bool,
}

impl Heard {
    fn new(coverage: Coverage) -> Self {
        Self {
            levels: Observations::default(),
            shapes: Vec::new(),
            edges: Vec::new(),
            coverage,
            bad: 0,
            tach_lost: 0,
            has_bands: false,
        }
    }

    /// Takes a message; true where it fills a class.
    fn take(&mut self, message: &Message) -> bool {
        self.levels.take(message);
        match message {
            Message::Spectrum(spectrum) => self.has_bands |= !spectrum.bands.is_empty(),
            Message::Event(event) if matches!(event.kind, EventKind::TachStalled | EventKind::TachDoubtful) => {
                self.tach_lost += 1;
            }
            Message::Indicators(values) => return self.values(values),
            _ => {}
        }
        false
    }

    fn values(&mut self, values: &Indicators) -> bool {
        let speed_hz = f64::from(values.tag.speed_hz);
        if values.tag.validity != Validity::Locked {
            return false;
        }
        if !values.quality.is_good() {
            self.bad += 1;
            return false;
        }
        let mut add = |watched, speed_hz: f64, value: f32| {
            if value.is_finite() && value > 0.0 {
                self.shapes.push(ShapeValue { watched, speed_hz, value: f64::from(value) });
            }
        };
        add(Watched::Kurtosis, speed_hz, values.kurtosis);
        if self.has_bands {
            add(Watched::SidebandEnergyRatio, speed_hz, values.sideband_energy_ratio);
        }
        if let Some(gear) = &values.gear {
            add(Watched::Fm4, f64::from(gear.speed_hz), gear.fm4);
        }
        if let Some(measured) = &values.bandwidth {
            let (bandwidth_hz, law_hz) = (f64::from(measured.bandwidth_hz), f64::from(measured.law_hz));
            self.edges.push(TimedEdge { speed_hz, bandwidth_hz, law_hz });
        }
        self.coverage.take(speed_hz)
    }
}

/// Listens until all classes are filled or `seconds` of the node are over; an operator may grant as many again.
///
/// # Errors
/// Of the link, and where the end is asked for.
pub fn run_up(ear: &mut Ear<'_>, coverage: Coverage, seconds: f64, operator: &mut dyn Operator) -> Result<Heard> {
    let mut heard = Heard::new(coverage);
    operator.tell(&match heard.coverage.classes.len() {
        1 => format!("run-up: let the machine run at its one speed: {}", heard.coverage.missing()),
        _ => format!("run-up: bring the machine through its speeds: {}", heard.coverage.missing()),
    })?;
    loop {
        let mut told_s = None;
        ear.listen(seconds, operator, |message, ear, operator| {
            let filled = heard.take(message);
            if heard.coverage.is_complete() {
                return Ok(true);
            }
            let now_s = ear.now_s().unwrap_or(0.0);
            let due = now_s - *told_s.get_or_insert(now_s) > TELL_EVERY_S;
            if filled || due {
                told_s = Some(now_s);
                operator.tell(&progress(&heard.coverage, ear))?;
            }
            Ok(false)
        })?;
        if heard.coverage.is_complete() || !operator.ask(&question(&heard.coverage, seconds))? {
            return Ok(heard);
        }
    }
}

fn progress(coverage: &Coverage, ear: &Ear<'_>) -> String {
    let (filled, all) = (coverage.filled().count(), coverage.classes.len());
    let present = match ear.status().filter(|status| status.validity == Validity::Locked) {
        Some(status) => format!("{:.2} Hz now", status.speed_hz),
        None => "no speed now".into(),
    };
    format!("run-up: {filled} of {all} speed classes filled, {present}; still missing: {}", coverage.missing())
}

fn question(coverage: &Coverage, seconds: f64) -> String {
    format!("still missing: {}. Wait for another {:.0} min?", coverage.missing(), seconds / 60.0)
}

/// What the way through the speeds was like.
pub fn judged(heard: &Heard) -> StepRecord {
    let coverage = &heard.coverage;
    let seen = format!("{} of {} classes filled", coverage.filled().count(), coverage.classes.len());
    let missing = format!("missing: {}; nothing is expected there", coverage.missing());
    let mut findings = vec![match coverage.filled().count() {
        filled if filled == coverage.classes.len() => Finding::passed("speeds", seen),
        0 => {
            let advice = format!(
                "missing: {}; name the speeds that the machine has (--speeds 750rpm..1500rpm, or its one speed: \
                 --speeds 1485rpm), or more time (--time)",
                coverage.missing()
            );
            Finding::refused("speeds", seen, advice)
        }
        1 if coverage.has_one_speed() => {
            let advice = "the machine has run at one speed only: nothing is expected of others";
            Finding::warned("speeds", seen, advice)
        }
        _ => Finding::warned("speeds", seen, missing),
    }];
    let values = heard.levels.by_quantity[0].len();
    let seen = format!("{values} good, {} of bad quality", heard.bad);
    findings.push(if 10 * heard.bad > values {
        Finding::warned("values", seen, "clipped, settling or gaps: `meshband monitor` says which")
    } else {
        Finding::passed("values", seen)
    });
    let seen = format!("{} times lost or doubtful", heard.tach_lost);
    findings.push(if heard.tach_lost > 2 {
        Finding::warned("tach", seen, "change the speed more slowly, or see to the tach's signal")
    } else {
        Finding::passed("tach", seen)
    });
    StepRecord::new(Step::RunUp, findings)
}

/// A range of pinion speeds as one asks for it: `LOW..HIGH`, or the one speed that a machine has, for 3 % about it.
///
/// # Errors
/// Another text, speeds out of a node's range or in the wrong order.
pub fn speeds(text: &str) -> std::result::Result<Domain, String> {
    let (low, high) = match text.split_once("..") {
        Some((low, high)) => (low.parse::<Speed>()?.0, high.parse::<Speed>()?.0),
        None => {
            let Speed(only) = text.parse()?;
            (only / SLIP_RATIO, only * SLIP_RATIO)
        }
    };
    let [slowest, fastest] = POSSIBLE_HZ;
    if !(slowest..=fastest).contains(&low) || !(slowest..=fastest).contains(&high) || low >= high {
        return Err(format!(
            "'{}' is no range of pinion speeds from {slowest} to {fastest} Hz, the lower first: as 12Hz..25Hz, or \
             one speed as 1485rpm",
            meshband_common::text::name(text)
        ));
    }
    Ok(Domain { lowest_hz: low, highest_hz: high })
}

/// The range to go through: as asked for, or round the machine's nominal speed.
///
/// # Errors
/// A machine without nominal speed where no range is given.
pub fn range(asked: Option<Domain>, machine: &crate::machine::Machine) -> Result<Domain> {
    /// Shares of the nominal speed that a machine goes through.
    const SHARES: [f64; 2] = [0.5, 1.05];
    let nominal = machine
        .nominal
        .map(|nominal| Domain { lowest_hz: SHARES[0] * nominal.speed_hz, highest_hz: SHARES[1] * nominal.speed_hz });
    let missing = || Error::invalid("--speeds", format!("is needed: {} declares no [nominal] speed_hz", machine.title));
    asked.or(nominal).ok_or_else(missing)
}
