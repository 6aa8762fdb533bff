//! What complete records give: peaks and indicators, the law's check, mesh bands, condition indicators, and their
//! alarms.

use super::values::{OfChannel, Values};
use super::watch::{Evidence, use_of};
use super::{HOLD_AFTER_RECORD, Node, SPARED_PER_SECOND, State, WideStep, WideUse, velocity_from_hz};
use crate::alarm::{Use, Watched};
use crate::bandwidth_watch::Verdict;
use crate::buffers::{Arrays, Buffers};
use crate::config::PassBand;
use crate::events::EventKind;
use crate::gear_condition;
use crate::indicators::Moments;
use crate::levels::{self, Departure, Departures, ExpectedLevel, LevelPoint, LocalDepartures, LocalPoint};
use crate::math;
use crate::mesh_band::{self, Followed};
use crate::message::{
    ChannelValues, GearCondition, GearIndicators, Indicators, LineOrigin, MAX_PEAKS, Peaks, SpectralLine, Spectrum, Tag,
};
use crate::peaks;
use crate::spectrum::mean;
use crate::stream::WIDE_POINTS;
use crate::tach::Validity;
use crate::units::{Acceleration, Hertz};
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

    /// The wideband record is full.
    pub(super) fn begin_analysis(&mut self) {
        let (rate, stages) = (self.active.output, self.active.stages);
        self.wide_tag = self.tag(self.wide_tick, rate, stages, rate.0 / WIDE_POINTS as f32);
        self.wide_use = WideUse::Analysis(WideStep::Window);
    }

    /// The next step of the wideband analysis, where it is due.
    pub(super) fn go_on_with_wide(&mut self) {
        let WideUse::Analysis(step) = self.wide_use else { return };
        if self.next_tick < self.spared_until {
            return;
        }
        self.note_long_work();
        self.wide_use = match step {
            WideStep::Window => {
                self.prepare_wide();
                WideUse::Analysis(WideStep::Transform)
            }
            WideStep::Transform => {
                peaks::transform(&mut self.arrays.buffers_mut().wide);
                WideUse::Analysis(WideStep::Search)
            }
            WideStep::Search => {
                self.finish_wide();
                WideUse::Idle
            }
        };
    }

    /// The main loop may be behind for a while.
    fn note_long_work(&mut self) {
        self.hold = HOLD_AFTER_RECORD;
        self.spared_until = self.next_tick + u64::from(self.clock.0 / SPARED_PER_SECOND);
    }

    /// The wideband record's memory is needed for something else: what is under way begins anew.
    pub(super) fn take_over_wide(&mut self) {
        match self.wide_use {
            WideUse::Record => self.wide_count = 0,
            WideUse::Analysis(_) => {
                self.wide_use = WideUse::Idle;
                self.wide_due = self.next_tick;
            }
            WideUse::Idle | WideUse::Edges => {}
        }
    }

    fn prepare_wide(&mut self) {
        let Buffers { wide, snapshot, .. } = self.arrays.buffers_mut();
        if self.snapshot_wanted && self.snapshot_sent.is_none() {
            self.snapshot_wanted = false;
            self.snapshot_scale = keep_snapshot(wide, snapshot);
            self.snapshot_tag = self.wide_tag;
            self.snapshot_sent = Some(0);
        }
        self.signal_rms = rms_about_mean(wide);
        peaks::window(wide);
    }

    fn finish_wide(&mut self) {
        let (tag, rms) = (self.wide_tag, self.signal_rms);
        let (lines, digest) = peaks::search(&self.arrays.buffers().wide, tag.resolution_hz);
        let (origins, origin_gears) = match believed(&tag) {
            Some(pinion) => self.origins(&lines, &tag, pinion),
            None => (Vec::new(), Vec::new()),
        };
        let dropped = self.peaks.replace(Peaks { tag, lines, rms, digest, origins, origin_gears }).is_some();
        self.count_dropped(dropped);
    }

    /// Mesh harmonics that lines may be, and of which gear: of the pinion's mesh, and only what that does not explain
    /// of a further stage's.
    fn origins(
        &self,
        lines: &[SpectralLine],
        tag: &Tag,
        pinion: Hertz,
    ) -> (Vec<LineOrigin, MAX_PEAKS>, Vec<u8, MAX_PEAKS>) {
        let reach = peaks::reach_hz(tag.rate_hz, tag.stages, self.config.limits.analogue_stop.0);
        let of = |gear: u8| {
            let followed = Followed::of(&self.config, gear);
            let mesh_hz = f32::from(followed.teeth) * followed.rate(pinion).0;
            peaks::label(lines, mesh_hz, tag.rate_hz, tag.resolution_hz, reach)
        };
        let mut origins = of(0);
        let mut gears: Vec<u8, MAX_PEAKS> = origins.iter().map(|_| 0).collect();
        for (number, gear) in (1u8..).zip(&self.config.train).filter(|(_, gear)| gear.stage > 1) {
            let stage_before = usize::from(number).checked_sub(2).and_then(|place| self.config.train.get(place));
            if stage_before.is_some_and(|before| before.stage == gear.stage) {
                continue;
            }
            for ((origin, of_gear), other) in origins.iter_mut().zip(&mut gears).zip(of(number)) {
                if *origin == LineOrigin::Unexplained && other != LineOrigin::Unexplained {
                    (*origin, *of_gear) = (other, number);
                }
            }
        }
        (origins, gears)
    }

    /// Overall values in units, with what has become complete since the last ones.
    pub(super) fn finish_values(&mut self, values: &Values) {
        let tag = self.tag(values.first_tick, self.active.adc, 0, 0.0);
        let ChannelValues { rms, peak, crest, kurtosis, velocity_rms, quality, .. } =
            in_units(&values.first, self.sensor().acceleration_per_code, Hertz(0.0));
        let second = values.second.as_ref().zip(self.config.second.as_ref()).map(|(values, second)| {
            let bounds = PassBand { sensor: second.band, ..self.config.pass };
            in_units(values, second.acceleration_per_code, bounds.upper_edge())
        });
        self.bias_codes = [Some(values.first.codes.mean), values.second.as_ref().map(|second| second.codes.mean)];
        // Of another gear of a train they are nobody's here.
        let follows_pinion = self.round.gear() == 0;
        let orders = self.arrays.buffers_mut().chain.shafts().take();
        let (pinion, mut wheel) = if follows_pinion { orders } else { (None, None) };
        if pinion.is_some() {
            self.round.note_orders();
        }
        if let Some(orders) = wheel.as_mut().filter(|_| !self.config.train.is_empty()) {
            // Its angle counts from another tooth with every visit.
            orders.lines.iter_mut().for_each(|line| line.phase_deg = f32::NAN);
        }
        if believed(&tag).is_none() {
            (self.departures, self.local_departures) = (Departures::NONE, LocalDepartures::NONE);
        }
        let starting = values.starting;
        let may = |watched: Watched| use_of(watched, &quality, starting);
        let told = |watched: Watched| may(watched) != Use::Neither;
        self.departures.rms = self.departure(&tag, rms, |point| point.rms).filter(|_| told(Watched::Rms));
        self.departures.velocity_rms =
            self.departure(&tag, velocity_rms, |point| point.velocity_rms).filter(|_| told(Watched::VelocityRms));
        let (departures, local_departures, is_whole) = self.departures_to_say();
        let indicators = Indicators {
            tag,
            rms,
            peak,
            crest,
            kurtosis,
            sideband_energy_ratio: self.pinion_sideband_energy,
            gear: self.gear.take(),
            bandwidth: self.bandwidth.take(),
            quality,
            velocity_rms,
            velocity_band_hz: [velocity_from_hz(&self.config), values.velocity_to_hz],
            pinion,
            wheel,
            departures,
            second,
            local_departures,
            absolute_phase: self.marks.is_absolute(),
        };
        let largest = indicators.largest_departure();
        let dropped = self.indicators.replace(indicators).is_some();
        self.count_dropped(dropped);
        if !starting {
            self.watch_sensor(&Evidence {
                quality,
                second: second.as_ref().map(|second| second.quality),
                mean_code: values.first.codes.mean,
                rms,
                departure: self.departures.rms.filter(|_| may(Watched::Rms) == Use::Both),
                turns: believed(&tag).is_some(),
                bias_v: self.board_health.sensor_bias_v,
            });
        }
        let speed = believed(&tag);
        if let Some(second) = second {
            self.watch_second(speed, &second, starting);
        }
        let of_the_whole = [
            (Watched::Rms, rms),
            (Watched::Peak, peak),
            (Watched::Crest, crest),
            (Watched::Kurtosis, kurtosis),
            (Watched::VelocityRms, velocity_rms),
        ];
        for (watched, value) in of_the_whole {
            self.watch(watched, speed, value, may(watched));
        }
        if let (Some(orders), Some(_)) = (pinion, speed) {
            self.watch(Watched::OncePerTurn, speed, orders.lines[0].amplitude, may(Watched::Rms));
        }
        if let (Some(largest), Some(_)) = (largest, speed) {
            // Without the mesh it is a part of what there is: it may raise, and is no evidence of health.
            let may = match may(Watched::Rms) {
                Use::Both if !is_whole => Use::RaiseOnly,
                other => other,
            };
            self.watch(Watched::Departure, speed, largest, may);
        }
    }

    fn watch_second(&mut self, speed: Option<Hertz>, second: &ChannelValues, starting: bool) {
        let values = [
            (Watched::SecondRms, second.rms),
            (Watched::SecondPeak, second.peak),
            (Watched::SecondCrest, second.crest),
            (Watched::SecondKurtosis, second.kurtosis),
            (Watched::SecondVelocityRms, second.velocity_rms),
        ];
        for (watched, value) in values {
            self.watch(watched, speed, value, use_of(watched, &second.quality, starting));
        }
    }

    /// Whether codes were clipped since a tick.
    fn clipped_since(&self, tick: u64) -> bool {
        self.clipped_until > tick
    }

    pub(super) fn finish_edges(&mut self) {
        // Edges that were cut at their height are shorter than the machine's.
        if self.clipped_since(self.rise_from) {
            return;
        }
        let Some(measured) = self.bandwidth_watch.result() else { return };
        self.bandwidth = Some(measured);
        let ratio = measured.bandwidth_hz / measured.law_hz;
        let tag = self.tag(self.next_tick, self.active.adc, 0, 0.0);
        self.watch_at_speed(Watched::BandwidthRatio, &tag, ratio, Use::Both);
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
        // From its end, which is near: a slow gear's record is longer than what a tick tells.
        let end = self.time.peek(record.first_tick.wrapping_add(record.ticks as u32));
        let first_tick = end.saturating_sub(record.ticks);
        let tag = Tag { speed_hz, ..self.tag(first_tick, rate, stages, speed_hz * zoom.order_per_bin()) };
        let followed = self.round.followed(&self.config);
        if tag.validity == Validity::Locked && self.state == State::Measuring {
            let sidebands = self.config.mesh.sidebands;
            let (bands, digest) = mesh_band::bands(zoom, &followed, (self.mesh_plan.harmonics, sidebands), speed_hz);
            let gear_order = followed.mate_order();
            let energy = |shaft: f32| zoom.sideband_energy_ratio(1, shaft).unwrap_or(0.0);
            let sideband_energy = [energy(1.0), energy(gear_order)];
            let inseparable = mesh_band::inseparable(zoom, gear_order, sidebands);
            let of_turn = |ticks: u32| self.clock.rate(ticks).0;
            let (slowest_hz, fastest_hz) = (of_turn(record.longest), of_turn(record.shortest));
            let turns = zoom.config().turns;
            if let Some(first) = bands.first() {
                self.sideband_energy = sideband_energy;
                if self.round.gear() == 0 {
                    self.pinion_sideband_energy = sideband_energy[0];
                    self.departures.mesh_amplitude =
                        self.departure(&tag, first.line.amplitude, |point| point.mesh_amplitude);
                    if !self.config.local_levels.is_empty() {
                        self.local_departures.sidebands =
                            self.local_departure(&tag, mesh_band::sideband_amplitude(&bands, inseparable), |point| {
                                point.sidebands
                            });
                    }
                }
                // Clipping takes from the line and makes sidebands of its own.
                let [line, shape] =
                    if self.clipped_since(first_tick) { [Use::LowerBound, Use::Neither] } else { [Use::Both; 2] };
                self.watch_gear(Watched::MeshAmplitude, &tag, first.line.amplitude, line);
                self.watch_gear(Watched::SidebandEnergyRatio, &tag, sideband_energy[0], shape);
            }
            let gear = self.round.gear();
            let outgoing = &mut self.arrays.buffers_mut().outgoing;
            outgoing.spectrum = Spectrum { tag, bands, digest, turns, slowest_hz, fastest_hz, inseparable };
            outgoing.gear = gear;
            let dropped = core::mem::replace(&mut outgoing.waits, true);
            self.count_dropped(dropped);
        }
        self.round.note_bands();
        self.record_complete = true;
        self.note_long_work();
    }

    /// Indicators of a complete average, where all of it is of a locked speed and a mesh cascade made for it. The
    /// wideband record serves as work space; one under way begins anew.
    pub(super) fn finish_average(&mut self) {
        self.note_long_work();
        let followed = self.round.followed(&self.config);
        let tag = {
            let tag = self.tag(self.next_tick, self.active.output, self.active.stages, 0.0);
            Tag { speed_hz: followed.rate(Hertz(tag.speed_hz)).0, ..tag }
        };
        let teeth = followed.teeth;
        let (turns, hunting_broken) = mesh_band::average_turns(teeth, followed.mate_teeth);
        let is_pinion = self.round.gear() == 0;
        self.round.note_average();
        self.take_over_wide();
        let Buffers { chain, wide, .. } = self.arrays.buffers_mut();
        let average = chain.average();
        let points = average.points();
        let (work, split) = wide.split_at_mut(WIDE_POINTS / 2);
        let of_turns = matches!(self.state, State::Settling | State::Measuring);
        let Some(speed) = believed(&tag).filter(|_| of_turns) else {
            average.reset();
            return;
        };
        let na4 = |residual: &Moments| {
            let of = |point: &LevelPoint| point.residual_rms;
            // Levels are learned of the pinion.
            if !is_pinion {
                return f32::NAN;
            }
            na4(residual, levels::departure(&self.config.levels, speed, 0.0, residual.rms(), of))
        };
        let result = average
            .finish()
            .map(|average| gear_condition::of_average(average, teeth, na4, &mut work[..points], &mut split[..points]));
        average.reset();
        let Some(Ok(indicators)) = result else { return };
        let indicators = GearIndicators {
            tick: self.next_tick,
            speed_hz: tag.speed_hz,
            turns: turns as u16,
            hunting_broken,
            gear_sideband_energy_ratio: self.sideband_energy[1],
            ..indicators
        };
        if is_pinion {
            self.gear = Some(indicators);
        } else {
            let dropped = self.condition.replace(GearCondition { gear: self.round.gear(), indicators }).is_some();
            self.count_dropped(dropped);
        }
        if is_pinion {
            self.departures.residual_rms = self.departure(&tag, indicators.residual_rms, |point| point.residual_rms);
            self.local_departures.fm0 = self.local_departure(&tag, indicators.fm0, |point| point.fm0);
        }
        let began = self.next_tick.saturating_sub((turns as f32 / speed.0 * self.clock.0 as f32) as u64);
        let may = if self.clipped_since(began) { Use::Neither } else { Use::Both };
        self.watch_gear(Watched::Fm0, &tag, indicators.fm0, may);
        self.watch_gear(Watched::Fm4, &tag, indicators.fm4, may);
    }

    /// How far a value is from what is expected at the result's speed.
    fn departure(&self, tag: &Tag, value: f32, of: fn(&LevelPoint) -> ExpectedLevel) -> Option<Departure> {
        levels::departure(&self.config.levels, believed(tag)?, tag.speed_uncertainty, value, of)
    }

    fn local_departure(&self, tag: &Tag, value: f32, of: fn(&LocalPoint) -> ExpectedLevel) -> Option<Departure> {
        levels::departure(&self.config.local_levels, believed(tag)?, tag.speed_uncertainty, value, of)
    }

    /// Puts a value that needs a speed to its limits.
    fn watch_at_speed(&mut self, watched: Watched, tag: &Tag, value: f32, may: Use) {
        if let Some(speed) = believed(tag) {
            self.watch(watched, Some(speed), value, may);
        }
    }

    /// Puts a value of the gear followed, with its own speed in the tag, to the limits of that gear.
    fn watch_gear(&mut self, watched: Watched, tag: &Tag, value: f32, may: Use) {
        if let Some(speed) = believed(tag) {
            let pinion = Hertz(speed.0 / self.round.followed(&self.config).per_pinion_turn);
            self.watch_of(self.round.gear(), watched, Some(pinion), value, may);
        }
    }

    pub(super) fn count_dropped(&mut self, dropped: bool) {
        if dropped {
            self.totals.messages_dropped = self.totals.messages_dropped.saturating_add(1);
        }
    }
}

