//! The register map for whoever programs a PLC: one row per value, one request per group, bytes of an example.
//!
//! Made from [`meshband::modbus::map`], the table that a node answers from, so it cannot differ from it. Addresses
//! count from 0, as they are on the line.

use super::limit::Limit;
use super::words::name_and_unit;
use meshband::modbus::CRC16;
use meshband::modbus::map::{INPUTS, Kind, REGISTERS, SAMPLE_REGISTERS, SAMPLES};

/// Function that reads input registers.
const READ_REGISTERS: u8 = 4;
/// Function that reads discrete inputs.
const READ_INPUTS: u8 = 2;
/// Bits of each kind of alarm bit.
const ALARM_BITS: u16 = 8;

/// A value of the map.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Function that reads it.
    pub function: u8,
    /// First address, from 0.
    pub address: u16,
    /// Registers or bits.
    pub count: u16,
    /// `uint16`, `uint32`, `float32` or `bit`.
    pub kind: &'static str,
    /// Name.
    pub name: String,
    /// Unit; empty for plain numbers.
    pub unit: String,
    /// Group that one request reads.
    pub group: String,
    /// What it says.
    pub meaning: String,
}

/// Every value; alarm bits with what they stand for where the node's alarms are known.
pub fn rows(alarms: Option<&[Limit]>) -> Vec<Row> {
    let of_register = |register: &meshband::modbus::map::Register| Row {
        function: READ_REGISTERS,
        address: register.address,
        count: register.kind.registers(),
        kind: match register.kind {
            Kind::Word => "uint16",
            Kind::Long => "uint32",
            Kind::Float => "float32",
        },
        name: register.name.into(),
        unit: register.unit.into(),
        group: register.group.into(),
        meaning: register.meaning.into(),
    };
    let of_input = |input: &meshband::modbus::map::Bit| -> Vec<Row> {
        let bit = |n: u16| Row {
            function: READ_INPUTS,
            address: input.address + n,
            count: 1,
            kind: "bit",
            name: if input.count == 1 { input.name.into() } else { format!("{}_{}", input.name, n + 1) },
            unit: String::new(),
            group: "discrete inputs".into(),
            meaning: if input.count == ALARM_BITS { alarm(alarms, n, input.name) } else { input.meaning.into() },
        };
        (0..input.count).map(bit).collect()
    };
    let samples = Row {
        function: READ_REGISTERS,
        address: SAMPLES,
        count: Kind::Float.registers(),
        kind: "float32",
        name: "sample_1".into(),
        unit: "m/s^2".into(),
        group: "waveform samples".into(),
        meaning: format!(
            "first of {} samples of the waveform held, the oldest; sample n is at {SAMPLES} + 2 (n - 1)",
            SAMPLE_REGISTERS / 2
        ),
    };
    REGISTERS.iter().map(of_register).chain([samples]).chain(INPUTS.iter().flat_map(of_input)).collect()
}

/// What bit `n` of a kind says.
fn alarm(alarms: Option<&[Limit]>, n: u16, kind: &str) -> String {
    let number = n + 1;
    let state = match kind {
        "standing" => "is raised or latched",
        "raised" => "is beyond its limit now",
        _ => "stands and nobody has acknowledged it",
    };
    let what = match alarms.map(|alarms| alarms.get(usize::from(n))) {
        None => format!("alarm {number}, [[alarms]] table {number} of the settings"),
        Some(None) => format!("alarm {number}, not configured"),
        Some(Some(limit)) => {
            let (band, call) = (limit.band, limit.call().to_lowercase());
            let (name, _) = name_and_unit(band.watched);
            format!("{call} {number}, {name} {} from {} to {} Hz", limit.beyond(), band.from.0, band.to.0)
        }
    };
    format!("{what}: {state}")
}

/// First address and length of each group that one request reads, in the order of the addresses.
pub fn groups(rows: &[Row]) -> Vec<(u8, String, u16, u16)> {
    let mut groups: Vec<(u8, String, u16, u16)> = Vec::new();
    for row in rows {
        let end = row.address + row.count;
        match groups.last_mut() {
            // A gap has no meaning: a request over it is refused.
            Some((function, group, first, count))
                if *group == row.group && *function == row.function && *first + *count == row.address =>
            {
                *count = end - *first;
            }
            _ => groups.push((row.function, row.group.clone(), row.address, row.count)),
        }
    }
    groups
}

/// Bytes of a read and of its answer on the serial line, checksums included.
pub fn example(station: u8, row: &Row, value: f32) -> [Vec<u8>; 2] {
    let sealed = |mut bytes: Vec<u8>| {
        bytes.extend(CRC16.checksum(&bytes).to_le_bytes());
        bytes
    };
    let [a, b] = row.address.to_be_bytes();
    let [c, d] = row.count.to_be_bytes();
    let request = sealed(vec![station, row.function, a, b, c, d]);
    let mut answer = vec![station, row.function, 4];
    answer.extend(value.to_be_bytes());
    [request, sealed(answer)]
}
