//! The node's alarms through everything that happens to a machine: no tach, bad signals, restarts, people.

use meshband::alarm::{AlarmBand, AlarmHolding, AlarmMode, Severity, Watched};
use meshband::config::{Configuration, OkOutput, PassBand};
use meshband::events::EventKind;
use meshband::health::BoardHealth;
use meshband::identity::Identity;
use meshband::message::{Bound, Indicators, Message, Request, Status};
use meshband::node::Block;
use meshband::session::Session;
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use std::f64::consts::TAU;

const BLOCK: usize = 512;
const CLOCK: u32 = 25_000_000;
const M_S2_PER_CODE: f64 = 0.002;
const SPEED: u32 = 20;

/// RMS limits of two speed classes, latching.
pub fn configuration() -> Configuration {
    let mut config = Configuration::default();
    config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE as f32);
    let band = |from: f32, to: f32, raise: f32| AlarmBand {
        watched: Watched::Rms,
        from: Hertz(from),
        to: Hertz(to),
        raise,
        clear: 0.8 * raise,
        persistence: 1,
    };
    config.alarms = [band(5.0, 25.0, 5.0), band(25.0, 60.0, 15.0)].into_iter().collect();
    config.holding = AlarmHolding { latching: true, persistence_s: 0.5, watch_signal: true };
    config
}

/// A node, its machine and what it said.
pub struct Watch {
    pub session: Box<Session>,
    first: u64,
    edge: u64,
    sequence: u32,
    pub tach: bool,
    events: Vec<(EventKind, u32)>,
    status: Option<Status>,
    pub indicators: Option<Indicators>,
}

impl Watch {
    pub fn new(config: Configuration) -> Self {
        let session = Session::new(config, TicksPerSecond(CLOCK), Identity::HOST).expect("a sound configuration");
        let session = Box::new(session);
        Self { session, first: 0, edge: 0, sequence: 0, tach: true, events: Vec::new(), status: None, indicators: None }
    }

    /// Runs on with a sine of this amplitude, m/s^2; beyond the rails it is clipped.
    pub fn run(&mut self, seconds: f64, amplitude: f64) -> &mut Self {
        let until = self.first + (seconds * f64::from(CLOCK)) as u64;
        while self.first < until {
            let period = self.session.node().requested_period_ticks();
            let code = |n: u64| {
                let t = (self.first + n * u64::from(period)) as f64 / f64::from(CLOCK);
                (amplitude * (TAU * (400.0 * t).fract()).sin() / M_S2_PER_CODE + 32_768.0).clamp(0.0, 65_535.0) as u16
            };
            let codes: Vec<u16> = (0..BLOCK as u64).map(code).collect();
            let end = self.first + BLOCK as u64 * u64::from(period);
            while self.edge < end {
                if self.tach {
                    self.session.on_edge(self.edge as u32);
                }
                self.edge += u64::from(CLOCK / SPEED);
            }
            let (first_tick, sequence) = (self.first as u32, self.sequence);
            let block =
                Block { codes: &codes, second: &[], first_tick, period_ticks: period, sequence, overrun: false };
            self.session.take_block(block, end as u32);
            (self.first, self.sequence) = (end, self.sequence + 1);
            while let Some(message) = self.session.node_mut().poll(end as u32) {
                match message {
                    Message::Event(event) => self.events.push((event.kind, event.detail)),
                    Message::Status(status) => self.status = Some(status),
                    Message::Indicators(indicators) => self.indicators = Some(indicators),
                    _ => {}
                }
            }
        }
        self
    }

    /// The next block is missing.
    pub fn lose_block(&mut self) -> &mut Self {
        self.first += BLOCK as u64 * u64::from(self.session.node().requested_period_ticks());
        self.sequence += 1;
        self
    }

    fn ask(&mut self, request: Request) {
        self.session.on_request(request, &mut |_| ());
    }

    pub fn stands(&self) -> bool {
        self.session.node().alarm_stands()
    }

    pub fn said(&self, kind: EventKind) -> Vec<u32> {
        self.events.iter().filter(|event| event.0 == kind).map(|event| event.1).collect()
    }

    fn status(&self) -> Status {
        self.status.expect("a status")
    }
}

