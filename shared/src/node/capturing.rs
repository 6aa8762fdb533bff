//! What a node does about waveforms: what ends their sample grid, what begins one, what is said of it.

use super::Node;
use super::capture::{Codes, Triggered};
use crate::buffers::Arrays;
use crate::config::Configuration;
use crate::events::EventKind;
use crate::frame::CRC32;
use crate::sample_ring::UNITS_PER_CODE;
use crate::waveform::{CaptureEnd, CaptureFacts, CaptureHead, CapturePart, CapturePhase, CaptureReport, Trigger};

impl<A: Arrays> Node<A> {
    /// Follows the configuration; what is held stays.
    pub(super) fn configure_capture(&mut self) {
        self.break_capture(CaptureEnd::Commanded);
        let keeps = self.config.capture.wanted(self.active.output).is_some();
        self.arrays.capture_mut().configure(keeps);
    }

    /// The sample grid ends: the memory begins anew, or a waveform whose trigger has been ends here.
    pub(super) fn break_capture(&mut self, end: CaptureEnd) {
        if self.arrays.capture_mut().end_grid() {
            self.seal_capture(end);
        }
    }

    /// A block of codes into the memory.
    pub(super) fn follow_capture(&mut self, codes: &[u16], railed: bool, first: u64, period: u32) {
        let Some(wanted) = self.config.capture.wanted(self.active.output) else { return };
        let (over, zero) = (self.active.adc.0 / wanted.0, self.config.sensor.zero_code);
        if self.arrays.capture_mut().take(&Codes { codes, railed, first, period, over, zero }) {
            self.seal_capture(CaptureEnd::Full);
        }
    }

    /// Goes on with a checksum, also of a node that has been stopped.
    pub(super) fn go_on_sealing(&mut self) {
        if let Some(number) = self.arrays.capture_mut().go_on_sealing() {
            self.note(EventKind::CaptureHeld, number);
        }
    }

    /// An alarm or a host wants what is there.
    pub(super) fn trigger_capture(&mut self, trigger: Trigger) {
        if let Triggered::Missed(missed) = self.arrays.capture_mut().trigger(trigger, self.next_tick) {
            self.note(EventKind::CaptureMissed, missed);
        }
    }

    #[inline(never)]
    fn seal_capture(&mut self, end: CaptureEnd) {
        let speed = self.present_speed();
        let facts = CaptureFacts {
            ticks_per_second: self.clock.0,
            scale: self.sensor().acceleration_per_code.0 / UNITS_PER_CODE,
            speed_hz: speed.pinion.0,
            validity: speed.validity,
            end,
            teeth: [self.config.gears.pinion_teeth, self.config.gears.gear_teeth],
            configuration: fingerprint(&self.config),
            ..CaptureFacts::NONE
        };
        self.arrays.capture_mut().seal(facts);
    }

    /// The memory may be used again; another number changes nothing.
    pub(super) fn release_capture(&mut self, number: u32) -> CaptureReport {
        let marks_from = self.tach_locked.then_some(self.next_tick);
        if self.arrays.capture_mut().release(number, marks_from) {
            self.configure_capture();
        }
        self.arrays.capture().report()
    }

    /// What the node does about waveforms.
    pub fn capture_phase(&self) -> CapturePhase {
        self.arrays.capture().phase()
    }

    /// The waveform that it holds.
    pub fn held_waveform(&self) -> Option<&CaptureHead> {
        self.arrays.capture().held()
    }

    /// Triggers that found another waveform begun or held, since the start.
    pub fn missed_waveforms(&self) -> u32 {
        self.arrays.capture().missed()
    }

    /// A sample of the waveform held, m/s^2, by its place from the oldest; not a number where there is none.
    pub fn held_sample(&self, place: u32) -> f32 {
        self.arrays.capture().sample(place)
    }

    /// Part of the bytes held.
    pub(super) fn capture_part(&self, number: u32, offset: u32) -> CapturePart {
        self.arrays.capture().part(number, offset)
    }
}

/// CRC-32 of a configuration in postcard, as a node stores it.
#[inline(never)]
fn fingerprint(config: &Configuration) -> u32 {
    let mut room = [0; Configuration::MAX_SERIALISED];
    let length = config.to_stored(&mut room).unwrap_or(0);
    room.get(..length).map_or(0, |bytes| CRC32.checksum(bytes))
}
