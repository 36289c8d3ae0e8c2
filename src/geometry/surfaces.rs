//! From the scene's boxes, walls, meshes and openings to surfaces, portals and the facets that rays meet.

use std::ops::Range;

use glam::{DVec2, DVec3};

use super::cut::{self, Piece};
use super::facet::FacetShape;
use super::openings::LeafFace;
use super::patches::{patches, triangle_normal};
use super::planes::PlaneBook;
use super::screen::Screen;
use super::sheets::Sheet;
use super::{Portal, Surface};
use crate::error::Result;
use crate::scene::{BoxRoom, Face, Frame, Host, Mesh, Scene, Wall};

/// Everything that `Geometry` is made of.
pub(crate) struct Parts {
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) portals: Vec<Portal>,
    pub(crate) shapes: Vec<FacetShape>,
    pub(crate) screens: Vec<Screen>,
    pub(crate) book: PlaneBook,
    pub(crate) sheets: Vec<Sheet>,
    /// Indices of the surfaces that come from meshes.
    pub(crate) of_mesh: Range<usize>,
}

/// Local frame of a box face: the normal points into the box, local y up on the side faces (towards y on the floor),
/// origin at the lower corner that makes all local coordinates positive.
pub fn face_frame(room: &BoxRoom, face: Face) -> Frame {
    let (a, b) = (room.min_m, room.max_m);
    let (origin_m, x, y) = match face {
        Face::XMin => (a, DVec3::Y, DVec3::Z),
        Face::XMax => (DVec3::new(b.x, b.y, a.z), DVec3::NEG_Y, DVec3::Z),
        Face::YMin => (DVec3::new(b.x, a.y, a.z), DVec3::NEG_X, DVec3::Z),
        Face::YMax => (DVec3::new(a.x, b.y, a.z), DVec3::X, DVec3::Z),
        Face::Floor => (a, DVec3::X, DVec3::Y),
        Face::Ceiling => (DVec3::new(a.x, b.y, b.z), DVec3::X, DVec3::NEG_Y),
    };
    Frame { origin_m, x, y, normal: x.cross(y) }
}

/// Width and height in m of a box face in its [`face_frame`].
fn face_size(room: &BoxRoom, face: Face) -> [f64; 2] {
    let s = room.max_m - room.min_m;
    match face {
        Face::XMin | Face::XMax => [s.y, s.z],
        Face::YMin | Face::YMax => [s.x, s.z],
        Face::Floor | Face::Ceiling => [s.x, s.y],
    }
}

/// A surface in the making.
pub(crate) struct Draft {
    pub(crate) surface: Surface,
    pub(crate) shape: Shape,
    pub(crate) is_rim: bool,
}

/// What a draft consists of.
pub(crate) enum Shape {
    /// Convex pieces in the surface's frame.
    Pieces(Vec<Piece>),
    /// Triangles as they stand in the mesh.
    Triangles(Vec<[DVec3; 3]>),
    /// The whole plane.
    Unbounded,
    /// A part of an unbounded wall, known to its screen.
    OnScreen,
}

/// The planes an opening's host stands in, one a face.
pub(crate) struct HostPlanes {
    /// Plane id and height over the host's frame in m.
    pub(crate) faces: Vec<(usize, f64)>,
    /// Thickness in m.
    pub(crate) thickness_m: f64,
    /// Group id.
    pub(crate) group: usize,
}

pub(crate) struct Builder<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) centre: DVec3,
    pub(crate) extent_m: f64,
    pub(crate) tolerance_m: f64,
    pub(crate) book: PlaneBook,
    pub(crate) drafts: Vec<Draft>,
    pub(crate) sheets: Vec<Sheet>,
    pub(crate) of_mesh: Range<usize>,
    groups: usize,
    box_hosts: Vec<Vec<HostPlanes>>,
    wall_hosts: Vec<HostPlanes>,
    pub(crate) leaf_faces: Vec<LeafFace>,
}

