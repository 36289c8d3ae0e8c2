//! One ray from the source to its end, with everything it sends to the probes on its way.
//!
//! What reaches a probe is partitioned by the last event before it, so that nothing counts twice:
//! * a diffuse reflection: rain from the hit point to the probe (next-event estimation), never the sphere;
//! * a specular reflection, a passage through a wall or a portal: the receiver sphere collects the flight;
//! * except after a portal with a broad lobe, where the crossing itself sends its signed density to the probe.
//!
//! Histories that deterministic paths cover (all reflections specular, no more of them and of portals than those paths
//! have) are followed but not recorded.

use glam::DVec3;

use super::Scattering;
use super::lanes::{Lanes, add, lanes, mean, multiply, peak};
use super::ledger::Account;
use super::portal::Captured;
use super::random::Stream;
use super::ray::{Last, Ray};
use super::receiver::Chord;
use super::stage::Stage;
use super::tally::Tally;
use crate::geometry::{Element, Hit, Skip};
use crate::scene::Source;
use crate::wbsdf::scatter::Form;

/// After this many split-off rays the inclination of a history to split has halved: bounds the tree.
const SPLIT_BUDGET: f64 = 16.0;

/// Rays into which one of full strength is split when it first passes a portal.
const PORTAL_PARTS: f64 = 6.0;

/// A ray whose weight crossings have raised far above that with which its branch began goes on as several, each of at least this
/// many times that weight.
const HEADROOM: f32 = 2.0;

/// Most copies that a ray whose weight has grown in a crossing is split into at once.
const MOST_COPIES: f32 = 64.0;

/// Hits after which a ray books what it has lost: single precision would not add more than that.
const SETTLED_HITS: u32 = 256;

/// Hits after which a ray that makes no headway (wedged between two surfaces) is ended.
const MAX_HITS: u32 = 200_000;

/// `before` - `after`.
#[inline]
fn difference<const N: usize>(before: &Lanes<N>, after: &Lanes<N>) -> Lanes<N> {
    let mut out = *before;
    for (out, after) in out.iter_mut().zip(after) {
        *out -= after;
    }
    out
}

/// A passage of a portal.
struct Through {
    portal: usize,
    form: Form,
    /// Place in the portal's frame.
    at_m: (f64, f64),
    /// Local direction of incidence.
    s_i: DVec3,
}

/// Follows one ray of `source` and all rays split off from it. `pending` is scratch memory.
///
/// Russian roulette keeps the number of rays at `population` times the square root of the power they have left; at 3 this is full
/// strength to -10 dB, one in twenty at -35 dB, one in 300 at -60 dB. Levels come from the strong rays, decay times need
/// some weak ones; the square root is the optimum between a number that follows the power (levels alone) and a constant one.
pub(super) fn trace_ray<S: Scattering, const N: usize>(
    stage: &Stage<'_, S, N>,
    source: &Source,
    population: f32,
    stream: &mut Stream,
    pending: &mut Vec<Ray<N>>,
    tally: &mut Tally<N>,
) {
    let direction = stream.isotropic();
    let power = source.directivity.intensity(direction);
    let weights = lanes(std::iter::repeat_n(power, stage.bands));
    tally.accounts.book(Account::Emitted, &weights);
    let mut walk = Walk { stage, population, stream, pending, tally, split: 0, absorbed: [0.0; N], air: [0.0; N] };
    walk.pending.clear();
    walk.pending.push(Ray::emitted(source.position_m, direction, weights, stage.bands));
    while let Some(ray) = walk.pending.pop() {
        walk.follow(ray);
    }
    walk.settle();
    walk.tally.end_ray();
}

/// One history in progress.
struct Walk<'w, 's, S, const N: usize> {
    stage: &'w Stage<'s, S, N>,
    population: f32,
    stream: &'w mut Stream,
    pending: &'w mut Vec<Ray<N>>,
    tally: &'w mut Tally<N>,
    /// Rays split off so far.
    split: u32,
    /// What surfaces and air have taken from this history and is not yet booked.
    absorbed: Lanes<N>,
    air: Lanes<N>,
}

