//! Edges round which sound bends: free borders of thin walls and convex wedges.
//!
//! Along every border of every sheet (box face, wall face, rim, mesh triangle) the half-planes that start from that
//! line are collected, wherever they belong to a border or to the middle of another sheet, and sorted by angle. A
//! sector of air between two neighbours wider than 180 + 5 degrees is an edge; a single half-plane is a free edge of
//! 360 degrees. Where the half-planes change along a border it is divided, collinear parts with the same wedge are
//! joined again, and sectors that the air of the sources and probes does not reach (the outside of a closed room) are
//! dropped. Borders that an opening touches are left to its portal.

use std::collections::{BTreeMap, HashMap};
use std::f64::consts::{PI, TAU};

use glam::DVec3;
use rayon::prelude::*;

use super::facet::{FacetShape, PORTAL_BIT};
use super::patches::Topology;
use super::planes::COPLANAR_M;
use super::region::Region;
use super::sheets::Sheet;
use super::skins::{Leaf, Skins};
use super::{Element, Geometry, Skip};
use crate::scene::{Opening, Scene};

/// A straight edge and its two faces.
#[derive(Debug, Clone, PartialEq)]
pub struct Edge {
    /// One end in m.
    pub start: DVec3,
    /// Unit vector along the edge, towards growing x (else y, else z); face_a, normal_a, direction are right-handed.
    pub direction: DVec3,
    /// Length in m.
    pub length_m: f64,
    /// Unit vector in face A, at right angles to the edge, pointing from the edge into the face.
    pub face_a: DVec3,
    /// Unit normal of face A, pointing into the air.
    pub normal_a: DVec3,
    /// Angle through the air from face A to face B in rad: above pi, at most 2 pi (thin wall).
    pub exterior_angle: f64,
    /// Groups of faces A and B; equal for a free edge.
    pub groups: [usize; 2],
    /// Planes of faces A and B; equal for a free edge.
    pub planes: [usize; 2],
    /// Whether the edge stands on a surface at right angles to it, at its start and at its end: in that it goes on as its
    /// mirror image. Other ends are free.
    pub on_surface: [bool; 2],
    /// The surfaces that meet, as `barrier edge` or `side 1 / side 2`; numbered where several would share a name.
    pub name: String,
}

impl Edge {
    /// Angle of a point about the edge in 0..2 pi, measured from face A through the air.
    pub fn angle(&self, point: DVec3) -> f64 {
        let d = point - self.start;
        d.dot(self.normal_a).atan2(d.dot(self.face_a)).rem_euclid(TAU)
    }

    /// The point at `along_m` from the start, in m.
    pub fn point(&self, along_m: f64) -> DVec3 {
        self.start + self.direction * along_m
    }
}

/// Sectors of air up to 180 degrees and this much are no edges.
const FLAT: f64 = 5.0 * PI / 180.0;

/// Beside a border, in m, a sheet is looked for: ten times what still counts as coplanar.
const BESIDE_M: f64 = 10.0 * COPLANAR_M;

/// Half-planes nearer in angle than this are one.
const SAME_ANGLE: f64 = 1e-3;

/// Distance from an edge, in m, of the point that tells which region of air it belongs to.
const INTO_AIR_M: f64 = 1e-4;

/// Half the length in m of an edge without ends.
const ENDLESS_M: f64 = 1e7;

/// Depth in m of the deeper face, its area over the edge's length, below which an edge of a mesh is left out.
///
/// The field of a wedge takes its faces as endless. Round a relief finer than a wavelength these fields do not add up to what
/// the relief does, which is to scatter; that its scattering coefficient says.
pub const FINE_M: f64 = 0.3;

