//! Octave plan: which ADC rate and which half-band decimation give a wanted output rate.
//!
//! The analogue anti-alias filter is fixed, so the ADC rate must never fall below twice the filter's stop edge F/2.
//! The plan keeps the ADC rate in the octave [F, 2F) and reaches lower output rates by k half-band stages,
//! `output = adc / 2^k`. A rate wanted above F needs no stage. Once chosen, k is kept until the ADC rate would fall
//! below F or rise [`OCTAVE_OVERLAP`] above 2F: a speed that dithers on an octave border changes nothing.
//!
//! The sample timer divides the time base by an integer: at 84 MHz one tick is 0.24 to 0.48 % of the period between
//! 200 and 400 kHz, so no plan meets a wanted rate to 150 ppm there. It need not: the law says which rate the signal
//! wants *at least*, and the order domain is resampled by time stamps. What is asked of the board is therefore a
//! period in ticks, the longest whose rate is not below the wanted one; the board grants that integer or says
//! otherwise, and every product carries the granted rate, exact to single precision. The excess over the wanted rate,
//! less than one step of the period, is reported with it.
//!
//! Steps are a board's ([`Timing::period_step`]): where the converter's clock is a fraction of the timer's, only
//! multiples of that fraction give equidistant samples. With 4 ticks at 84 MHz the excess is up to 1 % at 200 kHz and
//! 2 % at 420 kHz; jitter of up to 36 ns, which it replaces, would be noise at -50 dB under a line at 40 kHz.

use crate::board::Timing;
use crate::units::{Hertz, PartsPerMillion};
use serde::{Deserialize, Serialize};

/// How far above 2F the ADC rate may rise before a stage is dropped, relative.
pub const OCTAVE_OVERLAP: f32 = 0.1;

/// Most half-band stages between ADC and output.
pub const MAX_STAGES: u8 = 10;

/// Share of the output rate that is free of aliases and flat after decimation.
pub const USABLE_SHARE: f32 = 1.0 / 2.56;

/// Which multiple of the bandwidth is wanted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum RatePolicy {
    /// Twice the bandwidth: the smallest rate that carries it. The decimation filter's transition costs its upper 22 %.
    Critical,
    /// 2.56 times the bandwidth: all of it flat and free of aliases.
    Spectrum,
    /// A multiple of the bandwidth at which waveforms keep their rise time.
    Waveform {
        /// Samples per second and hertz of bandwidth.
        multiple: f32,
    },
    /// This exact ADC rate without decimation, whatever the analogue filter allows. For tests.
    Forced {
        /// ADC rate.
        rate: Hertz,
    },
}

impl RatePolicy {
    /// Wanted output rate for a bandwidth.
    pub fn rate(self, bandwidth: Hertz) -> Hertz {
        match self {
            RatePolicy::Critical => Hertz(2.0 * bandwidth.0),
            RatePolicy::Spectrum => Hertz(2.56 * bandwidth.0),
            RatePolicy::Waveform { multiple } => Hertz(multiple * bandwidth.0),
            RatePolicy::Forced { rate } => rate,
        }
    }
}

/// Limits of a board's sampling.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RateLimits {
    /// Stop edge of the fixed analogue filter: above it nothing reaches the ADC.
    pub analogue_stop: Hertz,
    /// Highest ADC rate.
    pub highest_adc: Hertz,
}

/// A granted rate: what the timer really does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RateGrant {
    /// Output rate that is wanted at least.
    pub requested: Hertz,
    /// Granted sample period, ticks of the time base.
    pub period_ticks: u32,
    /// Half-band stages between ADC and output.
    pub stages: u8,
    /// Granted ADC rate.
    pub adc: Hertz,
    /// Granted output rate.
    pub output: Hertz,
    /// Granted over wanted output rate, less one: 0 to one step of the period, unless limited.
    pub residual: PartsPerMillion,
    /// Highest frequency that is flat and free of aliases at the output.
    pub usable: Hertz,
    /// The board could not give the wanted rate: highest ADC rate or most stages reached.
    pub limited: bool,
    /// The ADC rate is below twice the analogue stop edge: lines may be folded (forced rates only).
    pub aliasing: bool,
}

/// The plan with its memory of the present octave.
#[derive(Clone, Debug)]
pub struct RatePlan {
    limits: RateLimits,
    timing: Timing,
    stages: Option<u8>,
}

impl RatePlan {
    /// A plan for a board and the limits of its analogue part.
    pub fn new(timing: impl Into<Timing>, limits: RateLimits) -> Self {
        Self { limits, timing: timing.into(), stages: None }
    }

