//! Pulses as wheels and pick-ups really give them: second edges, joints, eccentric wheels, bolts, ratios; and what is
//! made of them.

use crate::rig::{Rig, none, slow_converter, steady};
use meshband::board::Timing;
use meshband::config::{Configuration, ConfigurationError};
use meshband::events::EventKind;
use meshband::tach::Validity;
use meshband::units::Hertz;
use std::f64::consts::TAU;

fn mesh(t: f64) -> f64 {
    10.0 * (TAU * 19.0 * 20.0 * t).sin()
}

/// One pulse per turn at 20 Hz; behind a share of them a second edge.
fn bouncing(delay: f64, share: f64) -> impl Fn(u64) -> f64 {
    move |n| {
        let every = (1.0 / share).round() as u64;
        let (round, place) = (n / (every + 1), n % (every + 1));
        let turn = round * every + place.min(every - 1);
        (turn as f64 + 0.5) / 20.0 + if place == every { delay } else { 0.0 }
    }
}

fn share_locked(rig: &Rig) -> f64 {
    let locked = rig.statuses.iter().filter(|status| status.validity == Validity::Locked).count();
    locked as f64 / rig.statuses.len() as f64
}

#[test]
fn regress_a5_a_second_edge_behind_each_pulse_does_not_unlock() {
    for delay in [0.0002, 0.002, 0.005] {
        for share in [1.0, 0.3, 0.1] {
            let mut rig = Rig::new(slow_converter());
            rig.run(2.0, mesh, bouncing(delay, share)).forget().run(12.0, mesh, bouncing(delay, share));
            let locked = share_locked(&rig);
            assert!(locked > 0.99, "{delay} s behind {share}: locked {locked}");
            let status = rig.status();
            assert!((status.speed_hz / 20.0 - 1.0).abs() < 1e-3, "{status:?}");
            assert!(rig.node.statistics().pulses_spurious > 0, "and counted");
        }
    }
}

#[test]
fn regress_a16_a_shaft_faster_than_declared_is_told_as_such_and_not_at_half_its_speed() {
    let mut config = slow_converter();
    config.tach.highest = Hertz(30.0);
    let mut rig = Rig::new(config);
    rig.run(6.0, mesh, steady(34.0));
    assert!(rig.statuses.iter().all(|status| status.validity != Validity::Locked));
    assert!(!rig.said(EventKind::TachTooFast).is_empty(), "{:?}", rig.events);
}

#[test]
fn regress_a14_an_encoder_that_the_board_cannot_follow_is_refused() {
    let encoder = |highest: f32, pulses_per_turn: u16| {
        let mut config = slow_converter();
        (config.tach.highest, config.tach.pulses_per_turn) = (Hertz(highest), pulses_per_turn);
        config.validate(Timing::STM32F405)
    };
    // 1024 pulses per turn were right at 20 Hz and lost edges at 40 Hz.
    assert_eq!(encoder(14.0, 1024), Ok(()));
    assert_eq!(encoder(40.0, 1024), Err(ConfigurationError::TachTooManyPulses));
    assert_eq!(encoder(60.0, 1024), Err(ConfigurationError::TachTooManyPulses));
    assert_eq!(encoder(60.0, 60), Ok(()));
}

#[test]
fn regress_a6_no_gear_condition_is_made_while_the_tach_is_doubtful() {
    // Two pulses per turn, one a third late: the tracker never agrees.
    let doubtful = |n: u64| (n as f64 + if n.is_multiple_of(2) { 0.0 } else { 0.33 } + 0.1 * (n % 3) as f64) / 20.0;
    let mut config = slow_converter();
    config.tach.highest = Hertz(200.0);
    let mut rig = Rig::new(config);
    rig.run(20.0, mesh, doubtful);
    for values in &rig.indicators {
        assert!(values.gear.is_none() || values.tag.validity == Validity::Locked, "{values:?}");
    }
}

