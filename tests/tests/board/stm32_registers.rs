//! The STM32F405's drivers, run on register blocks of plain memory: what they program, bit by bit.
//!
//! This stands in for a board: nobody could run one here, and QEMU's STM32F405 has neither PLL nor DMA nor
//! converter. It proves what is written, not what silicon makes of it. Expected values are positions and numbers of
//! the reference manual RM0090, written out here, not names of the register crate.

use meshband_stm32::block_stamp::Captured;
use meshband_stm32::clock::{self, Oscillator, ResetCause};
use meshband_stm32::design_parameters::{self, SHORTEST_PERIOD};
use meshband_stm32::filter::{FILTERS, Filter};
use meshband_stm32::flash::{BrownOut, Sectors};
use meshband_stm32::housekeeping::{Calibration, Housekeeping};
use meshband_stm32::period::reload_of;
use meshband_stm32::time_base::{self, Capture, Edge};
use meshband_stm32::{BLOCK_SAMPLES, adc, dma, flash, pac, pins, sample_clock, uart, watchdog};
use meshband_tests::registers::*;

#[test]
fn theory_every_rate_of_the_plan_is_programmed_as_granted() {
    let periods = planned_periods();
    assert_eq!(periods.len(), 4 * 596);
    for period in periods {
        assert!(period >= SHORTEST_PERIOD, "{period}");
        // The converter's clock is a quarter of the timer's: other periods would be taken up to 36 ns late, by turns.
        assert_eq!(period % 4, 0, "{period} is no whole number of the converter's cycles");
        let (tim2, tim3) = (block::<pac::tim2::RegisterBlock>(), block::<pac::tim3::RegisterBlock>());
        sample_clock::configure(&tim2, &tim3, period, BLOCK_SAMPLES);
        assert_eq!(word(&*tim2, ARR), period - 1);
        assert_eq!(word(&*tim2, PSC), 0);
        // The triggers' rate from the registers alone.
        let rate = f64::from(design_parameters::TIMER_HZ)
            / f64::from(word(&*tim2, PSC) + 1)
            / f64::from(word(&*tim2, ARR) + 1);
        assert!((rate * f64::from(period) / f64::from(design_parameters::TIMER_HZ) - 1.0).abs() < 1e-12);
        // ARPE and URS, upwards, not one-pulse, not started.
        assert_eq!(word(&*tim2, CR1), (1 << 7) | (1 << 2));
        // MMS = 010: update is TRGO.
        assert_eq!(word(&*tim2, CR2), 0b010 << 4);
        assert_eq!(word(&*tim2, SMCR), 0);
        sample_clock::start(&tim2, &tim3);
        assert_eq!(word(&*tim2, CR1) & 1, 1);
        assert_eq!(word(&*tim3, CR1) & 1, 1);
    }
}

#[test]
fn theory_periods_the_converter_cannot_follow_become_the_shortest() {
    // Conversion: 15 + 12 cycles of 84 MHz / 4, in ticks of 84 MHz.
    const { assert!(SHORTEST_PERIOD > 27 * 4 && SHORTEST_PERIOD.is_multiple_of(4)) };
    for period in [0, 1, 107, 109, 112] {
        assert_eq!(reload_of(period), 111);
    }
    assert_eq!(reload_of(113), 112);
    assert_eq!(reload_of(u32::MAX), u32::MAX - 1);
}

#[test]
fn theory_sample_counter_counts_triggers_and_requests_the_reload() {
    let (tim2, tim3) = (block::<pac::tim2::RegisterBlock>(), block::<pac::tim3::RegisterBlock>());
    sample_clock::configure(&tim2, &tim3, 420, BLOCK_SAMPLES);
    // TS = 001 (ITR1 = TIM2), SMS = 111 (external clock mode 1).
    assert_eq!(word(&*tim3, SMCR), (0b001 << 4) | 0b111);
    assert_eq!(word(&*tim3, ARR), u32::from(BLOCK_SAMPLES) - 1);
    assert_eq!(word(&*tim3, PSC), 0);
    assert_eq!(word(&*tim3, CR2), 0b010 << 4);
    // UDE, and no interrupt.
    assert_eq!(word(&*tim3, DIER), 1 << 8);
    assert_eq!(usize::from(BLOCK_SAMPLES), meshband::replay::BLOCK_SAMPLES);

    let dma1 = block::<dma::RegisterBlock>();
    // SAFETY: plain memory, nothing is transferred.
    unsafe { sample_clock::configure_reload(&dma1, 0x2000_1000, 0x4000_002c) };
    let stream = 0x10 + 0x18 * 2;
    let control = word(&*dma1, stream);
    assert_fields(
        control,
        &[
            (25, 7, 5, "channel 5: TIM3_UP"),
            (16, 3, 3, "highest priority"),
            (13, 3, 2, "memory words"),
            (11, 3, 2, "register words"),
            (9, 3, 0, "neither address moves"),
            (8, 1, 1, "circular"),
            (6, 3, 1, "memory to peripheral"),
        ],
    );
    assert_eq!(control & 0x3f, 1, "enabled, no interrupts");
    assert_eq!(word(&*dma1, stream + 0x04), 1);
    assert_eq!(word(&*dma1, stream + 0x08), 0x4000_002c);
    assert_eq!(word(&*dma1, stream + 0x0c), 0x2000_1000);
    assert_eq!(word(&*dma1, stream + 0x14) & 4, 0, "direct mode");
}

