//! Octave plan over all speeds, laws and limits.

use meshband::law::{Law, LawForm};
use meshband::rate_plan::{RateLimits, RatePlan, RatePolicy};
use meshband::units::{Hertz, TicksPerSecond};

const LIMITS: RateLimits = RateLimits { analogue_stop: Hertz(100_000.0), highest_adc: Hertz(500_000.0) };

fn laws() -> Vec<Law> {
    let mut wide = Law::PROVISIONAL;
    wide.highest = Hertz(60.0);
    let mut physical = wide;
    physical.form = LawForm::Physical { ramp_turns: 1.2e-4, mode_rise_s: 8.0e-6 };
    vec![wide, physical]
}

#[test]
fn theory_no_rate_lets_the_analogue_filter_alias() {
    for clock in [84_000_000, 25_000_000] {
        for law in laws() {
            for policy in [RatePolicy::Critical, RatePolicy::Spectrum, RatePolicy::Waveform { multiple: 8.0 }] {
                let mut plan = RatePlan::new(TicksPerSecond(clock), LIMITS);
                let mut speed = 0.5f32;
                while speed <= 60.0 {
                    let wanted = policy.rate(law.bandwidth(Hertz(speed)).bandwidth);
                    let grant = plan.grant(wanted);
                    assert!(grant.adc.0 >= 2.0 * LIMITS.analogue_stop.0, "{speed} Hz: {grant:?}");
                    assert!(grant.adc.0 <= LIMITS.highest_adc.0, "{speed} Hz: {grant:?}");
                    assert!(!grant.aliasing);
                    let exact = f64::from(clock) / f64::from(grant.period_ticks) / f64::from(1u32 << grant.stages);
                    assert!((f64::from(grant.output.0) / exact - 1.0).abs() < 2.0e-7);
                    if !grant.limited {
                        // One tick, where the octave's floor forbids the nearest; half a tick elsewhere.
                        let tick = 1.0e6 / f64::from(grant.period_ticks);
                        assert!(f64::from(grant.residual.0).abs() <= 1.01 * tick, "{speed} Hz: {grant:?}");
                    }
                    speed *= 1.003;
                }
            }
        }
    }
}

#[test]
fn theory_residual_stays_within_150_ppm_where_the_timer_allows() {
    // Filter and ADC of a slow node: the octave lies below 300e-6 times the time base.
    let limits = RateLimits { analogue_stop: Hertz(5_000.0), highest_adc: Hertz(25_000.0) };
    let mut plan = RatePlan::new(TicksPerSecond(84_000_000), limits);
    let mut wanted = 50.0f32;
    while wanted < 20_000.0 {
        let grant = plan.grant(Hertz(wanted));
        assert!(grant.residual.0.abs() <= 150.0, "{wanted}: {grant:?}");
        wanted *= 1.01;
    }
}

#[test]
fn theory_a_speed_dithering_on_an_octave_border_changes_no_stage() {
    let mut plan = RatePlan::new(TicksPerSecond(84_000_000), LIMITS);
    for border in [200_000.0f32, 100_000.0, 50_000.0, 12_500.0] {
        plan.grant(Hertz(border * 1.5));
        plan.grant(Hertz(border * 0.99));
        let stages = plan.grant(Hertz(border * 0.99)).stages;
        for n in 0..100 {
            let dither = if n % 2 == 0 { 1.02 } else { 0.98 };
            assert_eq!(plan.grant(Hertz(border * dither)).stages, stages, "{border}");
        }
    }
}

#[test]
fn fault_absurd_wishes_get_the_highest_rate_and_say_so() {
    for wish in [0.0, -1.0, f32::NAN, f32::INFINITY, 1.0e9] {
        let grant = RatePlan::new(TicksPerSecond(84_000_000), LIMITS).grant(Hertz(wish));
        assert!(grant.limited && grant.adc.0 <= 500_000.0 && grant.adc.0 > 490_000.0, "{wish}: {grant:?}");
    }
    let grant = RatePlan::new(TicksPerSecond(84_000_000), LIMITS).grant(Hertz(1.0e-3));
    assert!(grant.limited && !grant.aliasing, "{grant:?}");
}

#[test]
fn theory_a_forced_rate_is_exact_and_flagged() {
    let grant = RatePlan::new(TicksPerSecond(84_000_000), LIMITS).force(Hertz(10_000.0));
    assert_eq!((grant.period_ticks, grant.stages, grant.output.0), (8_400, 0, 10_000.0));
    assert!(grant.aliasing && grant.usable.0 == 0.0);
}
