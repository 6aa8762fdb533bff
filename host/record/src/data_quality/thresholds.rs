//! Thresholds of the remarks, with unit and reason.

/// Share of a channel's range within which samples lie at its limit: a flat top has them all there, noise on it
/// included.
pub const LIMIT_STRIP_SHARE: f64 = 0.003;
/// How many times as many samples lie at a limit as in the next strip of that width; a sine has 2.4 times.
pub const MIN_PILE_RATIO: f64 = 5.0;
/// Fewest samples at a limit, and fewest places with three of them in a row.
pub const MIN_LIMIT_SAMPLES: usize = 12;
pub const LEAST_TOPS: usize = 3;
/// Widest code step, share of the range, of which a limit can be told from the next code: a channel of four codes or
/// of two levels lies at its limits.
pub const MAX_CODE_STEP_SHARE: f64 = 0.25;
/// Samples in a row at a limit that make a flat top.
pub const FLAT_TOP_SAMPLES: usize = 3;
/// Equal samples in a row that are a standstill: no fewer than this, and than so many times the usual run of equal
/// codes.
pub const MIN_STANDSTILL_SAMPLES: usize = 64;
pub const MIN_STANDSTILL_RUN_RATIO: usize = 50;
/// Shortest standstill that is said, s.
pub const STANDSTILL_S: f64 = 0.01;
/// Samples of a block that is looked for again, and fewest different values in it.
pub const BLOCK: usize = 64;
pub const BLOCK_VALUES: usize = 16;
/// Share of a run that repeats beyond which it is a generated loop.
pub const LOOP_SHARE: f64 = 0.5;
/// Frames over which channels are compared, s, and fewest of them.
pub const FRAME_S: f64 = 0.25;
pub const LEAST_FRAMES: usize = 12;
/// Lines that are compared, and the farthest clocks, as a share.
pub const COMPARED_LINES: usize = 32;
pub const MAX_CLOCK_OFFSET_SHARE: f64 = 5e-4;
/// Coherence with the clock found, and by how much it must be above that without: chance has 0.3 with twelve frames.
pub const CLOCK_COHERENCE: f64 = 0.55;
pub const MIN_COHERENCE_GAIN: f64 = 0.1;
/// Least drift of the highest compared line over the run, cycles.
pub const LEAST_DRIFT: f64 = 0.2;
/// Height of a mains line over its surroundings, dB, and its share of the signal's rms.
pub const HUM_DB: f64 = 20.0;
pub const HUM_SHARE: f64 = 0.01;
/// Farthest that a mains line may lie from its place, as a share: the grid's own wander.
pub const HUM_NEAR: f64 = 0.002;
