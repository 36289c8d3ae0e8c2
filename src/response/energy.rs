//! Energy over time in one band: early paths as impulses, the echogram as bins of constant power.

use crate::probe::Reception;

/// Removes negative bins without losing or adding energy.
///
/// A negative bin is sampling noise of signed rays. The smallest interval round it with a sum that is not negative pays
/// for it: there the negative bins become zero and the positive ones shrink in proportion, so the sum over that interval,
/// and over all bins, stays what it was. A band whose total is not positive has no energy to show: all zeros.
pub(super) fn carried_over(bins: &[f64]) -> Vec<f64> {
    if bins.is_empty() || bins.iter().sum::<f64>() <= 0.0 {
        return vec![0.0; bins.len()];
    }
    let mut bins = bins.to_vec();
    for i in 0..bins.len() {
        if bins[i] >= 0.0 {
            continue;
        }
        let (mut first, mut last, mut sum) = (i, i, bins[i]);
        while sum < 0.0 && (first > 0 || last + 1 < bins.len()) {
            if first > 0 {
                first -= 1;
                sum += bins[first];
            }
            if sum < 0.0 && last + 1 < bins.len() {
                last += 1;
                sum += bins[last];
            }
        }
        let interval = &mut bins[first..=last];
        let positive: f64 = interval.iter().filter(|e| **e > 0.0).sum();
        let scale = if positive > 0.0 { (sum / positive).max(0.0) } else { 0.0 };
        for e in interval {
            *e = e.max(0.0) * scale;
        }
    }
    bins
}

/// Energy over time in one band; times in s on the reception's own clock, energies as relative intensities.
#[derive(Debug, Clone)]
pub(super) struct EnergyCurve {
    /// Early paths with energy, (delay, intensity), in order of arrival.
    pub(super) arrivals: Vec<(f64, f64)>,
    /// Energy of each bin of the echogram, never negative.
    pub(super) bins: Vec<f64>,
    /// Width of a bin.
    pub(super) bin_s: f64,
    /// `arriving[i]` = intensity of arrivals i.. ; one element more than `arrivals`.
    arriving: Vec<f64>,
    /// `left[i]` = energy of bins i.. ; one element more than `bins`.
    left: Vec<f64>,
}

impl EnergyCurve {
    /// The curve of band `band` of a reception.
    pub(super) fn new(reception: &Reception, band: usize) -> Self {
        let mut arrivals: Vec<(f64, f64)> = reception
            .paths
            .iter()
            .filter_map(|p| p.intensity.get(band).map(|&e| (p.delay_s, e)))
            .filter(|(t, e)| *e > 0.0 && e.is_finite() && t.is_finite())
            .collect();
        arrivals.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (bins, bin_s) = reception
            .echogram
            .as_ref()
            .and_then(|e| e.energy.get(band).map(|bins| (carried_over(bins), e.bin_s)))
            .filter(|(_, bin_s)| *bin_s > 0.0)
            .unwrap_or((Vec::new(), 1.0));
        Self::of_parts(arrivals, bins, bin_s)
    }

    /// The curve of arrivals in order and bins that are not negative.
    pub(super) fn of_parts(arrivals: Vec<(f64, f64)>, bins: Vec<f64>, bin_s: f64) -> Self {
        Self {
            arriving: sums_from(arrivals.iter().map(|a| a.1)),
            left: sums_from(bins.iter().copied()),
            arrivals,
            bins,
            bin_s,
        }
    }

    /// All energy.
    pub(super) fn total(&self) -> f64 {
        self.arriving[0] + self.left[0]
    }

    /// Energy arriving at or after `t_s`.
    pub(super) fn remaining(&self, t_s: f64) -> f64 {
        let first = self.arrivals.partition_point(|a| a.0 < t_s);
        self.arriving[first] + self.remaining_in_bins(t_s)
    }

    /// Energy of the echogram at or after `t_s`; the power is constant within a bin.
    pub(super) fn remaining_in_bins(&self, t_s: f64) -> f64 {
        let position = (t_s / self.bin_s).max(0.0);
        if position >= self.bins.len() as f64 {
            return 0.0;
        }
        let bin = position as usize; // below bins.len(): the line above
        self.left[bin] - self.bins[bin] * (position - bin as f64)
    }

    /// First arrival in s: the earliest path, or the start of the first bin that holds energy.
    pub(super) fn first_arrival_s(&self) -> Option<f64> {
        let path = self.arrivals.first().map(|a| a.0);
        let bin = self.bins.iter().position(|e| *e > 0.0).map(|i| i as f64 * self.bin_s);
        // A bin may begin before the sound that fell into it, so an early path in the same bin decides.
        match (path, bin) {
            (Some(p), Some(b)) if b + self.bin_s > p => Some(p),
            (Some(p), Some(b)) => Some(p.min(b)),
            (p, b) => p.or(b),
        }
    }

    /// End of what is known in s: the end of the echogram or the last path, whichever is later.
    pub(super) fn end_s(&self) -> f64 {
        let bins = self.bins.len() as f64 * self.bin_s;
        self.arrivals.last().map_or(bins, |a| a.0.max(bins))
    }

    /// The latest time in s at which `share` (0..1) of all energy is still to come.
    pub(super) fn time_of_share(&self, share: f64) -> f64 {
        let wanted = share * self.total();
        let (mut early, mut late) = (self.first_arrival_s().unwrap_or(0.0), self.end_s());
        for _ in 0..60 {
            let middle = 0.5 * (early + late);
            if self.remaining(middle) >= wanted {
                early = middle;
            } else {
                late = middle;
            }
        }
        late
    }
}

/// Sums from each element to the last, and a final 0.
fn sums_from(values: impl DoubleEndedIterator<Item = f64>) -> Vec<f64> {
    let mut sums: Vec<f64> = std::iter::once(0.0)
        .chain(values.rev().scan(0.0, |sum, e| {
            *sum += e;
            Some(*sum)
        }))
        .collect();
    sums.reverse();
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_bins_are_paid_by_their_neighbours_and_no_energy_is_lost() {
        let bins = [0.0, 2.0, -1.0, 3.0, 0.5, -2.0, 0.1, 4.0];
        let carried = carried_over(&bins);
        assert!(carried.iter().all(|e| *e >= 0.0), "{carried:?}");
        let (before, after) = (bins.iter().sum::<f64>(), carried.iter().sum::<f64>());
        assert!((before - after).abs() < 1e-12, "{before} {after}");
        // Each debt stays in its neighbourhood: bins 0..=2 hold 1 before and after.
        assert!((carried[..3].iter().sum::<f64>() - 1.0).abs() < 1e-12, "{carried:?}");
    }

    #[test]
    fn bins_without_debt_are_left_alone_and_a_negative_total_is_silent() {
        assert_eq!(carried_over(&[1.0, 0.0, 3.0]), [1.0, 0.0, 3.0]);
        assert_eq!(carried_over(&[1.0, -3.0]), [0.0, 0.0]);
        assert!(carried_over(&[]).is_empty());
    }
}