impl<'a> Builder<'a> {
    /// `tolerance_m`: how near a corner counts as lying on a cut.
    pub(crate) fn new(scene: &'a Scene, centre: DVec3, extent_m: f64, tolerance_m: f64) -> Self {
        Self {
            scene,
            centre,
            extent_m,
            tolerance_m,
            book: PlaneBook::new(centre, extent_m),
            drafts: Vec::new(),
            sheets: Vec::new(),
            of_mesh: 0..0,
            groups: 0,
            box_hosts: Vec::new(),
            wall_hosts: Vec::new(),
            leaf_faces: Vec::new(),
        }
    }

    pub(crate) fn build(mut self) -> Result<Parts> {
        let scene = self.scene;
        for room in &scene.boxes {
            self.add_box(room);
        }
        let box_faces = self.drafts.len();
        let mut covers = Vec::new(); // front and back faces of walls: they replace the box faces they lie on
        for wall in &scene.walls {
            self.add_wall(wall, &mut covers)?;
        }
        let first = self.drafts.len();
        for mesh in &scene.meshes {
            self.add_mesh(mesh);
        }
        self.of_mesh = first..self.drafts.len();
        for i in covers {
            self.replace_box_faces(i, box_faces);
        }
        for opening in &scene.openings {
            self.cut_opening(opening);
        }
        for (i, opening) in scene.openings.iter().enumerate() {
            if let Some(leaf) = &opening.leaf {
                self.add_leaf(i, opening, leaf);
            }
            self.add_reveals(opening);
        }
        self.finish()
    }

    fn group(&mut self) -> usize {
        self.groups += 1;
        self.groups - 1
    }

    fn add_box(&mut self, room: &BoxRoom) {
        let mut hosts = Vec::with_capacity(6);
        for face in Face::ALL {
            let frame = face_frame(room, face);
            let [w, h] = face_size(room, face);
            let corners = [frame.point(0.0, 0.0), frame.point(w, 0.0), frame.point(w, h), frame.point(0.0, h)];
            let (plane, group) = (self.book.id(frame.normal, &corners), self.group());
            hosts.push(HostPlanes { faces: vec![(plane, 0.0)], thickness_m: 0.0, group });
            if let Some(material) = room.faces[face as usize] {
                let name = format!("{}.{}", room.name, face.name());
                let surface = Surface { frame, material, plane, group, area_m2: w * h, name, one_sided: true };
                let shape = Shape::Pieces(vec![cut::rectangle([0.0, w], [0.0, h])]);
                self.sheets.push(Sheet::box_face(&surface, &corners, self.centre));
                self.drafts.push(Draft { surface, shape, is_rim: false });
            }
        }
        self.box_hosts.push(hosts);
    }

    fn add_wall(&mut self, wall: &Wall, covers: &mut Vec<usize>) -> Result<()> {
        let group = self.group();
        let half = 0.5 * wall.thickness_m;
        let corners: Vec<DVec2> = wall.corners_m.iter().map(|&c| wall.frame.local(c).truncate()).collect();
        let sides: &[f64] = if half > 0.0 { &[1.0, -1.0] } else { &[0.0] };
        let mut faces = Vec::new();
        for &side in sides {
            // the back face is turned about local x: x, -y, -normal
            let flip = if side < 0.0 { -1.0 } else { 1.0 };
            let frame = Frame {
                origin_m: wall.frame.origin_m + wall.frame.normal * (half * side),
                x: wall.frame.x,
                y: wall.frame.y * flip,
                normal: wall.frame.normal * flip,
            };
            let local: Vec<DVec2> = corners.iter().map(|c| DVec2::new(c.x, c.y * flip)).collect();
            let world: Vec<DVec3> = local.iter().map(|c| frame.point(c.x, c.y)).collect();
            let plane = self.book.id(frame.normal, &world);
            faces.push((plane, half * side));
            let (shape, area_m2) = if wall.unbounded {
                (Shape::Unbounded, f64::INFINITY)
            } else {
                let pieces = cut::convex_pieces(&local, &wall.name)?;
                let area = pieces.iter().map(|p| cut::area(p)).sum();
                (Shape::Pieces(pieces), area)
            };
            let (material, name, one_sided) = (wall.material, wall.name.clone(), half > 0.0);
            let surface = Surface { frame, material, plane, group, area_m2, name, one_sided };
            self.sheets.push(match &shape {
                Shape::Pieces(pieces) => Sheet::wall(&surface, &world, pieces, self.centre),
                _ => Sheet::unbounded(&surface, self.centre),
            });
            covers.push(self.drafts.len());
            self.drafts.push(Draft { surface, shape, is_rim: false });
        }
        if half > 0.0 && !wall.unbounded {
            self.add_rims(wall, &corners, group);
        }
        self.wall_hosts.push(HostPlanes { faces, thickness_m: wall.thickness_m, group });
        Ok(())
    }

