//! A Modbus line: bytes in any pieces, with any silences and pauses of the main loop between them.

use meshband::board::Timing;
use meshband::config::{Configuration, LinkConfig, Personality};
use meshband::identity::Identity;
use meshband::modbus::CRC16;
use meshband::modbus::station::LISTENING_S;
use meshband::session::Session;

const ADDRESS: u8 = 17;
const BOARD: Timing = Timing::STM32F405;

/// Requests of every kind with silences: for this node, for all, for another, one split, one merged.
pub fn seeds() -> Vec<Vec<u8>> {
    let sealed = |address: u8, pdu: &[u8]| {
        let mut frame = [&[address], pdu].concat();
        frame.extend(CRC16.checksum(&frame).to_le_bytes());
        frame
    };
    let piece = |bytes: &[u8]| [&[0, bytes.len() as u8], bytes].concat();
    let silence = [1, 20];
    let mut all = Vec::new();
    for function in [1, 2, 3, 4, 6, 43] {
        all.extend(piece(&sealed(ADDRESS, &[function, 0, 0, 0, 2])));
        all.extend(silence);
    }
    let mut others = Vec::new();
    for address in [0, 3, ADDRESS] {
        others.extend(piece(&sealed(address, &[4, 0, 96, 0, 22])));
        if address != 3 {
            others.extend(silence);
        }
    }
    let request = sealed(ADDRESS, &[4, 1, 0, 0, 10]);
    let split = [piece(&request[..3]), vec![1, 1], piece(&request[3..]), silence.to_vec(), silence.to_vec()].concat();
    vec![all, others, split]
}

/// What is answered is a whole frame of this node's, behind at least as many bytes as a request has.
pub fn run(bytes: &[u8]) -> String {
    let link = LinkConfig { personality: Personality::Modbus, address: ADDRESS, ..LinkConfig::default() };
    let config = Configuration { link, ..Configuration::default() };
    let mut session = Session::new(config, BOARD, Identity::HOST).expect("a valid configuration");
    let mut now = u32::MAX - BOARD.clock.0;
    let mut quiet = |_: &[u8]| panic!("said without having been asked");
    session.follow_line(now, &mut quiet);
    now = now.wrapping_add(BOARD.clock.0 * LISTENING_S);
    session.follow_line(now, &mut quiet);
    let (mut heard, mut answers, mut refusals) = (0_usize, 0_usize, 0_usize);
    let mut bytes = bytes.iter().copied();
    while let Some(operation) = bytes.next() {
        let count = usize::from(bytes.next().unwrap_or(0));
        if operation % 2 == 0 {
            for byte in bytes.by_ref().take(count) {
                heard += 1;
                session.on_byte(byte, &mut quiet);
            }
        } else {
            // Up to 51 ms, and now and then a pause of the loop.
            let unit = if operation == 0xff { 50 } else { 1 };
            now = now.wrapping_add(BOARD.clock.0 / 5000 * unit * count as u32);
        }
        session.follow_line(now, &mut |answer| {
            let (content, checksum) = answer.split_last_chunk::<2>().expect("a frame");
            assert_eq!((content[0], CRC16.checksum(content).to_le_bytes()), (ADDRESS, *checksum));
            let exception = content[1] & 0x80 != 0;
            let length = if exception { 1 } else { 1 + usize::from(content[2]) };
            assert!(content.len() == 2 + length && answer.len() <= 256);
            answers += 1;
            refusals += usize::from(exception);
        });
        assert!(4 * answers <= heard, "{answers} answers to {heard} bytes");
    }
    let some = |count: usize| ["none", "one", "two", "three", "several"][count.min(4)];
    format!("answers {}, of them refusals {}", some(answers), some(refusals))
}
