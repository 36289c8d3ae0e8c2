//! What is computed once a scene for the openings of one plane, and what of it once a source.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock, PoisonError, RwLock};

use super::crossing::{Crossing, Incident, Spectrum};
use super::mask::Mask;
use super::multipole::{Lit, nearness};
use super::slit::BandApertures;
use super::timed::{Cost, Timed};

/// The exact apertures of infinitely long openings in every band, and the fields that sources make leave them: each is made
/// when it is first needed and then serves all pairs.
pub struct SlitTables {
    mask: Mask,
    thickness_m: f64,
    bands: Vec<(Spectrum, Timed<BandApertures>)>,
    sources: RwLock<HashMap<[u64; 4], Arc<LitBands>>>,
}

/// What one source makes leave the openings, band by band; `None` where it is too near to them.
pub struct LitBands {
    bands: Vec<OnceLock<Option<Lit>>>,
    /// How near the receivers are that it is for.
    reach: usize,
}

/// One band's apertures, and one source's field behind them.
#[derive(Clone, Copy)]
pub struct Solved<'a> {
    /// The apertures.
    pub apertures: &'a BandApertures,
    /// What leaves them.
    pub lit: Option<&'a Lit>,
}

impl SlitTables {
    /// For the openings of `mask` in a wall of `thickness_m`.
    pub fn new(mask: Mask, thickness_m: f64, spectra: &[Spectrum]) -> Self {
        let bands = spectra.iter().map(|s| (*s, Timed::default())).collect();
        Self { mask, thickness_m, bands, sources: RwLock::default() }
    }

    /// The openings.
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// Thickness of the wall in m.
    pub fn thickness_m(&self) -> f64 {
        self.thickness_m
    }

    /// The field of the source of `crossing`, whose rays run across the edges, for its receiver and all that are not much
    /// nearer: to be computed band by band with [`band`](Self::band).
    pub fn source(&self, crossing: &Crossing) -> Arc<LitBands> {
        let reach = nearness(self.mask.openings(), self.thickness_m, (crossing.x_m, crossing.z_m));
        // A plane wave's s_y and a point source's place along the edges do not count: rays across the edges have none.
        let key = match crossing.incident {
            Incident::Line { x_m, z_m } | Incident::Point { x_m, z_m, .. } => {
                [0, reach as u64, x_m.to_bits(), z_m.to_bits()]
            }
            Incident::Plane { s_x, .. } => [1, reach as u64, s_x.to_bits(), 0],
        };
        let known = self.sources.read().unwrap_or_else(PoisonError::into_inner).get(&key).cloned();
        known.unwrap_or_else(|| {
            let mut sources = self.sources.write().unwrap_or_else(PoisonError::into_inner);
            let new = || LitBands { bands: self.bands.iter().map(|_| OnceLock::new()).collect(), reach };
            Arc::clone(sources.entry(key).or_insert_with(|| Arc::new(new())))
        })
    }

    /// Drops what belongs to sources; the apertures stay.
    pub fn forget_sources(&self) {
        self.sources.write().unwrap_or_else(PoisonError::into_inner).clear();
    }

    /// What has been solved so far.
    pub fn cost(&self) -> Cost {
        let made = || self.bands.iter().map(|(_, apertures)| apertures);
        let making = made().map(|apertures| Cost { frequencies: 0, seconds: apertures.seconds() });
        making.chain(made().filter_map(Timed::get).map(BandApertures::cost)).sum()
    }

    /// The apertures of a band and the field of `source` (at `incident`) behind them.
    pub fn band<'a>(&'a self, band: usize, source: &'a LitBands, incident: &Incident) -> Solved<'a> {
        let (spectrum, apertures) = &self.bands[band];
        let apertures = apertures.get_or_make(|| BandApertures::new(&self.mask, self.thickness_m, spectrum, 1.0));
        Solved {
            apertures,
            lit: source.bands[band].get_or_init(|| apertures.light_for(incident, source.reach)).as_ref(),
        }
    }
}
