//! A node behind a client without a line and without waiting: reading computes its next block.

use meshband::config::Configuration;
use meshband::frame::{MAX_FRAME, Packet, encode};
use meshband_host::link::transport::Transport;
use meshband_host::virtual_node::serve::Looped;
use meshband_host::virtual_node::signal::{Signal, Unit};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Teeth of machines/17-38.toml.
const TEETH: [u32; 2] = [17, 38];
/// Rate of the signal, Hz.
const RATE_HZ: f64 = 25_600.0;

/// Seconds of a pair at a speed: mesh harmonics, swollen once per turn of both shafts, and noise of so many m/s2.
pub fn signal(seconds: f64, speed_hz: f64, noise: f64) -> Signal {
    let mut seed = 1u64;
    let mut random = || {
        // Marsaglia's xorshift, twelve of which are nearly Gaussian.
        let mut sum = -6.0;
        for _ in 0..12 {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            sum += (seed >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    };
    let ratio = f64::from(TEETH[0]) / f64::from(TEETH[1]);
    let value = |n: usize| {
        let turns = speed_hz * n as f64 / RATE_HZ;
        let swell = 1.0 + 0.2 * (TAU * turns).cos() + 0.1 * (TAU * ratio * turns).cos();
        let mesh: f64 = (1..=4).map(|h| (TAU * f64::from(h * TEETH[0]) * turns).cos() / f64::from(h)).sum();
        3.0 * swell * mesh + (TAU * turns).cos() + noise * random()
    };
    let samples = (0..(seconds * RATE_HZ) as usize).map(value).collect();
    let edges_s = (0..(seconds * speed_hz) as usize).map(|turn| turn as f64 / speed_hz).collect();
    Signal {
        title: "a pair".into(),
        place: "test".into(),
        channel: "bearing".into(),
        unit: Unit::Acceleration,
        samples,
        second: None,
        rate_hz: RATE_HZ,
        edges_s,
        pulses_per_turn: 1,
        pinion_per_tach: 1.0,
        teeth: TEETH,
        train: Vec::new(),
        machine_hash: None,
        notes: Vec::new(),
    }
}

/// The line to a node on a looped signal.
pub struct Direct {
    node: Looped<'static>,
    sequence: u16,
    waiting: VecDeque<u8>,
    /// Bits of the factor by which the machine vibrates more than its signal.
    pub strength: Arc<AtomicU64>,
}

impl Direct {
    /// A node with this configuration; the signal stays until the end of the program.
    pub fn new(signal: &Signal, config: &Configuration) -> Self {
        let signal: &'static Signal = Box::leak(Box::new(signal.clone()));
        let node = Looped::new(signal, config).expect("loops");
        // The signal takes nine tenths of the range: a fault needs room.
        let strength = Arc::new(AtomicU64::new(0.4f64.to_bits()));
        Self { node, sequence: 0, waiting: VecDeque::new(), strength }
    }

    fn take(&mut self, packets: &[Packet]) {
        for packet in packets {
            let mut buffer = [0; MAX_FRAME];
            self.waiting.extend(encode(packet, self.sequence, &mut buffer).expect("fits"));
            self.sequence = self.sequence.wrapping_add(1);
        }
    }
}

impl Transport for Direct {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        if self.waiting.is_empty() {
            self.node.set_strength(f64::from_bits(self.strength.load(Ordering::Relaxed)));
            let packets = self.node.block();
            self.take(&packets);
        }
        let count = self.waiting.len().min(buffer.len());
        for (place, byte) in buffer.iter_mut().zip(self.waiting.drain(..count)) {
            *place = byte;
        }
        Ok(Some(count))
    }

    fn write(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        let packets = self.node.receive(bytes);
        self.take(&packets);
        Ok(())
    }
}
