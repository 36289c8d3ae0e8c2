//! Plane polygons: frames, simplicity, and what lies inside.

use glam::{DVec2, DVec3};

use super::Frame;

/// Twice the vector area of a closed polygon in m^2 (Newell's method); its direction is the normal about which the
/// corners run counter-clockwise.
pub(super) fn newell(corners: &[DVec3]) -> DVec3 {
    let first = corners.first().copied().unwrap_or_default();
    edges(corners).map(|(a, b)| (a - first).cross(b - first)).sum()
}

/// The edges of a closed polygon in order.
pub(super) fn edges<P: Copy>(corners: &[P]) -> impl Iterator<Item = (P, P)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Origin at the first corner, x towards the second, y into the polygon, normal = x cross y.
/// `None` where the first two corners coincide or the polygon has no area.
pub(super) fn frame(corners: &[DVec3]) -> Option<Frame> {
    let normal = newell(corners).try_normalize()?;
    let [first, second, ..] = corners else { return None };
    let along = *second - *first;
    let x = (along - normal * along.dot(normal)).try_normalize()?;
    // The interior lies to the left of each edge seen against the normal, and normal cross x is that left.
    Some(Frame { origin_m: *first, x, y: normal.cross(x), normal })
}

/// The first two edges (numbered from 0) that cross, touch or overlap though they are not neighbours, or fold back on
/// each other though they are; `None`: the polygon is simple. `slack` is a length in m.
pub(super) fn crossing(corners: &[DVec2], slack: f64) -> Option<(usize, usize)> {
    let n = corners.len();
    let edge = |i: usize| (corners[i], corners[(i + 1) % n]);
    for i in 0..n {
        for j in i + 1..n {
            let ((a, b), (c, d)) = (edge(i), edge(j));
            let bad = if j == i + 1 {
                folds_back(a, b, d, slack)
            } else if (j + 1) % n == i {
                folds_back(c, d, b, slack)
            } else {
                segment_distance(a, b, c, d) <= slack
            };
            if bad {
                return Some((i, j));
            }
        }
    }
    None
}

/// Whether the edge from `b` to `c` runs back along the edge from `a` to `b`.
fn folds_back(a: DVec2, b: DVec2, c: DVec2, slack: f64) -> bool {
    let (back, onward) = (a - b, c - b);
    back.dot(onward) > 0.0 && back.perp_dot(onward).abs() <= slack * back.length().max(onward.length())
}

/// Distance of a point from a segment in m.
pub(super) fn point_distance(p: DVec2, a: DVec2, b: DVec2) -> f64 {
    let along = b - a;
    let t =
        if along.length_squared() > 0.0 { ((p - a).dot(along) / along.length_squared()).clamp(0.0, 1.0) } else { 0.0 };
    (a + along * t - p).length()
}

/// Distance of two segments in m; 0 where they cross.
fn segment_distance(a: DVec2, b: DVec2, c: DVec2, d: DVec2) -> f64 {
    let side = |p: DVec2, q: DVec2, r: DVec2| (q - p).perp_dot(r - p);
    if side(a, b, c) * side(a, b, d) < 0.0 && side(c, d, a) * side(c, d, b) < 0.0 {
        return 0.0;
    }
    point_distance(a, c, d).min(point_distance(b, c, d)).min(point_distance(c, a, b)).min(point_distance(d, a, b))
}

/// Whether a point lies in the polygon or within `slack` m of its outline.
pub(super) fn contains(corners: &[DVec2], p: DVec2, slack: f64) -> bool {
    if edges(corners).any(|(a, b)| point_distance(p, a, b) <= slack) {
        return true;
    }
    let mut inside = false;
    for (a, b) in edges(corners) {
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (p.y - a.y) / (b.y - a.y) * (b.x - a.x) {
            inside = !inside;
        }
    }
    inside
}

/// Whether two polygons have an area in common, and not only points or sides (to `slack` m).
pub(super) fn overlap(a: &[DVec2], b: &[DVec2], slack: f64) -> bool {
    let well_inside = |polygon: &[DVec2], p: DVec2| {
        contains(polygon, p, 0.0) && edges(polygon).all(|(from, to)| point_distance(p, from, to) > slack)
    };
    let cross = |(p, q): (DVec2, DVec2), (r, s): (DVec2, DVec2)| {
        let side = |u: DVec2, v: DVec2, w: DVec2| (v - u).perp_dot(w - u) / (v - u).length();
        let apart = |x: f64, y: f64| x.min(y) < -slack && x.max(y) > slack;
        apart(side(p, q, r), side(p, q, s)) && apart(side(r, s, p), side(r, s, q))
    };
    edges(a).any(|first| edges(b).any(|second| cross(first, second)))
        || points_of_interest(a).any(|p| well_inside(b, p))
        || points_of_interest(b).any(|p| well_inside(a, p))
}

/// Corners, middles of sides and one point of the interior, which tells equal polygons from neighbours.
fn points_of_interest(polygon: &[DVec2]) -> impl Iterator<Item = DVec2> + '_ {
    edges(polygon).flat_map(|(a, b)| [a, (a + b) / 2.0]).chain(centre_of_an_ear(polygon))
}

