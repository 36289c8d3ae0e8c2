//! A ray under way, and what it remembers of its history.

use glam::DVec3;

use super::lanes::{Lanes, lanes, mean};
use crate::geometry::{Hit, Skip};

/// Walls a ray remembers having passed. A second passage of the same wall (the way back) is sampled with its
/// true probability instead of being forced.
const REMEMBERED_GROUPS: usize = 4;

/// The last event of a ray.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Last {
    Emission,
    Specular,
    Diffuse,
    Through,
    /// Crossing of the portal with this index.
    Portal(usize),
}

/// A ray under way.
#[derive(Clone, Copy)]
pub(super) struct Ray<const N: usize> {
    pub(super) position: DVec3,
    pub(super) direction: DVec3,
    /// Way from the source in m.
    pub(super) length_m: f64,
    /// Length of it at the last portal in m, 0 before: from there the field spreads.
    pub(super) spread_m: f64,
    /// Signed power, one a band; an omnidirectional source gives 1.
    pub(super) weights: Lanes<N>,
    /// Probability of this history's specular/diffuse decisions in each band over the one they were drawn with; mean 1.
    pub(super) ratio: Lanes<N>,
    /// Mean weight at the start of this branch.
    pub(super) reference: f32,
    /// Probability with which the roulette has let this branch come so far, times the copies it was split into.
    pub(super) kept: f32,
    pub(super) skip: Skip,
    pub(super) last: Last,
    pub(super) reflections: u32,
    pub(super) portals: u32,
    pub(super) diffuse: bool,
    pub(super) hits: u32,
    passed: [usize; REMEMBERED_GROUPS],
    passed_count: usize,
}

impl<const N: usize> Ray<N> {
    /// A ray that leaves a source; `weights` of an omnidirectional one are 1 in each of the `bands`.
    pub(super) fn emitted(position: DVec3, direction: DVec3, weights: Lanes<N>, bands: usize) -> Self {
        Self {
            position,
            direction,
            length_m: 0.0,
            spread_m: 0.0,
            weights,
            ratio: lanes(std::iter::repeat_n(1.0, bands)),
            reference: bands as f32 / N as f32,
            kept: 1.0,
            skip: Skip::NONE,
            last: Last::Emission,
            reflections: 0,
            portals: 0,
            diffuse: false,
            hits: 0,
            passed: [usize::MAX; REMEMBERED_GROUPS],
            passed_count: 0,
        }
    }

    pub(super) fn at(&self, t: f64) -> DVec3 {
        self.position + self.direction * t
    }

    /// Whether the wall or portal `group` leads somewhere this history has not been.
    pub(super) fn explores(&self, group: usize) -> bool {
        self.passed_count < REMEMBERED_GROUPS && !self.passed[..self.passed_count].contains(&group)
    }

    /// Strength relative to the start of the branch.
    pub(super) fn strength(&self) -> f64 {
        f64::from(mean(&self.weights) / self.reference)
    }

    /// Goes on from a reflection.
    pub(super) fn leave(&mut self, hit: &Hit, direction: DVec3, diffuse: bool) {
        self.direction = direction;
        self.last = if diffuse { Last::Diffuse } else { Last::Specular };
        self.diffuse |= diffuse;
        self.reflections += 1;
        self.position = hit.point;
        self.skip = Skip::reflected(hit);
    }

    /// Begins a branch beyond the wall or portal `group`, unless it is known: it is followed as far below its own start as
    /// the ray it came from.
    pub(super) fn enter(&mut self, group: usize) {
        if self.explores(group) {
            self.passed[self.passed_count] = group;
            self.passed_count += 1;
            self.reference = mean(&self.weights).min(self.reference);
            self.kept = 1.0;
        }
    }
}
