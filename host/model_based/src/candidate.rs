//! A candidate effect: named templates that are linear in a few physical parameters.

use super::start::Start;
use crate::dynamics::excitation::Facts;
use crate::effects::hypothesis::{Fitted, Hypothesis, Seat, Site, Tooth, Wave};
use crate::model::forward::Line;
use crate::observation::spectrum::{Analyser, REACH, Sparse};
use rustfft::num_complex::Complex64 as C;
use std::sync::Arc;

/// Response to one unit of one real parameter: sparse bins per run and channel.
///
/// Candidates that differ in what they claim share the bins, which make up most of the loop's memory.
#[derive(Debug, Clone)]
pub struct Template {
    /// Per run, per channel.
    pub runs: Vec<Arc<[Sparse; 2]>>,
}

impl Template {
    /// From the bins of each run.
    pub fn new(runs: impl IntoIterator<Item = [Sparse; 2]>) -> Self {
        Self { runs: runs.into_iter().map(Arc::new).collect() }
    }

    /// `p` times this and `q` times the other.
    pub fn mixed(&self, p: f64, other: &Self, q: f64) -> Self {
        let sum = |own: &[Sparse; 2], other: &[Sparse; 2]| [0, 1].map(|c| Sparse::mixed(&own[c], p, &other[c], q));
        Self::new(self.runs.iter().zip(&other.runs).map(|(own, other)| sum(own, other)))
    }

    /// The template restricted to one run.
    pub fn only(&self, run: usize) -> Self {
        let empty = Arc::<[Sparse; 2]>::default();
        let of = |(r, bins): (usize, &Arc<[Sparse; 2]>)| Arc::clone(if r == run { bins } else { &empty });
        Self { runs: self.runs.iter().enumerate().map(of).collect() }
    }
}

/// What a parameter means.
#[derive(Debug, Clone)]
pub struct Parameter {
    /// Name in the outcome.
    pub name: String,
    /// Unit in the outcome.
    pub unit: &'static str,
    /// Index of the first template; complex parameters use the next one for the quadrature.
    pub first: usize,
    /// Amplitude and phase from two templates, or one real value.
    pub complex: bool,
}

/// Whether a candidate claims a physical cause.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Claim {
    /// A library effect with a name.
    Named,
    /// A plain description of an excitation.
    Generic,
}

/// One possible explanation of what the model lacks.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Library name, or plain description.
    pub name: String,
    /// Named or generic.
    pub claim: Claim,
    /// Plain description of the same excitation, which stays when the name is withheld from the library.
    pub plain: Option<String>,
    /// Family word of the outcome.
    pub family: &'static str,
    /// pinion, gear or none.
    pub shaft: &'static str,
    /// Order of the pinion, if locked to it.
    pub order: Option<f64>,
    /// Frequency, Hz, if fixed.
    pub frequency_hz: Option<f64>,
    /// Parameters to report.
    pub parameters: Vec<Parameter>,
    /// Templates, one per real unknown.
    pub templates: Vec<Template>,
    /// Number of alternatives searched to arrive at this candidate, as its score pays for them.
    pub searched: f64,
    /// Number of places (orders, frequencies) of this record that its own was chosen from.
    pub scanned: f64,
    /// Exponents of speed and torque that the templates carry in the excitation.
    pub exponents: [f64; 2],
    /// Phase is arbitrary in every run (not locked to the shaft): templates 0 and 1 are a quadrature pair.
    pub phase_free: bool,
    /// Shape which may be improved once the candidate is among the best.
    pub tuning: Option<Tuning>,
    /// The effect that it is, or would be at another order: what is simulated at a strength, and written by `--apply`.
    pub hypothesis: Option<&'static Hypothesis>,
    /// Which of that effect's seats it has.
    pub seat: Option<Seat>,
    /// The tooth it sits on.
    pub tooth: Option<u32>,
    /// The channel whose path it changes; none: the machine, or both.
    pub channel: Option<usize>,
    /// Whether the templates already give the simulated response at the fitted strength.
    pub bent: bool,
    /// Orders of the pinion at which the templates' quadrature pairs stand: what they turn with when a run starts
    /// some turns later.
    pub pair_orders: Vec<f64>,
    /// Starts of the runs that the templates are made for.
    pub start: Start,
}

