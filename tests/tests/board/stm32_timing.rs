//! The STM32F405's timers and reload stream in concert: when rates change, and whether every block's stamp is true.
//!
//! The drivers program register blocks of plain memory; a model of what RM0090 says about timers and DMA runs on what
//! they wrote.

use meshband::board::Due;
use meshband_stm32::block_stamp::{self, Borders, Captured, Stamp};
use meshband_stm32::design_parameters::{CONVERSION_TICKS, SHORTEST_PERIOD};
use meshband_stm32::filter::{FILTERS, Filter};
use meshband_stm32::period::reload_of;
use meshband_stm32::time_base::{self, Edge};
use meshband_stm32::{BLOCK_SAMPLES, pac, sample_clock};
use meshband_tests::registers::{ARR, CCR1, CCR2, CNT, SMCR, SR, block, planned_periods, set, word};

/// The three timers and the reload stream as RM0090 describes them, driven by what the drivers wrote.
///
/// The stream reads one word ahead in direct mode, says the manual; the drivers must be right either way.
struct Timers {
    /// The word read ahead, where the stream does so.
    ahead: Option<u32>,
    tim2: Box<pac::tim2::RegisterBlock>,
    tim3: Box<pac::tim3::RegisterBlock>,
    tim5: Box<pac::tim5::RegisterBlock>,
    /// TIM2's reload in force, behind the preload register.
    shadow: u64,
    now: u64,
    counted: u32,
    triggers: Vec<u64>,
}

impl Timers {
    fn start(period: u32, reads_ahead: bool) -> Self {
        let (tim2, tim3) = (block::<pac::tim2::RegisterBlock>(), block::<pac::tim3::RegisterBlock>());
        let tim5 = block::<pac::tim5::RegisterBlock>();
        sample_clock::configure(&tim2, &tim3, period, BLOCK_SAMPLES);
        time_base::start(&tim5, Edge::Rising, FILTERS[0]);
        sample_clock::start(&tim2, &tim3);
        let shadow = u64::from(word(&*tim2, ARR));
        // Near the wrap of the 32-bit counter, on purpose.
        let now = u64::from(u32::MAX) - 300_000;
        let ahead = reads_ahead.then(|| reload_of(period));
        Self { ahead, tim2, tim3, tim5, shadow, now, counted: 0, triggers: Vec::new() }
    }

    /// Runs to the end of a block; DMA then copies the word in memory, or the one it read ahead.
    fn run_block(&mut self, in_memory: u32) {
        while !self.trigger() {}
        self.reload(in_memory);
    }

    /// When the next trigger comes.
    fn next_trigger(&self) -> u64 {
        self.now + self.shadow + 1
    }

    /// Runs to the next trigger; true if it is a block's last, whose instant TIM5 then captures.
    fn trigger(&mut self) -> bool {
        self.now = self.next_trigger();
        // Update: the preload register is taken up, and the trigger goes out.
        self.shadow = u64::from(word(&*self.tim2, ARR));
        self.triggers.push(self.now);
        assert_eq!(word(&*self.tim3, SMCR) & 0x77, 0x17, "TIM3 counts TIM2's updates");
        self.counted += 1;
        if self.counted <= word(&*self.tim3, ARR) {
            return false;
        }
        self.counted = 0;
        let status = word(&*self.tim5, SR);
        let over = if status & (1 << 2) != 0 { 1 << 10 } else { 0 };
        set(&*self.tim5, SR, status | (1 << 2) | over);
        set(&*self.tim5, CCR2, self.now as u32);
        true
    }

    /// DMA's answer to TIM3's update.
    fn reload(&mut self, in_memory: u32) {
        let copied = self.ahead.as_mut().map_or(in_memory, |ahead| std::mem::replace(ahead, in_memory));
        set(&*self.tim2, ARR, copied);
    }

