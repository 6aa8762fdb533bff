//! Thresholds of the search for impacts, with unit and source. "Nats": minus the natural logarithm of a probability
//! by chance.

/// Equal parts of the band up to half the rate that a carrier is looked for in: a bank as of the fast kurtogram
/// (Antoni 2007).
pub const PARTS: [usize; 8] = [1, 2, 3, 4, 6, 8, 12, 16];
/// Least width of a band, turns of the pinion per second: four harmonics of a passage of order 6.
pub const LEAST_WIDTH: f64 = 24.0;
/// Fewest bands whose spectra are also read as one: fewer are hardly other than each.
pub const MIN_MEAN_BANDS: usize = 4;
/// Power over the spectrum's own local floor beyond which a bin is a deterministic line, and is cut down to.
pub const LINE_FLOOR_RATIO: f64 = 10.0;
/// Highest order of a squared envelope that is read.
pub const HIGHEST_ORDER: f64 = 40.0;
/// Points of its grid per turn.
pub const PER_TURN: usize = 128;
/// Share of the turns that a comb is found on.
pub const FIT_TURN_SHARE: f64 = 0.74;
/// Share of the turns from which on it has to stand again.
pub const HELD_OUT_START_SHARE: f64 = 0.75;
/// Fewest turns of the held-out part: its bins must part a comb from a shaft's orders.
pub const FEWEST_TURNS: usize = 8;
/// Widths over which slip and jitter may smear a line, share of its order (Randall, Antoni 2011: 1 to 2 %; measured:
/// hardly any).
pub const SMEARS: [f64; 2] = [0.0, 0.01];
/// Share within which two combs are one, or multiples: half of the widest smear.
pub const SAME_COMB: f64 = 0.005;
/// Harmonics that a comb is read with, alternatives.
pub const HARMONICS: [usize; 4] = [3, 4, 6, 8];
/// Those that are also read with a shaft's first sidebands.
pub const SIDEBAND_HARMONICS: [usize; 2] = [3, 4];
/// Share of the background's peaks that its tail is fitted to, and fewest of them.
pub const TAIL: (f64, usize) = (0.05, 10);
/// Combs of one band and number of harmonics that are looked at closely.
pub const FINALISTS: usize = 3;
/// The same of all bands.
pub const MAX_FINALISTS: usize = 200;
/// Orders of the slower, and of the faster shaft, that a comb's base lies between.
pub const BASES: (f64, f64) = (1.3, 14.0);
/// Most combs of a record.
pub const MAX_COMBS: usize = 4;
/// Nats after all choices from which a comb is adopted: 1 %.
pub const MIN_ADOPTION_NATS: f64 = 4.6;
/// Nats of a comb's lines without the highest: what it rests on is more than one line.
pub const MIN_OTHER_LINES_NATS: f64 = 4.6;
/// Nats on the held-out turns, after the choice of the slip there.
pub const MIN_HELD_OUT_NATS: f64 = 4.6;
/// Nats from which a ring is named. Weak combs are often a sound bearing's, or another support's.
pub const MIN_RING_NATS: f64 = 12.0;
/// Depth of the first harmonic, share of the band's mean power, from which a ring is named (measured: passages of
/// sound bearings up to 0.12, of damaged ones from 0.16).
pub const MIN_RING_DEPTH: f64 = 0.14;
/// Share by which a base may have moved on the held-out turns.
pub const SLIP: f64 = 0.003;
/// Share of its order within which a base is a multiple of half a shaft's turn: the shaft's own, a loose fit's, or a
/// supply's.
pub const HALF_TURN: f64 = 0.004;
/// Share of all orders that may lie so near to a part of a shaft's turn where that is still a finding.
pub const MAX_COINCIDENCE_SHARE: f64 = 0.1;
/// Share of a shaft's first or second order within which a comb is the shaft's own, smeared: the slip of bearings.
pub const BESIDE_SHARE: f64 = 0.02;
/// Turns of a shaft above which looseness has no lines to speak of (its harmonics fade within ten).
pub const MOST_TURNS: f64 = 10.0;
/// Logarithm of power by which another base must stand higher than this one (mean over three harmonics) to be the
/// base; within it both are in question.
pub const MIN_LN_POWER_LEAD: f64 = 0.25;
/// The same for a multiple or a part of the base.
pub const MULTIPLE: f64 = 2.0;
/// Nats from which sidebands stand.
pub const SIDEBANDS: f64 = 8.0;
/// Power of sidebands over their carriers' from which a shaft modulates the comb as it does a turning ring.
pub const MIN_SIDEBAND_POWER_RATIO: f64 = 0.12;
/// Share of the sum of two passages within which it is a whole number.
pub const WHOLE_NUMBER_SHARE: f64 = 0.003;
/// Least order of an outer ring's passage: seven elements, ratio of diameters 0.36.
pub const MIN_OUTER_ORDER: f64 = 2.24;
/// Least order of an inner ring's passage: seven elements, ratio of diameters 0.12.
pub const MIN_INNER_ORDER: f64 = 3.92;
/// Order from which an outer ring needs twelve elements or more, which ball bearings do not have.
pub const MANY_ELEMENTS: f64 = 4.84;
/// Highest order of an outer, and of an inner ring with 24 elements.
pub const MAX_OUTER_ORDER: f64 = 10.6;
/// Slip of a declared bearing, share of its orders, and the share by which a steeper contact raises the outer ring's.
pub const DECLARED_SLIP: (f64, f64) = (0.02, 0.01);
/// Nats within which two parts of a declared bearing are both in question.
pub const PART_MARGIN_NATS: f64 = 3.0;
