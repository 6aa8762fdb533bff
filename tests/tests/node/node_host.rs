//! The node on the host, fed with synthetic pulses and codes of known content.

use meshband::config::{Configuration, Gain};
use meshband::frame::Packet;
use meshband::message::{Message, Peaks, Request, Spectrum, Status};
use meshband::node::{Block, Node, State};
use meshband::rate_plan::RatePolicy;
use meshband::tach::Validity;
use meshband::units::{Acceleration, Hertz, TicksPerSecond};
use meshband_tests::plant::{self, Fault, Plant};

const BLOCK: usize = 1024;
const M_S2_PER_CODE: f32 = 0.01;

struct Rig {
    node: Node,
    clock: f64,
    time_ticks: u64,
    sequence: u32,
    next_turn: f64,
    period: u32,
}

/// What the node said.
#[derive(Default)]
struct Heard {
    spectra: Vec<Spectrum>,
    peaks: Vec<Peaks>,
    status: Vec<Status>,
    snapshot: Vec<f64>,
}

impl Rig {
    fn new(config: Configuration, clock: u32) -> Self {
        let node = Node::new(config, TicksPerSecond(clock)).expect("valid configuration");
        let period = node.requested_period_ticks();
        Self { node, clock: f64::from(clock), time_ticks: 1_000, sequence: 0, next_turn: 0.0, period }
    }

    /// Runs until `seconds`; `turns(t)` is the shaft angle, `signal(t, turns)` the acceleration.
    fn run(&mut self, seconds: f64, turns: impl Fn(f64) -> f64, signal: impl Fn(f64, f64) -> f64, heard: &mut Heard) {
        let mut codes = vec![0u16; BLOCK];
        while (self.time_ticks as f64) < seconds * self.clock {
            let first = self.time_ticks;
            for (n, code) in codes.iter_mut().enumerate() {
                let t = (first + n as u64 * u64::from(self.period)) as f64 / self.clock;
                let value = signal(t, turns(t)) / f64::from(M_S2_PER_CODE);
                *code = (value.round() + 32_768.0).clamp(0.0, 65_535.0) as u16;
            }
            let end = first + BLOCK as u64 * u64::from(self.period);
            let end_turns = turns(end as f64 / self.clock);
            while self.next_turn <= end_turns {
                let (mut low, mut high) = (first as f64 / self.clock - 0.1, end as f64 / self.clock);
                for _ in 0..60 {
                    let middle = 0.5 * (low + high);
                    if turns(middle) < self.next_turn { low = middle } else { high = middle }
                }
                self.node.on_tach_edge((high * self.clock).round() as i64 as u32);
                self.next_turn += 1.0;
            }
            let (first_tick, period_ticks, sequence) = (first as u32, self.period, self.sequence);
            self.node.on_block(Block {
                codes: &codes,
                second: &[],
                first_tick,
                period_ticks,
                sequence,
                overrun: false,
            });
            self.sequence += 1;
            self.time_ticks = end;
            self.period = self.node.requested_period_ticks();
            while let Some(message) = self.node.poll(end as u32) {
                match message {
                    Message::Spectrum(spectrum) => heard.spectra.push(spectrum),
                    Message::Peaks(peaks) => heard.peaks.push(peaks),
                    Message::Status(status) => heard.status.push(status),
                    Message::Snapshot(part) => {
                        assert_eq!(usize::from(part.offset), heard.snapshot.len());
                        let scale = f64::from(part.scale);
                        heard.snapshot.extend(part.samples.iter().map(|&x| f64::from(x) * scale));
                    }
                    _ => {}
                }
            }
        }
    }
}

fn config(teeth: u16) -> Configuration {
    let mut config = Configuration::default();
    config.gears.pinion_teeth = teeth;
    config.sensor.acceleration_per_code = Acceleration(M_S2_PER_CODE);
    config
}

