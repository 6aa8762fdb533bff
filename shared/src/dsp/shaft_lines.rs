//! Once, twice and three times per turn of both shafts: amplitude and phase over whole turns.
//!
//! Input is one value per tooth pitch: bin 0 of the mesh bands' filter bank ([`crate::zoom`]), a mean over six
//! pitches under a Blackman-Harris window. Its aliases at these orders lie below -92 dB, its droop is known and
//! undone, and whole turns of either shaft are whole numbers of values, so a line of one leaks into no other of the
//! same shaft. What is not a multiple of the shaft leaks as it does through a rectangular window of that many turns.
//!
//! Phase is the lag behind the turn mark, degrees: a line is `amplitude * cos(order * angle - phase)`. The gear's
//! angle counts from the turn mark at which the tach locked; a new lock begins at another tooth.
//!
//! Cost (Cortex-M4F): about 300 instructions per pitch. Source: vector filtering as in API 670, section on phase
//! reference.

use crate::math;
use crate::window::{Window, phase_step};
use serde::{Deserialize, Serialize};

/// Orders of each shaft.
pub const ORDERS: usize = 3;
/// Degrees per radian.
const DEGREES: f32 = 180.0 / core::f32::consts::PI;
/// Length of the filter bank's window, pitches; a value describes its middle.
const WINDOW_PITCHES: u32 = 6;

/// One order of a shaft.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OrderLine {
    /// Peak amplitude, m/s^2.
    pub amplitude: f32,
    /// Lag of the peak behind the turn mark, degrees of the order, -180 to 180.
    pub phase_deg: f32,
}

/// Orders 1 to 3 of a shaft over whole turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ShaftOrders {
    /// Once, twice, three times per turn.
    pub lines: [OrderLine; ORDERS],
    /// Turns of this shaft.
    pub turns: u16,
}

/// Sums of one shaft.
#[derive(Clone, Copy, Debug)]
struct Shaft {
    teeth: u32,
    /// Pitch within the turn of the next value.
    place: u32,
    values: u32,
    ticks: f64,
    sums: [(f32, f32); ORDERS],
    latest: Option<ShaftOrders>,
}

impl Shaft {
    const IDLE: Self = Self { teeth: 0, place: 0, values: 0, ticks: 0.0, sums: [(0.0, 0.0); ORDERS], latest: None };

    fn begin(&mut self, place: u32) {
        *self = Self { teeth: self.teeth, place, latest: self.latest, ..Self::IDLE };
    }

    fn push(&mut self, value: f32, ticks: f32, long_enough: f32) {
        if self.teeth == 0 {
            return;
        }
        let step = phase_step(self.teeth as usize);
        for (order, sum) in (1u32..).zip(&mut self.sums) {
            let (cosine, sine) = math::cossin(step.wrapping_mul(order * self.place));
            sum.0 += value * cosine;
            sum.1 += value * sine;
        }
        self.place = if self.place + 1 == self.teeth { 0 } else { self.place + 1 };
        self.values += 1;
        self.ticks += f64::from(ticks);
        // Half a pitch of tolerance: a turn of just a second is long enough.
        if self.values.is_multiple_of(self.teeth) && self.ticks as f32 + 0.5 * ticks >= long_enough {
            self.latest = Some(self.orders());
            self.begin(self.place);
        }
    }

    fn orders(&self) -> ShaftOrders {
        let scale = 2.0 / self.values as f32;
        let mut lines = [OrderLine::default(); ORDERS];
        for ((order, line), (re, im)) in (1u32..).zip(&mut lines).zip(self.sums) {
            let offset = (WINDOW_PITCHES * order) as f32 / self.teeth as f32;
            let droop = Window::BlackmanHarris.response(offset);
            let phase_deg = math::atan2(im, re) * DEGREES;
            *line = OrderLine { amplitude: math::hypot(re, im) * scale / droop, phase_deg };
        }
        ShaftOrders { lines, turns: self.values.checked_div(self.teeth).unwrap_or(0) as u16 }
    }
}

/// Both shafts.
#[derive(Clone, Debug)]
pub struct ShaftLines {
    pinion: Shaft,
    gear: Shaft,
    /// A record lasts at least this long, ticks.
    long_enough: f32,
    begun: bool,
}

impl ShaftLines {
    /// Without a gear pair: takes values and gives nothing. All zero bytes but the option's, for statics.
    pub const IDLE: Self = Self { pinion: Shaft::IDLE, gear: Shaft::IDLE, long_enough: 0.0, begun: false };

    /// For a pair of teeth; records last at least `long_enough` ticks.
    pub fn configure(&mut self, pinion_teeth: u16, gear_teeth: u16, long_enough: f32) {
        *self = Self::IDLE;
        (self.pinion.teeth, self.gear.teeth) = (u32::from(pinion_teeth), u32::from(gear_teeth));
        self.long_enough = long_enough;
    }

    /// The values so far are no part of what comes.
    pub fn interrupt(&mut self) {
        self.begun = false;
    }

    /// A turn of the pinion begins, the `number`-th since the lock. The first one after an interruption says where
    /// values begin.
    pub fn begin_turn(&mut self, number: u32) {
        if core::mem::replace(&mut self.begun, true) || self.gear.teeth == 0 || self.pinion.teeth == 0 {
            return;
        }
        // The first value comes when the window is full, and describes its middle.
        let middle = WINDOW_PITCHES / 2;
        self.pinion.begin(middle % self.pinion.teeth);
        let gear = u64::from(number) * u64::from(self.pinion.teeth) + u64::from(middle);
        self.gear.begin((gear % u64::from(self.gear.teeth)) as u32);
    }

    /// One value of the filter bank, of a pitch of this duration.
    pub fn push(&mut self, value: f32, pitch_ticks: f32) {
        if self.begun {
            self.pinion.push(value, pitch_ticks, self.long_enough);
            self.gear.push(value, pitch_ticks, self.long_enough);
        }
    }

    /// The newest complete record of the pinion and of the gear, once.
    pub fn take(&mut self) -> (Option<ShaftOrders>, Option<ShaftOrders>) {
        (self.pinion.latest.take(), self.gear.latest.take())
    }

    /// Forgets complete records as well: the gear's angle has begun anew.
    pub fn reset(&mut self) {
        self.interrupt();
        (self.pinion.latest, self.gear.latest) = (None, None);
    }
}
