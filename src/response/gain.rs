//! The last correction: a smooth gain that gives the whole response the band energies of the reception.
//!
//! Levels add intensities, samples add pressures: early paths that overlap within a period interfere, most of all in the
//! lowest bands, and may leave a band's energy at its very edge. A gain, linear in ln G over ln f and of minimum phase,
//! restores the white mean of |H|^2 over each band, and as far as it can what the Butterworth filters of IEC 61260-1
//! class 1 measure of it; times of arrival stay. Of all such gains it is the one with the least curvature.

use std::ops::RangeInclusive;

use nalgebra::{DMatrix, DVector};
use realfft::num_complex::Complex64;

use super::spectrum::{Between, SILENT_LN, Shaper, between_bins, between_hz, fade, minimum_phase};
use super::transform::Transform;
use crate::scene::Band;

/// Remaining error in dB of a band's white mean and of its filtered ones at which the iteration stops.
const GOALS_DB: [f64; 2] = [0.02, 0.17];
/// The errors of both that the fit leaves alone. White mean and filtered mean of a spectrum with structure differ, and forcing
/// them together bends the spectrum within the bands, and with it their decays.
const TOLERATED_DB: [f64; 2] = [0.0, 0.15];
/// Shares of the remaining errors of both by which the aim is moved: white means may answer to it twice, as the gain rings past the ends.
const RELAXATION: [f64; 2] = [0.7, 1.0];
/// Natural logarithm of an energy ratio of 1 dB.
const NEPERS_PER_DB: f64 = std::f64::consts::LN_10 / 10.0;
/// Orders of the Butterworth band-passes: class 1 is met from 3 on (4 near half the sample rate).
const FILTER_ORDERS: [i32; 2] = [3, 4];
/// Pieces per octave into which the spectrum is summed for the fit.
const PIECES: f64 = 64.0;
/// Distance of the gain's support points in octaves.
const SUPPORT_OCTAVES: f64 = 0.25;
/// Weights of white means, of filtered means, of the gain's curvature and of its size in the least squares; without the last one the
/// correction of one band sways its neighbours.
const WEIGHTS: [f64; 4] = [30.0, 2.0, 0.03, 0.03];
/// Ratio of frequencies outside the bands over which the gain returns to 1: nobody knows the energy there, so that the plain
/// sum of pressures stays.
const OUTSIDE: f64 = std::f64::consts::SQRT_2;
/// Weight that holds it there.
const UNCORRECTED: f64 = 1e6;
/// Largest gain or loss, in nepers of amplitude (about 52 dB).
const LIMIT: f64 = 6.0;

/// Share of the cost, and the cost (0.0015 dB of a white mean), by which a step must lower it to be followed by another.
const SETTLED: [f64; 2] = [0.01, 1e-4];

/// Least and greatest factor on the noise of a band.
const FACTORS: [f64; 2] = [0.5, 2.0];

/// One mean of |H|^2 over frequency, as weights of consecutive bins.
struct Mean {
    band: usize,
    /// Whether a filter takes it; else it is the white mean between the band's edges.
    filtered: bool,
    first_piece: usize,
    /// Energy of each piece, its share in the mean included, before the gain.
    energies: Vec<f64>,
}

/// The weights of a filtered mean.
struct Filter {
    band: usize,
    first_piece: usize,
    /// Weight of |H|^2 of each bin of a piece, from `first_piece` on; pieces that matter less than 1e-9 are left out.
    shares: Vec<f64>,
}

/// Measures the means of a spectrum, piece by piece.
struct Meter<'a> {
    bands: &'a [Band],
    sample_rate_hz: f64,
    /// Over the response and a pulse more, for the gain to ring, and over one second at least.
    transform: Transform,
    /// Piece of each bin.
    piece: Vec<usize>,
    /// Frequency of each piece in Hz.
    piece_hz: Vec<f64>,
    /// Filtered means.
    filters: Vec<Filter>,
}

