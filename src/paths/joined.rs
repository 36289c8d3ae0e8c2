//! Ways through openings past edges take the place of those through the opening alone, and join the reflections that an edge
//! begins or ends.
//!
//! Where a face of an edge begins to reflect, its reflection sets in with half of its pressure, and the edge's own wave takes over
//! from there (docs/physics.md section 3). Both are therefore one way, which exists on either side of the boundary: first as the wave
//! over the edge alone, `begun`, then as the reflection of an image with it. On the boundary it joins the direct sound as a
//! pressure; beyond, it parts from it within half a wavelength of detour, as at edges without an opening.

use glam::DVec3;

use super::Pair;
use super::edge::{JOINED_FRESNEL, coherence};
use super::flanked::{Brought, View};
use super::images::ImageTree;
use super::wave::{Wave, interference};
use crate::probe::EarlyPath;
use crate::wbsdf::crossing::Spectrum;

/// Relative accuracy of the field on the opening.
const ACCURACY: f64 = 1e-3;

/// How ways belong together: one image's own and the reflections of it that an edge begins or ends.
pub(super) struct Kin {
    /// Its image, and of the mere beginning of a reflection the edge and its face.
    pub(super) own: (usize, Option<(usize, usize)>),
    /// The image that is reflected.
    pub(super) of: Option<usize>,
    /// By how much in m the shortest way over the edge is longer than the reflection.
    pub(super) past_m: f64,
}

impl Kin {
    /// Share in which two ways add as pressures: an edge joins the direct sound and the reflection at its boundary.
    fn joined(&self, other: &Self, spectrum: &Spectrum) -> f64 {
        let hz = 0.5 * (spectrum.low_hz + spectrum.high_hz);
        let share = |kin: &Self| coherence(kin.past_m, hz, spectrum, JOINED_FRESNEL);
        let reflects = |kin: &Self, of: &Self| kin.of == Some(of.own.0) && of.own.1.is_none();
        match self.own == other.own {
            true => 1.0,
            false if reflects(self, other) => share(self),
            false if reflects(other, self) => share(other),
            false if self.of.is_some() && self.of == other.of => share(self) * share(other),
            false => 0.0,
        }
    }
}

/// What is sent over one way.
struct Sent<'a> {
    /// The path that it belongs to.
    path: usize,
    place: Place,
    /// Before and behind the opening.
    kin: [Kin; 2],
    /// One a band.
    intensity: Vec<f64>,
    wave: Wave<'a>,
}

/// Where the wave of a way belongs.
enum Place {
    /// In the place of that of a path through the opening alone, which keeps what these shares leave, one a band.
    Of(usize, Vec<f64>),
    /// To a new path.
    New,
    /// To no path of its own.
    Begun,
}

/// Paths through one opening, by source and probe image.
pub(super) type Keyed = Vec<((usize, usize), EarlyPath)>;

