//! The STM32F405's timers and reload stream in concert: when rates change, and whether every block's stamp is true.
//!
//! The drivers program register blocks of plain memory; a model of what RM0090 says about timers and DMA runs on what they
//! wrote.

use meshband_stm32::block_stamp::{self, Borders, Stamp};
use meshband_stm32::filter::FILTERS;
use meshband_stm32::period::{SHORTEST_PERIOD, reload_of};
use meshband_stm32::time_base::{self, Edge};
use meshband_stm32::{BLOCK_SAMPLES, pac, sample_clock};
use meshband_tests::registers::{ARR, CCR2, SMCR, SR, block, planned_periods, set, word};

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
        sample_clock::configure(&tim2, &tim3, period);
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
        loop {
            self.now += self.shadow + 1;
            // Update: the preload register is taken up, and the trigger goes out.
            self.shadow = u64::from(word(&*self.tim2, ARR));
            self.triggers.push(self.now);
            assert_eq!(word(&*self.tim3, SMCR) & 0x77, 0x17, "TIM3 counts TIM2's updates");
            self.counted += 1;
            if self.counted > word(&*self.tim3, ARR) {
                self.counted = 0;
                let status = word(&*self.tim5, SR);
                let over = if status & (1 << 2) != 0 { 1 << 10 } else { 0 };
                set(&*self.tim5, SR, status | (1 << 2) | over);
                set(&*self.tim5, CCR2, self.now as u32);
                let copied = self.ahead.as_mut().map_or(in_memory, |ahead| std::mem::replace(ahead, in_memory));
                set(&*self.tim2, ARR, copied);
                return;
            }
        }
    }

    /// The block interrupt: reads the border and the period behind it, and publishes a wish.
    fn interrupt(&self, borders: &mut Borders, wanted: u32) -> Option<Stamp> {
        let (last, missed) = self.take_border();
        let next = sample_clock::period(&self.tim2);
        assert!(!time_base::border_waits(&self.tim5));
        let stamp = borders.on_border(last, missed, Some(next));
        assert_eq!(borders.publish(wanted), reload_of(borders.published()));
        stamp
    }

    /// Reading the count clears its flag, as hardware does.
    fn take_border(&self) -> (u32, bool) {
        let border = time_base::take_border(&self.tim5);
        set(&*self.tim5, SR, word(&*self.tim5, SR) & !(1 << 2) & if border.1 { !(1 << 10) } else { u32::MAX });
        border
    }
}

#[test]
fn theory_rate_changes_fall_on_block_borders_and_stamps_are_exact() {
    let wanted = planned_periods();
    for reads_ahead in [false, true] {
        let mut timers = Timers::start(wanted[0], reads_ahead);
        let mut borders = Borders::starting(wanted[0]);
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
        let mut borders = Borders::starting(420);
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
    let mut borders = Borders::starting(400);
    assert!(borders.on_border(300_000, false, None).is_some(), "this block's own period is known");
    assert_eq!(borders.on_border(504_800, false, Some(400)), None, "the next one's is not");
    let stamp = borders.on_border(709_600, false, Some(400)).expect("a stamp");
    assert_eq!((stamp.sequence, stamp.period_ticks, stamp.overrun), (2, 400, true));
}

#[test]
fn fault_every_block_of_a_long_silence_is_counted() {
    // The core stands still while a sector is erased; timers and transfers go on.
    for asleep in [1, 2, 3, 10, 977] {
        for (period, reads_ahead) in [(110, false), (420, true), (900, true)] {
            let mut timers = Timers::start(period, reads_ahead);
            let mut borders = Borders::starting(period);
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
        let mut borders = Borders::starting(84);
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
            assert_eq!(block_stamp::is_aligned(counted, remaining), lag <= 2, "{counted} {lag}");
        }
    }
}

#[test]
fn regress_restarted_sampling_leaves_a_gap_and_keeps_the_period_asked_for() {
    let mut borders = Borders::starting(400);
    assert!(borders.on_border(300_000, false, Some(400)).is_some());
    assert_eq!(borders.publish(500), 499);
    borders.restart();
    let stamp = borders.on_border(900_000, false, Some(500)).expect("a stamp");
    assert_eq!((stamp.sequence, stamp.period_ticks, stamp.overrun), (2, 500, true));
}
