//! The power balance of a crossing: what a ray sends out is what the opening passes.
//!
//! The share of a ray's power per outgoing direction is a product over the two sides of an opening. It is symmetric in both
//! directions (reciprocity), but its integral over the outgoing hemisphere is not exactly the opening's transmission: the part of
//! the lobe beyond grazing is cut off, and obliquity and lobe of one side do not know the other. A door 8 rad wide lost 10 % of a
//! diffuse field so. One factor a band takes that back on the average over diffuse incidence and leaves the symmetry.

use std::f64::consts::TAU;

use glam::DVec3;

/// Smallest cosine in the obliquity ratio: grazing rays carry no flux, and their weight stays bounded.
pub(super) const MIN_COS: f64 = 0.05;
/// Pairs of directions behind the factor: it is known to about 1 %.
const DRAWS: usize = 8192;

/// The factor for a share of which `draw` gives a sample over its density, from an incident direction and two uniform numbers
/// (0 where it is evanescent), and for the transmission `passes` of an incident direction.
pub(super) fn diffuse_balance(draw: impl Fn(DVec3, [f64; 2]) -> f64, passes: impl Fn(DVec3) -> f64) -> f64 {
    let (mut sent, mut passed) = (0.0, 0.0);
    for n in 1..=DRAWS {
        // A Kronecker sequence in four dimensions; incidence by Lambert's law.
        let u = |step: f64| (0.5 + n as f64 * step).fract();
        let (sin2, (sin, cos)) = (u(0.856_674_883_9), (TAU * u(0.733_891_856_6)).sin_cos());
        let s_i = DVec3::new(sin2.sqrt() * cos, sin2.sqrt() * sin, (1.0 - sin2).sqrt());
        sent += draw(s_i, [u(0.628_706_721_0), u(0.538_597_257_2)]);
        passed += passes(s_i);
    }
    if sent > 0.0 { passed / sent } else { 1.0 }
}

/// The product of the two directions' ratios O^2/(cos theta_i cos theta_o) is 1 on the shadow boundary, as it must be,
/// but counts a grazing direction's small cosine twice. With C = cos theta / (cos theta_x cos theta_y) <= 1 of a
/// direction, C_i C_o takes one of them back; near the shadow boundary it is divided by C^2 of the mean direction,
/// near meaning a change of direction small against the cosines with the normal.
pub(super) fn grazing_balance(s_i: DVec3, s_o: DVec3) -> f64 {
    let c = |s: DVec3| {
        let z = s.z.max(MIN_COS);
        z / (s.x.hypot(z) * s.y.hypot(z))
    };
    let mean = c((s_i + s_o).normalize()).powi(2);
    let change = (s_o.x - s_i.x).powi(2) + (s_o.y - s_i.y).powi(2);
    let far = change / (change + s_i.z.max(MIN_COS) * s_o.z.max(MIN_COS));
    c(s_i) * c(s_o) / (mean + (1.0 - mean) * far)
}

/// Cell and fraction of `t` in 0..=1 on a table of `count` equidistant nodes.
pub(super) fn place(t: f64, count: usize) -> (usize, f64) {
    let t = t.clamp(0.0, 1.0) * (count - 1) as f64;
    let low = (t as usize).min(count - 2);
    (low, t - low as f64)
}