#[test]
fn theory_converter_takes_one_sample_per_trigger_of_tim2() {
    let (adc3, common) = (block::<pac::adc1::RegisterBlock>(), block::<pac::adc_common::RegisterBlock>());
    adc::configure(&common);
    adc::start(&adc3, adc::CHANNEL);
    let control = word(&*adc3, 0x08);
    assert_fields(
        control,
        &[
            (28, 3, 0b01, "EXTEN: rising edge"),
            (24, 0xf, 0b0110, "EXTSEL: TIM2 TRGO"),
            (11, 1, 1, "left-aligned"),
            (9, 1, 1, "requests go on after the last transfer"),
            (8, 1, 1, "DMA"),
            (1, 1, 0, "not continuous"),
            (0, 1, 1, "on"),
        ],
    );
    assert_eq!(control & !0x3f00_0b01, 0, "nothing else");
    assert_eq!(word(&*adc3, 0x04), 1 << 26, "12 bits, no scan, an interrupt for overruns alone");
    assert_eq!(word(&*adc3, 0x10), 0b001 << 3, "channel 1: 15 cycles");
    assert_eq!(word(&*adc3, 0x2c) >> 20, 0, "one conversion");
    assert_eq!(word(&*adc3, 0x34), 1, "of channel 1");
    // The common block begins at CSR; CCR is at 4. ADCPRE = 01: 84 MHz / 4 = 21 MHz, below the limit of 36 MHz.
    // TSVREFE on.
    assert_eq!(word(&*common, 0x04), 1 << 23 | 0b01 << 16);
    let conversion_s = 27.0 / (f64::from(design_parameters::APB2_HZ) / 4.0);
    assert!(1.0 / f64::from(design_parameters::HIGHEST_RATE_HZ) > conversion_s);
    // The second one takes the same trigger on the same clock, another pin.
    let adc2 = block::<pac::adc1::RegisterBlock>();
    adc::start(&adc2, adc::SECOND_CHANNEL);
    assert_eq!(word(&*adc2, 0x08), control);
    assert_eq!((word(&*adc2, 0x10), word(&*adc2, 0x34)), (0b001 << 6, 2), "channel 2: 15 cycles");
}

#[test]
fn theory_second_pulses_are_taken_once_with_the_filters_delay_off() {
    let tim5 = block::<pac::tim5::RegisterBlock>();
    time_base::start(&tim5, Edge::Rising, FILTERS[7]);
    assert_eq!(time_base::take_second_pulse(&tim5), None);
    // CCR4 at 0x40; CC4IF is bit 4, CC4OF bit 12.
    set(&*tim5, 0x40, 5_000);
    set(&*tim5, 0x10, 1 << 12 | 1 << 4);
    assert_eq!(time_base::take_second_pulse(&tim5), Some(4_992), "eight ticks of the filter");
    assert_eq!(
        word(&*tim5, 0x10),
        !(1 << 12) & 0xffff | word(&*tim5, 0x10) & 0xffff_0000,
        "only the over-capture is cleared by hand"
    );
}

