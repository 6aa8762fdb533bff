//! The strongest lines of a wideband record: each once, strongest first, nothing else between them.

use meshband::peaks::strongest;
use meshband::stream::WIDE_POINTS;
use std::f64::consts::TAU;

#[test]
fn theory_each_tone_is_one_line_and_nothing_else_is() {
    // Bin and amplitude; the second lies in the first one's neighbourhood, but beyond its lobe.
    let tones = [(500.3, 1.0), (511.0, 0.3), (1500.7, 0.1), (60.5, 0.03)];
    let mut record = [0.0_f32; WIDE_POINTS];
    for (n, x) in record.iter_mut().enumerate() {
        let tone = |(bin, amplitude): (f64, f64)| amplitude * (TAU * bin * n as f64 / WIDE_POINTS as f64).cos();
        *x = (2.0 + tones.map(tone).iter().sum::<f64>()) as f32;
    }
    let (lines, _) = strongest(&mut record, 1.0);
    for (line, (bin, amplitude)) in lines.iter().zip(tones) {
        assert!((f64::from(line.frequency_hz) - bin).abs() < 0.01, "{line:?} for {bin}");
        assert!((f64::from(line.amplitude) / amplitude - 1.0).abs() < 0.01, "{line:?} for {amplitude}");
    }
    for line in &lines[tones.len()..] {
        assert!(line.amplitude < 1e-3, "{line:?} is no tone");
    }
}
