//! Plane polygons as lists of convex pieces, and the cutting of holes out of them.
//!
//! A polygon is split into convex pieces once (by ear clipping if it is not convex); a convex hole is then cut
//! out of each piece edge by edge, after Sutherland and Hodgman (1974): the part of the piece outside the
//! hole's first edge is kept, the rest goes on to the second edge, and what is inside all edges is the hole. The
//! pieces never overlap, holes may overlap each other and the border, and a corner within `tolerance_m` of a cut
//! counts as lying on it, so that no slivers appear beside a flush cut.

use glam::DVec2;

use crate::error::{Error, Result};

/// A convex polygon, counter-clockwise, in m.
pub(crate) type Piece = Vec<DVec2>;

/// Largest relative difference between the area of a polygon and that of its triangles: beyond rounding the
/// polygon is not simple.
const AREA_DEVIATION: f64 = 1e-9;

/// Signed area in m^2, positive for counter-clockwise corners (shoelace formula about the first corner).
pub(crate) fn area(polygon: &[DVec2]) -> f64 {
    let Some(&origin) = polygon.first() else { return 0.0 };
    polygon.windows(2).map(|w| 0.5 * (w[0] - origin).perp_dot(w[1] - origin)).sum()
}

/// The rectangle between the limits in m.
pub(crate) fn rectangle(x: [f64; 2], y: [f64; 2]) -> Piece {
    vec![DVec2::new(x[0], y[0]), DVec2::new(x[1], y[0]), DVec2::new(x[1], y[1]), DVec2::new(x[0], y[1])]
}

/// Splits a simple polygon of either orientation into convex pieces; a convex one stays whole.
///
/// Errors if the corners cross over (the triangles' area then differs from the polygon's).
pub(crate) fn convex_pieces(polygon: &[DVec2], name: &str) -> Result<Vec<Piece>> {
    let mut corners = without_repeats(polygon);
    if area(&corners) < 0.0 {
        corners.reverse();
    }
    if corners.len() < 3 || area(&corners) == 0.0 {
        return Ok(Vec::new());
    }
    if is_convex(&corners) {
        return Ok(vec![corners]);
    }
    let points: Vec<[f64; 2]> = corners.iter().map(|c| c.to_array()).collect();
    let mut triangles: Vec<u32> = Vec::new();
    earcut::Earcut::new().earcut(points.iter().copied(), &[], &mut triangles);
    if earcut::deviation(points.iter().copied(), &[], &triangles) > AREA_DEVIATION {
        return Err(Error::input(
            format!("the corners of `{name}` do not make a simple polygon"),
            "list the corners in order round the border; its sides must not cross",
        ));
    }
    let corner = |i: u32| DVec2::from_array(points[i as usize]);
    Ok(triangles
        .chunks_exact(3)
        .map(|t| vec![corner(t[0]), corner(t[1]), corner(t[2])])
        .map(|mut t| {
            if area(&t) < 0.0 {
                t.reverse();
            }
            t
        })
        .collect())
}

/// Cuts the convex counter-clockwise `hole` out of every piece.
pub(crate) fn subtract(pieces: Vec<Piece>, hole: &[DVec2], tolerance_m: f64) -> Vec<Piece> {
    let mut left = Vec::with_capacity(pieces.len() + 4);
    for piece in pieces {
        let mut outside = Vec::new();
        let mut rest = piece.clone();
        for (i, &a) in hole.iter().enumerate() {
            let b = hole[(i + 1) % hole.len()];
            let Some(along) = (b - a).try_normalize() else { continue };
            let (inside, out) = split(&rest, a, along, tolerance_m);
            outside.extend(out);
            match inside {
                Some(inside) => rest = inside,
                None => {
                    rest.clear();
                    break;
                }
            }
        }
        if rest.is_empty() {
            left.push(piece); // the hole does not reach it: keep it whole
        } else {
            left.append(&mut outside);
        }
    }
    left
}

