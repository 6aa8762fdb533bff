//! Who imports whom in the crates of the host: files of a crate form no circle. Cargo keeps the crates apart.
//!
//! Paths are read from the source as text: `use` trees and paths in code that start with `crate`, `super` or `self`,
//! and in a folder's `mod.rs` those that start with one of its children. Comments and strings do not count. A path
//! belongs to the deepest module it names, so what a `mod.rs` re-exports counts as the `mod.rs`'s own. Limits: among
//! files a folder's `mod.rs`, which names its children by its nature, is no node (between rooms it counts with its
//! folder); macros and glob imports of another room's names are not followed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Path of a module below the crate's root; a folder's own file is the folder.
type Module = Vec<String>;
/// Who names whom, and by which path.
type Graph = BTreeMap<String, BTreeMap<String, String>>;

/// Crates of the host, by their folders.
const CRATES: [&str; 11] = [
    "analysis",
    "common",
    "law",
    "mechanics",
    "model_based",
    "node_side",
    "record",
    "signal",
    "signal_based",
    "train_dynamics",
    "validate",
];

/// Every source file of a crate by its module, comments and strings taken out.
fn sources(of_crate: &str) -> BTreeMap<Module, String> {
    let mut all = BTreeMap::new();
    collect(&Path::new(env!("CARGO_MANIFEST_DIR")).join(of_crate).join("src"), &[], &mut all);
    // The root names every room, and the command is no part of the library.
    all.remove(&vec![]);
    all
}

fn collect(folder: &Path, module: &[String], all: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        let (path, name) = (entry.path(), entry.file_name().into_string().unwrap());
        let mut own = module.to_vec();
        if path.is_dir() {
            own.push(name);
            collect(&path, &own, all);
        } else if let Some(stem) = name.strip_suffix(".rs") {
            if !matches!(stem, "mod" | "lib" | "main") {
                own.push(stem.to_string());
            }
            if stem != "main" {
                all.insert(own, code_of(&fs::read_to_string(&path).unwrap()));
            }
        }
    }
}

/// Source without comments, strings and the unit tests at its end.
fn code_of(source: &str) -> String {
    let source = source.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let mut code = String::new();
    for line in source.lines() {
        let mut in_string = false;
        let mut before = ' ';
        for (at, c) in line.char_indices() {
            match c {
                '"' if before != '\\' && before != '\'' => in_string = !in_string,
                '/' if !in_string && line[at..].starts_with("//") => break,
                c if !in_string => code.push(c),
                _ => {}
            }
            before = c;
        }
        code.push('\n');
    }
    code
}

/// Every path that the code names, `use` trees spread out.
fn paths(code: &str) -> Vec<Vec<String>> {
    let mut all = Vec::new();
    let mut rest = code;
    while let Some(at) = rest.find("use ") {
        let word_before = rest[..at].chars().next_back().is_some_and(|c| c.is_alphanumeric() || c == '_');
        inline_paths(&rest[..at], &mut all);
        let end = rest[at..].find(';').map_or(rest.len(), |n| at + n);
        if !word_before {
            spread(&[], &rest[at + 4..end], &mut all);
        }
        rest = &rest[end..];
    }
    inline_paths(rest, &mut all);
    all
}

fn inline_paths(code: &str, all: &mut Vec<Vec<String>>) {
    let part_of_path = |c: char| !(c.is_alphanumeric() || c == '_' || c == ':');
    for path in code.split(part_of_path).filter(|path| path.contains("::")) {
        all.push(path.split("::").map(str::to_string).collect());
    }
}

fn spread(before: &[String], tree: &str, all: &mut Vec<Vec<String>>) {
    let (head, branches) = match tree.split_once('{') {
        Some((head, rest)) => (head, Some(&rest[..rest.rfind('}').unwrap_or(rest.len())])),
        None => (tree.split(" as ").next().unwrap_or_default(), None),
    };
    let mut path = before.to_vec();
    path.extend(head.split("::").map(str::trim).filter(|part| !part.is_empty()).map(str::to_string));
    let Some(branches) = branches else {
        all.push(path);
        return;
    };
    let (mut depth, mut from) = (0, 0);
    for (at, c) in branches.char_indices() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        if c == ',' && depth == 0 {
            spread(&path, &branches[from..at], all);
            from = at + 1;
        }
    }
    if !branches[from..].trim().is_empty() {
        spread(&path, &branches[from..], all);
    }
}

/// The module that a path named in `from` leads to, if it is one of this crate.
fn target(path: &[String], from: &Module, all: &BTreeMap<Module, String>) -> Option<Module> {
    let mut at = match path[0].as_str() {
        "crate" => vec![],
        "super" | "self" => from.clone(),
        child => {
            let own = [from.as_slice(), &[child.to_string()]].concat();
            return all.contains_key(&own).then(|| deepest(own, &path[1..], all));
        }
    };
    let steps = path.iter().take_while(|part| matches!(part.as_str(), "crate" | "super" | "self")).count();
    for part in &path[..steps] {
        if part == "super" {
            at.pop();
        }
    }
    Some(deepest(at, &path[steps..], all))
}

fn deepest(mut at: Module, path: &[String], all: &BTreeMap<Module, String>) -> Module {
    for part in path {
        at.push(part.clone());
        if !all.contains_key(&at) {
            at.pop();
            break;
        }
    }
    at
}

