//! Every mistake in a room file is told with its place, what is allowed, and a hint.
//!
//! Each file of tests/bad opens with its expectations as comments: `# expect:` a piece of the message, `# at:` line:column
//! or "option" (the message names the option instead) or file:line:column of a file beside it, `# set:` an override.

use std::fs;
use std::path::{Path, PathBuf};

use diffray::error::Error;
use diffray::scene::{Override, Scene};

fn bad_files() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad");
    let entries = fs::read_dir(folder).expect("tests/bad is part of the source tree");
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("readable folder").path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    files.sort();
    files
}

fn comments<'t>(text: &'t str, key: &str) -> Vec<&'t str> {
    text.lines().filter_map(|line| line.strip_prefix("# ")?.strip_prefix(key)?.strip_prefix(": ")).collect()
}

#[test]
fn every_bad_file_is_refused_with_its_place_and_a_hint() {
    let files = bad_files();
    assert!(files.len() >= 40, "{} files", files.len());
    let mut failures = Vec::new();
    for path in files {
        let text = fs::read_to_string(&path).expect("bad files are UTF-8");
        let file = path.file_name().expect("a file").to_string_lossy().into_owned();
        let overrides: Result<Vec<Override>, Error> = comments(&text, "set").into_iter().map(Override::parse).collect();
        let message = match overrides.and_then(|overrides| Scene::load(&path, &overrides)) {
            Ok(_) => {
                failures.push(format!("{file}: accepted"));
                continue;
            }
            Err(error) => error.to_string(),
        };
        let expected = comments(&text, "expect");
        assert!(!expected.is_empty(), "{file} expects nothing");
        for piece in expected {
            if !message.contains(piece) {
                failures.push(format!("{file}: no {piece:?} in\n    {message}"));
            }
        }
        match comments(&text, "at")[..] {
            ["option"] if message.starts_with("--set ") => {}
            ["option"] => failures.push(format!("{file}: the option is not named in\n    {message}")),
            [place] if message.starts_with(&format!("{}:{place}: ", path.display())) => {}
            [place] if message.starts_with(&format!("{}: ", path.with_file_name(place).display())) => {}
            [place] => failures.push(format!("{file}: not at {place}:\n    {message}")),
            _ => failures.push(format!("{file}: needs one `# at:`")),
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

#[test]
fn a_file_that_is_not_text_is_told_with_the_place_of_its_first_bad_byte() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("room.toml");
    fs::write(&path, b"name = \"a\"\n# gr\xfc\xdfe\n").expect("writable");
    let message = Scene::load(&path, &[]).expect_err("not UTF-8").to_string();
    assert!(message.contains(":2:5: this is not UTF-8 text"), "{message}");
}

#[test]
fn a_missing_file_is_told_by_its_name() {
    let message = Scene::load(Path::new("nowhere/room.toml"), &[]).expect_err("no such file").to_string();
    assert!(message.starts_with("nowhere/room.toml: cannot read: "), "{message}");
}