    /// The block interrupt: reads the border and the period behind it, and publishes a wish.
    fn interrupt(&self, borders: &mut Borders, wanted: u32) -> Option<Stamp> {
        let border = self.take_border();
        let next = sample_clock::period(&self.tim2);
        assert!(!time_base::border_waits(&self.tim5));
        let stamp = borders.on_border(border, Some(next));
        assert_eq!(borders.publish(wanted), reload_of(borders.published()));
        stamp
    }

    /// Reading the count clears its flag, as hardware does.
    fn take_border(&self) -> Captured {
        let status = word(&*self.tim5, SR);
        let border = time_base::take_border(&self.tim5);
        let read = if border.last_tick.is_some() { 1 << 2 } else { 0 };
        set(&*self.tim5, SR, status & !read & if border.missed { !(1 << 10) } else { u32::MAX });
        border
    }
}

/// A border captured in time.
fn at(last_tick: u32) -> Captured {
    Captured { last_tick: Some(last_tick), missed: false }
}

/// The timers with what comes behind a border: the reload by DMA, the last conversion, the transfer's interrupt.
struct Late {
    timers: Timers,
    borders: Borders,
    /// Word in memory for the DMA.
    published: u32,
    reload_at: Option<u64>,
    complete_at: Option<u64>,
    /// Transfer-complete flag, and blocks converted so far.
    flag: bool,
    complete: u32,
}

impl Late {
    /// From TIM3's update to the word in TIM2, ticks: an assumption, no less than the bus takes.
    const RELOAD: u64 = 20;

    fn start(period: u32, reads_ahead: bool) -> Self {
        let (timers, borders) = (Timers::start(period, reads_ahead), Borders::starting(period, BLOCK_SAMPLES));
        let published = reload_of(borders.published());
        Self { timers, borders, published, reload_at: None, complete_at: None, flag: false, complete: 0 }
    }

    /// Everything that happens up to an instant.
    fn advance(&mut self, until: u64) {
        loop {
            let (trigger, never) = (self.timers.next_trigger(), u64::MAX);
            let (reload, complete) = (self.reload_at.unwrap_or(never), self.complete_at.unwrap_or(never));
            if trigger.min(reload).min(complete) > until {
                return;
            } else if reload <= trigger.min(complete) {
                self.reload_at = None;
                self.timers.reload(self.published);
            } else if complete <= trigger {
                self.complete_at = None;
                (self.flag, self.complete) = (true, self.complete + 1);
            } else if self.timers.trigger() {
                self.reload_at = Some(trigger + Self::RELOAD);
                self.complete_at = Some(trigger + u64::from(CONVERSION_TICKS));
            }
        }
    }

    /// The interrupt, `reading` ticks of which pass between the transfer's flag and the border's; gives the stamp and
    /// the number of the block in the buffer that it belongs to.
    fn interrupt(&mut self, now: u64, reading: u64, wanted: u32) -> Option<(Stamp, u32)> {
        self.advance(now);
        assert!(std::mem::take(&mut self.flag), "an interrupt has a cause");
        let complete = self.complete - 1;
        self.advance(now + reading);
        let border = self.timers.take_border();
        let next = sample_clock::period(&self.timers.tim2);
        let next = (!time_base::border_waits(&self.timers.tim5)).then_some(next);
        let stamp = self.borders.on_border(border, next);
        self.published = self.borders.publish(wanted);
        Some((stamp?, complete))
    }

    /// Runs until the next block is complete, and gives the instant.
    fn wait(&mut self) -> u64 {
        while !self.flag {
            let next = [Some(self.timers.next_trigger()), self.reload_at, self.complete_at];
            self.advance(next.into_iter().flatten().min().unwrap_or_default());
        }
        self.timers.now
    }
}

