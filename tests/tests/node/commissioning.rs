//! Commissioning of the node's own code on an imitated machine: a healthy one is learned and then watched, and what
//! is wired or declared wrongly is refused with the sentence that says what to do. The node's time is as fast as the
//! host asks for it.

use meshband::config::Configuration;
use meshband::events::EventKind;
use meshband::law::LawForm;
use meshband::message::{Message, Status};
use meshband_host::commissioning::ear::Operator;
use meshband_host::commissioning::outcome::Commissioning;
use meshband_host::commissioning::step::{Outcome, Step};
use meshband_host::commissioning::{Plan, commission, run_up};
use meshband_host::law::domain::Domain;
use meshband_host::link::Client;
use meshband_host::link::setup::{Installation, Sources};
use meshband_host::link::transport::Transport;
use meshband_host::machine::Machine;
use meshband_tests::plant::{Fault, Plant, configuration};
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Time of the plant per reading, s.
const STEP_S: f64 = 0.02;

/// What the machine does now; tests change it while the node runs.
#[derive(Clone)]
struct Machinery {
    speed_hz: fn(f64) -> f64,
    fault: Fault,
}

/// A plant as a port.
struct Wire {
    plant: Plant,
    machinery: Arc<Mutex<Machinery>>,
}

impl Transport for Wire {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        if self.plant.ring.is_empty() {
            let now = self.plant.seconds();
            let Machinery { speed_hz, fault } = self.machinery.lock().expect("not poisoned").clone();
            self.plant.run(STEP_S, |t| speed_hz(now + t), fault);
            if self.plant.session.take_commit() {
                self.plant.session.on_stored(true);
            }
        }
        let mut count = 0;
        self.plant.ring.drain(|byte| {
            let fits = count < buffer.len();
            if fits {
                buffer[count] = byte;
                count += 1;
            }
            fits
        });
        Ok(Some(count))
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        bytes.iter().for_each(|&byte| self.plant.receive(byte));
        Ok(())
    }
}

/// Nobody to ask; everything that was told.
#[derive(Default)]
struct Silent {
    told: Vec<String>,
    /// Ends when so many lines were told.
    ends_after: Option<usize>,
    /// Ends when a line began like this.
    ends_at: Option<&'static str>,
}

impl Operator for Silent {
    fn tell(&mut self, line: &str) -> meshband_host::Result<()> {
        self.told.push(line.to_owned());
        Ok(())
    }

    fn ask(&mut self, _: &str) -> meshband_host::Result<bool> {
        Ok(false)
    }

    fn wants_to_end(&self) -> bool {
        let told = |beginning: &str| self.told.iter().any(|line| line.starts_with(beginning));
        self.ends_after.is_some_and(|lines| self.told.len() >= lines) || self.ends_at.is_some_and(told)
    }
}

/// From 10 to 25 Hz and back, by 3 % per second at most.
fn sweeping(time_s: f64) -> f64 {
    250.0f64.sqrt() * 2.5f64.powf(0.52 * (TAU * time_s / 100.0).sin())
}

/// Other speeds than the sweep's at every time, within the same range.
fn wandering(time_s: f64) -> f64 {
    250.0f64.sqrt() * 2.5f64.powf(0.3 * (TAU * time_s / 93.0).sin() + 0.17 * (TAU * time_s / 41.0 + 1.0).sin())
}

fn steady(_: f64) -> f64 {
    15.0
}

/// Grows by 18 dB from 10 to 25 Hz, with a resonance in between.
fn strength(speed_hz: f64) -> f64 {
    let bump = 1.0 + 2.0 * (-((speed_hz - 17.0) / 2.0).powi(2)).exp();
    0.1 * (speed_hz / 15.0).powf(2.3) * bump
}

fn machine() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../machines/19-48.toml"))
}

struct Bench {
    client: Client,
    machinery: Arc<Mutex<Machinery>>,
    plan: Plan,
}

fn bench(speed_hz: fn(f64) -> f64, fault: Fault) -> Bench {
    bench_of(configuration(), speed_hz, fault)
}

fn bench_of(former: Configuration, speed_hz: fn(f64) -> f64, fault: Fault) -> Bench {
    let mut plant = Plant::new(former, 11);
    // What the host does not take stays in the ring, as on the board.
    plant.line = 0.0;
    plant.strength = strength;
    let machinery = Arc::new(Mutex::new(Machinery { speed_hz, fault }));
    let client = Client::new(Box::new(Wire { plant, machinery: machinery.clone() }));
    let path = machine();
    let plan = Plan {
        port: "plant".into(),
        machine: Machine::read(&path).expect("a machine"),
        sources: Sources::read(Some(&path), None, None).expect("reads"),
        installation: Installation::default(),
        law_given: true,
        range: Domain { lowest_hz: 10.5, highest_hz: 24.0 },
        values: 12,
        seconds: 600.0,
        allowance_db: 1.0,
        false_alarms_per_year: 1.0,
        yes: true,
    };
    Bench { client, machinery, plan }
}

