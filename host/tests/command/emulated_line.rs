//! The released image in the emulated chip, behind a TCP port as behind a serial line.

use meshband_emulator::board::Board;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Step in which the board runs between two looks at the connection, s.
const STEP_S: f64 = 0.002;

/// A board behind a TCP port, which runs until this is dropped.
pub struct Line {
    /// Name of the port.
    pub port: String,
    over: Arc<AtomicBool>,
    board: Option<JoinHandle<()>>,
}

impl Line {
    /// `loss` of every million bytes in either direction are damaged.
    pub fn open(board: Board, loss: u32) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = format!("tcp:{}", listener.local_addr().expect("a port"));
        let over = Arc::new(AtomicBool::new(false));
        let seen = over.clone();
        let board = std::thread::spawn(move || serve(&listener, board, loss, &seen));
        Self { port, over, board: Some(board) }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        let ended = self.board.take().expect("there until now").join();
        assert!(ended.is_ok() || std::thread::panicking(), "the board's thread ends well");
    }
}

/// Bytes of the newest connection as characters of the line; the board runs whether somebody is connected or not.
fn serve(listener: &TcpListener, mut board: Board, loss: u32, over: &AtomicBool) {
    listener.set_nonblocking(true).expect("set");
    let (mut wire, mut buffer, mut random): (Option<TcpStream>, _, u64) = (None, [0; 512], 0x9e37_79b9_7f4a_7c15);
    let mut pass = |bytes: &mut [u8]| {
        for byte in bytes {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            *byte ^= if ((random >> 20) % 1_000_000) < u64::from(loss) { 0x20 } else { 0 };
        }
    };
    while !over.load(Ordering::Relaxed) {
        if let Ok((stream, _)) = listener.accept() {
            stream.set_nonblocking(true).expect("set");
            wire = Some(stream);
        }
        let until = board.seconds() + STEP_S;
        board.run_until(until).expect("the board runs");
        let mut sent = board.take_sent();
        let Some(stream) = &mut wire else { continue };
        pass(&mut sent);
        let gone = match stream.read(&mut buffer) {
            Ok(0) => true,
            Ok(count) => {
                pass(&mut buffer[..count]);
                board.send(&buffer[..count]);
                false
            }
            Err(error) => error.kind() != ErrorKind::WouldBlock,
        };
        if gone || stream.write_all(&sent).is_err() {
            wire = None;
        }
    }
}