impl Default for Candidate {
    /// A plain description without templates, order, frequency or refinement: what most candidates have in common.
    fn default() -> Self {
        Self {
            name: String::new(),
            claim: Claim::Generic,
            plain: None,
            family: "other",
            shaft: "none",
            order: None,
            frequency_hz: None,
            parameters: Vec::new(),
            templates: Vec::new(),
            searched: 1.0,
            scanned: 1.0,
            exponents: [0.0, 0.0],
            phase_free: false,
            tuning: None,
            hypothesis: None,
            seat: None,
            tooth: None,
            channel: None,
            bent: false,
            pair_orders: Vec::new(),
            start: Start::Counted,
        }
    }
}

/// Largest distance over which friction turns, base pitches: beyond half the path nothing of its law is left.
const LARGEST_TRANSITION: f64 = 0.8;

/// A shape that enters a candidate not in proportion, improved by search once the candidate is among the best.
#[derive(Debug, Clone, Copy)]
#[allow(missing_docs, reason = "named by the line above each")]
pub enum Tuning {
    /// Mode of a channel's path: natural frequency (Hz) and damping ratio.
    Mode { channel: usize, f0: f64, zeta: f64 },
    /// Index of the seat of an excitation at an order of neither shaft, whose order is to be found more finely.
    Order { seat: usize },
    /// Delay of a channel, s.
    Delay { delay_s: f64 },
    /// Delay of a second path, s.
    Echo { delay_s: f64 },
    /// How the loss of a cracked tooth grows along its path.
    Growth { growth: f64, bow: f64 },
    /// Square of the distance, base pitches, over which friction turns at the pitch point: the response goes with it.
    Transition { square: f64 },
    /// Share of the path of contact that tip relief covers at each end, and the exponent of its shape.
    Relief { share: f64, exponent: i32 },
}

impl Tuning {
    /// The shape as the simulator's effects are told it: share and exponent, or frequency and damping ratio.
    pub fn shape(self) -> [f64; 2] {
        match self {
            Self::Relief { share, exponent } => [share, f64::from(exponent)],
            Self::Mode { f0, zeta, .. } => [f0, zeta],
            Self::Delay { delay_s } | Self::Echo { delay_s } => [delay_s, 0.0],
            Self::Growth { growth, bow } => [growth, bow],
            Self::Transition { square } => [square.sqrt(), 0.0],
            Self::Order { .. } => [0.0; 2],
        }
    }
}

impl Candidate {
    /// Numbers of its shape that are refined by simulation, each with the step of a difference that is well within
    /// the linear range.
    pub fn shape(&self) -> Vec<(f64, f64)> {
        match (self.tuning, self.order) {
            (Some(Tuning::Mode { f0, zeta, .. }), _) => vec![(f0.ln(), 0.02 * zeta), (zeta.ln(), 0.01)],
            (Some(Tuning::Relief { share, .. }), _) => vec![(share, 1e-3)],
            (Some(Tuning::Echo { delay_s }), _) => vec![(delay_s, 1e-7)],
            (Some(Tuning::Growth { growth, bow }), _) => vec![(growth, 0.01), (bow, 0.01)],
            (Some(Tuning::Transition { square }), _) => vec![(square, 1e-3)],
            (Some(Tuning::Order { .. }), Some(order)) => vec![(order, 3e-5)],
            _ => Vec::new(),
        }
    }

    /// Cosine and sine parts of every parameter at the unknowns `x`.
    pub fn parts(&self, x: &[f64]) -> Vec<[f64; 2]> {
        let part = |i: usize| x.get(i).copied().unwrap_or(0.0);
        self.parameters.iter().map(|p| [part(p.first), if p.complex { part(p.first + 1) } else { 0.0 }]).collect()
    }

