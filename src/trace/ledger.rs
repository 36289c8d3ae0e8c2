//! The energy ledger: what the rays were given and where it went, so that nothing is lost unnoticed.

use super::lanes::Lanes;

/// Energy accounts of one source, one value a band, per emitted ray: an omnidirectional source emits 1.
///
/// Every change of a ray's weight is booked where it happens, so
/// emitted + transmitted + portals + resampling = absorbed + air + escaped + timed_out (see [`Ledger::imbalance`]) holds
/// to rounding, not to statistics.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct Ledger {
    /// Given to the rays at the source (mean directivity).
    pub emitted: Vec<f64>,
    /// Taken by surfaces: absorption, the transmitted share included.
    pub absorbed: Vec<f64>,
    /// Taken by the air.
    pub air: Vec<f64>,
    /// Carried out of the scene.
    pub escaped: Vec<f64>,
    /// Still under way when the echogram ended.
    pub timed_out: Vec<f64>,
    /// Given back to rays that pass through walls (transmission loss).
    pub transmitted: Vec<f64>,
    /// Net gain at portals: signed weights of the lobe, capture regions, evanescent rays. Zero on average where the
    /// portals conserve power and the field is homogeneous over the capture regions.
    pub portals: Vec<f64>,
    /// Net gain by random decisions (Russian roulette, specular or diffuse). Zero on average.
    pub resampling: Vec<f64>,
}

impl Ledger {
    /// Income minus expenditure in band `band`; zero to rounding.
    pub fn imbalance(&self, band: usize) -> f64 {
        self.emitted[band] + self.transmitted[band] + self.portals[band] + self.resampling[band]
            - self.absorbed[band]
            - self.air[band]
            - self.escaped[band]
            - self.timed_out[band]
    }
}

/// One account of the ledger, in the order of the fields of [`Ledger`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Account {
    Emitted,
    Absorbed,
    Air,
    Escaped,
    TimedOut,
    Transmitted,
    Portals,
    Resampling,
}

const ACCOUNTS: usize = 8;

/// The accounts while rays are traced: sums over rays, f64.
#[derive(Clone)]
pub(super) struct Accounts<const N: usize>([[f64; N]; ACCOUNTS]);

impl<const N: usize> Accounts<N> {
    pub(super) fn new() -> Self {
        Self([[0.0; N]; ACCOUNTS])
    }

    /// Books whole weights.
    #[inline]
    pub(super) fn book(&mut self, account: Account, weights: &Lanes<N>) {
        let slot = &mut self.0[account as usize];
        for b in 0..N {
            slot[b] += f64::from(weights[b]);
        }
    }

    /// Books the change of a ray's weights, `after` - `before`, as a gain.
    #[inline]
    pub(super) fn book_gain(&mut self, account: Account, before: &Lanes<N>, after: &Lanes<N>) {
        let slot = &mut self.0[account as usize];
        for b in 0..N {
            slot[b] += f64::from(after[b]) - f64::from(before[b]);
        }
    }

    /// Adds the sums of another part of the rays.
    pub(super) fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.0.iter_mut().zip(&other.0) {
            for b in 0..N {
                mine[b] += theirs[b];
            }
        }
    }

    /// The ledger per emitted ray.
    pub(super) fn ledger(&self, bands: usize, rays: u64) -> Ledger {
        let per_ray = |account: Account| {
            self.0[account as usize][..bands].iter().map(|sum| sum / rays.max(1) as f64).collect::<Vec<_>>()
        };
        Ledger {
            emitted: per_ray(Account::Emitted),
            absorbed: per_ray(Account::Absorbed),
            air: per_ray(Account::Air),
            escaped: per_ray(Account::Escaped),
            timed_out: per_ray(Account::TimedOut),
            transmitted: per_ray(Account::Transmitted),
            portals: per_ray(Account::Portals),
            resampling: per_ray(Account::Resampling),
        }
    }
}
