//! The files of a run, written from hand-made results and read back.

use std::fs;
use std::path::{Path, PathBuf};

use diffray::error::Warning;
use diffray::probe::{BandLevel, EarlyPath, Echogram, Reception, TableCost};
use diffray::report::{
    Folder, Pair, ReferenceCurve, Run, Series, Simulated, SweepValue, Swept, levels_table, rises, rises_table,
    write_bands, write_closing, write_metrics, write_sweep,
};
use diffray::response::{DecayTime, Metrics, Response};
use diffray::scene::{Band, Edges, Output, RoomSource, Simulation, Transport};

const OCTAVES: [f64; 8] = [63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0];

fn run(name: &str) -> Run {
    let half = 2f64.sqrt();
    Run {
        name: name.into(),
        source: RoomSource {
            file: PathBuf::from("rooms/door.toml"),
            text: "name = \"<Sliding> & door\"\n\n[bands]\nspacing = \"octave\"\n".into(),
            sha256: "0".repeat(64),
        },
        set: vec!["opening.door.open_m=0.3".into()],
        bands: OCTAVES.iter().map(|&f| Band { nominal_hz: f, low_hz: f / half, high_hz: f * half }).collect(),
        simulation: Simulation {
            seed: 7,
            target_db: 0.5,
            max_rays: 10_000_000,
            max_time_s: 600.0,
            reflection_order: 3,
            diffraction_order: 2,
            edges: Edges::Auto,
            transport: Transport::Wbsdf,
            interference: false,
            ray_tolerance: 2e-3,
        },
        output: Output { sample_rate_hz: 48_000, response_length_s: None, signal_to_noise_db: None },
        spl_1m_db: vec![("talker".into(), vec![79.15; 8])],
        plan: serde_json::json!({ "portals": [{ "opening": "door", "model": "exact aperture below 545 Hz" }] }),
        plan_text: "portal door (0.30 m x 2.10 m)\n  63-500 Hz   exact aperture\n  1-8 kHz     signed rays\n".into(),
        rays: 1_234_567,
        stop: "the target of 0.5 dB was reached".into(),
        times_s: vec![("plan".into(), 0.0123), ("paths".into(), 0.41), ("rays".into(), 72.8)],
        opening_tables: vec![TableCost { opening: "door".into(), frequencies: 212, seconds: 0.146 }],
        warnings: vec![Warning {
            observation: "the volume of \"hall\" is not closed <1 %>".into(),
            remedy: "check the faces that are \"none\"".into(),
        }],
    }
}

fn level(band_hz: f64, db: f64, std_error_db: f64, early_share: f64) -> BandLevel {
    let intensity = 10f64.powf(db / 10.0);
    let intensity_error = std_error_db * intensity * std::f64::consts::LN_10 / 10.0;
    BandLevel { band_hz, intensity, intensity_error, early_share }
}

fn reception(source: &str, probe: &str, std_error_db: f64, db: impl Fn(usize) -> f64) -> Reception {
    let levels: Vec<BandLevel> = OCTAVES.iter().enumerate().map(|(b, &f)| level(f, db(b), std_error_db, 0.3)).collect();
    let path = |label: &str, reflections: usize, share: f64| EarlyPath {
        course: Vec::new(),
        from: glam::DVec3::X,
        label: label.into(),
        reflections,
        delay_s: 0.0132 + 0.004 * reflections as f64,
        intensity: levels.iter().map(|l| l.intensity * share).collect(),
        error: vec![0.0; 8],
    };
    Reception {
        source: source.into(),
        probe: probe.into(),
        paths: vec![path("door", 0, 0.2), path("floor, door", 1, 0.1)],
        echogram: Some(Echogram {
            bin_s: 0.001,
            bin_error: Vec::new(),
            reflections_per_s3: None,
            energy: vec![vec![0.0]; 8],
            std_error: vec![0.0; 8],
        }),
        levels,
    }
}

/// A smooth, made-up level of a door with openings that make it fall while the opening grows.
fn door_db(open_m: f64, band: usize) -> f64 {
    let x = open_m * OCTAVES[band].sqrt() / 20.0;
    if open_m == 0.0 {
        -42.0
    } else {
        10.0 * (1.0 - (-4.0 * x).exp()).log10() - 4.0 + 1.5 * (6.0 * x).sin() / (1.0 + x)
    }
}

