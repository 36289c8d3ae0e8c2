//! Paths over two parallel edges in a row: thick barriers, one barrier behind another, thick walls seen round.
//!
//! Where neither edge is passed in sight the chain is a path of its own. Where one of them is, the path over the other
//! edge alone already exists and is multiplied by what the first one changes: so levels are continuous where an edge comes
//! into sight. Sound that is reflected between the two edges (by the ground between two barriers) is left out.

use glam::{DVec2, DVec3};
use num_complex::Complex64;

use super::edge::{Heard, Reached};
use super::images::Origin;
use super::reach::FELT_FRESNEL;
use super::wave::{Sound, Wave};
use super::{Pair, Specular};
use crate::geometry::{Edge, Skip};
use crate::probe::EarlyPath;
use crate::scene::{SourceKind, Transport};
use crate::wbsdf::chain::{Chain, ChainField, ChainRays, Corner, From, Passage};
use crate::wbsdf::crossing::Spectrum;

/// A chain weaker than this relative to the strongest path in the lowest band is left out (-50 dB): higher bands lose more.
const FAINT: f64 = 1e-5;
/// Angle in radians within which an edge lies on the other's face.
const ON_FACE: f64 = 1e-6;
/// Relative accuracy of the integral over the portal.
const ACCURACY: f64 = 2e-3;

/// Sound that changes no level by more than this times what nobody hears (0.004 dB) is taken from the uniform theory, whose
/// error of 3 dB is then below 0.002 dB of the level.
const FEEBLE: f64 = 10.0;

/// How a chain is reckoned in a band.
enum Form {
    /// Not at all: nobody hears it.
    Silent,
    /// By the uniform theory: where it is feeble, or asked for as the second opinion.
    Rays(ChainRays),
    /// By the exact fields of both edges.
    Field(Box<ChainField>),
}

/// Two parallel edges in the plane across them.
struct Two<'a> {
    edges: [&'a Edge; 2],
    corners: [Corner; 2],
    common_face: bool,
    origin: DVec3,
    x: DVec3,
    y: DVec3,
    along: DVec3,
}

impl<'a> Two<'a> {
    /// `None` where sound cannot pass from one edge to the other: they are not parallel, belong to one thin wall, or
    /// one lies behind the other's faces.
    fn new(first: &'a Edge, second: &'a Edge) -> Option<Self> {
        let thin = |e: &Edge| e.planes[0] == e.planes[1];
        if first.direction.dot(second.direction).abs() < 1.0 - 1e-9 {
            return None;
        }
        let (x, y, along) = (first.face_a, first.normal_a, first.direction);
        let flat = |v: DVec3| DVec2::new(v.dot(x), v.dot(y));
        let corners = [first, second].map(|e| Corner {
            at: flat(e.start - first.start),
            face_a: flat(e.face_a),
            normal_a: flat(e.normal_a),
            exterior_angle: e.exterior_angle,
        });
        let way = corners[1].at - corners[0].at;
        if way.length() < 1e-6 || !corners[0].has_air(way) || !corners[1].has_air(-way) {
            return None;
        }
        let on_face = |corner: &Corner, way: DVec2| {
            let phi = corner.angle(way);
            phi < ON_FACE || corner.exterior_angle - phi < ON_FACE
        };
        let faces = [on_face(&corners[0], way), on_face(&corners[1], -way)];
        // The other border of a thin wall lies on both of its faces: the sound has passed the wall at the first one.
        if [(first, faces[0]), (second, faces[1])].iter().any(|(edge, on)| thin(edge) && *on) {
            return None;
        }
        let common_face = faces[0] && faces[1];
        Some(Self { edges: [first, second], corners, common_face, origin: first.start, x, y, along })
    }

    fn flat(&self, point: DVec3) -> DVec2 {
        self.turned(point - self.origin)
    }

    fn turned(&self, direction: DVec3) -> DVec2 {
        DVec2::new(direction.dot(self.x), direction.dot(self.y))
    }

    fn along_m(&self, point: DVec3) -> f64 {
        (point - self.origin).dot(self.along)
    }

