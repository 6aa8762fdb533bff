//! The tachometer: timer 1 runs out at each edge of the record's list.
//!
//! The stamp is the edge's own instant, as a capture register would hold it; the latency of the interrupt
//! does not enter.

use super::registers::{Device, TimerBlock};
use super::time::TimeBase;
use heapless::spsc::Producer;
use meshband::replay::Replay;

const RUN: u32 = 1;
const INTERRUPT: u32 = 1 << 3;
/// The two counters were started a few instructions apart.
const START_SKEW_TICKS: u32 = 4;

/// State of the tachometer, owned by its interrupt.
pub struct Tach {
    timer: Device<TimerBlock>,
    time: TimeBase,
    record: Replay<'static>,
    next: usize,
    edges: Producer<'static, u32>,
    /// Edges that found the queue full.
    pub lost: u32,
}

impl Tach {
    /// Prepares it; [`Tach::start`] sets it going.
    pub fn new(
        timer: Device<TimerBlock>,
        time: TimeBase,
        record: Replay<'static>,
        edges: Producer<'static, u32>,
    ) -> Self {
        Self { timer, time, record, next: 0, edges, lost: 0 }
    }

    /// Starts waiting for the first edge.
    pub fn start(&mut self) {
        self.timer.reload.write(u32::MAX);
        self.arm();
    }

    /// The timer's interrupt: every edge that is due, then the time to the next.
    pub fn on_interrupt(&mut self) {
        self.timer.interrupt.write(1);
        self.arm();
    }

    /// Number of edges delivered.
    pub fn delivered(&self) -> usize {
        self.next - self.lost as usize
    }

    fn arm(&mut self) {
        while let Some(edge) = self.record.edge(self.next) {
            let now = self.time.now().saturating_add(START_SKEW_TICKS);
            if edge > now {
                self.timer.value.write(edge - now);
                self.timer.control.write(RUN | INTERRUPT);
                return;
            }
            self.next += 1;
            if self.edges.enqueue(TimeBase::stamp(edge)).is_err() {
                self.lost += 1;
            }
        }
        self.timer.control.write(0);
    }
}
