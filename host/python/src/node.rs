//! The node's own chain: the code that the firmware runs, fed with arrays.

use crate::errors::{invalid, raised};
use crate::law::Law;
use crate::record::Record;
use crate::work;
use meshband::config::{BLOCK_SAMPLES, Configuration, GearPair, TachWheel};
use meshband::frame::Packet;
use meshband::identity::Identity;
use meshband::node::Block;
use meshband::session::Session;
use meshband::units::{Acceleration, TicksPerSecond};
use meshband_host::virtual_node::frames::Received;
use meshband_host::virtual_node::setup::configuration;
use meshband_host::virtual_node::signal::Signal;
use meshband_host::virtual_node::simulation;
use meshband_host::{Error, Result};
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::sync::{Arc, Mutex, PoisonError};

/// A node on the host that is fed block by block.
#[pyclass(frozen, module = "meshband._meshband")]
pub struct Node {
    // A node is 100 KB: on the heap, and one caller at a time.
    session: Mutex<Box<Session>>,
}

#[pymethods]
impl Node {
    /// A node with tooth counts, a tach on a shaft with so many turns per turn of the pinion, a scale and a time base.
    #[new]
    fn new(
        py: Python<'_>,
        teeth: (u16, u16),
        pulses_per_turn: u16,
        pinion_per_tach: f32,
        acceleration_per_code: f32,
        ticks_per_second: u32,
        law: Option<&Law>,
    ) -> PyResult<Self> {
        let defaults = Configuration::default();
        let mut config = Configuration {
            gears: GearPair { pinion_teeth: teeth.0, gear_teeth: teeth.1 },
            tach: TachWheel { pulses_per_turn, pinion_per_tach, ..defaults.tach },
            ..defaults
        };
        config.sensor.acceleration_per_code = Acceleration(acceleration_per_code);
        config.sensor.zero_code = 0x8000;
        if let Some(law) = law {
            config.law = raised(py, law.file.for_node())?;
        }
        let session = Session::new(config, TicksPerSecond(ticks_per_second), Identity::HOST)
            .map_err(|error| invalid(py, "the node's configuration", error))?;
        Ok(Self { session: Mutex::new(Box::new(session)) })
    }

    /// Most samples of a block.
    #[classattr]
    const BLOCK_SAMPLES: usize = BLOCK_SAMPLES;

    /// Period that the node asks of its converter, ticks.
    #[getter]
    fn requested_period_ticks(&self) -> u32 {
        self.session.lock().unwrap_or_else(PoisonError::into_inner).node().requested_period_ticks()
    }

    /// State in words.
    #[getter]
    fn state(&self) -> String {
        format!("{:?}", self.session.lock().unwrap_or_else(PoisonError::into_inner).node().state())
    }

    /// Edges up to a block's end, then the block (offset-binary codes); gives the bytes the node sends.
    fn feed<'py>(
        &self,
        py: Python<'py>,
        codes: PyReadonlyArray1<'py, u16>,
        first_tick: u32,
        period_ticks: u32,
        sequence: u32,
        edge_ticks: PyReadonlyArray1<'py, u32>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let (codes, edges) = (codes.as_array().to_vec(), edge_ticks.as_array().to_vec());
        if codes.is_empty() || codes.len() > BLOCK_SAMPLES {
            return Err(invalid(py, "codes", format!("{} samples: a block has 1 to {BLOCK_SAMPLES}", codes.len())));
        }
        if period_ticks == 0 {
            return Err(invalid(py, "period_ticks", "0 is no period"));
        }
        let sent = py.detach(|| {
            let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
            let mut sent = Vec::new();
            edges.iter().for_each(|&tick| session.on_edge(tick));
            let block = Block { codes: &codes, second: &[], first_tick, period_ticks, sequence, overrun: false };
            session.on_block(block, &mut |frame| sent.extend_from_slice(frame));
            sent
        });
        Ok(PyBytes::new(py, &sent))
    }

    /// Frames of bytes that a node sent, as JSON, and how many were refused and lost.
    #[staticmethod]
    fn decode(py: Python<'_>, bytes: Vec<u8>) -> PyResult<(String, u32, u32)> {
        let received = Received::decode(&bytes);
        let text = raised(py, messages(&received))?;
        Ok((text, received.refused, received.lost))
    }
}

/// The node's own chain on a run of a record, as a board does that is never late: bytes of the link, messages as JSON.
#[pyfunction]
#[allow(clippy::too_many_arguments, reason = "keywords on the Python side")]
pub fn replay<'py>(
    py: Python<'py>,
    record: &Record,
    run: usize,
    channel: String,
    start_s: f64,
    duration_s: Option<f64>,
    law: Option<&Law>,
    rate_hz: Option<f64>,
) -> PyResult<(Bound<'py, PyBytes>, String)> {
    let record = Arc::clone(&record.inner);
    let law = law.map(|law| law.file.clone());
    let (link, text) = work::run(py, move || {
        let signal = Signal::of_record(&record, run, (&channel, None), start_s, duration_s)?;
        let mut config = configuration(&signal, rate_hz)?;
        if let Some(law) = &law {
            config.law = law.for_node()?;
        }
        let image = signal.image(&config)?;
        let simulated = simulation::run(&image.bytes)?;
        let text = messages(&Received::decode(&simulated.link))?;
        Ok((simulated.link, text))
    })?;
    Ok((PyBytes::new(py, &link), text))
}

/// Messages and replies as a JSON list of objects with one key, their kind.
fn messages(received: &Received) -> Result<String> {
    let value = |packet: &Packet| match packet {
        Packet::Message(message) => serde_json::to_value(message).ok(),
        Packet::Reply(reply) => serde_json::to_value(reply).ok(),
        Packet::Request(_) => None,
    };
    let list: Vec<_> = received.packets.iter().filter_map(value).collect();
    serde_json::to_string(&list).map_err(|error| Error::invalid("messages", error))
}