/// All edges of the scene, in the order of their borders, and how many of meshes are left out as too fine.
pub(crate) fn find(scene: &Scene, geometry: &Geometry, sheets: &[Sheet]) -> (Vec<Edge>, usize) {
    let finder = Finder::new(scene, geometry, sheets);
    let of_sheets = sheets.iter().zip(&finder.ordinals);
    let mut borders: Vec<Border> =
        of_sheets.flat_map(|(sheet, &ordinal)| sides(&sheet.ring).map(move |(a, b)| (ordinal, a, b))).collect();
    let skins = finder.add_mesh_borders(&mut borders);
    let edges = borders.par_iter().flat_map_iter(|&border| finder.border(border, &skins)).collect();
    let mut region = Region::new(scene, geometry);
    let mut edges = within(&mut region, geometry, join(edges));
    let found = edges.len();
    let mesh = geometry.surfaces[geometry.of_mesh.clone()].iter();
    let areas_m2: HashMap<usize, f64> = mesh.map(|s| (s.group, s.area_m2)).collect();
    edges.retain(|edge| {
        let depth_m = |group: &usize| areas_m2.get(group).map_or(f64::INFINITY, |area| area / edge.length_m);
        edge.groups.iter().map(depth_m).fold(0.0, f64::max) >= FINE_M
    });
    let fine = found - edges.len();
    edges.par_iter_mut().for_each(|edge| {
        edge.on_surface = [(0.0, -1.0), (edge.length_m, 1.0)].map(|(end, sign)| stands(geometry, edge, end, sign));
    });
    (edges, fine)
}

/// A border to look along: the rank of its sheet or mesh facet, and its ends, relative to the scene's centre.
type Border = (usize, DVec3, DVec3);

/// An edge and the skin its first face belongs to, if that is a mesh's.
struct Found {
    edge: Edge,
    skin: Option<usize>,
}

/// As many edges of a skin are asked where they lie; all others lie there too if these agree.
const ASKED: usize = 16;

/// The edges that the air of the sources and probes reaches.
fn within(region: &mut Region, geometry: &Geometry, found: Vec<Found>) -> Vec<Edge> {
    let mut of_skin: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, found) in found.iter().enumerate() {
        if let Some(skin) = found.skin {
            of_skin.entry(skin).or_default().push(i);
        }
    }
    let mut known = vec![None; found.len()];
    for edges in of_skin.into_values().filter(|edges| edges.len() > ASKED) {
        let mut asked = (0..ASKED).map(|n| lies_in(region, geometry, &found[edges[n * edges.len() / ASKED]].edge));
        let inside = asked.next();
        if asked.all(|other| Some(other) == inside) {
            edges.into_iter().for_each(|i| known[i] = inside);
        }
    }
    let lies = |(found, known): (Found, Option<bool>)| {
        known.unwrap_or_else(|| lies_in(region, geometry, &found.edge)).then_some(found.edge)
    };
    found.into_iter().zip(known).filter_map(lies).collect()
}

/// Numbers the edges that share a name: `barrier edge`, `barrier edge 2`, ...
pub(crate) fn number(edges: &mut [Edge]) {
    let mut times: HashMap<String, usize> = HashMap::new();
    for edge in edges {
        let times = times.entry(edge.name.clone()).or_insert(0);
        *times += 1;
        if *times > 1 {
            edge.name = format!("{} {times}", edge.name);
        }
    }
}

/// The edges of half-planes: openings that leave one half of an unbounded wall.
pub(crate) fn half_planes(scene: &Scene, geometry: &Geometry) -> Vec<Edge> {
    let edge = |opening: &Opening| {
        let (x_m, side) = scene.half_plane(opening)?;
        let surface = geometry.surfaces.iter().find(|s| {
            s.area_m2.is_infinite()
                && s.frame.normal.dot(opening.frame.normal).abs() > SAME_ANGLE.cos()
                && s.frame.local(opening.frame.origin_m).z.abs() <= COPLANAR_M
        })?;
        let along = opening.frame.y;
        let leading = along.to_array().into_iter().find(|c| c.abs() > SAME_ANGLE).unwrap_or(1.0);
        let direction = along * leading.signum();
        let face_a = opening.frame.x * side;
        Some(Edge {
            start: opening.frame.point(x_m, 0.0) - direction * ENDLESS_M,
            direction,
            length_m: 2.0 * ENDLESS_M,
            face_a,
            normal_a: direction.cross(face_a),
            exterior_angle: TAU,
            groups: [surface.group; 2],
            planes: [surface.plane; 2],
            on_surface: [true; 2],
            name: format!("{} edge", surface.name),
        })
    };
    scene.openings.iter().filter_map(edge).collect()
}