    /// The board it was made for.
    pub fn timing(&self) -> Timing {
        self.timing
    }

    /// Lowest ADC rate at which the fixed analogue filter prevents aliases.
    pub fn lowest_adc(&self) -> Hertz {
        Hertz(2.0 * self.limits.analogue_stop.0)
    }

    /// Grants the lowest rate of the timer that is not below the wanted output rate. Undefined or absurd wishes get the
    /// highest rate.
    pub fn grant(&mut self, wanted: Hertz) -> RateGrant {
        self.grant_up_to(wanted, self.limits.highest_adc)
    }

    /// As [`RatePlan::grant`], of ADC rates up to `calm` where there is one that the filter allows and the wish leaves:
    /// a stage less then gives a higher output rate than is asked for.
    pub fn grant_up_to(&mut self, wanted: Hertz, calm: Hertz) -> RateGrant {
        let floor = self.lowest_adc().0.min(self.limits.highest_adc.0);
        let sane = wanted.0 > 0.0 && wanted.0 <= self.limits.highest_adc.0;
        let target = if sane { wanted.0 } else { self.limits.highest_adc.0 };
        let ceiling = (2.0 * floor * (1.0 + OCTAVE_OVERLAP)).min(self.limits.highest_adc.0);
        let fits = |stages: u8| {
            let adc = target * power_of_two(stages);
            adc >= floor && (adc < ceiling || stages == 0)
        };
        let stages = match self.stages {
            Some(present) if fits(present) => present,
            _ => (0..MAX_STAGES).find(|&k| target * power_of_two(k) >= floor).unwrap_or(MAX_STAGES),
        };
        let calmer = target * power_of_two(stages) > calm.0 && stages > 0 && floor <= calm.0;
        let stages = if calmer { stages - 1 } else { stages };
        self.stages = Some(stages);
        let adc = (target * power_of_two(stages)).max(floor).min(self.limits.highest_adc.0);
        let period = self.longest_period(adc).max(self.shortest_period());
        let granted = self.rate(period);
        let limited = !sane || (!calmer && adc != target * power_of_two(stages)) || granted < adc;
        self.describe(wanted, period, stages, limited)
    }

    /// Grants an exact ADC rate without decimation; only the timer and the ADC limit it.
    pub fn force(&mut self, rate: Hertz) -> RateGrant {
        self.stages = None;
        let sane = rate.0 > 0.0 && rate.0 <= self.limits.highest_adc.0;
        let adc = if sane { rate.0 } else { self.limits.highest_adc.0 };
        self.describe(rate, self.nearest_period(adc).max(self.shortest_period()), 0, !sane)
    }

    /// What a given timer period means with a number of stages.
    pub fn describe(&self, requested: Hertz, period_ticks: u32, stages: u8, limited: bool) -> RateGrant {
        let adc = self.timing.clock.rate(period_ticks);
        let output = Hertz(adc.0 / power_of_two(stages));
        let (stop, clear) = (self.limits.analogue_stop.0, adc.0 - self.limits.analogue_stop.0);
        let usable = if stages > 0 { output.0 * USABLE_SHARE } else { clear.min(adc.0 / 2.0).max(0.0) };
        RateGrant {
            requested,
            period_ticks,
            stages,
            adc,
            output,
            residual: PartsPerMillion((output.0 / requested.0 - 1.0) * 1.0e6),
            usable: Hertz(usable),
            limited,
            aliasing: adc.0 < 2.0 * stop,
        }
    }

    fn rate(&self, period: u32) -> f32 {
        self.timing.clock.rate(period).0
    }

    fn step(&self) -> u32 {
        self.timing.period_step.max(1)
    }

    /// Longest period whose rate is not below `adc`.
    fn longest_period(&self, adc: f32) -> u32 {
        let period = self.nearest_period(adc);
        if self.rate(period) < adc { period.saturating_sub(self.step()).max(self.step()) } else { period }
    }

    fn shortest_period(&self) -> u32 {
        let highest = self.limits.highest_adc.0.min(self.timing.highest_adc.0);
        let period = self.nearest_period(highest);
        if self.rate(period) > highest { period + self.step() } else { period }
    }

    /// Multiple of the step that is nearest to a rate's period.
    fn nearest_period(&self, rate_hz: f32) -> u32 {
        let step = self.step();
        ((self.timing.clock.0 as f32 / (rate_hz * step as f32) + 0.5) as u32).max(1) * step
    }
}

fn power_of_two(stages: u8) -> f32 {
    (1u32 << stages.min(31)) as f32
}
