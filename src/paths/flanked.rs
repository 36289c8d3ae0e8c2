//! Paths through openings past edges before or behind them: a door and then the corner of a wall, a barrier and then a window.
//!
//! Edges along the opening count with the source or probe image on their side of it where they hide that from a part of the
//! opening or nearly do. Sight is asked for place by place: what an edge takes away it gives back itself, so that levels are
//! continuous, and the path takes the place of the one through the opening alone, so that nothing is counted twice. A reflection
//! by a face of such an edge ends at it in the same way, as the path over the face's image.

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec2, DVec3};
use num_complex::Complex64;

use super::Pair;
use super::images::{ImageTree, Origin};
use super::reach::FELT_FRESNEL;
use super::wave::{Sound, Wave};
use crate::geometry::{Edge, Skip};
use crate::probe::EarlyPath;
use crate::scene::{Frame, SourceKind};
use crate::wbsdf::chain::Corner;
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::flanked::{Apertures, Bend, End, Flank, FlankedField, Sight};
use crate::wbsdf::mask::Mask;
use crate::wbsdf::wedge;

/// Places across each opening where edges are judged.
const PLACES: usize = 33;
/// How far in m an edge may lie off the plane of a wall's face to be one of its borders.
const ON_PLANE_M: f64 = 1e-6;
/// Steps of sin(beta) to which apertures are shared where only the change by edges is asked for: a power of two.
const COARSE: f64 = 64.0;
/// Relative accuracy of the field on the opening.
const ACCURACY: f64 = 1e-3;

/// Band, whether the edges lie along x of the opening, and sine of the angle between ray and edges (its bits).
type Key = (usize, bool, u64);

/// Apertures that several pairs share.
#[derive(Default)]
pub(super) struct Solved(Mutex<HashMap<Key, Arc<Apertures>>>);

/// An opening seen across those of its edges that lie along y of the frame.
pub(super) struct View<'a> {
    pub(super) frame: Frame,
    pub(super) across: &'a Mask,
    /// Limits along y in m.
    pub(super) along_m: [f64; 2],
    pub(super) depth_m: f64,
    pub(super) skip: Skip,
    /// Whether x and y of the opening have changed places.
    pub(super) turned: bool,
    pub(super) solved: &'a Solved,
}

/// An edge about its apex, the point of it that the way passes.
struct Apex {
    at: DVec3,
    /// Image whose chain leads from the apex to the end.
    image: usize,
}

/// Source or probe image with the edges between it and the opening.
struct Side<'p> {
    tree: &'p ImageTree,
    image: usize,
    /// Sign of z of this side of the wall.
    sign: f64,
    /// Whether the end itself is on this side.
    faces: bool,
    y_m: f64,
    flank: Flank,
    apexes: Vec<Apex>,
    /// Shortest detour in m over each edge; 0 where it hides the end from a part of the opening.
    detours_m: Vec<f64>,
    factors: Vec<f64>,
}

/// One way through an opening past edges, between one source image and one probe image.
pub(super) struct Flanked<'p, 'a> {
    view: &'p View<'p>,
    pair: &'p Pair<'a>,
    sides: [Side<'p>; 2],
    /// Length in m of the shortest way across the edges, and of the straight one.
    over_m: f64,
    straight_m: f64,
    /// Receiver minus source along the edges in m (point source).
    dy_m: f64,
    /// Sine of the angle between the way and the edges.
    sin_beta: f64,
    wave: wedge::Wave,
    /// Place in the opening, on the way.
    pub(super) middle: DVec3,
}

impl View<'_> {
    fn flat(&self, p: DVec3) -> DVec2 {
        let local = self.frame.local(p);
        DVec2::new(local.x, local.z)
    }

    fn half_m(&self) -> f64 {
        0.5 * self.depth_m
    }

    fn corner(&self, edge: &Edge) -> Option<Corner> {
        if edge.direction.dot(self.frame.y).abs() < 1.0 - 1e-9 {
            return None;
        }
        let turned = |v: DVec3| {
            let local = self.frame.turn(v);
            DVec2::new(local.x, local.z)
        };
        Some(Corner {
            at: self.flat(edge.start),
            face_a: turned(edge.face_a),
            normal_a: turned(edge.normal_a),
            exterior_angle: edge.exterior_angle,
        })
    }