    /// The narrow sides of a thick wall, normals pointing out of it.
    fn add_rims(&mut self, wall: &Wall, corners: &[DVec2], group: usize) {
        let mut ring = corners.to_vec();
        if cut::area(&ring) < 0.0 {
            ring.reverse();
        }
        for (i, &a) in ring.iter().enumerate() {
            let side = ring[(i + 1) % ring.len()] - a;
            let Some(along) = side.try_normalize() else { continue };
            let x = wall.frame.x * along.x + wall.frame.y * along.y;
            let (y, t, length) = (wall.frame.normal, wall.thickness_m, side.length());
            let frame = Frame { origin_m: wall.frame.point(a.x, a.y) - y * (0.5 * t), x, y, normal: x.cross(y) };
            let ends = [frame.point(0.0, 0.0), frame.point(length, 0.0), frame.point(length, t), frame.point(0.0, t)];
            let plane = self.book.id(frame.normal, &ends);
            let name = format!("{} rim {}", wall.name, i + 1);
            let (material, area_m2) = (wall.material, length * t);
            let surface = Surface { frame, material, plane, group, area_m2, name, one_sided: true };
            let pieces = vec![cut::rectangle([0.0, length], [0.0, t])];
            self.sheets.push(Sheet::wall(&surface, &ends, &pieces, self.centre));
            self.drafts.push(Draft { surface, shape: Shape::Pieces(pieces), is_rim: true });
        }
    }

