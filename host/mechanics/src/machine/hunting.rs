//! The hunting period: after how many turns the same teeth meet again, and what of a vibration tells those turns apart.

/// The hunting period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hunting {
    /// Turns of the pinion after which the same teeth meet.
    pub turns: u32,
    /// Order of the gear's rotation per turn of the pinion.
    pub ratio: f64,
}

/// How an effect depends on the start of its run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freedom {
    /// Not at all: orders of the pinion.
    None,
    /// By whole turns of the pinion: orders of the gear.
    Turns,
    /// In any way: an order of neither shaft.
    Phase,
}

impl Hunting {
    /// Of a pair with these numbers of teeth.
    pub fn of(teeth: [u32; 2]) -> Self {
        let (mut a, mut b) = (teeth[1], teeth[0]);
        while b > 0 {
            (a, b) = (b, a % b);
        }
        Self { turns: teeth[1] / a, ratio: f64::from(teeth[0]) / f64::from(teeth[1]) }
    }

    /// Dependence of an effect whose quadrature pairs stand at these orders.
    pub fn freedom(&self, orders: &[f64]) -> Freedom {
        let whole = |x: f64| (x - x.round()).abs() < 1e-6;
        if self.turns < 2 || orders.iter().all(|&o| whole(o)) {
            Freedom::None
        } else if orders.iter().all(|&o| whole(o / self.ratio)) {
            Freedom::Turns
        } else if orders.len() == 1 {
            Freedom::Phase
        } else {
            Freedom::None
        }
    }
}