    /// Places over all openings, just outside the wall on one side.
    fn places(&self, sign: f64) -> Vec<DVec2> {
        let z = (self.half_m() + 1e-9) * sign;
        let place = |o: &[f64; 2], n: usize| o[0] + (o[1] - o[0]) * (n as f64 + 0.5) / PLACES as f64;
        self.across.openings().iter().flat_map(|o| (0..PLACES).map(move |n| DVec2::new(place(o, n), z))).collect()
    }

    fn end(&self, origin: Origin) -> Option<(End, f64)> {
        match origin {
            Origin::At(p) => {
                let local = self.frame.local(p);
                Some((End::At(DVec2::new(local.x, local.z)), local.z))
            }
            Origin::Along(d) => {
                let d = self.frame.turn(d);
                let across = DVec2::new(d.x, d.z);
                (across.length() > 1e-3).then(|| (End::Along(across.normalize()), -d.z))
            }
        }
    }

    /// The edges that count on the side `sign` between the opening and an image.
    fn side<'p>(
        &self,
        pair: &'p Pair<'_>,
        tree: &'p ImageTree,
        image: usize,
        sign: f64,
        y_m: f64,
    ) -> Option<(Side<'p>, Vec<&'p Edge>)> {
        let (end, z) = self.end(tree.images[image].origin)?;
        let places = self.places(sign);
        let middle = places[places.len() / 2];
        let low_hz = pair.spectra.first()?.low_hz;
        let mut side = Side {
            tree,
            image,
            sign,
            faces: z * sign > self.half_m(),
            y_m: if let Origin::At(p) = tree.images[image].origin { self.frame.local(p).y } else { 0.0 },
            flank: Flank { end, bends: Vec::new() },
            apexes: Vec::new(),
            detours_m: Vec::new(),
            factors: Vec::new(),
        };
        let mut edges = Vec::new();
        let mut lit = None;
        for edge in &pair.geometry.edges {
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
            let on_face = tree.images[image].planes.last().is_some_and(|plane| edge.planes.contains(plane));
            let own = if on_face { tree.images[image].parent? } else { image };
            let (own_end, _) = self.end(tree.images[own].origin)?;
            let inside = match own_end {
                End::At(p) => corner.has_air(p - corner.at) && p.distance(corner.at) > 1e-6,
                End::Along(d) => corner.has_air(-d),
            };
            if !inside {
                continue;
            }
            let mut bend = Bend { corner, end: own_end, parts: [true, false, false] };
            let reflects = |at: &DVec2, face: usize| match face {
                0 => bend.sum(*at) < PI,
                _ => bend.sum(*at) > 2.0 * corner.exterior_angle - PI,
            };
            let any = [0, 1].map(|face| !border && places.iter().any(|at| reflects(at, face)));
            let hides = |at: &DVec2| match (on_face, any[0]) {
                (false, _) => bend.span(*at) >= PI,
                (true, first) => !reflects(at, usize::from(!first)),
            };
            // An edge beyond which the end is in sight all the same, as the far end of a wall, hides nothing.
            let longer = |at: &DVec2| (bend.length_m(*at) - end.length_m(*at)).max(0.0);
            let own_m = places.iter().filter(|at| !hides(at)).map(longer).fold(f64::INFINITY, f64::min);
            let over_m = places.iter().filter(|at| hides(at)).map(longer).fold(f64::INFINITY, f64::min);
            let detour_m = match over_m.is_finite() {
                true if !*lit.get_or_insert_with(|| side.is_seen(self, pair, &places, y_m)) => 0.0,
                _ => own_m.min(over_m),
            };
            bend.parts = match (on_face, border) {
                // In the plane of a face direct sound and reflection are one.
                (_, true) => [!on_face, false, false],
                (true, _) => [false, any[0], any[1]],
                (false, _) => [true, !any[0], !any[1]],
            };
            let felt = 2.0 * detour_m * low_hz / pair.scene.air.speed_of_sound_m_s <= FELT_FRESNEL;
            if !felt || bend.parts == [false; 3] {
                continue;
            }
            side.flank.bends.push(bend);
            side.detours_m.push(detour_m);
            side.apexes.push(Apex { at: DVec3::ZERO, image: own });
            edges.push(edge);
        }
        Some((side, edges))
    }

    /// The way through the opening past edges between two images; `None` where no edge counts.
    pub(super) fn flanked<'p, 'a>(
        &'p self,
        pair: &'p Pair<'a>,
        (s, p): (usize, usize),
        signs: [f64; 2],
    ) -> Option<Flanked<'p, 'a>> {
        let &Pair { scene, kind, source, probe, .. } = pair;
        if let SourceKind::Line(axis) = kind
            && axis.dot(self.frame.y).abs() < 1.0 - 1e-9
        {
            return None;
        }
        let Origin::At(receiver) = probe.images[p].origin else { return None };
        let receiver = self.frame.local(receiver);
        // About where the way passes the opening.
        let about_y = match source.images[s].origin {
            Origin::At(from) => {
                let from = self.frame.local(from);
                from.y + (receiver.y - from.y) * from.z.abs() / (from.z.abs() + receiver.z.abs())
            }
            Origin::Along(_) => receiver.y,
        };
        let inset = 1e-6;
        let within = |y: f64| y.max(self.along_m[0] + inset).min(self.along_m[1] - inset);
        let (mut before, first) = self.side(pair, source, s, signs[0], within(about_y))?;
        let (mut behind, second) = self.side(pair, probe, p, signs[1], within(about_y))?;
        if first.is_empty() && second.is_empty() {
            return None;
        }
        let to = DVec2::new(receiver.x, receiver.z);
        let places = [self.places(signs[0]), self.places(signs[1])];
        let ways =
            places[0].iter().zip(&places[1]).map(|(a, b)| (before.flank.length_m(*a), behind.flank.length_m(*b), *a));
        let (into_m, out_m, at) = ways.min_by(|a, b| (a.0 + a.1).total_cmp(&(b.0 + b.1)))?;
        let over_m = into_m + out_m;
        let (dy_m, sin_beta, slope, wave, straight_m) = match (before.flank.end, kind) {
            (End::Along(_), _) => {
                let Origin::Along(d) = source.images[s].origin else { return None };
                let d_y = self.frame.turn(d).y;
                let sin_beta = (1.0 - d_y * d_y).sqrt();
                (0.0, sin_beta, d_y / sin_beta, wedge::Wave::Plane, 1.0)
            }
            (End::At(from), SourceKind::Line(_)) => (0.0, 1.0, 0.0, wedge::Wave::Line, from.distance(to)),
            (End::At(from), _) => {
                let dy = receiver.y - before.y_m;
                (dy, over_m / over_m.hypot(dy), dy / over_m, wedge::Wave::Line, from.distance(to))
            }
        };
        let middle_y = within(receiver.y - slope * out_m);
        let middle = DVec3::new(at.x, middle_y, 0.0);
        before.y_m = middle_y - slope * into_m;
        behind.y_m = receiver.y;
        for (side, edges) in [(&mut before, first), (&mut behind, second)] {
            side.look(self, pair, edges, middle);
        }
        if before.flank.bends.is_empty() && behind.flank.bends.is_empty() {
            return None;
        }
        // Over an edge, through the opening and over another edge: three in a row.
        let hidden = |side: &Side<'_>| side.detours_m.contains(&0.0);
        if scene.simulation.diffraction_order < 3 && hidden(&before) && hidden(&behind) {
            return None;
        }
        Some(Flanked { view: self, pair, sides: [before, behind], over_m, straight_m, dy_m, sin_beta, wave, middle })
    }
}