fn swept(std_error_db: f64) -> Swept {
    let sets: Vec<(f64, Vec<Reception>)> = (0..=60)
        .map(|i| {
            let open_m = f64::from(i) * 0.02;
            let wobble = if i % 2 == 0 { 0.3 } else { -0.3 } * std_error_db;
            let at = |offset: f64| move |b: usize| door_db(open_m, b) - offset + wobble;
            let pair = |probe: &str, offset: f64| reception("talker", probe, std_error_db, at(offset));
            (open_m, vec![pair("mic-1", 0.0), pair("mic-2", 6.0)])
        })
        .collect();
    let values: Vec<SweepValue> = sets
        .iter()
        .map(|(value, receptions)| SweepValue {
            value: *value,
            receptions,
            spl_1m_db: vec![("talker".into(), vec![79.15; 8])],
        })
        .collect();
    let reference = ReferenceCurve {
        label: "exact solution".into(),
        source: "talker".into(),
        probe: "mic-1".into(),
        band_hz: 1000.0,
        points: (1..=60).map(|i| (f64::from(i) * 0.02, door_db(f64::from(i) * 0.02, 4) - 0.4)).collect(),
    };
    Swept {
        run: run("Sliding door, 1.2 m"),
        parameter: "opening.door.open_m".into(),
        series: Series::collect(&values),
        references: vec![reference],
    }
}

fn simulated() -> Simulated {
    let decay_s = 0.08;
    let mut state = 1u32;
    let samples = (0..36_000)
        .map(|i| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let t = f64::from(i) / 48_000.0;
            let noise = f64::from(state >> 8) / f64::from(1u32 << 24) - 0.5;
            if t < 0.013 { 0.0 } else { (0.2 * noise * (-(t - 0.013) / decay_s).exp()) as f32 }
        })
        .collect();
    let time = |seconds, correlation| DecayTime { seconds, correlation, reliable: true, reason: None };
    let metrics = |band_hz: f64| Metrics {
        band_hz,
        edt: time(Some(0.512345678901), Some(-0.998)),
        t20: time(Some(0.55), Some(-0.9995)),
        t30: DecayTime { reason: Some("the decay spans only 31 dB, \"35\" are needed".into()), ..time(None, None) },
        c50_db: Some(3.2),
        c80_db: Some(7.1),
        d50: Some(0.68),
        ts_s: Some(0.041),
        g_db: Some(3.25),
        curvature: None,
    };
    let shape = |b: usize| if b == 0 { f64::NEG_INFINITY } else { -10.123456789012 - 1.7 * b as f64 };
    Simulated {
        run: run("<Sliding> & door"),
        pairs: vec![
            Pair {
                reception: reception("talker", "mic-1", 0.21, shape),
                response: Some(Response {
                    sample_rate_hz: 48_000,
                    samples,
                    others: vec![],
                    title: String::new(),
                    warnings: vec![],
                }),
                metrics: OCTAVES.map(metrics).into(),
                response_metrics: OCTAVES.map(metrics).into(),
                speech_transmission_index: Some(0.625),
            },
            Pair {
                reception: reception("loudspeaker", "mic, the \"second\"", 0.34, |b| shape(b) - 12.0),
                response: None,
                metrics: vec![],
                response_metrics: vec![],
                speech_transmission_index: None,
            },
        ],
    }
}

fn rows(text: &[u8]) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_reader(text);
    let header = reader.headers().unwrap().iter().map(str::to_owned).collect();
    let rows = reader.records().map(|r| r.unwrap().iter().map(str::to_owned).collect()).collect();
    (header, rows)
}

#[test]
fn bands_csv_reads_back_to_the_last_digit() {
    let results = simulated();
    let mut text = Vec::new();
    write_bands(&mut text, &results.run, results.pairs.iter().map(|p| &p.reception)).unwrap();
    let (header, rows) = rows(&text);
    assert_eq!(header, ["source", "probe", "band_hz", "level_db", "std_error_db", "early_level_db", "spl_db"]);
    assert_eq!(rows.len(), 16);
    assert_eq!(rows[0][3], "-inf");
    assert_eq!(rows[8][1], "mic, the \"second\"");
    assert_eq!(rows[8][6], "", "a source without a power has no sound pressure level");
    for (row, expected) in rows.iter().zip(results.pairs.iter().flat_map(|p| &p.reception.levels)) {
        assert_eq!(row[2].parse::<f64>().unwrap(), expected.band_hz);
        assert_eq!(row[3].parse::<f64>().unwrap(), expected.level_db());
        assert_eq!(row[4].parse::<f64>().unwrap(), expected.std_error_db());
    }
    // 30 % of the energy are early: 10 lg 0.3 = -5.2288 dB; the source's power puts 79.15 dB at 1 m.
    let field = |column: usize| rows[1][column].parse::<f64>().unwrap();
    assert!((field(5) - field(3) - 10.0 * 0.3f64.log10()).abs() < 1e-12);
    assert!((field(6) - field(3) - 79.15).abs() < 1e-12);
}

