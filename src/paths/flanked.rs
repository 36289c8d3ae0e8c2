//! Paths through openings past edges before or behind them: a door and then the corner of a wall, a barrier and then a window.
//!
//! Edges along the opening count with the source or probe image on their side of it where they hide that from a part of the
//! opening or nearly do. Sight is asked for place by place: what an edge takes away it gives back itself, so that levels are
//! continuous, and the path takes the place of the one through the opening alone, so that nothing is counted twice. A reflection
//! by a face of such an edge ends at it in the same way, as the path over the face's image.

use std::collections::HashMap;
use std::f64::consts::FRAC_PI_4;
use std::sync::{Arc, Mutex, PoisonError};

use glam::{DVec2, DVec3};
use num_complex::Complex64;

use super::Pair;
use super::edge::coherence;
use super::images::Origin;
use super::joined::Kin;
use super::reach::FELT_FRESNEL;
use super::side::Side;
use super::wave::{Sound, Wave};
use crate::geometry::{Edge, Skip};
use crate::scene::{Frame, SourceKind};
use crate::wbsdf::chain::Corner;
use crate::wbsdf::crossing::Spectrum;
use crate::wbsdf::flanked::{Apertures, Bend, End, Flank, FlankedField, Sight};
use crate::wbsdf::mask::Mask;
use crate::wbsdf::wedge;

/// Places across each opening where edges are judged.
pub(super) const PLACES: usize = 33;
/// Steps of sin(beta) to which apertures are shared where only the change by edges is asked for: a power of two.
const COARSE: f64 = 64.0;

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

/// What a way brings in a band.
pub(super) struct Brought {
    /// Mean of the intensity relative to the free field at 1 m.
    pub(super) intensity: f64,
    field: FlankedField,
    /// What |p|^2 of the field is multiplied by.
    factor: f64,
}

impl Brought {
    /// A share of it.
    pub(super) fn times(self, share: f64) -> Self {
        Self { intensity: share * self.intensity, factor: share * self.factor, ..self }
    }
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

    pub(super) fn half_m(&self) -> f64 {
        0.5 * self.depth_m
    }

    pub(super) fn corner(&self, edge: &Edge) -> Option<Corner> {
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
    pub(super) fn places(&self, sign: f64) -> Vec<DVec2> {
        let z = (self.half_m() + 1e-9) * sign;
        // The jambs themselves are blind.
        let share = |n: usize| 1e-6 + (1.0 - 2e-6) * n as f64 / (PLACES - 1) as f64;
        let place = |o: &[f64; 2], n: usize| o[0] + (o[1] - o[0]) * share(n);
        self.across.openings().iter().flat_map(|o| (0..PLACES).map(move |n| DVec2::new(place(o, n), z))).collect()
    }

    pub(super) fn end(&self, origin: Origin) -> Option<(End, f64)> {
        match origin {
            Origin::At(p) => {
                let local = self.frame.local(p);
                Some((End::At(DVec2::new(local.x, local.z)), local.z))
            }
            Origin::Along { direction, .. } => {
                let d = self.frame.turn(direction);
                let across = DVec2::new(d.x, d.z);
                (across.length() > 1e-3).then(|| (End::Along(across.normalize()), -d.z))
            }
        }
    }

    /// The way through the opening past edges between two images, and after it those of the waves that begin reflections by faces of
    /// these edges; none where no edge counts.
    pub(super) fn flanked<'p, 'a>(
        &'p self,
        pair: &'p Pair<'a>,
        (s, p): (usize, usize),
        signs: [f64; 2],
    ) -> Option<Vec<Flanked<'p, 'a>>> {
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
            Origin::Along { .. } => receiver.y,
        };
        let before = self.side(pair, source, s, signs[0], self.within(about_y))?;
        let behind = self.side(pair, probe, p, signs[1], self.within(about_y))?;
        if before.passed.is_empty() && behind.passed.is_empty() {
            return None;
        }
        let mut way = self.way(pair, [before, behind])?;
        let middle = way.middle;
        way.sides.iter_mut().for_each(|side| side.look(self, pair, middle));
        let [before, behind] = &way.sides;
        if before.passed.is_empty() && behind.passed.is_empty() {
            return None;
        }
        // Over an edge, through the opening and over another edge: three in a row.
        let hidden = |side: &Side<'_>| side.passed.iter().any(|passed| passed.detour_m == 0.0);
        if scene.simulation.diffraction_order < 3 && hidden(before) && hidden(behind) {
            return None;
        }
        let [first, second] = [before, behind].map(|side| [side.clone()].into_iter().chain(side.begun()));
        let second: Vec<Side<'p>> = second.collect();
        let pairs = first.flat_map(|a| second.iter().map(move |b| [a.clone(), b.clone()]));
        let begun: Vec<[Side<'p>; 2]> = pairs.skip(1).collect();
        let begun = begun.into_iter().filter_map(|sides| self.way(pair, sides));
        Some([way].into_iter().chain(begun).collect())
    }

    fn within(&self, y: f64) -> f64 {
        let inset = 1e-6;
        y.max(self.along_m[0] + inset).min(self.along_m[1] - inset)
    }

    /// The shortest way between two sides.
    fn way<'p, 'a>(&'p self, pair: &'p Pair<'a>, mut sides: [Side<'p>; 2]) -> Option<Flanked<'p, 'a>> {
        let [before, behind] = &mut sides;
        let (source, probe) = (pair.source.images[before.image].origin, pair.probe.images[behind.image].origin);
        let (Origin::At(receiver), End::At(to)) = (probe, behind.flank.end) else { return None };
        let receiver = self.frame.local(receiver);
        let places = [self.places(before.sign), self.places(behind.sign)];
        let ways =
            places[0].iter().zip(&places[1]).map(|(a, b)| (before.flank.length_m(*a), behind.flank.length_m(*b), *a));
        let (into_m, out_m, at) = ways.min_by(|a, b| (a.0 + a.1).total_cmp(&(b.0 + b.1)))?;
        let over_m = into_m + out_m;
        let (dy_m, sin_beta, slope, wave, straight_m) = match (before.flank.end, pair.kind, source) {
            (End::Along(_), _, Origin::Along { direction, .. }) => {
                let d_y = self.frame.turn(direction).y;
                let sin_beta = (1.0 - d_y * d_y).sqrt();
                (0.0, sin_beta, d_y / sin_beta, wedge::Wave::Plane, 1.0)
            }
            (End::At(from), SourceKind::Line(_), _) => (0.0, 1.0, 0.0, wedge::Wave::Line, from.distance(to)),
            (End::At(from), _, Origin::At(source)) => {
                let dy = receiver.y - self.frame.local(source).y;
                (dy, over_m / over_m.hypot(dy), dy / over_m, wedge::Wave::Line, from.distance(to))
            }
            _ => return None,
        };
        let middle_y = self.within(receiver.y - slope * out_m);
        let middle = DVec3::new(at.x, middle_y, 0.0);
        before.y_m = middle_y - slope * into_m;
        behind.y_m = receiver.y;
        Some(Flanked { view: self, pair, sides, over_m, straight_m, dy_m, sin_beta, wave, middle })
    }
}