impl Side<'_> {
    /// Keeps the edges in sight of the end, at the points that the way from `middle` of the opening passes.
    fn look(&mut self, view: &View<'_>, pair: &Pair<'_>, edges: Vec<&Edge>, middle: DVec3) {
        let from = DVec2::new(middle.x, view.half_m() * self.sign);
        let mut kept = Vec::new();
        for (n, edge) in edges.into_iter().enumerate() {
            let corner = &self.flank.bends[n].corner;
            let share = match self.flank.bends[n].end {
                End::At(end) => from.distance(corner.at) / (from.distance(corner.at) + end.distance(corner.at)),
                End::Along(_) => 0.0,
            };
            let y = middle.y + share * (self.y_m - middle.y);
            let out = corner.at + corner.outwards() * (1e-6 * (1.0 + corner.at.length()));
            let apex = view.frame.point(out.x, y) + view.frame.normal * out.y;
            let along = (apex - edge.start).dot(edge.direction);
            if !(0.0..=edge.length_m).contains(&along) {
                continue;
            }
            let image = self.apexes[n].image;
            if let Some(loss) = self.tree.arrive(pair.scene, pair.geometry, image, apex, Skip::NONE) {
                if image == self.image && self.factors.is_empty() {
                    self.factors = loss.factors;
                }
                kept.push((n, apex));
            }
        }
        self.flank.bends = kept.iter().map(|(n, _)| self.flank.bends[*n]).collect();
        self.detours_m = kept.iter().map(|(n, _)| self.detours_m[*n]).collect();
        self.apexes = kept.iter().map(|(n, at)| Apex { at: *at, image: self.apexes[*n].image }).collect();
    }

    /// Whether the end is in sight of some of the places of the opening.
    fn is_seen(&self, view: &View<'_>, pair: &Pair<'_>, places: &[DVec2], y_m: f64) -> bool {
        self.faces
            && places.iter().step_by(PLACES / 8).any(|at| {
                let from = view.frame.point(at.x, y_m) + view.frame.normal * at.y;
                self.tree.arrive(pair.scene, pair.geometry, self.image, from, view.skip).is_some()
            })
    }

    /// What the places of the opening see, and the factors of the chain.
    fn sights(
        &self,
        view: &View<'_>,
        pair: &Pair<'_>,
        places: impl Iterator<Item = DVec2>,
        y: f64,
    ) -> (Vec<Sight>, Option<Vec<f64>>) {
        let mut factors = (!self.factors.is_empty()).then(|| self.factors.clone());
        let sight = |at: DVec2| {
            let from = view.frame.point(at.x, y) + view.frame.normal * at.y;
            let loss = match self.faces {
                true => self.tree.arrive(pair.scene, pair.geometry, self.image, from, view.skip),
                false => None,
            };
            let direct = loss.is_some();
            if factors.is_none() {
                factors = loss.map(|loss| loss.factors);
            }
            let free = |apex: &Apex| !pair.geometry.blocked(from, apex.at, view.skip, Skip::NONE);
            Sight { direct, bends: self.apexes.iter().map(free).collect() }
        };
        let sights = places.map(sight).collect();
        (sights, factors)
    }
}

