//! Volume, surface and mean absorption of the room round a point, from diffuse walks.
//!
//! Stops of a diffuse walk in a closed room are spread evenly over its surface, and the mean length between stops is
//! 4 V / S (Kosten 1960), whatever the shape. The stops per square metre of the densest surfaces, which lie wholly in
//! the room, give the surface S behind all stops, parts hidden by partitions left out; the mean length gives V. If
//! every surface met lies wholly in the room and they close, both are exact: S is their sum and V follows from the
//! divergence theorem.

use std::collections::BTreeMap;

use glam::DVec3;

use super::Geometry;
use super::walk::{Walk, spread};
use crate::scene::Material;

/// The air round a point, everything behind open portals included.
#[derive(Debug, Clone, PartialEq)]
pub struct Enclosure {
    /// Volume in m^3.
    pub volume_m3: f64,
    /// Surface in m^2, openings to the outside included.
    pub area_m2: f64,
    /// Mean absorption by area, one a band; openings to the outside absorb all.
    pub absorption: Vec<f64>,
    /// Share of the surface that is open to the outside, 0..=1.
    pub open_share: f64,
    /// Whether volume and surface are exact rather than estimates (about 1 %).
    pub exact: bool,
}

const WALKS: usize = 96;
/// Flights of each walk; in a long or divided room it takes tens of them to get round.
const FLIGHTS: usize = 720;
/// Flights before a walk has forgotten where it started.
const FIRST_FLIGHTS: usize = 80;
/// With a larger share of escaping rays a scene is open air.
const MOST_OPEN: f64 = 0.25;
/// Surfaces with fewer stops say nothing about the density.
const FEWEST: f64 = 100.0;

/// One side of a surface.
struct Side {
    stops: f64,
    area_m2: f64,
    /// Unit normal into the room.
    normal: DVec3,
    /// Height over the surface in m of the point asked for.
    height_m: f64,
}

impl Geometry {
    /// The room round `point` (m); `None` in the open (a quarter or more of the rays escape) or if nothing is met.
    ///
    /// `materials`: those of the scene. Deterministic: the same point gives the same answer.
    pub fn enclosure(&self, point: DVec3, materials: &[Material]) -> Option<Enclosure> {
        let mut stops: BTreeMap<(usize, bool), f64> = BTreeMap::new();
        let (mut total, mut escaped, mut length_m) = (0.0, 0.0, 0.0);
        for i in 0..WALKS {
            let mut walk = Walk::new(self, point, spread(i, WALKS), i);
            for n in 0..FLIGHTS {
                let stop = walk.next();
                if n < FIRST_FLIGHTS {
                    if stop.is_none() {
                        walk.turn_back();
                    }
                    continue;
                }
                match stop {
                    Some(stop) => {
                        total += 1.0;
                        length_m += stop.chord_m;
                        *stops.entry((stop.surface, stop.in_front)).or_default() += 1.0;
                    }
                    None => {
                        escaped += 1.0;
                        walk.turn_back();
                    }
                }
            }
        }
        let open_share = escaped / (total + escaped);
        if !(open_share < MOST_OPEN && total > 0.0) {
            return None;
        }
        let sides: Vec<Side> = stops
            .iter()
            .map(|(&(surface, in_front), &stops)| {
                let s = &self.surfaces[surface];
                let normal = if in_front { s.frame.normal } else { -s.frame.normal };
                let height_m = normal.dot(point - s.frame.origin_m);
                Side { stops, area_m2: s.area_m2, normal, height_m }
            })
            .collect();
        let (density, all_whole) = density(&sides)?;
        let closes = sides.iter().map(|s| s.normal * s.area_m2).sum::<DVec3>();
        let area: f64 = sides.iter().map(|s| s.area_m2).sum();
        let exact = all_whole && escaped == 0.0 && closes.length() < 1e-9 * area;
        let (volume_m3, area_m2) = if exact {
            (sides.iter().map(|s| s.area_m2 * s.height_m).sum::<f64>().abs() / 3.0, area)
        } else {
            let area = (total + escaped) / density;
            (area * length_m / total / 4.0, area)
        };
        let weights = stops.keys().zip(&sides).map(|(&(surface, _), side)| {
            let share = if exact { side.area_m2 / area } else { side.stops / (total + escaped) };
            (surface, share)
        });
        let bands = materials.iter().map(|m| m.absorption.len()).max().unwrap_or(0);
        let mut absorption = vec![if exact { 0.0 } else { open_share }; bands];
        for (surface, share) in weights {
            if let Some(material) = materials.get(self.surfaces[surface].material) {
                absorption.iter_mut().zip(&material.absorption).for_each(|(mean, a)| *mean += share * a);
            }
        }
        Some(Enclosure { volume_m3, area_m2, absorption, open_share, exact })
    }
}

/// Stops per m^2 on surfaces that lie wholly in the room, and whether all do.
fn density(sides: &[Side]) -> Option<(f64, bool)> {
    let ratio = |s: &Side| s.stops / s.area_m2;
    // within four standard errors, both of the surface and of the one it is compared with
    let error = |s: &Side| 4.0 / s.stops.sqrt();
    let enough = sides.iter().map(|s| s.stops).fold(0.0, f64::max).min(FEWEST);
    let densest = sides.iter().filter(|s| s.stops >= enough).max_by(|a, b| {
        let lower = |s: &Side| ratio(s) * (1.0 - error(s));
        lower(a).total_cmp(&lower(b))
    })?;
    let is_whole = |s: &&Side| ratio(s) >= ratio(densest) * (1.0 - error(densest) - error(s));
    let (stops, area) = sides.iter().filter(is_whole).fold((0.0, 0.0), |(n, a), s| (n + s.stops, a + s.area_m2));
    let density = stops / area;
    (density > 0.0 && density.is_finite()).then(|| (density, sides.iter().filter(is_whole).count() == sides.len()))
}
