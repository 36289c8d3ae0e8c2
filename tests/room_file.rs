//! Good room files: what every key becomes, defaults, overrides, sweeps.

use std::path::Path;
use std::time::Instant;

use diffray::error::Result;
use diffray::scene::{Edges, Face, Host, Loaded, Override, Room, Scene, SourceKind, Spacing, Transport};
use glam::DVec3;
use proptest::prelude::*;

const HALL: &str = include_str!("data/hall.toml");
const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/hall.toml");

/// A small room around further text.
fn room(more: &str) -> String {
    format!(
        "{more}\n[[source]]\nname = \"s\"\nposition_m = [1, 1, 1]\n[[probe]]\nname = \"p\"\nposition_m = [2, 1, 1]\n"
    )
}

fn load(text: &str) -> Loaded {
    Scene::from_str(text, "room.toml", &[]).unwrap_or_else(|error| panic!("{error}"))
}

fn hall_with(settings: &[&str]) -> Result<Loaded> {
    let overrides = settings.iter().map(|text| Override::parse(text)).collect::<Result<Vec<_>>>()?;
    Scene::load(Path::new(DATA), &overrides)
}

const SCREEN: &str = "[[wall]]\nname = \"screen\"\ncorners_m = [[4, 0, 0], [4, 5, 0], [4, 5, 3], [4, 0, 3]]\n";

#[test]
fn every_key_of_the_room_file_reaches_the_scene() {
    let Loaded { scene, source, warnings } = hall_with(&[]).expect("a good file");
    assert_eq!(warnings, []);
    assert_eq!(scene.name, "Sliding door");
    assert_eq!(scene.air.speed_of_sound_m_s, 343.0);
    assert_eq!(scene.bands.len(), 8);
    assert_eq!(scene.boxes[0].max_m, DVec3::new(8.0, 5.0, 3.0));
    let face = |face| scene.materials[scene.boxes[0].face(face).expect("present")].name.as_str();
    assert_eq!([face(Face::Floor), face(Face::Ceiling), face(Face::XMin)], ["parquet", "gypsum", "curtain"]);
    assert_eq!([face(Face::XMax), face(Face::YMin), face(Face::YMax)], ["plaster"; 3]);
    // The file's own plaster, not the built-in one; 40 dB is a ten-thousandth.
    let plaster = scene.materials.iter().find(|m| m.name == "plaster").expect("in use");
    assert_eq!(plaster.absorption, [0.02, 0.02, 0.03, 0.03, 0.04, 0.05, 0.05, 0.05]);
    assert!(plaster.transmission.as_ref().expect("given").iter().all(|t| (t - 1e-4).abs() < 1e-12));
    assert_eq!(scene.walls[0].material, scene.materials.iter().position(|m| m.name == "concrete").expect("in use"));
    assert_eq!(scene.meshes[0].triangles_m.len(), 2);
    assert!(scene.meshes[0].materials.iter().all(|id| scene.materials[*id].name == "wood"));
    let door = &scene.openings[0];
    assert_eq!((door.host, door.hole_x_m, door.y_m), (Host::Wall(0), [1.0, 2.2], [0.0, 2.1]));
    assert_eq!(door.open_x_m, [1.0, 1.3]);
    let leaf = door.leaf.as_ref().expect("covers the rest");
    assert_eq!((leaf.x_m, leaf.thickness_m), ([1.3, 2.2], 0.04));
    assert_eq!(scene.openings[1].host, Host::BoxFace(0, Face::XMax));
    assert_eq!(scene.openings[1].frame.point(1.0, 1.5), DVec3::new(8.0, 1.0, 1.5));
    assert_eq!(scene.sources[0].power_db, Some(vec![90.0; 8]));
    assert_eq!(scene.probes[0].position_m, DVec3::new(6.0, 1.0, 1.5));
    assert_eq!(scene.output.response_length_s, Some(1.5));
    let sweep = scene.sweep.expect("given");
    assert_eq!((sweep.parameter.as_str(), sweep.values.len()), ("opening.door.open_m", 61));
    assert_eq!(source.text, HALL);
    assert_eq!(source.sha256.len(), 64);
}