impl Flanked<'_, '_> {
    /// Share of a band in which the edges count: short waves do not feel an edge in sight that long ones do.
    pub(super) fn felt(&self, spectrum: &Spectrum) -> f64 {
        let fade = |detour_m: &f64| {
            let fresnel = 2.0 * detour_m * spectrum.low_hz / spectrum.speed_m_s;
            let t = (fresnel / FELT_FRESNEL * 2.0 - 1.0).clamp(0.0, 1.0);
            1.0 - t * t * (3.0 - 2.0 * t)
        };
        self.sides.iter().flat_map(|side| &side.detours_m).map(fade).fold(0.0, f64::max)
    }

    /// Length in m of the shortest way; of a plane wave from the wave front through the origin of coordinates.
    pub(super) fn length_m(&self) -> f64 {
        match self.pair.source.images[self.sides[0].image].origin {
            Origin::Along(d) => {
                self.view.frame.origin_m.dot(d)
                    + self.middle.y * self.view.frame.turn(d).y
                    + self.over_m * self.sin_beta
                    + (self.sides[1].y_m - self.middle.y) * self.view.frame.turn(d).y
            }
            Origin::At(_) => self.over_m.hypot(self.dy_m),
        }
    }

    fn field(&self, band: usize, sin_beta: f64, plain: bool) -> Option<(FlankedField, Vec<f64>)> {
        let view = self.view;
        let key = (band, view.turned, sin_beta.to_bits());
        let known = view.solved.0.lock().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        let apertures = match known {
            Some(apertures) => apertures,
            None => {
                let new = Arc::new(Apertures::new(view.across, view.depth_m, &self.pair.spectra[band], sin_beta)?);
                // Any other angle belongs to one pair alone.
                if (sin_beta * COARSE).fract() == 0.0 {
                    view.solved.0.lock().unwrap_or_else(PoisonError::into_inner).insert(key, Arc::clone(&new));
                }
                new
            }
        };
        let signs = [0, 1].map(|n| self.sides[n].sign);
        if plain {
            let open =
                |n: usize| apertures.places(signs[n]).map(|_| Sight { direct: true, bends: Vec::new() }).collect();
            let sights: [Vec<Sight>; 2] = [open(0), open(1)];
            let flanks = [0, 1].map(|n| Flank { end: self.plain_end(n), bends: Vec::new() });
            return Some((apertures.field([&flanks[0], &flanks[1]], signs, [&sights[0], &sights[1]]), Vec::new()));
        }
        let look = |n: usize| self.sides[n].sights(view, self.pair, apertures.places(signs[n]), self.middle.y);
        let ((a, before), (b, behind)) = (look(0), look(1));
        let factors = before?.iter().zip(&behind?).map(|(a, b)| a * b).collect();
        let flanks = [0, 1].map(|n| &self.sides[n].flank);
        Some((apertures.field(flanks, signs, [&a, &b]), factors))
    }

