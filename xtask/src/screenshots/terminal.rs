//! A terminal's screen as SVG text: what tmux captured with its colours, cell by cell.
//!
//! Text stays text, so the pictures are small and sharp. Every run of equal style is set to its exact width: fonts
//! differ in theirs.

use std::fmt::Write;

const CELL: (f64, f64) = (7.8, 16.0);
/// The eight colours of a terminal, then their bright ones.
const COLOURS: [&str; 16] = [
    "#0c1014", "#e0524a", "#3fb26a", "#d9a331", "#4a8fe0", "#b673c8", "#35a9b8", "#d5dae0", "#6c7783", "#ff7b72",
    "#56d364", "#e3b341", "#79c0ff", "#d2a8ff", "#56d4dd", "#ffffff",
];
const INK: &str = "#d5dae0";
const PAPER: &str = "#14181d";

#[derive(Clone, Copy, PartialEq, Default)]
struct Style {
    ink: Option<usize>,
    paper: Option<usize>,
    bold: bool,
    dim: bool,
    reversed: bool,
}

/// `screen` as `tmux capture-pane -e -p` gives it.
pub fn svg(screen: &str, columns: usize, rows: usize) -> String {
    let (width, height) = (CELL.0 * columns as f64 + 16.0, CELL.1 * rows as f64 + 16.0);
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width:.0} {height:.0}\" font-family=\"'DejaVu Sans \
         Mono',Menlo,Consolas,monospace\" \
         font-size=\"13\">\n<rect width=\"100%\" height=\"100%\" rx=\"6\" fill=\"{PAPER}\"/>\n"
    );
    let mut style = Style::default();
    for (row, line) in screen.lines().take(rows).enumerate() {
        let mut column = 0;
        for (text, style) in runs(line, &mut style) {
            draw(&mut out, &text, style, (column, row));
            column += text.chars().count();
        }
    }
    out + "</svg>\n"
}

/// Texts of one style; the style at the end carries over to the next line.
fn runs(line: &str, style: &mut Style) -> Vec<(String, Style)> {
    let mut out: Vec<(String, Style)> = Vec::new();
    let mut rest = line;
    while !rest.is_empty() {
        let (text, after) = rest.split_once('\u{1b}').map_or((rest, None), |(text, after)| (text, Some(after)));
        if !text.is_empty() {
            out.push((text.to_owned(), *style));
        }
        rest = after.map_or("", |after| {
            // "[1;32m"; other sequences do not occur in a capture.
            let Some((codes, after)) = after.strip_prefix('[').and_then(|after| after.split_once('m')) else {
                return after;
            };
            *style = changed(*style, codes);
            after
        });
    }
    out
}

fn changed(mut style: Style, codes: &str) -> Style {
    let mut codes = codes.split(';').map(|code| code.parse::<usize>().unwrap_or(0));
    while let Some(code) = codes.next() {
        match code {
            0 => style = Style::default(),
            1 => style.bold = true,
            2 => style.dim = true,
            7 => style.reversed = true,
            22 => (style.bold, style.dim) = (false, false),
            27 => style.reversed = false,
            30..=37 => style.ink = Some(code - 30),
            39 => style.ink = None,
            40..=47 => style.paper = Some(code - 40),
            49 => style.paper = None,
            90..=97 => style.ink = Some(code - 82),
            100..=107 => style.paper = Some(code - 92),
            // 38;5;N and 48;5;N: one of the sixteen.
            38 | 48 => {
                let colour = codes.nth(1).filter(|&n| n < COLOURS.len());
                if code == 38 { style.ink = colour } else { style.paper = colour }
            }
            _ => {}
        }
    }
    style
}

fn draw(out: &mut String, text: &str, style: Style, (column, row): (usize, usize)) {
    let colour = |index: Option<usize>, otherwise| index.map_or(otherwise, |i| COLOURS[i]);
    let (mut ink, mut paper) = (colour(style.ink, INK), style.paper.map(|i| COLOURS[i]));
    if style.reversed {
        (ink, paper) = (paper.unwrap_or(PAPER), Some(ink));
    }
    let count = text.chars().count() as f64;
    let (x, y) = (8.0 + CELL.0 * column as f64, 8.0 + CELL.1 * row as f64);
    if let Some(paper) = paper {
        let _ = writeln!(
            out,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{}\" fill=\"{paper}\"/>",
            CELL.0 * count,
            CELL.1
        );
    }
    if text.trim().is_empty() {
        return;
    }
    let bold = if style.bold { " font-weight=\"bold\"" } else { "" };
    let dim = if style.dim { " opacity=\"0.6\"" } else { "" };
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let _ = writeln!(
        out,
        "<text x=\"{x:.1}\" y=\"{:.1}\" textLength=\"{:.1}\" lengthAdjust=\"spacingAndGlyphs\" \
         xml:space=\"preserve\" fill=\"{ink}\"{bold}{dim}>{text}</text>",
        y + 12.0,
        CELL.0 * count
    );
}