/// Fresnel number up to which an edge in sight counts: where pressures add it is heard longer.
pub(super) fn felt_fresnel(pair: &Pair<'_>) -> f64 {
    if pair.scene.adds_pressures() { 2.0 * FELT_FRESNEL } else { FELT_FRESNEL }
}

impl Flanked<'_, '_> {
    /// Share of a band in which the edges count: short waves do not feel an edge in sight that long ones do.
    pub(super) fn felt(&self, spectrum: &Spectrum) -> f64 {
        let passed = self.sides.iter().flat_map(|side| &side.passed);
        passed.map(|passed| self.felt_at(passed.detour_m, spectrum)).fold(0.0, f64::max)
    }

    /// Whether this is the mere beginning of reflections by faces of edges: 1 about their boundaries, 0 far from them.
    pub(super) fn begins(&self, spectrum: &Spectrum) -> f64 {
        let past_m = |side: &Side<'_>| side.begins.map(|(_, face)| side.passed[0].past_faces_m[face]);
        self.sides.iter().filter_map(past_m).map(|past_m| self.felt_at(past_m, spectrum)).product()
    }

    /// The same for an edge the way over which is `detour_m` longer.
    fn felt_at(&self, detour_m: f64, spectrum: &Spectrum) -> f64 {
        let most = felt_fresnel(self.pair);
        coherence(detour_m, spectrum.low_hz, spectrum, [0.5 * most, most])
    }

