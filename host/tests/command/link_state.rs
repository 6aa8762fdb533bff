//! One state of a link: live, in chunks and over reconnects, and replayed from the capture, everything that is said of
//! it agrees, and the alarms are those of the node.

use meshband::alarm::{AlarmBand, AlarmMode, Severity, Side, Watched};
use meshband::config::{Configuration, TrainGear};
use meshband::events::{Event, EventKind};
use meshband::frame::{MAX_FRAME, PacketRef, encode};
use meshband::message::{
    AlarmState, GearCondition, GearIndicators, GearSpectrum, Indicators, MeshBand, Message, Reply, SpectralLine,
    Spectrum, Status,
};
use meshband::units::Hertz;
use meshband_host::link::alarms::{Alarms, numbers};
use meshband_host::link::limit::Limit;
use meshband_host::link::stream::REOPEN_MARK;
use meshband_host::link::transport::{self, Transport};
use meshband_host::link::view::View;
use meshband_host::link::{Client, report};
use meshband_host::monitor::capture::{Capture, Kept};
use meshband_host::monitor::link::Standing;
use meshband_host::monitor::panel::Panel;
use meshband_host::output::Outputs;
use proptest::prelude::*;
use std::collections::VecDeque;
use std::path::Path;
use std::time::Duration;

/// What happens next on the line.
#[derive(Debug, Clone)]
enum Step {
    Status,
    Values(f32),
    /// An alarm rises or falls and the node says so.
    Alarm(u8),
    SignalBad(bool),
    Configured,
    /// The next frames are lost.
    Lose(u16),
    Garbage(Vec<u8>),
    Restart(u16),
    Reopen,
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        6 => Just(Step::Status),
        4 => (0.1f32..50.0).prop_map(Step::Values),
        4 => (0u8..8).prop_map(Step::Alarm),
        1 => any::<bool>().prop_map(Step::SignalBad),
        1 => Just(Step::Configured),
        2 => (1u16..4).prop_map(Step::Lose),
        1 => prop::collection::vec(any::<u8>(), 1..40).prop_map(Step::Garbage),
        1 => (0u16..5).prop_map(Step::Restart),
        1 => Just(Step::Reopen),
    ]
}

/// A node at the far end: what it would say, and the truth.
struct Far {
    sequence: u16,
    tick: u64,
    alarms: AlarmState,
    /// Frames still to be lost.
    losing: u16,
    /// Pieces of the line, one list per connection.
    connections: Vec<Vec<u8>>,
    /// Frames lost between two that arrived, as the receiver can know.
    gap: u32,
    lost: u32,
    restarts: u32,
    dropped_any: bool,
    /// A frame has arrived over this connection.
    heard_any: bool,
}

impl Far {
    fn new() -> Self {
        let alarms = AlarmState::default();
        Self {
            sequence: 40_000,
            tick: 1 << 32,
            alarms,
            losing: 0,
            connections: vec![Vec::new()],
            gap: 0,
            lost: 0,
            restarts: 0,
            dropped_any: false,
            heard_any: false,
        }
    }

