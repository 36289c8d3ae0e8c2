//! What the probes have received so far: echograms, sums over rays and their squares.

use super::lanes::Lanes;
use super::ledger::Accounts;
use crate::probe::Echogram;

/// The receptions of a set of rays of one source at all probes.
#[derive(Clone)]
pub(super) struct Tally<const N: usize> {
    bins: usize,
    bins_per_s: f64,
    /// Echogram of each probe, `bins` entries each.
    echogram: Vec<[f64; N]>,
    /// First and one past the last bin in use, one pair a probe.
    used: Vec<(usize, usize)>,
    /// What the current ray has brought to each probe.
    current: Vec<[f64; N]>,
    /// Probes the current ray has reached.
    reached: Vec<usize>,
    /// Sums over rays, one a probe.
    pub(super) sum: Vec<[f64; N]>,
    /// Sums of squares over rays, one a probe.
    pub(super) square: Vec<[f64; N]>,
    /// Rays that reached the probe at all.
    pub(super) arrivals: Vec<u64>,
    /// Rays traced.
    pub(super) rays: u64,
    /// Hits on surfaces and portals.
    pub(super) hits: u64,
    /// Energy accounts.
    pub(super) accounts: Accounts<N>,
    /// Batches merged, and the squares of their sums; `None` in a tally that is a batch itself.
    batches: Option<Batches<N>>,
}

/// Squares over batches of equal size, which the standard errors of bins are made of: a batch is a chunk of rays, so that a ray
/// costs nothing a bin. The error of a level is made of the smallest batches there are: each ray with everything split off from it.
#[derive(Clone)]
struct Batches<const N: usize> {
    count: u64,
    /// Squares of the batches' bins, as the echogram.
    bins: Vec<[f64; N]>,
}

/// The variance of a bin is the mean over this many bins on either side too: few rays reach a bin of 1 ms, those that miss it
/// would leave it with too small an error, and the variance changes slowly. Bins of 200 runs of 2048 and 8192 rays in three
/// rooms: the truth lay within one error in 48 to 67 % by themselves, in 65 to 74 % so (where the error is below the bin's energy).
const NEIGHBOURS: usize = 3;

/// The standard error of the mean of `count` samples of the given sum and sum of squares.
fn standard_error(sum: f64, square: f64, count: u64) -> f64 {
    if count < 2 {
        return f64::INFINITY;
    }
    let n = count as f64;
    (((square - sum * sum / n) / (n - 1.0)).max(0.0) / n).sqrt()
}

/// Student's t for one standard deviation of `count` samples: what their standard error must be widened by to cover the truth as
/// often as that of a normal distribution, their variance being known from themselves alone.
///
/// Expansion in 1/(count - 1) (Abramowitz and Stegun 26.7.5 at x = 1): 2 % off for two samples, below 0.1 % from four on.
fn student(count: u64) -> f64 {
    let per_free = 1.0 / (count.max(2) - 1) as f64;
    1.0 + per_free * (0.5 + per_free * (0.25 + per_free * 0.0625))
}

impl<const N: usize> Tally<N> {
    /// A tally that others are merged into, as [`Self::new`].
    pub(super) fn of_batches(probes: usize, bins: usize, bin_s: f64) -> Self {
        let batches = Batches { count: 0, bins: vec![[0.0; N]; probes * bins] };
        Self { batches: Some(batches), ..Self::new(probes, bins, bin_s) }
    }

    pub(super) fn new(probes: usize, bins: usize, bin_s: f64) -> Self {
        Self {
            bins,
            bins_per_s: 1.0 / bin_s,
            echogram: vec![[0.0; N]; probes * bins],
            used: vec![(bins, 0); probes],
            current: vec![[0.0; N]; probes],
            reached: Vec::with_capacity(probes),
            sum: vec![[0.0; N]; probes],
            square: vec![[0.0; N]; probes],
            arrivals: vec![0; probes],
            rays: 0,
            hits: 0,
            accounts: Accounts::new(),
            batches: None,
        }
    }

    /// Memory of one chunk's tally in bytes.
    pub(super) fn bytes(probes: usize, bins: usize) -> usize {
        probes * bins * N * size_of::<f64>()
    }