impl<S: Scattering, const N: usize> Walk<'_, '_, S, N> {
    /// Follows one ray to its end.
    fn follow(&mut self, mut ray: Ray<N>) {
        loop {
            let left_m = self.stage.length_m - ray.length_m;
            if left_m <= 0.0 || ray.hits >= MAX_HITS {
                self.tally.accounts.book(Account::TimedOut, &ray.weights);
                return;
            }
            if !self.roulette(&mut ray) {
                return;
            }
            let found = self.stage.geometry.closest(ray.position, ray.direction, f64::INFINITY, ray.skip);
            let flight_m = found.as_ref().map_or(left_m, |hit| hit.t.min(left_m));
            self.collect(&ray, flight_m);
            // Borrowed: moving it out costs more than finding it in a small room.
            let Some(hit) = &found else {
                self.tally.accounts.book(Account::Escaped, &ray.weights);
                return;
            };
            self.fade(&mut ray, flight_m);
            if hit.t >= left_m {
                self.tally.accounts.book(Account::TimedOut, &ray.weights);
                return;
            }
            ray.length_m += hit.t;
            ray.hits += 1;
            self.tally.hits += 1;
            if ray.hits.is_multiple_of(SETTLED_HITS) {
                self.settle();
            }
            match hit.element {
                Element::Surface(surface) => self.reflect(&mut ray, surface, hit),
                Element::Portal(portal) => {
                    self.meet_portal(ray, portal, hit);
                    return;
                }
            }
        }
    }

    /// Books what surfaces and air have taken.
    fn settle(&mut self) {
        self.tally.accounts.book(Account::Absorbed, &std::mem::replace(&mut self.absorbed, [0.0; N]));
        self.tally.accounts.book(Account::Air, &std::mem::replace(&mut self.air, [0.0; N]));
    }

    /// A hit on an opening: a share passes, the rest is reflected. In a capture region the opening's own area counts like
    /// the wall around it.
    fn meet_portal(&mut self, ray: Ray<N>, portal: usize, hit: &Hit) {
        let stage = self.stage;
        let mut left = [1.0; N];
        for &captor in &stage.companions[portal] {
            multiply(&mut left, &self.capture(&ray, captor, hit));
        }
        let passage = &stage.passages[portal];
        let sign = ray.direction.dot(passage.frame.normal).signum();
        if !passage.is_captured(sign) {
            let (passes, scale) = self.passing(&ray, portal, 1.0);
            let local = passage.frame.local(hit.point);
            let mut through = ray;
            multiply(&mut through.weights, &scale);
            multiply(&mut left, &passes.map(|p| 1.0 - p));
            self.tally.accounts.book(Account::Portals, &through.weights);
            let strength = ray.strength();
            self.cross(through, portal, (local.x, local.y), strength, hit);
        }
        // The reflected rest; of a share near 0 only now and then.
        let probability = f64::from(peak(&left)).min(1.0);
        if probability > 0.0 && self.stream.uniform() < probability {
            let mut child = ray;
            multiply(&mut child.weights, &left.map(|l| l / probability as f32));
            let normal = passage.frame.normal;
            child.direction = (ray.direction - normal * (2.0 * ray.direction.dot(normal))).normalize();
            child.position = hit.point;
            child.skip = Skip::reflected(hit);
            child.last = Last::Specular;
            child.reflections += 1;
            self.tally.accounts.book(Account::Portals, &child.weights);
            self.pending.push(child);
        }
        self.tally.accounts.book_gain(Account::Portals, &ray.weights, &[0.0; N]);
    }