/// Whether a surface at right angles to the edge ends it at `end_m`, towards `sign` times its direction.
fn stands(geometry: &Geometry, edge: &Edge, end_m: f64, sign: f64) -> bool {
    let (sin, cos) = (0.5 * edge.exterior_angle).sin_cos();
    let step_m = INTO_AIR_M.min(0.01 * edge.length_m);
    let onward = edge.direction * sign;
    let from = edge.point(end_m) + (edge.face_a * cos + edge.normal_a * sin - onward) * step_m;
    let hit = geometry.closest(from, onward, 2.0 * step_m, Skip::NONE);
    let normal = hit.and_then(|hit| match hit.element {
        Element::Surface(surface) => Some(geometry.surfaces[surface].frame.normal),
        Element::Portal(_) => None,
    });
    normal.is_some_and(|n| n.dot(edge.direction).abs() > SAME_ANGLE.cos())
}

/// Whether the air of the sources and probes reaches the edge anywhere.
fn lies_in(region: &mut Region, geometry: &Geometry, edge: &Edge) -> bool {
    let (sin, cos) = (0.5 * edge.exterior_angle).sin_cos();
    let off = (edge.face_a * cos + edge.normal_a * sin) * INTO_AIR_M.min(0.01 * edge.length_m);
    [0.5, 0.31, 0.77].iter().any(|&f| region.reaches(geometry, edge.point(f * edge.length_m) + off))
}

fn sides(ring: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> {
    ring.iter().enumerate().map(|(i, &a)| (a, ring[(i + 1) % ring.len()]))
}

/// How a mesh facet leaves one of its sides, which starts at `a` and runs along the unit vector `along`.
fn leaf(facet: usize, shape: &FacetShape, a: DVec3, along: DVec3) -> Leaf {
    let middle = shape.corner + (shape.side_u + shape.side_v) / 3.0 - a;
    let into = (middle - along * middle.dot(along)).normalize_or_zero();
    Leaf { facet, normal: shape.normal, into }
}

/// A sheet or mesh triangle that contains the line of a border, in coordinates (along the line, beside it) in m.
struct Flat {
    parts: Vec<Vec<[f64; 2]>>,
    holes: Vec<Vec<[f64; 2]>>,
    unbounded: bool,
    /// Unit vector in the sheet towards growing second coordinate.
    beside: DVec3,
    normal: DVec3,
    one_sided: bool,
    ordinal: usize,
    plane: usize,
    group: usize,
}

/// A half-plane that starts from the line.
#[derive(Clone)]
struct Half {
    angle: f64,
    into: DVec3,
    /// Whether there is air towards growing and towards falling angles.
    air: [bool; 2],
    ordinal: usize,
    plane: usize,
    group: usize,
    is_border: bool,
}

struct Finder<'a> {
    geometry: &'a Geometry,
    sheets: &'a [Sheet],
    /// Rank of each sheet: walls before box faces, so that a wall on a box face is named.
    ordinals: Vec<usize>,
    /// Names of sheets by rank.
    names: Vec<&'a str>,
    has_mesh: bool,
}

impl<'a> Finder<'a> {
    fn new(scene: &Scene, geometry: &'a Geometry, sheets: &'a [Sheet]) -> Self {
        let mut by_rank: Vec<usize> = (0..sheets.len()).collect();
        by_rank.sort_by_key(|&i| (sheets[i].is_box_face, i));
        let mut ordinals = vec![0; sheets.len()];
        for (rank, &i) in by_rank.iter().enumerate() {
            ordinals[i] = rank;
        }
        let names = by_rank.iter().map(|&i| sheets[i].name.as_str()).collect();
        Self { geometry, sheets, ordinals, names, has_mesh: !scene.meshes.is_empty() }
    }

    fn is_mesh(&self, facet: usize) -> bool {
        let element = self.geometry.tree.shapes[facet].element;
        element & PORTAL_BIT == 0 && self.geometry.of_mesh.contains(&(element as usize))
    }

