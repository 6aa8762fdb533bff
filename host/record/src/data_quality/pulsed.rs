//! Pulses of a tachometer beside the channels that its mesh is looked for in.

/// Pulses and channels as far as the check needs them.
pub struct Pulsed<'a> {
    /// Channels of the run, equally long.
    pub channels: &'a [Vec<f64>],
    /// Their sampling rate, Hz.
    pub rate_hz: f64,
    /// All pulses of the run.
    pub edges_s: &'a [f64],
    /// Pulses per turn of the tach's shaft.
    pub pulses: u32,
    /// Turns of the tach's shaft per turn of the pinion.
    pub ratio: f64,
    /// Its name, for people: "the pinion".
    pub shaft: String,
    /// Teeth of pinion and gear.
    pub teeth: [u32; 2],
    /// Carrier orders on each side of a mesh harmonic at which a planetary set has lines of its own: sidebands that
    /// stand there are no other number of teeth. 0 for a pair.
    pub passes: u32,
    /// The speed was only given, no pulse was measured.
    pub nominal: bool,
    /// Rate at which the pulses were sampled, Hz, where they come from a signal.
    pub sampled_at_hz: Option<f64>,
}

impl Pulsed<'_> {
    /// Mean speed of the tach's shaft, turns/s.
    pub(super) fn mean_speed_hz(&self) -> f64 {
        let (first, last) = (self.edges_s[0], self.edges_s[self.edges_s.len() - 1]);
        (self.edges_s.len() - 1) as f64 / f64::from(self.pulses) / (last - first)
    }

    /// What puts the mesh where it is implied, for sentences.
    pub(super) fn implied_by(&self) -> &'static str {
        if self.nominal { "the given speed and teeth" } else { "pulses and teeth" }
    }
}
