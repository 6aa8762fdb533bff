//! Reports: one self-contained HTML file per command for people, one JSON file for machines.
//!
//! No scripts, no outside resources: the file can be mailed, printed or archived. Pictures are inline SVG
//! with text as text, so they stay sharp and searchable, and marks say their values under the pointer. Colours are
//! the Okabe-Ito set, told apart with any common colour vision deficiency. Dark screens get dark pages: the style
//! repaints ink, grid and paper of the pictures by their colours; paper stays white in print.

pub mod advice;
pub mod facts;
pub mod glossary;
mod hover;
pub mod letter;
pub mod owners;
pub mod plot;
mod raster;

use glossary::explained;
use std::fmt::Write;

/// A report under construction; methods chain.
#[derive(Debug, Clone, Default)]
pub struct Report {
    title: String,
    subtitle: String,
    /// Sentences at the top: what was found, how sure, what to do.
    verdict: Vec<String>,
    summary: Vec<(String, String)>,
    body: String,
    /// An appendix has begun: details that a print leaves out.
    in_appendix: bool,
    facts: facts::Facts,
}

impl Report {
    /// A report with a title and one line below it.
    pub fn new(title: &str, subtitle: &str) -> Self {
        Self { title: title.into(), subtitle: subtitle.into(), ..Self::default() }
    }

    /// The answer in plain sentences, above everything else.
    pub fn verdict(mut self, sentences: impl IntoIterator<Item = impl Into<String>>) -> Self {
        self.verdict.extend(sentences.into_iter().map(Into::into));
        self
    }

    /// What the page rests on, at its foot.
    pub fn facts(mut self, facts: facts::Facts) -> Self {
        self.facts.extend(facts);
        self
    }

    /// Starts the part that is for who wants every figure: it can be folded away, and a print leaves it out.
    pub fn appendix(mut self, heading: &str) -> Self {
        if !std::mem::replace(&mut self.in_appendix, true) {
            let _ = writeln!(self.body, "<p class=\"printed\">{heading}: in the file, on the screen.</p>");
            let _ = writeln!(self.body, "<details open class=\"more\"><summary>{}</summary>", escape(heading));
        }
        self
    }

    /// Adds a key figure to the summary at the top.
    pub fn figure(mut self, name: &str, value: impl std::fmt::Display) -> Self {
        self.summary.push((name.into(), value.to_string()));
        self
    }

    /// Starts a section.
    pub fn section(mut self, heading: &str) -> Self {
        let _ = writeln!(self.body, "<h2>{}</h2>", escape(heading));
        self
    }

    /// Adds a paragraph.
    pub fn text(mut self, text: &str) -> Self {
        let _ = writeln!(self.body, "<p>{}</p>", escape(text));
        self
    }

    /// Adds a set-off note: limits, warnings, how to read the picture.
    pub fn note(mut self, text: &str) -> Self {
        let _ = writeln!(self.body, "<aside>{}</aside>", escape(text));
        self
    }

    /// Adds a table; numbers are aligned right in columns that hold hardly anything else.
    pub fn table(mut self, caption: &str, head: &[&str], rows: &[Vec<String>]) -> Self {
        let _ = write!(self.body, "<div class=\"scroll\"><table><caption>{}</caption><thead><tr>", explained(caption));
        let numeric = |c: usize| {
            let numbers = rows.iter().filter(|row| row.get(c).is_some_and(|cell| is_number(cell))).count();
            4 * numbers >= 3 * rows.len() && numbers > 0
        };
        for (c, cell) in head.iter().enumerate() {
            let class = if numeric(c) { " class=\"n\"" } else { "" };
            let _ = write!(self.body, "<th{class}>{}</th>", explained(cell));
        }
        self.body.push_str("</tr></thead><tbody>\n");
        for row in rows {
            self.body.push_str("<tr>");
            for (c, cell) in row.iter().enumerate() {
                let class = if numeric(c) && is_number(cell) { " class=\"n\"" } else { "" };
                let cell = if c == 0 { explained(cell) } else { escape(cell) };
                let _ = write!(self.body, "<td{class}>{cell}</td>");
            }
            self.body.push_str("</tr>\n");
        }
        self.body.push_str("</tbody></table></div>\n");
        self
    }

    /// Adds a picture (SVG text from [`plot`]) with its caption.
    pub fn picture(mut self, svg: &str, caption: &str) -> Self {
        let _ = writeln!(self.body, "<figure>{svg}<figcaption>{}</figcaption></figure>", explained(caption));
        self
    }

    /// The whole document.
    pub fn html(&self) -> String {
        let mut summary = String::new();
        for (name, value) in &self.summary {
            let _ = writeln!(summary, "<div><dt>{}</dt><dd>{}</dd></div>", explained(name), escape(value));
        }
        let mut verdict = String::new();
        for sentence in &self.verdict {
            let _ = writeln!(verdict, "<p>{}</p>", escape(sentence));
        }
        if !verdict.is_empty() {
            verdict = format!("<section class=\"verdict\">\n{verdict}</section>\n");
        }
        if !summary.is_empty() {
            summary = format!("<dl>\n{summary}</dl>\n");
        }
        let end = if self.in_appendix { "</details>\n" } else { "" };
        let title = escape(&self.title);
        format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>{STYLE}</style></head>\n<body><main>\n\
             <header><p class=\"mark\">meshband</p><h1>{title}</h1><p class=\"sub\">{}</p></header>\n\
             {verdict}{summary}{}{end}{}</main></body></html>\n",
            escape(&self.subtitle),
            self.body,
            self.foot(),
        )
    }

    /// What the page rests on, then command and version.
    fn foot(&self) -> String {
        let mut rows = String::new();
        let own = facts::command().map(|command| ("command".to_owned(), command.to_owned()));
        for (name, value) in self.facts.iter().chain(&own) {
            let _ = writeln!(rows, "<tr><th>{}</th><td>{}</td></tr>", escape(name), escape(value));
        }
        let table = if rows.is_empty() { rows } else { format!("<table>{rows}</table>") };
        format!("<footer>{table}meshband {}</footer>\n", env!("CARGO_PKG_VERSION"))
    }
}

