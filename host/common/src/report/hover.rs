//! Values under the pointer: titles of invisible circles on a picture's marks. No script is needed for them, so they
//! survive mailing and archives.

use super::escape;
use std::fmt::Write;

/// Most marks of a picture that get one: beyond it they would lie on each other and only make the file large.
const MAX_MARKS: usize = 400;

/// Marks with what is said of them.
#[derive(Default)]
pub(super) struct Hover(Vec<((i32, i32), String)>);

impl Hover {
    /// A mark at a place of the picture.
    pub fn add(&mut self, at: (i32, i32), text: String) {
        self.0.push((at, text));
    }

    /// The picture with its marks' titles.
    pub fn onto(&self, mut svg: String) -> String {
        if self.0.len() > MAX_MARKS || !svg.trim_end().ends_with("</svg>") {
            return svg;
        }
        svg.truncate(svg.trim_end().len() - "</svg>".len());
        for ((x, y), text) in &self.0 {
            let _ = writeln!(
                svg,
                "<circle cx=\"{x}\" cy=\"{y}\" r=\"7\" fill=\"none\" pointer-events=\"all\"><title>{}</title></circle>",
                escape(text)
            );
        }
        svg + "</svg>"
    }
}