    fn chain(&self, origin: Origin, kind: &SourceKind, receiver: DVec3) -> Option<Chain> {
        let from = match (origin, kind) {
            (Origin::At(position), SourceKind::Line(axis)) => {
                (axis.dot(self.along).abs() > 1.0 - 1e-9).then(|| From::Line(self.flat(position)))?
            }
            (Origin::At(position), _) => {
                From::Point(self.flat(position), self.along_m(receiver) - self.along_m(position))
            }
            (Origin::Along { direction, .. }, _) => {
                let across = self.turned(direction);
                (across.length() > 1e-3).then(|| From::Plane(across.normalize(), across.length()))?
            }
        };
        let chain = Chain { from, corners: self.corners, common_face: self.common_face, to: self.flat(receiver) };
        let towards = match from {
            From::Line(s) | From::Point(s, _) => s - self.corners[0].at,
            From::Plane(d, _) => -d,
        };
        let away = chain.to - self.corners[1].at;
        let near = towards.length().min(away.length());
        (near > 1e-9 && self.corners[0].has_air(towards) && self.corners[1].has_air(away)).then_some(chain)
    }

    /// Places along the edges at which the shortest way passes them, in m.
    fn places_m(&self, chain: &Chain, origin: Origin, receiver: DVec3) -> [f64; 2] {
        let [before, between, behind] = chain.legs_m();
        let end = self.along_m(receiver);
        let slope = match (chain.from, origin) {
            (From::Point(_, dz_m), _) => dz_m / (before + between + behind),
            (From::Plane(_, sin_beta), Origin::Along { direction, .. }) => direction.dot(self.along) / sin_beta,
            _ => 0.0,
        };
        [end - (between + behind) * slope, end - behind * slope]
    }

    /// The point of an edge at `along_m`, just outside it, in the middle of the air.
    fn apex(&self, edge: usize, along_m: f64) -> DVec3 {
        let out = self.corners[edge].outwards();
        let at = self.corners[edge].at + out * (1e-6 * (1.0 + self.corners[edge].at.length()));
        self.origin + self.along * along_m + self.x * at.x + self.y * at.y
    }
}

/// Adds the paths over two edges, and what an edge in sight changes of the paths over the other, to `paths`.
///
/// Where pressures are asked for, the same as pressures to `waves`.
pub(super) fn add<'a>(pair: &Pair<'a>, paths: &mut Vec<Specular>, waves: &mut Vec<Wave<'a>>) {
    let &Pair { scene, kind, source, probe, order, edges, reached, .. } = pair;
    if scene.simulation.diffraction_order < 2
        || matches!(scene.simulation.transport, Transport::Geometric | Transport::Paraxial)
    {
        return;
    }
    // Of each edge the images of source and probe that reach it.
    let images = |reached: &Reached| {
        let mut of_edge = vec![Vec::new(); edges.len()];
        for (image, met) in reached.iter().enumerate() {
            met.iter().for_each(|(edge, _)| of_edge[*edge].push(image));
        }
        of_edge
    };
    let [sources, probes] = reached.map(images);
    for (i, (first, _)) in edges.iter().enumerate() {
        for (j, (second, _)) in edges.iter().enumerate().filter(|(j, _)| *j != i) {
            let Some(two) = Two::new(first, second) else { continue };
            for &s in &sources[i] {
                let from = &source.images[s];
                for &p in &probes[j] {
                    let to = &probe.images[p];
                    if from.planes.len() + to.planes.len() > order {
                        continue;
                    }
                    let Origin::At(receiver) = to.origin else { continue };
                    if let Some(chain) = two.chain(from.origin, kind, receiver) {
                        let over = Over { pair, two: &two, chain, images: [s, p], receiver };
                        over.add(paths, waves);
                    }
                }
            }
        }
    }
}

/// Intensity of the strongest path in the lowest band.
fn strongest(paths: &[Specular]) -> f64 {
    paths.iter().filter_map(|path| path.path.intensity.first()).fold(0.0, |a, b| a.max(*b))
}

/// One chain between one source image and one probe image.
struct Over<'a> {
    pair: &'a Pair<'a>,
    two: &'a Two<'a>,
    chain: Chain,
    images: [usize; 2],
    receiver: DVec3,
}

