//! The documents hold together: every page is reachable, every relative link leads somewhere, sizes stay bounded.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Words of all Markdown in the repository at most.
const MAX_WORDS: usize = 45_000;
/// Bytes of `docs` and `book` together at most.
const MAX_BYTES: u64 = 2_500_000;
/// Columns of a Rust line at most; rustfmt leaves comments and strings alone.
const MAX_COLUMNS: usize = 120;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Files below a folder with an ending, build results left out.
fn files(folder: &Path, ending: &str, all: &mut Vec<PathBuf>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.flatten().map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            if !name.starts_with('.') && !matches!(name.as_str(), "target" | "demo-out" | "node_modules" | "venv") {
                files(&path, ending, all);
            }
        } else if name.ends_with(ending) {
            all.push(path);
        }
    }
}

fn markdown() -> Vec<PathBuf> {
    let mut all = Vec::new();
    files(&root(), ".md", &mut all);
    all
}

/// Targets of the links in a page, code left out.
fn links(text: &str) -> Vec<String> {
    let mut all = Vec::new();
    let mut in_fence = false;
    for line in text.lines() {
        in_fence ^= line.trim_start().starts_with("```");
        if in_fence {
            continue;
        }
        let plain: String = line.split('`').step_by(2).collect::<Vec<_>>().join("");
        let mut rest = plain.as_str();
        while let Some(at) = rest.find("](") {
            rest = &rest[at + 2..];
            if let Some(end) = rest.find(')') {
                all.push(rest[..end].split_whitespace().next().unwrap_or_default().to_owned());
            }
        }
    }
    all
}

fn is_relative(link: &str) -> bool {
    !link.is_empty() && !link.starts_with('#') && !link.contains("://") && !link.starts_with("mailto:")
}

fn target(page: &Path, link: &str) -> PathBuf {
    page.parent().unwrap_or(Path::new("")).join(link.split('#').next().unwrap_or(link))
}

#[test]
fn theory_no_page_is_empty() {
    let empty: Vec<PathBuf> = markdown()
        .into_iter()
        .filter(|page| fs::read_to_string(page).is_ok_and(|text| text.trim().is_empty()))
        .collect();
    assert!(empty.is_empty(), "empty pages: {empty:?}");
}

#[test]
fn theory_every_relative_link_leads_to_a_file() {
    let mut broken = Vec::new();
    for page in markdown() {
        let text = fs::read_to_string(&page).expect("a readable page");
        for link in links(&text).iter().filter(|link| is_relative(link)) {
            if !target(&page, link).exists() {
                broken.push(format!("{}: {link}", page.display()));
            }
        }
    }
    assert!(broken.is_empty(), "broken links:\n{}", broken.join("\n"));
}

#[test]
fn theory_every_page_of_the_book_is_in_its_summary() {
    let source = root().join("book/src");
    let summary = source.join("SUMMARY.md");
    let listed: BTreeSet<PathBuf> = links(&fs::read_to_string(&summary).expect("the summary"))
        .iter()
        .filter_map(|link| target(&summary, link).canonicalize().ok())
        .collect();
    let mut pages = Vec::new();
    files(&source, ".md", &mut pages);
    let missing: Vec<_> =
        pages.iter().filter(|page| **page != summary && !listed.contains(&page.canonicalize().unwrap())).collect();
    assert!(listed.len() > 20, "the summary is read: {} pages", listed.len());
    assert!(missing.is_empty(), "pages that the summary does not list: {missing:?}");
}

#[test]
fn theory_documents_stay_within_their_size() {
    // Borders of tables are no words.
    let is_word = |token: &&str| token.contains(char::is_alphanumeric);
    let of = |page: &PathBuf| fs::read_to_string(page).unwrap_or_default().split_whitespace().filter(is_word).count();
    let words: usize = markdown().iter().map(of).sum();
    println!("{words} words");
    assert!(words <= MAX_WORDS, "{words} words of Markdown");
    let mut all = Vec::new();
    ["docs", "book"].iter().for_each(|folder| files(&root().join(folder), "", &mut all));
    let bytes: u64 = all.iter().filter_map(|path| path.metadata().ok()).map(|about| about.len()).sum();
    assert!(bytes <= MAX_BYTES, "{bytes} bytes in docs and book");
}

#[test]
fn theory_no_rust_line_is_wider_than_the_page() {
    let mut sources = Vec::new();
    files(&root(), ".rs", &mut sources);
    let mut wide = Vec::new();
    for source in &sources {
        let text = fs::read_to_string(source).expect("readable source");
        let lines = text.lines().enumerate().filter(|(_, line)| line.chars().count() > MAX_COLUMNS);
        wide.extend(lines.map(|(n, _)| format!("{}:{}", source.display(), n + 1)));
    }
    assert!(sources.len() > 500, "the sources are found");
    assert!(wide.is_empty(), "{} lines over {MAX_COLUMNS} columns:\n{}", wide.len(), wide.join("\n"));
}