/// Root mean square about the mean.
fn rms_about_mean(record: &[f32]) -> f32 {
    let mean = mean(record);
    let squares = |run: &[f32]| run.iter().fold(0.0f32, |sum, x| sum + (x - mean) * (x - mean));
    math::sqrt(record.chunks(64).map(squares).sum::<f32>() / record.len().max(1) as f32)
}

/// NA4 of a residual against what is expected of it at this speed: the mean variance of the ensemble is that of the
/// table of levels, made on the sound machine and kept (NA4* in effect). Not a number where nothing is expected.
fn na4(residual: &Moments, departure: Option<Departure>) -> f32 {
    departure.map_or(f32::NAN, |departure| {
        let ratio = math::ratio_from_decibels(departure.departure_db);
        residual.kurtosis * ratio * ratio * ratio * ratio
    })
}

/// A channel's values by its sensitivity.
fn in_units(values: &OfChannel, per_code: Acceleration, passed: Hertz) -> ChannelValues {
    let (codes, per_code) = (&values.codes, per_code.0.abs());
    ChannelValues {
        rms: codes.rms * per_code,
        peak: codes.peak * per_code,
        crest: codes.crest(),
        kurtosis: codes.kurtosis,
        velocity_rms: values.velocity_rms * per_code,
        quality: values.quality,
        mean_code: codes.mean,
        passed_hz: passed.0,
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
