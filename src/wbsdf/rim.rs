//! A rectangular opening of many wavelengths: the direct sound and what each of its four edges sends, as pressures.
//!
//! Each edge is that of a rigid half-plane, exact up to its ends (Biot and Tolstoy's integral between limits, wedge.rs),
//! whatever the angle between ray and edge. Left out: what is diffracted by two edges in turn, and the corners themselves.

use std::f64::consts::TAU;

use glam::DVec3;
use num_complex::Complex64;

use super::crossing::Spectrum;
use super::edge::AboutEdge;
use super::slit::{MOST_FREQUENCIES, gauss_nodes};
use super::wedge::{Wave, WedgeField};

/// One edge: its field, and the length in m of the way over it that phases count from.
struct Edge {
    field: WedgeField,
    over_m: f64,
}

/// Intensity at `receiver` of a point source at `source`, on opposite sides of z = 0, relative to the free field at 1 m:
/// band mean through the thin opening `x_m` by `y_m`.
pub(super) fn intensity(x_m: [f64; 2], y_m: [f64; 2], source: DVec3, receiver: DVec3, spectrum: &Spectrum) -> f64 {
    let turned = |p: DVec3| DVec3::new(p.y, p.x, p.z);
    let edges = [
        edge(x_m[0], -1.0, y_m, source, receiver, spectrum),
        edge(x_m[1], 1.0, y_m, source, receiver, spectrum),
        edge(y_m[0], -1.0, x_m, turned(source), turned(receiver), spectrum),
        edge(y_m[1], 1.0, x_m, turned(source), turned(receiver), spectrum),
    ];
    let straight_m = (receiver - source).length();
    let at = source + (receiver - source) * (source.z / (source.z - receiver.z));
    // On an edge half of the direct sound is seen: the edge's own part vanishes there.
    let seen = |x: f64, limits: [f64; 2]| match (x - limits[0]).min(limits[1] - x) {
        inside if inside.abs() < 1e-9 => 0.5,
        inside if inside > 0.0 => 1.0,
        _ => 0.0,
    };
    let direct = seen(at.x, x_m) * seen(at.y, y_m) / straight_m;
    let ways = edges.iter().flat_map(|e| e.field.ways_m());
    let (low, high) = (spectrum.low_k(), spectrum.high_k());
    let farthest = ways.fold(0.0_f64, |a, way| a.max(way - straight_m));
    let count = if high > low { 5 + ((0.7 * (high - low) * farthest).ceil() as usize).min(MOST_FREQUENCIES) } else { 1 };
    let power = |k: f64| {
        let sent = edges.iter().map(|edge| {
            let parts = edge.field.diffracted(k, |_| 1.0);
            (parts.incident + parts.faces[0] + parts.faces[1]) * Complex64::from_polar(1.0, k * edge.over_m)
        });
        (Complex64::from_polar(direct, k * straight_m) + sent.sum::<Complex64>()).norm_sqr()
    };
    gauss_nodes(low, high, count).map(|(k, weight)| weight * power(k)).sum()
}

/// The edge at `edge_m` along x with its screen towards `side` of it, from `ends_m[0]` to `ends_m[1]` along y.
fn edge(edge_m: f64, side: f64, ends_m: [f64; 2], source: DVec3, receiver: DVec3, spectrum: &Spectrum) -> Edge {
    let about = |p: DVec3| ((p.x - edge_m) * side, p.z.abs());
    let ((x_s, z_s), (x_r, z_r)) = (about(source), about(receiver));
    let from = AboutEdge { r_m: x_s.hypot(z_s), phi: z_s.atan2(x_s) };
    let to = AboutEdge { r_m: x_r.hypot(z_r), phi: TAU - z_r.atan2(x_r) };
    let dy = receiver.y - source.y;
    let ends = ends_m.map(|y| y - source.y);
    let field = WedgeField::between(TAU, from, to, Wave::Point(dy), ends, spectrum);
    Edge { field, over_m: (from.r_m + to.r_m).hypot(dy) }
}

#[cfg(test)]
mod tests {
    use super::super::hatch::Hatch;
    use super::super::mask::{Jambs, Mask};
    use super::super::product::Product;
    use super::*;

    #[test]
    fn tmp_rim_vs_exact() {
        let mut state = 7u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        for (w, h) in [(0.9, 2.0), (1.0, 1.0), (0.1, 2.0)] {
            for ka in [12.0, 20.0, 28.0, 40.0] {
                for (most, over) in [(30.0, 80.0), (60.0, 60.0), (80.0, 80.0)] {
                    let k = ka / h;
                    let spectrum = Spectrum {
                        low_hz: k * 343.0 / TAU * 0.6667,
                        high_hz: k * 343.0 / TAU * 1.3333,
                        speed_m_s: 343.0,
                    };
                    let (x, y) = ([-w / 2.0, w / 2.0], [-h / 2.0, h / 2.0]);
                    let n = 4 + (0.7 * k * 0.6667 * f64::hypot(w, h)).ceil() as usize;
                    let nodes: Vec<(f64, f64)> = gauss_nodes(spectrum.low_k(), spectrum.high_k(), n).collect();
                    let hatch = Hatch::new(x, y, 0.0, &nodes);
                    let product = Product::new(&Mask::new(&[x]), &Mask::new(&[y]), 0.0, &spectrum, Jambs::Rigid);
                    let mut errors = [Vec::new(), Vec::new()];
                    let mut time = [0.0, 0.0];
                    for _ in 0..60 {
                        let mut point = |sign: f64| {
                            let most = f64::to_radians(if sign < 0.0 { most } else { over });
                            let low = most.cos();
                            let (cos, turn, r) = (low + (1.0 - low) * random(), TAU * random(), 1.0 + 2.5 * random());
                            let sin = f64::sqrt(1.0 - cos * cos);
                            DVec3::new(r * sin * turn.cos(), r * sin * turn.sin(), sign * r * cos)
                        };
                        let (s, r) = (point(-1.0), point(1.0));
                        let exact = hatch.intensity(&hatch.driven(&hatch.view(s)), &hatch.view(r));
                        let t0 = std::time::Instant::now();
                        let a = product.intensity(s, r);
                        time[0] += t0.elapsed().as_secs_f64() / 60e-6;
                        let t0 = std::time::Instant::now();
                        let b = intensity(x, y, s, r, &spectrum);
                        time[1] += t0.elapsed().as_secs_f64() / 60e-6;
                        errors[0].push((10.0 * (a / exact).log10()).abs());
                        errors[1].push((10.0 * (b / exact).log10()).abs());
                    }
                    for e in &mut errors {
                        e.sort_by(f64::total_cmp);
                    }
                    let q = |e: &[f64]| format!("{:.3} {:.3} {:.3}", e[30], e[54], e[59]);
                    println!(
                        "{w} {h} ka {ka} {most} {over}: product {} ({:.0} us) rim {} ({:.0} us)",
                        q(&errors[0]),
                        time[0],
                        q(&errors[1]),
                        time[1]
                    );
                }
            }
        }
    }
}
