//! Triangles of a mesh merged into patches: connected, coplanar, of one material.

use std::collections::HashMap;

use glam::DVec3;

use super::planes::PlaneBook;
use crate::scene::{MaterialId, Mesh};

/// Which polygons share a side, corners that coincide being one vertex.
pub(crate) struct Topology {
    /// The polygons (with multiplicity) at each undirected side, lower vertex first.
    pub(crate) sides: HashMap<(usize, usize), Vec<usize>>,
    /// Vertex indices of each polygon.
    pub(crate) rings: Vec<Vec<usize>>,
}

impl Topology {
    /// Joins corners that agree after rounding to `weld_m`.
    pub(crate) fn new<'a>(polygons: impl Iterator<Item = &'a [DVec3]>, weld_m: f64) -> Self {
        let mut index: HashMap<[i64; 3], usize> = HashMap::new();
        let mut vertex = |p: &DVec3| {
            let next = index.len();
            *index.entry((*p / weld_m).to_array().map(|v| v.round() as i64)).or_insert(next)
        };
        let rings: Vec<Vec<usize>> = polygons.map(|p| p.iter().map(&mut vertex).collect()).collect();
        let mut sides: HashMap<(usize, usize), Vec<usize>> = HashMap::new();
        for (i, ring) in rings.iter().enumerate() {
            for (k, &a) in ring.iter().enumerate() {
                let b = ring[(k + 1) % ring.len()];
                if a != b {
                    sides.entry((a.min(b), a.max(b))).or_default().push(i);
                }
            }
        }
        Self { sides, rings }
    }
}

/// Connected coplanar triangles of one material.
pub(crate) struct Patch {
    /// Indices of the mesh's triangles, ascending.
    pub(crate) triangles: Vec<usize>,
    /// Plane id.
    pub(crate) plane: usize,
    /// Material of all of them.
    pub(crate) material: MaterialId,
}

/// Normal of a triangle; zero if it has no area.
pub(crate) fn triangle_normal(t: &[DVec3; 3]) -> DVec3 {
    (t[1] - t[0]).cross(t[2] - t[0]).normalize_or_zero()
}

/// Merges the triangles of `mesh`; triangles without area are left out. Ordered by their first triangle.
pub(crate) fn patches(mesh: &Mesh, book: &mut PlaneBook, weld_m: f64) -> Vec<Patch> {
    let topology = Topology::new(mesh.triangles_m.iter().map(|t| t.as_slice()), weld_m);
    let planes: Vec<Option<usize>> = mesh
        .triangles_m
        .iter()
        .map(|t| {
            let n = triangle_normal(t);
            (n != DVec3::ZERO).then(|| book.id(n, t))
        })
        .collect();
    let mut parent: Vec<usize> = (0..planes.len()).collect();
    for sharing in topology.sides.values() {
        for (a, b) in sharing.iter().enumerate().flat_map(|(i, &a)| sharing[i + 1..].iter().map(move |&b| (a, b))) {
            if planes[a].is_some() && planes[a] == planes[b] && mesh.materials[a] == mesh.materials[b] {
                let (ra, rb) = (root(&mut parent, a), root(&mut parent, b));
                parent[ra.max(rb)] = ra.min(rb);
            }
        }
    }
    let mut patches: Vec<Patch> = Vec::new();
    let mut of_root: HashMap<usize, usize> = HashMap::new();
    for (i, plane) in planes.iter().enumerate() {
        let Some(plane) = *plane else { continue };
        let r = root(&mut parent, i);
        let at = *of_root.entry(r).or_insert_with(|| {
            patches.push(Patch { triangles: Vec::new(), plane, material: mesh.materials[i] });
            patches.len() - 1
        });
        patches[at].triangles.push(i);
    }
    patches
}

/// The root of `i` in a forest of parents, whose ways to it are halved.
pub(crate) fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}