#[test]
fn fault_an_interrupt_late_by_any_time_counts_every_border_once() {
    let samples = usize::from(BLOCK_SAMPLES);
    for (period, reads_ahead, reading) in [(420u32, false, 0), (420, true, 9), (112, true, 0), (112, false, 9)] {
        let length = u64::from(period) * samples as u64;
        // Coarsely over two blocks and a half, tick by tick round the borders.
        let fine = [length, 2 * length].into_iter().flat_map(|border| border - 300..border + 300);
        for delay in (0..length * 5 / 2).step_by(1_777).chain(fine) {
            let mut late = Late::start(period, reads_ahead);
            let mut seen = vec![];
            for block in 0..9u64 {
                late.wait();
                let ready = late.timers.now.max(late.timers.triggers.last().copied().unwrap_or(0) + 130);
                let now = ready + if block == 2 { delay } else { 0 };
                // Rates change all the time, but where several borders pass unnoticed: these can only be counted at
                // one rate.
                let wanted = if delay < 2 * length { period + 84 * (block as u32 % 3) } else { period };
                seen.extend(late.interrupt(now, reading, wanted));
            }
            for (stamp, complete) in &seen {
                let first = late.timers.triggers[stamp.sequence as usize * samples];
                let apart = late.timers.triggers[stamp.sequence as usize * samples + 1] - first;
                let told = (stamp.sequence, stamp.first_tick, u64::from(stamp.period_ticks));
                assert_eq!(told, (*complete, first as u32, apart), "late by {delay}, {period}, ahead: {reads_ahead}");
            }
            assert!(seen.len() >= 5, "late by {delay}: {} blocks", seen.len());
        }
    }
}

#[test]
fn theory_rate_changes_fall_on_block_borders_and_stamps_are_exact() {
    let wanted = planned_periods();
    for reads_ahead in [false, true] {
        let mut timers = Timers::start(wanted[0], reads_ahead);
        let mut borders = Borders::starting(wanted[0], BLOCK_SAMPLES);
        let samples = usize::from(BLOCK_SAMPLES);
        let mut expected_first = None;
        let mut changes = 0;
        let mut served = Vec::new();
        for (index, &period) in wanted.iter().step_by(3).enumerate() {
            timers.run_block(reload_of(borders.published()));
            let stamp = timers.interrupt(&mut borders, period).expect("no border was missed");
            assert_eq!((stamp.sequence, stamp.overrun), (index as u32, false));
            let triggers = &timers.triggers[index * samples..];
            assert_eq!(triggers.len(), samples);
            // Every sample of the block where its stamp says, to the tick.
            for (sample, &trigger) in triggers.iter().enumerate() {
                let stamped = stamp.first_tick.wrapping_add(stamp.period_ticks * sample as u32);
                assert_eq!(trigger as u32, stamped, "block {index}, sample {sample}, ahead: {reads_ahead}");
            }
            // And the block where its predecessor ends.
            assert!(expected_first.is_none_or(|first| first == stamp.first_tick));
            expected_first = Some(stamp.first_tick.wrapping_add(stamp.period_ticks * BLOCK_SAMPLES as u32));
            changes += usize::from(served.last().is_some_and(|&before| before != stamp.period_ticks));
            served.push(stamp.period_ticks);
        }
        assert!(changes > 100, "{changes} changes of rate");
        // Every wish is served, two blocks after the one it was made in, or three.
        let asked: Vec<u32> = wanted.iter().step_by(3).copied().collect();
        let delay = if reads_ahead { 3 } else { 2 };
        assert_eq!(served[delay..], asked[..asked.len() - delay], "ahead: {reads_ahead}");
    }
}

#[test]
fn fault_after_a_missed_border_one_block_is_given_up_and_the_next_stamps_are_right() {
    for reads_ahead in [false, true] {
        let mut timers = Timers::start(420, reads_ahead);
        let mut borders = Borders::starting(420, BLOCK_SAMPLES);
        let ends = |timers: &mut Timers, borders: &mut Borders, wanted| {
            timers.run_block(reload_of(borders.published()));
            timers.interrupt(borders, wanted)
        };
        assert_eq!(ends(&mut timers, &mut borders, 500).expect("a stamp").period_ticks, 420);
        // The interrupt sleeps through the border behind the second block; whose period the third has nobody read.
        timers.run_block(reload_of(borders.published()));
        assert_eq!(ends(&mut timers, &mut borders, 600), None);
        for (sequence, overrun) in [(3, true), (4, false), (5, false), (6, false)] {
            let stamp = ends(&mut timers, &mut borders, 600).expect("a stamp");
            let triggers = &timers.triggers[sequence as usize * usize::from(BLOCK_SAMPLES)..];
            let period = (triggers[1] - triggers[0]) as u32;
            let expected = Stamp { first_tick: triggers[0] as u32, period_ticks: period, sequence, overrun };
            assert_eq!(stamp, expected, "ahead: {reads_ahead}");
        }
        assert_eq!(ends(&mut timers, &mut borders, 600).expect("a stamp").period_ticks, 600);
    }
}

