//! Runs the node's image in QEMU and judges strictly how it ended.
//!
//! The only success is that the firmware said so (its closing line) *and* ended the machine with
//! semihosting exit code 0. QEMU itself also exits with 0 when it is asked to terminate, and known runners
//! take a QEMU killed by a signal for a success: here a panic, a fault, a lock-up, a signal and a time-out
//! are all errors with a reason. The virtual clock counts instructions, so two runs give the same bytes.

use super::simulation::TakenBlock;
use crate::{Error, Result};
use meshband::replay::{BLOCK_SAMPLES, IMAGE_ADDRESS, IMAGE_CAPACITY};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Program that emulates the board.
pub const PROGRAM: &str = "qemu-system-arm";
/// The firmware's last words before it exits with success.
const CLOSING_LINE: &str = "node: finished";

/// Where the node's UART goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Link {
    /// Into [`Finished::link`], all of it.
    Captured,
    /// A TCP port on this machine that QEMU listens on; the run begins when a client has connected.
    Tcp(u16),
    /// A TCP port on this machine that the caller listens on.
    Connect(u16),
    /// A Unix socket that the caller listens on. It holds a few hundred bytes where TCP holds megabytes: a caller that
    /// does not read stalls the line at once.
    Socket(PathBuf),
}

/// A machine to run, not yet started.
#[derive(Debug, Clone)]
pub struct Qemu {
    /// The firmware's ELF image.
    pub firmware: PathBuf,
    /// Wall-clock time after which the run counts as hung.
    pub time_limit: Duration,
    /// Virtual nanoseconds per instruction as a power of two. 2 gives 250 million instructions per second, about twice
    /// an STM32F405 at 168 MHz: the board spends some 100 instructions per sample on imitating ADC and DMA.
    pub icount_shift: u8,
    /// Whether an idle processor waits for the clock on the wall, so that the node lives as long as its record says;
    /// else idle time takes none.
    pub at_wall_speed: bool,
    /// Where the UART goes.
    pub link: Link,
    /// File that keeps the board's memory with the stored configuration beyond a run; made where absent.
    pub memory: Option<PathBuf>,
}

/// What a successful run left.
#[derive(Debug, Clone)]
pub struct Finished {
    /// Every byte the node sent over its link.
    pub link: Vec<u8>,
    /// Text of the console.
    pub console: String,
    /// The raw defmt log.
    pub log: Vec<u8>,
    /// Wall-clock time of the run.
    pub wall_time: Duration,
}

impl Finished {
    /// A counter among the closing statistics; zero where it is missing.
    pub fn count(&self, key: &str) -> u32 {
        self.statistic(key).and_then(|value| value.parse().ok()).unwrap_or(0)
    }

    /// The blocks that the firmware's node got, as its log says.
    ///
    /// # Errors
    /// [`Error::Tool`] where the firmware kept no log, or one that did not hold them all.
    pub fn blocks(&self) -> Result<Vec<TakenBlock>> {
        let incomplete = || Error::tool("node in QEMU", "its log of blocks is incomplete");
        if self.statistic("runs_left_out") != Some("0") {
            return Err(incomplete());
        }
        let mut blocks = Vec::new();
        for line in self.console.lines().filter_map(|line| line.strip_prefix("block: ")) {
            let numbers: Vec<u32> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
            let [sequence, first_tick, period, overrun, count] = numbers[..] else { return Err(incomplete()) };
            blocks.extend((0..count).map(|n| TakenBlock {
                sequence: sequence.wrapping_add(n),
                first_tick: first_tick.wrapping_add(n * period * BLOCK_SAMPLES as u32),
                period,
                overrun: overrun != 0 && n == 0,
            }));
        }
        Ok(blocks)
    }

    /// The value of `key=value` in the firmware's closing statistics.
    pub fn statistic(&self, key: &str) -> Option<&str> {
        let words = self.console.lines().filter(|l| l.starts_with("node: ")).flat_map(str::split_whitespace);
        words.filter_map(|word| word.split_once('=')).find(|(k, _)| *k == key).map(|(_, value)| value)
    }
}

