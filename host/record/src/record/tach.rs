//! Tachometer edge files: CSV with the header `edge_time_s`, one edge per line, seconds from the first sample.

use crate::budget::{self, EDGES};
use crate::{Error, Result, text};
use std::path::Path;

/// Reads edge times, s.
///
/// # Errors
/// A missing file, wrong header, text that is no number, NaN or infinity, fewer than two edges (no speed can
/// be had from one), times that do not strictly ascend, or more edges than the [`budget`]; file and line are named.
pub fn read_edges(path: &Path) -> Result<Vec<f64>> {
    let content = budget::read_text(path)?;
    let refuse = |line: usize, what: String| Err(Error::invalid(format!("{}:{line}", path.display()), what));
    let mut lines = content.lines().enumerate();
    match lines.next() {
        Some((_, header)) if header.trim() == "edge_time_s" => {}
        _ => return refuse(1, "the header must be edge_time_s".into()),
    }
    let mut edges: Vec<f64> = Vec::new();
    for (i, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let edge: f64 = match line.trim().parse() {
            Ok(edge) => edge,
            Err(_) => return refuse(i + 1, format!("{} is not a time in seconds", text::quoted(line))),
        };
        if !edge.is_finite() {
            return refuse(i + 1, format!("edge time is {edge}"));
        }
        if let Some(before) = edges.last().filter(|before| **before >= edge) {
            return refuse(i + 1, format!("edge at {edge} s does not come after the one at {before} s"));
        }
        edges.push(edge);
        EDGES.check(path.display(), edges.len() as f64, "cut the run into parts")?;
    }
    match edges.len() {
        0 => Err(Error::invalid(path.display(), "has no tach edges")),
        1 => Err(Error::invalid(path.display(), "has one tach edge; a speed needs at least two")),
        _ => Ok(edges),
    }
}

/// The text of an edge file, with nanosecond resolution.
pub fn edges_text(edges_s: &[f64]) -> String {
    let mut text = String::from("edge_time_s\n");
    for edge in edges_s {
        text.push_str(&format!("{edge:.9}\n"));
    }
    text
}