/// Puts the ways past edges in the place of `paths`, those through the opening alone, and of their `waves` (from `first` on one
/// a path, where pressures are asked for); those of the waves that begin reflections go to `begun`.
///
/// Without pressures the ways about one reflection boundary still add as such: what they change together of the sum of their
/// energies is shared out by these.
///
/// `views`: the opening across either pair of its edges; `whole`: intensity in a band through all of a rectangle between two
/// places in its frame (slits: none, the field past the edges is the whole one).
pub(super) fn replace<'a>(
    views: &[View<'_>],
    pair: &Pair<'a>,
    paths: &mut Keyed,
    (waves, first): (&mut Vec<Wave<'a>>, usize),
    begun: &mut Vec<Wave<'a>>,
    whole: Option<&dyn Fn(usize, [DVec3; 2]) -> f64>,
    label: &dyn Fn(usize, usize) -> String,
) {
    let &Pair { scene, geometry, spectra, source, probe, order, .. } = pair;
    let mut sent: Vec<Sent<'a>> = Vec::new();
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
            let Some(mut ways) = found else { continue };
            let old = paths.iter().position(|(key, _)| *key == (s, p));
            let later = ways.split_off(1);
            let way = &ways[0];
            let mut ratios = Vec::with_capacity(spectra.len());
            let mut brought = Vec::with_capacity(spectra.len());
            let mut intensity = Vec::with_capacity(spectra.len());
            let shares: Vec<f64> = spectra.iter().map(|spectrum| way.felt(spectrum)).collect();
            for (band, share) in shares.iter().enumerate() {
                let ratio = whole.map(|whole| way.ratio(band, whole(band, way.plain_ends())).unwrap_or_default());
                let new = way.brings(band, ratio);
                let felt = if old.is_some() { *share } else { 1.0 };
                let alone = old.map_or(0.0, |n| paths[n].1.intensity[band]);
                intensity.push(felt * new.as_ref().map_or(0.0, |new| new.intensity) + (1.0 - felt) * alone);
                brought.push(new);
                ratios.push(ratio);
            }
            let of_way = EarlyPath {
                course: Vec::new(),
                label: label(s, p),
                reflections: from.planes.len() + to.planes.len(),
                from: way.heard_from(),
                delay_s: way.length_m() / scene.air.speed_of_sound_m_s,
                error: Vec::new(),
                intensity: intensity.clone(),
            };
            let path = match old {
                Some(n) => {
                    paths[n].1 = of_way;
                    n
                }
                None => {
                    paths.push(((s, p), of_way));
                    paths.len() - 1
                }
            };
            let place = old.map_or(Place::New, |n| Place::Of(n, shares));
            sent.push(Sent { path, place, kin: way.kin(), intensity, wave: way.as_wave(brought) });
            for way in later {
                let in_band = |(band, spectrum): (usize, &Spectrum)| {
                    let near = way.begins(spectrum);
                    let own = |whole: &dyn Fn(usize, [DVec3; 2]) -> f64| way.ratio(band, whole(band, way.plain_ends()));
                    // Far from the boundary it goes where the sound goes to which it belongs.
                    let ratio = match (ratios[band], whole) {
                        (Some(ratio), Some(whole)) if near > 0.0 => {
                            Some(ratio.powf(1.0 - near) * own(whole)?.powf(near))
                        }
                        (ratio, _) => ratio,
                    };
                    Some(way.brings(band, ratio)?.times(way.felt(spectrum)))
                };
                let brought: Vec<Option<Brought>> = spectra.iter().enumerate().map(in_band).collect();
                let intensity = brought.iter().map(|b| b.as_ref().map_or(0.0, |b| b.intensity)).collect();
                sent.push(Sent { path, place: Place::Begun, kin: way.kin(), intensity, wave: way.as_wave(brought) });
            }
        }
    }
    join(paths, &sent, spectra);
    for Sent { place, wave, .. } in sent.into_iter().filter(|_| coherent) {
        match place {
            Place::Of(n, felt) => {
                let alone = waves.remove(first + n);
                waves.insert(first + n, wave.mixed(alone, felt));
            }
            Place::New => waves.push(wave),
            Place::Begun => begun.push(wave),
        }
    }
}

/// Adds to the `paths` what the ways of each bring beside its own, and what they bring together beside the sum of their energies.
fn join(paths: &mut Keyed, sent: &[Sent<'_>], spectra: &[Spectrum]) {
    for (i, a) in sent.iter().enumerate() {
        for (band, spectrum) in spectra.iter().enumerate() {
            if let Place::Begun = a.place {
                paths[a.path].1.intensity[band] += a.intensity[band];
            }
            for b in &sent[..i] {
                let joined: f64 = a.kin.iter().zip(&b.kin).map(|(a, b)| a.joined(b, spectrum)).product();
                let both = a.intensity[band] + b.intensity[band];
                if joined > 0.0 && both > 0.0 {
                    let change = joined * interference(&a.wave, &b.wave, band, spectrum);
                    for of in [a, b] {
                        paths[of.path].1.intensity[band] += change * of.intensity[band] / both;
                    }
                }
            }
        }
    }
    for path in sent.iter().map(|sent| sent.path) {
        let path = &mut paths[path].1;
        path.intensity.iter_mut().for_each(|i| *i = i.max(0.0));
        path.error = path.intensity.iter().map(|i| ACCURACY * i).collect();
    }
}