    /// The share of a ray's power that a portal passes from an area `1/ratio` times its own, at most all of it, and the
    /// factor that gives a crossing (whose mean gain is the opening's transmission) this share over `ratio`.
    fn passing(&self, ray: &Ray<N>, portal: usize, ratio: f64) -> (Lanes<N>, Lanes<N>) {
        let passage = &self.stage.passages[portal];
        let local = passage.frame.turn(ray.direction);
        let mut transmitted = [1.0; N];
        let s_i = DVec3::new(local.x, local.y, local.z.abs());
        self.stage.scatter[portal].transmitted(s_i, &mut transmitted[..self.stage.bands]);
        let ratio = ratio as f32;
        let mut scale = [1.0; N];
        scale.iter_mut().zip(passage.made_good(local.z)).for_each(|(scale, factor)| *scale = *factor);
        let mut passes = [0.0; N];
        for b in 0..N {
            let share = ratio * transmitted[b];
            passes[b] = (scale[b] * share).min(1.0);
            if scale[b] * share > 1.0 {
                scale[b] = 1.0 / share;
            }
        }
        (passes, scale)
    }

    /// Whether the history of a ray is one that deterministic paths count.
    fn is_covered(&self, diffuse: bool, reflections: u32, portals: u32) -> bool {
        !diffuse && reflections <= self.stage.reflection_order && portals <= self.stage.portal_order
    }

    /// Ends weak rays at random without bias. Returns false if the ray ended.
    fn roulette(&mut self, ray: &mut Ray<N>) -> bool {
        let largest = mean(&ray.weights);
        if largest == 0.0 {
            return false;
        }
        // kept <= 2 population sqrt(power) with the power largest * kept / reference.
        if ray.kept * ray.reference <= 4.0 * self.population * self.population * largest {
            return true;
        }
        let before = ray.weights;
        let survives = self.stream.uniform() < 0.5;
        let factor = if survives { 2.0 } else { 0.0 };
        ray.weights.iter_mut().for_each(|w| *w *= factor);
        ray.kept *= 0.5;
        self.tally.accounts.book_gain(Account::Resampling, &before, &ray.weights);
        survives
    }

    /// Air absorption along a flight.
    fn fade(&mut self, ray: &mut Ray<N>, flight_m: f64) {
        if let Some(air) = &self.stage.air {
            let before = ray.weights;
            multiply(&mut ray.weights, &air.factors(flight_m as f32));
            add(&mut self.air, &difference(&before, &ray.weights));
        }
    }

    /// The receiver spheres on a flight of `flight_m` from the ray's position.
    fn collect(&mut self, ray: &Ray<N>, flight_m: f64) {
        if ray.last == Last::Diffuse || self.is_covered(ray.diffuse, ray.reflections, ray.portals) {
            return;
        }
        for (probe, receiver) in self.stage.receivers.iter().enumerate() {
            // The lobe of a portal is collected by the narrow ball, for which it was judged.
            let come_m = if matches!(ray.last, Last::Portal(_)) { 0.0 } else { ray.length_m - ray.spread_m };
            let Some(chord) = receiver.chord(ray.position, ray.direction, flight_m, come_m) else { continue };
            let Chord { start, end, closest, ball } = chord;
            let middle = ray.at(0.5 * (start + end));
            if ball.may_be_cut && self.stage.geometry.blocked(receiver.position, middle, Skip::NONE, Skip::NONE) {
                continue;
            }
            let factor = ((end - start) * ball.scale) as f32;
            let mut received = ray.weights.map(|w| w * factor);
            if let Last::Portal(portal) = ray.last {
                multiply(&mut received, &receiver.sphere_bands[portal]);
            }
            self.receive(probe, ray.length_m, closest, received);
        }
    }

    /// Books what arrives at a probe after a last straight way of `r_m`, the air on it included.
    fn receive(&mut self, probe: usize, length_m: f64, r_m: f64, mut intensity: Lanes<N>) {
        if let Some(air) = &self.stage.air {
            multiply(&mut intensity, &air.factors(r_m as f32));
        }
        self.tally.receive(probe, (length_m + r_m) / self.stage.speed_m_s, &intensity);
    }

