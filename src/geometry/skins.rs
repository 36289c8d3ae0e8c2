//! Which sides of mesh facets belong together: a skin is what one can walk over without leaving the surface.
//!
//! Sound that reaches one place of a skin reaches all of it, unless a wall divides the air on the way. So a few places
//! tell for the thousands of edges of a fine mesh whether they lie in the air of the sources and probes.

use glam::DVec3;

use super::patches::root;

/// Where a half-plane leaves a border: `facet`, and the unit vector from the border into it.
pub(crate) struct Leaf {
    pub(crate) facet: usize,
    pub(crate) normal: DVec3,
    pub(crate) into: DVec3,
}

/// The sides of facets, each known by the facet and by whether it looks along the facet's normal.
pub(crate) struct Skins {
    parents: Vec<usize>,
}

impl Skins {
    /// Every side of `facets` facets for itself.
    pub(crate) fn new(facets: usize) -> Self {
        Self { parents: (0..2 * facets).collect() }
    }

    /// Joins what meets at a border along the unit vector `along`: the two sides of a single facet, or those of two facets
    /// that look into the same air. Where more meet nothing is joined.
    pub(crate) fn join(&mut self, along: DVec3, leaves: &[Leaf]) {
        // Turning about the border, the air after one facet is the air before the next.
        let turned = match leaves {
            [only] => [(side(only, along), side(only, -along)); 2],
            [a, b] => [(side(a, along), side(b, -along)), (side(a, -along), side(b, along))],
            _ => return,
        };
        for (a, b) in turned {
            let (a, b) = (root(&mut self.parents, a), root(&mut self.parents, b));
            self.parents[a.max(b)] = a.min(b);
        }
    }

    /// The skin of the side of a facet that is met on turning about `along`, away from it.
    pub(crate) fn of(&self, leaf: &Leaf, along: DVec3) -> usize {
        let mut i = side(leaf, along);
        while self.parents[i] != i {
            i = self.parents[i];
        }
        i
    }
}

fn side(leaf: &Leaf, along: DVec3) -> usize {
    2 * leaf.facet + usize::from(leaf.normal.dot(along.cross(leaf.into)) > 0.0)
}
