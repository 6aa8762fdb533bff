//! Numbers of several solutions side by side, as the compiler puts them into vector units.
//!
//! Operations are written lane by lane and never fused, so one solution gives the same bits alone, beside others, and
//! on every processor. Who computes with them dispatches by `pulp`, so that the widest units at hand are used.

use std::ops::{Add, Mul, Sub};

/// A number of one solution, or of several side by side.
pub trait Lane: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Whether all coordinates of an order fit into the processor's registers.
    const IN_REGISTERS: bool;
    /// The same value for all.
    fn of(value: f64) -> Self;
    /// One value for each solution.
    fn each(&self) -> &[f64];
}

impl Lane for f64 {
    const IN_REGISTERS: bool = true;

    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn each(&self) -> &[f64] {
        std::slice::from_ref(self)
    }
}

/// Numbers of several solutions side by side.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(32))]
pub struct Several(pub [f64; LANES]);

/// Solutions whose coefficients are computed side by side.
pub const LANES: usize = 4;

impl Several {
    #[inline(always)]
    fn with(self, other: Self, operation: impl Fn(f64, f64) -> f64) -> Self {
        Self(std::array::from_fn(|l| operation(self.0[l], other.0[l])))
    }
}

impl Add for Several {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.with(other, |a, b| a + b)
    }
}

impl Sub for Several {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.with(other, |a, b| a - b)
    }
}

impl Mul for Several {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.with(other, |a, b| a * b)
    }
}

impl Lane for Several {
    const IN_REGISTERS: bool = false;

    #[inline(always)]
    fn of(value: f64) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn each(&self) -> &[f64] {
        &self.0
    }
}