impl From<Report> for String {
    fn from(report: Report) -> Self {
        report.html()
    }
}

/// Text made safe for HTML and SVG.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn is_number(cell: &str) -> bool {
    let cell = cell.trim().trim_end_matches('%').trim();
    cell.is_empty() || cell == "-" || cell.parse::<f64>().is_ok()
}

const STYLE: &str = "
:root{color-scheme:light dark;--paper:#fff;--ink:#1b1f24;--soft:#59636e;--line:#d5dae0;--wash:#f5f7f9;
--mark:#0072b2;--note:#fdf8ec}
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);
font:16px/1.55 system-ui,-apple-system,'Segoe UI',Roboto,'Liberation Sans',sans-serif}
main{max-width:62rem;margin:0 auto;padding:2.5rem 1.5rem}
header{border-bottom:3px solid var(--mark);margin-bottom:1.5rem;padding-bottom:.8rem}
.mark{margin:0;color:var(--mark);font-weight:600;letter-spacing:.08em;font-size:.8rem;text-transform:uppercase}
h1{margin:.1rem 0 .2rem;font-size:1.9rem;line-height:1.2;letter-spacing:-.01em}
.sub{margin:0;color:var(--soft)}
h2{margin:2.4rem 0 .6rem;font-size:1.25rem;line-height:1.3}
p{max-width:46rem;margin:.6rem 0}
dl{display:grid;grid-template-columns:repeat(auto-fill,minmax(11.5rem,1fr));gap:.75rem;margin:0 0 1rem}
dl div{background:var(--wash);border-radius:6px;padding:.65rem .85rem}
dt{color:var(--soft);font-size:.8rem}
dd{margin:0;font-size:1.15rem;font-weight:600;font-variant-numeric:tabular-nums;overflow-wrap:anywhere}
.scroll{overflow-x:auto;margin:1rem 0}
table{border-collapse:collapse;font-size:.92rem;font-variant-numeric:tabular-nums;min-width:50%}
caption{text-align:left;color:var(--soft);font-size:.88rem;padding-bottom:.35rem}
th,td{padding:.32rem .9rem .32rem 0;text-align:left;border-bottom:1px solid var(--line);vertical-align:top}
th{border-bottom:2px solid var(--ink);font-weight:600}
.n{text-align:right}td.n{white-space:nowrap}
figure{margin:1.2rem 0}
figure svg{width:100%;height:auto;display:block}
figcaption{color:var(--soft);font-size:.88rem;max-width:46rem}
.verdict{border-left:4px solid var(--mark);background:var(--wash);padding:.7rem 1.1rem;margin:0 0 1.4rem;
border-radius:0 6px 6px 0;font-size:1.08rem}
.verdict p{max-width:52rem;margin:.45rem 0}
abbr{text-decoration:underline dotted var(--soft);text-underline-offset:.2em;cursor:help}
details>summary{cursor:pointer;font-size:1.25rem;font-weight:600;margin-top:2.4rem}
.printed{display:none}
aside{border-left:4px solid #e69f00;background:var(--note);padding:.6rem .9rem;margin:1rem 0;
border-radius:0 6px 6px 0;max-width:46rem}
footer table{font-size:.8rem;margin-bottom:.8rem}footer th{border:0;font-weight:400;white-space:nowrap}footer \
td{border:0;overflow-wrap:anywhere}footer th,footer td{padding:.1rem 1rem .1rem 0}
footer{margin-top:3rem;color:var(--soft);font-size:.8rem;border-top:1px solid var(--line);padding-top:.6rem}
@media screen and (prefers-color-scheme:dark){
:root{--paper:#14181d;--ink:#e4e8ec;--soft:#9aa5b1;--line:#343b44;--wash:#1e242b;--mark:#56b4e9;--note:#2a2416}
svg [fill=\"#1B1F24\"]{fill:var(--ink)}svg [stroke=\"#1B1F24\"]{stroke:var(--ink)}
svg [stroke=\"#E2E6EB\"]{stroke:#2a313a}svg [fill=\"#FFFFFF\"]{fill:var(--paper)}
svg :is(polyline,path,circle,line)[stroke=\"#0072B2\"]{stroke:#3d9fdb}svg circle[fill=\"#0072B2\"]{fill:#3d9fdb}
}
@media print{@page{margin:14mm}.more{display:none}.printed{display:block;color:var(--soft)}
abbr{text-decoration:none}figure svg{max-height:95mm}h2{margin-top:1.2rem}main{max-width:none;padding:0}
h2{break-after:avoid}figure,table,aside,dl div{break-inside:avoid}body{font-size:10pt}}
";