    /// What its hypothesis carries to the simulator's effects, at a size and a phase (rad) and with `parts`.
    pub fn fitted<'p>(&self, facts: &Facts, (size, phase_rad): (f64, f64), parts: &'p [[f64; 2]]) -> Fitted<'p> {
        Fitted {
            teeth: facts.teeth,
            pressure_angle_rad: facts.pressure_angle_rad,
            base_pitch_m: facts.base_pitch_m,
            body: self.body(),
            order: self.order,
            frequency_hz: self.frequency_hz,
            size,
            phase_rad,
            tooth: self.tooth,
            torque_exponent: self.exponents[1],
            parts,
            channel: self.channel.map_or(2.0, |channel| channel as f64),
            channel_share: self.channel.map_or([1.0; 2], |channel| [1.0 - channel as f64, channel as f64]),
            shape: self.tuning.map_or([0.0; 2], Tuning::shape),
        }
    }

    /// The same with other numbers of its shape.
    pub fn with_shape(&self, values: &[f64]) -> Self {
        let mut other = self.clone();
        match (other.tuning.as_mut(), values) {
            (Some(Tuning::Mode { f0, zeta, .. }), [f, z]) => (*f0, *zeta) = (f.exp(), z.exp()),
            (Some(Tuning::Relief { share, .. }), [s]) => *share = s.clamp(0.01, 0.5),
            (Some(Tuning::Echo { delay_s }), [d]) => *delay_s = *d,
            (Some(Tuning::Growth { growth, bow }), [g, b]) => {
                (*growth, *bow) = (g.clamp(-3.9, 3.9), b.clamp(-1.9, 1.9));
            }
            (Some(Tuning::Transition { square }), [s]) => *square = s.clamp(0.0, LARGEST_TRANSITION.powi(2)),
            (Some(Tuning::Order { .. }), [order]) => other.order = Some(*order),
            _ => {}
        }
        if let Some(Tuning::Mode { f0, .. }) = other.tuning {
            other.frequency_hz = Some(f0);
        }
        other
    }

    /// Whether its response is simulated at the strength found.
    pub fn bends(&self) -> bool {
        self.hypothesis.is_some_and(|h| h.bends)
    }

    /// Whether it says that this varies sinusoidally.
    pub fn has_wave(&self, wave: Wave) -> bool {
        matches!(self.seat, Some(Seat::Wave(own)) if own == wave)
    }

    /// Whether it says that a tooth of this body is softer.
    pub fn softens_tooth_of(&self, body: usize) -> bool {
        matches!(self.seat, Some(Seat::OneTooth(own, Tooth::Softened)) if own == body)
    }

    /// Whether the values `x` of its unknowns make physical sense.
    pub fn is_possible(&self, x: &[f64]) -> bool {
        let never_negative = self.hypothesis.is_some_and(|h| h.never_negative);
        !never_negative
            || self.parameters.iter().filter(|p| !p.complex).all(|p| x.get(p.first).is_none_or(|v| *v > 0.0))
    }

    /// The body it sits on.
    pub fn body(&self) -> usize {
        match self.seat {
            Some(Seat::Wave(Wave::BearingStiffness(body) | Wave::Force { at: Site::Along(body), .. })) => body,
            Some(Seat::OneTooth(body, _) | Seat::EveryTooth(body)) => body,
            _ => usize::from(self.shaft == "gear"),
        }
    }

    /// The same effect with every run started as `start` says.
    pub fn started(&self, start: Start) -> Self {
        let mut turned = self.clone();
        for (j, &order) in self.pair_orders.iter().enumerate() {
            for run in 0..turned.templates[2 * j].runs.len() {
                let (sin, cos) = start.phase_rad(run, order).sin_cos();
                for channel in 0..2 {
                    let [a, b] = [0, 1].map(|i| &self.templates[2 * j + i].runs[run][channel]);
                    let pair = [Sparse::mixed(a, cos, b, sin), Sparse::mixed(a, -sin, b, cos)];
                    for (i, part) in pair.into_iter().enumerate() {
                        Arc::make_mut(&mut turned.templates[2 * j + i].runs[run])[channel] = part;
                    }
                }
            }
        }
        turned.start = start;
        turned
    }
}

/// Per-run lines as a pair of quadrature templates: parameters `a`, `b` give `Re((a + i b) line)`.
pub fn quadrature(analyser: &Analyser, angles: &[(f64, f64)], lines: &[Vec<Line>]) -> [Template; 2] {
    [C::ONE, C::I].map(|factor| {
        Template::new(lines.iter().zip(angles).map(|(lines, &(offset, shaft_hz))| {
            let turned: Vec<Line> =
                lines.iter().map(|l| Line { order: l.order, amplitude: l.amplitude.map(|a| a * factor) }).collect();
            analyser.templates_of_lines(&turned, offset, shaft_hz, REACH)
        }))
    })
}