#[test]
fn theory_housekeeping_reads_the_reference_and_the_temperature_in_turn() {
    let adc1 = block::<pac::adc1::RegisterBlock>();
    let typical = [1_502, 959, 1_207];
    let mut keeping = Housekeeping::start(&adc1, Calibration::of(typical));
    // EXTEN = 0, SWSTART, right-aligned, no DMA, on.
    assert_eq!(word(&*adc1, 0x08), 1 << 30 | 1);
    assert_eq!(word(&*adc1, 0x04), 0, "no interrupt");
    // SMPR1: channels 16 and 17 at 480 cycles: 22.9 us at 21 MHz, of at least 10 us.
    assert_eq!(word(&*adc1, 0x0c), 7 << 21 | 7 << 18);
    assert_eq!(word(&*adc1, 0x34), 17);
    keeping.follow(&adc1);
    assert_eq!((keeping.supply_v(), word(&*adc1, 0x34)), (None, 17), "a reading under way is waited for");
    set(&*adc1, 0x00, 1 << 1);
    set(&*adc1, 0x4c, 1_652);
    keeping.follow(&adc1);
    assert_eq!(word(&*adc1, 0x34), 16);
    // 3.3 V times 1502 / 1652.
    assert!((keeping.supply_v().expect("read") - 3.0004).abs() < 1e-3);
    assert_eq!(keeping.temperature_c(), None);
    set(&*adc1, 0x4c, 1_320);
    keeping.follow(&adc1);
    assert_eq!(
        (word(&*adc1, 0x34), word(&*adc1, 0x10)),
        (4, 7 << 12),
        "the sensor's bias, with its divider's patience"
    );
    // 1320 codes at 3.0 V are 1200 at 3.3 V.
    let celsius = keeping.temperature_c().expect("read");
    assert!((celsius - (30.0 + 80.0 * (1_200.1 - 959.0) / 248.0)).abs() < 0.2, "{celsius}");
    set(&*adc1, 0x4c, 2_048);
    keeping.follow(&adc1);
    let volts = keeping.sensor_bias_v().expect("read");
    assert!((volts - 1.5).abs() < 0.01 && word(&*adc1, 0x34) == 17, "{volts}");
}

#[test]
fn fault_factory_codes_that_cannot_be_are_replaced_by_typical_ones() {
    let typical = Calibration::of([1_502, 959, 1_207]);
    for spoiled in [[0xffff; 3], [0; 3], [1_502, 1_207, 959], [3_000, 959, 1_207], [1_502, 959, 959]] {
        assert_eq!(Calibration::of(spoiled), typical, "{spoiled:?}");
    }
    assert_ne!(Calibration::of([1_490, 940, 1_190]), typical, "a chip's own are taken");
}

#[test]
fn fault_converter_overrun_is_taken_once() {
    let adc1 = block::<pac::adc1::RegisterBlock>();
    assert!(!adc::take_overrun(&adc1));
    set(&*adc1, 0x00, (1 << 5) | (1 << 4));
    assert!(adc::take_overrun(&adc1));
    // Flags are cleared by zeros: only OVR was written zero.
    assert_eq!(word(&*adc1, 0x00) & 0x3f, 0x1f);
    set(&*adc1, 0x00, 1 << 5);
    adc::stop(&adc1);
    assert_eq!((word(&*adc1, 0x00), word(&*adc1, 0x08)), (0, 0), "off, and no flag left to hold the requests up");
}

#[test]
fn theory_double_buffer_takes_half_words_of_the_converter() {
    let dma2 = block::<dma::RegisterBlock>();
    // SAFETY: plain memory, nothing is transferred.
    unsafe {
        dma::start_double_buffer(&dma2, dma::ADC3_STREAM, 0x4001_224c, [0x2000_4000, 0x2000_4400], BLOCK_SAMPLES);
        dma::start_double_buffer(&dma2, dma::ADC2_STREAM, 0x4001_214c, [0x2000_4200, 0x2000_4600], BLOCK_SAMPLES / 2);
    }
    let control = word(&*dma2, 0x10);
    assert_fields(
        control,
        &[
            (25, 7, 2, "channel 2: ADC3"),
            (18, 1, 1, "double buffer"),
            (19, 1, 0, "first target memory 0"),
            (16, 3, 2, "priority below ADC2's"),
            (13, 3, 1, "half-words to memory"),
            (11, 3, 1, "half-words from the register"),
            (10, 1, 1, "memory address moves"),
            (9, 1, 0, "register address stays"),
            (8, 1, 1, "circular"),
            (6, 3, 0, "peripheral to memory"),
        ],
    );
    assert_eq!(control & 0x3f, (1 << 4) | (1 << 2) | 1, "complete and error interrupts, enabled");
    assert_eq!(word(&*dma2, 0x14), u32::from(BLOCK_SAMPLES));
    assert_eq!(word(&*dma2, 0x18), 0x4001_224c);
    assert_eq!(word(&*dma2, 0x1c), 0x2000_4000);
    assert_eq!(word(&*dma2, 0x20), 0x2000_4400);

    let second = word(&*dma2, 0x58);
    assert_eq!(
        second,
        control & !(7 << 25 | 3 << 16 | 0x3f) | 1 << 25 | 3 << 16 | 1,
        "channel 1, served first, no interrupts of its own"
    );
    assert_eq!(word(&*dma2, 0x5c), u32::from(BLOCK_SAMPLES / 2));
    assert_eq!((word(&*dma2, 0x60), word(&*dma2, 0x64), word(&*dma2, 0x68)), (0x4001_214c, 0x2000_4200, 0x2000_4600));

    let stream = dma2.st(dma::ADC3_STREAM.number);
    assert_eq!(dma::target(stream), dma::Target::Memory0);
    // SAFETY: as above.
    unsafe { dma::exchange(stream, dma::Target::Memory1, 0x2000_4800) };
    assert_eq!((word(&*dma2, 0x1c), word(&*dma2, 0x20)), (0x2000_4000, 0x2000_4800));
    set(&*dma2, 0x10, control | 1 << 19);
    assert_eq!(dma::target(stream), dma::Target::Memory1);
    // SAFETY: as above.
    unsafe { dma::exchange(stream, dma::Target::Memory0, 0x2000_4c00) };
    assert_eq!((word(&*dma2, 0x1c), word(&*dma2, 0x20)), (0x2000_4c00, 0x2000_4800));
}