/// Whether QEMU can be started here.
pub fn is_installed() -> bool {
    Command::new(PROGRAM)
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success())
}

/// Where `cargo xtask node-build` leaves the image of a board.
pub fn built_firmware(board: &str) -> PathBuf {
    let workspace = &Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let target =
        std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| workspace.join("target"), |folder| workspace.join(folder));
    target.join("thumbv7em-none-eabihf/firmware").join(board)
}

impl Qemu {
    /// A machine with this image, a time limit of two minutes and a captured link.
    pub fn new(firmware: impl Into<PathBuf>) -> Self {
        let time_limit = Duration::from_secs(120);
        Self {
            firmware: firmware.into(),
            time_limit,
            icount_shift: 2,
            at_wall_speed: false,
            link: Link::Captured,
            memory: None,
        }
    }

    /// A machine with the built image of a board; `None` where QEMU or the image is absent.
    pub fn of_board(board: &str) -> Option<Self> {
        let firmware = built_firmware(board);
        (is_installed() && firmware.is_file()).then(|| Self::new(firmware))
    }

    /// Boots the image with `replay` in its PSRAM and waits until it exits.
    ///
    /// # Errors
    /// [`Error::Tool`] unless the firmware itself reported success; the message says how it ended and quotes
    /// the console's last line.
    pub fn run(&self, replay: &[u8]) -> Result<Finished> {
        self.start(replay)?.finish()
    }

    /// Boots the image with `replay` in its PSRAM. The machine dies with the returned value, as by a power cut.
    ///
    /// # Errors
    /// [`Error::Tool`] where image or QEMU is absent, [`Error::Invalid`] for a replay larger than the memory.
    pub fn start(&self, replay: &[u8]) -> Result<Running> {
        if !self.firmware.is_file() {
            let what = format!(
                "no image at {}: in a checkout of the sources `cargo xtask node-build` makes it, elsewhere name one \
                 with --firmware; without any, `meshband node --serve tcp:PORT --loop RECORD` runs the node's own code",
                self.firmware.display()
            );
            return Err(Error::tool("firmware", what));
        }
        if replay.len() > IMAGE_CAPACITY {
            let what = format!("{} bytes of signal do not fit the board's {IMAGE_CAPACITY}", replay.len());
            return Err(Error::invalid("replay image", what));
        }
        let folder = RunFolder::new()?;
        let signal = folder.0.join("signal.bin");
        let link = folder.0.join("link.bin");
        std::fs::write(&signal, replay).map_err(Error::file(&signal))?;
        let start = Instant::now();
        let machine = Machine::start(self.command(&signal, &link))?;
        let captured = (self.link == Link::Captured).then_some(link);
        Ok(Running { machine, start, time_limit: self.time_limit, captured, _folder: folder })
    }

    fn command(&self, signal: &Path, link: &Path) -> Command {
        let mut command = Command::new(PROGRAM);
        command
            .args(["-machine", "mps2-an386", "-nodefaults", "-display", "none", "-monitor", "none"])
            .arg("-icount")
            .arg(format!("shift={},sleep={}", self.icount_shift, if self.at_wall_speed { "on" } else { "off" }))
            .args(["-semihosting-config", "enable=on,target=native"])
            .arg("-device")
            .arg(format!("loader,file={},addr={IMAGE_ADDRESS:#x},force-raw=on", escape(signal)))
            .arg("-serial")
            .arg(match self.link {
                Link::Captured => format!("file:{}", escape(link)),
                Link::Tcp(port) => format!("tcp:127.0.0.1:{port},server=on,wait=on,nodelay=on"),
                Link::Connect(port) => format!("tcp:127.0.0.1:{port},nodelay=on"),
                Link::Socket(ref path) => format!("unix:{}", escape(path)),
            })
            .arg("-kernel")
            .arg(&self.firmware);
        if let Some(memory) = &self.memory {
            let file = escape(memory);
            command.arg("-object").arg(format!("memory-backend-file,id=psram,size=16M,mem-path={file},share=on"));
            command.args(["-machine", "memory-backend=psram"]);
        }
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        command
    }
}