    /// Adds the sides of mesh facets that are not obviously flat; gives which sides of facets belong together.
    fn add_mesh_borders(&self, borders: &mut Vec<Border>) -> Skins {
        let shapes = &self.geometry.tree.shapes;
        let mut skins = Skins::new(shapes.len());
        if !self.has_mesh {
            return skins;
        }
        let facets: Vec<usize> = (0..shapes.len()).filter(|&i| self.is_mesh(i)).collect();
        let rings: Vec<Vec<DVec3>> = facets.iter().map(|&i| shapes[i].ring()).collect();
        let topology = Topology::new(rings.iter().map(|r| r.as_slice()), COPLANAR_M);
        for (n, (ring, ids)) in rings.iter().zip(&topology.rings).enumerate() {
            for (k, (a, b)) in sides(ring).enumerate() {
                let (i, j) = (ids[k], ids[(k + 1) % ids.len()]);
                let Some(sharing) = topology.sides.get(&(i.min(j), i.max(j))) else { continue };
                let along = (b - a).normalize_or_zero();
                let leaf = |p: &usize| leaf(facets[*p], &shapes[facets[*p]], a, along);
                let leaves: Vec<Leaf> = sharing.iter().map(leaf).collect();
                if sharing[0] == n {
                    skins.join(along, &leaves);
                }
                if let [p, q] = &leaves[..]
                    && (shapes[p.facet].plane == shapes[q.facet].plane || p.into.dot(q.into) <= -FLAT.cos())
                {
                    continue;
                }
                borders.push((self.sheets.len() + facets[n], a, b));
            }
        }
        skins
    }

    /// The edges along a border.
    fn border(&self, (ordinal, a, b): Border, skins: &Skins) -> Vec<Found> {
        let mut edges = Vec::new();
        let length = (b - a).length();
        if length <= 4.0 * BESIDE_M {
            return edges;
        }
        let along = (b - a) / length;
        let flats = self.flats(a, along, length);
        let Some(zero) = flats.iter().find(|f| f.ordinal == ordinal).map(|f| f.beside) else { return edges };
        let up = along.cross(zero);
        let mut cuts = vec![0.0, length];
        for flat in &flats {
            for polygon in flat.parts.iter().chain(&flat.holes) {
                crossings(polygon, &mut cuts);
            }
        }
        cuts.retain(|&s| s >= 0.0 && s <= length);
        cuts.sort_by(f64::total_cmp);
        for w in cuts.windows(2).filter(|w| w[1] - w[0] > 4.0 * BESIDE_M) {
            let middle = 0.5 * (w[0] + w[1]);
            let Some(halves) = halves(&flats, middle, zero, up, along) else { continue };
            if halves.iter().filter(|h| h.is_border).map(|h| h.ordinal).min() != Some(ordinal) {
                continue; // another sheet's border answers for this part
            }
            let Some((first, second, angle)) = widest_air(merge(halves)) else { continue };
            let (from, to) = (a + along * w[0], a + along * w[1]);
            let skin = first.ordinal.checked_sub(self.sheets.len()).map(|facet| {
                let normal = self.geometry.tree.shapes[facet].normal;
                skins.of(&Leaf { facet, normal, into: first.into }, along)
            });
            edges.push(Found { edge: self.edge(from, to, along, [first, second], angle), skin });
        }
        edges
    }

    /// The edge, its direction turned to growing x (else y, else z), so that parts of one edge found from different
    /// borders agree.
    fn edge(&self, from: DVec3, to: DVec3, along: DVec3, faces: [Half; 2], exterior_angle: f64) -> Edge {
        let [first, second] = faces;
        let leading = along.to_array().into_iter().find(|c| c.abs() > SAME_ANGLE).unwrap_or(1.0);
        let (start, direction, first, second) =
            if leading > 0.0 { (from, along, first, second) } else { (to, -along, second, first) };
        Edge {
            start: start + self.geometry.centre_m,
            direction,
            length_m: (to - from).length(),
            face_a: first.into,
            normal_a: direction.cross(first.into),
            exterior_angle,
            groups: [first.group, second.group],
            planes: [first.plane, second.plane],
            on_surface: [false; 2],
            name: self.name(&first, &second),
        }
    }

