//! The order of the modules: each uses only those above it, so that the data flow can be read from the list.

use std::fs;
use std::path::{Path, PathBuf};

/// The library's modules in the order of the data flow (docs/architecture.md). `probe` holds the words in which results
/// are told, `wbsdf` is physics without geometry.
const ORDER: [&str; 13] = [
    "error", "scene", "probe", "geometry", "wbsdf", "paths", "plan", "trace", "response", "simulate", "sweep",
    "report", "verify",
];

/// Source files longer than this have two subjects.
const MOST_LINES: usize = 600;

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()) {
        if entry.is_dir() {
            sources(&entry, found);
        } else if entry.extension().is_some_and(|e| e == "rs") {
            found.push(entry);
        }
    }
}

/// Module of a file of src/, `None` for lib.rs and the files of the program.
fn module(file: &Path, src: &Path) -> Option<usize> {
    let first = file.strip_prefix(src).unwrap().components().next().unwrap();
    let name = first.as_os_str().to_str().unwrap().trim_end_matches(".rs");
    ORDER.iter().position(|m| *m == name)
}

#[test]
fn a_module_uses_only_modules_above_it() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&src, &mut files);
    assert!(files.len() > 40);
    let mut wrong = Vec::new();
    for file in &files {
        let Some(own) = module(file, &src) else { continue };
        let text = fs::read_to_string(file).unwrap();
        // Unit tests may look downstream.
        let code = text.split("#[cfg(test)]").next().unwrap_or_default();
        for (number, line) in code.lines().enumerate() {
            for used in line.split("crate::").skip(1) {
                let name: String = used.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
                match ORDER.iter().position(|m| *m == name) {
                    Some(other) if other > own => {
                        wrong.push(format!("{}:{}: {} uses {name}", file.display(), number + 1, ORDER[own]));
                    }
                    Some(_) => {}
                    // A list in braces or something else: not how modules are named here.
                    None => wrong.push(format!("{}:{}: crate::{name}", file.display(), number + 1)),
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_module_stands_in_the_order() {
    let lib = include_str!("../src/lib.rs");
    let modules = lib.lines().filter_map(|l| l.strip_prefix("pub mod ")?.strip_suffix(';'));
    for name in modules {
        assert!(ORDER.contains(&name), "{name} is not in the order of the modules");
    }
}

#[test]
fn no_file_has_two_subjects() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&src, &mut files);
    for file in files {
        let lines = fs::read_to_string(&file).unwrap().lines().count();
        assert!(lines <= MOST_LINES, "{}: {lines} lines", file.display());
    }
}
