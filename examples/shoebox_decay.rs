//! Decay time of a shoebox with diffusely reflecting walls.
//!
//! Phenomenon: in a room whose walls scatter, sound decays exponentially.
//! Expected: Eyring's time, 24 ln(10) V / (-c S ln(1 - a)); it holds for one mean free path 4V/S, and the spread of the
//! free paths (relative variance 0.34 in rooms like a cube) lengthens it by a few per cent: Kuttruff's correction.
//! Source: C. F. Eyring, J. Acoust. Soc. Am. 1, 1930; H. Kuttruff, Room Acoustics, section 5.4.

use diffray::geometry::Geometry;
use diffray::plan::Plan;
use diffray::response;
use diffray::scene::Scene;
use diffray::simulate;

const ROOM: &str = r#"
air = { speed_of_sound_m_s = 343.0, absorption = false }
bands = { from_hz = 1000, to_hz = 1000 }
source = [{ name = "source", position_m = [1.5, 2.0, 2.5] }]
probe = [{ name = "probe", position_m = [4.0, 4.5, 3.0] }]
simulation = { max_rays = 20_000, target_db = 0.05 }

[material.even]
absorption = 0.2
scattering = 1.0

[[box]]
name = "room"
min_m = [0, 0, 0]
max_m = [6, 6, 6]
material = "even"
"#;

fn main() -> diffray::error::Result<()> {
    println!("absorption   T30 (s)  Eyring (s)  Kuttruff (s)");
    for absorption in [0.1, 0.2, 0.4] {
        let room = ROOM.replace("absorption = 0.2", &format!("absorption = {absorption}"));
        let scene = Scene::from_str(&room, "shoebox", &[])?.scene;
        let geometry = Geometry::new(&scene)?;
        let outcome = simulate::run(&scene, &geometry, &Plan::new(&scene, &geometry), &|_| {})?;
        let metrics = response::metrics(&outcome.receptions[0], &scene.bands);
        let t30 = metrics[0].t30.seconds.unwrap_or(f64::NAN);
        let (volume, surface, exponent) = (216.0, 216.0, (1.0f64 - absorption).ln());
        let eyring = 24.0 * 10f64.ln() * volume / (-343.0 * surface * exponent);
        let kuttruff = eyring / (1.0 + 0.5 * 0.342 * exponent);
        println!("{absorption:10}  {t30:8.3}  {eyring:10.3}  {kuttruff:12.3}");
    }
    Ok(())
}