#[test]
fn theory_mesh_harmonics_and_sidebands_are_found() {
    let (speed, teeth) = (16.665, 46.0);
    let mut rig = Rig::new(config(46), 84_000_000);
    let mut heard = Heard::default();
    let tone = |turns: f64, order: f64| (std::f64::consts::TAU * order * turns).sin();
    rig.run(
        3.5,
        |t| speed * t,
        |_, turns| {
            (1..=5)
                .map(|h| {
                    let order = f64::from(h) * teeth;
                    tone(turns, order) * 10.0 / f64::from(h) + tone(turns, order + 1.0) + 0.5 * tone(turns, order - 2.0)
                })
                .sum()
        },
        &mut heard,
    );
    assert_eq!(rig.node.state(), State::Measuring);
    assert_eq!(rig.node.statistics().blocks_lost, 0);
    let spectrum = heard.spectra.last().expect("a mesh-band spectrum");
    assert_eq!(spectrum.bands.len(), 5);
    assert!(spectrum.tag.resolution_hz <= speed as f32 / 6.0, "resolution {} Hz", spectrum.tag.resolution_hz);
    for band in &spectrum.bands {
        let h = f64::from(band.harmonic);
        let expected = h * teeth * speed;
        let frequency_error = (f64::from(band.line.frequency_hz) / expected - 1.0).abs();
        let level_error = 20.0 * (f64::from(band.line.amplitude) / (10.0 / h)).log10();
        assert!(frequency_error < 5.0e-5, "harmonic {h}: {} Hz", band.line.frequency_hz);
        assert!(level_error.abs() < 0.1, "harmonic {h}: {level_error} dB");
        let upper = 20.0 * f64::from(band.sidebands[3].amplitude).log10();
        let lower = 20.0 * (f64::from(band.sidebands[1].amplitude) / 0.5).log10();
        assert!(upper.abs() < 0.1 && lower.abs() < 0.1, "harmonic {h}: sidebands {upper}, {lower} dB");
    }
}

#[test]
fn claim_a_forced_slow_rate_aliases_and_the_automatic_one_does_not() {
    let mesh = 293.303;
    let speed = mesh / 20.0;
    let signal = |_: f64, turns: f64| {
        [(1.0, 1.0), (35.0, 5.0), (36.0, 5.0)]
            .iter()
            .map(|(h, a)| a * (std::f64::consts::TAU * 20.0 * h * turns).sin())
            .sum()
    };
    let mut forced = config(20);
    forced.policy = RatePolicy::Forced { rate: Hertz(10_000.0) };
    let level_at = |peaks: &Peaks, hz: f32| {
        let reach = 0.5 * peaks.tag.resolution_hz;
        peaks.lines.iter().find(|line| (line.frequency_hz - hz).abs() < reach).map_or(0.0, |line| line.amplitude)
    };
    let mut heard = Heard::default();
    Rig::new(forced, 84_000_000).run(1.5, |t| speed * t, signal, &mut heard);
    let slow = heard.peaks.last().expect("peaks at the forced rate");
    assert!(slow.tag.aliasing);
    // 35 x 293.303 = 10265.6 Hz and 36 x 293.303 = 10558.9 Hz fold about 10 kHz.
    assert!(level_at(slow, 265.605) > 4.9 && level_at(slow, 558.908) > 4.9, "{:?}", slow.lines);
    let mut heard = Heard::default();
    Rig::new(config(20), 84_000_000).run(1.5, |t| speed * t, signal, &mut heard);
    let fast = heard.peaks.last().expect("peaks at the automatic rate");
    assert!(!fast.tag.aliasing);
    assert!(level_at(fast, 10_265.605) > 4.9 && level_at(fast, 10_558.908) > 4.9, "{:?}", fast.lines);
    assert!(fast.lines.iter().filter(|line| line.frequency_hz < 280.0).all(|line| line.amplitude < 0.005));
}

#[test]
fn theory_run_up_changes_rates_at_block_borders_without_losing_blocks() {
    let mut rig = Rig::new(config(20), 84_000_000);
    let mut heard = Heard::default();
    let turns = |t: f64| if t < 2.0 { 3.0 * t } else { 6.0 + 3.0 * (t - 2.0) + 2.2 * (t - 2.0) * (t - 2.0) };
    rig.run(7.0, turns, |_, turns| (std::f64::consts::TAU * 20.0 * turns).sin(), &mut heard);
    let statistics = rig.node.statistics();
    assert_eq!(statistics.blocks_lost, 0);
    assert_eq!(statistics.count(meshband::events::EventKind::TimeJump), 0);
    let rates: Vec<f32> = heard.status.iter().map(|status| status.granted_hz).collect();
    assert!(rates.iter().cloned().fold(f32::MAX, f32::min) < 30_000.0, "{rates:?}");
    for status in heard.status.iter().filter(|status| status.tick > 3 * 84_000_000) {
        let expected = 3.0 + 4.4 * (status.tick as f64 / 84.0e6 - (1u64 << 32) as f64 / 84.0e6 - 2.0);
        if expected > 4.0 && status.validity == Validity::Locked {
            assert!((f64::from(status.speed_hz) / expected - 1.0).abs() < 2.0e-3, "{status:?}, true speed {expected}");
        }
    }
    for status in heard.status.iter().filter(|status| !status.safe_rate) {
        assert!(status.adc_hz >= 200_000.0 && status.adc_hz <= 440_000.0, "ADC rate {}", status.adc_hz);
        assert!(status.granted_hz >= 2.0 * status.bandwidth_hz, "rate {} at {}", status.granted_hz, status.speed_hz);
    }
}

