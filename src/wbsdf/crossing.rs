//! One source and one receiver on either side of a portal, seen in the portal's frame.
//!
//! Frame: x across the edges, y along them, z the normal in the direction of travel. Only y differences matter:
//! nothing changes along an edge, so a ray keeps its direction cosine along y (Keller's cone).

use crate::scene::Band;

/// Where the sound comes from, in the portal's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Incident {
    /// A line source parallel to the edges, `z_m` > 0 before the portal.
    Line {
        /// Position across the edges in m.
        x_m: f64,
        /// Distance before the portal in m.
        z_m: f64,
    },
    /// A point source.
    Point {
        /// Position across the edges in m.
        x_m: f64,
        /// Distance before the portal in m.
        z_m: f64,
        /// Receiver minus source along the edges in m.
        dy_m: f64,
    },
    /// A plane wave with these direction cosines along x and y.
    Plane {
        /// Along x.
        s_x: f64,
        /// Along y.
        s_y: f64,
    },
}

/// A source-receiver pair in the portal's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// The source.
    pub incident: Incident,
    /// The receiver across the edges in m.
    pub x_m: f64,
    /// The receiver's distance behind the portal in m, > 0.
    pub z_m: f64,
}

/// The ray through one point of the portal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Sine of the angle of incidence in the plane across the edges.
    pub sin_i: f64,
    /// Its cosine.
    pub cos_i: f64,
    /// Sine of the angle of emergence in that plane.
    pub sin_o: f64,
    /// Its cosine.
    pub cos_o: f64,
    /// Sine of the angle between ray and edge.
    pub sin_beta: f64,
    /// Spherical, cylindrical or plane spreading in 1/m (docs/physics.md, eq. 7): the intensity at the receiver
    /// is the integral of weight * obliquity * spread over x.
    pub spread: f64,
}

impl Ray {
    /// From a line source to a receiver, both as (x, distance from the portal) in m, over the portal at `x_m`.
    #[inline(always)]
    pub(super) fn from_line(source: (f64, f64), receiver: (f64, f64), x_m: f64) -> Self {
        let (into, out) = (x_m - source.0, receiver.0 - x_m);
        let (rho_in, rho_out) =
            ((into * into + source.1 * source.1).sqrt(), (out * out + receiver.1 * receiver.1).sqrt());
        let spread = 1.0 / (rho_in * rho_out);
        // Both reciprocals with one division.
        let (per_in, per_out) = (spread * rho_out, spread * rho_in);
        Self {
            sin_i: into * per_in,
            cos_i: source.1 * per_in,
            sin_o: out * per_out,
            cos_o: receiver.1 * per_out,
            sin_beta: 1.0,
            spread,
        }
    }

    /// From a point source, `dy_square` the squared difference along the edges in m^2.
    #[inline(always)]
    pub(super) fn from_point(source: (f64, f64), receiver: (f64, f64), dy_square: f64, x_m: f64) -> Self {
        let (into, out) = (x_m - source.0, receiver.0 - x_m);
        let (rho_in, rho_out) =
            ((into * into + source.1 * source.1).sqrt(), (out * out + receiver.1 * receiver.1).sqrt());
        let product = 1.0 / (rho_in * rho_out);
        let (per_in, per_out) = (product * rho_out, product * rho_in);
        let rho = rho_in + rho_out;
        let length = (rho * rho + dy_square).sqrt();
        let sin_beta = rho / length;
        // sin^3 beta / (rho_in rho_out rho)
        let spread = product * sin_beta * sin_beta / length;
        Self {
            sin_i: into * per_in,
            cos_i: source.1 * per_in,
            sin_o: out * per_out,
            cos_o: receiver.1 * per_out,
            sin_beta,
            spread,
        }
    }

    /// Of a plane wave from `sin_i` in the plane across the edges.
    #[inline(always)]
    pub(super) fn from_plane(sin_i: f64, sin_beta: f64, receiver: (f64, f64), x_m: f64) -> Self {
        let out = receiver.0 - x_m;
        let per_out = 1.0 / (out * out + receiver.1 * receiver.1).sqrt();
        let cos_i = (1.0 - sin_i * sin_i).max(0.0).sqrt();
        Self { sin_i, cos_i, sin_o: out * per_out, cos_o: receiver.1 * per_out, sin_beta, spread: sin_beta * per_out }
    }

    /// Change of the direction cosine along x, Delta of eq. (3).
    pub fn delta(&self) -> f64 {
        self.sin_beta * (self.sin_o - self.sin_i)
    }

    /// cos(sigma) and sin(delta) with sigma, delta = half sum and half difference of the angles:
    /// cos^2 sigma = (1 + cos(theta_o + theta_i)) / 2.
    pub fn cos_sigma(&self) -> f64 {
        self.cos_sigma_square().max(0.0).sqrt()
    }

