//! An alarm of the released image leaves its waveform: read over the line byte for byte as the host's node holds it.

use super::compared::{Node, STARTED_S, configuration, machine, turns};
use super::image::image;
use meshband::alarm::{AlarmBand, Watched};
use meshband::config::{CaptureConfig, CaptureRate, Configuration};
use meshband::events::EventKind;
use meshband::frame::Packet;
use meshband::message::{Reply, Request};
use meshband::units::Hertz;
use meshband::waveform::{CaptureHead, CapturePart, PART_BYTES, Trigger};

const SPEED_HZ: f64 = 25.0;

/// Waveforms at 10 kHz and a limit that every signal is beyond.
fn alarmed() -> Configuration {
    let (from, to) = (Hertz(5.0), Hertz(60.0));
    let alarm = AlarmBand { watched: Watched::Rms, from, to, raise: 0.01, clear: 0.005, persistence: 1 };
    let capture = CaptureConfig { keep: CaptureRate::Fixed, rate: Hertz(0.0) };
    Configuration { alarms: [alarm].into_iter().collect(), capture, ..configuration() }
}

fn last_reply(node: &Node) -> Reply {
    let reply = |packet| if let Packet::Reply(reply) = packet { Some(reply) } else { None };
    node.packets().into_iter().filter_map(reply).next_back().expect("a reply")
}

fn ask(node: &mut Node, request: Request) -> Reply {
    node.link.clear();
    node.ask(request);
    // A long step of the analysis may lie in between.
    for _ in 0..10 {
        node.run_for(0.02);
        if node.packets().iter().any(|packet| matches!(packet, Packet::Reply(_))) {
            break;
        }
    }
    last_reply(node)
}

fn read(head: &CaptureHead, mut ask: impl FnMut(Request) -> Reply) -> Vec<u8> {
    let mut bytes = Vec::new();
    for offset in (0..head.bytes).step_by(PART_BYTES) {
        match ask(Request::ReadCapture { number: head.facts.number, offset }) {
            Reply::CapturePart(CapturePart { bytes: part, .. }) => bytes.extend_from_slice(&part),
            other => panic!("{other:?}"),
        }
    }
    bytes
}

#[test]
fn claim_an_alarm_s_waveform_is_read_from_the_released_image_byte_for_byte_as_the_host_s_node_holds_it() {
    let Some(image) = image("waveform of an alarm") else { return };
    let mut node = Node::new(&image, &alarmed());
    node.board.set_analogue(machine(SPEED_HZ));
    node.board.add_tach_edges(&turns(SPEED_HZ, STARTED_S, 9.0));
    node.run_until(6.0);
    assert_eq!(node.details(EventKind::CaptureHeld), [1], "{:?}", node.events());
    assert!(node.details(EventKind::BlocksLost).is_empty());
    assert!(node.compare().is_equal(), "frames with capture on");
    let mut host = node.host_node();
    let report = host.node_mut().on_request(Request::GetCapture);
    assert_eq!(ask(&mut node, Request::GetCapture), report);
    let Reply::Capture(report) = report else { panic!("{report:?}") };
    let head = report.head.expect("held");
    assert_eq!(head.facts.trigger, Trigger::Alarm { index: 0 });
    let seconds = f64::from(head.facts.samples) * f64::from(head.facts.period_ticks) / 84.0e6;
    let rate_hz = 84.0e6 / f64::from(head.facts.period_ticks);
    println!("{} samples at {rate_hz:.1} Hz: {seconds:.3} s, {} turns", head.facts.samples, head.facts.marks);
    assert!(seconds >= 1.92 && rate_hz >= 10_000.0);
    assert!(head.facts.marks_whole && (48..=52).contains(&head.facts.marks), "{:?}", head.facts);
    let expected = read(&head, |request| host.node_mut().on_request(request));
    let bytes = read(&head, |request| ask(&mut node, request));
    assert_eq!(bytes.len(), head.bytes as usize);
    assert!(bytes == expected, "sample for sample");
    let released = ask(&mut node, Request::ReleaseCapture { number: 1 });
    assert!(matches!(released, Reply::Capture(report) if report.head.is_none()), "{released:?}");
}