impl<'a> Meter<'a> {
    fn new(shaper: &Shaper<'a>, samples: usize) -> Self {
        let (bands, rate) = (shaper.bands(), shaper.sample_rate_hz());
        let transform = Transform::new((samples + shaper.length()).max(rate.ceil() as usize));
        let step = rate / transform.length() as f64;
        let (mut piece, mut piece_hz, mut sizes) = (vec![0], vec![0.0], vec![1.0]);
        let mut end = 0.0;
        for k in 1..transform.bins() {
            let hz = k as f64 * step;
            if hz >= end {
                end = hz * (1.0 / PIECES).exp2();
                piece_hz.push(0.0);
                sizes.push(0.0);
            }
            let last = piece_hz.len() - 1;
            piece.push(last);
            piece_hz[last] += hz;
            sizes[last] += 1.0;
        }
        for (hz, size) in piece_hz.iter_mut().zip(&sizes) {
            *hz /= size;
        }
        let filters = bands
            .iter()
            .enumerate()
            .filter(|(_, b)| b.high_hz < 0.49 * rate)
            .flat_map(|(band, b)| FILTER_ORDERS.map(|order| (band, b, order)))
            .map(|(band, b, order)| {
                let power: Vec<f64> = piece_hz.iter().map(|hz| butterworth(b, *hz, rate, order)).collect();
                let sum: f64 = power.iter().zip(&sizes).map(|(p, n)| p * n).sum();
                let matters = |i: &usize| power[*i] * sizes[*i] > 1e-9 * sum;
                let first_piece = (0..power.len()).find(matters).unwrap_or(0);
                let last_piece = (0..power.len()).rfind(matters).unwrap_or(0);
                Filter { band, first_piece, shares: power[first_piece..=last_piece].iter().map(|p| p / sum).collect() }
            })
            .collect();
        Self { bands, sample_rate_hz: rate, transform, piece, piece_hz, filters }
    }

    /// Distance of the bins in Hz.
    fn step_hz(&self) -> f64 {
        self.sample_rate_hz / self.transform.length() as f64
    }

    /// All means of `spectrum`.
    fn means(&self, spectrum: &[Complex64]) -> impl Iterator<Item = Mean> {
        let power: Vec<f64> = spectrum.iter().map(|h| h.norm_sqr()).collect();
        let mut energy = vec![0.0; self.piece_hz.len()];
        for (p, piece) in power.iter().zip(&self.piece) {
            energy[*piece] += p;
        }
        let white = move |b: usize| {
            let bins = self.white_bins(b);
            let first_piece = self.piece[*bins.start()];
            let mut energies = vec![0.0; self.piece[*bins.end()] - first_piece + 1];
            for (k, share) in self.white_shares(b) {
                energies[self.piece[k] - first_piece] += share * power[k];
            }
            Mean { band: b, filtered: false, first_piece, energies }
        };
        let filtered = move |f: &Filter| Mean {
            band: f.band,
            filtered: true,
            first_piece: f.first_piece,
            energies: f.shares.iter().zip(&energy[f.first_piece..]).map(|(share, e)| share * e).collect(),
        };
        (0..self.bands.len()).map(white).chain(self.filters.iter().map(filtered))
    }

    /// Edges of band `b` in bins.
    fn edges(&self, b: usize) -> [f64; 2] {
        let top = (self.transform.bins() - 1) as f64;
        [self.bands[b].low_hz, self.bands[b].high_hz].map(|hz| (hz / self.step_hz()).min(top))
    }

    /// The bins that its white mean depends on.
    fn white_bins(&self, b: usize) -> RangeInclusive<usize> {
        let [low, high] = self.edges(b);
        low.floor() as usize..=high.ceil() as usize
    }

    /// Their weights in it: the mean is the exact integral of the polygon through the bins.
    fn white_shares(&self, b: usize) -> impl Iterator<Item = (usize, f64)> {
        let [low, high] = self.edges(b);
        let unit = 1.0 / (high - low).max(f64::MIN_POSITIVE);
        // Of the triangle over the bin and half of both distances, what lies between the edges, by distance from its feet.
        let part = |from: f64, to: f64| 0.5 * (to.clamp(0.0, 1.0).powi(2) - from.clamp(0.0, 1.0).powi(2));
        self.white_bins(b).map(move |k| {
            let (before, after) = (k as f64 - 1.0, k as f64 + 1.0);
            let inside = low <= before && after <= high;
            let area = if inside { 1.0 } else { part(low - before, high - before) + part(after - high, after - low) };
            (k, area * unit)
        })
    }
}

/// |F|^2 of a digital Butterworth band-pass of the given order with -3 dB at the band's edges (bilinear transform).
fn butterworth(band: &Band, hz: f64, rate: f64, order: i32) -> f64 {
    let warp = |hz: f64| (std::f64::consts::PI * hz / rate).tan();
    let (low, high, w) = (warp(band.low_hz), warp(band.high_hz), warp(hz));
    let detuning = (w * w - low * high) / (w * (high - low));
    1.0 / (1.0 + detuning.powi(2 * order))
}

