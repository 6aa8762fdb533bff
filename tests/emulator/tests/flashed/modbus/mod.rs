//! The released image as a Modbus station: read by an independent master, against what the same node says over its own link.

mod master;

use super::image::image;
use super::outputs::watched;
use super::spoken::Node;
use master::Master;
use meshband::config::{Configuration, LinkConfig, Parity, Personality, SensorSupply};
use meshband::frame::Packet;
use meshband::message::{Indicators, Message, Reply, Request, Spectrum};
use meshband::modbus::map::{Kind, REGISTERS, Register};
use std::f64::consts::TAU;
use std::sync::Arc;

const ADDRESS: u8 = 17;
const RATE: f64 = 19_200.0;
/// Port A's pin of the line's driver.
const DRIVER: (usize, u32) = (0, 8);
/// When the listening is over for sure, s from power.
const LISTENED_S: f64 = 3.4;

fn configuration() -> Configuration {
    let link =
        LinkConfig { personality: Personality::Modbus, address: ADDRESS, bits_per_second: 0, parity: Parity::Even };
    Configuration { link, ..watched(SensorSupply::Off) }
}

/// A node with that stored, at the moment its power comes back: 25 Hz, mesh at 500 Hz, loud from the second second on.
fn stored(test: &str, configuration: &Configuration) -> Option<Node> {
    let image = image(test)?;
    let mut node = Node::new(&image);
    node.start();
    node.configure(configuration);
    node.commit();
    node.cycle_power();
    let begin = node.board.seconds();
    node.board.set_analogue(Arc::new(move |time_s| {
        let (angle, amplitude) = (TAU * 25.0 * time_s, if time_s > begin + 2.0 { 0.3 } else { 0.005 });
        0.5 + amplitude * ((20.0 * angle).sin() + 0.2 * (angle + 0.4).cos() + 0.1 * (21.0 * angle).cos())
    }));
    let edges: Vec<f64> = (1..1200).map(|n| begin + 0.04 * f64::from(n)).collect();
    node.board.add_tach_edges(&edges);
    Some(node)
}

fn register(group: &str, name: &str) -> &'static Register {
    REGISTERS.iter().find(|row| (row.group, row.name) == (group, name)).unwrap_or_else(|| panic!("{group}.{name}"))
}

/// A group as its words, with the address of the first.
fn group(master: &mut Master, node: &mut Node, name: &str) -> (u16, Vec<u32>) {
    let rows: Vec<_> = REGISTERS.iter().filter(|row| row.group == name).collect();
    let first = rows[0].address;
    let last = rows[rows.len() - 1];
    let count = last.address + last.kind.registers() - first;
    (first, master.numbers(&mut node.board, &format!("read 4 {first} {count}")))
}

/// A value of a group that was read.
fn value((first, words): &(u16, Vec<u32>), group: &str, name: &str) -> u32 {
    let row = register(group, name);
    let at = usize::from(row.address - first);
    if row.kind == Kind::Word { words[at] } else { words[at] << 16 | words[at + 1] }
}

#[test]
fn claim_an_independent_modbus_master_reads_what_the_link_reports() {
    const TEST: &str = "Modbus by an independent master";
    let Some(mut node) = stored(TEST, &configuration()) else { return };
    let Some(mut master) = Master::start(TEST, ADDRESS) else { return };
    let power = node.snapshot();
    node.board.set_line(RATE, 11);
    node.run(9.0);
    let values = group(&mut master, &mut node, "values");
    println!("{values:?}");
    let number = value(&values, "values", "number");
    assert!(number >= 6, "{number}");
}