    fn name(&self, first: &Half, second: &Half) -> String {
        let name = |h: &Half| match self.names.get(h.ordinal) {
            Some(name) => name,
            None => {
                let element = self.geometry.tree.shapes[h.ordinal - self.names.len()].element;
                self.geometry.surfaces[element as usize].name.as_str()
            }
        };
        let (first, second) = if second.ordinal < first.ordinal { (second, first) } else { (first, second) };
        let (a, b) = (name(first), name(second));
        if a == b { format!("{a} edge") } else { format!("{a} / {b}") }
    }

    /// Every sheet and mesh triangle whose plane contains the line and that comes near the border.
    fn flats(&self, a: DVec3, along: DVec3, length: f64) -> Vec<Flat> {
        let b = a + along * length;
        let contains =
            |point: DVec3, n: DVec3| n.dot(a - point).abs() <= COPLANAR_M && n.dot(b - point).abs() <= COPLANAR_M;
        let flat = |normal: DVec3, parts: &[Vec<DVec3>], holes: &[Vec<DVec3>], ordinal: usize| {
            let beside = normal.cross(along).normalize_or_zero();
            let to_line = |c: &DVec3| [(*c - a).dot(along), (*c - a).dot(beside)];
            let polygons = |p: &[Vec<DVec3>]| p.iter().map(|c| c.iter().map(to_line).collect()).collect();
            Flat {
                parts: polygons(parts),
                holes: polygons(holes),
                unbounded: false,
                beside,
                normal,
                one_sided: false,
                ordinal,
                plane: 0,
                group: 0,
            }
        };
        let mut flats = Vec::new();
        for (sheet, &ordinal) in self.sheets.iter().zip(&self.ordinals) {
            if contains(sheet.point, sheet.normal) {
                let (unbounded, one_sided) = (sheet.unbounded, sheet.one_sided);
                let (plane, group) = (sheet.plane, sheet.group);
                let flat = flat(sheet.normal, &sheet.parts, &sheet.holes, ordinal);
                flats.push(Flat { unbounded, one_sided, plane, group, ..flat });
            }
        }
        if self.has_mesh {
            let near = DVec3::splat(BESIDE_M);
            self.geometry.tree.overlapping(a.min(b) - near, a.max(b) + near, |i| {
                let shape = &self.geometry.tree.shapes[i];
                if contains(shape.corner, shape.normal) && self.is_mesh(i) {
                    let flat = flat(shape.normal, &[shape.ring()], &[], self.sheets.len() + i);
                    flats.push(Flat { plane: shape.plane as usize, group: shape.group as usize, ..flat });
                }
            });
        }
        flats
    }
}

/// Where the sides of a polygon cross or touch the line (second coordinate 0), as first coordinates.
fn crossings(polygon: &[[f64; 2]], cuts: &mut Vec<f64>) {
    for (i, p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        if p[1].abs() <= COPLANAR_M {
            cuts.push(p[0]);
        } else if (p[1] < 0.0) != (q[1] < 0.0) && q[1].abs() > COPLANAR_M {
            cuts.push(p[0] + (q[0] - p[0]) * p[1] / (p[1] - q[1]));
        }
    }
}

/// Whether a convex polygon of either orientation contains the point.
fn contains(polygon: &[[f64; 2]], point: [f64; 2]) -> bool {
    let (mut left, mut right) = (false, false);
    for (i, p) in polygon.iter().enumerate() {
        let q = polygon[(i + 1) % polygon.len()];
        let (side, to) = ([q[0] - p[0], q[1] - p[1]], [point[0] - p[0], point[1] - p[1]]);
        let cross = side[0] * to[1] - side[1] * to[0];
        let rounding = 1e-12 * (side[0].abs() + side[1].abs()) * (to[0].abs() + to[1].abs());
        left |= cross > rounding;
        right |= cross < -rounding;
    }
    !(left && right)
}