/// The parts of a convex piece on the left of a line and on its right; `None` where nothing of any width is.
fn split(piece: &[DVec2], point: DVec2, along: DVec2, tolerance_m: f64) -> (Option<Piece>, Option<Piece>) {
    let height = |p: DVec2| along.perp_dot(p - point);
    if piece.iter().all(|&p| height(p) >= -tolerance_m) {
        return (piece.iter().any(|&p| height(p) > tolerance_m).then(|| piece.to_vec()), None);
    }
    if piece.iter().all(|&p| height(p) <= tolerance_m) {
        return (None, Some(piece.to_vec()));
    }
    let (mut left, mut right) = (Vec::new(), Vec::new());
    for (i, &p) in piece.iter().enumerate() {
        let q = piece[(i + 1) % piece.len()];
        let (hp, hq) = (height(p), height(q));
        if hp >= -tolerance_m {
            left.push(p);
        }
        if hp <= tolerance_m {
            right.push(p);
        }
        let crosses = (hp > tolerance_m && hq < -tolerance_m) || (hp < -tolerance_m && hq > tolerance_m);
        if crosses {
            let cut = p + (q - p) * (hp / (hp - hq));
            left.push(cut);
            right.push(cut);
        }
    }
    (Some(left), Some(right))
}

fn is_convex(corners: &[DVec2]) -> bool {
    let n = corners.len();
    let mut turns = 0.0;
    for i in 0..n {
        let (a, b) = (corners[(i + 1) % n] - corners[i], corners[(i + 2) % n] - corners[(i + 1) % n]);
        if a.perp_dot(b) < -1e-12 * a.length() * b.length() {
            return false;
        }
        turns += a.angle_to(b);
    }
    // a star winds round more than once
    turns < 1.5 * std::f64::consts::TAU
}

fn without_repeats(polygon: &[DVec2]) -> Vec<DVec2> {
    let mut corners: Vec<DVec2> = polygon.to_vec();
    corners.dedup();
    while corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    corners
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOLERANCE_M: f64 = 1e-9;

    fn total(pieces: &[Piece]) -> f64 {
        pieces.iter().map(|p| area(p)).sum()
    }

    #[test]
    fn a_door_standing_on_the_floor_leaves_the_exact_area_in_three_pieces() {
        let wall = convex_pieces(&rectangle([0.0, 5.0], [0.0, 3.0]), "wall").expect("a rectangle is simple");
        let cut = subtract(wall, &rectangle([1.0, 2.2], [0.0, 2.1]), TOLERANCE_M);
        assert_eq!(cut.len(), 3);
        assert!((total(&cut) - (15.0 - 1.2 * 2.1)).abs() < 1e-12);
    }

    #[test]
    fn overlapping_holes_are_cut_once() {
        let wall = vec![rectangle([0.0, 4.0], [0.0, 4.0])];
        let once = subtract(wall, &rectangle([1.0, 3.0], [1.0, 2.0]), TOLERANCE_M);
        let twice = subtract(once.clone(), &rectangle([1.0, 3.0], [1.0, 2.0]), TOLERANCE_M);
        assert!((total(&once) - 14.0).abs() < 1e-12);
        assert!((total(&twice) - 14.0).abs() < 1e-12);
        let crossed = subtract(once, &rectangle([1.5, 2.0], [-1.0, 5.0]), TOLERANCE_M);
        assert!((total(&crossed) - (14.0 - 4.0 * 0.5 + 0.5)).abs() < 1e-12);
    }

    #[test]
    fn a_hole_beside_the_wall_leaves_it_whole() {
        let wall = vec![rectangle([0.0, 4.0], [0.0, 4.0])];
        assert_eq!(subtract(wall.clone(), &rectangle([4.0, 6.0], [0.0, 4.0]), TOLERANCE_M), wall);
        assert_eq!(subtract(wall.clone(), &rectangle([6.0, 7.0], [6.0, 7.0]), TOLERANCE_M), wall);
    }

    #[test]
    fn a_hole_larger_than_the_wall_leaves_nothing() {
        let wall = vec![rectangle([0.0, 4.0], [0.0, 4.0])];
        assert!(subtract(wall, &rectangle([-1.0, 5.0], [0.0, 4.0]), TOLERANCE_M).is_empty());
    }

    #[test]
    fn an_l_shaped_polygon_keeps_its_area_in_either_orientation() {
        let mut l: Vec<DVec2> = [[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]]
            .into_iter()
            .map(DVec2::from_array)
            .collect();
        for _ in 0..2 {
            let pieces = convex_pieces(&l, "l").expect("simple");
            assert!((total(&pieces) - 6.0).abs() < 1e-12);
            assert!(pieces.iter().all(|p| area(p) > 0.0));
            l.reverse();
        }
    }

    #[test]
    fn crossing_sides_are_an_error() {
        let bow: Vec<DVec2> =
            [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0]].into_iter().map(DVec2::from_array).collect();
        assert!(convex_pieces(&bow, "bow").is_err());
    }
}