impl Mean {
    fn value(&self) -> f64 {
        self.energies.iter().sum()
    }

    /// 10 lg(mean/target).
    fn error_db(&self, target: &[f64]) -> f64 {
        10.0 * (self.value() / target[self.band]).log10()
    }
}

/// What finds gains for samples of one length.
pub(super) struct Matcher<'a> {
    meter: Meter<'a>,
    /// Support points of the gain in Hz.
    nodes_hz: Vec<f64>,
    /// Places of the pieces between them.
    pieces: Vec<Between>,
}

/// A gain that gives a response its band energies.
struct Gain {
    /// Response at the bins over the transform's length; empty where there is nothing to change.
    filter: Vec<Complex64>,
    /// The samples with the gain.
    samples: Vec<f64>,
    /// Remaining error of each band's white mean in dB: 0 where silence was asked for, -infinite where there was nothing to
    /// amplify.
    errors_db: Vec<f64>,
}

impl<'a> Matcher<'a> {
    pub(super) fn new(shaper: &Shaper<'a>, length: usize) -> Self {
        let meter = Meter::new(shaper, length);
        let nodes_hz = support(meter.bands);
        Self { pieces: meter.piece_hz.iter().map(|hz| between_hz(&nodes_hz, *hz)).collect(), nodes_hz, meter }
    }

    /// The gain that gives `samples` the band means of |H|^2 in `target` (one a band; 0: the band is silenced), the filtered ones of bands
    /// that reach above `filters_from_hz`.
    fn matching(&self, samples: &[f64], target: &[f64], filters_from_hz: f64, shaper: &mut Shaper<'_>) -> Gain {
        let counts = |m: &Mean| !m.filtered || self.meter.bands[m.band].high_hz > filters_from_hz;
        let means_of = |spectrum: &[Complex64]| -> Vec<Mean> { self.meter.means(spectrum).filter(counts).collect() };
        let mut raw = self.meter.transform.spectrum(samples.to_vec());
        let silent: Vec<bool> = target.iter().map(|t| *t <= 0.0).collect();
        let step_hz = self.meter.step_hz();
        let fades: Option<Vec<f64>> = silent
            .contains(&true)
            .then(|| (0..raw.len()).map(|k| fade(self.meter.bands, &silent, k as f64 * step_hz)).collect());
        for (h, f) in raw.iter_mut().zip(fades.iter().flatten()) {
            *h *= f;
        }
        let means = means_of(&raw);
        let worst = Worst::of(&means, target);
        let mut best = Gain { filter: Vec::new(), samples: samples.to_vec(), errors_db: worst.white_db.clone() };
        let loud = |m: &Mean| target[m.band] > 0.0 && m.value() > 0.0;
        if !silent.contains(&true) && (worst.is_met() || !means.iter().any(loud)) {
            return best;
        }

        let mut wanted: Vec<Option<f64>> = means.iter().map(|m| loud(m).then(|| target[m.band].ln())).collect();
        let mut ln_gain = vec![0.0; self.nodes_hz.len()];
        let mut least = f64::INFINITY;
        for _ in 0..16 {
            fit(&means, &wanted, &self.pieces, &mut ln_gain);
            let filter = self.filter(&ln_gain, &silent, fades.as_deref(), shaper);
            let mut spectrum: Vec<Complex64> = raw.iter().zip(&filter).map(|(r, f)| r * f).collect();
            // What rings past either end of the response is cut off; then the loss is measured and made good.
            let result = self.samples(&mut spectrum, samples.len());
            let reached = means_of(&self.meter.transform.spectrum(result.clone()));
            let worst = Worst::of(&reached, target);
            for (w, m) in wanted.iter_mut().zip(&reached) {
                // Means are pressed no harder than needed: each press bends the gain further.
                let (error_db, kind) = (m.error_db(target), usize::from(m.filtered));
                let pressed = m.value() > 0.0 && error_db.abs() > GOALS_DB[kind];
                let tolerated_db = TOLERATED_DB[kind];
                if let Some(w) = w.as_mut().filter(|_| pressed) {
                    *w -= RELAXATION[kind] * (error_db - error_db.clamp(-tolerated_db, tolerated_db)) * NEPERS_PER_DB;
                }
            }
            let met = worst.is_met();
            if worst.score < least {
                least = worst.score;
                best = Gain { filter, samples: result, errors_db: worst.white_db };
            }
            if met {
                break;
            }
        }
        for (g, f) in best.filter.iter_mut().zip(fades.iter().flatten()) {
            *g *= f;
        }
        best
    }

