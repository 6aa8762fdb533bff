//! Octave plan over all speeds, laws and limits.

use meshband::board::Timing;
use meshband::config::{Configuration, ConfigurationError};
use meshband::law::{Law, LawForm};
use meshband::rate_plan::{RateLimits, RatePlan, RatePolicy};
use meshband::units::{Hertz, TicksPerSecond};

const LIMITS: RateLimits = RateLimits { analogue_stop: Hertz(100_000.0), highest_adc: Hertz(500_000.0) };

/// Every law form, the node's default among them.
fn laws() -> Vec<Law> {
    let mut wide = Law::PROVISIONAL;
    wide.highest = Hertz(60.0);
    let quadratic = Law { form: LawForm::Quadratic { a_per_hz: 12.0, b: 1_500.0, c_hz: 900.0 }, ..wide };
    let physical = Law { form: LawForm::Physical { ramp_turns: 1.2e-4, mode_rise_s: 8.0e-6 }, ..wide };
    let tabulated = meshband::law_data::law();
    assert!(matches!(tabulated.form, LawForm::Tabulated(_)));
    vec![wide, quadratic, physical, tabulated]
}

const POLICIES: [RatePolicy; 3] = [RatePolicy::Critical, RatePolicy::Spectrum, RatePolicy::Waveform { multiple: 8.0 }];

#[test]
fn theory_no_rate_lets_the_analogue_filter_alias_and_none_is_below_the_laws() {
    for board in [Timing::STM32F405, Timing::AN386] {
        let clock = board.clock.0;
        let (mut most, mut limited, mut grants) = (0.0f64, 0, 0);
        for law in laws() {
            for policy in POLICIES {
                let mut plan = RatePlan::new(board, LIMITS);
                let mut speed = 0.5f32;
                while speed <= 60.0 {
                    let wanted = policy.rate(law.bandwidth(Hertz(speed)).bandwidth);
                    let grant = plan.grant(wanted);
                    assert!(grant.adc.0 >= 2.0 * LIMITS.analogue_stop.0, "{speed} Hz: {grant:?}");
                    assert!(grant.adc.0 <= LIMITS.highest_adc.0, "{speed} Hz: {grant:?}");
                    assert_eq!(grant.period_ticks % board.period_step, 0, "{speed} Hz: {grant:?}");
                    assert!(!grant.aliasing);
                    // What is reported is what the integer period does.
                    let exact = f64::from(clock) / f64::from(grant.period_ticks) / f64::from(1u32 << grant.stages);
                    assert!((f64::from(grant.output.0) / exact - 1.0).abs() < 2.0e-7);
                    let excess = exact / f64::from(wanted.0) - 1.0;
                    assert!((f64::from(grant.residual.0) - 1.0e6 * excess).abs() < 0.3, "{speed} Hz: {grant:?}");
                    grants += 1;
                    if grant.limited {
                        limited += 1;
                    } else {
                        // Never below the law's, and less than a step of the period above it.
                        let step = f64::from(board.period_step) / f64::from(grant.period_ticks);
                        assert!(excess > -2.0e-7 && excess < 1.01 * step, "{speed} Hz: {excess} {grant:?}");
                        most = most.max(excess);
                    }
                    speed *= 1.003;
                }
            }
        }
        println!("{clock} ticks/s: {grants} grants, {limited} limited, excess at most {:.0} ppm", 1.0e6 * most);
    }
}

#[test]
fn theory_the_board_is_asked_in_ticks_so_that_request_and_grant_are_one_number() {
    use meshband::node::{Block, Node};
    let mut config = Configuration::default();
    for rate in [50_000.0f32, 123_456.0, 311_111.0] {
        config.policy = RatePolicy::Forced { rate: Hertz(rate) };
        let mut node = Box::new(Node::new(config.clone(), TicksPerSecond(84_000_000)).expect("a sound configuration"));
        let codes = [32_768u16; 512];
        let mut first_tick = 0;
        for sequence in 0..4 {
            let period_ticks = node.requested_period_ticks();
            node.on_block(Block { codes: &codes, second: &[], first_tick, period_ticks, sequence, overrun: false });
            first_tick += 512 * period_ticks;
            let active = node.active_rate();
            assert_eq!(active.period_ticks, period_ticks);
            assert_eq!(active.adc.0, 84.0e6 / period_ticks as f32);
        }
        // A board that does something else is found out and believed.
        let period_ticks = node.requested_period_ticks() + 3;
        node.on_block(Block { codes: &codes, second: &[], first_tick, period_ticks, sequence: 4, overrun: false });
        assert_eq!(node.active_rate().adc.0, 84.0e6 / period_ticks as f32);
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
fn fault_a_rate_that_the_board_cannot_sustain_is_refused() {
    let mut config = Configuration::default();
    assert_eq!(config.validate(Timing::STM32F405), Ok(()), "the default runs on every board");
    assert_eq!(config.validate(Timing::AN386), Ok(()));
    for rate in [420_001.0, 500_000.0, 750_000.0] {
        config.limits.highest_adc = Hertz(rate);
        assert_eq!(config.validate(Timing::STM32F405), Err(ConfigurationError::HighestAdc), "{rate}");
    }
    // And a plan that is asked for more all the same stays at what the board sustains.
    let limits = RateLimits { highest_adc: Hertz(750_000.0), ..LIMITS };
    let grant = RatePlan::new(Timing::STM32F405, limits).grant(Hertz(700_000.0));
    assert!(grant.adc.0 <= 420_000.0 && grant.limited, "{grant:?}");
    assert_eq!(RatePlan::new(Timing::STM32F405, limits).force(Hertz(750_000.0)).period_ticks, 200);
}

#[test]
fn theory_a_forced_rate_is_exact_and_flagged() {
    let grant = RatePlan::new(TicksPerSecond(84_000_000), LIMITS).force(Hertz(10_000.0));
    assert_eq!((grant.period_ticks, grant.stages, grant.output.0), (8_400, 0, 10_000.0));
    assert!(grant.aliasing && grant.usable.0 == 0.0);
}