#[test]
fn theory_stream_flags_are_read_and_cleared_at_their_own_place() {
    for (stream, status, clear, shift) in
        [(0, 0x00, 0x08, 0), (2, 0x00, 0x08, 16), (3, 0x00, 0x08, 22), (5, 0x04, 0x0c, 6), (7, 0x04, 0x0c, 22)]
    {
        let dma = block::<dma::RegisterBlock>();
        set(&*dma, status, 1 << (shift + 5));
        assert_eq!(dma::take_flags(&dma, stream), dma::Flags { complete: true, error: false });
        assert_eq!(word(&*dma, clear), 0x3d << shift);
        set(&*dma, status, 1 << (shift + 3));
        assert_eq!(dma::take_flags(&dma, stream), dma::Flags { complete: false, error: true });
        // Another stream's flags are not ours.
        set(&*dma, status, !(0x3f << shift));
        assert_eq!(dma::take_flags(&dma, stream), dma::Flags::default());
    }
}

#[test]
fn theory_time_base_captures_edges_and_borders() {
    for edge in [Edge::Rising, Edge::Falling] {
        for filter in FILTERS {
            let tim5 = block::<pac::tim5::RegisterBlock>();
            time_base::start(&tim5, edge, filter);
            let expected_ckd = u32::from(filter.clock_division);
            assert_eq!(word(&*tim5, CR1), (expected_ckd << 8) | 1, "free-running upwards");
            assert_eq!(word(&*tim5, PSC), 0);
            assert_eq!(word(&*tim5, ARR), u32::MAX);
            assert_eq!(word(&*tim5, SMCR), 0b001 << 4, "TRC = ITR1 = TIM3, no slave mode");
            // CC1S = 01 (TI1), IC1PSC = 0, IC1F; CC2S = 11 (TRC).
            assert_eq!(word(&*tim5, CCMR1), (0b11 << 8) | (u32::from(filter.code) << 4) | 0b01);
            let polarity = u32::from(edge == Edge::Falling) << 1;
            assert_eq!(word(&*tim5, CCER), (1 << 12) | (1 << 4) | polarity | 1);
            // CC4S = 01 (TI4), IC4F = 3: eight samples of the undivided clock, whatever divider the tach's filter has.
            assert_eq!(word(&*tim5, 0x1c), (3 << 12) | (0b01 << 8));
            assert_eq!(word(&*tim5, DIER), 1 << 1, "interrupt of channel 1 only");
            // Filter clock and count by RM0090's table of IC1F, in ticks.
            let divided = if filter.clock_division == 2 { 4 } else { 1 };
            let ticks = match filter.code {
                3 => 8,
                5 => 2 * 8 * divided,
                7 => 4 * 8 * divided,
                9 => 8 * 8 * divided,
                12 => 16 * 8 * divided,
                15 => 32 * 8 * divided,
                other => panic!("{other} does not take eight samples"),
            };
            assert_eq!(filter.ticks, ticks);
        }
    }
}

#[test]
fn theory_filter_can_change_while_the_time_base_runs() {
    let tim5 = block::<pac::tim5::RegisterBlock>();
    time_base::start(&tim5, Edge::Rising, FILTERS[0]);
    for filter in FILTERS.into_iter().rev() {
        time_base::set_filter(&tim5, filter);
        assert_eq!(word(&*tim5, CR1), (u32::from(filter.clock_division) << 8) | 1, "it goes on counting");
        assert_eq!(word(&*tim5, CCMR1), (0b11 << 8) | (u32::from(filter.code) << 4) | 0b01);
    }
}