/// The centre of the first triangle of neighbouring corners that lies in the polygon: a point of its interior.
fn centre_of_an_ear(polygon: &[DVec2]) -> Option<DVec2> {
    let n = polygon.len();
    (0..n)
        .map(|i| (polygon[i] + polygon[(i + 1) % n] + polygon[(i + 2) % n]) / 3.0)
        .find(|p| contains(polygon, *p, 0.0))
}

/// Whether a rectangle lies wholly in the polygon, up to `slack` m.
pub(super) fn contains_rectangle(corners: &[DVec2], x: [f64; 2], y: [f64; 2], slack: f64) -> bool {
    let rectangle = [DVec2::new(x[0], y[0]), DVec2::new(x[1], y[0]), DVec2::new(x[1], y[1]), DVec2::new(x[0], y[1])];
    if !rectangle.iter().all(|corner| contains(corners, *corner, slack)) {
        return false;
    }
    // An outline that enters the rectangle has a piece well inside it.
    !edges(corners).any(|(a, b)| enters(a, b, [x[0] + slack, x[1] - slack], [y[0] + slack, y[1] - slack]))
}

/// Whether a segment passes through the interior of a rectangle (clipping by the four sides).
fn enters(a: DVec2, b: DVec2, x: [f64; 2], y: [f64; 2]) -> bool {
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for (start, delta, [low, high]) in [(a.x, b.x - a.x, x), (a.y, b.y - a.y, y)] {
        if low >= high {
            return false;
        }
        if delta == 0.0 {
            if start <= low || start >= high {
                return false;
            }
            continue;
        }
        let (t0, t1) = ((low - start) / delta, (high - start) / delta);
        from = from.max(t0.min(t1));
        to = to.min(t0.max(t1));
    }
    from < to
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(list: &[(f64, f64)]) -> Vec<DVec2> {
        list.iter().map(|(x, y)| DVec2::new(*x, *y)).collect()
    }

    const ELL: [(f64, f64); 6] = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0), (2.0, 4.0), (0.0, 4.0)];

    #[test]
    fn a_bow_tie_crosses_itself_and_an_ell_does_not() {
        assert_eq!(crossing(&points(&[(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)]), 1e-9), Some((0, 2)));
        assert_eq!(crossing(&points(&ELL), 1e-9), None);
        assert_eq!(crossing(&points(&[(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)]), 1e-9), None);
        // A corner in the middle of a straight side is harmless, a spike is not.
        assert_eq!(crossing(&points(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]), 1e-9), None);
        assert!(crossing(&points(&[(0.0, 0.0), (3.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)]), 1e-9).is_some());
    }

    #[test]
    fn rectangles_must_lie_wholly_in_a_concave_polygon() {
        let ell = points(&ELL);
        assert!(contains_rectangle(&ell, [0.0, 4.0], [0.0, 2.0], 1e-9));
        assert!(contains_rectangle(&ell, [0.5, 1.5], [0.5, 3.5], 1e-9));
        assert!(!contains_rectangle(&ell, [0.5, 3.0], [0.5, 3.0], 1e-9));
        // All four corners inside, but the notch of a U between them.
        let u =
            points(&[(0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (2.0, 3.0), (2.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)]);
        assert!(!contains_rectangle(&u, [0.5, 2.5], [0.5, 2.5], 1e-9));
    }

    #[test]
    fn neighbours_share_no_area_and_equal_polygons_do() {
        let square = |x: f64, size: f64| points(&[(x, 0.0), (x + size, 0.0), (x + size, size), (x, size)]);
        assert!(!overlap(&square(0.0, 1.0), &square(1.0, 1.0), 1e-6));
        assert!(!overlap(&square(0.0, 1.0), &square(3.0, 1.0), 1e-6));
        assert!(overlap(&square(0.0, 1.0), &square(0.0, 1.0), 1e-6));
        assert!(overlap(&square(0.0, 1.0), &square(0.5, 1.0), 1e-6));
        assert!(overlap(&square(0.0, 4.0), &square(1.0, 1.0), 1e-6));
        // The square in the notch of the ell.
        let notch = points(&[(2.0, 2.0), (4.0, 2.0), (4.0, 4.0), (2.0, 4.0)]);
        assert!(!overlap(&points(&ELL), &notch, 1e-6));
    }

    #[test]
    fn the_frame_of_a_wall_points_from_corner_1_to_corner_2_and_towards_the_others() {
        for mirrored in [false, true] {
            let top = if mirrored { -3.0 } else { 3.0 };
            let corners = [(0.0, 0.0), (5.0, 0.0), (5.0, top), (0.0, top)].map(|(y, z)| DVec3::new(4.0, y, z));
            let frame = frame(&corners).expect("a rectangle has a frame");
            assert_eq!(frame.x, DVec3::Y);
            assert_eq!(frame.y, DVec3::Z * top.signum());
            assert!((frame.x.cross(frame.y) - frame.normal).length() < 1e-15);
            // The far corner has positive local coordinates.
            assert!((frame.local(corners[2]) - DVec3::new(5.0, 3.0, 0.0)).length() < 1e-12);
        }
    }
}
