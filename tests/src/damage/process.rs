//! Running the command under limits: memory, file size, time; with outputs that are closed or full, and signals.
//!
//! Limits are set by `sh` before it becomes the command (`ulimit`, `exec`): what a parent could only do between fork
//! and exec, with unsafe code, the shell does for everyone. File sizes are limited with SIGXFSZ ignored, so that
//! writing fails as on a full disk.

use super::snapshot::Snapshot;
use rustix::process::{Pid, Signal, kill_process};
use std::ffi::OsString;
use std::fs::File;
use std::io::Read;
use std::os::unix::process::ExitStatusExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Address space of a command, bytes.
pub const MEMORY: u64 = 2 << 30;
/// No command may write files beyond this, bytes: the campaign must not fill the disk of its host.
pub const LARGEST_FILE: u64 = 1 << 30;
/// A command that takes longer hangs, unless a busy machine kept it from working.
pub const TIME: Duration = Duration::from_secs(20);
/// Beyond this no machine is that busy.
const PATIENCE: Duration = Duration::from_secs(100);
/// Bytes of a file-size limit's step in POSIX shells.
pub const FILE_STEP: u64 = 512;

/// Where an output of a command goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sink {
    /// Read afterwards.
    Kept,
    /// A pipe whose reader takes so many bytes and leaves.
    Pipe(usize),
    /// A device that is full.
    Full,
    /// Closed before the command starts.
    Closed,
}

/// When a signal is sent.
#[derive(Debug, Clone, Copy)]
pub enum When {
    /// So long after the start.
    After(Duration),
    /// So long after the first change in the folder `out`.
    Change(Duration),
}

/// One command line and how it is run.
#[derive(Debug, Clone)]
pub struct Invocation {
    /// Words after the program's name.
    pub arguments: Vec<OsString>,
    /// Standard output.
    pub stdout: Sink,
    /// Standard error.
    pub stderr: Sink,
    /// Largest file it can write, bytes, where that is the attack.
    pub file_limit: Option<u64>,
    /// Size of the file system behind the folder `out`, kilobytes, where that is the attack.
    pub disk_kb: Option<u64>,
    /// A signal.
    pub signal: Option<(Signal, When)>,
}

impl Invocation {
    /// Undisturbed.
    pub fn new(arguments: Vec<OsString>) -> Self {
        Self { arguments, stdout: Sink::Kept, stderr: Sink::Kept, file_limit: None, disk_kb: None, signal: None }
    }

    /// As one would type it.
    pub fn line(&self) -> String {
        let mut line = String::from("meshband");
        for word in &self.arguments {
            let word = word.to_string_lossy();
            let plain = !word.is_empty() && word.chars().all(|c| c.is_ascii_alphanumeric() || "-_=./,:".contains(c));
            let short: String = word.chars().take(200).collect();
            line += &if plain { format!(" {short}") } else { format!(" {short:?}") };
        }
        for (name, sink) in [("stdout", self.stdout), ("stderr", self.stderr)] {
            if sink != Sink::Kept {
                line += &format!(" [{name} {sink:?}]");
            }
        }
        if let Some(limit) = self.file_limit {
            line += &format!(" [files up to {limit} bytes]");
        }
        if let Some(kb) = self.disk_kb {
            line += &format!(" [disk of {kb} kB]");
        }
        if let Some((signal, when)) = self.signal {
            line += &format!(" [signal {}, {when:?}]", signal.as_raw());
        }
        line
    }
}

/// How a command ended.
#[derive(Debug, Clone, Default)]
pub struct Ended {
    /// Exit code.
    pub code: Option<i32>,
    /// Signal that ended it.
    pub signal: Option<i32>,
    /// Whether it had to be ended after [`TIME`].
    pub hung: bool,
    /// Whether the signal of the attack was sent before it ended.
    pub signalled: Option<i32>,
    /// Standard output, where kept.
    pub stdout: Vec<u8>,
    /// Standard error, where kept.
    pub stderr: Vec<u8>,
}

struct Running<'a> {
    invocation: &'a Invocation,
    child: Child,
    signalled: Option<i32>,
    hung: bool,
    changed: Option<Instant>,
}

/// Starts all commands at once in `folder` and waits for them; `said` holds what they say.
///
/// # Panics
/// Where `sh` cannot be started or the campaign's folder not be written.
pub fn run(program: &Path, folder: &Path, said: &Path, invocations: &[Invocation]) -> Vec<Ended> {
    let watched = folder.join("out");
    let before = Snapshot::of(&watched).digest();
    let start = Instant::now();
    let mut running: Vec<Running> = invocations
        .iter()
        .enumerate()
        .map(|(i, invocation)| {
            let child = spawn(program, folder, said, i, invocation);
            Running { invocation, child, signalled: None, hung: false, changed: None }
        })
        .collect();
    let mut ended: Vec<Option<Ended>> = invocations.iter().map(|_| None).collect();
    while ended.iter().any(Option::is_none) {
        for (i, one) in running.iter_mut().enumerate() {
            if ended[i].is_some() {
                continue;
            }
            if let Some(status) = one.child.try_wait().expect("our own child") {
                let of = |name: &str| std::fs::read(said.join(format!("{i}.{name}"))).unwrap_or_default();
                ended[i] = Some(Ended {
                    code: status.code(),
                    signal: status.signal(),
                    hung: one.hung,
                    signalled: one.signalled,
                    stdout: of("stdout"),
                    stderr: of("stderr"),
                });
            } else {
                one.disturb(start, || Snapshot::of(&watched).digest() != before);
            }
        }
        std::thread::sleep(Duration::from_micros(300));
    }
    ended.into_iter().flatten().collect()
}