#[test]
fn theory_filter_passes_every_pulse_of_a_plan_and_is_the_longest_that_does() {
    // One to 60 pulses per turn at up to 60 Hz, and the default's 100 Hz.
    for pulses in [1u32, 2, 12, 36, 60, 256, 1024] {
        for shaft_hz in [0.5, 1.0, 10.0, 25.0, 60.0, 100.0] {
            let interval = (f64::from(design_parameters::TIMER_HZ) / (shaft_hz * f64::from(pulses))) as u32;
            let filter = Filter::for_interval(interval);
            assert!(filter.ticks * 32 <= interval, "{pulses} pulses at {shaft_hz} Hz");
            let longer = FILTERS.iter().find(|f| f.ticks > filter.ticks);
            assert!(longer.is_none_or(|f| f.ticks * 32 > interval));
        }
    }
    assert_eq!(Filter::for_interval(0), FILTERS[0]);
}

#[test]
fn theory_captured_edge_is_stamped_without_the_filters_delay() {
    let tim5 = block::<pac::tim5::RegisterBlock>();
    let filter = FILTERS[7];
    assert_eq!(time_base::take_edge(&tim5, filter), Capture::default());
    set(&*tim5, SR, 1 << 1);
    set(&*tim5, CCR1, 500);
    let expected = 500u32.wrapping_sub(1024);
    assert_eq!(time_base::take_edge(&tim5, filter), Capture { tick: Some(expected), lost: false });
    set(&*tim5, SR, (1 << 9) | (1 << 1));
    assert!(time_base::take_edge(&tim5, filter).lost);
    assert_eq!(word(&*tim5, SR), !(1 << 9), "only the over-capture flag is cleared");
    set(&*tim5, CCR2, 77);
    set(&*tim5, SR, 1 << 10);
    assert_eq!(time_base::take_border(&tim5), Captured { last_tick: None, missed: true });
    assert_eq!(word(&*tim5, SR), !(1 << 10));
    set(&*tim5, SR, 1 << 2);
    assert_eq!(time_base::take_border(&tim5), Captured { last_tick: Some(77), missed: false });
    set(&*tim5, SR, (1 << 10) | (1 << 2));
    assert_eq!(time_base::take_border(&tim5), Captured { last_tick: Some(77), missed: true });
}

#[test]
fn theory_clocks_run_at_168_mhz_from_either_oscillator() {
    for (crystal_present, divider, source, oscillator) in
        [(true, 4, 1, Oscillator::Crystal), (false, 8, 0, Oscillator::Internal)]
    {
        let (rcc, flash) = (block::<pac::rcc::RegisterBlock>(), block::<pac::flash::RegisterBlock>());
        assert_eq!(clock::start(&rcc, &flash, &mut || follow_clocks(&rcc, crystal_present, true)), Ok(oscillator));
        let pll = word(&*rcc, 0x04);
        let (m, n, p, q) = (pll & 0x3f, pll >> 6 & 0x1ff, 2 * ((pll >> 16 & 3) + 1), pll >> 24 & 0xf);
        assert_eq!((m, pll >> 22 & 1), (divider, source));
        let input = if crystal_present { 8_000_000 } else { 16_000_000 };
        assert_eq!(input / m * n / p, design_parameters::CORE_HZ);
        assert_eq!(input / m * n / q, 48_000_000);
        let configuration = word(&*rcc, 0x08);
        assert_eq!(configuration & 3, 0b10, "PLL taken");
        assert_eq!(configuration >> 4 & 0xf, 0, "AHB by 1");
        assert_eq!(configuration >> 10 & 7, 0b101, "APB1 by 4: 42 MHz, its timers 84 MHz");
        assert_eq!(configuration >> 13 & 7, 0b100, "APB2 by 2: 84 MHz");
        // Five wait states, prefetch, both caches.
        assert_eq!(word(&*flash, 0x00), (0b111 << 8) | 5);
        let control = word(&*rcc, 0x00);
        assert_eq!(control >> 19 & 1, u32::from(crystal_present), "the crystal is watched");
        assert_eq!(control >> 16 & 1, u32::from(crystal_present), "an absent crystal is switched off");
    }
}

#[test]
fn fault_pll_that_does_not_lock_ends_the_wait() {
    let (rcc, flash) = (block::<pac::rcc::RegisterBlock>(), block::<pac::flash::RegisterBlock>());
    assert_eq!(clock::start(&rcc, &flash, &mut || follow_clocks(&rcc, true, false)), Err(clock::PllFault));
    assert_eq!(word(&*rcc, 0x08) & 3, 0, "still the internal oscillator");
}

