//! Frames: round trip, damage, truncation, random bytes; losses counted exactly.

use meshband::config::Configuration;
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
    let band =
        AlarmBand { watched: Watched::Rms, from: Hertz(1.0), to: Hertz(25.0), raise: 2.0, clear: 1.0, persistence: 3 };
    use meshband::units::Hertz;
    let mut config = Configuration::default();
    while config.alarms.push(band).is_ok() {}
    assert_eq!(config.validate(84_000_000), Ok(()));
    let packet = Packet::Request(Request::SetConfiguration(config));
    let mut buffer = [0u8; MAX_FRAME];
    assert!(encode(&packet, 0, &mut buffer).expect("fits").len() <= Configuration::MAX_SERIALISED);
}

#[test]
fn fault_damaged_links_lose_whole_frames_only_and_count_them() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let mut decoder = Decoder::new();
    let mut buffer = [0u8; MAX_FRAME];
    let (mut sent_intact, mut received_total, mut lost) = (0u32, 0u32, 0u32);
    let frames = 100_000u32;
    for number in 0..=frames {
        let expected = packet(number);
        let wire = encode(&expected, number as u16, &mut buffer).expect("fits");
        let mut wire = wire.to_vec();
        // The first and the last frame are intact, so that every loss lies between two received frames.
        let whole = number == 0 || number == frames;
        let mut intact = true;
        if !whole && random.random_bool(0.05) {
            let at = random.random_range(0..wire.len());
            let flip: u8 = random.random_range(1..=255);
            wire[at] ^= flip;
            intact = false;
        }
        if !whole && random.random_bool(0.02) {
            wire.truncate(random.random_range(0..wire.len()));
            intact = false;
        }
        sent_intact += u32::from(intact);
        for frame in receive(&mut decoder, &wire).into_iter().flatten() {
            // A frame that lost its closing zero arrives with the opening one of the next.
            let sent = if frame.sequence == number as u16 { number } else { number.wrapping_sub(1) };
            assert_eq!(frame.packet, packet(sent), "a wrong frame was accepted");
            received_total += 1;
            lost += u32::from(frame.lost);
        }
    }
    // A frame that only lost a delimiter still arrives.
    assert!(received_total >= sent_intact);
    assert_eq!(lost, frames + 1 - received_total);
    println!("{received_total} of {} frames received, {lost} lost, {} refused", frames + 1, decoder.refused());
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