impl Running<'_> {
    /// After the time is over: whether it has worked all of it (on a machine of its own it would not have ended
    /// either), or not at all (it waits for something that does not come). In between others had the processor, and
    /// it may still end.
    fn hangs(&self, start: Instant) -> bool {
        let worked = processor_time(self.child.id()).unwrap_or(TIME);
        start.elapsed() > PATIENCE || worked > TIME || worked < TIME / 100
    }

    fn disturb(&mut self, start: Instant, changed: impl Fn() -> bool) {
        if start.elapsed() > TIME && !self.hung && self.hangs(start) {
            self.hung = true;
            // It may have ended by itself meanwhile.
            let _ = self.child.kill();
        }
        let Some((signal, when)) = self.invocation.signal.filter(|_| self.signalled.is_none()) else { return };
        let due = match when {
            When::After(delay) => start.elapsed() >= delay,
            When::Change(delay) => {
                if self.changed.is_none() && changed() {
                    self.changed = Some(Instant::now());
                }
                self.changed.is_some_and(|at| at.elapsed() >= delay)
            }
        };
        if due && kill_process(Pid::from_child(&self.child), signal).is_ok() {
            self.signalled = Some(signal.as_raw());
        }
    }
}

/// Processor time of a process with all its threads, from Linux's `/proc`; `None` elsewhere.
fn processor_time(process: u32) -> Option<Duration> {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // After the name in parentheses: state, ten fields, then user and system time in hundredths of a second.
    let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    let ticks = fields.next()?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?;
    Some(Duration::from_millis(10 * ticks))
}

fn spawn(program: &Path, folder: &Path, said: &Path, index: usize, invocation: &Invocation) -> Child {
    let mut script = format!("ulimit -c 0; ulimit -v {}; trap '' XFSZ; ", MEMORY / 1024);
    script += &format!("ulimit -f {}; ", invocation.file_limit.unwrap_or(LARGEST_FILE) / FILE_STEP);
    for (sink, number) in [(invocation.stdout, 1), (invocation.stderr, 2)] {
        script += &match sink {
            Sink::Closed => format!("exec {number}>&-; "),
            Sink::Full => format!("exec {number}>/dev/full; "),
            Sink::Kept | Sink::Pipe(_) => String::new(),
        };
    }
    script += "exec \"$0\" \"$@\"";
    let mut command = match invocation.disk_kb {
        None => Command::new("sh"),
        Some(kb) => small_disk(kb),
    };
    command.args(["-c", &script]).arg(program).args(&invocation.arguments);
    command.current_dir(folder).stdin(Stdio::null());
    let file = |name: &str| File::create(said.join(format!("{index}.{name}"))).expect("the campaign's folder");
    command.stdout(if let Sink::Pipe(_) = invocation.stdout { Stdio::piped() } else { file("stdout").into() });
    command.stderr(if let Sink::Pipe(_) = invocation.stderr { Stdio::piped() } else { file("stderr").into() });
    let mut child = command.spawn().expect("sh starts");
    leave_after(child.stdout.take(), invocation.stdout);
    leave_after(child.stderr.take(), invocation.stderr);
    child
}

/// A reader that takes the first bytes of a pipe and leaves.
fn leave_after(pipe: Option<impl Read + Send + 'static>, sink: Sink) {
    if let (Some(mut pipe), Sink::Pipe(bytes)) = (pipe, sink) {
        let mut buffer = vec![0; bytes];
        std::thread::spawn(move || pipe.read_exact(&mut buffer));
    }
}

/// A shell in a name space of its own where the folder `out` is a file system of this size; what the command leaves
/// there is in `out` afterwards.
fn small_disk(kb: u64) -> Command {
    let script = format!(
        "mkdir disk && mount -t tmpfs -o size={kb}k none disk || exit 77; \
         cp -R out/. disk/ 2>&- || exit 77; mkdir under; mount --bind out under; mount --bind disk out; \
         \"$@\"; status=$?; find under -mindepth 1 -delete; cp -R disk/. under/; \
         umount out; umount under; umount disk; rmdir under disk; exit $status"
    );
    let mut command = Command::new("unshare");
    command.args(["--user", "--map-root-user", "--mount", "sh", "-c", &script, "sh", "sh"]);
    command
}

/// Whether this machine lets us make a small disk.
pub fn has_small_disks(folder: &Path) -> bool {
    let made = folder.join("probe");
    let _ = std::fs::create_dir_all(made.join("out"));
    let status = small_disk(64).args(["-c", "echo yes > out/file"]).current_dir(&made).stderr(Stdio::null()).status();
    status.is_ok_and(|status| status.success()) && made.join("out/file").is_file()
}