/// The flags of RCC behind its switches, as RM0090 section 7.3 has them: ready flags follow, the clock in use follows
/// the choice, and what is written to the PLL's settings while it runs is ignored.
fn follow_clocks(rcc: &pac::rcc::RegisterBlock, crystal_present: bool, pll_locks: bool) {
    /// Settings the PLL runs with; reserved words behind the last register serve as the model's memory.
    const LATCH_OFFSET: usize = 0x7c;
    let control = word(rcc, 0x00);
    let mut ready = (control & 1) << 1;
    ready |= if crystal_present { (control >> 16 & 1) << 17 } else { 0 };
    if control & (1 << 24) != 0 {
        if control & (1 << 25) == 0 {
            set(rcc, LATCH_OFFSET, word(rcc, 0x04));
        }
        set(rcc, 0x04, word(rcc, LATCH_OFFSET));
        ready |= if pll_locks { 1 << 25 } else { 0 };
    }
    set(rcc, 0x00, control & !((1 << 1) | (1 << 17) | (1 << 25)) | ready);
    let choice = word(rcc, 0x08) & 3;
    set(rcc, 0x08, word(rcc, 0x08) & !0b1100 | choice << 2);
}

#[test]
fn fault_clocks_start_from_what_the_boot_loader_leaves() {
    for crystal_present in [true, false] {
        let (rcc, flash) = (block::<pac::rcc::RegisterBlock>(), block::<pac::flash::RegisterBlock>());
        // 60 MHz by the PLL from the crystal, as the loader in ROM runs USB, and its own idea of bus dividers.
        let loader = 8 | (240 << 6) | (0b01 << 16) | (1 << 22) | (5 << 24);
        set(&*rcc, 0x00, 0x0303_0083);
        set(&*rcc, 0x04, loader);
        set(&*rcc, 0x7c, loader);
        set(&*rcc, 0x08, 0b1010 | (0b100 << 10));
        let started = clock::start(&rcc, &flash, &mut || follow_clocks(&rcc, crystal_present, true));
        assert!(started.is_ok());
        let pll = word(&*rcc, 0x04);
        assert_eq!((pll >> 6 & 0x1ff, pll >> 16 & 3), (168, 0), "the loader's settings stay: {pll:#010x}");
        assert_eq!(pll & 0x3f, if crystal_present { 4 } else { 8 });
        assert_eq!(word(&*rcc, 0x08) & 0b1111, 0b1010, "the PLL serves");
    }
}

#[test]
fn fault_peripherals_that_the_boot_loader_left_running_are_reset() {
    let rcc = block::<pac::rcc::RegisterBlock>();
    let mut held = [0; 4];
    clock::reset_peripherals(&rcc, &mut || held = [0x10, 0x14, 0x20, 0x24].map(|register| word(&*rcc, register)));
    let [ahb1, ahb2, apb1, apb2] = held;
    // Ports A and C, both DMA controllers, USB FS, timers 2, 3 and 5, USART3, CAN2, I2C1, power, USART1, converters,
    // SPI1.
    assert_eq!(ahb1 & (1 | 1 << 2 | 1 << 21 | 1 << 22), 1 | 1 << 2 | 1 << 21 | 1 << 22);
    assert_eq!(ahb2 >> 7 & 1, 1);
    let used = 1 | 1 << 1 | 1 << 3 | 1 << 18 | 1 << 26 | 1 << 21 | 1 << 28;
    assert_eq!(apb1 & used, used);
    assert_eq!(apb2 & (1 << 4 | 1 << 8 | 1 << 12), 1 << 4 | 1 << 8 | 1 << 12);
    assert_eq!([0x10, 0x14, 0x20, 0x24].map(|register| word(&*rcc, register)), [0; 4], "and let go again");
}

#[test]
fn theory_peripheral_clocks_and_reset_causes() {
    let rcc = block::<pac::rcc::RegisterBlock>();
    clock::enable_peripherals(&rcc);
    assert_eq!(word(&*rcc, 0x30), (1 << 22) | (1 << 21) | (1 << 20) | (1 << 2) | (1 << 1) | 1);
    assert_eq!(word(&*rcc, 0x40), (1 << 14) | (1 << 3) | (1 << 1) | 1);
    assert_eq!(word(&*rcc, 0x44), (1 << 10) | (1 << 9) | (1 << 8) | (1 << 4));
    // The pin's flag (bit 26) accompanies every other cause.
    for (flags, cause) in [
        (1 << 29 | 1 << 26, ResetCause::Watchdog),
        (1 << 28 | 1 << 26, ResetCause::Software),
        (1 << 27 | 1 << 26 | 1 << 25, ResetCause::Power),
        (1 << 26, ResetCause::Pin),
        (1 << 30 | 1 << 26, ResetCause::Other),
    ] {
        set(&*rcc, 0x74, flags);
        assert_eq!(clock::reset_cause(&rcc), cause);
        assert_eq!(word(&*rcc, 0x74) >> 24 & 1, 1, "flags are cleared for the next time");
    }
}