    fn send<'a>(&mut self, packet: impl Into<PacketRef<'a>>) {
        let mut buffer = [0; MAX_FRAME];
        let frame = encode(packet, self.sequence, &mut buffer).expect("fits").to_vec();
        self.sequence = self.sequence.wrapping_add(1);
        self.tick += 1000;
        if self.losing > 0 {
            (self.losing, self.dropped_any, self.gap) = (self.losing - 1, true, self.gap + 1);
            return;
        }
        // What was lost before the first frame of a connection nobody can know of.
        let gap = std::mem::take(&mut self.gap);
        self.lost += if self.heard_any { gap } else { 0 };
        self.heard_any = true;
        self.connections.last_mut().expect("one").extend(frame);
    }

    fn take(&mut self, step: &Step) {
        match step {
            Step::Status => {
                let status = Status { tick: self.tick, alarms: self.alarms, ..super::monitor::status() };
                self.send(&Message::Status(status));
            }
            Step::Values(rms) => self.send(&Message::Indicators(Indicators { rms: *rms, ..Indicators::default() })),
            Step::Alarm(index) => {
                let bit = 1 << index;
                let rises = self.alarms.standing & bit == 0;
                for bits in [&mut self.alarms.raised, &mut self.alarms.standing, &mut self.alarms.unseen] {
                    *bits = if rises { *bits | bit } else { *bits & !bit };
                }
                let kind = if rises { EventKind::AlarmRaised } else { EventKind::AlarmCleared };
                self.event(kind, u32::from(*index));
            }
            Step::SignalBad(is) => {
                self.alarms.signal_bad = *is;
                self.event(if *is { EventKind::SignalBad } else { EventKind::SignalGood }, 1);
            }
            Step::Configured => {
                let mut config = Configuration::default();
                let (from, to) = (Hertz(1.0), Hertz(60.0));
                let band = AlarmBand { watched: Watched::Rms, from, to, raise: 2.0, clear: 1.0, persistence: 3 };
                config.alarms = [band].into_iter().collect();
                self.send(&Reply::Configuration(config));
            }
            Step::Lose(count) => self.losing = *count,
            Step::Garbage(bytes) => {
                let line = self.connections.last_mut().expect("one");
                line.push(0);
                line.extend(bytes.iter().filter(|&&byte| byte != 0));
                line.push(0);
            }
            Step::Restart(unheard) => {
                *self = Self {
                    sequence: *unheard,
                    tick: 1 << 32,
                    alarms: AlarmState::default(),
                    gap: u32::from(*unheard),
                    connections: std::mem::take(&mut self.connections),
                    restarts: self.restarts + 1,
                    ..*self
                };
            }
            Step::Reopen => {
                self.connections.push(Vec::new());
                (self.gap, self.heard_any) = (0, false);
            }
        }
    }

    fn event(&mut self, kind: EventKind, detail: u32) {
        let (first_tick, last_tick, count) = (self.tick, self.tick, 1);
        self.send(&Message::Event(Event { kind, detail, first_tick, last_tick, count }));
    }
}

/// Bytes in pieces, as a line gives them.
struct Pieces(VecDeque<Vec<u8>>);

impl Transport for Pieces {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        let Some(piece) = self.0.pop_front() else { return Ok(None) };
        buffer[..piece.len()].copy_from_slice(&piece);
        Ok(Some(piece.len()))
    }

    fn write(&mut self, _: &[u8]) -> std::io::Result<()> {
        Ok(())
    }
}

fn hear(client: &mut Client, panel: &mut Panel) {
    while !client.has_ended() {
        if let Some(message) = client.next_message(Duration::from_millis(1)).expect("no fault of the transport") {
            panel.take(message, 1.0);
        }
        client.take_replies().into_iter().for_each(|reply| panel.view.take_reply(reply));
    }
}

fn said(view: &View, client: &Client) -> [String; 3] {
    let losses = client.losses();
    let page = report::of_view(view, losses, "somewhere").expect("a page").html();
    [view.json(losses).to_string(), view.text(losses), page]
}

fn check(steps: &[Step], piece: usize, folder: &Path) -> Result<(), TestCaseError> {
    let mut far = Far::new();
    let mut truths = Vec::new();
    for step in steps {
        far.take(step);
        truths.push(far.alarms);
    }
    let path = folder.join("line.link");
    let _ = std::fs::remove_file(&path);
    let lock = Outputs::new(true).appended(&path).expect("a capture");
    let capture = Capture::append(&path, lock).expect("opens");
    let pieces = |bytes: &[u8]| -> Box<dyn Transport> {
        let line = Pieces(bytes.chunks(piece).map(<[u8]>::to_vec).collect());
        Box::new(Kept::new(Box::new(line), capture.clone()))
    };
    let mut live = Client::new(pieces(&far.connections[0]));
    let mut panel = Panel::default();
    hear(&mut live, &mut panel);
    for connection in &far.connections[1..] {
        capture.keep(REOPEN_MARK);
        live.reopen(pieces(connection));
        hear(&mut live, &mut panel);
    }
    let mut replay = Client::new(transport::replay(&path).expect("opens"));
    let mut replayed = Panel::default();
    hear(&mut replay, &mut replayed);
    prop_assert_eq!(live.losses(), replay.losses());
    prop_assert_eq!(said(&panel.view, &live), said(&replayed.view, &replay));

    let losses = live.losses();
    prop_assert_eq!(losses.reopened as usize, far.connections.len() - 1);
    prop_assert!(losses.restarts <= far.restarts, "{losses:?}, truly {}", far.restarts);
    if far.restarts == 0 {
        prop_assert_eq!(losses.lost, far.lost);
    }
    // Every text says of each alarm what the model says.
    let alarms = Alarms::of(&panel.view);
    let [json, text, page] = said(&panel.view, &live);
    for line in alarms.lines() {
        prop_assert!(text.contains(&line), "{line} in {text}");
        let escaped = meshband_host::report::escape(&line);
        prop_assert!(page.contains(&escaped), "{line} in the report");
    }
    let known = format!("\"known\":{}", alarms.known);
    prop_assert!(json.contains(&known), "{}", json);
    prop_assert_eq!(alarms.known, panel.view.status.is_some());
    let shown = super::monitor::picture(&panel, &Standing::Open, 1.0, (200, 60)).join("\n");
    prop_assert_eq!(alarms.any(), shown.contains("ALARM"), "{}", shown);
    // Nothing was lost: what is said is the node's own state at the end.
    if !far.dropped_any && alarms.known && far.restarts == 0 {
        let truth: Vec<u8> = numbers(&far.alarms).map(|index| index + 1).collect();
        let told: Vec<u8> = alarms.standing.iter().map(|alarm| alarm.number).collect();
        prop_assert_eq!((told, alarms.signal_bad), (truth, far.alarms.signal_bad));
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]
    #[test]
    fn claim_a_link_says_the_same_live_replayed_and_in_every_text(
        steps in prop::collection::vec(step(), 1..120),
        piece in 1usize..200,
    ) {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("link-state");
        std::fs::create_dir_all(&folder).expect("a folder");
        check(&steps, piece, &folder)?;
    }
}

