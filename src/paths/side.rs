//! One side of an opening: a source or probe image with the edges between it and the opening, place by place.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::Pair;
use super::bend::reflection_factors;
use super::flanked::{PLACES, View, felt_fresnel};
use super::images::{ImageTree, Origin};
use super::joined::Kin;
use crate::geometry::{Edge, Skip};
use crate::wbsdf::flanked::{Bend, End, Flank, Sight};

/// How far in m an edge may lie off the plane of a wall's face to be one of its borders.
const ON_PLANE_M: f64 = 1e-6;

/// An edge on the way.
#[derive(Clone)]
pub(super) struct Passed<'p> {
    pub(super) edge: &'p Edge,
    /// Its number in the geometry.
    pub(super) number: usize,
    /// The point of it that the way passes.
    pub(super) apex: DVec3,
    /// Image whose chain leads from there to the end.
    pub(super) image: usize,
    /// Shortest detour in m over it; 0 where it hides the end from a part of the opening.
    pub(super) detour_m: f64,
    /// By how much in m the way over it is longer at least than those of the end's mirror images in its faces.
    pub(super) past_faces_m: [f64; 2],
    /// The faces whose waves are ways of their own.
    pub(super) apart: [bool; 2],
}

/// Source or probe image with the edges between it and the opening.
#[derive(Clone)]
pub(super) struct Side<'p> {
    pub(super) tree: &'p ImageTree,
    pub(super) image: usize,
    /// Sign of z of this side of the wall.
    pub(super) sign: f64,
    pub(super) y_m: f64,
    pub(super) flank: Flank,
    /// One an edge of the flank.
    pub(super) passed: Vec<Passed<'p>>,
    /// What the chain leaves of the energy, one factor a band.
    pub(super) factors: Vec<f64>,
    /// The edge by number and its face from which this is no more than the wave that begins a reflection.
    pub(super) begins: Option<(usize, usize)>,
}

impl View<'_> {
    /// The edges that count on the side `sign` between the opening and an image.
    pub(super) fn side<'p>(
        &self,
        pair: &'p Pair<'_>,
        tree: &'p ImageTree,
        image: usize,
        sign: f64,
        y_m: f64,
    ) -> Option<Side<'p>> {
        let (end, z) = self.end(tree.images[image].origin)?;
        let places = self.places(sign);
        let middle = places[places.len() / 2];
        let low_hz = pair.spectra.first()?.low_hz;
        let mut side = Side {
            tree,
            image,
            sign,
            y_m: if let Origin::At(p) = tree.images[image].origin { self.frame.local(p).y } else { 0.0 },
            flank: Flank { end, faces: z * sign > self.half_m(), bends: Vec::new() },
            passed: Vec::new(),
            factors: Vec::new(),
            begins: None,
        };
        let mut lit = None;
        for (number, edge) in pair.geometry.edges.iter().enumerate() {
            let Some(corner) = self.corner(edge) else { continue };
            let height = corner.at.y * sign - self.half_m();
            let border = height.abs() <= ON_PLANE_M;
            if height < -ON_PLANE_M || !places.iter().all(|at| corner.has_air(*at - corner.at)) {
                continue;
            }
            let from_middle = corner.about(middle);
            if border && from_middle.phi.min(corner.exterior_angle - from_middle.phi) > ON_PLANE_M {
                continue;
            }
            // The last thing before the opening is a reflection by a face of this edge: the edge ends it.
            let last = tree.images[image].planes.last();
            let of_face = edge.planes.map(|plane| last == Some(&plane));
            let on_face = of_face.contains(&true);
            let own = if on_face { tree.images[image].parent? } else { image };
            let (own_end, _) = self.end(tree.images[own].origin)?;
            let inside = match own_end {
                End::At(p) => corner.has_air(p - corner.at) && p.distance(corner.at) > 1e-6,
                End::Along(d) => corner.has_air(-d),
            };
            if !inside {
                continue;
            }
            let mut bend = Bend { corner, end: own_end, parts: [true, false, false], faces: [1.0; 2] };
            let lit_by = [0, 1].map(|face| places.iter().filter(|at| bend.reflects(**at, face)).count());
            let any = [0, 1].map(|face| !border && (of_face[face] || !on_face) && lit_by[face] > 0);
            let hides = |at: &DVec2| match (on_face, any[0]) {
                (false, _) => bend.span(*at) >= PI,
                (true, first) => !bend.reflects(*at, usize::from(!first)),
            };
            // An edge beyond which the end is in sight all the same, as the far end of a wall, hides nothing.
            let longer = |at: &DVec2| (bend.length_m(*at) - end.length_m(*at)).max(0.0);
            let own_m = places.iter().filter(|at| !hides(at)).map(longer).fold(f64::INFINITY, f64::min);
            let over_m = places.iter().filter(|at| hides(at)).map(longer).fold(f64::INFINITY, f64::min);
            let unseen = over_m.is_finite() && !*lit.get_or_insert_with(|| side.is_seen(self, pair, &places, y_m));
            let detour_m = if unseen { 0.0 } else { own_m.min(over_m) };
            let past_face_m = |face: usize| {
                let places = places.iter().map(|at| bend.past_face_m(*at, face));
                if border { f64::INFINITY } else { places.fold(f64::INFINITY, f64::min) }
            };
            let past_faces_m = [0, 1].map(past_face_m);
            // Where nothing sees the end, all ways lead over edges and are one.
            let dark = unseen || places.iter().all(hides);
            let apart = any.map(|any| !(on_face || border || any || dark));
            bend.parts = match (on_face, border) {
                // In the plane of a face direct sound and reflection are one.
                (_, true) => [!on_face, false, false],
                (true, _) => [false, any[0], any[1]],
                (false, _) => [true, !any[0] && dark, !any[1] && dark],
            };
            // About a reflection boundary the direct sound meets the reflection.
            let nearest_m = if on_face { detour_m } else { past_faces_m.into_iter().fold(detour_m, f64::min) };
            let felt = 2.0 * nearest_m * low_hz / pair.scene.air.speed_of_sound_m_s <= felt_fresnel(pair);
            if !felt || bend.parts == [false; 3] {
                continue;
            }
            side.flank.bends.push(bend);
            side.passed.push(Passed { edge, number, apex: DVec3::ZERO, image: own, detour_m, past_faces_m, apart });
        }
        Some(side)
    }
}