    /// The end as the opening alone would meet it: where it is behind the wall, as far away in front of the opening.
    fn plain_end(&self, n: usize) -> End {
        let side = &self.sides[n];
        if side.faces || matches!(side.flank.end, End::Along(_)) {
            return side.flank.end;
        }
        let at = DVec2::new(self.middle.x, self.view.half_m() * side.sign);
        End::At(at + DVec2::new(0.0, side.flank.length_m(at) * side.sign))
    }

    /// The ends in the frame of the view, as the opening alone would meet them.
    pub(super) fn plain_ends(&self) -> [DVec3; 2] {
        [0, 1].map(|n| match self.plain_end(n) {
            End::At(p) => DVec3::new(p.x, self.sides[n].y_m, p.y),
            End::Along(_) => DVec3::ZERO,
        })
    }

    /// What the shortest way spreads over, times the mean of |p/p_free|^2 over `straight_m` across the edges.
    fn spread(&self, over_m: f64, straight_m: f64) -> f64 {
        match (self.wave, self.pair.kind) {
            (wedge::Wave::Plane, _) => 1.0,
            (_, SourceKind::Line(_)) => 1.0 / straight_m,
            _ => over_m / ((over_m * over_m + self.dy_m * self.dy_m) * straight_m),
        }
    }

    /// Band mean of the intensity relative to the free field at 1 m, the chain's factors (one a band) in it, and the field.
    pub(super) fn intensity(&self, band: usize) -> Option<(f64, FlankedField, f64)> {
        let (field, factors) = self.field(band, self.sin_beta, false)?;
        let value = field.mean(self.wave, self.straight_m) * self.spread(self.over_m, self.straight_m);
        Some((value * factors[band] * self.air(band), field, factors[band] * self.air(band)))
    }

    /// What the edges change of the intensity through the opening alone between [`Flanked::plain_ends`]; the chain's factors in it.
    pub(super) fn change(&self, band: usize) -> Option<f64> {
        let sin_beta = (self.sin_beta * COARSE).ceil() / COARSE;
        let (with, factors) = self.field(band, sin_beta, false)?;
        let (without, _) = self.field(band, sin_beta, true)?;
        let ends = [0, 1].map(|n| self.plain_end(n));
        let plain_m = match ends {
            [End::At(a), End::At(b)] => a.distance(b),
            _ => 1.0,
        };
        let alone = without.mean(self.wave, plain_m) * self.spread(plain_m, plain_m);
        let both = with.mean(self.wave, self.straight_m) * self.spread(self.over_m, self.straight_m);
        (alone > 0.0).then(|| both / alone * factors[band] * self.air(band))
    }

    fn air(&self, band: usize) -> f64 {
        (-self.pair.scene.air.attenuation_per_m[band] * self.length_m()).exp()
    }

    /// Unit vector from the probe towards the last edge on the way, or the opening.
    fn heard_from(&self) -> DVec3 {
        let side = &self.sides[1];
        let (at, image) = side.apexes.last().map_or((self.middle, side.image), |apex| (apex.at, apex.image));
        side.tree.heard_from(self.pair.geometry, image, at)
    }

    /// The sound as a pressure; `fields`: one a band with the factors of the chain, as [`Flanked::intensity`] gives them.
    pub(super) fn as_wave<'w>(&self, fields: Vec<(FlankedField, f64)>) -> Wave<'w> {
        let (over_m, dy_m, length_m) = (self.over_m, self.dy_m, self.length_m());
        let space = over_m.hypot(dy_m);
        let point = self.wave == wedge::Wave::Line && !matches!(self.pair.kind, SourceKind::Line(_));
        let detour_m = self.sides.iter().flat_map(|side| &side.detours_m).fold(0.0_f64, |a, d| a.max(*d));
        let ends: Vec<f64> = self.view.across.openings().iter().flatten().copied().collect();
        let span_m =
            ends.iter().fold(f64::NEG_INFINITY, |a, x| a.max(*x)) - ends.iter().fold(f64::INFINITY, |a, x| a.min(*x));
        let (scale, turn) = if point { (over_m.sqrt() / space, FRAC_PI_4) } else { (1.0, 0.0) };
        Wave {
            length_m,
            wander_m: detour_m + span_m,
            sound: Sound::at(move |band, k| {
                let (field, factor) = &fields[band];
                field.envelope(k, over_m) * Complex64::from_polar(scale * factor.sqrt(), k * length_m + turn)
            }),
        }
    }
}