#[test]
fn theory_link_runs_within_a_fifth_of_a_percent_and_by_dma() {
    let usart = block::<pac::usart1::RegisterBlock>();
    uart::start(&usart);
    let divider = word(&*usart, 0x08) & 0xffff;
    let rate = f64::from(design_parameters::APB2_HZ) / f64::from(divider);
    assert!((rate / f64::from(design_parameters::BITS_PER_SECOND) - 1.0).abs() < 0.002, "{rate}");
    // UE, TE, RE; oversampling by 16, 8 bits, no parity, no interrupts.
    assert_eq!(word(&*usart, 0x0c) & 0xffff, (1 << 13) | (1 << 3) | (1 << 2));
    assert_eq!(word(&*usart, 0x14) & 0xffff, (1 << 7) | (1 << 6));

    let dma2 = block::<dma::RegisterBlock>();
    // SAFETY: plain memory, nothing is transferred.
    unsafe { uart::start_reception(&dma2, 0x4001_1004, 0x2000_0400, 1024) };
    let (receive, send) = (0x10 + 0x18 * 5, 0x10 + 0x18 * 7);
    let control = word(&*dma2, receive);
    assert_eq!((control >> 25 & 7, control >> 8 & 1, control >> 6 & 3, control & 0x3f), (4, 1, 0, 1));
    assert_eq!((control >> 9 & 3, control >> 11 & 0xf), (0b10, 0));
    assert_eq!([4, 8, 12].map(|register| word(&*dma2, receive + register)), [1024, 0x4001_1004, 0x2000_0400],);
    for (left, position) in [(1024, 0), (1023, 1), (1, 1023)] {
        set(&*dma2, receive + 4, left);
        assert_eq!(uart::write_position(&dma2, 1024), position);
    }
    assert!(!uart::is_sending(&dma2));
    // SAFETY: as above.
    unsafe { uart::start_sending(&dma2, 0x4001_1004, 0x2000_0800, 300) };
    let control = word(&*dma2, send);
    assert_eq!((control >> 25 & 7, control >> 8 & 1, control >> 6 & 3, control & 0x3f), (4, 0, 1, 1));
    assert_eq!([4, 8, 12].map(|register| word(&*dma2, send + register)), [300, 0x4001_1004, 0x2000_0800]);
    assert!(uart::is_sending(&dma2));
}

#[test]
fn theory_a_shared_lines_characters_and_the_end_of_what_is_sent() {
    let (ue_te_re, m, pce, ps, tcie) = ((1 << 13) | (1 << 3) | (1 << 2), 1 << 12, 1 << 10, 1 << 9, 1 << 6);
    for (character, control, stop) in [
        (uart::Character::Even, m | pce, 0),
        (uart::Character::Odd, m | pce | ps, 0),
        (uart::Character::TwoStop, 0, 0b10 << 12),
        (uart::Character::OneStop, 0, 0),
    ] {
        let usart = block::<pac::usart1::RegisterBlock>();
        uart::start(&usart);
        for rate in [2400, 9600, 19_200, 115_200] {
            uart::set_format(&usart, rate, character);
            let divider = word(&*usart, 0x08) & 0xffff;
            let real = f64::from(design_parameters::APB2_HZ) / f64::from(divider);
            assert!((real / f64::from(rate) - 1.0).abs() < 0.001, "{rate}: {real}");
            assert_eq!(word(&*usart, 0x0c) & 0xffff, ue_te_re | control, "{character:?}");
            assert_eq!(word(&*usart, 0x10) & 0xffff, stop, "{character:?}");
            assert_eq!(word(&*usart, 0x14) & 0xffff, (1 << 7) | (1 << 6), "by DMA as before");
        }
        // The end of what was sent before is forgotten, received bytes are not.
        set(&*usart, 0x00, 0xc0 | 1 << 5);
        uart::forget_end(&usart);
        assert_eq!(word(&*usart, 0x00) & (1 << 6 | 1 << 5), 1 << 5);
        uart::announce_end(&usart);
        assert_eq!(word(&*usart, 0x0c) & tcie, tcie);
        set(&*usart, 0x00, 1 << 7);
        assert!(!uart::take_end(&usart), "still sending");
        assert_eq!(word(&*usart, 0x0c) & tcie, tcie);
        set(&*usart, 0x00, 0xc0);
        assert!(uart::take_end(&usart));
        assert_eq!(word(&*usart, 0x0c) & 0xffff, ue_te_re | control, "once");
    }
}