    /// ln of the gain, at its support points, that gives the response with this spectrum the means in `target`; `None` where it has them.
    pub(super) fn fitted(&self, spectrum: &[Complex64], target: &[f64]) -> Option<Vec<f64>> {
        let means: Vec<Mean> = self.meter.means(spectrum).collect();
        if Worst::of(&means, target).is_met() {
            return None;
        }
        let loud = |m: &Mean| target[m.band] > 0.0 && m.value() > 0.0;
        let wanted: Vec<Option<f64>> = means.iter().map(|m| loud(m).then(|| target[m.band].ln())).collect();
        let mut ln_gain = vec![0.0; self.nodes_hz.len()];
        fit(&means, &wanted, &self.pieces, &mut ln_gain);
        Some(ln_gain)
    }

    /// Applies a gain to samples and their spectrum.
    pub(super) fn apply(&self, gain: &[Complex64], spectrum: &mut [Complex64], samples: &mut Vec<f64>) {
        spectrum.iter_mut().zip(gain).for_each(|(s, g)| *s *= g);
        *samples = self.samples(&mut spectrum.to_vec(), samples.len());
    }

    /// Response of a gain, of minimum phase, at the bins of the transform, from its ln at the support points, of which it takes a `share`.
    pub(super) fn gain(&self, ln_gain: &[f64], share: f64, shaper: &mut Shaper<'_>) -> Vec<Complex64> {
        let ln_gain: Vec<f64> = ln_gain.iter().map(|ln| share * ln).collect();
        self.filter(&ln_gain, &vec![false; self.meter.bands.len()], None, shaper)
    }

    /// Its amplitudes alone.
    pub(super) fn amplitudes(&self, ln_gain: &[f64], shaper: &Shaper<'_>) -> Vec<f64> {
        let (length, transform) = (shaper.length(), &self.meter.transform);
        let places = between_bins(&self.nodes_hz, self.meter.sample_rate_hz / length as f64, length / 2 + 1);
        let ln: Vec<Complex64> = places.iter().map(|place| Complex64::new(place.of(ln_gain), 0.0)).collect();
        let gain = between_pulse_bins(&ln, length as f64 / transform.length() as f64, transform.bins());
        gain.iter().map(|g| g.re).collect()
    }

    /// [`Self::gain`] with silent bands; their `fades` are left to the caller but for their phase.
    fn filter(
        &self,
        ln_gain: &[f64],
        silent: &[bool],
        fades: Option<&[f64]>,
        shaper: &mut Shaper<'_>,
    ) -> Vec<Complex64> {
        let (coarse, share) = shaper.gain(silent, &self.nodes_hz, ln_gain);
        let transform = &self.meter.transform;
        let Some(fades) = fades else {
            return between_pulse_bins(&coarse, shaper.length() as f64 / transform.length() as f64, transform.bins());
        };
        // The flanks of a silent band are too steep for the pulse grid.
        let places = between_bins(&self.nodes_hz, self.meter.step_hz(), transform.bins());
        let ln: Vec<f64> = places.iter().map(|place| place.of(ln_gain)).collect();
        let faded: Vec<f64> = ln.iter().zip(fades).map(|(ln, f)| ln + f.ln().max(SILENT_LN)).collect();
        let fine = minimum_phase(&faded, transform);
        ln.iter().zip(fine).map(|(ln, angle)| Complex64::from_polar(ln.exp(), share * angle)).collect()
    }

    /// Gives the first channel the band means of |H|^2 in `target`, filtered ones where bands reach above `filters_from_hz`, and the others
    /// the same gain. Returns the remaining errors in dB.
    pub(super) fn match_bands(
        &self,
        channels: &mut [Vec<f64>],
        target: &[f64],
        filters_from_hz: f64,
        shaper: &mut Shaper<'_>,
    ) -> Vec<f64> {
        let gain = self.matching(&channels[0], target, filters_from_hz, shaper);
        for samples in channels[1..].iter_mut().filter(|_| !gain.filter.is_empty()) {
            let mut spectrum = self.meter.transform.spectrum(samples.to_vec());
            spectrum.iter_mut().zip(&gain.filter).for_each(|(s, gain)| *s *= gain);
            *samples = self.samples(&mut spectrum, samples.len());
        }
        channels[0] = gain.samples;
        gain.errors_db
    }

