//! What a scene needs is decided before anything runs: the plan as data, without tracing.

use diffray::geometry::Geometry;
use diffray::plan::{Plan, PortalModel};
use diffray::scene::{Override, Scene};

fn plan_of(text: &str) -> Plan {
    let scene = Scene::from_str(text, "room.toml", &[]).expect("a sound room").scene;
    Plan::new(&scene, &Geometry::new(&scene).expect("sound geometry"))
}

fn plan_of_room(room: &str, set: &[&str]) -> Plan {
    let set: Vec<Override> = set.iter().map(|s| Override::parse(s).expect("a setting")).collect();
    let scene = Scene::load(format!("rooms/{room}").as_ref(), &set).expect("a sound room").scene;
    Plan::new(&scene, &Geometry::new(&scene).expect("sound geometry"))
}

fn models(plan: &Plan) -> Vec<PortalModel> {
    plan.portals[0].bands.iter().map(|b| b.model).collect()
}

#[test]
fn free_field_and_laboratory_screens_trace_no_rays() {
    for room in ["free-field.toml", "sliding-door.toml", "two-gaps.toml", "barrier.toml"] {
        let plan = plan_of_room(room, &[]);
        assert!(plan.traced.is_none() && plan.untraced_why.is_some(), "{room}");
    }
    let plan = plan_of_room("shoebox.toml", &[]);
    assert!(plan.untraced_why.is_none());
    let part = plan.traced.expect("a diffuse room is traced");
    // Eyring: 24 ln(10) V / (-c S ln(1 - 0.2)) with V = 180 m^3, S = 216 m^2, exactly known for one box.
    let eyring = 24.0 * 10.0_f64.ln() * 180.0 / (343.0 * 216.0 * -(0.8_f64.ln()));
    assert!((part.reverberation_s.expect("closed") - eyring).abs() < 1e-9);
}

#[test]
fn a_room_without_scattering_and_with_few_reflections_traces_no_rays() {
    // A rigid floor in the open: one reflection is all there is.
    let open = "[[wall]]\nname = \"ground\"\ncorners_m = [[0, 0, 0], [1, 0, 0], [1, 1, 0]]\nunbounded = true\n\
                [[source]]\nname = \"s\"\nposition_m = [0, 0, 1]\n[[probe]]\nname = \"p\"\nposition_m = [3, 0, 1]\n";
    assert!(plan_of(open).traced.is_none());
    let scattering = format!("[material.rough]\nabsorption = 0.1\nscattering = 0.5\n{open}")
        .replace("unbounded = true", "unbounded = true\nmaterial = \"rough\"");
    assert!(plan_of(&scattering).traced.expect("diffuse reflections are traced").why.contains("scatter"));
}

#[test]
fn the_form_of_an_opening_follows_its_width_in_wavelengths() {
    let wide = plan_of_room("sliding-door.toml", &["opening.door.open_m=0.6"]);
    // k a = 12 lies between the octaves at 1 and 2 kHz for 0.6 m.
    let split = models(&wide).iter().position(|m| *m == PortalModel::Opening).expect("wide at high frequencies");
    assert_eq!(wide.portals[0].bands[split].band_hz, 2000.0);
    assert!(models(&wide)[..split].iter().all(|m| *m == PortalModel::NarrowOpening));
    let crack = plan_of_room("sliding-door.toml", &["opening.door.open_m=0.005"]);
    assert!(models(&crack).iter().all(|m| *m == PortalModel::NarrowOpening));
    let ka = crack.portals[0].bands[3].ka.expect("finite");
    // Centre of the octave in wave number: 1.0607 times the nominal centre.
    assert!((ka - 1.060_66 * std::f64::consts::TAU * 1000.0 / 343.0 * 0.005).abs() < 1e-4, "{ka}");
}