    /// A hit on a surface: capture, transmission, absorption, rain, and the new direction.
    fn reflect(&mut self, ray: &mut Ray<N>, surface: usize, hit: &Hit) {
        let stage = self.stage;
        let face = &stage.faces[surface];
        let along = ray.direction.dot(face.normal);
        let towards = if along > 0.0 { 1.0 } else { -1.0 };
        // The normal on the side the ray comes from.
        let normal = face.normal * -towards;

        let incoming = ray.weights;
        let mut left = [1.0; N];
        for &portal in &face.captures {
            multiply(&mut left, &self.capture(ray, portal, hit));
        }
        let material = &stage.materials[face.material];
        let side = usize::from(towards < 0.0);
        if let Some(transmission) = &material.transmission
            && face.beyond[side]
        {
            self.transmit(ray, transmission, face.normal * towards, face.through_m[side], hit);
        }

        multiply(&mut ray.weights, &material.reflected);
        add(&mut self.absorbed, &difference(&incoming, &ray.weights));
        if !face.captures.is_empty() {
            let before = ray.weights;
            multiply(&mut ray.weights, &left);
            self.tally.accounts.book_gain(Account::Portals, &before, &ray.weights);
        }

        if material.rain_probability > 0.0 && self.stream.uniform() < material.rain_probability {
            let skip = Skip::reflected(hit);
            for probe in 0..stage.receivers.len() {
                let to = stage.receivers[probe].position - hit.point;
                let height = to.dot(normal);
                if height <= 0.0 {
                    continue;
                }
                let r2 = to.length_squared();
                let r = r2.sqrt();
                if !self.tally.in_time((ray.length_m + r) / stage.speed_m_s) {
                    continue;
                }
                let factor = height / (r * r2);
                // Where there are many probes weak rain falls only now and then.
                let kept = (factor * stage.rain_m2).min(1.0);
                if kept < 1.0 && self.stream.uniform() >= kept {
                    continue;
                }
                if stage.geometry.blocked(hit.point, stage.receivers[probe].position, skip, Skip::NONE) {
                    continue;
                }
                let factor = (factor / kept) as f32;
                let mut rain = incoming.map(|w| w * factor);
                multiply(&mut rain, &material.rain);
                self.receive(probe, ray.length_m, r, rain);
            }
        }

        let mirrored = ray.direction - face.normal * (2.0 * along);
        // A unit vector but for rounding: one step of Newton's method towards the length 1.
        let mirrored = mirrored * (1.5 - 0.5 * mirrored.length_squared());
        let diffuse = match material.uniform_scattering {
            Some(s) if s <= 0.0 => false,
            Some(s) => s >= 1.0 || self.stream.uniform() < s,
            None if material.parts_bands && ray.reflections == 0 => {
                // Where the bands part for the first time, following both ways spares each the others' decision: at
                // scattering 0 to 0.9 the errors of four bands fall to 0.44-0.78 for 1.6 times the hits.
                let mut child = *ray;
                for (ray, share) in
                    [(&mut child, material.scattering.map(|s| 1.0 - s)), (&mut *ray, material.scattering)]
                {
                    multiply(&mut ray.ratio, &share);
                    multiply(&mut ray.weights, &share);
                }
                child.leave(hit, mirrored, false);
                self.pending.push(child);
                true
            }
            None => self.decide(ray, &material.scattering),
        };
        let direction = if diffuse { self.stream.lambert(normal) } else { mirrored };
        ray.leave(hit, direction, diffuse);
    }

    /// Specular or diffuse where the bands differ. All bands share one decision, drawn with the mean of their
    /// probabilities, each band weighing as much as this history is likely in it ([`Ray::ratio`]). A band's weight is then its
    /// own probability of the whole history over the mean of all bands' (the balance heuristic over bands), which
    /// never exceeds the number of bands; with a fixed mixing probability it would grow without bound along the ray.
    fn decide(&mut self, ray: &mut Ray<N>, scattering: &Lanes<N>) -> bool {
        let (mut diffuse_mass, mut mass) = (0.0f32, 0.0f32);
        for (ratio, s) in ray.ratio.iter().zip(scattering) {
            diffuse_mass += ratio * s;
            mass += ratio;
        }
        let probability = (diffuse_mass / mass).clamp(0.0, 1.0);
        let diffuse = self.stream.uniform() < f64::from(probability);
        let before = ray.weights;
        let factors = scattering.map(|s| if diffuse { s / probability } else { (1.0 - s) / (1.0 - probability) });
        multiply(&mut ray.ratio, &factors);
        multiply(&mut ray.weights, &factors);
        self.tally.accounts.book_gain(Account::Resampling, &before, &ray.weights);
        diffuse
    }

