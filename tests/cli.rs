//! The program as a user meets it: arguments, exit status, what goes where.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Free field: one source, probes at 1, 2 and 7.3 m.
const FREE_FIELD: &str = r#"
name = "Free field"

[air]
absorption = false

[bands]
from_hz = 500
to_hz = 1000

[[source]]
name = "s"
position_m = [0, 0, 0]
power_db = 90.0

[[probe]]
name = "near"
position_m = [1, 0, 0]

[[probe]]
name = "far"
position_m = [0, 7.3, 0]
"#;

struct Place(tempfile::TempDir);

impl Place {
    /// A fresh directory with `room.toml` in it.
    fn new(room: &str) -> Place {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("room.toml"), room).unwrap();
        Place(place)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn diffray(&self, args: &[&str]) -> Output {
        self.command(args).output().unwrap()
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_diffray"));
        command.args(args).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    fn files(&self) -> Vec<String> {
        fn walk(directory: &Path, root: &Path, names: &mut Vec<String>) {
            for entry in fs::read_dir(directory).unwrap().map(|e| e.unwrap().path()) {
                if entry.is_dir() {
                    walk(&entry, root, names);
                } else {
                    names.push(entry.strip_prefix(root).unwrap().to_str().unwrap().to_owned());
                }
            }
        }
        let mut names = Vec::new();
        walk(self.0.path(), self.0.path(), &mut names);
        names.sort();
        names
    }

    /// Rows of a CSV file, header included.
    fn rows(&self, name: &str) -> Vec<Vec<String>> {
        let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(self.path(name)).unwrap();
        reader.records().map(|r| r.unwrap().iter().map(str::to_owned).collect()).collect()
    }
}

fn status(output: &Output) -> i32 {
    output.status.code().expect("the program was killed")
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[test]
fn help_and_version_go_to_the_standard_output() {
    let place = Place::new("");
    for args in [&["--help"][..], &["--version"], &["simulate", "--help"], &["verify", "--help"]] {
        let output = place.diffray(args);
        assert_eq!(status(&output), 0, "{args:?}");
        assert!(text(&output.stdout).contains("diffray"), "{args:?}");
        assert!(output.stderr.is_empty(), "{args:?}");
    }
    let help = place.diffray(&["simulate", "--help"]);
    let options = ["--out", "--set", "--seed", "--target-db", "--max-rays", "--max-time", "--threads", "--quiet"];
    for option in options {
        assert!(text(&help.stdout).contains(option), "{option}");
    }
}

#[test]
fn wrong_usage_is_status_2() {
    let place = Place::new(FREE_FIELD);
    let wrong: [&[&str]; 9] = [
        &[],
        &["simulat", "room.toml"],
        &["simulate"],
        &["simulate", "room.toml", "--colour"],
        &["simulate", "room.toml", "--set", "nonsense"],
        &["simulate", "room.toml", "--set", "=3"],
        &["simulate", "room.toml", "--seed", "-1"],
        &["simulate", "room.toml", "--max-rays", "1.5"],
        &["simulate", "room.toml", "--threads", "0"],
    ];
    for args in wrong {
        let output = place.diffray(args);
        assert_eq!(status(&output), 2, "{args:?}");
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{args:?}");
    }
    assert_eq!(place.files(), ["room.toml"]);
}

#[test]
fn a_room_file_that_is_not_there_is_named() {
    let output = Place::new("").diffray(&["check", "nowhere.toml"]);
    assert_eq!(status(&output), 1);
    assert!(text(&output.stderr).starts_with("error: nowhere.toml: cannot read"), "{}", text(&output.stderr));
    assert!(output.stdout.is_empty());
}

#[test]
fn a_mistake_in_the_room_file_is_shown_with_its_place_and_a_hint_on_a_line_of_its_own() {
    let place = Place::new(&FREE_FIELD.replace("power_db", "powr_db"));
    for command in ["check", "plan", "simulate", "sweep"] {
        let output = place.diffray(&[command, "room.toml"]);
        let said = text(&output.stderr);
        assert_eq!(status(&output), 1, "{said}");
        assert!(said.starts_with("error: room.toml:14:1: ") && said.contains("powr_db"), "{said}");
        assert!(said.lines().any(|line| line.starts_with("hint: ")), "{said}");
        assert!(!said.contains('\u{1b}'), "colours only on a terminal");
    }
    assert_eq!(place.files(), ["room.toml"]);
}

#[test]
fn check_and_plan_write_nothing() {
    let place = Place::new(FREE_FIELD);
    let check = place.diffray(&["check", "room.toml"]);
    assert_eq!(status(&check), 0, "{}", text(&check.stderr));
    assert!(text(&check.stdout).contains("room.toml: ok"));
    let plan = place.diffray(&["plan", "room.toml"]);
    assert_eq!(status(&plan), 0, "{}", text(&plan.stderr));
    assert!(text(&plan.stdout).contains("free field"), "{}", text(&plan.stdout));
    assert_eq!(place.files(), ["room.toml"]);
}

#[test]
fn free_field_levels_fall_with_the_distance() {
    let place = Place::new(FREE_FIELD);
    let output = place.diffray(&["simulate", "room.toml"]);
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("s → far"), "{}", text(&output.stdout));
    assert!(!text(&output.stderr).contains('\u{1b}'));
    let names = ["bands.csv", "ir/s-far.wav", "ir/s-near.wav", "metrics.csv", "report.html", "run.json"];
    let expected: Vec<String> = names.iter().map(|n| format!("out/room/{n}")).chain(["room.toml".to_owned()]).collect();
    assert_eq!(place.files(), expected);
    let rows = place.rows("out/room/bands.csv");
    assert_eq!(rows[0][..5], ["source", "probe", "band_hz", "level_db", "std_error_db"]);
    assert_eq!(rows.len(), 1 + 2 * 2);
    for row in &rows[1..] {
        let distance_m: f64 = if row[1] == "near" { 1.0 } else { 7.3 };
        let level_db: f64 = row[3].parse().unwrap();
        // Closed form; the bound is the contract's for free field.
        assert!((level_db + 20.0 * distance_m.log10()).abs() < 1e-9, "{row:?}");
    }
}

#[test]
fn a_sweep_takes_its_values_from_the_command_line() {
    let place = Place::new(FREE_FIELD);
    let none = place.diffray(&["sweep", "room.toml"]);
    assert_eq!(status(&none), 1);
    assert!(text(&none.stderr).contains("no [sweep]"), "{}", text(&none.stderr));
    let args = ["sweep", "room.toml", "--set", "source.s.power_db=80:90:5", "--out", "power", "--quiet"];
    let output = place.diffray(&args);
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
    let names = ["power/closing.csv", "power/report.html", "power/run.json", "power/sweep.csv", "room.toml"];
    assert_eq!(place.files(), names);
    let rows = place.rows("power/sweep.csv");
    assert_eq!(rows[0][..6], ["value", "source", "probe", "band_hz", "level_db", "std_error_db"]);
    assert_eq!(rows.len(), 1 + 3 * 2 * 2);
    let spl = |value: &str| -> f64 {
        let column = rows[0].iter().position(|name| name == "spl_db").unwrap();
        rows.iter().find(|row| row[0] == value && row[2] == "near").unwrap()[column].parse().unwrap()
    };
    // The sound pressure level follows the power of each value; at 1 m it lies 10 lg 4 pi = 11 dB below it, give or
    // take the 0.2 dB by which rho c differs from 400 Pa s/m.
    assert!((spl("90") - spl("80") - 10.0).abs() < 1e-9);
    assert!((spl("90") - (90.0 - 10.99)).abs() < 0.3, "{}", spl("90"));
    assert_eq!(place.rows("power/closing.csv").len(), 1, "a level that does not change has no rises");
}

#[test]
fn options_end_up_in_the_record() {
    let place = Place::new(FREE_FIELD);
    let args =
        ["simulate", "room.toml", "--seed", "42", "--max-rays", "2e6", "--set", "probe.far.position_m=[0, 4, 0]"];
    let output = place.diffray(&args);
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    let record: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(place.path("out/room/run.json")).unwrap()).unwrap();
    assert_eq!(record["seed"], 42);
    assert_eq!(record["options"]["simulation"]["max_rays"], 2_000_000);
    assert_eq!(record["set"][0], "probe.far.position_m=[0, 4, 0]");
}