/// A machine that runs; dropping it cuts its power.
pub struct Running {
    machine: Machine,
    start: Instant,
    time_limit: Duration,
    captured: Option<PathBuf>,
    _folder: RunFolder,
}

impl Running {
    /// Waits until the firmware exits.
    ///
    /// # Errors
    /// As [`Qemu::run`].
    pub fn finish(mut self) -> Result<Finished> {
        let status = self.machine.wait(self.start + self.time_limit)?;
        let wall_time = self.start.elapsed();
        let (log, console) = self.machine.output();
        let console = String::from_utf8_lossy(&console).into_owned();
        judge(status, &console, self.time_limit)?;
        let link = match &self.captured {
            Some(link) => std::fs::read(link).map_err(Error::file(link))?,
            None => Vec::new(),
        };
        Ok(Finished { link, console, log, wall_time })
    }
}

/// A comma ends a QEMU option unless it is doubled.
fn escape(path: &Path) -> String {
    path.to_string_lossy().replace(',', ",,")
}

/// Turns the way QEMU ended into success or a reason; `None` is a time-out.
fn judge(status: Option<ExitStatus>, console: &str, limit: Duration) -> Result<()> {
    let closed = console.lines().any(|line| line == CLOSING_LINE);
    let what = match status {
        Some(status) if status.code() == Some(0) && closed => return Ok(()),
        None => format!("no end after {} s of wall-clock time", limit.as_secs_f64()),
        Some(status) if status.code() == Some(0) => "QEMU ended without the firmware having finished".to_owned(),
        Some(status) => match status.code() {
            Some(code) => format!("ended with exit code {code}"),
            None => format!("QEMU died ({status}), as it does when the core locks up"),
        },
    };
    let last = console.lines().rev().find(|line| line.starts_with("node: ") || line.starts_with("qemu"));
    Err(Error::tool("node in QEMU", last.map_or(what.clone(), |line| format!("{what}; console: {line}"))))
}

/// A running QEMU; killed when dropped.
struct Machine {
    child: Child,
    readers: Vec<std::thread::JoinHandle<Vec<u8>>>,
}

impl Machine {
    fn start(mut command: Command) -> Result<Self> {
        let mut child = command.spawn().map_err(|e| {
            let what = match e.kind() {
                std::io::ErrorKind::NotFound => "not installed: run `cargo xtask setup`".to_owned(),
                _ => format!("cannot be started: {e}"),
            };
            Error::tool(PROGRAM, what)
        })?;
        let log = child.stdout.take().map(collect);
        let console = child.stderr.take().map(collect);
        Ok(Self { child, readers: log.into_iter().chain(console).collect() })
    }

    /// Its exit status, or `None` when the deadline passed and it was killed.
    fn wait(&mut self, deadline: Instant) -> Result<Option<ExitStatus>> {
        loop {
            if let Some(status) = self.child.try_wait().map_err(|e| Error::tool(PROGRAM, e))? {
                return Ok(Some(status));
            }
            if Instant::now() >= deadline {
                self.kill();
                return Ok(None);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Standard output and error; to be called after the end.
    fn output(&mut self) -> (Vec<u8>, Vec<u8>) {
        let mut streams = self.readers.drain(..).map(|reader| reader.join().unwrap_or_default());
        (streams.next().unwrap_or_default(), streams.next().unwrap_or_default())
    }

    fn kill(&mut self) {
        // It may have ended by itself in between; either way it is gone and reaped afterwards.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Drop for Machine {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Reads a stream to its end beside the program, so that a full pipe never blocks it.
fn collect(mut stream: impl Read + Send + 'static) -> std::thread::JoinHandle<Vec<u8>> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // What came before a broken pipe is still worth showing.
        let _ = stream.read_to_end(&mut bytes);
        bytes
    })
}

/// Folder of one run's files, removed at its end.
struct RunFolder(PathBuf);

impl RunFolder {
    fn new() -> Result<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let name = format!("meshband-run-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).map_err(Error::file(&path))?;
        Ok(Self(path))
    }
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        // A remainder in the temporary folder harms nobody.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
