//! Random numbers keyed by (seed, source, ray): every ray has a stream of its own and can be traced again alone.

use glam::DVec3;
use rand_core::Rng;
use rand_pcg::Pcg64;

/// The random numbers of one ray.
///
/// State and stream of a PCG64 are hashed from the key, so that neighbouring rays start at unrelated points of
/// unrelated streams.
pub(super) struct Stream(Pcg64);

impl Stream {
    /// The stream of one ray of one source.
    pub(super) fn new(seed: u64, source: usize, ray: u64) -> Self {
        let mut key = mix(mix(mix(seed) ^ source as u64) ^ ray);
        let mut word = || {
            key = mix(key);
            u128::from(key)
        };
        let state = word() << 64 | word();
        let stream = word() << 64 | word();
        Self(Pcg64::new(state, stream))
    }

    /// Uniform in [0, 1).
    #[inline]
    pub(super) fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// A unit vector, uniform over the sphere.
    pub(super) fn isotropic(&mut self) -> DVec3 {
        let z = 1.0 - 2.0 * self.uniform();
        let (sin, cos) = (std::f64::consts::TAU * self.uniform()).sin_cos();
        let r = (1.0 - z * z).max(0.0).sqrt();
        DVec3::new(r * cos, r * sin, z)
    }

    /// A unit vector on the side of the unit vector `normal`, with density cos/pi (Lambert's law): the normal plus a point
    /// of the unit sphere, made a unit vector.
    #[inline]
    pub(super) fn lambert(&mut self, normal: DVec3) -> DVec3 {
        loop {
            let sum = normal + self.isotropic();
            let length2 = sum.length_squared();
            if length2 > 1e-12 {
                return sum / length2.sqrt();
            }
        }
    }
}

/// SplitMix64's output function (Steele, Lea, Flood 2014): every bit of the input moves about half the output bits.
fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_repeat_and_differ() {
        let draw = |seed, source, ray| {
            let mut s = Stream::new(seed, source, ray);
            [s.uniform(), s.uniform()]
        };
        assert_eq!(draw(1, 0, 5), draw(1, 0, 5));
        assert_ne!(draw(1, 0, 5), draw(1, 0, 6));
        assert_ne!(draw(1, 0, 5), draw(1, 1, 5));
        assert_ne!(draw(1, 0, 5), draw(2, 0, 5));
    }

    #[test]
    fn lambert_directions_have_the_mean_cosine_two_thirds() {
        let normal = DVec3::new(0.6, 0.0, 0.8);
        let n = 100_000;
        let (mut cos, mut cos2) = (0.0, 0.0);
        for ray in 0..n {
            let d = Stream::new(7, 0, ray).lambert(normal);
            assert!((d.length() - 1.0).abs() < 1e-12);
            cos += d.dot(normal) / n as f64;
            cos2 += d.dot(normal).powi(2) / n as f64;
        }
        // Standard deviations of cos and cos^2 under density 2 cos d(cos): sqrt(1/18), sqrt(1/12); 4 standard errors.
        assert!((cos - 2.0 / 3.0).abs() < 4.0 * (1.0f64 / 18.0 / n as f64).sqrt(), "{cos}");
        assert!((cos2 - 0.5).abs() < 4.0 * (1.0f64 / 12.0 / n as f64).sqrt(), "{cos2}");
    }

    #[test]
    fn first_numbers_of_neighbouring_rays_are_uncorrelated() {
        let n = 100_000;
        let mean = (0..n)
            .map(|ray| (Stream::new(1, 0, ray).uniform() - 0.5) * (Stream::new(1, 0, ray + 1).uniform() - 0.5))
            .sum::<f64>()
            / n as f64;
        // Product of two independent uniform deviations: standard deviation 1/12.
        assert!(mean.abs() < 4.0 / 12.0 / (n as f64).sqrt(), "{mean}");
    }
}
