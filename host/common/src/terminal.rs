//! What people see in the terminal: aligned tables on stdout, a progress bar on stderr for long work.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::{Duration, Instant};

/// A progress bar that stays unseen for the first second, and always where stderr is no terminal.
#[derive(Debug)]
pub struct Progress {
    bar: ProgressBar,
    started: Instant,
    name: &'static str,
}

impl Progress {
    /// A bar of `steps` steps; nothing is drawn before a second has passed.
    pub fn new(name: &'static str, steps: u64) -> Self {
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::hidden());
        Self { bar, started: Instant::now(), name }
    }

    /// One step further; callable from several threads.
    pub fn step(&self) {
        self.advance(1);
    }

    /// So many steps further.
    pub fn advance(&self, steps: u64) {
        self.bar.inc(steps);
        if self.bar.is_hidden() && self.started.elapsed() > Duration::from_secs(1) {
            if let Ok(style) = ProgressStyle::with_template("{msg:>16} {bar:32} {percent} % {eta} left") {
                self.bar.set_style(style);
            }
            self.bar.set_message(self.name);
            self.bar.set_draw_target(ProgressDrawTarget::stderr());
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// An aligned plain-text table: first column left, the others right; two spaces between.
///
/// Rows shorter than the head are filled with empty cells; names of foreign files are shortened.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let cell = |row: &[String], c: usize| row.get(c).map_or_else(String::new, |text| crate::text::cell(text));
    let width = |c: usize| {
        let rows = rows.iter().map(|row| cell(row, c).chars().count());
        rows.chain([head[c].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: Vec<String>| {
        let text: Vec<String> = cells
            .iter()
            .zip(&widths)
            .enumerate()
            .map(|(c, (cell, &w))| if c == 0 { format!("{cell:<w$}") } else { format!("{cell:>w$}") })
            .collect();
        text.join("  ").trim_end().to_string() + "\n"
    };
    let mut out = line(head.iter().map(|h| h.to_string()).collect());
    for row in rows {
        out.push_str(&line((0..head.len()).map(|c| cell(row, c)).collect()));
    }
    out
}