#[test]
fn regress_an_alarm_that_stood_before_the_view_is_shown_from_the_first_status_on() {
    let mut panel = Panel::default();
    let first = |panel: &Panel| super::monitor::picture(panel, &Standing::Open, 0.5, (80, 24)).join("\n");
    assert!(first(&panel).contains("alarms not known yet"), "{}", first(&panel));
    let alarms = AlarmState { raised: 1, standing: 1, unseen: 1, signal_bad: false };
    panel.take(Message::Status(Status { alarms, ..super::monitor::status() }), 0.4);
    let band =
        AlarmBand { watched: Watched::Rms, from: Hertz(5.0), to: Hertz(60.0), raise: 2.0, clear: 1.0, persistence: 3 };
    let mode = AlarmMode::default();
    panel.view.limits = Some(vec![Limit { band, mode, gear: 0 }]);
    panel.take(Message::Indicators(Indicators { rms: 32.157, ..Indicators::default() }), 0.45);
    let shown = first(&panel);
    assert!(shown.contains("ALARM 1: RMS 32.2 m/s2 above 2 m/s2") && !shown.contains("no alarm"), "{shown}");
    let losses = meshband_host::link::Losses::default();
    assert!(panel.view.text(losses).contains("ALARM 1: RMS 32.2 m/s2 above 2 m/s2"));
    let page = report::of_view(&panel.view, losses, "x").expect("a page").html();
    let (alarm, first_section) = (page.find("ALARM 1: RMS").expect("in the report"), page.find("<h2>").expect("one"));
    assert!(alarm < first_section, "an alarm is the report's first line");
}

/// A limit at the low side, one on a rise, an alert: none of them is an alarm "above".
#[test]
fn regress_side_and_severity_of_an_alarm_are_said() {
    let mut view = View::default();
    let alarms = AlarmState { raised: 3, standing: 7, unseen: 7, signal_bad: false };
    view.take(Message::Status(Status { alarms, ..super::monitor::status() }));
    let (from, to) = (Hertz(5.0), Hertz(60.0));
    let band = |raise: f32| AlarmBand { watched: Watched::Rms, from, to, raise, clear: raise, persistence: 3 };
    let limit = |raise, side, severity| Limit { band: band(raise), mode: AlarmMode { side, severity }, gear: 0 };
    view.limits = Some(vec![
        limit(0.5, Side::Below, Severity::Danger),
        limit(3.0, Side::Rise, Severity::Alert),
        limit(9.0, Side::Above, Severity::Alert),
    ]);
    view.take(Message::Indicators(Indicators { rms: 0.25, ..Indicators::default() }));
    let lines = Alarms::of(&view).lines();
    assert!(lines[0].starts_with("ALARM 1: RMS 0.250 m/s2 below 0.5 m/s2"), "{}", lines[0]);
    assert!(lines[1].starts_with("ALERT 2: RMS 0.250 m/s2 more than 3 m/s2 over its mean of 10 min"), "{}", lines[1]);
    assert!(lines[2].starts_with("ALERT 3: RMS was above 9 m/s2"), "{}", lines[2]);
}

