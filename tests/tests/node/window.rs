//! Window figures against their defining sums in f64 and the published values.

use meshband::window::Window;
use std::f64::consts::TAU;

const ALL: [Window; 4] = [Window::Rectangular, Window::Hann, Window::BlackmanHarris, Window::FlatTop];

fn values(window: Window, count: usize) -> Vec<f64> {
    let mut ones = vec![1.0f32; count];
    window.apply(&mut ones, 0.0);
    ones.into_iter().map(f64::from).collect()
}

/// |W(offset)| / |W(0)| by the defining sum.
fn response(values: &[f64], offset: f64) -> f64 {
    let n = values.len() as f64;
    let (mut re, mut im) = (0.0, 0.0);
    for (i, w) in values.iter().enumerate() {
        let angle = TAU * offset * i as f64 / n;
        re += w * angle.cos();
        im += w * angle.sin();
    }
    re.hypot(im) / values.iter().sum::<f64>()
}

#[test]
fn theory_figures_match_the_defining_sums() {
    for window in ALL {
        let w = values(window, 1024);
        let mean = w.iter().sum::<f64>() / 1024.0;
        let square = w.iter().map(|x| x * x).sum::<f64>() / 1024.0;
        assert!((mean - f64::from(window.coherent_gain())).abs() < 1e-6, "{window:?}");
        assert!((square - f64::from(window.power())).abs() < 1e-6, "{window:?}");
        assert!((square / mean / mean - f64::from(window.enbw_bins())).abs() < 1e-5, "{window:?}");
        for offset in [0.1, 0.25, 0.5, 0.9, 1.3, 1.7] {
            let exact = response(&w, offset);
            let closed = f64::from(window.response(offset as f32));
            assert!((exact - closed.abs()).abs() < 5e-6, "{window:?} at {offset}: {exact} {closed}");
        }
    }
}

#[test]
fn ref_response_is_the_sum_of_its_terms_on_and_beside_every_whole_bin() {
    let sinc = |x: f64| if x == 0.0 { 1.0 } else { (TAU * 0.5 * x).sin() / (TAU * 0.5 * x) };
    for window in ALL {
        let a: Vec<f64> = window.coefficients().iter().map(|&a| f64::from(a)).collect();
        for thousandth in -6_500..=6_500 {
            let offset = f64::from(thousandth) * 1e-3;
            let pair = |(k, a): (usize, &f64)| 0.5 * a * (sinc(offset - k as f64) + sinc(offset + k as f64));
            let exact = sinc(offset) + a.iter().enumerate().skip(1).map(pair).sum::<f64>() / a[0];
            let found = f64::from(window.response(offset as f32));
            assert!((found - exact).abs() < 4e-6, "{window:?} at {offset}: {found} for {exact}");
        }
    }
}

#[test]
fn ref_published_enbw_and_scallop_loss() {
    for (window, enbw, scallop) in [
        (Window::Rectangular, 1.0, 3.9224),
        (Window::Hann, 1.5, 1.4236),
        (Window::BlackmanHarris, 2.0044, 0.8256),
        (Window::FlatTop, 3.8832, 0.0039),
    ] {
        assert!((window.enbw_bins() - enbw).abs() < 1e-4, "{window:?} {}", window.enbw_bins());
        assert!((window.scallop_loss_db() - scallop).abs() < 2e-4, "{window:?} {}", window.scallop_loss_db());
    }
}

#[test]
fn ref_highest_side_lobes() {
    for (window, level_db) in [(Window::Hann, -31.4), (Window::BlackmanHarris, -92.0), (Window::FlatTop, -90.2)] {
        let w = values(window, 1024);
        let first = f64::from(window.main_lobe_bins());
        let highest = (0..800).map(|i| response(&w, first + f64::from(i) * 0.05)).fold(0.0, f64::max);
        let level = 20.0 * highest.log10();
        assert!((level - level_db).abs() < 0.25, "{window:?}: {level}");
    }
}

#[test]
fn theory_offset_is_recovered_from_the_neighbour_ratio() {
    for window in [Window::Rectangular, Window::Hann, Window::BlackmanHarris] {
        for i in 0..=50 {
            let offset = f64::from(i) / 100.0;
            let ratio = window.response(1.0 - offset as f32) / window.response(offset as f32);
            let found = f64::from(window.offset_from_ratio(ratio));
            assert!((found - offset).abs() < 2e-4, "{window:?}: {offset} read as {found}");
        }
    }
}
