//! A board around the chip: power, signal, tach, line. See the crate's head for how to use it.

use crate::chip::Chip;
use crate::cpu::{Cpu, Snapshot};
use crate::elf::Image;
use crate::error::{Error, Result};
use crate::flash;
use crate::world::{Analogue, Seen};

/// Cycles per instruction unless told otherwise: on the safe side of what the core's manual gives for this program.
pub const CYCLES_PER_INSTRUCTION: f64 = 2.0;
/// How long a tach pulse lasts at most, s.
const PULSE_S: f64 = 0.005;
/// Share of the interval to the next pulse that a pulse lasts at most.
const PULSE_SHARE: f64 = 0.4;

/// The board.
pub struct Board {
    cpu: Cpu,
    line_free_s: f64,
}

impl Board {
    /// A board with an image in its flash, switched on now.
    ///
    /// # Errors
    /// [`Error::Absent`] without Unicorn, [`Error::Image`] for an image that lies elsewhere.
    pub fn new(image: &Image) -> Result<Self> {
        let mut chip = Chip::new();
        for segment in &image.segments {
            let place = segment.address.checked_sub(flash::START).map(|at| at as usize);
            let place = place.and_then(|at| chip.cells.get_mut(at..at + segment.bytes.len()));
            let Some(place) = place else {
                return Err(Error::Image(format!("a segment at {:#010x} is not in flash", segment.address)));
            };
            place.copy_from_slice(&segment.bytes);
        }
        Ok(Self { cpu: Cpu::new(chip, CYCLES_PER_INSTRUCTION)?, line_free_s: 0.0 })
    }

    /// Seconds since power first came.
    pub fn seconds(&self) -> f64 {
        self.chip().seconds()
    }

    /// Runs until so many seconds since power first came.
    ///
    /// # Errors
    /// What ends a run: see [`Error`].
    pub fn run_until(&mut self, seconds: f64) -> Result<()> {
        // Clocks may change on the way, and with them which instant is meant.
        for _ in 0..4 {
            let until = self.chip().time_at(seconds);
            if self.chip().now >= until {
                break;
            }
            self.cpu.run(until)?;
        }
        Ok(())
    }

    /// The signal at the second sensor's pin from now on.
    pub fn set_second(&mut self, analogue: Analogue) {
        self.chip_mut().inputs.second = analogue;
    }

    /// The signal at the first sensor's pin from now on.
    pub fn set_analogue(&mut self, analogue: Analogue) {
        self.chip_mut().inputs.analogue = analogue;
    }

    /// Pulses of the tach: their rising edges, s, ascending, behind those given before.
    pub fn add_tach_edges(&mut self, edges_s: &[f64]) {
        let chip = self.chip_mut();
        for (n, &edge) in edges_s.iter().enumerate() {
            let length = edges_s.get(n + 1).map_or(PULSE_S, |next| (next - edge) * PULSE_SHARE).min(PULSE_S);
            chip.inputs.tach.extend([(edge, true), (edge + length, false)]);
        }
        chip.follow_inputs();
    }

    /// Pulses per second: their rising edges, s, ascending, behind those given before. Clean ones, long enough for
    /// any filter.
    pub fn add_second_pulses(&mut self, edges_s: &[f64]) {
        let chip = self.chip_mut();
        chip.inputs.second_pulses.extend(edges_s);
        chip.follow_inputs();
    }

    /// Changes of the tach's pin, s and level, ascending: for storms, bounces and glitches.
    pub fn add_tach_levels(&mut self, levels: &[(f64, bool)]) {
        let chip = self.chip_mut();
        chip.inputs.tach.extend(levels);
        chip.follow_inputs();
    }

    /// Bytes from the host, one behind the other as fast as the line goes, from now or from the end of those given
    /// before.
    pub fn send(&mut self, bytes: &[u8]) {
        let inputs = &self.chip().inputs;
        let byte_s = inputs.bits as f64 / inputs.bits_per_second;
        self.line_free_s = self.line_free_s.max(self.seconds());
        for &byte in bytes {
            self.line_free_s += byte_s;
            let at = self.line_free_s;
            self.chip_mut().inputs.bytes.push_back((at, byte));
        }
        self.chip_mut().follow_inputs();
    }

    /// From now on the host sends at another rate, so many bits per character; a program that listens otherwise hears
    /// other bytes.
    pub fn set_line(&mut self, bits_per_second: f64, bits: u64) {
        let inputs = &mut self.chip_mut().inputs;
        (inputs.bits_per_second, inputs.bits) = (bits_per_second, bits);
    }

    /// Takes the bytes that the board has sent.
    pub fn take_sent(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.chip_mut().seen.sent).into_iter().map(|(_, byte)| byte).collect()
    }

    /// What was seen; whoever looks may take it.
    pub fn seen(&mut self) -> &mut Seen {
        &mut self.chip_mut().seen
    }

    /// Switches the power off and on again: flash is kept, torn where it was busy; memory is lost.
    pub fn cycle_power(&mut self) {
        self.chip_mut().lose_power();
    }

    /// The chip.
    pub fn chip(&self) -> &Chip {
        self.cpu.chip()
    }

    /// The chip.
    pub fn chip_mut(&mut self) -> &mut Chip {
        self.cpu.chip_mut()
    }

    /// The processor.
    pub fn cpu(&mut self) -> &mut Cpu {
        &mut self.cpu
    }

    /// Everything as it is now.
    pub fn snapshot(&self) -> (Snapshot, f64) {
        (self.cpu.snapshot(), self.line_free_s)
    }

    /// Back to how everything was.
    ///
    /// # Errors
    /// [`Error::Engine`].
    pub fn restore(&mut self, snapshot: &(Snapshot, f64)) -> Result<()> {
        self.line_free_s = snapshot.1;
        self.cpu.restore(&snapshot.0)
    }
}
