//! Openings: holes in every surface of their plane, leaves, portals, and reveals where there are no portals.

use super::cut;
use super::facet::PORTAL_BIT;
use super::screen::{Region, Screen};
use super::surfaces::{Builder, Draft, Owner, Parts, Shape, cut_draft, piece_facets, shape_facets};
use super::{Portal, Surface, has_portals};
use crate::error::Result;
use crate::scene::{Frame, Host, Leaf, Opening};

/// A leaf's surface on one face of the host.
pub(crate) struct LeafFace {
    opening: usize,
    plane: usize,
    draft: usize,
}

impl Builder<'_> {
    /// Limits cut down to what can matter in this scene, so that bounded surfaces are cut by finite holes.
    fn finite(&self, opening: &Opening, limits: [f64; 2]) -> [f64; 2] {
        let far = 4.0 * (self.extent_m + (opening.frame.origin_m - self.centre).length() + 1.0);
        limits.map(|v| v.clamp(-far, far))
    }

    fn is_unbounded(&self, host: Host) -> bool {
        matches!(host, Host::Wall(i) if self.scene.walls[i].unbounded)
    }

    /// Cuts the hole out of every surface in the planes of the host's faces.
    pub(crate) fn cut_opening(&mut self, opening: &Opening) {
        let rectangle = cut::rectangle(self.finite(opening, opening.hole_x_m), self.finite(opening, opening.y_m));
        if cut::area(&rectangle) <= 0.0 {
            return;
        }
        let planes: Vec<usize> = self.host(opening.host).faces.iter().map(|f| f.0).collect();
        for sheet in self.sheets.iter_mut().filter(|s| planes.contains(&s.plane)) {
            sheet.holes.push(rectangle.iter().map(|c| opening.frame.point(c.x, c.y) - self.centre).collect());
        }
        for draft in self.drafts.iter_mut().filter(|d| planes.contains(&d.surface.plane)) {
            cut_draft(draft, &opening.frame, &rectangle, self.tolerance_m);
        }
    }

    /// Fills what the leaf covers, on each face of the host.
    pub(crate) fn add_leaf(&mut self, index: usize, opening: &Opening, leaf: &Leaf) {
        let (faces, group) = (self.host(opening.host).faces.clone(), self.host(opening.host).group);
        for (plane, height_m) in faces {
            // behind a thick wall the frame is turned about local x, as that of the wall's back face
            let flip = if height_m < 0.0 { -1.0 } else { 1.0 };
            let f = opening.frame;
            let frame =
                Frame { origin_m: f.origin_m + f.normal * height_m, x: f.x, y: f.y * flip, normal: f.normal * flip };
            let mut y_m = self.finite(opening, opening.y_m).map(|y| y * flip);
            y_m.sort_by(f64::total_cmp);
            let shape = match self.is_unbounded(opening.host) {
                true => Shape::OnScreen,
                false => Shape::Pieces(vec![cut::rectangle(self.finite(opening, leaf.x_m), y_m)]),
            };
            let surface = Surface {
                frame,
                material: leaf.material,
                plane,
                group,
                area_m2: (leaf.x_m[1] - leaf.x_m[0]) * (opening.y_m[1] - opening.y_m[0]),
                name: format!("{} leaf", opening.name),
                one_sided: height_m != 0.0,
            };
            self.leaf_faces.push(LeafFace { opening: index, plane, draft: self.drafts.len() });
            self.drafts.push(Draft { surface, shape, is_rim: false });
        }
    }

    /// The jambs, sill and lintel of a plain hole in a thick wall. A portal needs none: what crosses it passes the
    /// wall.
    pub(crate) fn add_reveals(&mut self, opening: &Opening) {
        let Host::Wall(wall) = opening.host else { return };
        let (t, group) = (self.host(opening.host).thickness_m, self.host(opening.host).group);
        if has_portals(&self.scene.simulation) || t <= 0.0 || opening.is_closed() {
            return;
        }
        let f = opening.frame;
        let ([x0, x1], [y0, y1]) = (self.finite(opening, opening.open_x_m), self.finite(opening, opening.y_m));
        let limits = [opening.open_x_m, opening.y_m].concat();
        let sides = [(x0, y0, f.y, y1 - y0), (x1, y1, -f.y, y1 - y0), (x1, y0, -f.x, x1 - x0), (x0, y1, f.x, x1 - x0)];
        for (limit, (x, y, along, length)) in limits.into_iter().zip(sides) {
            if !limit.is_finite() {
                continue;
            }
            let origin_m = f.point(x, y) - f.normal * (0.5 * t);
            let frame = Frame { origin_m, x: along, y: f.normal, normal: along.cross(f.normal) };
            let corners =
                [frame.point(0.0, 0.0), frame.point(length, 0.0), frame.point(length, t), frame.point(0.0, t)];
            let surface = Surface {
                frame,
                material: self.scene.walls[wall].material,
                plane: self.book.id(frame.normal, &corners),
                group,
                area_m2: length * t,
                name: format!("{} reveal", opening.name),
                one_sided: true,
            };
            let shape = Shape::Pieces(vec![cut::rectangle([0.0, length], [0.0, t])]);
            self.drafts.push(Draft { surface, shape, is_rim: false });
        }
    }

    /// Turns the drafts into surfaces and facets and adds the portals.
    pub(crate) fn finish(mut self) -> Result<Parts> {
        let (mut portals, mut shapes, mut screens) = (Vec::new(), Vec::new(), Vec::new());
        for (i, draft) in self.drafts.iter().enumerate() {
            if let Shape::Unbounded = draft.shape {
                screens.push(Screen::new(&draft.surface, i, self.centre));
            }
            shape_facets(draft, i, self.centre, &mut shapes);
        }
        for (i, opening) in self.scene.openings.iter().enumerate() {
            let host = self.host(opening.host);
            // What a half-plane leaves open is no portal: its edge is an edge like others.
            let is_portal =
                has_portals(&self.scene.simulation) && !opening.is_closed() && self.scene.half_plane(opening).is_none();
            let portal = is_portal.then(|| {
                portals.push(Portal {
                    opening: i,
                    frame: opening.frame,
                    x_m: opening.open_x_m,
                    y_m: opening.y_m,
                    thickness_m: host.thickness_m,
                    group: host.group,
                });
                PORTAL_BIT | (portals.len() - 1) as u32
            });
            for &(plane, height_m) in &host.faces {
                let f = opening.frame;
                let face = Frame { origin_m: f.origin_m + f.normal * height_m, ..f };
                if let Some(element) = portal
                    && !self.is_unbounded(opening.host)
                {
                    let piece =
                        cut::rectangle(self.finite(opening, opening.open_x_m), self.finite(opening, opening.y_m));
                    let owner = Owner { element, plane, group: host.group, is_rim: false };
                    piece_facets(&piece, &face, owner, self.centre, &mut shapes);
                }
                let leaf = self.leaf_faces.iter().find(|l| l.opening == i && l.plane == plane).map(|l| l.draft as u32);
                let leaf_x_m = opening.leaf.as_ref().map_or([0.0; 2], |l| l.x_m);
                let frame = Frame { origin_m: face.origin_m - self.centre, ..face };
                let region = |x_m, element| Region { frame, x_m, y_m: opening.y_m, element, group: host.group };
                for screen in screens.iter_mut().filter(|s: &&mut Screen| s.plane == plane) {
                    screen.regions.extend(leaf.map(|e| region(leaf_x_m, Some(e))));
                    screen.regions.extend(portal.map(|e| region(opening.open_x_m, Some(e))));
                    screen.regions.push(region(opening.hole_x_m, None));
                }
            }
        }
        let surfaces: Vec<Surface> = self.drafts.into_iter().map(|d| d.surface).collect();
        for (i, surface) in surfaces.iter().enumerate() {
            self.book.planes[surface.plane].surfaces.push(i);
        }
        Ok(Parts { surfaces, portals, shapes, screens, book: self.book, sheets: self.sheets, of_mesh: self.of_mesh })
    }
}