/// The half-planes at `middle` along the line; `None` where an opening reaches it.
fn halves(flats: &[Flat], middle: f64, zero: DVec3, up: DVec3, along: DVec3) -> Option<Vec<Half>> {
    let mut halves = Vec::new();
    for flat in flats {
        let on = |side: f64| {
            let point = [middle, side * BESIDE_M];
            let hole = flat.holes.iter().any(|h| contains(h, point));
            (flat.unbounded || flat.parts.iter().any(|p| contains(p, point)), hole)
        };
        let sides = [(1.0, on(1.0)), (-1.0, on(-1.0))];
        let is_border = sides[0].1.0 != sides[1].1.0;
        for (side, (there, hole)) in sides {
            if !there {
                continue;
            }
            if hole {
                return None;
            }
            let into = flat.beside * side;
            let mut angle = into.dot(up).atan2(into.dot(zero)).rem_euclid(TAU);
            if TAU - angle < SAME_ANGLE {
                angle = 0.0;
            }
            let front = flat.normal.dot(along.cross(into)) > 0.0;
            halves.push(Half {
                angle,
                into,
                air: [!flat.one_sided || front, !flat.one_sided || !front],
                ordinal: flat.ordinal,
                plane: flat.plane,
                group: flat.group,
                is_border,
            });
        }
    }
    Some(halves)
}

/// Joins half-planes that coincide; the first in rank gives its name.
fn merge(mut halves: Vec<Half>) -> Vec<Half> {
    halves.sort_by(|a, b| a.angle.total_cmp(&b.angle));
    let mut merged: Vec<Half> = Vec::new();
    for half in halves {
        match merged.last_mut() {
            Some(last) if half.angle - last.angle < SAME_ANGLE => {
                let air = [last.air[0] || half.air[0], last.air[1] || half.air[1]];
                if half.ordinal < last.ordinal {
                    *last = Half { angle: last.angle, ..half };
                }
                last.air = air;
            }
            _ => merged.push(half),
        }
    }
    merged
}

/// The sector of air wider than 180 + 5 degrees, if there is one: its faces in the order of angles, and its angle.
fn widest_air(halves: Vec<Half>) -> Option<(Half, Half, f64)> {
    if let [only] = &halves[..] {
        return Some((only.clone(), only.clone(), TAU)); // free: there is air on both sides of its border
    }
    halves.iter().enumerate().find_map(|(i, first)| {
        let second = &halves[(i + 1) % halves.len()];
        let angle = (second.angle - first.angle).rem_euclid(TAU);
        (angle > PI + FLAT && first.air[0] && second.air[1]).then(|| (first.clone(), second.clone(), angle))
    })
}

/// Joins parts of one edge that follow each other.
fn join(found: Vec<Found>) -> Vec<Found> {
    let edges: Vec<&Edge> = found.iter().map(|found| &found.edge).collect();
    let key = |p: DVec3| (p / COPLANAR_M).to_array().map(|v| v.round() as i64);
    let mut starts: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (i, e) in edges.iter().enumerate() {
        starts.entry(key(e.start)).or_default().push(i);
    }
    let continues = |a: &Edge, b: &Edge| {
        let near = |u: DVec3, v: DVec3| (u - v).length() < SAME_ANGLE;
        near(a.face_a, b.face_a)
            && near(a.normal_a, b.normal_a)
            && near(a.direction, b.direction)
            && (a.exterior_angle - b.exterior_angle).abs() < SAME_ANGLE
            && a.planes == b.planes
            && a.groups == b.groups
    };
    let mut next: Vec<Option<usize>> = vec![None; edges.len()];
    let mut is_first = vec![true; edges.len()];
    for (i, e) in edges.iter().enumerate() {
        let followers = starts.get(&key(e.point(e.length_m)));
        next[i] = followers.into_iter().flatten().copied().find(|&j| j != i && is_first[j] && continues(e, edges[j]));
        if let Some(j) = next[i] {
            is_first[j] = false;
        }
    }
    let mut joined = Vec::new();
    for (i, e) in edges.iter().enumerate().filter(|(i, _)| is_first[*i]) {
        let mut last = i;
        while let Some(j) = next[last] {
            last = j;
        }
        let end = edges[last].point(edges[last].length_m);
        let edge = Edge { length_m: (end - e.start).length(), ..(*e).clone() };
        joined.push(Found { edge, skin: found[i].skin });
    }
    joined
}