/// Zebra tape with a butt joint: the last pitch is shorter or longer than the others.
fn joined(hz: f64, pulses: u64, last: f64) -> impl Fn(u64) -> f64 {
    move |n| {
        let (turn, place) = (n / pulses, n % pulses);
        let whole = (pulses - 1) as f64 + last;
        (turn as f64 + place as f64 / whole + 0.001) / hz
    }
}

fn zebra(pulses: u16) -> Configuration {
    let mut config = slow_converter();
    config.tach.pulses_per_turn = pulses;
    config
}

#[test]
fn regress_a8_a_joint_in_a_zebra_tape_is_learned() {
    for last in [0.98, 0.95, 0.9, 0.5, 1.1] {
        let mut rig = Rig::new(zebra(60));
        rig.run(3.0, mesh, joined(20.0, 60, last)).forget().run(15.0, mesh, joined(20.0, 60, last));
        assert!(rig.spectra.len() > 8, "joint {last}: {} spectra", rig.spectra.len());
        assert!(rig.indicators.iter().any(|values| values.gear.is_some()), "joint {last}: averages");
        assert!(rig.indicators.iter().filter(|values| values.pinion.is_some()).count() > 8, "joint {last}: orders");
        assert!(share_locked(&rig) > 0.99, "joint {last}: {} locked, {:?}", share_locked(&rig), rig.events);
        for status in &rig.statuses {
            assert!((status.speed_hz / 20.0 - 1.0).abs() < 1e-3, "joint {last}: {}", status.speed_hz);
        }
    }
}

#[test]
fn regress_a8_an_eccentric_wheel_s_speed_is_right_and_so_is_its_uncertainty() {
    for eccentricity in [0.02, 0.1] {
        let pulses = 60u64;
        let pulse = move |n: u64| {
            let place = TAU * (n % pulses) as f64 / pulses as f64;
            (n as f64 + eccentricity * place.sin()) / pulses as f64 / 20.0 + 0.001
        };
        let mut rig = Rig::new(zebra(60));
        rig.run(5.0, mesh, pulse).forget().run(12.0, mesh, pulse);
        for status in &rig.statuses {
            let off = f64::from((status.speed_hz / 20.0 - 1.0).abs());
            assert!(off < 3.0 * f64::from(status.speed_uncertainty) + 1e-4, "{eccentricity}: {off} {status:?}");
            assert!(off < 1e-3, "{eccentricity}: {off}");
        }
    }
}

#[test]
fn regress_a8_bolts_at_uneven_places_are_learned() {
    // One draw of places, 8 % RMS of a pitch.
    let places = [0.03, -0.11, 0.09, 0.02, -0.07, 0.12, -0.05, -0.03];
    let pulse = move |n: u64| (n as f64 + places[(n % 8) as usize]) / 8.0 / 20.0 + 0.01;
    let mut rig = Rig::new(zebra(8));
    rig.run(5.0, mesh, pulse).forget().run(15.0, mesh, pulse);
    assert!(share_locked(&rig) > 0.99 && rig.spectra.len() > 8, "{} {}", share_locked(&rig), rig.spectra.len());
    for status in &rig.statuses {
        assert!((status.speed_hz / 20.0 - 1.0).abs() < 1e-3, "{}", status.speed_hz);
    }
}

#[test]
fn theory_a_joint_is_learned_while_the_speed_changes() {
    // 10 Hz to 20 Hz at 5 % of 20 Hz per second.
    let angle_to_time = |turns: f64| ((100.0 + 2.0 * turns).sqrt() - 10.0) / 1.0;
    let pulse = move |n: u64| {
        let (turn, place) = (n / 60, n % 60);
        angle_to_time(turn as f64 + place as f64 / 59.95)
    };
    let turns = |t: f64| 10.0 * t + 0.5 * t * t;
    let mut rig = Rig::new(zebra(60));
    rig.run(2.0, mesh, pulse).forget().run(9.0, mesh, pulse);
    assert!(share_locked(&rig) > 0.9, "{}", share_locked(&rig));
    let status = rig.status();
    // The node counts ticks from 2^32 on.
    let true_hz = 10.0 + f64::from(status.tick as u32) / 84.0e6;
    assert!((f64::from(status.speed_hz) / true_hz - 1.0).abs() < 2e-3, "{} {true_hz}", status.speed_hz);
    assert!(turns(9.0) > 100.0);
}