    /// Back to nothing received; costs only the bins in use.
    pub(super) fn clear(&mut self) {
        for (probe, used) in self.used.iter_mut().enumerate() {
            let start = probe * self.bins;
            if used.0 < used.1 {
                self.echogram[start + used.0..start + used.1].fill([0.0; N]);
            }
            *used = (self.bins, 0);
        }
        self.current.fill([0.0; N]);
        self.reached.clear();
        self.sum.fill([0.0; N]);
        self.square.fill([0.0; N]);
        self.arrivals.fill(0);
        self.rays = 0;
        self.hits = 0;
        self.accounts = Accounts::new();
    }

    /// Whether something that arrives after `delay_s` still lies in the echogram.
    #[inline]
    pub(super) fn in_time(&self, delay_s: f64) -> bool {
        delay_s * self.bins_per_s < self.bins as f64
    }

    /// Books an arrival of the current ray; one that is too late for the echogram is ignored.
    #[inline]
    pub(super) fn receive(&mut self, probe: usize, delay_s: f64, intensity: &Lanes<N>) {
        let bin = (delay_s * self.bins_per_s) as usize;
        if bin >= self.bins {
            return;
        }
        let slot = &mut self.echogram[probe * self.bins + bin];
        let current = &mut self.current[probe];
        for b in 0..N {
            let i = f64::from(intensity[b]);
            slot[b] += i;
            current[b] += i;
        }
        let used = &mut self.used[probe];
        *used = (used.0.min(bin), used.1.max(bin + 1));
        if self.reached.last() != Some(&probe) && !self.reached.contains(&probe) {
            self.reached.push(probe);
        }
    }

    /// Closes the account of the current ray.
    pub(super) fn end_ray(&mut self) {
        self.rays += 1;
        for probe in self.reached.drain(..) {
            let current = &mut self.current[probe];
            let (sum, square) = (&mut self.sum[probe], &mut self.square[probe]);
            for b in 0..N {
                sum[b] += current[b];
                square[b] += current[b] * current[b];
            }
            *current = [0.0; N];
            self.arrivals[probe] += 1;
        }
    }

    /// Adds the receptions of another set of rays, one batch of as many rays as all others. The order of merging decides the
    /// last bits.
    pub(super) fn merge(&mut self, other: &Self) {
        if let Some(batches) = &mut self.batches {
            batches.count += 1;
        }
        for probe in 0..self.sum.len() {
            let (first, end) = other.used[probe];
            let start = probe * self.bins;
            for bin in start + first..start + end.max(first) {
                for b in 0..N {
                    self.echogram[bin][b] += other.echogram[bin][b];
                }
                if let Some(batches) = &mut self.batches {
                    for b in 0..N {
                        batches.bins[bin][b] += other.echogram[bin][b] * other.echogram[bin][b];
                    }
                }
            }
            let used = &mut self.used[probe];
            *used = (used.0.min(first), used.1.max(end));
            for b in 0..N {
                self.sum[probe][b] += other.sum[probe][b];
                self.square[probe][b] += other.square[probe][b];
            }
            self.arrivals[probe] += other.arrivals[probe];
        }
        self.rays += other.rays;
        self.hits += other.hits;
        self.accounts.merge(&other.accounts);
    }

    /// Mean over rays and its standard error, in one band of one probe. Each ray is one independent sample that carries the
    /// whole power of the source.
    pub(super) fn mean_and_error(&self, probe: usize, band: usize) -> (f64, f64) {
        if self.rays < 2 {
            return (0.0, f64::INFINITY);
        }
        let (n, sum) = (self.rays as f64, self.sum[probe][band]);
        (sum / n, standard_error(sum, self.square[probe][band], self.rays))
    }