#[test]
fn fault_no_input_makes_the_node_panic_and_it_recovers() {
    use rand::{RngExt, SeedableRng};
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    let mut node = Node::new(config(20), TicksPerSecond(25_000_000)).expect("valid configuration");
    let mut codes = vec![0u16; 600];
    for _ in 0..3_000 {
        match random.random_range(0..6) {
            0 => node.on_tach_edge(random.random()),
            1..=3 => {
                codes.iter_mut().for_each(|code| *code = random.random());
                let length = random.random_range(0..codes.len());
                let period_ticks =
                    if random.random_bool(0.8) { node.requested_period_ticks() } else { random.random() };
                let (first_tick, sequence) = (random.random(), random.random());
                let overrun = random.random_bool(0.1);
                node.on_block(Block {
                    codes: &codes[..length],
                    second: &[],
                    first_tick,
                    period_ticks,
                    sequence,
                    overrun,
                });
            }
            4 => {
                let request = match random.random_range(0..5) {
                    0 => Request::Snapshot,
                    1 => Request::Stop,
                    2 => Request::Start,
                    3 => Request::Events,
                    _ => Request::SetConfiguration(config(random.random_range(0..2000))),
                };
                node.on_request(request);
            }
            _ => {
                let _ = node.poll(random.random());
            }
        }
    }
}

#[test]
fn theory_the_node_fits_its_memory() {
    let size = std::mem::size_of::<Node>();
    println!("Node: {size} bytes");
    // 24 KiB of it hold waveforms.
    assert!(size <= (100 + 24) * 1024, "{size} bytes");
}

#[test]
fn theory_the_mesh_plan_resolves_an_eighth_of_the_shaft_rate_for_all_usual_tooth_counts() {
    use meshband::mesh_band::{CAPACITY, Followed, MeshPlan, record_turns};
    use meshband::mesh_decimator::BAND_SHARE;
    use meshband::rate_plan::RatePlan;
    for teeth in 12..=300 {
        assert!((8..=28).contains(&record_turns(teeth)) && record_turns(teeth) * teeth >= 256);
        let config = config(teeth);
        let mut speed = 1.0f32;
        while speed <= 25.0 {
            let mut plan = RatePlan::new(TicksPerSecond(84_000_000), config.limits);
            let grant = plan.grant(config.policy.rate(config.law.bandwidth(Hertz(speed)).bandwidth));
            let followed = Followed::of(&config, 0);
            let mesh = MeshPlan::new(&followed, config.mesh.harmonics, Hertz(speed), grant.adc);
            let per_turn = grant.adc.0 / mesh.decimation.ratio() as f32 / speed;
            let per_period = per_turn / (f32::from(mesh.harmonics) * f32::from(teeth));
            // Nothing folds into a band while the speed falls by a fifth.
            let highest = 0.5 / 0.8 * per_turn / f32::from(teeth);
            let grid = f32::from(mesh.samples_per_pitch);
            assert!(grid - highest >= f32::from(mesh.harmonics) + 0.33, "{teeth} teeth at {speed} Hz: {mesh:?}");
            // The bands stay below the decimator's while the speed rises by a fifth.
            let band = 1.2 * (f32::from(mesh.harmonics) + 1.0 / 3.0) * f32::from(teeth) / per_turn;
            assert!(teeth > 69 || band <= 1.0001 * BAND_SHARE, "{teeth} teeth at {speed} Hz: {band}");
            assert!(2.5 * per_turn <= CAPACITY as f32, "{teeth} teeth at {speed} Hz: {per_turn} per turn");
            assert!(mesh.harmonics >= 1 && per_period >= 4.0, "{teeth} teeth at {speed} Hz: {per_period} per period");
            if teeth <= 69 {
                assert_eq!(mesh.harmonics, 5, "{teeth} teeth at {speed} Hz");
                assert!(per_period <= 9.6, "{teeth} teeth at {speed} Hz: {per_period}");
            }
            speed *= 1.02;
        }
    }
}