#[test]
fn fault_a_wheel_that_is_lost_and_comes_back_is_learned_again() {
    let mut rig = Rig::new(zebra(60));
    rig.run(4.0, mesh, joined(20.0, 60, 0.95)).run(6.0, mesh, none);
    rig.run(10.0, mesh, joined(20.0, 60, 0.95)).forget().run(18.0, mesh, joined(20.0, 60, 0.95));
    assert!(rig.spectra.len() > 6 && share_locked(&rig) > 0.99);
}

/// Phase of once per turn against a fixed angle, of the latest values, degrees.
fn phase(rig: &Rig) -> f32 {
    rig.values().pinion.expect("orders").lines[0].phase_deg
}

fn apart(a: f32, b: f32) -> f32 {
    let turns = (a - b) / 360.0;
    360.0 * (turns - turns.round()).abs()
}

#[test]
fn regress_a9_the_phase_of_a_wheel_with_a_gap_is_the_same_after_every_start() {
    let gap = |hz: f64, from: u64| {
        move |n: u64| {
            let n = n + from;
            (n / 58 * 60 + n % 58 + 1) as f64 / 60.0 / hz - (from / 58) as f64 / hz + 0.001
        }
    };
    let unbalance = |t: f64| 5.0 * (TAU * 20.0 * t + 0.3).cos();
    let mut phases = Vec::new();
    for from in [0, 17, 41] {
        let mut config = zebra(60);
        config.tach.missing = 2;
        let mut rig = Rig::new(config);
        // The wheel's angle zero is at the same time, whichever tooth comes first.
        let pulse = gap(20.0, from);
        let start = pulse(0);
        rig.run(6.0, unbalance, move |n| if n == 0 { start } else { pulse(n) });
        phases.push(phase(&rig));
        // A drop-out of 0.4 s.
        let pulse = gap(20.0, from);
        rig.run(6.4, unbalance, none).run(12.0, unbalance, pulse);
        phases.push(phase(&rig));
    }
    for other in &phases {
        assert!(apart(*other, phases[0]) < 1.0, "{phases:?}");
    }
}

#[test]
fn regress_a9_marks_do_not_drift_against_the_pulses() {
    use meshband::config::TachWheel;
    use meshband::tach::TachTracker;
    use meshband::turn_marks::TurnMarks;
    use meshband::units::TicksPerSecond;
    // The tach on the gear of 48, the pinion has 19: 48/19 turns of the pinion per pulse.
    let wheel = TachWheel {
        pulses_per_turn: 1,
        missing: 0,
        pinion_per_tach: 48.0 / 19.0,
        highest: Hertz(100.0),
        lowest: Hertz(0.25),
    };
    let clock = TicksPerSecond(1_000_000);
    let (mut tach, mut marks) = (TachTracker::new(wheel, clock), TurnMarks::new(&wheel));
    let (mut count, mut first, mut last) = (0u64, None, 0u64);
    // A million turns of the gear, 100 ms each.
    for n in 1..=1_000_000u64 {
        tach.on_pulse(100_000 * n);
        marks.follow(&tach, |instant| {
            (first, last) = (first.or(Some(instant)), instant);
            count += 1;
        });
    }
    let first = first.expect("marks");
    let expected = (count - 1) as f64 * 100_000.0 * 19.0 / 48.0;
    let drift = ((last - first) as f64 - expected) / (100_000.0 * 19.0 / 48.0) * 360.0;
    assert!(drift.abs() < 0.1, "{drift} degrees after {count} turns of the pinion");
}
