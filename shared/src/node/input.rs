//! Blocks come in: continuity of the sample grid, the period they were taken with, and what the filters make of them.

use super::{
    Block, HOLD_AFTER_TURN, NO_RECORDS_S, NO_RECORDS_TURNS, Node, RISE_INTERVAL_S, State, WIDE_PER_SECOND, WideUse,
};
use crate::bandwidth_watch::BandwidthWatch;
use crate::buffers::{Arrays, Buffers};
use crate::events::EventKind;
use crate::mesh_band;
use crate::stream::WIDE_POINTS;
use crate::tach::Validity;
use crate::waveform::CaptureEnd;

impl<A: Arrays> Node<A> {
    /// Sequence, time and overrun: anything that breaks the sample grid restarts the records.
    pub(super) fn check_continuity(&mut self, block: &Block<'_>, first: u64, period: u32) {
        let mut broken = block.overrun;
        if block.overrun {
            self.note(EventKind::Overrun, block.sequence);
        }
        let lost = self.next_sequence.map_or(0, |expected| block.sequence.wrapping_sub(expected));
        if lost != 0 {
            self.totals.blocks_lost = self.totals.blocks_lost.saturating_add(lost);
            self.note(EventKind::BlocksLost, lost);
            broken = true;
        } else if self.next_sequence.is_some() && first.abs_diff(self.next_tick) > u64::from(period) {
            self.note(EventKind::TimeJump, first.wrapping_sub(self.next_tick) as u32);
            broken = true;
        }
        let fresh = self.next_sequence.is_none();
        self.next_sequence = Some(block.sequence.wrapping_add(1));
        self.next_tick = first + u64::from(period) * block.codes.len() as u64;
        if broken {
            self.values.note_gap(first);
            self.break_capture(CaptureEnd::SamplesLost);
            // The wideband record's search is the longest turn there is: begun at every gap it would cause the next
            // one. One that was cut short has not cost it yet.
            let due = if self.wide_use == WideUse::Record { first } else { self.wide_due };
            self.restart_stream(first);
            self.wide_due = due;
        } else if !self.stream.is_started() {
            self.stream.set_origin(first);
        }
        if fresh {
            self.break_capture(CaptureEnd::Commanded);
            self.values.restart(first);
            self.watch.expect_from(first);
        }
    }

    /// Blocks carry the period they were sampled with; the plan that belongs to it becomes active.
    pub(super) fn follow_period(&mut self, period: u32, first: u64, sequence: u32) {
        let wanted = if period == self.pending.period_ticks {
            self.pending
        } else if period == self.active.period_ticks {
            return;
        } else {
            self.note(EventKind::UnexpectedPeriod, period);
            self.plan.describe(self.pending.requested, period, self.pending.stages, true)
        };
        if wanted == self.active {
            return;
        }
        let same_chain = wanted.period_ticks == self.active.period_ticks && wanted.stages == self.active.stages;
        self.active = wanted;
        if !same_chain {
            self.note(EventKind::RateChanged, period);
            self.break_capture(CaptureEnd::RateChanged);
            self.restart_stream(first);
            self.post_status(sequence);
        }
    }

    pub(super) fn restart_stream(&mut self, first: u64) {
        self.stream.stop();
        self.restart_mesh(first);
        // A record that is complete is of one stream, whatever becomes of it.
        if !matches!(self.wide_use, WideUse::Analysis(_)) {
            self.wide_use = WideUse::Idle;
        }
        self.wide_due = first;
        if matches!(self.state, State::Settling | State::Measuring) {
            self.state = State::Settling;
        }
    }

    /// Notes clipped codes and an input that does not move, whose detail gets `mark`; true where any is clipped.
    pub(super) fn watch_input(&mut self, codes: &[u16], mark: u32) -> bool {
        // One pass without branches.
        let Some(&first) = codes.first() else { return false };
        let range = self.config.range.in_force();
        let (mut railed, mut moved) = (0usize, 0u16);
        for &code in codes {
            railed += usize::from(range.is_beyond(code));
            moved |= code ^ first;
        }
        if railed * 1000 > codes.len() {
            let hundreds = (railed * 1000 / codes.len()) as u32 / 100;
            self.note(EventKind::Saturated, (hundreds * 100) | mark);
        }
        if codes.len() >= 64 && moved == 0 {
            self.note(EventKind::Stuck, u32::from(first) | mark);
        }
        railed > 0
    }

    /// All codes of both sensors into the overall values, cut at the turns.
    pub(super) fn follow_values(&mut self, codes: [&[u16]; 2], first: u64, period: u32) {
        let locked = self.tach_locked;
        self.values.follow_speed(self.present_speed().pinion.0, period);
        let mut complete = None;
        self.values.push(codes, first, period, locked, |values| complete = Some(values));
        if let Some(values) = complete {
            self.finish_values(&values);
        }
    }