/// A gear of a train has its own values and its own alarm; the pinion's stay the pinion's.
#[test]
fn theory_further_gears_of_a_train_are_told_apart_in_text_alarms_and_picture() {
    let mut panel = Panel::default();
    let alarms = AlarmState { raised: 1, standing: 1, unseen: 1, signal_bad: false };
    panel.take(Message::Status(Status { alarms, ..super::monitor::status() }), 0.4);
    let gear = TrainGear { stage: 2, teeth: 77, mate_teeth: 19, turns: 21, pinion_turns: 83 };
    let band =
        AlarmBand { watched: Watched::Fm4, from: Hertz(5.0), to: Hertz(60.0), raise: 6.0, clear: 5.0, persistence: 3 };
    let mut config = Configuration { alarms: [band].into_iter().collect(), ..Configuration::default() };
    config.train.extend([gear; 2]);
    config.alarm_gears.push(2).expect("room");
    panel.view.take_reply(Reply::Configuration(config));
    let of = |fm4: f32| GearIndicators { fm4, ..GearIndicators::default() };
    let pinion = Indicators { gear: Some(of(3.0)), ..Indicators::default() };
    panel.take(Message::Indicators(pinion), 0.45);
    panel.take(Message::GearCondition(GearCondition { gear: 2, indicators: of(9.5) }), 0.5);
    let line = SpectralLine { frequency_hz: 120.0, amplitude: 5.0 };
    let bands = [MeshBand { harmonic: 1, line, ..MeshBand::default() }].into_iter().collect();
    let spectrum = Spectrum { bands, ..Spectrum::default() };
    panel.take(Message::GearSpectrum(GearSpectrum { gear: 2, spectrum }), 0.5);
    assert!(panel.view.spectrum.is_none(), "no spectrum of the pinion");
    let losses = meshband_host::link::Losses::default();
    let text = panel.view.text(losses);
    assert!(text.contains("ALARM 1: FM4 of gear 2 9.50 above 6"), "{text}");
    assert!(text.contains("gear 2 of the train (stage 2, 77 teeth)") && text.contains("mesh 1 5.0000 m/s2"), "{text}");
    assert!(text.contains("FM4 3.000") && text.contains("FM4 9.500"), "{text}");
    let shown = super::monitor::picture(&panel, &Standing::Open, 0.5, (80, 24)).join("\n");
    assert!(shown.contains("gear 2 of the train (stage 2, 77 teeth)"), "{shown}");
    let json = panel.view.json(losses);
    assert_eq!(
        (&json["view"]["gears"]["2"]["indicators"]["fm4"], &json["alarms"]["standing"][0]["gear"]),
        (&9.5.into(), &2.into())
    );
}

#[test]
fn fault_a_lost_link_does_not_say_that_there_is_no_alarm_now() {
    let mut panel = Panel::default();
    panel.take(Message::Status(super::monitor::status()), 0.4);
    let lost = Standing::Lost { reason: "gone".into(), attempts: 1, next_s: 1.0 };
    let shown = super::monitor::picture(&panel, &lost, 12.4, (80, 24)).join("\n");
    assert!(shown.contains("12 s ago, not known now: no alarm"), "{shown}");
}

#[test]
fn regress_a_node_that_was_killed_and_restarted_is_one_restart_and_no_lost_frames() {
    // The first run ends at a frame number; the second is heard from its number 40 on, over another connection.
    let mut far = Far::new();
    (0..5).for_each(|_| far.take(&Step::Status));
    far.take(&Step::Reopen);
    far.take(&Step::Restart(40));
    far.gap = 0;
    (0..3).for_each(|_| far.take(&Step::Status));
    let line = [&far.connections[0][..], REOPEN_MARK, &far.connections[1]].concat();
    let mut client = Client::new(Box::new(Pieces(line.chunks(100).map(<[u8]>::to_vec).collect())));
    let mut panel = Panel::default();
    hear(&mut client, &mut panel);
    let losses = client.losses();
    assert_eq!((losses.lost, losses.restarts, losses.reopened), (0, 1, 1), "{losses:?}");
}
