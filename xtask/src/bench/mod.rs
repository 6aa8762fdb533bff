//! `cargo xtask bench`: what the tools cost, beside peers on the same machine in the same run, into
//! `target/benchmarks.md`.
//!
//! Processor time throughout: on a shared machine the wall clock measures the neighbours. Ratios come first, because
//! they survive a change of machine; a slow or busy machine slows both sides. The peers need Python packages
//! ([`peers`]).

mod commands;
mod kernels;
pub mod node;
mod peers;

use crate::shell::{Outcome, TemporaryFolder, capture, command, programs, root, say};
use std::fmt::Write;

/// `--without-ross` leaves out the peer whose installation is large.
pub fn run_task(args: &[String]) -> Outcome {
    let with_ross = match args {
        [] => true,
        [only] if only == "--without-ross" => false,
        _ => return Err("bench takes nothing or --without-ross".into()),
    };
    let folder = TemporaryFolder::new("bench")?;
    let python = peers::python(with_ross)?;
    let [program] = programs(["meshband"])?;
    let kernels = kernels::measure()?;
    let scipy = peers::scipy(&python)?;
    let ross = if with_ross { Some(peers::ross_s(&python, &program)?) } else { None };
    let mut page = String::from(HEAD);
    page.push_str(&machine());
    page.push_str(&kernels::table(&kernels, &scipy, ross));
    page.push_str(&commands::table(&python, &program, &folder.0)?);
    page.push_str(&node::page()?);
    let path = root().join("target/benchmarks.md");
    std::fs::write(&path, &page).map_err(|e| format!("{}: {e}", path.display()))?;
    print!("{page}");
    say(format_args!("written: {}", path.display()));
    Ok(())
}

const HEAD: &str = "\
# Benchmarks

Written by `cargo xtask bench`, which measures everything here one after the other on one machine. Times are \
processor time,
one thread unless said otherwise; peers run in the same minutes on the same machine, so ratios say more than seconds.

";

/// The machine, the date and the compiler, as a list.
fn machine() -> String {
    let file = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let field = |text: &str, name: &str| {
        let line = text.lines().find(|line| line.starts_with(name)).unwrap_or_default();
        line.split(':').nth(1).unwrap_or("unknown").trim().to_owned()
    };
    let cpu = file("/proc/cpuinfo");
    let said = |words: &[&str]| capture(&mut command(words)).map(|text| text.trim().to_owned()).unwrap_or_default();
    let load = file("/proc/loadavg");
    let mut text = String::new();
    let cores = cpu.lines().filter(|line| line.starts_with("processor")).count();
    let _ = writeln!(
        text,
        "* {} x {}, family {} model {}",
        cores,
        field(&cpu, "model name"),
        field(&cpu, "cpu family"),
        field(&cpu, "model")
    );
    let _ = writeln!(
        text,
        "* memory {}, load at the start {}",
        field(&file("/proc/meminfo"), "MemTotal"),
        load.split(' ').next().unwrap_or_default()
    );
    let _ = writeln!(
        text,
        "* {}; {}; {}",
        said(&["date", "-u", "+%Y-%m-%d"]),
        said(&["uname", "-srm"]),
        said(&["rustc", "--version"])
    );
    text
}