#[test]
fn theory_pins_of_tach_signal_and_link_and_watchdog() {
    let (port_a, port_b, port_c) = (
        block::<pac::gpioa::RegisterBlock>(),
        block::<pac::gpiob::RegisterBlock>(),
        block::<pac::gpioi::RegisterBlock>(),
    );
    // As reset leaves port A: the debug pins in alternate function.
    set(&*port_a, 0x00, 0xa800_0000);
    pins::configure(&port_a, &port_b, &port_c);
    assert_eq!(
        word(&*port_a, 0x00),
        0xa800_0000
            | (0b10 << 20)
            | (0b10 << 18)
            | (0b01 << 16)
            | (0b11 << 8)
            | (0b10 << 6)
            | (0b11 << 4)
            | (0b11 << 2)
            | 0b10
    );
    assert_eq!(word(&*port_a, 0x18), 1 << (8 + 16), "PA8: others speak on a shared line");
    assert_eq!(word(&*port_a, 0x20), (2 << 12) | 2, "PA0, PA3: TIM5");
    assert_eq!(word(&*port_a, 0x24), (7 << 8) | (7 << 4), "PA9, PA10: USART1");
    assert_eq!(word(&*port_a, 0x0c), (0b01 << 20) | (0b10 << 6) | 0b01);

    let iwdg = block::<pac::iwdg::RegisterBlock>();
    watchdog::start(&iwdg);
    assert_eq!(word(&*iwdg, 0x04) & 7, 6, "by 256");
    let reload = word(&*iwdg, 0x08);
    assert_eq!(reload, 999);
    assert_eq!(word(&*iwdg, 0x00) & 0xffff, 0xaaaa, "fed last");
    // At the oscillator's fast end, 47 kHz, the time-out is still longer than an erasure.
    assert!(f64::from(reload + 1) * 256.0 / 47e3 > 2.0);
}

#[test]
fn theory_flash_erases_only_the_sectors_it_is_given() {
    for sector in 0..4 {
        let controller = block::<pac::flash::RegisterBlock>();
        set(&*controller, 0x10, 1 << 31);
        let outcome = flash::erase(&controller, Sectors::CONFIGURATION, sector);
        if sector < 2 {
            assert_eq!(outcome, Ok(()));
            assert_eq!(word(&*controller, 0x04), 0xcdef_89ab, "second key last");
            assert_eq!(word(&*controller, 0x10), 1 << 31, "locked again");
        } else {
            assert_eq!(outcome, Err(flash::FlashFault::Range));
            assert_eq!(word(&*controller, 0x04), 0, "not even unlocked");
        }
    }
    // Caches are on behind an erasure, neither held in reset.
    let controller = block::<pac::flash::RegisterBlock>();
    set(&*controller, 0x00, (0b11 << 11) | 5);
    flash::erase(&controller, Sectors::CONFIGURATION, 0).unwrap();
    assert_eq!(word(&*controller, 0x00), (0b11 << 9) | 5, "emptied and on, wait states as before");
    for (option, level) in [(0, BrownOut::Level3), (1, BrownOut::Level2), (2, BrownOut::Level1), (3, BrownOut::Off)] {
        set(&*controller, 0x14, 0x0fff_aae1 | option << 2);
        assert_eq!(flash::brown_out(&controller), level);
    }
    // Addresses of RM0090, table 5.
    let places = [
        (Sectors::SLOT_A, 5, 0x0802_0000),
        (Sectors::SLOT_B, 7, 0x0806_0000),
        (Sectors::CONFIGURATION, 10, 0x080c_0000),
    ];
    for (sectors, first, start) in places {
        assert_eq!((sectors.start(), sectors.bytes()), (start, 0x4_0000));
        for number in 0..2 {
            let controller = block::<pac::flash::RegisterBlock>();
            flash::select(&controller, sectors, number).unwrap();
            // Words, the sector's number, sector erase; neither locked nor started.
            assert_eq!(word(&*controller, 0x10), (0b10 << 8) | ((first + u32::from(number)) << 3) | 2);
        }
    }
    let controller = block::<pac::flash::RegisterBlock>();
    flash::begin_write(&controller).unwrap();
    assert_eq!(word(&*controller, 0x10), (0b10 << 8) | 1, "words, programming");
    set(&*controller, 0x0c, 1 << 4);
    assert_eq!(flash::settle(&controller), Err(flash::FlashFault::Refused));
}
