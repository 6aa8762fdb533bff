//! The stated error of every function in `meshband::math`, against f64 over at least 10^5 points each.

use meshband::math;
use std::f64::consts::TAU;

/// Deterministic points in 0..1.
fn unit(i: u32) -> f64 {
    f64::from(i.wrapping_mul(2_654_435_761)) / 4_294_967_296.0
}

const POINTS: u32 = 200_000;

fn worst(mut error: impl FnMut(f64) -> f64) -> f64 {
    (0..POINTS).map(|i| error(unit(i))).fold(0.0, f64::max)
}

#[test]
fn theory_square_root_is_correctly_rounded() {
    for i in 0..POINTS {
        let x = f32::from_bits((f64::from(0x7f00_0000u32) * unit(i)) as u32);
        assert_eq!(math::sqrt(x).to_bits(), (f64::from(x).sqrt() as f32).to_bits(), "sqrt of {x}");
    }
    assert!(math::sqrt(-1.0).is_nan());
}

#[test]
fn theory_cossin_holds_its_error() {
    let mut worst_error = 0.0f64;
    for i in 0..1_000_000u32 {
        let phase = i.wrapping_mul(2_654_435_761);
        let (c, s) = math::cossin(phase);
        let angle = TAU * f64::from(phase) / 4_294_967_296.0;
        worst_error = worst_error.max((f64::from(c) - angle.cos()).abs()).max((f64::from(s) - angle.sin()).abs());
    }
    println!("cossin: {worst_error:e}");
    assert!(worst_error < 1.3e-7, "{worst_error:e}");
    assert_eq!(math::cossin(0), (1.0, 0.0));
    assert_eq!(math::cossin(1 << 30), (0.0, 1.0));
}

#[test]
fn theory_sine_and_cosine_hold_their_error_within_a_turn() {
    let error = worst(|u| {
        let x = (2.0 * u - 1.0) * TAU;
        let x32 = x as f32;
        let x = f64::from(x32);
        (f64::from(math::sin(x32)) - x.sin()).abs().max((f64::from(math::cos(x32)) - x.cos()).abs())
    });
    println!("sin, cos: {error:e}");
    assert!(error < 5e-7, "{error:e}");
}

#[test]
fn theory_sinc_holds_near_zero_and_at_integers() {
    let error = worst(|u| {
        let x = (20.0 * u) as f32;
        let y = std::f64::consts::PI * f64::from(x);
        let exact = if x == 0.0 { 1.0 } else { y.sin() / y };
        (f64::from(math::sinc(x)) - exact).abs()
    });
    assert!(error < 1e-6, "{error:e}");
    assert_eq!(math::sinc(0.0), 1.0);
    assert!(math::sinc(3.0).abs() < 1e-6);
}

#[test]
fn theory_atan2_holds_its_error_in_all_quadrants() {
    let mut error = 0.0f64;
    for i in 0..POINTS {
        let angle = (2.0 * unit(i) - 1.0) * std::f64::consts::PI;
        let length = 10f64.powf(12.0 * unit(i.wrapping_add(77)) - 6.0);
        let (y, x) = ((length * angle.sin()) as f32, (length * angle.cos()) as f32);
        error = error.max((f64::from(math::atan2(y, x)) - f64::from(y).atan2(f64::from(x))).abs());
    }
    assert!(error < 3e-7, "{error:e}");
    assert_eq!(math::atan2(0.0, 0.0), 0.0);
}

#[test]
fn theory_logarithms_and_decibels_hold_their_error() {
    let mut log = 0.0f64;
    let mut decibel = 0.0f64;
    let mut coarse = 0.0f64;
    let mut inverse = 0.0f64;
    for i in 0..POINTS {
        let x = 10f64.powf(20.0 * unit(i) - 10.0) as f32;
        let exact = f64::from(x).ln();
        log = log.max(((f64::from(math::ln(x)) - exact).abs() - 1e-7) / exact.abs().max(1e-30));
        decibel = decibel.max((f64::from(math::decibels(x)) - 20.0 * f64::from(x).log10()).abs());
        coarse = coarse.max((f64::from(math::decibels_coarse(x)) - 20.0 * f64::from(x).log10()).abs());
        let level = (200.0 * unit(i) - 100.0) as f32;
        let exact = 10f64.powf(f64::from(level) / 20.0);
        inverse = inverse.max((f64::from(math::ratio_from_decibels(level)) / exact - 1.0).abs());
    }
    println!("ln {log:e}, dB {decibel:e}, coarse dB {coarse}, inverse {inverse:e}");
    assert!(log < 2e-7, "{log:e}");
    assert!(decibel < 4e-5, "{decibel:e}");
    assert!(coarse < 1.1, "{coarse}");
    assert!(inverse < 2e-6, "{inverse:e}");
}

#[test]
fn theory_floor_and_median_match_std() {
    for i in 0..POINTS {
        let x = ((2.0 * unit(i) - 1.0) * 1e6) as f32;
        assert_eq!(math::floor(x), x.floor());
    }
    assert_eq!(math::floor(3e9), 3e9);
    for count in 1..60u32 {
        let mut values: Vec<f32> = (0..count).map(|i| unit(i * 7 + count) as f32).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        let middle = count as usize / 2;
        let exact = if count % 2 == 1 { sorted[middle] } else { 0.5 * (sorted[middle - 1] + sorted[middle]) };
        assert_eq!(math::median(&mut values), Some(exact));
    }
    assert_eq!(math::median(&mut []), None);
}
