//! Frames: round trip, damage, truncation, random bytes; losses counted exactly.

use meshband::config::{Configuration, StageLaw, TrainGear};
use meshband::frame::{Decoder, Frame, FrameError, MAX_FRAME, Packet, encode};
use meshband::message::{MAX_PEAKS, MeshBand, Message, Peaks, Reply, Request, Snapshot, SpectralLine, Spectrum};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn receive(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Result<Frame, FrameError>> {
    bytes.iter().filter_map(|&byte| decoder.push(byte)).collect()
}

fn line(seed: u32) -> SpectralLine {
    SpectralLine { frequency_hz: seed as f32 * 1.37, amplitude: 1.0 / (1.0 + seed as f32) }
}

fn packet(number: u32) -> Packet {
    match number % 4 {
        0 => Packet::Request(Request::Identify),
        1 => Packet::Reply(Reply::Configuration(Configuration::default())),
        2 => Packet::Message(Message::Peaks(Peaks {
            lines: (0..number % MAX_PEAKS as u32).map(line).collect(),
            digest: number,
            ..Peaks::default()
        })),
        _ => Packet::Message(Message::Snapshot(Snapshot {
            samples: (0..number % 128).map(|n| (n * number) as i16).collect(),
            ..Snapshot::default()
        })),
    }
}

#[test]
fn theory_the_largest_messages_fit_a_frame() {
    let sidebands: heapless::Vec<SpectralLine, 8> = (0..8).map(line).collect();
    let band = MeshBand { harmonic: 8, line: line(1), sidebands: sidebands.clone(), gear_sidebands: sidebands };
    let bands = (0..meshband::config::MAX_HARMONICS).map(|_| band.clone()).collect();
    let spectrum = Packet::Message(Message::Spectrum(Spectrum { bands, digest: u32::MAX, ..Spectrum::default() }));
    let samples = (0..128).map(|_| i16::MIN).collect();
    let snapshot = Packet::Message(Message::Snapshot(Snapshot { samples, ..Snapshot::default() }));
    for packet in [spectrum, snapshot] {
        let mut buffer = [0u8; MAX_FRAME];
        let length = encode(&packet, 7, &mut buffer).expect("fits").len();
        println!("{length} bytes");
        let received = receive(&mut Decoder::new(), &buffer[..length]);
        assert_eq!(received, [Ok(Frame { sequence: 7, lost: 0, packet })]);
    }
}

#[test]
fn theory_the_configuration_fits_its_bound() {
    use meshband::alarm::{AlarmBand, Watched};
    use meshband::law::LawForm;
    use meshband::levels::{ExpectedLevel, LevelPoint, LocalPoint};
    let band =
        AlarmBand { watched: Watched::Fm4, from: Hertz(1.0), to: Hertz(25.0), raise: 2.0, clear: 1.0, persistence: 3 };
    use meshband::units::Hertz;
    let mut config = Configuration::default();
    while config.alarms.push(band).is_ok() {}
    for n in 1..=meshband::levels::MAX_LEVELS {
        let level = ExpectedLevel { level_db: -12.3, uncertainty_db: 1.5 };
        let point = LevelPoint {
            speed: Hertz(n as f32),
            rms: level,
            velocity_rms: level,
            mesh_amplitude: level,
            residual_rms: level,
        };
        config.levels.push(point).expect("room");
        let local = LocalPoint { speed: Hertz(n as f32), sidebands: level, fm0: level };
        config.local_levels.push(local).expect("room");
    }
    while config.modes.push(meshband::alarm::AlarmMode::default()).is_ok() {}
    let gear = TrainGear { stage: 4, teeth: 797, mate_teeth: 991, turns: 400_000_001, pinion_turns: 400_000_003 };
    while config.train.push(gear).is_ok() {}
    while config.stage_laws.push(StageLaw { ramp_turns: 0.02, mode_rise_s: 1e-4 }).is_ok() {}
    while config.alarm_gears.push(5).is_ok() {}
    (config.range.lowest, config.range.highest) = (20_000, 60_000);
    config.sensor_check.mean = [20_000, 60_000];
    config.second = Some(meshband::config::SecondSensor::default());
    config.limits.highest_adc = Hertz(200_000.0);
    assert_eq!(config.validate(meshband::board::Timing::STM32F405), Ok(()));
    assert!(matches!(config.law.form, LawForm::Tabulated(_)), "the longest form");
    let packet = Packet::Request(Request::SetConfiguration(config));
    let mut buffer = [0u8; MAX_FRAME];
    let length = encode(&packet, 0, &mut buffer).expect("fits").len();
    println!("{length} bytes");
    assert!(length <= Configuration::MAX_SERIALISED);
}

/// A link that damages one byte in a hundred and cuts one frame in fifty short.
struct Noise {
    random: ChaCha8Rng,
    /// Intact bytes until the next damaged one.
    until_damage: u32,
}

impl Noise {
    fn new(seed: u64) -> Self {
        Self { random: ChaCha8Rng::seed_from_u64(seed), until_damage: 0 }
    }

    /// Damages the frame in place; tells how much of it arrives and whether it is still what was sent.
    fn pass(&mut self, wire: &mut [u8]) -> (usize, bool) {
        let (mut at, mut intact) = (self.until_damage as usize, true);
        while at < wire.len() {
            wire[at] ^= self.random.random_range(1..=255u8);
            intact = false;
            // Geometric: every byte is damaged with probability 1 %, independent of the others.
            let share: f64 = self.random.random();
            at += 1 + (share.ln() / 0.99f64.ln()) as usize;
        }
        self.until_damage = (at - wire.len()) as u32;
        if self.random.random_bool(0.02) {
            return (self.random.random_range(0..wire.len()), false);
        }
        (wire.len(), intact)
    }
}

#[test]
fn fault_a_million_frames_over_a_damaged_link_lose_whole_frames_only_and_count_them() {
    const FRAMES: u32 = 1_000_000;
    // Every content once; a frame's number is in its sequence, and the contents recur with an odd period.
    let packets: Vec<Packet> = (0..997).map(packet).collect();
    let mut noise = Noise::new(3);
    let mut decoder = Decoder::<Packet>::new();
    let mut buffer = [0u8; MAX_FRAME];
    let (mut intact_frames, mut received, mut lost) = (0u32, 0u32, 0u32);
    // The newest frame before the present one of which anything arrived.
    let mut former = 0;
    for number in 0..=FRAMES {
        let expected = &packets[number as usize % packets.len()];
        let length = encode(expected, number as u16, &mut buffer).expect("fits").len();
        let wire = &mut buffer[..length];
        // The first and the last frame are intact, so that every loss lies between two received frames.
        let edge = number == 0 || number == FRAMES;
        let (arrives, intact) = if edge { (length, true) } else { noise.pass(wire) };
        intact_frames += u32::from(intact);
        let mut this_one = false;
        for &byte in &wire[..arrives] {
            let Some(Ok(frame)) = decoder.push(byte) else { continue };
            // A frame that lost its closing zero arrives with the opening one of the next that arrives at all.
            let sent = if frame.sequence == number as u16 { number } else { former };
            assert_eq!(frame.sequence, sent as u16, "a frame of another time was accepted");
            assert_eq!(frame.packet, packets[sent as usize % packets.len()], "a wrong frame was accepted");
            this_one |= sent == number;
            received += 1;
            lost += u32::from(frame.lost);
        }
        former = if arrives > 0 { number } else { former };
        assert!(this_one || !intact, "frame {number} was intact and not received: not resynchronised");
    }
    assert_eq!(lost, FRAMES + 1 - received, "losses are counted exactly");
    assert_eq!(lost, decoder.lost());
    println!(
        "{FRAMES} frames: {intact_frames} intact, {received} received, {lost} lost, {} refused",
        decoder.refused()
    );
    // Whole frames arrive, some of them without a delimiter; and the noise was no mere whisper.
    assert!(received >= intact_frames && intact_frames < FRAMES / 2);
}

proptest! {
    #[test]
    fn fault_random_bytes_are_never_a_frame(bytes in proptest::collection::vec(any::<u8>(), 0..4000)) {
        let mut decoder = Decoder::new();
        let received = receive(&mut decoder, &bytes);
        prop_assert!(received.iter().all(Result::is_err));
        decoder.push(0);
        let mut buffer = [0u8; MAX_FRAME];
        let wire = encode(&Request::Start, 1, &mut buffer).expect("fits");
        let last = receive(&mut decoder, wire);
        prop_assert_eq!(&last, &[Ok(Frame { sequence: 1, lost: 0, packet: Packet::Request(Request::Start) })]);
    }

    #[test]
    fn fault_small_buffers_are_refused(room in 0usize..40) {
        let mut buffer = vec![0u8; room];
        let result = encode(&Reply::Configuration(Configuration::default()), 1, &mut buffer);
        prop_assert_eq!(result, Err(FrameError::NoRoom));
    }
}