    /// Probability with which a ray that sends up to the share `strongest` of its power through the wall `group` is split:
    /// high while the ray is strong (the rays split off then have equal weights), never below what the power itself asks for.
    fn split_probability(&self, ray: &Ray<N>, group: usize, strongest: f64) -> f64 {
        let analog = strongest.clamp(0.0, 1.0);
        if ray.explores(group) { (ray.strength() * self.budget()).min(1.0).max(analog) } else { analog }
    }

    /// Inclination to split, 1 at first, less in a history that has split often.
    fn budget(&self) -> f64 {
        SPLIT_BUDGET / (SPLIT_BUDGET + f64::from(self.split))
    }

    /// The branch split off from `ray` with probability `probability`, its weights times `share` over it.
    fn branch(&mut self, ray: &Ray<N>, share: &Lanes<N>, probability: f64) -> Ray<N> {
        self.split += 1;
        let mut child = *ray;
        multiply(&mut child.weights, &share.map(|s| (f64::from(s) / probability) as f32));
        child
    }

    /// Sends a share of the ray through the wall, straight on. It goes on from the opposite face at the foot of the normal,
    /// so that a thick wall's rims play no part.
    fn transmit(&mut self, ray: &Ray<N>, transmission: &Lanes<N>, inward: DVec3, through_m: f64, hit: &Hit) {
        let probability = self.split_probability(ray, hit.group, f64::from(peak(transmission)));
        if self.stream.uniform() >= probability {
            return;
        }
        let mut child = self.branch(ray, transmission, probability);
        child.enter(hit.group);
        self.tally.accounts.book(Account::Transmitted, &child.weights);
        child.position = hit.point + inward * through_m;
        child.length_m += through_m;
        child.skip = Skip::passed(hit);
        child.last = Last::Through;
        self.pending.push(child);
    }

    /// Sends a share of a ray that hits the wall round a narrow opening through it. Returns the share that is left: 1
    /// outside the capture region.
    fn capture(&mut self, ray: &Ray<N>, portal: usize, hit: &Hit) -> Lanes<N> {
        let passage = &self.stage.passages[portal];
        let sign = ray.direction.dot(passage.frame.normal).signum();
        let Some(Captured { x_m, y_m, ratio }) = passage.captured(hit.point, sign) else { return [1.0; N] };
        let (passes, scale) = self.passing(ray, portal, ratio);
        let left = passes.map(|p| 1.0 - p);
        let probability = self.split_probability(ray, hit.group, f64::from(peak(&passes)));
        if self.stream.uniform() < probability {
            let child = self.branch(ray, &scale.map(|s| s * ratio as f32), probability);
            self.tally.accounts.book(Account::Portals, &child.weights);
            // The ray's strength is in the probability already.
            self.cross(child, portal, (x_m, y_m), 1.0, hit);
        }
        left
    }

