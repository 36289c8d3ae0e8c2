//! docs/room-file.md and the program say the same.

use diffray::scene::{LibraryEntry, Scene, library};

const DOCS: &str = include_str!("../docs/room-file.md");

/// One line of the table of built-in materials.
fn row(entry: &LibraryEntry) -> String {
    let numbers = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let absorption = &entry.material.absorption;
    let absorption =
        if absorption.iter().all(|a| *a == absorption[0]) { absorption[0].to_string() } else { numbers(absorption) };
    let loss = match &entry.material.transmission {
        None => String::new(),
        // At 500 Hz, the fourth octave.
        Some(transmission) => format!("{:.0}", -10.0 * transmission[3].log10()),
    };
    let source = match entry.source.split(';').next().unwrap_or_default() {
        "Vorländer, Auralization, annex" => "V",
        "Barron, Industrial Noise Control and Acoustics, appendix D" => "B",
        "general table of building materials and furnishings" => "G",
        other => other,
    };
    let LibraryEntry { name, description, material, .. } = entry;
    format!("| `{name}` | {description} | {absorption} | {} | {loss} | {source} |", material.scattering[0])
}

#[test]
fn the_table_of_built_in_materials_is_the_library() {
    let library = library().expect("the built-in materials read");
    let head = "| name | what it is | absorption 63 to 8000 Hz | scattering | loss at 500 Hz, dB | source |";
    let rows: Vec<String> = library.iter().map(row).collect();
    let table = format!("{head}\n| --- | --- | --- | --- | --- | --- |\n{}\n", rows.join("\n"));
    assert!(DOCS.ends_with(&table), "docs/room-file.md must end with\n{table}");
}

#[test]
fn every_key_is_documented() {
    // The reader lists its keys when it meets an unknown one.
    let tables = [
        "",
        "[air]",
        "[bands]",
        "[material.m]",
        "[[box]]",
        "[[wall]]",
        "[[mesh]]",
        "[[opening]]",
        "[[source]]",
        "[[probe]]",
        "[simulation]",
        "[output]",
        "[sweep]",
        "[[opening]]\n[opening.door]",
        "[[box]]\n[box.faces]",
    ];
    for table in tables {
        let message =
            Scene::from_str(&format!("{table}\nno-such-key = 1"), "x", &[]).expect_err("unknown key").to_string();
        let mut keys: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
        assert_eq!(keys.remove(0), "no-such-key", "{message}");
        assert!(!keys.is_empty());
        for key in keys {
            let known = DOCS.contains(&format!("`{key}`"))
                || DOCS.contains(&format!("[{key}]"))
                || DOCS.contains(&format!("[{key}."));
            assert!(known, "{table}: `{key}` is not in docs/room-file.md");
        }
    }
}

#[test]
fn the_example_of_the_page_is_a_room() {
    let example = DOCS.split("```toml\n").nth(1).and_then(|rest| rest.split("```").next()).expect("an example");
    Scene::from_str(example, "example.toml", &[]).unwrap_or_else(|error| panic!("{error}"));
}