#[test]
fn fault_lost_blocks_are_counted_and_never_spliced() {
    let mut node = Node::new(config(20), TicksPerSecond(84_000_000)).expect("valid configuration");
    let codes = [32_768u16; 512];
    let period_ticks = node.requested_period_ticks();
    let mut first_tick = 0u32;
    let mut feed = |node: &mut Node, sequence: u32, jump: u32| {
        first_tick = first_tick.wrapping_add(jump);
        node.on_block(Block { codes: &codes, second: &[], first_tick, period_ticks, sequence, overrun: false });
        first_tick = first_tick.wrapping_add(512 * period_ticks);
    };
    for sequence in 0..10 {
        feed(&mut node, sequence, 0);
    }
    feed(&mut node, 13, 3 * 512 * period_ticks);
    feed(&mut node, 14, 77 * period_ticks);
    let statistics = node.statistics();
    assert_eq!((statistics.blocks, statistics.blocks_lost), (12, 3));
    assert_eq!(statistics.count(meshband::events::EventKind::TimeJump), 1);
    assert_eq!(statistics.count(meshband::events::EventKind::BlocksLost), 1);
}

#[test]
fn theory_a_snapshot_returns_the_waveform() {
    let mut rig = Rig::new(config(20), 84_000_000);
    rig.node.on_request(Request::Snapshot);
    let mut heard = Heard::default();
    rig.run(1.0, |t| 10.0 * t, |_, turns| 20.0 * (std::f64::consts::TAU * 20.0 * turns).sin(), &mut heard);
    assert_eq!(heard.snapshot.len(), 4096);
    let rms = (heard.snapshot.iter().map(|x| x * x).sum::<f64>() / 4096.0).sqrt();
    assert!((rms / (20.0 / f64::sqrt(2.0)) - 1.0).abs() < 0.05, "{rms}");
}

#[test]
fn regress_the_age_of_a_speed_that_never_was_counts_from_the_start() {
    let mut plant = Plant::new(plant::configuration(), 1);
    plant.run(2.5, |_| 20.0, Fault::NoPulses);
    let ages: Vec<f32> = plant
        .frames
        .iter()
        .filter_map(|f| if let Packet::Message(Message::Status(s)) = &f.packet { Some(s.age_s) } else { None })
        .collect();
    assert!(ages.len() >= 3 && ages[0] < 0.1, "{ages:?}");
    assert!((1.9..2.6).contains(ages.last().expect("some")), "{ages:?}");
    plant.run(1.0, |_| 20.0, Fault::None);
    assert!(plant.status().expect("each second").age_s < 0.06, "then the latest pulse counts");
}

#[test]
fn regress_a_new_configuration_keeps_the_tachs_counters() {
    let mut plant = Plant::new(plant::configuration(), 1);
    plant.run(2.0, |_| 20.0, Fault::None);
    let before = plant.session.node().statistics();
    assert!(before.pulses > 30 && before.relocks == 1, "{before:?}");
    plant.request(&Request::SetConfiguration(plant::configuration()));
    assert_eq!(plant.session.node().statistics(), before);
    plant.run(2.0, |_| 20.0, Fault::None);
    let after = plant.session.node().statistics();
    assert!(after.pulses >= before.pulses + 36 && after.relocks == 2, "{after:?}");
}

#[test]
fn theory_amplitudes_are_scaled_with_the_gain_in_use() {
    let line = |gain: Gain| {
        let mut plant = Plant::new(plant::configuration(), 1);
        plant.session.node_mut().set_gain(gain);
        plant.run(3.0, |_| 20.0, Fault::None);
        plant.spectrum_since(0).expect("a spectrum").bands[0].line.amplitude
    };
    let ratio = line(Gain::X1) / line(Gain::X8);
    assert!((ratio - 8.0).abs() < 1e-3, "{ratio}");
}
