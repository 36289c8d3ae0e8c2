//! Unbounded walls: whole planes, met analytically.

use glam::DVec3;

use super::Surface;
use crate::scene::Frame;

/// A rectangle of a screen that is not the screen: portal, leaf or plain hole. Limits may be infinite.
#[derive(Debug, Clone)]
pub(crate) struct Region {
    /// Frame of the opening, origin relative to the scene's centre.
    pub(crate) frame: Frame,
    /// Limits along local x in m.
    pub(crate) x_m: [f64; 2],
    /// Limits along local y in m.
    pub(crate) y_m: [f64; 2],
    /// What stands there; `None`: nothing.
    pub(crate) element: Option<u32>,
    /// Group of the opening's host.
    pub(crate) group: usize,
}

/// An unbounded wall's face; coordinates relative to the scene's centre.
#[derive(Debug, Clone)]
pub(crate) struct Screen {
    normal: DVec3,
    distance: f64,
    element: u32,
    /// Plane id.
    pub(crate) plane: usize,
    /// Group id.
    pub(crate) group: usize,
    /// In order of precedence.
    pub(crate) regions: Vec<Region>,
}

impl Screen {
    pub(crate) fn new(surface: &Surface, index: usize, centre: DVec3) -> Self {
        Self {
            normal: surface.frame.normal,
            distance: surface.frame.normal.dot(surface.frame.origin_m - centre),
            element: index as u32,
            plane: surface.plane,
            group: surface.group,
            regions: Vec::new(),
        }
    }

    /// Distance along the ray, element and group; `None` if it runs parallel or passes through a hole.
    pub(crate) fn meet(&self, origin: DVec3, direction: DVec3) -> Option<(f64, u32, usize)> {
        let t = (self.distance - self.normal.dot(origin)) / self.normal.dot(direction);
        if !t.is_finite() {
            return None;
        }
        let (element, group) = self.part(origin + direction * t)?;
        Some((t, element, group))
    }

    /// The element at a point of the plane; `None` in a hole.
    pub(crate) fn element(&self, p: DVec3) -> Option<u32> {
        self.part(p).map(|(element, _)| element)
    }

    fn part(&self, p: DVec3) -> Option<(u32, usize)> {
        for region in &self.regions {
            let q = region.frame.local(p);
            let within = |v: f64, [low, high]: [f64; 2]| match region.element {
                Some(_) => v >= low && v <= high,
                None => v > low && v < high, // the border of a plain hole belongs to the screen
            };
            if within(q.x, region.x_m) && within(q.y, region.y_m) {
                return region.element.map(|e| (e, region.group));
            }
        }
        Some((self.element, self.group))
    }

    /// Whether the ray runs against the normal.
    pub(crate) fn faces(&self, direction: DVec3) -> bool {
        self.normal.dot(direction) < 0.0
    }

    /// Distance in m of a point (relative to the scene's centre) from the screen's plane.
    pub(crate) fn distance(&self, p: DVec3) -> f64 {
        (self.normal.dot(p) - self.distance).abs()
    }
}