impl<'p> Side<'p> {
    /// Keeps the edges in sight of the end, at the points that the way from `middle` of the opening passes.
    pub(super) fn look(&mut self, view: &View<'_>, pair: &Pair<'_>, middle: DVec3) {
        let from = DVec2::new(middle.x, view.half_m() * self.sign);
        for (bend, mut passed) in
            std::mem::take(&mut self.flank.bends).into_iter().zip(std::mem::take(&mut self.passed))
        {
            let corner = &bend.corner;
            let share = match bend.end {
                End::At(end) => from.distance(corner.at) / (from.distance(corner.at) + end.distance(corner.at)),
                End::Along(_) => 0.0,
            };
            let y = middle.y + share * (self.y_m - middle.y);
            let out = corner.at + corner.outwards() * (1e-6 * (1.0 + corner.at.length()));
            passed.apex = view.frame.point(out.x, y) + view.frame.normal * out.y;
            let along = (passed.apex - passed.edge.start).dot(passed.edge.direction);
            if !(0.0..=passed.edge.length_m).contains(&along) {
                continue;
            }
            if let Some(loss) = self.tree.arrive(pair.scene, pair.geometry, passed.image, passed.apex, Skip::NONE) {
                if self.factors.is_empty() {
                    self.factors = loss.factors;
                    if passed.image != self.image {
                        let face = usize::from(!bend.parts[1]);
                        let reflected = reflection_factors(pair.scene, pair.geometry, passed.edge, face);
                        self.factors.iter_mut().zip(reflected).for_each(|(factor, r)| *factor *= r * r);
                    }
                }
                self.flank.bends.push(bend);
                self.passed.push(passed);
            }
        }
    }

    /// The waves that begin reflections, each like a reflection that no place sees yet.
    pub(super) fn begun(&self) -> impl Iterator<Item = Self> {
        let edges = self.flank.bends.iter().zip(&self.passed);
        let faces = edges.flat_map(|(bend, passed)| [0, 1].map(|face| (bend, passed, face)));
        faces.filter(|(_, passed, face)| passed.apart[*face]).map(|(bend, passed, face)| {
            let end = bend.mirrored(face);
            let faces = if let End::At(p) = end { p.y * self.sign > 0.0 } else { true };
            let parts = [false, face == 0, face == 1];
            let detour_m = passed.detour_m.min(passed.past_faces_m[face]);
            Self {
                flank: Flank { end, faces, bends: vec![Bend { parts, ..*bend }] },
                passed: vec![Passed { detour_m, apart: [false; 2], ..passed.clone() }],
                begins: Some((passed.number, face)),
                ..self.clone()
            }
        })
    }

    /// The flank as it is in a band: what a face sends carries its pressure reflection factor, which a reflection has already.
    pub(super) fn flank_in(&self, pair: &Pair<'_>, band: usize) -> Flank {
        let mut flank = self.flank.clone();
        for (bend, passed) in flank.bends.iter_mut().zip(&self.passed) {
            if passed.image == self.image && bend.parts != [true, false, false] {
                bend.faces = [0, 1].map(|face| reflection_factors(pair.scene, pair.geometry, passed.edge, face)[band]);
            }
        }
        flank
    }

    /// How it belongs to other ways.
    pub(super) fn kin(&self) -> Kin {
        let mut parts = self.flank.bends.iter().zip(&self.passed);
        let reflected = parts.find(|(bend, _)| !bend.parts[0]).map(|(_, passed)| passed.image);
        Kin { own: (self.image, self.begins), of: reflected, past_m: 0.0 }
    }

    /// Whether the end is in sight of some of the places of the opening.
    fn is_seen(&self, view: &View<'_>, pair: &Pair<'_>, places: &[DVec2], y_m: f64) -> bool {
        self.flank.faces
            && places.iter().step_by(PLACES / 8).any(|at| {
                let from = view.frame.point(at.x, y_m) + view.frame.normal * at.y;
                self.tree.arrive(pair.scene, pair.geometry, self.image, from, view.skip).is_some()
            })
    }

    /// What the places of the opening see, and the factors of the chain.
    pub(super) fn sights(
        &self,
        view: &View<'_>,
        pair: &Pair<'_>,
        places: impl Iterator<Item = DVec2>,
        y: f64,
    ) -> (Vec<Sight>, Option<Vec<f64>>) {
        let mut factors = (!self.factors.is_empty()).then(|| self.factors.clone());
        let sight = |at: DVec2| {
            let from = view.frame.point(at.x, y) + view.frame.normal * at.y;
            let loss = match self.flank.faces && self.begins.is_none() {
                true => self.tree.arrive(pair.scene, pair.geometry, self.image, from, view.skip),
                false => None,
            };
            let direct = loss.is_some();
            if factors.is_none() {
                factors = loss.map(|loss| loss.factors);
            }
            let free = |passed: &Passed<'_>| !pair.geometry.blocked(from, passed.apex, view.skip, Skip::NONE);
            Sight { direct, bends: self.passed.iter().map(free).collect() }
        };
        let sights = places.map(sight).collect();
        (sights, factors)
    }
}
