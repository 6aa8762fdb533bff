//! `cargo xtask screenshots`: a picture of each main thing, into `book/src/pictures`.
//!
//! Reports of the commands on one simulated and one imported record through headless Chromium, light and one of them
//! dark; the live view through tmux at 80x24 and 200x60 with a virtual node behind it. Pictures show what the
//! commands make at this commit: nothing is drawn by hand. `MESHBAND_COMMAND` names a command that is built already.
//! Without Chromium, tmux, QEMU or the firmware image that part is said and left as it was.

mod terminal;

use crate::shell::{Outcome, TemporaryFolder, capture, command, on_path, programs, root, say, timed};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Largest picture, bytes.
const MAX_PICTURE_BYTES: u64 = 150_000;
/// How long the live view may take to show what it is to show.
const PATIENCE: Duration = Duration::from_secs(120);

/// Makes them all, or only those whose names are given.
pub fn run_task(names: &[String]) -> Outcome {
    if given().is_none() {
        programs(["meshband"])?;
    }
    let folder = TemporaryFolder::new("screenshots")?;
    let pictures = root().join("book/src/pictures");
    std::fs::create_dir_all(&pictures).map_err(|e| format!("{}: {e}", pictures.display()))?;
    let wanted = |name: &str| names.is_empty() || names.iter().any(|wanted| wanted == name);
    if wanted("monitor") {
        timed("live view", || monitor(&folder.0, &pictures))?;
    }
    let browser =
        ["chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"].into_iter().find_map(on_path);
    let Some(browser) = browser else {
        say("no headless chromium: pictures of reports stay as they are");
        return Ok(());
    };
    for page in PAGES.iter().filter(|page| wanted(page.name)) {
        timed(page.name, || page.take(&browser, &folder.0, &pictures))?;
    }
    Ok(())
}

/// A report to be shown.
struct Page {
    name: &'static str,
    /// Commands that come first, words separated by blanks; `MACHINE` is the 17/38 pair.
    before: &'static [&'static str],
    /// The command that makes the report.
    words: &'static str,
    height: u32,
    dark: bool,
}

const RECORD: &str = "simulate MACHINE --speed 20 --torque 10 --duration 6 --rate 51200 --noise 0.02 --pulses 8 \
    --effect eccentricity:amplitude=20e-6 -o record";
const IMPORT_COMMAND: &str = "import record/run00.npy --rate 51200 --teeth 17,38 --mesh 340 -o own";

const PAGES: [Page; 8] = [
    Page { name: "stiffness", before: &[], words: "stiffness MACHINE", height: 1150, dark: false },
    Page { name: "machine-check", before: &[], words: "machine check MACHINE", height: 900, dark: false },
    Page { name: "law", before: &[], words: "law fit MACHINE -o law.toml", height: 1500, dark: true },
    Page { name: "analyse", before: &[RECORD], words: "analyse record", height: 1350, dark: false },
    Page {
        name: "import",
        before: &[RECORD],
        words: "import record/run00.npy --rate 51200 --teeth 17,38 --mesh 340 -o own",
        height: 1300,
        dark: false,
    },
    Page { name: "loop-kinematic", before: &[RECORD, IMPORT_COMMAND], words: "loop own", height: 1300, dark: false },
    Page { name: "loop-dynamic", before: &[SPEEDS], words: "loop three", height: 1350, dark: false },
    Page {
        name: "node",
        before: &[],
        words: "node MACHINE --duration 4 --effect eccentricity:amplitude=20e-6",
        height: 1500,
        dark: false,
    },
];
const SOUND: &str =
    "simulate MACHINE --speed 30,40,50 --torque 10 --duration 6 --rate 51200 --noise 0.02 --pulses 8 -o sound";
const SPEEDS: &str = "simulate MACHINE --speed 14,17,20 --torque 10 --duration 2 --rate 51200 --noise 0.02 --pulses \
    8 --effect eccentricity:amplitude=20e-6 -o three";