#[test]
fn the_hash_is_the_sha_256_of_the_text() {
    // FIPS 180-2, appendix B.1.
    assert_eq!(
        Room::new("abc", "x").source().sha256,
        "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    );
}

#[test]
fn what_is_left_out_takes_the_documented_defaults() {
    let scene = load(&room(SCREEN)).scene;
    assert_eq!(scene.name, "room");
    let air = &scene.air;
    assert_eq!((air.temperature_c, air.relative_humidity_percent, air.pressure_kpa), (20.0, 50.0, 101.325));
    // Humid air of 20 degrees Celsius: 343.2 m/s dry (ISO 9613-1), 0.2 % more at 50 % humidity.
    assert!((343.6..344.1).contains(&air.speed_of_sound_m_s), "{}", air.speed_of_sound_m_s);
    assert!(air.absorption);
    // 4.66 dB/km at 1 kHz (ISO 9613-1, table 1) is 1.073e-3 Np/m of intensity.
    assert!((air.attenuation_per_m[4] / 1.073e-3 - 1.0).abs() < 0.005, "{:?}", air.attenuation_per_m);
    assert_eq!(scene.spacing, Spacing::Octave);
    let nominal: Vec<f64> = scene.bands.iter().map(|band| band.nominal_hz).collect();
    assert_eq!(nominal, [63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0]);
    let simulation = &scene.simulation;
    assert_eq!((simulation.seed, simulation.target_db, simulation.max_rays), (1, 0.5, 10_000_000));
    assert_eq!((simulation.max_time_s, simulation.reflection_order, simulation.diffraction_order), (600.0, 3, 2));
    assert_eq!((simulation.edges, simulation.transport), (Edges::Auto, Transport::Wbsdf));
    assert_eq!((scene.output.sample_rate_hz, scene.output.response_length_s), (48_000, None));
    assert_eq!(scene.materials[scene.walls[0].material].name, "rigid");
    assert_eq!(scene.sources[0].kind, SourceKind::Point);
    assert_eq!(scene.sources[0].power_db, None);
    assert_eq!(scene.sources[0].directivity.omni_share, 1.0);
    assert!(scene.sweep.is_none());
}

#[test]
fn air_without_absorption_attenuates_nothing() {
    let scene = load(&room("[air]\nabsorption = false")).scene;
    assert_eq!(scene.air.attenuation_per_m, [0.0; 8]);
}

#[test]
fn tones_are_sorted_and_have_no_width() {
    let scene = load(&room("[bands]\nspacing = \"tones\"\nfrequencies_hz = [1000, 440.5]")).scene;
    assert_eq!(scene.bands.iter().map(|band| band.nominal_hz).collect::<Vec<_>>(), [440.5, 1000.0]);
    assert!(scene.bands.iter().all(|band| band.is_tone()));
}

#[test]
fn third_octaves_interpolate_the_octave_values_of_a_material() {
    let text = room(&format!(
        "[bands]\nspacing = \"third-octave\"\nfrom_hz = 500\nto_hz = 1000\n[material.m]\n\
         absorption = [0, 0, 0, 0.3, 0.6, 0, 0, 0]\n{SCREEN}material = \"m\"\n"
    ));
    let scene = load(&text).scene;
    let absorption = &scene.materials[0].absorption;
    // Linear on log f between 0.3 at 500 Hz and 0.6 at 1 kHz, at 500, 630, 800, 1000 Hz.
    for (value, f) in absorption.iter().zip([500.0f64, 630.0, 800.0, 1000.0]) {
        assert!((value - (0.3 + 0.3 * (f / 500.0).log2())).abs() < 1e-12, "{f} Hz: {value}");
    }
    assert_eq!(absorption.len(), 4);
}

#[test]
fn the_three_forms_of_a_spectrum_agree() {
    let absorption = |form: &str| {
        let text = room(&format!("[material.m]\nabsorption = {form}\n{SCREEN}material = \"m\"\n"));
        load(&text).scene.materials[0].absorption.clone()
    };
    assert_eq!(absorption("0.25"), absorption("[0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25, 0.25]"));
    assert_eq!(absorption("0.25"), absorption("{ 125 = 0.25, \"31.5\" = 0.25 }"));
    assert_eq!(absorption("{ 1000 = 0.1, 125 = 0.4 }")[..2], [0.4, 0.4]);
    assert_eq!(absorption("{ 1000 = 0.1, 125 = 0.4 }")[4..], [0.1; 4]);
}

#[test]
fn what_passes_through_counts_as_absorbed() {
    let text = room(&format!("[material.m]\nabsorption = 0.05\ntransmission_loss_db = 10\n{SCREEN}material = \"m\"\n"));
    let Loaded { scene, warnings, .. } = load(&text);
    assert!(scene.materials[0].absorption.iter().all(|a| (a - 0.1).abs() < 1e-12));
    assert_eq!(warnings.len(), 1);
}

#[test]
fn a_sliding_door_opens_at_its_fixed_jamb() {
    let door = |leaf: &str| {
        let opening = format!(
            "[[opening]]\nname = \"d\"\nwall = \"screen\"\nx_m = [1.0, 2.2]\ny_m = [0, 2]\ndoor = {{ {leaf} }}\n"
        );
        load(&room(&format!("{SCREEN}{opening}"))).scene.openings.remove(0)
    };
    let at_min = door("open_m = 0.3");
    assert_eq!((at_min.open_x_m, at_min.leaf.expect("covers").x_m), ([1.0, 1.3], [1.3, 2.2]));
    let at_max = door("open_m = 0.5, fixed_jamb = \"x_max\"");
    assert_eq!(
        (at_max.open_x_m, at_max.leaf.expect("covers").x_m),
        ([1.7000000000000002, 2.2], [1.0, 1.7000000000000002])
    );
    let closed = door("open_m = 0");
    assert!(closed.is_closed());
    assert_eq!(closed.leaf.expect("covers all").x_m, [1.0, 2.2]);
    // 2.2 - 1.0 is not 1.2 in binary: fully open all the same, without a leaf.
    let open = door("open_m = 1.2");
    assert_eq!((open.open_x_m, open.leaf), ([1.0, 2.2], None));
}

#[test]
fn a_slit_needs_no_limits_along_y_and_a_half_plane_none_on_one_side() {
    let wall = format!("{SCREEN}unbounded = true\n");
    let opening = |x: &str| format!("[[opening]]\nname = \"o\"\nwall = \"screen\"\nx_m = {x}\n");
    let slit = load(&room(&format!("{wall}{}", opening("[1.0, 1.5]")))).scene.openings.remove(0);
    assert!(slit.is_slit());
    let half = load(&room(&format!("{wall}{}", opening("[-inf, 0.0]")))).scene.openings.remove(0);
    assert_eq!(half.hole_x_m, [f64::NEG_INFINITY, 0.0]);
    assert!(half.is_slit());
}

#[test]
fn box_faces_are_measured_from_their_lower_corner_along_the_world_axes() {
    let scene = hall_with(&[]).expect("a good file").scene;
    let hall = &scene.boxes[0];
    for face in Face::ALL {
        let frame = hall.face_frame(face);
        let [w, h] = hall.face_size_m(face);
        assert_eq!(frame.normal, frame.x.cross(frame.y));
        let (low, high) = (frame.origin_m, frame.point(w, h));
        assert!(low.cmple(high).all() && low.cmpge(hall.min_m).all() && high.cmple(hall.max_m).all(), "{face:?}");
        assert_eq!((high - low).cmpgt(DVec3::ZERO).bitmask().count_ones(), 2);
    }
}

#[test]
fn line_sources_and_directivities_keep_their_unit_vectors() {
    let text = format!(
        "{SCREEN}unbounded = true\n[[source]]\nname = \"l\"\nposition_m = [1, 1, 1]\nkind = \"line\"\naxis = [0, 0, 5]\n\
         [[source]]\nname = \"w\"\nposition_m = [1, 1, 1]\nkind = \"plane\"\ndirection = [3, 4, 0]\n\
         [[source]]\nname = \"c\"\nposition_m = [1, 1, 1]\ndirectivity = \"cardioid\"\ndirection = [2, 0, 0]\n\
         [[probe]]\nname = \"p\"\nposition_m = [2, 1, 1]\n"
    );
    let sources = load(&text).scene.sources;
    assert_eq!(sources[0].kind, SourceKind::Line(DVec3::Z));
    let SourceKind::Plane(d) = sources[1].kind else { panic!("a plane wave") };
    assert!((d - DVec3::new(0.6, 0.8, 0.0)).length() < 1e-15);
    assert_eq!(sources[2].directivity.intensity(DVec3::X), 1.0);
    assert_eq!(sources[2].directivity.intensity(-DVec3::X), 0.0);
}

#[test]
fn a_mesh_is_scaled_and_falls_back_on_its_own_material() {
    let text = room("[[mesh]]\nfile = \"panel.obj\"\nscale = 0.5\nmaterial = \"glass\"\n");
    let scene = Scene::from_str(&text, DATA, &[]).unwrap_or_else(|error| panic!("{error}")).scene;
    let area: f64 = scene.meshes[0].triangles_m.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum();
    // 2 m x 1 m at half size.
    assert!((area - 0.5).abs() < 1e-12);
    assert!(scene.materials[scene.meshes[0].materials[0]].name == "glass");
}

#[test]
fn a_probe_in_the_plane_of_a_thin_opening_is_warned_of() {
    let opening = "[[opening]]\nname = \"o\"\nwall = \"screen\"\nx_m = [1, 2]\ny_m = [0, 2]\n";
    let text = room(&format!("{SCREEN}{opening}[[probe]]\nname = \"edge-on\"\nposition_m = [4, 1.5, 1]\n"));
    let Loaded { scene, warnings, .. } = load(&text);
    assert_eq!(scene.probes.len(), 2);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    assert!(warnings[0].observation.contains("in the plane of the opening `o`"));
}

#[test]
fn likely_slips_are_warned_of() {
    let warnings =
        |text: &str| load(&room(text)).warnings.into_iter().map(|w| w.observation).collect::<Vec<_>>().join("; ");
    let cube = |name: &str, x: f64| {
        format!("[[box]]\nname = \"{name}\"\nmin_m = [{x}, 0, 0]\nmax_m = [{}, 3, 3]\nmaterial = \"brick\"\n", x + 4.0)
    };
    assert!(warnings(&(cube("a", 0.0) + &cube("b", 3.5))).contains("the boxes `a` and `b` overlap"));
    assert_eq!(warnings(&(cube("a", 0.0) + &cube("b", 4.0))), "");
    assert!(warnings(&cube("far", 10.0)).contains("source `s` lies outside every box"));
    assert!(warnings(&format!("{SCREEN}{}", SCREEN.replace("screen", "twin"))).contains("lie over each other"));
    assert!(warnings("[output]\nsample_rate_hz = 16000").contains("reaches beyond half the sample rate"));
}

#[test]
fn overrides_reach_every_kind_of_value() {
    let scene = hall_with(&[
        "opening.door.open_m=0.5",
        "opening.door.fixed_jamb=x_max",
        "opening.door.door.material=glass",
        "opening.hatch.x_m=[2.0, 3.0]",
        "probe.mic-1.position_m=[1, 2, 3e-1]",
        "probe.mic-1.position_m.y=2.25",
        "material.plaster.absorption=0.5",
        "material.parquet.absorption=0.07",
        "simulation.seed=7",
        "simulation.max_rays=1e6",
        "box.hall.material=concrete",
        "box.hall.faces.y_min=brick",
        "mesh.panel.obj.scale=2",
        "air.absorption=false",
        "name=Another hall",
        "output.sample_rate_hz=44100",
    ])
    .unwrap_or_else(|error| panic!("{error}"))
    .scene;
    assert_eq!(scene.openings[0].open_x_m, [1.7000000000000002, 2.2]);
    assert_eq!(scene.materials[scene.openings[0].leaf.as_ref().expect("covers").material].name, "glass");
    assert_eq!(scene.openings[1].hole_x_m, [2.0, 3.0]);
    assert_eq!(scene.probes[0].position_m, DVec3::new(1.0, 2.25, 0.3));
    assert_eq!((scene.simulation.seed, scene.simulation.max_rays), (7, 1_000_000));
    assert!(!scene.air.absorption);
    assert_eq!(scene.name, "Another hall");
    assert_eq!(scene.output.sample_rate_hz, 44_100);
    let face = |face| &scene.materials[scene.boxes[0].face(face).expect("present")];
    assert_eq!(face(Face::XMax).name, "concrete");
    assert_eq!(face(Face::YMin).name, "brick");
    // One key of a built-in material changed, the others kept.
    assert_eq!(face(Face::Floor).absorption, [0.07; 8]);
    assert_eq!(face(Face::Floor).scattering, [0.05; 8]);
    // 2 m x 1 m at double size.
    let area: f64 = scene.meshes[0].triangles_m.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum();
    assert!((area - 8.0).abs() < 1e-9);
}

#[test]
fn overrides_make_sections_that_the_file_lacks() {
    let text = room(SCREEN);
    let overrides: Vec<Override> = ["simulation.seed=5", "output.response_length_s=0.5", "bands.spacing=third-octave"]
        .map(|text| Override::parse(text).expect("valid"))
        .to_vec();
    let scene = Scene::from_str(&text, "room.toml", &overrides).unwrap_or_else(|error| panic!("{error}")).scene;
    assert_eq!((scene.simulation.seed, scene.output.response_length_s), (5, Some(0.5)));
    assert_eq!(scene.bands.len(), 22);
}

#[test]
fn an_option_of_its_own_is_named_in_its_error() {
    let overrides = [Override::option("--target-db", "simulation.target_db", "-1")];
    let message = Scene::from_str(&room(SCREEN), "room.toml", &overrides).expect_err("negative").to_string();
    assert!(message.starts_with("--target-db -1: target_db is -1, must be greater than 0"), "{message}");
}

#[test]
fn a_mistake_made_by_an_override_elsewhere_names_the_override() {
    let message = hall_with(&["box.hall.faces.x_max=none"]).expect_err("the hatch has lost its wall").to_string();
    assert!(message.contains("hall.toml:48:8: ") && message.contains("--set box.hall.faces.x_max=none"), "{message}");
}

#[test]
fn a_sweep_makes_one_scene_a_value_in_well_under_a_millisecond() {
    let text = HALL.replace("[[mesh]]\nfile = \"panel.obj\"\nscale = 1.0\nmaterials = { wood_panel = \"wood\" }\n", "");
    let room = Room::new(text, "hall.toml");
    let sweep = room.load(&[]).unwrap_or_else(|error| panic!("{error}")).scene.sweep.expect("given");
    let start = Instant::now();
    for value in &sweep.values {
        let scene = room.scene_at(&[], &sweep.parameter, *value).unwrap_or_else(|error| panic!("{error}"));
        let open = scene.openings[0].open_x_m;
        assert!((open[1] - open[0] - value).abs() < 1e-9);
    }
    let each = start.elapsed() / sweep.values.len() as u32;
    // About 0.1 ms on an idle machine; the limit leaves room for a loaded one.
    assert!(each.as_secs_f64() < 5e-3, "{each:?} a scene");
    println!("{each:?} a scene");
}

#[test]
fn a_whole_number_parameter_can_be_swept() {
    let room = Room::new(room(SCREEN), "room.toml");
    let scene = room.scene_at(&[], "simulation.reflection_order", 5.0).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(scene.simulation.reflection_order, 5);
    assert!(room.scene_at(&[], "simulation.reflection_order", 0.5).is_err());
}

/// Pieces that change a room file in ways people and programs do.
fn mutation() -> impl Strategy<Value = (f64, usize, String)> {
    let pieces = prop_oneof![
        Just(String::new()),
        Just("-".to_owned()),
        Just("nan".to_owned()),
        Just("-inf".to_owned()),
        Just("1e308".to_owned()),
        Just("1e-320".to_owned()),
        Just("[".to_owned()),
        Just("]".to_owned()),
        Just("{ }".to_owned()),
        Just("\"".to_owned()),
        Just("\n".to_owned()),
        Just("ü".to_owned()),
        Just("[[box]]\n".to_owned()),
        "[0-9.]{1,4}",
        "\\PC{0,5}",
    ];
    (0.0..1.0, 0usize..12, pieces)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, rng_seed: proptest::test_runner::RngSeed::Fixed(1), ..ProptestConfig::default() })]

    #[test]
    fn a_mutated_room_file_never_panics(mutations in prop::collection::vec(mutation(), 1..4)) {
        let mut text: Vec<char> = HALL.chars().collect();
        for (at, cut, piece) in mutations {
            let start = (at * text.len() as f64) as usize;
            let end = (start + cut).min(text.len());
            text.splice(start..end, piece.chars());
        }
        let text: String = text.into_iter().collect();
        let _ = Scene::from_str(&text, DATA, &[]).map_err(|error| error.to_string());
    }

    #[test]
    fn a_number_replaced_by_any_other_never_panics(which in 0usize..200, number in prop::num::f64::ANY) {
        let places: Vec<_> = HALL.match_indices(|c: char| c.is_ascii_digit()).collect();
        let (at, digit) = places[which % places.len()];
        let text = format!("{}{number:?}{}", &HALL[..at], &HALL[at + digit.len()..]);
        let _ = Scene::from_str(&text, DATA, &[]).map_err(|error| error.to_string());
    }

    #[test]
    fn an_arbitrary_override_never_panics(path in "(opening|probe|box|material|mesh|air|[a-z]{1,4})(\\.[a-z_1-9\".-]{0,8}){0,4}", value in "\\PC{0,12}") {
        if let Ok(one) = Override::parse(&format!("{path}={value}")) {
            let _ = Scene::from_str(HALL, DATA, &[one]).map_err(|error| error.to_string());
        }
    }

    #[test]
    fn an_arbitrary_sweep_text_never_panics(text in "[-+0-9.:,e naif]{0,24}") {
        let _ = diffray::scene::parse_sweep(&text);
    }
}
