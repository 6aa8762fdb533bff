//! An independent master (pymodbus) on the emulated board's line, over a bridge: bytes of a TCP connection as
//! characters of the line.

use meshband_emulator::board::Board;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::{Duration, Instant};

/// Step in which the board runs while its master waits, s.
const STEP_S: f64 = 0.002;
/// Longest wait for the master's program, of the wall clock.
const PATIENCE: Duration = Duration::from_secs(90);

/// The interpreter with pymodbus: `MESHBAND_MODBUS_PYTHON`, or the environment that `cargo xtask modbus` makes.
fn python() -> Option<PathBuf> {
    let own = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/modbus-python/bin/python");
    let python = std::env::var_os("MESHBAND_MODBUS_PYTHON").map_or_else(own, PathBuf::from);
    let has = Command::new(&python).args(["-c", "import pymodbus"]).stderr(Stdio::null()).status();
    has.is_ok_and(|status| status.success()).then_some(python)
}

/// The master.
pub struct Master {
    program: Child,
    orders: ChildStdin,
    answers: Receiver<String>,
    wire: TcpStream,
    /// Characters that came back for the latest order, with the ends of their stop bits in units of the emulator.
    pub latest: Vec<(u64, u8)>,
}

impl Master {
    /// Starts the program for a node's address; `None`, after saying so, where there is none.
    pub fn start(test: &str, address: u8) -> Option<Self> {
        let Some(python) = python() else {
            println!("skipped {test}: no Python with pymodbus (cargo xtask modbus)");
            return None;
        };
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("a port").port();
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/compare/modbus_master.py");
        let mut program = Command::new(python)
            .arg(script)
            .args([port.to_string(), address.to_string()])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("Python");
        let (orders, output) = (program.stdin.take().expect("piped"), program.stdout.take().expect("piped"));
        let (told, answers) = channel();
        std::thread::spawn(move || {
            BufReader::new(output).lines().map_while(Result::ok).all(|line| told.send(line).is_ok())
        });
        let wire = connection(&listener, &mut program);
        Some(Self { program, orders, answers, wire, latest: Vec::new() })
    }

    /// Gives an order and runs the board until it is answered.
    pub fn ask(&mut self, board: &mut Board, order: &str) -> String {
        writeln!(self.orders, "{order}").expect("the master lives");
        self.latest.clear();
        let begin = Instant::now();
        let mut buffer = [0; 512];
        loop {
            match self.answers.try_recv() {
                Ok(answer) => return answer,
                Err(TryRecvError::Empty) => {}
                Err(TryRecvError::Disconnected) => panic!("the master has ended at {order:?}"),
            }
            assert!(begin.elapsed() < PATIENCE, "no answer to {order:?}");
            match self.wire.read(&mut buffer) {
                Ok(count) => board.send(&buffer[..count]),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) => panic!("bridge: {error}"),
            }
            let until = board.seconds() + STEP_S;
            board.run_until(until).expect("the board runs");
            let sent = std::mem::take(&mut board.seen().sent);
            let bytes: Vec<u8> = sent.iter().map(|(_, byte)| *byte).collect();
            self.latest.extend(sent);
            self.wire.write_all(&bytes).expect("the master listens");
        }
    }

    /// As numbers.
    pub fn numbers(&mut self, board: &mut Board, order: &str) -> Vec<u32> {
        let answer = self.ask(board, order);
        let number = |word: &str| word.parse().unwrap_or_else(|_| panic!("{order}: {answer}"));
        answer.split_whitespace().map(number).collect()
    }
}

impl Drop for Master {
    fn drop(&mut self) {
        let _ = self.program.kill();
        let _ = self.program.wait();
    }
}

/// The program's connection, which comes when the interpreter has started.
fn connection(listener: &TcpListener, program: &mut Child) -> TcpStream {
    listener.set_nonblocking(true).expect("set");
    let begin = Instant::now();
    loop {
        match listener.accept() {
            Ok((wire, _)) => {
                wire.set_nonblocking(false).expect("set");
                wire.set_read_timeout(Some(Duration::from_millis(1))).expect("set");
                wire.set_nodelay(true).expect("set");
                return wire;
            }
            Err(error) => {
                let ended = program.try_wait().expect("a child");
                assert!(
                    ended.is_none() && begin.elapsed() < PATIENCE,
                    "the master does not connect: {error}, {ended:?}"
                );
                std::thread::sleep(Duration::from_millis(20));
            }
        }
    }
}