    /// Factors, one a band, on noise that give it the white means in `target` together with early sound, about 1; and both together then.
    pub(super) fn joined(
        &self,
        early: &[Complex64],
        noise: &[Complex64],
        target: &[f64],
    ) -> (Vec<f64>, Vec<Complex64>) {
        let factor = |(b, target): (usize, &f64)| {
            let [own, beside, cross] = [[noise, noise], [early, early], [early, noise]].map(|[x, y]| {
                let product = |(k, share): (usize, f64)| share * (x[k].re * y[k].re + x[k].im * y[k].im);
                self.meter.white_shares(b).map(product).sum::<f64>()
            });
            let root = (cross * cross + own * (target - beside)).max(0.0).sqrt();
            if own > 0.0 { ((root - cross) / own).clamp(FACTORS[0], FACTORS[1]) } else { 1.0 }
        };
        let factors: Vec<f64> = target.iter().enumerate().map(factor).collect();
        let step_hz = self.meter.step_hz();
        let mut whole = early.to_vec();
        let mut from = 0;
        for (b, factor) in factors.iter().enumerate() {
            let last = b + 1 == factors.len();
            let to = if last { whole.len() } else { (self.meter.bands[b].high_hz / step_hz) as usize };
            whole[from..to].iter_mut().zip(&noise[from..to]).for_each(|(sum, n)| *sum += n * *factor);
            from = to;
        }
        (factors, whole)
    }

    /// The transforms of all that it measures.
    pub(super) fn transform(&self) -> &Transform {
        &self.meter.transform
    }

    /// The first `length` samples of a spectrum.
    fn samples(&self, spectrum: &mut [Complex64], length: usize) -> Vec<f64> {
        let mut samples = self.meter.transform.samples(spectrum);
        samples.truncate(length);
        samples
    }
}

/// exp of a logarithm on the pulse grid at `bins` bins that lie `pulse_bins_a_bin` apart on it: between two of its bins the
/// logarithm is linear, so that each value is the one before times one factor.
fn between_pulse_bins(ln: &[Complex64], pulse_bins_a_bin: f64, bins: usize) -> Vec<Complex64> {
    let (mut cell, mut here, mut factor) = (usize::MAX, Complex64::ONE, Complex64::ONE);
    let value = |k: usize| {
        let place = k as f64 * pulse_bins_a_bin;
        let at = (place as usize).min(ln.len() - 2);
        if at == cell {
            here *= factor;
        } else {
            let slope = ln[at + 1] - ln[at];
            (cell, here, factor) = (at, (ln[at] + slope * (place - at as f64)).exp(), (slope * pulse_bins_a_bin).exp());
        }
        here
    };
    (0..bins).map(value).collect()
}

/// The errors of a response.
struct Worst {
    /// Error of each band's white mean in dB.
    white_db: Vec<f64>,
    /// Largest error in units of its goal.
    score: f64,
}

impl Worst {
    fn of(means: &[Mean], target: &[f64]) -> Self {
        let sounding = || means.iter().filter(|m| target[m.band] > 0.0);
        let mut white_db = vec![0.0; target.len()];
        for m in sounding().filter(|m| !m.filtered) {
            white_db[m.band] = m.error_db(target);
        }
        let goal = |m: &Mean| GOALS_DB[usize::from(m.filtered)];
        let errors = sounding().map(|m| m.error_db(target).abs() / goal(m)).filter(|e| e.is_finite());
        Self { score: errors.fold(0.0, f64::max), white_db }
    }

    fn is_met(&self) -> bool {
        self.score <= 1.0
    }
}

/// Support points of the gain: the bands' edges and points between them, about a quarter of an octave (in narrow
/// bands a third of a band) apart; and one on either side, beyond which nothing is corrected.
fn support(bands: &[Band]) -> Vec<f64> {
    let mut nodes: Vec<f64> = Vec::new();
    for b in bands {
        let octaves = (b.high_hz / b.low_hz).log2();
        let parts = ((octaves / SUPPORT_OCTAVES).round() as usize).clamp(3, 64);
        for i in 0..=parts {
            let hz = b.low_hz * (octaves * i as f64 / parts as f64).exp2();
            if nodes.last().is_none_or(|last| hz > last * 1.0001) {
                nodes.push(hz);
            }
        }
    }
    let (first, last) = (bands.first().map_or(1.0, |b| b.low_hz), bands.last().map_or(1.0, |b| b.high_hz));
    nodes.insert(0, first / OUTSIDE);
    nodes.push(last * OUTSIDE);
    nodes
}

