//! What directional microphones make of a direction: spherical harmonics (AmbiX) and patterns of first order.
//!
//! Directions are those sound comes from. The axes of the room are those of AmbiX: x ahead, y to the left, z up.

use glam::DVec3;

use crate::scene::{Directivity, ProbeFormat};

/// Order of the spherical harmonics that a format is made of.
pub(super) fn order(format: ProbeFormat) -> usize {
    match format {
        ProbeFormat::Omni => 0,
        ProbeFormat::Ambix(order) => order.min(3),
        ProbeFormat::Pattern(_) => 1,
    }
}

/// From harmonics to what the probe records.
pub(super) fn recorded(format: ProbeFormat, harmonics: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let ProbeFormat::Pattern(Directivity { omni_share, axis }) = format else { return harmonics };
    let first = (1.0 - omni_share) * axis;
    let weights = [omni_share, first.y, first.z, first.x];
    let mixed = |n: usize| harmonics.iter().zip(weights).map(|(h, w)| w * h[n]).sum();
    vec![(0..harmonics[0].len()).map(mixed).collect()]
}

/// Degree l of a channel.
pub(super) fn degree(channel: usize) -> usize {
    channel.isqrt()
}

/// Real spherical harmonics up to `order` (at most 3) of the unit vector `d`, ACN order, SN3D (AmbiX; Nachbar and others,
/// Ambisonics Symposium 2011).
pub(super) fn harmonics(order: usize, d: DVec3) -> Vec<f64> {
    let DVec3 { x, y, z } = d;
    let (r3, r15, a, b) = (3f64.sqrt(), 15f64.sqrt(), 0.625f64.sqrt(), 0.375f64.sqrt());
    let mut all = vec![
        1.0,
        y,
        z,
        x,
        r3 * x * y,
        r3 * y * z,
        0.5 * (3.0 * z * z - 1.0),
        r3 * x * z,
        0.5 * r3 * (x * x - y * y),
        a * y * (3.0 * x * x - y * y),
        r15 * x * y * z,
        b * y * (5.0 * z * z - 1.0),
        0.5 * z * (5.0 * z * z - 3.0),
        b * x * (5.0 * z * z - 1.0),
        0.5 * r15 * z * (x * x - y * y),
        a * x * (x * x - 3.0 * y * y),
    ];
    all.truncate((order.min(3) + 1).pow(2));
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn harmonics_of_a_degree_add_up_to_one_in_every_direction() {
        // The addition theorem with SN3D: the squares of one degree sum to 1.
        for (x, y, z) in [(1.0, 0.0, 0.0), (0.3, -0.5, 0.7), (-0.2, 0.9, -0.1)] {
            let all = harmonics(3, DVec3::new(x, y, z).normalize());
            for l in 0..4 {
                let sum: f64 = (0..16).filter(|c| degree(*c) == l).map(|c| all[c] * all[c]).sum();
                assert!((sum - 1.0).abs() < 1e-12, "{l}: {sum}");
            }
        }
    }

    #[test]
    fn a_cardioid_hears_nothing_from_behind() {
        let axis = DVec3::new(0.6, 0.0, 0.8);
        let cardioid = ProbeFormat::Pattern(Directivity { omni_share: 0.5, axis });
        for (direction, gain) in [(axis, 1.0), (-axis, 0.0), (DVec3::Y, 0.5)] {
            let channels = harmonics(1, direction).into_iter().map(|h| vec![h]).collect();
            assert!((recorded(cardioid, channels)[0][0] - gain).abs() < 1e-12);
        }
    }
}