#[test]
fn sweep_csv_has_one_row_a_value_and_series_in_ascending_order() {
    let results = swept(0.0);
    let mut text = Vec::new();
    write_sweep(&mut text, &results.series).unwrap();
    let (header, rows) = rows(&text);
    assert_eq!(header[..6], ["value", "source", "probe", "band_hz", "level_db", "std_error_db"]);
    assert_eq!(rows.len(), 61 * 2 * 8);
    let values: Vec<f64> = rows.iter().map(|r| r[0].parse().unwrap()).collect();
    assert!(values.is_sorted());
    let row = rows.iter().find(|r| r[0] == "0.3" && r[2] == "mic-2" && r[3] == "1000").unwrap();
    assert!((row[4].parse::<f64>().unwrap() - (door_db(0.3, 4) - 6.0)).abs() < 1e-9);
}

#[test]
fn closing_csv_lists_every_rise_with_its_ends() {
    for std_error_db in [0.0, 0.05] {
        let results = swept(std_error_db);
        let mut text = Vec::new();
        write_closing(&mut text, &results.series).unwrap();
        let (header, rows) = rows(&text);
        assert_eq!(
            header[..8],
            ["source", "probe", "band_hz", "value_low", "value_high", "level_low_db", "level_high_db", "rise_db"]
        );
        assert_eq!(rows.len(), results.series.iter().map(|s| rises(&s.points).len()).sum::<usize>());
        assert!(rows.len() >= 12, "{} rows", rows.len());
        for row in &rows {
            let n: Vec<f64> = row[2..].iter().map(|x| x.parse().unwrap()).collect();
            assert!(n[1] < n[2] && n[5] > 0.0, "{row:?}");
            assert!((n[3] - n[4] - n[5]).abs() < 1e-12, "{row:?}");
        }
    }
}

#[test]
fn metrics_csv_leaves_undefined_quantities_empty() {
    let results = simulated();
    let mut text = Vec::new();
    write_metrics(&mut text, &results.pairs).unwrap();
    let (header, rows) = rows(&text);
    let column = |name: &str| header.iter().position(|h| h == name).unwrap();
    assert_eq!(rows.len(), 8);
    assert_eq!(rows[0][column("edt_s")], "0.512345678901");
    assert_eq!(rows[0][column("t30_s")], "");
    assert_eq!(rows[0][column("ir_edt_s")], "0.512345678901");
    assert_eq!((rows[0][column("sti")].as_str(), rows[0][column("ir_g_db")].as_str()), ("0.625", "3.25"));
    assert_eq!(rows[0][column("reliable")], "true");
    assert_eq!(rows[0][column("note")], "T30: the decay spans only 31 dB, \"35\" are needed");
}

/// The page holds no address that a browser would fetch, no script, and every element that is opened is closed.
fn check_page(page: &str) {
    for foreign in ["http://", "https://", "src=", "href=", "url(", "@import", "<script", "<link", "<img"] {
        assert!(!page.contains(foreign), "the page refers to {foreign}");
    }
    assert!(page.starts_with("<!DOCTYPE html>"));
    assert!(!page.contains("NaN"));
    assert!(!page.contains("D1\""), "a reserved chart colour was left in the page");
    let void = ["meta", "br", "!DOCTYPE"];
    let mut open: Vec<&str> = Vec::new();
    let body = page.split_once("<style>").unwrap().0.to_owned() + page.split_once("</style>").unwrap().1;
    for tag in body.split('<').skip(1).map(|t| t.split_once('>').expect("an unclosed tag").0) {
        let name = tag.trim_start_matches('/').split([' ', '\n', '/']).next().unwrap();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "</{name}> closes something else");
        } else if !tag.ends_with('/') && !void.contains(&name) {
            // Names live as long as `body`.
            open.push(name);
        }
    }
    assert_eq!(open, Vec::<&str>::new());
}

fn written(write: impl FnOnce(&mut Folder) -> diffray::error::Result<()>) -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    let mut folder = Folder::stage(place.path()).unwrap();
    write(&mut folder).unwrap();
    folder.publish().unwrap();
    place
}

