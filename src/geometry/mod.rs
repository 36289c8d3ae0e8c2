//! The scene's surfaces and portals as rays meet them.
//!
//! Every surface is cut into triangles and parallelograms (openings and door leaves included), found through a
//! bounding volume tree and tested inclusively in f64, so that no ray passes between neighbours, not even one aimed
//! exactly at an edge. Two numbers steer what a ray may meet after an event: the *plane* a surface lies in, skipped
//! after a reflection (no self hits, no nudged origins), and the *group* of a wall or box face, skipped too after a
//! transmission or the crossing of a portal (the faces of a thick wall count once).

mod bvh;
mod cut;
mod edges;
mod enclosure;
mod facet;
mod few;
mod openings;
mod patches;
mod planes;
mod query;
mod region;
mod screen;
mod sheets;
mod skins;
mod surfaces;
mod walk;

use std::ops::Range;

use glam::DVec3;

use crate::error::Result;
use crate::scene::{Edges, Frame, MaterialId, Scene, Simulation, Transport};
use bvh::FacetTree;
use screen::Screen;

pub use edges::{Edge, FINE_M};
pub use enclosure::Enclosure;
pub use planes::{Outline, Plane};
pub use surfaces::face_frame;

/// What a ray meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Element {
    /// Index in [`Geometry::surfaces`].
    Surface(usize),
    /// Index in [`Geometry::portals`].
    Portal(usize),
}

/// Where a ray meets something.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance from the origin of the ray in m.
    pub t: f64,
    /// The point in m.
    pub point: DVec3,
    /// What is met.
    pub element: Element,
    /// Plane id: equal for everything in one plane (within 1e-6 m).
    pub plane: usize,
    /// Group id: equal for all parts of one wall, one box face or one flat patch of a mesh.
    pub group: usize,
    /// The group of the thick wall that the ray is passing through, if it meets one of the wall's rims from within:
    /// still to be skipped after a reflection there, since the wall or portal was counted when the ray went in.
    pub inside: Option<usize>,
}

/// A flat piece of the boundary.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// Local frame; the normal of a box face points into the box, that of a thick wall's face out of the wall.
    pub frame: Frame,
    /// Its material.
    pub material: MaterialId,
    /// Plane id, index in [`Geometry::planes`].
    pub plane: usize,
    /// Group id.
    pub group: usize,
    /// Area of one side in m^2 without its holes; infinite for an unbounded wall.
    pub area_m2: f64,
    /// Name of the box face, wall, leaf or mesh file.
    pub name: String,
    /// Whether sound is only expected on the side of the normal (box faces, faces of thick walls).
    pub one_sided: bool,
}

/// The open part of an opening.
#[derive(Debug, Clone, PartialEq)]
pub struct Portal {
    /// Index in [`Scene::openings`].
    pub opening: usize,
    /// The host's local frame, on the centre plane of a thick wall.
    pub frame: Frame,
    /// Limits of the open part along local x in m; may be infinite on an unbounded wall.
    pub x_m: [f64; 2],
    /// Limits along local y in m; may be infinite on an unbounded wall.
    pub y_m: [f64; 2],
    /// Thickness of the host in m; the portal's rectangle is met on both faces of a thick host.
    pub thickness_m: f64,
    /// Group id, that of the host.
    pub group: usize,
}

/// What a ray cannot meet: the plane it leaves and the group it passes through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Skip {
    /// Everything in this plane.
    pub plane: Option<usize>,
    /// Everything of this group.
    pub group: Option<usize>,
}

impl Skip {
    /// Nothing is skipped.
    pub const NONE: Self = Self { plane: None, group: None };

    /// For a ray reflected at `hit`.
    #[inline]
    pub fn reflected(hit: &Hit) -> Self {
        Self { plane: Some(hit.plane), group: hit.inside }
    }

    /// For a ray that passed through the wall or portal at `hit`.
    pub fn passed(hit: &Hit) -> Self {
        Self { plane: Some(hit.plane), group: Some(hit.group) }
    }
}

/// All surfaces and portals of a scene, ready for ray queries.
pub struct Geometry {
    /// Boundary pieces.
    pub surfaces: Vec<Surface>,
    /// Open parts of openings; empty without diffraction (openings are then plain holes).
    pub portals: Vec<Portal>,
    /// Edges that diffract, openings' own edges not counted but those of half-planes; no others unless `edges = "auto"`.
    pub edges: Vec<Edge>,
    /// Edges of meshes that are left out, as both their faces are less than [`FINE_M`] deep: scattering stands for them.
    pub fine_edges: usize,
    /// Point near the middle of the geometry in m; internal coordinates are relative to it.
    pub centre_m: DVec3,
    /// Largest distance of a corner from the centre in m.
    pub extent_m: f64,
    planes: Vec<Plane>,
    tree: FacetTree,
    screens: Vec<Screen>,
    of_mesh: Range<usize>,
    tolerance_m: f64,
}