/// Paths through one opening, by source and probe image.
pub(super) type Keyed = Vec<((usize, usize), EarlyPath)>;

/// Puts the ways past edges in the place of `paths`, those through the opening alone, and of their `waves` (from `first` on one
/// a path, where pressures are asked for).
///
/// `views`: the opening across either pair of its edges; `whole`: intensity in a band through all of a rectangle between two
/// places in its frame (slits: none, the field past the edges is the whole one).
pub(super) fn replace<'a>(
    views: &[View<'_>],
    pair: &Pair<'a>,
    paths: &mut Keyed,
    (waves, first): (&mut Vec<Wave<'a>>, usize),
    whole: Option<&dyn Fn(usize, [DVec3; 2]) -> f64>,
    label: &dyn Fn(usize, usize) -> String,
) {
    let &Pair { scene, geometry, spectra, source, probe, order, .. } = pair;
    let coherent = scene.adds_pressures();
    let views: Vec<&View<'_>> =
        views.iter().filter(|view| geometry.edges.iter().any(|edge| view.corner(edge).is_some())).collect();
    if views.is_empty() || scene.simulation.diffraction_order < 2 {
        return;
    }
    for (s, from) in source.images.iter().enumerate() {
        for (p, to) in probe.images.iter().enumerate().filter(|(_, to)| from.planes.len() + to.planes.len() <= order) {
            let found = views.iter().find_map(|view| {
                let (z_s, z_p) = (view.end(from.origin)?.1, view.end(to.origin)?.1);
                let way = |signs: [f64; 2]| view.flanked(pair, (s, p), signs);
                // The mirror image in a face behind the wall may stand before it. Round a border of the opening's own wall back to
                // the other side is left out.
                let across = |tree: &ImageTree| Some(view.end(tree.images.first()?.origin)?.1);
                match z_s * z_p < 0.0 {
                    true => way([z_s.signum(), z_p.signum()]),
                    false if across(source)? * across(probe)? >= 0.0 => None,
                    false => way([z_s.signum(), -z_s.signum()]).or_else(|| way([-z_p.signum(), z_p.signum()])),
                }
            });
            let Some(flanked) = found else { continue };
            let old = paths.iter().position(|(key, _)| *key == (s, p));
            let mut intensity = Vec::with_capacity(spectra.len());
            let mut fields = Vec::new();
            for (band, spectrum) in spectra.iter().enumerate() {
                let felt = if old.is_some() { flanked.felt(spectrum) } else { 1.0 };
                let new = match whole {
                    None => flanked.intensity(band).map(|(value, field, factor)| {
                        fields.push((field, factor));
                        value
                    }),
                    Some(whole) => flanked.change(band).map(|change| change * whole(band, flanked.plain_ends())),
                };
                let alone = old.map_or(0.0, |n| paths[n].1.intensity[band]);
                intensity.push(felt * new.unwrap_or(0.0) + (1.0 - felt) * alone);
            }
            let length_m = flanked.length_m();
            if coherent {
                let wave = match whole {
                    None if fields.len() == spectra.len() => flanked.as_wave(fields),
                    _ => {
                        // The phase is that of the shortest way.
                        let amplitudes: Vec<f64> = intensity.iter().map(|i| i.max(0.0).sqrt()).collect();
                        Wave {
                            length_m,
                            wander_m: 0.0,
                            sound: Sound::at(move |band, k| Complex64::from_polar(amplitudes[band], k * length_m)),
                        }
                    }
                };
                match old {
                    Some(n) => waves[first + n] = wave,
                    None => waves.push(wave),
                }
            }
            let error = intensity.iter().map(|i| ACCURACY * i).collect();
            let path = EarlyPath {
                course: Vec::new(),
                label: label(s, p),
                reflections: from.planes.len() + to.planes.len(),
                from: flanked.heard_from(),
                delay_s: length_m / scene.air.speed_of_sound_m_s,
                intensity,
                error,
            };
            match old {
                Some(n) => paths[n].1 = path,
                None => paths.push(((s, p), path)),
            }
        }
    }
}