impl Over<'_> {
    fn add<'w>(&self, paths: &mut Vec<Specular>, waves: &mut Vec<Wave<'w>>) -> Option<()> {
        let &Pair { scene, geometry, spectra, kind, source, probe, .. } = self.pair;
        let (two, chain, [s, p]) = (self.two, &self.chain, self.images);
        let passage = chain.passage();
        let speed = scene.air.speed_of_sound_m_s;
        let fresnel = |f: f64| 2.0 * chain.detour_m() * f / speed;
        if passage == Passage::Lit || fresnel(spectra.first()?.low_hz) > FELT_FRESNEL {
            return None;
        }
        let origin = source.images[s].origin;
        let places = two.places_m(chain, origin, self.receiver);
        let within = |edge: usize| {
            let start = two.along_m(two.edges[edge].start);
            let end = two.along_m(two.edges[edge].point(two.edges[edge].length_m));
            (start.min(end)..=start.max(end)).contains(&places[edge])
        };
        if *kind == SourceKind::Point && !(within(0) && within(1)) {
            return None;
        }
        // Over long ways only low bands may bring anything; where an edge is in sight all are looked at.
        let loudness = match passage {
            Passage::Shadow => self.loudness(paths)?,
            _ => vec![f64::INFINITY; spectra.len()],
        };
        let apexes = [two.apex(0, places[0]), two.apex(1, places[1])];
        if geometry.blocked(apexes[0], apexes[1], Skip::NONE, Skip::NONE) {
            return None;
        }
        let before = source.arrive(scene, geometry, s, apexes[0], Skip::NONE)?;
        let after = probe.arrive(scene, geometry, p, apexes[1], Skip::NONE)?;
        // Where an edge is passed in sight, the path over the other edge is changed, or the direct one beyond that edge's shadow.
        let single = two.edges[usize::from(passage == Passage::FirstLit)];
        let changed = match passage {
            Passage::Shadow => None,
            _ => {
                let label = self.label(&[single]);
                let planes = || source.images[s].planes.iter().chain(probe.images[p].planes.iter().rev());
                let direct = |path: &Specular| !path.bent && path.planes.iter().eq(planes());
                let found = paths.iter().position(|path| path.path.label == label);
                // An edge that the other end sees is in the direct sound already.
                let seen = || match passage {
                    Passage::FirstLit => probe.arrive(scene, geometry, p, apexes[0], Skip::NONE).is_some(),
                    _ => source.arrive(scene, geometry, s, apexes[1], Skip::NONE).is_some(),
                };
                let changed = found.or_else(|| paths.iter().position(direct).filter(|_| !seen()))?;
                if *paths[changed].path.intensity.first()? < FAINT * strongest(paths) {
                    return None;
                }
                Some(changed)
            }
        };
        let factors: Vec<f64> = before.factors.iter().zip(&after.factors).map(|(a, b)| a * b).collect();
        let (pressures, utd) = (scene.adds_pressures(), scene.simulation.transport == Transport::Utd);
        let mut forms = Vec::with_capacity(spectra.len());
        if let Some(changed) = changed.filter(|_| !utd) {
            for (band, spectrum) in spectra.iter().enumerate() {
                // Short waves do not feel an edge in sight that long ones do.
                let fade = |detour_m: f64| {
                    let fresnel = 2.0 * detour_m * spectrum.low_hz / speed;
                    let t = (fresnel / FELT_FRESNEL * 2.0 - 1.0).clamp(0.0, 1.0);
                    1.0 - t * t * (3.0 - 2.0 * t)
                };
                let beyond_m = if paths[changed].bent { 0.0 } else { chain.beyond_m() };
                let felt = fade(chain.detour_m()) * fade(beyond_m);
                let field = if felt > 0.0 || pressures { ChainField::new(*chain, spectrum) } else { None };
                if felt > 0.0
                    && let Some(change) = field.as_ref().and_then(|field| field.change(spectrum))
                {
                    paths[changed].path.intensity[band] *= 1.0 + felt * (change - 1.0);
                }
                forms.push(field.map_or(Form::Silent, |field| Form::Field(Box::new(field))));
            }
            if pressures {
                waves.push(self.wave(&factors, forms));
            }
            return Some(());
        }
        if passage != Passage::Shadow {
            return None;
        }
        let length_m = self.over_m();
        let mut intensity = Vec::with_capacity(spectra.len());
        for (band, spectrum) in spectra.iter().enumerate() {
            let form = match loudness[band] {
                loudness if loudness < 1.0 => Form::Silent,
                loudness if loudness < FEEBLE || utd => Form::Rays(ChainRays::new(chain)),
                _ => Form::Field(Box::new(ChainField::new(*chain, spectrum)?)),
            };
            let mean = match &form {
                Form::Silent => 0.0,
                Form::Rays(rays) => rays.mean(spectrum),
                Form::Field(field) => field.mean(spectrum),
            };
            let air = (-scene.air.attenuation_per_m[band] * length_m).exp();
            intensity.push(mean * factors[band] * air);
            forms.push(form);
            if band == 0 && loudness[0] >= 1.0 && intensity[0] < FAINT * strongest(paths) && !pressures {
                return None;
            }
        }
        if pressures {
            waves.push(self.wave(&factors, forms));
        }
        if loudness[0] >= 1.0 && intensity[0] < FAINT * strongest(paths) {
            return None;
        }
        let planes = |image: &super::images::Image| image.planes.clone();
        let mut passed = planes(&source.images[s]);
        passed.extend(planes(&probe.images[p]).into_iter().rev());
        let error = intensity.iter().map(|i| ACCURACY * i).collect();
        let path = EarlyPath {
            course: Vec::new(),
            label: self.label(&two.edges),
            reflections: passed.len(),
            from: probe.heard_from(geometry, p, apexes[1]),
            delay_s: length_m / speed,
            intensity,
            error,
        };
        paths.push(Specular { planes: passed, bent: true, path });
        Some(())
    }

    /// By how much the sound behind both edges changes each band at most, in units of what nobody hears; `None`: in no band by more.
    fn loudness(&self, paths: &[Specular]) -> Option<Vec<f64>> {
        let spectra = self.pair.spectra;
        let free = self.free();
        if self.chain.bound(spectra.first()?.low_k()) * free < FAINT * strongest(paths) {
            return None;
        }
        let heard = Heard::new(self.pair, paths);
        let loudness = |(band, spectrum): (usize, &Spectrum)| {
            let bound = (self.chain.bound(spectrum.low_k()) * free).sqrt();
            heard.loudness(band, spectrum, self.over_m(), bound)
        };
        let loudness: Vec<f64> = spectra.iter().enumerate().map(loudness).collect();
        // Beside silence loudness is no number, and everything is heard.
        let unheard = loudness.iter().all(|loudness| *loudness < 1.0);
        (!unheard).then_some(loudness)
    }

    /// Length in m of the shortest way over both edges.
    fn over_m(&self) -> f64 {
        let across_m: f64 = self.chain.legs_m().iter().sum();
        match self.chain.from {
            From::Line(_) => across_m,
            From::Point(_, dz_m) => across_m.hypot(dz_m),
            From::Plane(_, sin_beta) => self.ahead_m() + across_m * sin_beta,
        }
    }

    /// Way in m of a plane wave to the first edge, at the receiver's place along it; 0 of other sources.
    fn ahead_m(&self) -> f64 {
        let &Two { origin, along, .. } = self.two;
        match self.pair.source.images[self.images[0]].origin {
            wave @ Origin::Along { .. } => wave.length_m(origin + along * self.two.along_m(self.receiver)),
            Origin::At(_) => 0.0,
        }
    }

    /// Intensity of the free field over that way.
    fn free(&self) -> f64 {
        match self.chain.from {
            From::Line(_) => 1.0 / self.over_m(),
            From::Point(..) => self.over_m().powi(-2),
            From::Plane(..) => 1.0,
        }
    }

    /// The sound over both edges as a pressure; where one of them is passed in sight, what it changes of that over the other.
    fn wave<'w>(&self, factors: &[f64], forms: Vec<Form>) -> Wave<'w> {
        let scene = self.pair.scene;
        // A plane wave's field counts its phase from the first edge on, across the edges.
        let (length_m, ahead_m) = (self.over_m(), self.ahead_m());
        let air = |m: f64| (-m * length_m).exp();
        let attenuation = &scene.air.attenuation_per_m;
        let amplitudes: Vec<f64> = factors.iter().zip(attenuation).map(|(f, m)| (f * air(*m)).sqrt()).collect();
        let shadow = self.chain.passage() == Passage::Shadow;
        Wave {
            length_m,
            wander_m: self.chain.detour_m(),
            sound: Sound::at(move |band, k| {
                let pressure = match &forms[band] {
                    Form::Silent => return Complex64::ZERO,
                    Form::Rays(rays) => rays.pressure(k),
                    Form::Field(field) if shadow => field.pressure(k),
                    Form::Field(field) => field.correction(k).unwrap_or_default(),
                };
                pressure * Complex64::from_polar(amplitudes[band], k * ahead_m)
            }),
        }
    }

    fn label(&self, edges: &[&Edge]) -> String {
        let &Pair { geometry, source, probe, .. } = self.pair;
        let name = |plane: &usize| super::plane_name(geometry, *plane);
        let before = source.images[self.images[0]].planes.iter().map(name);
        let after = probe.images[self.images[1]].planes.iter().rev().map(name);
        let edges = edges.iter().map(|edge| edge.name.clone());
        before.chain(edges).chain(after).collect::<Vec<_>>().join(", ")
    }
}