    /// The echogram of one probe.
    pub(super) fn echogram(&self, probe: usize, bands: usize) -> Echogram {
        let n = self.rays.max(1) as f64;
        let range = probe * self.bins..(probe + 1) * self.bins;
        let bins = &self.echogram[range.clone()];
        let (first, end) = self.used[probe];
        let bin_error = self.batches.as_ref().map_or(Vec::new(), |batches| {
            let scale = student(batches.count) * batches.count as f64 / n;
            let squares = &batches.bins[range];
            let of = |b: usize| -> Vec<f64> {
                let variance: Vec<f64> = bins
                    .iter()
                    .zip(squares)
                    .map(|(sum, square)| (standard_error(sum[b], square[b], batches.count) * scale).powi(2))
                    .collect();
                let near = |i: usize| i.saturating_sub(NEIGHBOURS).max(first)..(i + NEIGHBOURS + 1).min(end);
                let mean = |around: &[f64]| around.iter().sum::<f64>() / around.len() as f64;
                (0..bins.len())
                    .map(|i| if (first..end).contains(&i) { mean(&variance[near(i)]).sqrt() } else { 0.0 })
                    .collect()
            };
            (0..bands).map(of).collect()
        });
        Echogram {
            bin_s: 1.0 / self.bins_per_s,
            energy: (0..bands).map(|b| bins.iter().map(|bin| bin[b] / n).collect()).collect(),
            bin_error,
            std_error: (0..bands).map(|b| self.mean_and_error(probe, b).1).collect(),
            reflections_per_s3: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three rays: 1 + 2 in two bins, nothing, -3.
    fn three_rays() -> Tally<8> {
        let mut tally = Tally::new(2, 10, 1e-3);
        tally.receive(1, 0.0015, &[1.0; 8]);
        tally.receive(1, 0.0031, &[2.0; 8]);
        tally.end_ray();
        tally.end_ray();
        tally.receive(1, 0.0031, &[-3.0; 8]);
        tally.receive(1, 0.0100, &[99.0; 8]);
        tally.end_ray();
        tally
    }

    #[test]
    fn the_error_is_that_of_the_mean_over_rays() {
        let tally = three_rays();
        // Samples 3, 0, -3: mean 0, sample variance 9, standard error sqrt(9/3).
        let (mean, error) = tally.mean_and_error(1, 0);
        assert!(mean.abs() < 1e-15 && (error - 3f64.sqrt()).abs() < 1e-12, "{mean} {error}");
        assert_eq!(tally.mean_and_error(0, 0), (0.0, 0.0));
        assert_eq!(tally.arrivals, [0, 2]);
    }

    #[test]
    fn late_arrivals_are_ignored_and_bins_hold_the_mean_over_rays() {
        let echogram = three_rays().echogram(1, 1);
        let expected = [0.0, 1.0 / 3.0, 0.0, -1.0 / 3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(echogram.energy[0].len(), 10);
        assert!(echogram.energy[0].iter().zip(expected).all(|(e, x)| (e - x).abs() < 1e-15), "{echogram:?}");
    }

    #[test]
    fn the_error_of_a_bin_comes_from_the_scatter_of_batches() {
        // 20 batches of one ray that bring 0, 1, 0, 1, ... to bin 5.
        let mut sum = Tally::<8>::of_batches(1, 10, 1e-3);
        for i in 0..20 {
            let mut batch = Tally::new(1, 10, 1e-3);
            batch.receive(0, 0.0055, &[(i % 2) as f32; 8]);
            batch.end_ray();
            sum.merge(&batch);
        }
        // Sample variance 5/19, standard error sqrt(5/19/20), Student's t for one standard deviation with 19 degrees of
        // freedom: 1.0270 (tables: 0.8413 quantile).
        let expected = (5.0f64 / 19.0 / 20.0).sqrt();
        let echogram = sum.echogram(0, 1);
        assert!((echogram.std_error[0] / expected - 1.0).abs() < 1e-9, "{}", echogram.std_error[0]);
        assert!((echogram.bin_error[0][5] / (1.0270 * expected) - 1.0).abs() < 1e-3, "{:?}", echogram.bin_error);
        assert!(echogram.bin_error[0].iter().enumerate().all(|(i, e)| i == 5 || *e == 0.0), "only one bin is in use");
    }

    #[test]
    fn merging_adds_and_clearing_forgets() {
        let mut sum = three_rays();
        let mut other = three_rays();
        sum.merge(&other);
        assert_eq!(sum.rays, 6);
        assert!((sum.echogram(1, 1).energy[0][1] - 1.0 / 3.0).abs() < 1e-15);
        other.clear();
        assert_eq!((other.rays, other.mean_and_error(1, 0).0), (0, 0.0));
        assert!(other.echogram(1, 1).energy[0].iter().all(|&e| e == 0.0));
    }
}