impl Page {
    fn take(&self, browser: &Path, folder: &Path, pictures: &Path) -> Outcome {
        self.before.iter().try_for_each(|words| {
            let made = words.rsplit(' ').next().unwrap_or_default();
            if folder.join(made).exists() { Ok(()) } else { capture(meshband(folder, words).arg("--force")).map(drop) }
        })?;
        let report = folder.join(format!("{}.html", self.name));
        capture(meshband(folder, self.words).arg("--force").arg("--report").arg(&report))?;
        let mut kinds = vec![(self.name.to_owned(), "1")];
        if self.dark {
            kinds.push((format!("{}-dark", self.name), "0"));
        }
        for (name, scheme) in kinds {
            let picture = pictures.join(format!("{name}.png"));
            let mut browse = Command::new(browser);
            browse.args(["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]);
            browse.arg(format!("--blink-settings=preferredColorScheme={scheme}"));
            browse.arg(format!("--window-size=1000,{}", self.height)).arg("--force-device-scale-factor=0.8");
            browse.arg(format!("--screenshot={}", picture.display())).arg(format!("file://{}", report.display()));
            capture(&mut browse)?;
            small_enough(&picture)?;
        }
        Ok(())
    }
}

/// The command in a folder, `MACHINE` replaced by the 17/38 pair's file.
fn meshband(folder: &Path, words: &str) -> Command {
    let machine = root().join("machines/17-38.toml").display().to_string();
    let mut command = Command::new(program());
    let words = words.split(' ').map(|word| if word == "MACHINE" { machine.clone() } else { word.to_owned() });
    command.args(words).current_dir(folder);
    command
}

fn program() -> PathBuf {
    given().unwrap_or_else(|| root().join("target/release/meshband"))
}

/// A command that is built already, as the Python tests take it.
fn given() -> Option<PathBuf> {
    std::env::var_os("MESHBAND_COMMAND").map(PathBuf::from)
}

fn small_enough(picture: &Path) -> Outcome {
    let size = std::fs::metadata(picture).map_err(|e| format!("{}: {e}", picture.display()))?.len();
    if size > MAX_PICTURE_BYTES {
        return Err(format!("{}: {size} bytes, more than {MAX_PICTURE_BYTES}", picture.display()));
    }
    say(format!("{}: {} KB", picture.display(), size / 1000));
    Ok(())
}

/// A program that ends with its owner.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The live view of a virtual node at both sizes.
fn monitor(folder: &Path, pictures: &Path) -> Outcome {
    if on_path("tmux").is_none() {
        say("no tmux: pictures of the live view stay as they are");
        return Ok(());
    }
    let (_node, port) = virtual_node(folder)?;
    expect_levels(folder, &port)?;
    let socket = format!("meshband-{}", std::process::id());
    let tmux = |words: &[&str]| capture(command(&["tmux", "-L", &socket]).args(words));
    let shown = format!("{} monitor tcp:127.0.0.1:{port} --record run.link", program().display());
    let place = folder.display().to_string();
    tmux(&["new-session", "-d", "-x", "80", "-y", "24", "-c", &place, &shown])?;
    let outcome = [(80, 24), (200, 60)].iter().try_for_each(|&(columns, rows): &(usize, usize)| {
        tmux(&["resize-window", "-x", &columns.to_string(), "-y", &rows.to_string()])?;
        let screen = until(|| tmux(&["capture-pane", "-e", "-p"]))?;
        let picture = pictures.join(format!("monitor-{columns}x{rows}.svg"));
        std::fs::write(&picture, terminal::svg(&screen, columns, rows))
            .map_err(|e| format!("{}: {e}", picture.display()))?;
        small_enough(&picture)
    });
    let _ = tmux(&["kill-server"]);
    outcome
}

/// The node expects the levels that it has on a record of the same machine at three speeds about that of the loop.
fn expect_levels(folder: &Path, port: &str) -> Outcome {
    capture(&mut meshband(folder, SOUND))?;
    capture(&mut meshband(folder, "levels learn sound -o levels.toml"))?;
    capture(meshband(folder, "configure").arg(format!("tcp:127.0.0.1:{port}")).args(["--settings", "levels.toml"]))
        .map(drop)
}

/// Waits until the view has measured for a while: mesh bands, values of an average, a trend.
fn until(mut screen: impl FnMut() -> Outcome<String>) -> Outcome<String> {
    let start = Instant::now();
    loop {
        std::thread::sleep(Duration::from_secs(3));
        let now = screen()?;
        let whole = ["MEASURING", "1x ", "RMS, m/s2", "FM4", "departure"].iter().all(|part| now.contains(part));
        if whole && start.elapsed() > Duration::from_secs(25) {
            return Ok(now);
        }
        if start.elapsed() > PATIENCE {
            return Err(format!("the live view does not measure:\n{now}"));
        }
    }
}

/// A node on the machine's looped signal, and its port: said once the signal is simulated and the port is open.
fn virtual_node(folder: &Path) -> Outcome<(Running, String)> {
    let mut node = meshband(folder, "node --serve tcp:127.0.0.1:0 --duration 4 --second gear --loop MACHINE");
    let mut node = Running(node.stdout(Stdio::piped()).spawn().map_err(|e| format!("the node: {e}"))?);
    let mut line = String::new();
    let out = node.0.stdout.take().ok_or("the node has no output")?;
    BufReader::new(out).read_line(&mut line).map_err(|e| format!("the node: {e}"))?;
    let port = line.split("tcp:127.0.0.1:").nth(1).and_then(|rest| rest.split(',').next());
    let port = port.ok_or_else(|| format!("no port in '{line}'"))?.to_owned();
    Ok((node, port))
}