impl Bench {
    fn commission(&mut self) -> (Commissioning, Vec<String>) {
        let mut operator = Silent::default();
        let done = commission(&mut self.client, &self.plan, &mut operator);
        (done.unwrap_or_else(|error| panic!("{error}\n{}", operator.told.join("\n"))), operator.told)
    }

    /// Refused at a step, with these words; the node's former configuration is in force.
    fn refused(&mut self, step: Step, words: &[&str]) {
        let (done, told) = self.commission();
        let Some((record, finding)) = done.refusal() else { panic!("not refused:\n{}", told.join("\n")) };
        assert_eq!(record.step, step, "{}", told.join("\n"));
        let sentence = format!("{}: {}: {}", finding.what, finding.seen, finding.advice);
        for word in words {
            assert!(sentence.contains(word), "`{word}` in `{sentence}`");
        }
        assert!(!done.stored && done.configuration.is_none());
        assert_eq!(self.client.configuration().expect("answers"), configuration(), "the former one stays");
    }

    /// Alarms raised within so many seconds of the node.
    fn raised(&mut self, seconds: f64) -> usize {
        let (mut raised, mut first) = (0, None);
        loop {
            match self.client.next_message(Duration::from_secs(5)).expect("speaks") {
                Some(Message::Event(event)) if event.kind == EventKind::AlarmRaised => raised += 1,
                Some(Message::Status(Status { tick, .. })) => {
                    let now_s = tick as f64 / f64::from(meshband_tests::plant::CLOCK_HZ);
                    if now_s - *first.get_or_insert(now_s) > seconds {
                        return raised;
                    }
                }
                Some(_) => {}
                None => panic!("silent"),
            }
        }
    }
}

#[test]
fn loop_a_healthy_machine_is_commissioned_and_then_only_its_fault_raises_an_alarm() {
    let mut bench = bench(sweeping, Fault::None);
    let (done, told) = bench.commission();
    let told = told.join("\n");
    assert!(done.stored && done.refusal().is_none(), "{told}");
    let steps: Vec<Step> = done.steps.iter().map(|record| record.step).collect();
    let all = [Step::Identify, Step::Wiring, Step::RunUp, Step::Law, Step::Baseline, Step::Alarms, Step::Store];
    assert_eq!(steps, all, "{told}");
    let warned: Vec<&str> =
        done.steps[1].findings.iter().filter(|f| f.outcome > Outcome::Passed).map(|f| f.what.as_str()).collect();
    assert_eq!(warned, ["once per turn"], "the signal has no line there: {told}");
    let held = bench.client.configuration().expect("answers");
    assert_eq!(Some(&held), done.configuration.as_ref());
    assert!(held.levels.len() > 4 && held.alarms.len() > 1 && held.holding.watch_signal, "{told}");
    println!("{told}");
    // A quarter of an hour of other speeds.
    bench.machinery.lock().expect("not poisoned").speed_hz = wandering;
    assert_eq!(bench.raised(900.0), 0, "false alarms");
    // Everything four times as strong: 12 dB.
    bench.machinery.lock().expect("not poisoned").fault = Fault::Codes(|code, _| {
        let value = 4 * (i32::from(code) - 32_768) + 32_768;
        value.clamp(0, 65_535) as u16
    });
    assert!(bench.raised(60.0) > 0, "12 dB more are seen within a minute");
}

#[test]
fn loop_what_is_not_wanted_is_not_stored_and_the_former_configuration_stays() {
    let mut bench = bench(sweeping, Fault::None);
    bench.plan.yes = false;
    let (done, _) = bench.commission();
    assert!(!done.stored && done.configuration.is_some() && !done.changes.is_empty());
    assert_eq!(bench.client.configuration().expect("answers"), configuration());
}

#[test]
fn loop_a_law_is_learned_where_the_node_times_edges_and_has_none_of_this_machine() {
    // Another machine's law, low enough for the converter to time edges.
    let mut former = configuration();
    former.law.form = LawForm::Quadratic { a_per_hz: 0.0, b: 100.0, c_hz: 0.0 };
    let mut bench = bench_of(former, sweeping, Fault::None);
    bench.plan.law_given = false;
    let (done, told) = bench.commission();
    let told = told.join("\n");
    assert!(done.stored, "{told}");
    let held = bench.client.configuration().expect("answers");
    match &done.law {
        Some(file) => {
            assert_eq!(held.law, file.for_node().expect("for a node"), "{told}");
            assert_eq!(held.law.machine_hash, bench.plan.machine.hash());
        }
        None => panic!("{told}"),
    }
}