/// Rounding margin relative to the largest coordinate: thousands of f64 roundings, and far below any acoustic length.
const ROUNDING: f64 = 1e-12;

impl Geometry {
    /// Builds all surfaces, portals and the search tree.
    ///
    /// Errors if the corners of a wall do not make a simple polygon.
    pub fn new(scene: &Scene) -> Result<Self> {
        let (centre_m, extent_m) = centre_and_extent(scene);
        let largest = extent_m.max((extent_m + centre_m.abs().max_element()) * f64::from(centre_m != DVec3::ZERO));
        let margin_m = ROUNDING * largest.max(1.0) + 2.0 * unevenness(scene);
        let parts = surfaces::Builder::new(scene, centre_m, extent_m, 0.5 * margin_m).build()?;
        let mut geometry = Self {
            tree: FacetTree::new(parts.shapes, margin_m),
            surfaces: parts.surfaces,
            portals: parts.portals,
            edges: Vec::new(),
            fine_edges: 0,
            centre_m,
            extent_m,
            planes: parts.book.planes,
            screens: parts.screens,
            of_mesh: parts.of_mesh,
            tolerance_m: margin_m,
        };
        geometry.outline_planes();
        if scene.simulation.edges == Edges::Auto && scene.simulation.transport != Transport::Geometric {
            (geometry.edges, geometry.fine_edges) = edges::find(scene, &geometry, &parts.sheets);
        }
        if has_portals(&scene.simulation) {
            let mut half_planes = edges::half_planes(scene, &geometry);
            geometry.edges.append(&mut half_planes);
        }
        edges::number(&mut geometry.edges);
        Ok(geometry)
    }

    /// The distinct planes, each with its surfaces; indexed by plane id.
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }

    /// Finds the rectangles of the planes that hold nothing unbounded.
    fn outline_planes(&mut self) {
        let surfaces = &self.surfaces;
        for shape in &self.tree.shapes {
            let plane = &mut self.planes[shape.plane as usize];
            let Some(first) = plane.surfaces.first() else { continue };
            if plane.surfaces.iter().all(|s| surfaces[*s].area_m2.is_finite()) {
                let frame = &surfaces[*first].frame;
                shape.corners().for_each(|corner| plane.widen([frame.x, frame.y], corner + self.centre_m));
            }
        }
    }

    /// Number of triangles and parallelograms that rays are tested against.
    pub fn facet_count(&self) -> usize {
        self.tree.facets.len()
    }
}

/// Whether openings diffract; if not they are plain holes.
fn has_portals(options: &Simulation) -> bool {
    options.transport != Transport::Geometric && options.edges != Edges::Off && options.diffraction_order > 0
}

/// The corners of all bounded geometry; sources and probes where there is none.
fn corners(scene: &Scene) -> Vec<DVec3> {
    let boxes = scene.boxes.iter().flat_map(|b| [b.min_m, b.max_m]);
    let walls = scene.walls.iter().flat_map(|w| w.corners_m.iter().copied());
    let meshes = scene.meshes.iter().flat_map(|m| m.triangles_m.iter().flatten().copied());
    let corners: Vec<DVec3> = boxes.chain(walls).chain(meshes).collect();
    if !corners.is_empty() {
        return corners;
    }
    scene.sources.iter().map(|s| s.position_m).chain(scene.probes.iter().map(|p| p.position_m)).collect()
}

/// The origin of internal coordinates and the largest distance of a corner from it. The given origin is kept where it
/// is near enough, else the middle rounded to metres, so that the subtraction rounds as little as possible.
fn centre_and_extent(scene: &Scene) -> (DVec3, f64) {
    let corners = corners(scene);
    let (low, high) =
        corners.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), c| (low.min(*c), high.max(*c)));
    if !(low.is_finite() && high.is_finite()) {
        return (DVec3::ZERO, 1.0);
    }
    let middle = 0.5 * (low + high);
    let radius = 0.5 * (high - low).length();
    let centre = if middle.length() <= 2.0 * radius { DVec3::ZERO } else { middle.round() };
    (centre, corners.iter().fold(0.0, |r: f64, c| r.max((*c - centre).length())))
}

/// How far in m the corners of walls lie off their planes.
fn unevenness(scene: &Scene) -> f64 {
    let off = |(wall, corner): (&crate::scene::Wall, &DVec3)| wall.frame.local(*corner).z.abs();
    scene.walls.iter().flat_map(|w| w.corners_m.iter().map(move |c| (w, c))).map(off).fold(0.0, f64::max)
}
