//! When an angle that grows over time passes given angles: edges of a tachometer.

/// Halvings of a sample's interval: far below a nanosecond at any rate.
const HALVINGS: usize = 50;

/// Times, s, at which the angle passes `targets` (ascending) after sample 0 and up to the last sample.
///
/// `turns` is the angle at `index / rate_hz`, `angle` the same at any time, s; between two samples it must not turn
/// back.
pub fn crossings(
    turns: &[f64],
    rate_hz: f64,
    angle: &impl Fn(f64) -> f64,
    targets: impl Iterator<Item = f64>,
) -> Vec<f64> {
    let (mut times, mut i) = (Vec::new(), 1);
    for target in targets {
        while i < turns.len() && turns[i] < target {
            i += 1;
        }
        if i >= turns.len() {
            break;
        }
        let (mut low, mut high) = ((i - 1) as f64 / rate_hz, i as f64 / rate_hz);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if angle(middle) >= target { high = middle } else { low = middle }
        }
        times.push(high);
    }
    times
}