#[test]
fn fault_a_dead_sensor_is_refused() {
    bench(steady, Fault::Codes(|_, _| 32_768)).refused(Step::Wiring, &["sensor", "never move", "its supply, its wire"]);
}

#[test]
fn fault_a_signal_at_the_rails_is_refused() {
    let railed = Fault::Codes(|code, _| if code > 32_768 { 65_535 } else { 0 });
    bench(steady, railed).refused(Step::Wiring, &["rails", "less gain"]);
}

#[test]
fn fault_a_bias_far_from_zero_is_refused_with_its_voltage() {
    let shifted = Fault::Codes(|code, _| (i32::from(code) / 4 + 49_152 + 4_000) as u16);
    bench(steady, shifted).refused(Step::Wiring, &["bias", "V of 3.3 V", "sensor supply"]);
}

#[test]
fn fault_a_missing_tach_is_refused() {
    bench(steady, Fault::NoPulses).refused(Step::Wiring, &["no tach pulse came", "tach_edge"]);
}

#[test]
fn fault_wrong_pulses_per_turn_are_refused_with_the_number_that_fits() {
    let mut bench = bench(steady, Fault::None);
    bench.plan.installation.pulses_per_turn = Some(2);
    bench.refused(Step::Wiring, &["2 declared, 1 fit", "--pulses 1"]);
}

#[test]
fn fault_interchanged_teeth_are_refused() {
    let mut bench = bench(steady, Fault::None);
    bench.plan.installation.teeth = Some([48, 19]);
    bench.refused(Step::Wiring, &["interchanged", "48 declared on the pinion, 19 fit"]);
}

#[test]
fn fault_double_edges_of_the_tach_are_refused_or_warned_of_by_their_share() {
    let mut bench = bench(steady, Fault::Pulses(3.0));
    let (done, told) = bench.commission();
    let wiring = done.steps.iter().find(|record| record.step == Step::Wiring).expect("was taken");
    let pulses = wiring.findings.iter().find(|finding| finding.what.starts_with("tach")).expect("was looked at");
    assert!(pulses.outcome != Outcome::Passed && !pulses.advice.is_empty(), "{}", told.join("\n"));
}

#[test]
fn fault_speeds_that_never_come_are_named() {
    let mut bench = bench(steady, Fault::None);
    bench.plan.seconds = 30.0;
    // Not even the class of its one speed fills in that time.
    bench.plan.values = 200;
    bench.refused(Step::RunUp, &["classes filled", "missing: 10.50 to", "--speeds"]);
}

#[test]
fn fault_an_interrupt_at_any_line_leaves_the_former_configuration() {
    let mut seen = 0;
    for lines in [1, 5, 12, 16, 24, 32] {
        let mut bench = bench(sweeping, Fault::None);
        let mut operator = Silent { ends_after: Some(lines), ..Silent::default() };
        if commission(&mut bench.client, &bench.plan, &mut operator).is_err() {
            seen += 1;
            assert_eq!(bench.client.configuration().expect("answers"), configuration(), "after {lines} lines");
        }
    }
    assert!(seen >= 4, "{seen} interrupts before the end");
}

#[test]
fn fault_an_interrupt_behind_the_store_leaves_what_is_stored_and_says_so() {
    let mut bench = bench(sweeping, Fault::None);
    let mut operator = Silent { ends_at: Some("store: levels"), ..Silent::default() };
    let done = commission(&mut bench.client, &bench.plan, &mut operator).expect("what is stored is no error");
    assert!(done.stored && done.refusal().is_none());
    let finding = done.steps.last().and_then(|step| step.findings.last()).expect("the last step");
    assert!(finding.seen.contains("interrupted"), "{finding:?}");
    assert_eq!(bench.client.configuration().expect("answers").levels.len(), done.levels.expect("learned").points.len());
}

#[test]
fn theory_the_range_is_round_the_nominal_speed_where_none_is_asked_for() {
    let machine = Machine::read(&machine()).expect("a machine");
    let range = run_up::range(None, &machine).expect("declares a nominal speed");
    let nominal = machine.nominal.expect("declared").speed_hz;
    assert!(range.lowest_hz < nominal && range.highest_hz > nominal);
    let without = Machine { nominal: None, ..machine };
    assert!(run_up::range(None, &without).is_err_and(|error| error.to_string().contains("--speeds")));
}