#[test]
fn theory_an_alarm_of_the_speed_s_class_is_raised_latched_and_acknowledged() {
    let mut watch = Watch::new(configuration());
    watch.run(4.0, 3.0);
    assert!(!watch.stands());
    watch.run(4.0, 12.0);
    assert_eq!(watch.said(EventKind::AlarmRaised), [0], "8.5 m/s2 RMS is below the fast class's limit");
    let alarms = watch.status().alarms;
    assert_eq!((alarms.raised, alarms.standing, alarms.unseen, alarms.signal_bad), (1, 1, 1, false));
    watch.run(4.0, 3.0);
    assert!(watch.stands() && watch.status().alarms.raised == 0, "latched");
    watch.ask(Request::AcknowledgeAlarms);
    assert!(!watch.stands());
    watch.run(2.0, 3.0);
    assert_eq!((watch.said(EventKind::AlarmCleared), watch.said(EventKind::AlarmsAcknowledged)), (vec![0], vec![0]));
}

#[test]
fn fault_without_a_tach_the_least_strict_class_still_watches() {
    let mut watch = Watch::new(configuration());
    watch.tach = false;
    watch.run(4.0, 12.0);
    assert!(!watch.stands(), "8.5 m/s2 RMS is within the limit of some speed");
    watch.run(4.0, 30.0);
    assert_eq!(watch.said(EventKind::AlarmRaised), [1], "21 m/s2 RMS is beyond that of every speed");
}

#[test]
fn fault_an_alarm_that_loses_its_tach_stands() {
    let mut config = configuration();
    config.holding.latching = false;
    let mut watch = Watch::new(config);
    watch.run(6.0, 12.0);
    assert!(watch.stands());
    watch.tach = false;
    watch.run(5.0, 3.0);
    assert!(watch.stands(), "nobody knows the class in which it would be well again");
    watch.tach = true;
    watch.edge = watch.first;
    watch.run(6.0, 3.0);
    assert!(!watch.stands());
}

/// With one class only, its limit is that of all speeds, too.
#[test]
fn regress_an_alarm_of_the_only_class_stands_without_a_tach_unless_it_was_raised_without_one() {
    let mut config = configuration();
    config.holding.latching = false;
    config.alarms.truncate(1);
    let mut watch = Watch::new(config.clone());
    watch.run(6.0, 12.0);
    watch.tach = false;
    watch.run(5.0, 3.0);
    assert!(watch.stands(), "at which speed was it well?");
    let mut never_turned = Watch::new(config);
    never_turned.tach = false;
    never_turned.run(4.0, 12.0);
    assert!(never_turned.stands());
    never_turned.run(4.0, 3.0);
    assert!(!never_turned.stands());
}

#[test]
fn fault_a_clipped_signal_raises_its_own_alarm_beside_the_limit_it_exceeds() {
    let mut config = configuration();
    config.holding.latching = false;
    let mut watch = Watch::new(config);
    // The front end clips at 62 m/s2.
    watch.run(4.0, 3.0).run(6.0, 90.0);
    assert_eq!(watch.said(EventKind::AlarmRaised), [0]);
    assert_eq!(watch.said(EventKind::SignalBad), [1]);
    let status = watch.status();
    assert!(watch.stands() && status.alarms.signal_bad && status.alarms.standing == 1);
    assert!(status.sensor.standing && status.sensor.reasons == 1);
    watch.run(6.0, 3.0);
    assert!(!watch.stands() && !watch.status().sensor.standing);
    assert_eq!((watch.said(EventKind::SignalGood), watch.said(EventKind::AlarmCleared)), (vec![0], vec![0]));
}

#[test]
fn theory_an_alert_is_told_and_leaves_the_output_alone() {
    let mut config = configuration();
    config.holding.latching = false;
    config.alarms.truncate(1);
    config.modes.push(AlarmMode { severity: Severity::Alert, ..AlarmMode::default() }).expect("room");
    let mut watch = Watch::new(config);
    watch.run(6.0, 12.0);
    assert_eq!(watch.said(EventKind::AlarmRaised), [0]);
    let status = watch.status();
    assert_eq!((status.alarms.standing, status.alerts, watch.stands()), (1, 1, false));
}

#[test]
fn theory_a_sensor_with_an_output_of_its_own_does_not_move_the_alarm_output() {
    let mut config = configuration();
    config.alarms.clear();
    config.sensor_check.output = OkOutput::Own;
    let mut watch = Watch::new(config);
    watch.run(4.0, 3.0);
    assert!(watch.session.node().sensor_is_ok());
    watch.run(6.0, 90.0);
    assert!(!watch.session.node().sensor_is_ok() && !watch.stands());
}