#[test]
fn a_closed_door_and_the_ablations_are_said_to_be_so() {
    let closed = plan_of_room("sliding-door.toml", &["opening.door.open_m=0"]);
    assert!(models(&closed).iter().all(|m| *m == PortalModel::Closed));
    assert!(closed.portals[0].bands.iter().all(|b| b.ka.is_none()));
    for set in ["simulation.transport=geometric", "simulation.edges=off", "simulation.diffraction_order=0"] {
        let plan = plan_of_room("sliding-door.toml", &[set]);
        assert!(models(&plan).iter().all(|m| *m == PortalModel::Geometric), "{set}");
    }
    let paraxial = plan_of_room("sliding-door.toml", &["simulation.transport=paraxial", "opening.door.open_m=0.005"]);
    assert!(models(&paraxial).iter().all(|m| *m == PortalModel::Opening), "the published form knows no narrow ones");
}

#[test]
fn an_edge_that_nobody_feels_is_left_out_with_a_bound() {
    let plan = |low: f64, probe_y: f64| {
        let high = low + 2.0;
        plan_of(&format!(
            "[bands]\nfrom_hz = 1000\nto_hz = 4000\n[[wall]]\nname = \"screen\"\n\
             corners_m = [[50, 0, {low}], [50, 2, {low}], [50, 2, {high}], [50, 0, {high}]]\n\
             [[source]]\nname = \"s\"\nposition_m = [0, 0, 1]\n\
             [[probe]]\nname = \"p\"\nposition_m = [0, {probe_y}, 1]\n"
        ))
    };
    let all_below = |plan: &Plan, bound_db: f64| {
        assert!(!plan.edges.is_empty());
        for edge in &plan.edges {
            assert!(!edge.felt && edge.bound_db > 0.0 && edge.bound_db < bound_db, "{edge:?}");
        }
    };
    // A screen far to the side, and above: the direct sound passes 50 m from it and no reflection comes near its edges.
    // Detour above 95 m, wavelength 0.49 m at most: N > 390, 1/(2 pi sqrt N) < 0.008. The image in the screen's plane would be
    // reflected 9 m below its edge, N > 6, 20 times as far: 1/(20 * 2 pi sqrt 6) < 0.0033. 20 lg(1 + 0.0113) < 0.1 dB.
    all_below(&plan(10.0, 5.0), 0.1);
    // At the height of source and probe, 30 m apart: N > 300, and N > 11 for the reflection by the screen's plane, 3.5 times
    // as far: 20 lg(1 + 1/(2 pi sqrt 300) + 1/(3.5 * 2 pi sqrt 11)) < 0.2 dB.
    all_below(&plan(0.0, 30.0), 0.2);
    // 5 m apart the reflection would come from half a metre beside the screen: the edge there is felt.
    assert!(plan(0.0, 5.0).edges.iter().any(|e| e.felt));
    let corner = plan_of_room("corner.toml", &[]);
    assert!(corner.edges.iter().all(|e| e.felt));
    assert!(plan_of_room("corner.toml", &["simulation.edges=off"]).edges.is_empty());
}

#[test]
fn too_many_image_sources_lower_the_order_and_say_so() {
    let plan = plan_of_room("corner.toml", &["simulation.reflection_order=9"]);
    assert!(plan.reflection_order < 9 && plan.images <= 50_000.0);
    assert!(plan.warnings.iter().any(|w| w.observation.contains("image sources")));
}

#[test]
fn a_half_plane_that_counts_as_thin_is_said_to_be_so() {
    let warned = |thickness_m: f64, sky: &str| {
        let plan = plan_of(&format!(
            "[[wall]]\nname = \"screen\"\nmaterial = \"rigid\"\nunbounded = true\nthickness_m = {thickness_m:?}\n\
             corners_m = [[0, 0, 0], [0, 0, 1], [0, 1, 1]]\n\
             [[opening]]\nname = \"sky\"\nwall = \"screen\"\nx_m = {sky}\ny_m = [-inf, inf]\n\
             [[source]]\nname = \"s\"\nposition_m = [-2, 0, -1]\n[[probe]]\nname = \"p\"\nposition_m = [2, 0, -1]\n"
        ));
        plan.warnings.iter().any(|w| w.observation.contains("edge of opening \"sky\" as if its wall were thin"))
    };
    assert!(warned(0.5, "[0, inf]") && warned(0.5, "[-inf, 0]"));
    assert!(!warned(0.0, "[0, inf]") && !warned(0.5, "[0, 1]"));
}