    fn add_mesh(&mut self, mesh: &Mesh) {
        let name = mesh.file.file_name().map_or_else(String::new, |f| f.to_string_lossy().into_owned());
        let size = |t: &[DVec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
        for patch in patches(mesh, &mut self.book, self.tolerance_m.max(1e-7)) {
            let triangles: Vec<[DVec3; 3]> = patch.triangles.iter().map(|&i| mesh.triangles_m[i]).collect();
            let largest = triangles.iter().fold(triangles[0], |a, b| if size(b) > size(&a) { *b } else { a });
            let normal = triangle_normal(&largest);
            let x = (largest[1] - largest[0]).normalize_or_zero();
            let frame = Frame { origin_m: largest[0], x, y: normal.cross(x), normal };
            let surface = Surface {
                frame,
                material: patch.material,
                plane: patch.plane,
                group: self.group(),
                area_m2: triangles.iter().map(size).sum(),
                name: name.clone(),
                one_sided: false,
            };
            self.drafts.push(Draft { surface, shape: Shape::Triangles(triangles), is_rim: false });
        }
    }

    /// Takes away the part of the first `box_faces` drafts that the wall face `wall` covers.
    fn replace_box_faces(&mut self, wall: usize, box_faces: usize) {
        let (below, above) = self.drafts.split_at_mut(box_faces);
        let Some(wall) = wall.checked_sub(box_faces).and_then(|i| above.get(i)) else { return };
        for face in below.iter_mut().filter(|f| f.surface.plane == wall.surface.plane) {
            match &wall.shape {
                Shape::Unbounded => {
                    face.shape = Shape::Pieces(Vec::new());
                    face.surface.area_m2 = 0.0;
                }
                Shape::Pieces(pieces) => {
                    for piece in pieces {
                        cut_draft(face, &wall.surface.frame, piece, self.tolerance_m);
                    }
                }
                Shape::Triangles(_) | Shape::OnScreen => {}
            }
        }
    }

    pub(crate) fn host(&self, host: Host) -> &HostPlanes {
        match host {
            Host::Wall(i) => &self.wall_hosts[i],
            Host::BoxFace(i, face) => &self.box_hosts[i][face as usize],
        }
    }
}

/// Cuts a convex hole, given in `frame`, out of a draft in the same plane and corrects its area.
pub(crate) fn cut_draft(draft: &mut Draft, frame: &Frame, hole: &[DVec2], tolerance_m: f64) {
    let own = draft.surface.frame;
    let mut local: Piece = hole.iter().map(|c| own.local(frame.point(c.x, c.y)).truncate()).collect();
    if cut::area(&local) < 0.0 {
        local.reverse();
    }
    let pieces = match &draft.shape {
        Shape::Unbounded | Shape::OnScreen => return,
        Shape::Pieces(pieces) => cut::subtract(pieces.clone(), &local, tolerance_m),
        Shape::Triangles(triangles) => {
            let flat: Vec<Piece> = triangles
                .iter()
                .map(|t| {
                    let mut piece: Piece = t.iter().map(|&c| own.local(c).truncate()).collect();
                    if cut::area(&piece) < 0.0 {
                        piece.reverse();
                    }
                    piece
                })
                .collect();
            let cut = cut::subtract(flat.clone(), &local, tolerance_m);
            if cut == flat {
                return; // untouched: keep the corners of the mesh to the last bit
            }
            cut
        }
    };
    draft.surface.area_m2 = pieces.iter().map(|p| cut::area(p)).sum();
    draft.shape = Shape::Pieces(pieces);
}

/// What a facet belongs to.
#[derive(Clone, Copy)]
pub(crate) struct Owner {
    pub(crate) element: u32,
    pub(crate) plane: usize,
    pub(crate) group: usize,
    pub(crate) is_rim: bool,
}

pub(crate) fn shape_facets(draft: &Draft, index: usize, centre: DVec3, shapes: &mut Vec<FacetShape>) {
    let surface = &draft.surface;
    let owner = Owner { element: index as u32, plane: surface.plane, group: surface.group, is_rim: draft.is_rim };
    match &draft.shape {
        Shape::Unbounded | Shape::OnScreen => {}
        Shape::Pieces(pieces) => {
            for piece in pieces {
                piece_facets(piece, &surface.frame, owner, centre, shapes);
            }
        }
        Shape::Triangles(triangles) => {
            for t in triangles {
                let n = triangle_normal(t);
                let normal = if n.dot(surface.frame.normal) < 0.0 { -n } else { n };
                shapes.push(shape(*t, false, normal, owner, centre));
            }
        }
    }
}

/// A convex piece as one parallelogram, or as a fan of triangles.
pub(crate) fn piece_facets(piece: &[DVec2], frame: &Frame, owner: Owner, centre: DVec3, shapes: &mut Vec<FacetShape>) {
    let corner = |p: DVec2| frame.point(p.x, p.y);
    if let [a, b, c, d] = *piece {
        let size = (c - a).length();
        if ((b - a) - (c - d)).length() <= 1e-14 * size {
            shapes.push(shape([a, b, d].map(corner), true, frame.normal, owner, centre));
            return;
        }
    }
    for w in piece.windows(2).skip(1) {
        shapes.push(shape([piece[0], w[0], w[1]].map(corner), false, frame.normal, owner, centre));
    }
}

fn shape(t: [DVec3; 3], parallelogram: bool, normal: DVec3, owner: Owner, centre: DVec3) -> FacetShape {
    FacetShape {
        corner: t[0] - centre,
        side_u: t[1] - t[0],
        side_v: t[2] - t[0],
        parallelogram,
        normal,
        element: owner.element,
        plane: owner.plane as u32,
        group: owner.group as u32,
        is_rim: owner.is_rim,
    }
}