fn read(place: &Path, name: &str) -> String {
    fs::read_to_string(place.join(name)).unwrap()
}

#[test]
fn the_report_of_a_simulation_is_one_self_contained_page() {
    let place = written(|folder| simulated().write(folder));
    let page = read(place.path(), "report.html");
    check_page(&page);
    assert!(page.contains("&lt;Sliding&gt; &amp; door"));
    assert_eq!(page.matches("<svg role=\"img\"").count(), 4);
    assert!(page.contains("check the faces that are &quot;none&quot;"));
}

#[test]
fn the_report_of_a_sweep_has_a_chart_a_series_and_one_over_all_bands() {
    let place = written(|folder| swept(0.05).write(folder));
    let page = read(place.path(), "report.html");
    check_page(&page);
    assert_eq!(page.matches("<svg role=\"img\"").count(), 2 * (1 + 8));
    assert!(page.contains("exact solution"));
}

#[test]
fn a_scene_in_which_nothing_arrives_has_a_report_too() {
    let mut results = simulated();
    for r in results.pairs.iter_mut().map(|p| &mut p.reception) {
        r.levels = r.levels.iter().map(|l| BandLevel { intensity: 0.0, intensity_error: 0.0, ..*l }).collect();
    }
    for response in results.pairs.iter_mut().filter_map(|p| p.response.as_mut()) {
        response.samples.fill(0.0);
    }
    let place = written(|folder| results.write(folder));
    check_page(&read(place.path(), "report.html"));
    let mut sweep = swept(0.0);
    for p in sweep.series.iter_mut().flat_map(|s| &mut s.points) {
        p.level.intensity = 0.0;
    }
    let place = written(|folder| sweep.write(folder));
    check_page(&read(place.path(), "report.html"));
}

#[test]
fn run_json_says_how_to_repeat_the_run() {
    let place = written(|folder| simulated().write(folder));
    let record: serde_json::Value = serde_json::from_str(&read(place.path(), "run.json")).unwrap();
    assert_eq!(record["seed"], 7);
    assert_eq!(record["set"][0], "opening.door.open_m=0.3");
    assert_eq!(record["room_file_sha256"].as_str().unwrap().len(), 64);
    assert_eq!(record["options"]["simulation"]["transport"], "wbsdf");
    assert_eq!(record["plan"]["portals"][0]["opening"], "door");
    let door = serde_json::json!({ "opening": "door", "frequencies": 212, "seconds": 0.146 });
    assert_eq!(record["opening_tables"], serde_json::json!([door]));
    assert_eq!(record["results"][0]["levels"][0]["level_db"], serde_json::Value::Null);
    assert_eq!(record["results"][0]["levels"][4]["level_db"].as_f64().unwrap(), -10.123456789012 - 1.7 * 4.0);
    assert_eq!(
        record["files"],
        serde_json::json!(["bands.csv", "ir/talker-mic-1.wav", "metrics.csv", "report.html", "run.json"])
    );
    for file in record["files"].as_array().unwrap() {
        assert!(place.path().join(file.as_str().unwrap()).is_file());
    }
}

#[test]
fn the_table_on_the_terminal_fits_a_hundred_columns() {
    let results = simulated();
    let text = levels_table(&results);
    assert!(text.lines().all(|l| l.chars().count() <= 100), "{text}");
    for words in ["talker → mic-1", "63 Hz", "8 kHz", "-inf", "-11.82 ±0.21", "re 20 µPa"] {
        assert!(text.contains(words), "{words} is missing in\n{text}");
    }
    let text = rises_table(&swept(0.0));
    assert!(text.lines().all(|l| l.chars().count() <= 100), "{text}");
    assert!(text.contains("largest rise on closing"), "{text}");
}

/// Writes two reports to look at: `cargo test --test report -- --ignored`.
#[test]
#[ignore = "writes reports to look at"]
fn demo_reports() {
    let place = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let write = |name: &str, write: &dyn Fn(&mut Folder) -> diffray::error::Result<()>| {
        let mut folder = Folder::stage(&place.join(name)).unwrap();
        write(&mut folder).unwrap();
        println!("{}", folder.publish().unwrap().display());
    };
    println!("{}", levels_table(&simulated()));
    println!("{}", rises_table(&swept(0.05)));
    write("demo-simulation", &|folder| simulated().write(folder));
    write("demo-sweep", &|folder| swept(0.05).write(folder));
}
