//! What complete records give: peaks and indicators, the law's check, mesh bands, condition indicators, and their alarms.

use super::values::Values;
use super::{HOLD_AFTER_RECORD, Node, State, VELOCITY_FROM_HZ, WideUse};
use crate::alarm::Watched;
use crate::bandwidth_watch::Verdict;
use crate::buffers::{Arrays, Buffers};
use crate::events::EventKind;
use crate::gear_condition;
use crate::indicators::Moments;
use crate::levels::{self, Departure, Departures, ExpectedLevel, LevelPoint};
use crate::mesh_band;
use crate::message::{GearIndicators, Indicators, Peaks, Spectrum, Tag};
use crate::peaks;
use crate::stream::WIDE_POINTS;
use crate::tach::Validity;
use crate::units::Hertz;
use heapless::Vec;

impl<A: Arrays> Node<A> {
    pub(super) fn tag(&self, first_tick: u64, rate: Hertz, stages: u8, resolution_hz: f32) -> Tag {
        let speed = self.present_speed();
        Tag {
            first_tick,
            speed_hz: speed.pinion.0,
            speed_uncertainty: speed.uncertainty,
            validity: speed.validity,
            period_ticks: self.active.period_ticks,
            stages,
            rate_hz: rate.0,
            resolution_hz,
            aliasing: self.active.aliasing,
        }
    }

    pub(super) fn finish_wide(&mut self) {
        self.hold = HOLD_AFTER_RECORD;
        let (rate, stages) = (self.active.output, self.active.stages);
        let tag = self.tag(self.wide_tick, rate, stages, rate.0 / WIDE_POINTS as f32);
        let Buffers { wide, snapshot, .. } = self.arrays.buffers_mut();
        if self.snapshot_wanted && self.snapshot_sent.is_none() {
            self.snapshot_wanted = false;
            self.snapshot_scale = keep_snapshot(wide, snapshot);
            self.snapshot_tag = tag;
            self.snapshot_sent = Some(0);
        }
        let rms = Moments::of(wide).rms();
        let (lines, digest) = peaks::strongest(wide, tag.resolution_hz);
        let mesh_hz = f32::from(self.config.gears.pinion_teeth) * tag.speed_hz;
        let reach = peaks::reach_hz(rate.0, stages, self.config.limits.analogue_stop.0);
        let origins = if tag.validity == Validity::Locked {
            peaks::label(&lines, mesh_hz, rate.0, tag.resolution_hz, reach)
        } else {
            Vec::new()
        };
        self.signal_rms = rms;
        let dropped = self.peaks.replace(Peaks { tag, lines, rms, digest, origins }).is_some();
        self.count_dropped(dropped);
    }

    /// Overall values in units, with what has become complete since the last ones.
    pub(super) fn finish_values(&mut self, values: &Values) {
        let tag = self.tag(values.first_tick, self.active.adc, 0, 0.0);
        let per_code = self.sensor().acceleration_per_code.0.abs();
        let codes = &values.codes;
        let (rms, peak, crest, kurtosis) = (codes.rms * per_code, codes.peak * per_code, codes.crest(), codes.kurtosis);
        let velocity_rms = values.velocity_rms * per_code;
        let (pinion, wheel) = self.arrays.buffers_mut().chain.shafts().take();
        if believed(&tag).is_none() {
            self.departures = Departures::NONE;
        }
        let good = values.quality.is_good();
        self.departures.rms = self.departure(&tag, rms, |point| point.rms).filter(|_| good);
        self.departures.velocity_rms = self.departure(&tag, velocity_rms, |point| point.velocity_rms).filter(|_| good);
        let indicators = Indicators {
            tag,
            rms,
            peak,
            crest,
            kurtosis,
            sideband_energy_ratio: self.sideband_energy[0],
            gear: self.gear.take(),
            bandwidth: self.bandwidth.take(),
            quality: values.quality,
            velocity_rms,
            velocity_band_hz: [VELOCITY_FROM_HZ, values.velocity_to_hz],
            pinion,
            wheel,
            departures: self.departures,
        };
        let dropped = self.indicators.replace(indicators).is_some();
        self.count_dropped(dropped);
        self.watch_signal(&values.quality);
        if !good {
            return;
        }
        let speed = believed(&tag);
        let of_the_whole = [
            (Watched::Rms, rms),
            (Watched::Peak, peak),
            (Watched::Crest, crest),
            (Watched::Kurtosis, kurtosis),
            (Watched::VelocityRms, velocity_rms),
        ];
        for (watched, value) in of_the_whole {
            self.watch(watched, speed, value);
        }
        if let (Some(orders), Some(_)) = (pinion, speed) {
            self.watch(Watched::OncePerTurn, speed, orders.lines[0].amplitude);
        }
        if let (Some(largest), Some(_)) = (self.departures.largest(), speed) {
            self.watch(Watched::Departure, speed, largest);
        }
    }

    pub(super) fn finish_edges(&mut self) {
        let Some(measured) = self.bandwidth_watch.result() else { return };
        self.bandwidth = Some(measured);
        let ratio = measured.bandwidth_hz / measured.law_hz;
        let tag = self.tag(self.next_tick, self.active.adc, 0, 0.0);
        self.watch_at_speed(Watched::BandwidthRatio, &tag, ratio);
        let per_cent = (100.0 * ratio) as u32;
        match self.bandwidth_watch.judge(&measured, &self.config) {
            Some(Verdict::Departs) => self.note(EventKind::BandwidthDeparts, per_cent),
            Some(Verdict::Agrees) => self.note(EventKind::BandwidthAgrees, per_cent),
            None => {}
        }
    }