#[test]
fn fault_period_read_too_late_costs_a_block_and_no_wrong_stamp() {
    let mut borders = Borders::starting(400, BLOCK_SAMPLES);
    assert!(borders.on_border(at(300_000), None).is_some(), "this block's own period is known");
    assert_eq!(borders.on_border(at(504_800), Some(400)), None, "the next one's is not");
    let stamp = borders.on_border(at(709_600), Some(400)).expect("a stamp");
    assert_eq!((stamp.sequence, stamp.period_ticks, stamp.overrun), (2, 400, true));
}

#[test]
fn fault_every_block_of_a_long_silence_is_counted() {
    // The core stands still while a sector is erased; timers and transfers go on.
    for asleep in [1, 2, 3, 10, 977] {
        for (period, reads_ahead) in [(112, false), (420, true), (900, true)] {
            let mut timers = Timers::start(period, reads_ahead);
            let mut borders = Borders::starting(period, BLOCK_SAMPLES);
            timers.run_block(reload_of(borders.published()));
            assert!(timers.interrupt(&mut borders, period).is_some());
            (0..=asleep).for_each(|_| timers.run_block(reload_of(borders.published())));
            assert_eq!(timers.interrupt(&mut borders, period), None);
            timers.run_block(reload_of(borders.published()));
            let stamp = timers.interrupt(&mut borders, period).expect("a stamp");
            let first = timers.triggers[(2 + asleep) * usize::from(BLOCK_SAMPLES)];
            assert_eq!((stamp.sequence, stamp.first_tick), (2 + asleep as u32, first as u32), "{asleep} {period}");
        }
    }
}

#[test]
fn fault_period_the_converter_cannot_follow_is_stamped_as_it_is_served() {
    // A configuration may ask for 1 MHz; the timer then runs at the converter's fastest, and the stamps say so.
    for reads_ahead in [false, true] {
        let mut timers = Timers::start(84, reads_ahead);
        let mut borders = Borders::starting(84, BLOCK_SAMPLES);
        for index in 0..4 {
            timers.run_block(reload_of(borders.published()));
            let stamp = timers.interrupt(&mut borders, 84).expect("a stamp");
            assert_eq!((stamp.period_ticks, stamp.overrun), (SHORTEST_PERIOD, false), "block {index}");
            assert_eq!(stamp.first_tick, timers.triggers[index * usize::from(BLOCK_SAMPLES)] as u32, "block {index}");
        }
    }
}

#[test]
fn fault_samples_shifted_against_their_count_are_seen() {
    let samples = BLOCK_SAMPLES;
    for counted in 0..samples {
        for lag in 0..samples {
            // Transfers behind the triggers by `lag`; the stream counts down from a block's length.
            let transferred = (counted + samples - lag) % samples;
            let remaining = samples - transferred;
            assert_eq!(block_stamp::is_aligned(counted, remaining, samples), lag <= 2, "{counted} {lag}");
        }
    }
}

#[test]
fn regress_restarted_sampling_leaves_a_gap_and_keeps_the_period_asked_for() {
    let mut borders = Borders::starting(400, BLOCK_SAMPLES);
    assert!(borders.on_border(at(300_000), Some(400)).is_some());
    assert_eq!(borders.publish(500), 499);
    borders.restart(BLOCK_SAMPLES);
    let stamp = borders.on_border(at(900_000), Some(500)).expect("a stamp");
    assert_eq!((stamp.sequence, stamp.period_ticks, stamp.overrun), (2, 500, true));
}

