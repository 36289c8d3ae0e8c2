//! A plane wave behind a rigid half-plane, round the shadow boundary.
//!
//! Phenomenon: sound bends round an edge. The level falls from free field through about -6 dB on the shadow boundary
//! (270 degrees here) into the shadow, although no ray carries a phase.
//! Expected: the signed rays follow Sommerfeld's exact solution, averaged over the 1 kHz octave, within 0.02 dB.
//! Source: A. Sommerfeld, Mathematische Annalen 47, 1896; in the form of Born and Wolf, Principles of Optics, section 11.5.

use std::f64::consts::PI;

use diffray::geometry::Geometry;
use diffray::plan::Plan;
use diffray::scene::Scene;
use diffray::simulate;
use num_complex::Complex64;
use spec_math::Fresnel;

const SPEED_M_S: f64 = 343.0;
const RADIUS_M: f64 = 2.0;

/// exp(-i pi/4)/sqrt(pi) times the integral of exp(i t^2) from -infinity to x.
fn step(x: f64) -> Complex64 {
    let f = (x * (2.0 / PI).sqrt()).fresnel();
    Complex64::from_polar(0.5f64.sqrt(), -0.25 * PI) * Complex64::new(0.5 + f.c, 0.5 + f.s)
}

/// Sommerfeld's pressure at `RADIUS_M` and angle `phi` from the rigid screen; the wave comes from 90 degrees.
fn pressure(k: f64, phi: f64) -> Complex64 {
    let term = |angle: f64| {
        Complex64::from_polar(1.0, -k * RADIUS_M * angle.cos())
            * step((2.0 * k * RADIUS_M).sqrt() * (0.5 * angle).cos())
    };
    term(phi - 0.5 * PI) + term(phi + 0.5 * PI)
}

/// Mean of the squared pressure over the 1 kHz octave in dB.
fn exact_db(phi: f64) -> f64 {
    let (low, high, n) = (1000.0 / 2f64.sqrt(), 1000.0 * 2f64.sqrt(), 256);
    let at = |i: usize| low + (high - low) * (i as f64 + 0.5) / n as f64;
    let sum: f64 = (0..n).map(|i| pressure(2.0 * PI * at(i) / SPEED_M_S, phi).norm_sqr()).sum();
    10.0 * (sum / n as f64).log10()
}

fn main() -> diffray::error::Result<()> {
    let angles: Vec<f64> = (0..15).map(|i| 200.0 + 10.0 * f64::from(i)).collect();
    let mut room = String::from(
        r#"
        air = { speed_of_sound_m_s = 343.0, absorption = false }
        bands = { from_hz = 1000, to_hz = 1000 }
        wall = [{ name = "screen", corners_m = [[0, 0, 0], [1, 0, 0], [1, 0, 1]], unbounded = true }]
        opening = [{ name = "edge", wall = "screen", x_m = [-inf, 0.0] }]
        source = [{ name = "wave", kind = "plane", direction = [0, -1, 0], position_m = [0, 1, 0] }]
        "#,
    );
    for angle in &angles {
        let (sin, cos) = angle.to_radians().sin_cos();
        let (x, y) = (RADIUS_M * cos, RADIUS_M * sin);
        room += &format!("\n[[probe]]\nname = \"at {angle}\"\nposition_m = [{x:?}, {y:?}, 0]\n");
    }
    let scene = Scene::from_str(&room, "half-plane", &[])?.scene;
    let geometry = Geometry::new(&scene)?;
    let outcome = simulate::run(&scene, &geometry, &Plan::new(&scene, &geometry), &|_| {})?;
    println!("angle  signed rays  Sommerfeld  difference (dB, 1 kHz octave)");
    for (angle, reception) in angles.iter().zip(&outcome.receptions) {
        let (level, exact) = (reception.levels[0].level_db(), exact_db(angle.to_radians()));
        println!("{angle:5}  {level:11.3}  {exact:10.3}  {:10.3}", level - exact);
    }
    Ok(())
}
