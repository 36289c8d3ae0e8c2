//! A plan, printed and asked, without running anything.
//!
//! Phenomenon: how an opening must be modelled depends on its width in wavelengths.
//! Expected: with the door 0.1 m open, k times width is 12 at 6.5 kHz: below, the exact aperture; above, signed rays with
//! a closed band mean. No ray is traced: line sources have deterministic paths only.
//! Source: docs/physics.md, "Infinitely long openings".

use diffray::geometry::Geometry;
use diffray::plan::Plan;
use diffray::scene::Scene;

const ROOM: &str = r#"
name = "A door, almost closed"
air = { speed_of_sound_m_s = 343.0, absorption = false }
wall = [{ name = "screen", corners_m = [[0, 0, 0], [1, 0, 0], [1, 0, 1]], unbounded = true }]
source = [{ name = "line", kind = "line", axis = [0, 0, 1], position_m = [0, 2, 0] }]
probe = [{ name = "mic", position_m = [0, -2, 0] }]

[[opening]]
name = "door"
wall = "screen"
x_m = [0.0, 1.2]
door = { open_m = 0.1 }
"#;

fn main() -> diffray::error::Result<()> {
    let scene = Scene::from_str(ROOM, "door", &[])?.scene;
    let geometry = Geometry::new(&scene)?;
    let plan = Plan::new(&scene, &geometry);
    print!("{}", plan.text());
    println!("\nband (Hz)       ka  model");
    for band in &plan.portals[0].bands {
        println!("{:9}  {:7.3}  {}", band.band_hz, band.ka.unwrap_or(f64::NAN), band.model.name());
    }
    Ok(())
}