/// The graph of all modules, each named by `name`; what has no name, or names itself, is left out.
fn graph(all: &BTreeMap<Module, String>, name: impl Fn(&Module) -> Option<String>) -> Graph {
    let mut graph = Graph::new();
    for (from, code) in all {
        let Some(source) = name(from) else { continue };
        for path in paths(code) {
            if let Some(to) = target(&path, from, all).as_ref().and_then(&name)
                && to != source
            {
                let why = format!("{} says {}", from.join("/"), path.join("::"));
                graph.entry(source.clone()).or_default().entry(to).or_insert(why);
            }
        }
    }
    graph
}

/// A circle, as lines that say who names whom.
fn circle(graph: &Graph) -> Option<String> {
    fn walk<'a>(at: &'a str, graph: &'a Graph, trail: &mut Vec<&'a str>, done: &mut BTreeSet<&'a str>) -> bool {
        if trail.contains(&at) {
            trail.push(at);
            return true;
        }
        if done.contains(at) {
            return false;
        }
        trail.push(at);
        for next in graph.get(at).into_iter().flat_map(BTreeMap::keys) {
            if walk(next, graph, trail, done) {
                return true;
            }
        }
        trail.pop();
        done.insert(at);
        false
    }
    let (mut trail, mut done) = (Vec::new(), BTreeSet::new());
    graph.keys().any(|from| walk(from, graph, &mut trail, &mut done)).then(|| {
        let first = trail.iter().position(|at| Some(at) == trail.last()).unwrap_or(0);
        let edges = trail[first..].windows(2);
        edges.map(|edge| format!("  {} -> {}: {}\n", edge[0], edge[1], graph[edge[0]][edge[1]])).collect()
    })
}

#[test]
fn theory_rooms_of_a_crate_import_each_other_in_no_circle() {
    for name in CRATES {
        let rooms = graph(&sources(name), |module| module.first().cloned());
        let found = circle(&rooms);
        assert!(found.is_none(), "rooms of {name} in a circle:\n{}", found.unwrap_or_default());
    }
    assert!(graph(&sources("analysis"), |m| m.first().cloned())["check"].contains_key("observation"));
}

#[test]
fn theory_files_of_a_crate_import_each_other_in_no_circle() {
    for name in CRATES {
        let all = sources(name);
        let folders: BTreeSet<Module> = all.keys().filter_map(|m| m.split_last().map(|(_, up)| up.to_vec())).collect();
        let files = graph(&all, |module| (!folders.contains(module)).then(|| module.join("/")));
        let found = circle(&files);
        assert!(found.is_none(), "files of {name} in a circle:\n{}", found.unwrap_or_default());
    }
    let files = graph(&sources("model_based"), |module| Some(module.join("/")));
    assert!(files["judge"].contains_key("frame"), "the parser sees the imports");
}

/// Names of the constants that a file declares, and whether each is visible elsewhere.
fn constants(code: &str) -> Vec<(String, bool)> {
    let declared = code.lines().filter_map(|line| {
        let public = line.starts_with("pub");
        let rest = line.split_once("const ")?.1;
        let name = rest.split_once(':')?.0;
        line.starts_with("const ").then_some(()).or(public.then_some(()))?;
        Some((name.trim().to_string(), public))
    });
    declared.collect()
}

/// The words of a source.
fn words(code: &str) -> BTreeSet<&str> {
    code.split(|c: char| !(c.is_alphanumeric() || c == '_')).collect()
}

#[test]
fn theory_one_gate_of_the_loop_decides_what_is_adopted() {
    let all = sources("model_based");
    let gate: Module = vec!["accept".to_string()];
    let thresholds = constants(&all[&gate]);
    assert!(thresholds.len() > 15 && thresholds.iter().any(|(name, _)| name == "LARGEST_P"), "{thresholds:?}");
    assert!(thresholds.iter().all(|(_, public)| !public), "a threshold of the gate is nobody else's: {thresholds:?}");
    for (module, code) in all.iter().filter(|(module, _)| **module != gate) {
        // `Adopted` keeps its list private: the compiler holds that nobody else lengthens or shortens it.
        assert!(!code.contains("Refusal::"), "{} makes a refusal", module.join("/"));
        let words = words(code);
        let named: Vec<_> = thresholds.iter().filter(|(name, _)| words.contains(name.as_str())).collect();
        assert!(named.is_empty(), "{} has a threshold of the gate: {named:?}", module.join("/"));
    }
}

#[test]
fn theory_a_circle_is_found_and_shown() {
    let module = |name: &str| vec![name.to_string()];
    let source = |code: &str| code_of(code);
    let all: BTreeMap<Module, String> = [
        (module("a"), source("use crate::b::{self, c::D};\n// use crate::a;\nlet s = \"crate::a::x\";")),
        (module("b"), source("fn f() -> crate::e::Thing {}")),
        (module("e"), source("pub use super::a::S as T;")),
    ]
    .into();
    let found = circle(&graph(&all, |m| Some(m.join("/")))).unwrap();
    for edge in ["a -> b", "b -> e: b says crate::e::Thing", "e -> a: e says super::a::S"] {
        assert!(found.contains(edge), "{found}");
    }
    let open: BTreeMap<Module, String> = all.into_iter().filter(|(m, _)| m[0] != "e").collect();
    assert!(circle(&graph(&open, |m| Some(m.join("/")))).is_none());
}