    pub(super) fn finish_mesh(&mut self) {
        let (stages, rate) = self.stream.mesh_format(self.clock);
        let chain = &self.arrays.buffers().chain;
        let (record, zoom) = (*chain.record(), chain.mesh_bands());
        let speed_hz = record.mean_hz(self.clock.0);
        let first_tick = self.time.peek(record.first_tick);
        let tag = Tag { speed_hz, ..self.tag(first_tick, rate, stages, speed_hz * zoom.order_per_bin()) };
        if tag.validity == Validity::Locked && self.state == State::Measuring {
            let (bands, digest) = mesh_band::bands(zoom, &self.config, self.mesh_plan.harmonics, speed_hz);
            let gear_order = f32::from(self.config.gears.pinion_teeth) / f32::from(self.config.gears.gear_teeth);
            let energy = |shaft: f32| zoom.sideband_energy_ratio(1, shaft).unwrap_or(0.0);
            let sideband_energy = [energy(1.0), energy(gear_order)];
            let of_turn = |ticks: u32| self.clock.rate(ticks).0;
            let (slowest_hz, fastest_hz) = (of_turn(record.longest), of_turn(record.shortest));
            let turns = zoom.config().turns;
            if let Some(first) = bands.first() {
                self.sideband_energy = sideband_energy;
                self.departures.mesh_amplitude =
                    self.departure(&tag, first.line.amplitude, |point| point.mesh_amplitude);
                self.watch_at_speed(Watched::MeshAmplitude, &tag, first.line.amplitude);
                self.watch_at_speed(Watched::SidebandEnergyRatio, &tag, sideband_energy[0]);
            }
            let spectrum = Spectrum { tag, bands, digest, turns, slowest_hz, fastest_hz };
            let dropped = self.spectrum.replace(spectrum).is_some();
            self.count_dropped(dropped);
        }
        self.record_complete = true;
        self.hold = HOLD_AFTER_RECORD;
    }

    /// Indicators of a complete average. The wideband record serves as work space; one under way begins anew.
    pub(super) fn finish_average(&mut self) {
        self.hold = HOLD_AFTER_RECORD;
        let tag = self.tag(self.next_tick, self.active.output, self.active.stages, 0.0);
        let teeth = self.config.gears.pinion_teeth;
        let (turns, hunting_broken) = mesh_band::average_turns(teeth, self.config.gears.gear_teeth);
        if self.wide_use == WideUse::Record {
            self.wide_count = 0;
        }
        let Buffers { chain, wide, .. } = self.arrays.buffers_mut();
        let average = chain.average();
        let points = average.points();
        let (work, split) = wide.split_at_mut(WIDE_POINTS / 2);
        let result = average.finish().map(|average| {
            gear_condition::of_average(average, teeth, &mut self.ensemble, &mut work[..points], &mut split[..points])
        });
        average.reset();
        let Some(Ok(indicators)) = result else { return };
        self.gear = Some(GearIndicators {
            tick: self.next_tick,
            speed_hz: tag.speed_hz,
            turns: turns as u16,
            hunting_broken,
            gear_sideband_energy_ratio: self.sideband_energy[1],
            ..indicators
        });
        self.departures.residual_rms = self.departure(&tag, indicators.residual_rms, |point| point.residual_rms);
        self.watch_at_speed(Watched::Fm0, &tag, indicators.fm0);
        self.watch_at_speed(Watched::Fm4, &tag, indicators.fm4);
    }

    /// How far a value is from what is expected at the result's speed.
    fn departure(&self, tag: &Tag, value: f32, of: fn(&LevelPoint) -> ExpectedLevel) -> Option<Departure> {
        levels::departure(&self.config.levels, believed(tag)?, tag.speed_uncertainty, value, of)
    }

    /// Puts a value that needs a speed to its limits.
    fn watch_at_speed(&mut self, watched: Watched, tag: &Tag, value: f32) {
        if let Some(speed) = believed(tag) {
            self.watch(watched, Some(speed), value);
        }
    }

    pub(super) fn count_dropped(&mut self, dropped: bool) {
        if dropped {
            self.totals.messages_dropped = self.totals.messages_dropped.saturating_add(1);
        }
    }
}

/// The speed of a result, where it is a measurement.
fn believed(tag: &Tag) -> Option<Hertz> {
    (tag.validity == Validity::Locked).then_some(Hertz(tag.speed_hz))
}

/// Keeps a wideband record in 16 bit; returns the scale, m/s^2 per unit.
fn keep_snapshot(record: &[f32; WIDE_POINTS], kept: &mut [i16; WIDE_POINTS]) -> f32 {
    let largest = record.iter().fold(0.0f32, |largest, sample| largest.max(sample.abs()));
    let scale = if largest > 0.0 { largest / 32_767.0 } else { 1.0 };
    for (kept, sample) in kept.iter_mut().zip(record) {
        *kept = (sample / scale) as i16;
    }
    scale
}