    /// cos^2(sigma).
    #[inline]
    pub(super) fn cos_sigma_square(&self) -> f64 {
        0.5 * (1.0 + self.cos_o * self.cos_i - self.sin_o * self.sin_i)
    }

    /// sin(delta), signed like Delta.
    pub fn sin_delta(&self) -> f64 {
        // 2 cos(sigma) sin(delta) = sin_o - sin_i, but cos(sigma) may vanish: use the half-angle form.
        let cos_difference = self.cos_o * self.cos_i + self.sin_o * self.sin_i;
        (0.5 * (1.0 - cos_difference)).max(0.0).sqrt().copysign(self.sin_o - self.sin_i)
    }
}

impl Crossing {
    /// The ray through the portal at `x_m`.
    #[inline]
    pub fn ray(&self, x_m: f64) -> Ray {
        let receiver = (self.x_m, self.z_m);
        match self.incident {
            Incident::Line { x_m: source, z_m } => Ray::from_line((source, z_m), receiver, x_m),
            Incident::Point { x_m: source, z_m, dy_m } => Ray::from_point((source, z_m), receiver, dy_m * dy_m, x_m),
            Incident::Plane { s_x, s_y } => {
                let sin_beta = (1.0 - s_y * s_y).sqrt();
                Ray::from_plane(s_x / sin_beta, sin_beta, receiver, x_m)
            }
        }
    }

    /// Length of the ray over the portal at `x_m` in the plane across the edges, in m; for a plane wave relative
    /// to the wave front through the portal's origin.
    pub fn length_m(&self, x_m: f64) -> f64 {
        let out = (self.x_m - x_m).hypot(self.z_m);
        match self.incident {
            Incident::Line { x_m: source, z_m } | Incident::Point { x_m: source, z_m, .. } => {
                (x_m - source).hypot(z_m) + out
            }
            Incident::Plane { s_x, s_y } => x_m * s_x / (1.0 - s_y * s_y).sqrt() + out,
        }
    }

    /// Where the straight line from source to receiver crosses the portal, in m along x: Delta is 0 there.
    pub fn straight_x_m(&self) -> f64 {
        match self.incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => {
                (x_m * self.z_m + self.x_m * z_m) / (z_m + self.z_m)
            }
            Incident::Plane { s_x, s_y } => {
                let sin_i = s_x / (1.0 - s_y * s_y).sqrt();
                self.x_m - self.z_m * sin_i / (1.0 - sin_i * sin_i).max(1e-300).sqrt()
            }
        }
    }

    /// Intensity with the screen taken away, relative to the free field at 1 m: 1/r (line), 1/r^2 (point), 1 (plane).
    pub fn free_intensity(&self) -> f64 {
        match self.incident {
            Incident::Line { x_m, z_m } => 1.0 / (self.x_m - x_m).hypot(self.z_m + z_m),
            Incident::Point { x_m, z_m, dy_m } => {
                1.0 / ((self.x_m - x_m).powi(2) + (self.z_m + z_m).powi(2) + dy_m * dy_m)
            }
            Incident::Plane { .. } => 1.0,
        }
    }

    /// Sine of the angle between the straight line and the edge: k sin(beta) is the wave number of the
    /// two-dimensional problem across the edges.
    pub fn sin_beta(&self) -> f64 {
        match self.incident {
            Incident::Line { .. } => 1.0,
            Incident::Point { x_m, z_m, dy_m } => {
                let rho = (self.x_m - x_m).hypot(self.z_m + z_m);
                rho / rho.hypot(dy_m)
            }
            Incident::Plane { s_y, .. } => (1.0 - s_y * s_y).sqrt(),
        }
    }
}

/// A band as the weights need it: centre, width and speed of sound.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spectrum {
    /// Lower edge in Hz.
    pub low_hz: f64,
    /// Upper edge in Hz.
    pub high_hz: f64,
    /// Speed of sound in m/s.
    pub speed_m_s: f64,
}

impl Spectrum {
    /// The band `band` at `speed_m_s`.
    pub fn new(band: &Band, speed_m_s: f64) -> Self {
        Self { low_hz: band.low_hz, high_hz: band.high_hz, speed_m_s }
    }

    /// A single frequency.
    pub fn tone(frequency_hz: f64, speed_m_s: f64) -> Self {
        Self { low_hz: frequency_hz, high_hz: frequency_hz, speed_m_s }
    }

    /// Wave number in 1/m at the upper edge.
    pub fn high_k(&self) -> f64 {
        std::f64::consts::TAU * self.high_hz / self.speed_m_s
    }

    /// Wave number in 1/m at the lower edge.
    pub fn low_k(&self) -> f64 {
        std::f64::consts::TAU * self.low_hz / self.speed_m_s
    }
}