/// Edges and blocks as the main loop hands them over when it looks at `turns`: `None` is the block that ends at `end`.
///
/// The edge is captured when it has passed the filter, the block is complete when its last sample is converted; both
/// are in their queues a handler's length later.
fn handed_over(edge: u32, end: u32, filter: Filter, turns: impl Iterator<Item = u32>) -> Vec<Option<u32>> {
    const HANDLER: u32 = 40;
    let tim5 = block::<pac::tim5::RegisterBlock>();
    let queued_at = edge.wrapping_add(filter.ticks + HANDLER);
    let complete_at = end.wrapping_add(CONVERSION_TICKS + HANDLER);
    let (mut edges, mut blocks, mut order) = (vec![], vec![], vec![]);
    let (mut edge_came, mut block_came) = (false, false);
    let reached = |now: u32, instant: u32| now.wrapping_sub(instant) as i32 >= 0;
    for now in turns {
        if !edge_came && reached(now, queued_at) {
            set(&*tim5, SR, 1 << 1);
            set(&*tim5, CCR1, edge.wrapping_add(filter.ticks));
            edges.extend(time_base::take_edge(&tim5, filter).tick);
            edge_came = true;
        }
        if !block_came && reached(now, complete_at) {
            blocks.push(end);
            block_came = true;
        }
        set(&*tim5, CNT, now);
        let due = Due::of(time_base::horizon(&tim5), blocks.first().copied());
        let before = |edge: &u32| (edge.wrapping_sub(due.edges_before) as i32) < 0;
        order.extend(edges.pop_if(|edge| before(edge)).map(Some));
        if due.block {
            order.extend(blocks.pop().map(|_| None));
        }
    }
    order
}

#[test]
fn fault_edges_at_every_offset_to_a_blocks_end_are_handed_over_in_the_order_of_time() {
    // The block ends shortly before the counter wraps, so that edges and turns lie on both sides.
    let end = u32::MAX - 500;
    for filter in FILTERS {
        for offset in -1_300..=1_300i32 {
            let edge = end.wrapping_add_signed(offset);
            let expected = if offset < 0 { [Some(edge), None] } else { [None, Some(edge)] };
            // A loop that idles, one that is busy, and first looks at every place relative to the interrupts.
            for (first, step) in [(0, 7), (3, 150), (91, 150), (40, 1_000), (700, 1_000), (0, 5_000), (1_250, 5_000)] {
                let turns = (0..).map(|n| end.wrapping_sub(1_400).wrapping_add(first + n * step));
                let count = (8_000 / step + 3) as usize;
                let order = handed_over(edge, end, filter, turns.take(count));
                assert_eq!(order, expected, "edge {offset} ticks from the end, {filter:?}, turns {first} + n {step}");
            }
        }
    }
}

#[test]
fn theory_an_edge_never_waits_longer_than_the_longest_filter_and_a_margin() {
    let tim5 = block::<pac::tim5::RegisterBlock>();
    set(&*tim5, CNT, 100);
    let waits = 100u32.wrapping_sub(time_base::horizon(&tim5));
    assert!(FILTERS.iter().all(|filter| filter.ticks < waits));
    // 20 us of the 1 ms that a block takes at the highest rate.
    assert!(waits < 84 * 20, "{waits}");
}

#[test]
fn theory_a_block_waits_for_the_horizon_across_the_wrap_of_the_counter() {
    for end in [0u32, 5, 0x7fff_ffff, 0x8000_0000, u32::MAX] {
        assert_eq!(Due::of(end, Some(end)), Due { edges_before: end, block: true });
        assert_eq!(Due::of(end.wrapping_add(70_000), Some(end)), Due { edges_before: end, block: true });
        let early = end.wrapping_sub(1);
        assert_eq!(Due::of(early, Some(end)), Due { edges_before: early, block: false });
        assert_eq!(Due::of(end, None), Due { edges_before: end, block: false });
    }
}