#[test]
fn theory_the_bias_of_the_sensor_has_a_band() {
    let mut config = configuration();
    config.sensor_check.bias_v = [8.0, 14.0];
    config.sensor_check.bias_divider = 5.0;
    let mut watch = Watch::new(config);
    let bias = |volts: f32| BoardHealth { sensor_bias_v: Some(volts / 5.0), ..BoardHealth::default() };
    watch.session.node_mut().set_board_health(bias(11.0));
    watch.run(6.0, 3.0);
    assert!(!watch.stands());
    // A cut cable: the current source goes to its supply.
    watch.session.node_mut().set_board_health(bias(23.0));
    watch.run(6.0, 3.0);
    assert!(watch.stands());
    assert_eq!(watch.said(EventKind::SignalBad), [u32::from(meshband::watch::reason::BIAS)]);
    assert_eq!(watch.session.node().health().sensor_bias_v, Some(23.0));
}

#[test]
fn fault_a_stopped_node_does_not_pass_for_a_healthy_machine() {
    let mut watch = Watch::new(configuration());
    watch.run(4.0, 3.0);
    watch.ask(Request::Stop);
    watch.run(40.0, 3.0);
    assert!(watch.stands(), "its limits have had nothing to judge for half a minute");
    assert_eq!(watch.said(EventKind::SignalBad), [u32::from(meshband::watch::reason::BLINDNESS)]);
}

#[test]
fn fault_a_latched_sensor_survives_a_power_cut() {
    let mut watch = Watch::new(configuration());
    watch.run(4.0, 3.0).run(6.0, 90.0).run(6.0, 3.0);
    let kept = watch.session.node().configuration().clone();
    assert!(kept.sensor_latched && watch.session.take_commit());
    let mut again = Watch::new(kept);
    assert!(again.stands(), "from the first moment on");
    again.run(6.0, 3.0);
    again.ask(Request::AcknowledgeAlarms);
    assert!(!again.stands() && !again.session.node().configuration().sensor_latched);
}

#[test]
fn fault_a_latched_alarm_survives_a_power_cut() {
    let mut watch = Watch::new(configuration());
    watch.run(8.0, 12.0);
    assert!(watch.session.take_commit(), "the latch is to be stored");
    let mut buffer = [0; Configuration::MAX_SERIALISED];
    let kept = postcard::to_slice(watch.session.node().configuration(), &mut buffer).expect("fits");
    let kept = Configuration::from_stored(kept).expect("the present schema");
    let mut again = Watch::new(kept);
    assert!(again.stands(), "from the first moment on");
    again.run(5.0, 3.0);
    assert!(again.stands() && !again.session.take_commit());
    again.ask(Request::AcknowledgeAlarms);
    assert!(!again.stands() && again.session.take_commit(), "and so is its end");
    assert_eq!(again.session.node().configuration().latched, 0);
}

#[test]
fn theory_a_latch_does_not_store_a_configuration_that_nobody_stored() {
    let mut watch = Watch::new(configuration());
    watch.ask(Request::SetConfiguration(configuration()));
    watch.run(8.0, 12.0);
    assert!(watch.stands() && !watch.session.take_commit());
    watch.ask(Request::CommitConfiguration);
    assert!(watch.session.take_commit());
    watch.session.on_stored(true);
    watch.ask(Request::AcknowledgeAlarms);
    watch.run(3.0, 3.0);
    assert!(watch.session.take_commit(), "from then on it does");
}

#[test]
fn theory_rates_are_bounded_by_what_filter_and_sensor_pass() {
    let law_of = |status: &Status| status.bandwidth_hz;
    let mut open = Watch::new(configuration());
    let all = open.run(5.0, 3.0).status();
    let law = law_of(&all);
    assert!((all.available_hz - law).abs() < 1.0 && all.bound == Bound::Law, "{all:?}");
    let pass = PassBand { analogue: Hertz(0.5 * law), sensor: Hertz(0.0) };
    let mut bounded = Watch::new(Configuration { pass, ..configuration() });
    let half = bounded.run(5.0, 3.0).status();
    assert_eq!((half.bound, half.bandwidth_hz), (Bound::AnalogueFilter, law), "two figures");
    assert!((half.available_hz - 0.5 * law).abs() < 1.0);
    assert!((half.requested_hz / all.requested_hz - 0.5).abs() < 0.02, "no rate for what does not pass");
    let pass = PassBand { analogue: Hertz(0.5 * law), sensor: Hertz(0.25 * law) };
    let mut bounded = Watch::new(Configuration { pass, ..configuration() });
    assert_eq!(bounded.run(5.0, 3.0).status().bound, Bound::Sensor);
}