    /// A crossing of the portal at local (x, y) in m: what it sends to the probes at once, and the rays that go on.
    ///
    /// On its first passage a ray of full `strength` goes on as several, each with its part of the power and of the random
    /// numbers (stratified): crossings are rare, and one direction has to serve all bands, whose lobes differ in width. Not
    /// on later passages: between live rooms joined by a wide opening the rays would breed without end.
    ///
    /// The rays leave from the far face at the same (x, y): a thick host's jambs play no part beyond what the scattering
    /// knows of them.
    fn cross(&mut self, mut ray: Ray<N>, portal: usize, (x_m, y_m): (f64, f64), strength: f64, hit: &Hit) {
        let stage = self.stage;
        let passage = &stage.passages[portal];
        let frame = &passage.frame;
        let sign = if ray.direction.dot(frame.normal) < 0.0 { -1.0 } else { 1.0 };
        let to_local = |d: DVec3| {
            let local = frame.turn(d);
            DVec3::new(local.x, local.y, local.z * sign)
        };
        let s_i = to_local(ray.direction);
        ray.position = frame.point(x_m, y_m) + frame.normal * (0.5 * sign * passage.thickness);
        ray.length_m += passage.thickness;
        ray.spread_m = ray.length_m;
        // A field that has only been reflected by mirrors so far still differs from place to place over the opening.
        let form = if ray.diffuse || ray.portals > 0 { Form::Marginal } else { Form::Signed };
        ray.portals += 1;
        ray.skip = Skip::passed(hit);

        if !self.is_covered(ray.diffuse, ray.reflections, ray.portals) {
            for probe in 0..stage.receivers.len() {
                if stage.receivers[probe].at_crossing[portal] {
                    let passage = Through { portal, form, at_m: (x_m, y_m), s_i };
                    self.rain_from_crossing(&ray, &passage, to_local, probe);
                }
            }
        }

        let parts = if ray.explores(hit.group) {
            (PORTAL_PARTS * strength * self.budget()).round().clamp(1.0, PORTAL_PARTS) as u32
        } else {
            1
        };
        self.split += parts - 1;
        ray.weights.iter_mut().for_each(|w| *w /= parts as f32);
        ray.enter(hit.group);
        for part in 0..parts {
            let mut child = ray;
            let u = [self.stream.uniform(), self.stream.uniform(), self.stream.uniform()];
            let u = [(f64::from(part) + u[0]) / f64::from(parts), u[1], u[2]];
            let out = stage.scatter[portal].sample(form, (x_m, y_m), s_i, u, &mut child.weights[..stage.bands]);
            let Some(out) = out else {
                self.tally.accounts.book_gain(Account::Portals, &ray.weights, &[0.0; N]);
                continue;
            };
            self.tally.accounts.book_gain(Account::Portals, &ray.weights, &child.weights);
            child.direction = (frame.x * out.x + frame.y * out.y + frame.normal * (out.z * sign)).normalize();
            child.last = Last::Portal(portal);
            // Crossing by crossing the weight of a few rays would grow without bound.
            let growth = mean(&child.weights) / child.reference;
            let copies = (growth / HEADROOM).floor().clamp(1.0, MOST_COPIES);
            child.weights.iter_mut().for_each(|w| *w /= copies);
            child.kept *= copies;
            self.pending.extend(std::iter::repeat_n(child, copies as usize));
        }
    }

    /// Next-event estimation from a crossing: 4 pi times power times density over r^2, in the bands with a broad lobe.
    fn rain_from_crossing(&mut self, ray: &Ray<N>, passage: &Through, to_local: impl Fn(DVec3) -> DVec3, probe: usize) {
        let stage = self.stage;
        let &Through { portal, form, at_m, s_i } = passage;
        let receiver = &stage.receivers[probe];
        let to = receiver.position - ray.position;
        let r2 = to.length_squared();
        let r = r2.sqrt();
        let s_o = to_local(to / r);
        if s_o.z <= 0.0
            || !self.tally.in_time((ray.length_m + r) / stage.speed_m_s)
            || stage.geometry.blocked(ray.position, receiver.position, ray.skip, Skip::NONE)
        {
            return;
        }
        let mut density = [0.0; N];
        stage.scatter[portal].density(form, at_m, s_i, s_o, &mut density[..stage.bands]);
        let factor = 4.0 * std::f64::consts::PI / r2;
        let mut received = density.map(|d| (d * factor) as f32);
        multiply(&mut received, &ray.weights);
        multiply(&mut received, &receiver.sphere_bands[portal].map(|sphere| 1.0 - sphere));
        self.receive(probe, ray.length_m, r, received);
    }
}