/// Improves `ln_gain` (amplitude, at the support points) until the means of the energies times the gain squared have the
/// logarithms `wanted` (`None`: this mean does not count): least squares on the logarithms after Levenberg and Marquardt.
fn fit(means: &[Mean], wanted: &[Option<f64>], places: &[Between], ln_gain: &mut Vec<f64>) {
    let n = ln_gain.len();
    let (mut damping, mut growth) = (1e-3, 2.0);
    let mut here = normal_equations(means, wanted, places, ln_gain);
    for _ in 0..60 {
        let mut damped = here.matrix.clone();
        for i in 0..n {
            damped[(i, i)] *= 1.0 + damping;
        }
        let Some(factor) = damped.cholesky() else { return };
        let step = factor.solve(&here.right);
        let expected = step.dot(&(2.0 * &here.right - &here.matrix * &step));
        let next: Vec<f64> = ln_gain.iter().zip(step.iter()).map(|(g, s)| (g + s).clamp(-LIMIT, LIMIT)).collect();
        let there = normal_equations(means, wanted, places, &next);
        let gained = here.cost - there.cost;
        if gained > 0.0 {
            *ln_gain = next;
            let settled = gained < SETTLED[0] * here.cost + SETTLED[1];
            here = there;
            if settled {
                return;
            }
            // Nielsen (1999): how well the linearisation foretold the gain decides how far to trust it.
            damping *= (1.0 - (2.0 * gained / expected - 1.0).powi(3)).max(1.0 / 3.0);
            growth = 2.0;
        } else {
            damping *= growth;
            growth *= 2.0;
            if damping > 1e9 {
                return;
            }
        }
    }
}

/// Normal equations of the least squares, linearised.
struct Normal {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    cost: f64,
}

fn normal_equations(means: &[Mean], wanted: &[Option<f64>], places: &[Between], ln_gain: &[f64]) -> Normal {
    let n = ln_gain.len();
    let power: Vec<f64> = places.iter().map(|p| (2.0 * p.of(ln_gain)).exp()).collect();
    let tolerated = TOLERATED_DB.map(|db| db * NEPERS_PER_DB);
    let (mut matrix, mut right, mut cost) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n), 0.0);
    for (mean, wanted) in means.iter().zip(wanted) {
        let Some(wanted) = wanted else { continue };
        let mut slope = DVector::<f64>::zeros(n);
        let mut value = 0.0;
        for (i, e) in mean.energies.iter().enumerate() {
            let (place, e) = (&places[mean.first_piece + i], e * power[mean.first_piece + i]);
            value += e;
            for (node, share) in place.shares() {
                slope[node] += 2.0 * e * share;
            }
        }
        if !(value > 0.0 && value.is_finite()) {
            continue;
        }
        slope /= value;
        let weight = WEIGHTS[usize::from(mean.filtered)].powi(2);
        let mut missing = wanted - value.ln();
        let tolerated = tolerated[usize::from(mean.filtered)];
        missing -= missing.clamp(-tolerated, tolerated);
        if missing == 0.0 {
            continue;
        }
        matrix.ger(weight, &slope, &slope, 1.0);
        right.axpy(weight * missing, &slope, 1.0);
        cost += weight * missing * missing;
    }
    // Size and smoothness of the whole gain, not of the step.
    let weight = WEIGHTS[2].powi(2);
    for i in 0..n {
        let size = if i == 0 || i + 1 == n { UNCORRECTED } else { WEIGHTS[3].powi(2) };
        matrix[(i, i)] += size;
        right[i] -= size * ln_gain[i];
        cost += size * ln_gain[i] * ln_gain[i];
        if i > 0 && i + 1 < n {
            let bend = ln_gain[i - 1] - 2.0 * ln_gain[i] + ln_gain[i + 1];
            cost += weight * bend * bend;
            for (a, x) in [(i - 1, 1.0), (i, -2.0), (i + 1, 1.0)] {
                right[a] -= weight * x * bend;
                for (b, y) in [(i - 1, 1.0), (i, -2.0), (i + 1, 1.0)] {
                    matrix[(a, b)] += weight * x * y;
                }
            }
        }
    }
    Normal { matrix, right, cost }
}
