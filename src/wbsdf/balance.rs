//! The power balance of a crossing: one factor a direction, so that what a ray sends out is what the opening passes.
//!
//! The share of a ray's power per outgoing direction is a product over the two sides of an opening and is symmetric in both
//! directions, K(i, o) = K(o, i) (reciprocity), but its integral over the outgoing hemisphere is not exactly the opening's
//! transmission T(i): the part of the lobe beyond grazing is cut off, and obliquity and lobe of one side do not know the
//! other. A door 8 rad wide lost 10 % of a diffuse field so. Factors a with
//!
//!     a(i) int K(i, o) a(o) do = T(i)
//!
//! take the balance back and keep the symmetry (Sinkhorn's scaling of a symmetric kernel); they tend to 1 where the opening is
//! wide.

use glam::DVec3;

/// Smallest cosine in the obliquity ratio: grazing rays carry no flux, and their weight stays bounded.
pub(super) const MIN_COS: f64 = 0.05;
/// Nodes over each of |s_x| and |s_y| / sqrt(1 - s_x^2), both 0 to 1.
const NODES: usize = 6;
/// Outgoing directions a node: the integral is known to about 1 %.
const DIRECTIONS: usize = 192;
/// Steps of the scaling; each takes the square root of what is left.
const STEPS: usize = 6;
/// Bounds of a factor: grazing directions, whose power is small, are not to be forced.
const BOUNDS: [f64; 2] = [0.5, 2.0];

/// The factors of one band.
pub(super) struct Balance([[f64; NODES]; NODES]);

impl Balance {
    /// No change.
    pub(super) const NONE: Self = Self([[1.0; NODES]; NODES]);

    /// The factors for a kernel that `draw`s an outgoing direction for an incident one from two uniform numbers, with K over
    /// the density of the draw (`None` where it is evanescent), and for the transmission `passes` of an incident direction.
    pub(super) fn new(draw: impl Fn(DVec3, [f64; 2]) -> Option<(DVec3, f64)>, passes: impl Fn(DVec3) -> f64) -> Self {
        let at = |i: usize| i as f64 / (NODES - 1) as f64;
        // The outermost directions, which carry nothing, stand a little inside.
        let incident = |i: usize, j: usize| {
            let (x, v) = (0.98 * at(i), 0.98 * at(j));
            let y = v * (1.0 - x * x).sqrt();
            DVec3::new(x, y, (1.0 - x * x - y * y).sqrt())
        };
        let kernel: Vec<(f64, Vec<(DVec3, f64)>)> = (0..NODES * NODES)
            .map(|n| {
                let s_i = incident(n / NODES, n % NODES);
                // A Kronecker sequence.
                let u = |m: usize, step: f64| (0.5 + (m + 1) as f64 * step).fract();
                let drawn = (0..DIRECTIONS).filter_map(|m| draw(s_i, [u(m, 0.754_877_666), u(m, 0.569_840_291)]));
                (passes(s_i), drawn.collect())
            })
            .collect();
        let mut balance = Self::NONE;
        for _ in 0..STEPS {
            let mut next = balance.0;
            for (n, (passes, drawn)) in kernel.iter().enumerate() {
                let sent = drawn.iter().map(|(s_o, k)| k * balance.at(*s_o)).sum::<f64>() / DIRECTIONS as f64;
                let factor = &mut next[n / NODES][n % NODES];
                if sent > 0.0 {
                    *factor = (*factor * passes / sent).sqrt().clamp(BOUNDS[0], BOUNDS[1]);
                }
            }
            balance.0 = next;
        }
        balance
    }

    /// The factor of a direction.
    pub(super) fn at(&self, s: DVec3) -> f64 {
        let (x, y) = (s.x.abs(), s.y.abs());
        let ((i, fi), (j, fj)) = (place(x, NODES), place(y / (1.0 - x * x).max(1e-12).sqrt(), NODES));
        let row = |i: usize| self.0[i][j] * (1.0 - fj) + self.0[i][j + 1] * fj;
        row(i) * (1.0 - fi) + row(i + 1) * fi
    }
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