    /// Length in m of the shortest way.
    pub(super) fn length_m(&self) -> f64 {
        match self.pair.source.images[self.sides[0].image].origin {
            // Across the edges it counts from the middle of the frame.
            wave @ Origin::Along { .. } => {
                wave.length_m(self.view.frame.point(0.0, self.sides[1].y_m)) + self.over_m * self.sin_beta
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
            let flanks = [0, 1].map(|n| Flank { end: self.plain_end(n), faces: true, bends: Vec::new() });
            return Some((apertures.field([&flanks[0], &flanks[1]], signs, [&sights[0], &sights[1]]), Vec::new()));
        }
        let look = |n: usize| self.sides[n].sights(view, self.pair, apertures.places(signs[n]), self.middle.y);
        let ((a, before), (b, behind)) = (look(0), look(1));
        let factors = before?.iter().zip(&behind?).map(|(a, b)| a * b).collect();
        let flanks = [0, 1].map(|n| self.sides[n].flank_in(self.pair, band));
        Some((apertures.field([&flanks[0], &flanks[1]], signs, [&a, &b]), factors))
    }

    /// The end as the opening alone would meet it: where it is behind the wall, as far away in front of the opening.
    fn plain_end(&self, n: usize) -> End {
        let side = &self.sides[n];
        if side.flank.faces || matches!(side.flank.end, End::Along(_)) {
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

    /// Intensity in a band through all of a rectangle, `whole`, over that through a slit, both between [`Flanked::plain_ends`].
    pub(super) fn ratio(&self, band: usize, whole: f64) -> Option<f64> {
        let (without, _) = self.field(band, self.coarse(), true)?;
        let plain_m = match [0, 1].map(|n| self.plain_end(n)) {
            [End::At(a), End::At(b)] => a.distance(b),
            _ => 1.0,
        };
        let alone = without.mean(self.wave, plain_m) * self.spread(plain_m, plain_m);
        (alone > 0.0).then(|| whole / alone)
    }

    /// What the way brings in a band; `ratio`: of a rectangle, [`Flanked::ratio`], by which the edges change what they change
    /// of the intensity through a slit.
    pub(super) fn brings(&self, band: usize, ratio: Option<f64>) -> Option<Brought> {
        let sin_beta = if ratio.is_some() { self.coarse() } else { self.sin_beta };
        let (field, factors) = self.field(band, sin_beta, false)?;
        let factor = ratio.unwrap_or(1.0) * factors[band] * self.air(band);
        let across = field.mean(self.wave, self.straight_m) * self.spread(self.over_m, self.straight_m);
        Some(Brought { intensity: across * factor, field, factor })
    }

    /// A sine of the angle that many ways share: what edges change depends little on it.
    fn coarse(&self) -> f64 {
        (self.sin_beta * COARSE).ceil() / COARSE
    }

    fn air(&self, band: usize) -> f64 {
        (-self.pair.scene.air.attenuation_per_m[band] * self.length_m()).exp()
    }

    /// Unit vector from the probe towards the last edge on the way, or the opening.
    pub(super) fn heard_from(&self) -> DVec3 {
        let side = &self.sides[1];
        let (at, image) = side.passed.last().map_or((self.middle, side.image), |passed| (passed.apex, passed.image));
        side.tree.heard_from(self.pair.geometry, image, at)
    }

    /// How it belongs to other ways, before and behind the opening.
    pub(super) fn kin(&self) -> [Kin; 2] {
        let places = self.sides.each_ref().map(|side| self.view.places(side.sign));
        [0, 1].map(|n| {
            let kin = self.sides[n].kin();
            let flanks = [n, 1 - n].map(|n| &self.sides[n].flank);
            let over_m = |bend: &Bend| {
                let ways = places[n].iter().zip(&places[1 - n]);
                ways.map(|(at, other)| bend.length_m(*at) + flanks[1].length_m(*other)).fold(f64::INFINITY, f64::min)
            };
            let over_m = flanks[0].bends.iter().filter(|bend| !bend.parts[0]).map(over_m).fold(f64::INFINITY, f64::min);
            let past_m = if kin.of.is_some() { (over_m - self.over_m).max(0.0) } else { 0.0 };
            Kin { past_m, ..kin }
        })
    }

    /// The sound as a pressure; `brought`: what it brings, one a band.
    pub(super) fn as_wave<'w>(&self, brought: Vec<Option<Brought>>) -> Wave<'w> {
        let (over_m, dy_m, length_m) = (self.over_m, self.dy_m, self.length_m());
        let space = over_m.hypot(dy_m);
        let point = self.wave == wedge::Wave::Line && !matches!(self.pair.kind, SourceKind::Line(_));
        let passed = self.sides.iter().flat_map(|side| &side.passed);
        let detour_m = passed.fold(0.0_f64, |a, passed| a.max(passed.detour_m));
        let ends: Vec<f64> = self.view.across.openings().iter().flatten().copied().collect();
        let span_m =
            ends.iter().fold(f64::NEG_INFINITY, |a, x| a.max(*x)) - ends.iter().fold(f64::INFINITY, |a, x| a.min(*x));
        let (scale, turn) = if point { (over_m.sqrt() / space, FRAC_PI_4) } else { (1.0, 0.0) };
        Wave {
            length_m,
            wander_m: detour_m + span_m,
            sound: Sound::at(move |band, k| {
                let way = |b: &Brought| {
                    b.field.envelope(k, over_m) * Complex64::from_polar(scale * b.factor.sqrt(), k * length_m + turn)
                };
                brought[band].as_ref().map_or(Complex64::ZERO, way)
            }),
        }
    }
}
