//! The closed loop: its forward model against records with nothing undeclared.

use meshband_host::closed_loop::angle::Angle;
use meshband_host::closed_loop::harmonic_model::Machine;
use meshband_host::closed_loop::input;
use meshband_host::closed_loop::spectrum::Analyser;
use std::path::Path;

/// Harmonic balance predicts the independent simulator's noise-free records.
#[test]
fn ref_harmonic_balance_leaves_a_thousandth_of_the_check_records() {
    for case in ["check-19-48", "check-55-75"] {
        let folder = Path::new("../../shared/vectors").join(case);
        if !folder.exists() {
            println!("skipped: {} is absent", folder.display());
            continue;
        }
        let record = input::read(&folder).expect("record");
        let machine = Machine::new(&record.pair, &record.shafts, &record.curve);
        for run in &record.runs {
            let angle = Angle::fit(run, record.pulses_per_rev, record.jitter_s);
            let analyser = Analyser::new(run.channels[0].len(), record.sample_rate_hz);
            let comb = machine.own_comb(angle.shaft_hz);
            let solution = machine.base(&comb, run.input_torque_n_m);
            for channel in 0..2 {
                let measured = analyser.bins_of(&run.channels[channel]);
                let model = analyser.bins_of_lines(&solution.lines, angle.offset_rad, angle.shaft_hz, channel, 160);
                let power = |bins: &mut dyn Iterator<Item = f64>| bins.skip(8).sum::<f64>().sqrt();
                let all = power(&mut measured.iter().map(|x| x.norm_sqr()));
                let left = power(&mut measured.iter().zip(&model).map(|(m, p)| (m - p).norm_sqr()));
                println!("{case} {:.3} Hz channel {channel}: {:.5}", angle.shaft_hz, left / all);
                assert!(left / all < 3e-3, "{case} channel {channel}: {}", left / all);
            }
        }
    }
}