    /// Begins what the wideband path is due for.
    pub(super) fn start_wide(&mut self, first: u64) {
        if self.state == State::Measuring && first >= self.rise_due && self.signal_rms > 0.0 {
            self.rise_due = first + RISE_INTERVAL_S * u64::from(self.clock.0);
            let speed = self.present_speed();
            let law_hz = self.config.law.bandwidth(speed.pinion).bandwidth.0;
            // Below the law's domain there is nothing to compare with, and a tooth pitch lasts without end as the
            // shaft comes to rest.
            let within = speed.pinion.0 >= self.config.law.lowest.0;
            let stages = BandwidthWatch::stages(self.active.adc.0, law_hz).filter(|_| within);
            if let (Some(stages), Validity::Locked, false) = (stages, speed.validity, self.active.aliasing) {
                let rate = self.active.adc.0 / (1u32 << stages) as f32;
                let mesh_hz = f32::from(self.config.gears.pinion_teeth) * speed.pinion.0;
                self.bandwidth_watch.begin(rate, law_hz, mesh_hz, self.signal_rms);
                self.stream.start_wide(first, stages);
                self.rise_from = first;
                self.wide_use = WideUse::Edges;
                return;
            }
        }
        if first >= self.wide_due || (self.snapshot_wanted && self.snapshot_sent.is_none()) {
            self.wide_due = first + u64::from(self.clock.0 / WIDE_PER_SECOND);
            self.stream.start_wide(first, self.active.stages);
            self.wide_use = WideUse::Record;
            self.wide_count = 0;
        }
    }

    /// Filters at most [`CHUNK`] codes and takes what comes out.
    pub(super) fn take_chunk(&mut self, codes: &[u16]) {
        let sensor = self.sensor();
        let Buffers { chain, wide: record, .. } = self.arrays.buffers_mut();
        let (wide_use, watch) = (self.wide_use, &mut self.bandwidth_watch);
        let (count, from) = (&mut self.wide_count, &mut self.wide_tick);
        let mut complete = false;
        let take_wide = |samples: &[f32], tick: u64| match wide_use {
            WideUse::Idle | WideUse::Analysis(_) => {}
            WideUse::Edges => complete = watch.push(samples),
            WideUse::Record => {
                if *count == 0 {
                    *from = tick;
                }
                let taken = samples.len().min(WIDE_POINTS.saturating_sub(*count));
                for (place, sample) in record.iter_mut().skip(*count).zip(samples) {
                    *place = *sample;
                }
                *count += taken;
                complete = *count == WIDE_POINTS;
            }
        };
        let take_mesh = |samples: &[f32], tick: u64, period: u32| chain.push_samples(samples, tick as u32, period);
        self.stream.push(codes, &sensor, take_wide, take_mesh);
        if complete {
            self.stream.stop_wide();
            match core::mem::replace(&mut self.wide_use, WideUse::Idle) {
                WideUse::Record => self.begin_analysis(),
                _ => self.finish_edges(),
            }
        }
    }

    /// A node that measures and completes nothing says so, and is back at settling until a record comes: pulses at
    /// places of no wheel, or a speed that changes faster than a record can follow.
    pub(super) fn watch_records(&mut self) {
        // Of a train the round looks after it.
        if self.state != State::Measuring || !self.tach_locked || !self.config.train.is_empty() {
            return;
        }
        let followed = self.round.followed(&self.config);
        let turns = NO_RECORDS_TURNS * f32::from(mesh_band::record_turns(followed.teeth));
        let patience = NO_RECORDS_S.max(turns / followed.rate(self.present_speed().pinion).0.max(0.01));
        let since = self.next_tick.saturating_sub(self.records_since);
        if since as f32 > patience * self.clock.0 as f32 {
            self.note(EventKind::NoRecords, self.clock.seconds(since) as u32);
            self.records_since = self.next_tick;
            (self.no_records, self.state) = (true, State::Settling);
        }
    }

    /// Resamples complete turns and takes what they complete.
    pub(super) fn follow_turns(&mut self) {
        let chain = &mut self.arrays.buffers_mut().chain;
        let progress = chain.process();
        if progress.turns > 0 {
            self.hold = self.hold.max(HOLD_AFTER_TURN);
        }
        if progress.records > 0 {
            self.records_since = self.next_tick;
            if core::mem::take(&mut self.no_records) && self.stream.is_settled() {
                self.state = State::Measuring;
            }
            self.finish_mesh();
        }
        let followed = self.round.followed(&self.config);
        let wanted = mesh_band::average_turns(followed.teeth, followed.mate_teeth).0;
        // Of a train the record comes first: what the average says of sidebands is that record's.
        let may_finish = self.config.train.is_empty() || self.round.has_bands();
        if may_finish && self.arrays.buffers_mut().chain.average().turns() >= wanted {
            self.finish_average();
        }
    }
}