#[test]
fn the_cost_of_an_opening_s_tables_ends_up_in_the_record() {
    let screen = "corners_m = [[0, 0, 0], [1, 0, 0], [1, 0, 1]]\nunbounded = true\nthickness_m = 0.1\n";
    let opening = "[[opening]]\nname = \"slit\"\nwall = \"screen\"\nx_m = [0.2, 0.7]\n";
    // Both probes lie behind the screen; the same tables serve them.
    let room =
        FREE_FIELD.replace("position_m = [0, 0, 0]", "position_m = [0, -2, 0]").replace("[1, 0, 0]", "[1, 1, 0]");
    let place = Place::new(&format!("{room}[[wall]]\nname = \"screen\"\n{screen}{opening}"));
    for (command, least) in [(vec!["simulate"], 8), (vec!["sweep", "--set", "source.s.power_db=80,90"], 16)] {
        let args = [&command[..1], &["room.toml", "--out", "out", "--threads", "1"], &command[1..]].concat();
        let output = place.diffray(&args);
        assert_eq!(status(&output), 0, "{}", text(&output.stderr));
        let record: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(place.path("out/run.json")).unwrap()).unwrap();
        let [slit] = record["opening_tables"].as_array().unwrap().as_slice() else { panic!("one opening") };
        assert_eq!(slit["opening"], "slit");
        // Two octaves take 4 frequencies each at least, those of a sweep are added.
        let frequencies = slit["frequencies"].as_u64().unwrap();
        assert!((least..100 * least).contains(&frequencies), "{frequencies}");
        let (seconds, times) = (slit["seconds"].as_f64().unwrap(), record["times_s"].as_object().unwrap());
        let spent: f64 = times.values().map(|s| s.as_f64().unwrap()).sum();
        assert!(0.0 < seconds && seconds < spent, "{seconds} of {times:?}");
    }
}

#[test]
fn results_that_cannot_be_written_are_an_error_and_leave_nothing() {
    let place = Place::new(FREE_FIELD);
    let output = place.diffray(&["simulate", "room.toml", "--out", "room.toml/results"]);
    assert_eq!(status(&output), 1);
    assert!(text(&output.stderr).starts_with("error: "), "{}", text(&output.stderr));
    assert!(output.stdout.is_empty());
    assert_eq!(place.files(), ["room.toml"]);
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let place = Place::new(FREE_FIELD);
    let mut child =
        place.command(&["simulate", "room.toml"]).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(status(&output), 0, "{}", text(&output.stderr));
    assert!(!text(&output.stderr).contains("panicked"));
    assert!(place.path("out/room/run.json").is_file());
}

#[test]
fn completions_are_written_for_a_shell() {
    let output = Place::new("").diffray(&["completions", "bash"]);
    assert_eq!(status(&output), 0);
    assert!(text(&output.stdout).contains("complete -F _diffray"));
}
