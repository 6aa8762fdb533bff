//! The alarm output: levels by practice and polarity, transitions by name, the minimum time, failing pins.

use embedded_hal_mock::eh1::MockError;
use embedded_hal_mock::eh1::digital::{Mock as Pin, State as Level, Transaction};
use meshband_drivers::alarm_output::{AlarmOutput, Practice, State, Transition};
use meshband_drivers::switch::Polarity;
use std::io::ErrorKind;

const MINIMUM: u64 = 1000;

fn output(levels: &[Level], polarity: Polarity, practice: Practice) -> (Pin, AlarmOutput<Pin>) {
    let transactions: Vec<_> = levels.iter().copied().map(Transaction::set).collect();
    let pin = Pin::new(&transactions);
    (pin.clone(), AlarmOutput::new(pin, polarity, practice, MINIMUM))
}

#[test]
fn theory_levels_follow_practice_and_polarity() {
    use Level::{High, Low};
    use Polarity::{ActiveHigh, ActiveLow};
    use Practice::{EnergisedInAlarm, EnergisedInHealth};
    for (practice, polarity, healthy, alarm) in [
        (EnergisedInHealth, ActiveHigh, High, Low),
        (EnergisedInHealth, ActiveLow, Low, High),
        (EnergisedInAlarm, ActiveHigh, Low, High),
        (EnergisedInAlarm, ActiveLow, High, Low),
    ] {
        let (mut pin, mut output) = output(&[healthy, alarm, healthy], polarity, practice);
        for (stands, now) in [(false, 0), (false, 10), (true, 20), (true, 30), (false, 1020), (false, 1030)] {
            output.update(stands, now).unwrap();
        }
        pin.done();
    }
}

#[test]
fn theory_output_is_not_energised_before_the_first_judgement() {
    let (mut pin, output) = output(&[], Polarity::ActiveHigh, Practice::EnergisedInHealth);
    assert_eq!(output.state(), State::Starting);
    assert!(!output.is_alarm());
    pin.done();
}

#[test]
fn theory_every_transition_has_its_name() {
    let (mut pin, mut output) =
        output(&[Level::High, Level::Low, Level::High], Polarity::ActiveHigh, Practice::EnergisedInHealth);
    let steps = [
        (false, 5, Some(Transition::Started)),
        (false, 6, None),
        (true, 7, Some(Transition::Raised)),
        (true, 1006, None),
        (true, 1007, Some(Transition::Stood)),
        (true, 9000, None),
        (false, 9001, Some(Transition::Cleared)),
        (false, 9002, None),
    ];
    for (stands, now, transition) in steps {
        assert_eq!(output.update(stands, now), Ok(transition), "at {now}");
    }
    pin.done();
}

#[test]
fn theory_an_alarm_at_the_first_judgement_never_shows_healthy() {
    let (mut pin, mut output) = output(&[Level::Low], Polarity::ActiveHigh, Practice::EnergisedInHealth);
    assert_eq!(output.update(true, 0), Ok(Some(Transition::Raised)));
    assert!(output.is_alarm());
    pin.done();
}

#[test]
fn theory_a_short_alarm_is_shown_for_the_minimum_time() {
    // Across the wrap of the counter too.
    for start in [0u32, u32::MAX - 500, u32::MAX] {
        let (mut pin, mut output) =
            output(&[Level::Low, Level::High, Level::Low], Polarity::ActiveHigh, Practice::EnergisedInAlarm);
        let mut at = |stands, after: u32| output.update(stands, start.wrapping_add(after)).unwrap();
        assert_eq!(at(false, 0), Some(Transition::Started));
        assert_eq!(at(true, 1), Some(Transition::Raised));
        for after in [2, 300, 700, 1000] {
            assert_eq!(at(false, after), None, "{after} after {start}");
        }
        assert_eq!(at(false, 1001), Some(Transition::Cleared));
        pin.done();
    }
}

#[test]
fn theory_an_alarm_that_comes_back_within_the_minimum_time_goes_on() {
    let (mut pin, mut output) = output(&[Level::High], Polarity::ActiveHigh, Practice::EnergisedInAlarm);
    let steps = [(true, 0), (false, 400), (true, 900), (true, 1000), (true, 2000)];
    let transitions = steps.map(|(stands, now)| output.update(stands, now).unwrap());
    assert_eq!(transitions, [Some(Transition::Raised), None, None, Some(Transition::Stood), None]);
    pin.done();
}

#[test]
fn theory_a_standing_alarm_clears_at_once_however_often_the_counter_wrapped() {
    let (mut pin, mut output) = output(&[Level::High, Level::Low], Polarity::ActiveHigh, Practice::EnergisedInAlarm);
    let mut now = 0u32;
    output.update(true, now).unwrap();
    for _ in 0..40 {
        now = now.wrapping_add(u32::MAX / 4);
        output.update(true, now).unwrap();
    }
    assert_eq!(output.state(), State::Standing);
    // So placed that the wrapped distance from its raising is below the minimum time.
    assert_eq!(output.update(false, 500), Ok(Some(Transition::Cleared)));
    pin.done();
}

#[test]
fn fault_failed_write_is_reported_and_the_alarm_still_shown_at_the_next_update() {
    let fault = MockError::Io(ErrorKind::NotConnected);
    let mut pin = Pin::new(&[
        Transaction::set(Level::High),
        Transaction::set(Level::Low).with_error(fault.clone()),
        Transaction::set(Level::Low),
    ]);
    let mut output = AlarmOutput::new(pin.clone(), Polarity::ActiveHigh, Practice::EnergisedInHealth, MINIMUM);
    output.update(false, 0).unwrap();
    assert_eq!(output.update(true, 1), Err(fault));
    assert!(output.is_alarm());
    assert_eq!(output.update(true, 2), Ok(None));
    pin.done();
}
