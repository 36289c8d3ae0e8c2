//! Smooth spectra through band values, and pulses that have them.
//!
//! A spectrum is a polygon in log-log coordinates: ln |H| is linear in ln f between the band centres and held outside
//! the outermost ones. A power law, the usual shape of diffraction and of mass-law transmission, is met exactly. Since
//! ln |H| is linear in the values at the centres, so is its minimum phase: one Hilbert transform a band serves all paths.

use std::collections::BTreeMap;

use realfft::num_complex::Complex64;

use super::transform::Transform;
use crate::scene::Band;

/// Floor of a silent band in the phase computation, 80 dB below the rest; the magnitude itself is 0 there.
pub(super) const SILENT_LN: f64 = -9.210340371976184;
/// Share of a band's width in octaves over which it fades towards a silent neighbour.
const FADE_SHARE: f64 = 1.0 / 3.0;

/// Where a frequency lies between support points: value = (1 - share) v[point] + share v[next].
#[derive(Debug, Clone, Copy)]
pub(super) struct Between {
    point: usize,
    next: usize,
    share: f64,
}

impl Between {
    /// Interpolates one value a support point.
    pub(super) fn of(&self, values: &[f64]) -> f64 {
        values[self.point] + self.share * (values[self.next] - values[self.point])
    }

    /// The two support points with their shares.
    pub(super) fn shares(&self) -> [(usize, f64); 2] {
        [(self.point, 1.0 - self.share), (self.next, self.share)]
    }
}

/// Place of `hz` between support points at `points_hz` (at least one, ascending), linear in ln f; held outside them.
pub(super) fn between_hz(points_hz: &[f64], hz: f64) -> Between {
    let above = points_hz.partition_point(|p| *p <= hz);
    let point = above.saturating_sub(1);
    let next = above.min(points_hz.len() - 1);
    let share =
        if point == next { 0.0 } else { (hz / points_hz[point]).ln() / (points_hz[next] / points_hz[point]).ln() };
    Between { point, next, share }
}

/// Places of the frequencies 0, `step_hz`, 2 `step_hz`, ... (`bins` of them) between support points, as [`between_hz`].
pub(super) fn between_bins(points_hz: &[f64], step_hz: f64, bins: usize) -> Vec<Between> {
    let mut places = Vec::with_capacity(bins);
    for next in 0..=points_hz.len() {
        let end = points_hz.get(next).map_or(bins, |hz| ((hz / step_hz).ceil() as usize).min(bins));
        if next == 0 || next == points_hz.len() {
            let point = next.saturating_sub(1);
            places.resize(end.max(places.len()), Between { point, next: point, share: 0.0 });
            continue;
        }
        let (from, to) = (points_hz[next - 1], points_hz[next]);
        let scale = 1.0 / (to / from).ln();
        let place = |k: usize| Between { point: next - 1, next, share: (k as f64 * step_hz / from).ln() * scale };
        places.extend((places.len()..end).map(place));
    }
    places
}

/// Geometric centres of bands in Hz, the support points of their spectra.
pub(super) fn centres_hz(bands: &[Band]) -> Vec<f64> {
    bands.iter().map(centre_hz).collect()
}

/// Geometric centre of a band in Hz.
pub(super) fn centre_hz(band: &Band) -> f64 {
    (band.low_hz * band.high_hz).sqrt()
}

/// Values of ln |H| at the band centres such that the white mean of |H|^2 over each band equals `intensity`.
///
/// The mean of a power law over half a band is elementary, so nothing is sampled. Bands with intensity 0 take the value of
/// their nearest neighbour with sound (they are silenced by [`fade`]). Fixed-point iteration: the energy of a band answers
/// mostly (more than half) to its own centre.
pub(super) fn ln_magnitude(bands: &[Band], intensity: &[f64]) -> Vec<f64> {
    let loudest = intensity.iter().copied().fold(0.0, f64::max);
    if loudest <= 0.0 {
        return vec![0.0; bands.len()];
    }
    let silent: Vec<bool> = intensity.iter().map(|e| *e <= 0.0).collect();
    // Squared magnitudes on a scale on which the loudest band is 1.
    let wanted: Vec<f64> = intensity.iter().map(|e| (e / loudest).max(f64::MIN_POSITIVE).ln()).collect();
    let cells = cells(bands);
    let mut x = wanted.clone();
    fill_silent(&mut x, &silent);
    for _ in 0..100 {
        let mut worst: f64 = 0.0;
        let missing: Vec<f64> = (0..bands.len()).map(|b| wanted[b] - mean_power(&cells, &x, b).ln()).collect();
        for b in (0..bands.len()).filter(|b| !silent[*b]) {
            x[b] += missing[b];
            worst = worst.max(missing[b].abs());
        }
        fill_silent(&mut x, &silent);
        if worst < 1e-10 {
            break;
        }
    }
    x.iter().map(|x| 0.5 * (x + loudest.ln())).collect()
}

/// Where a band lies, in ln f from its centre.
struct Cell {
    /// Its limits.
    limits: [f64; 2],
    /// The next centre, infinite if there is none.
    next: f64,
    /// Its centre over its width.
    sharpness: f64,
}

fn cells(bands: &[Band]) -> Vec<Cell> {
    let cell = |(b, band): (usize, &Band)| {
        let centre = centre_hz(band);
        Cell {
            limits: [(band.low_hz / centre).ln(), (band.high_hz / centre).ln()],
            next: bands.get(b + 1).map_or(f64::INFINITY, |next| (centre_hz(next) / centre).ln()),
            sharpness: centre / (band.high_hz - band.low_hz),
        }
    };
    bands.iter().enumerate().map(cell).collect()
}

/// White mean over band `b` of the power law pieces through ln |H|^2 = `x` at the centres, held beyond the outermost.
fn mean_power(cells: &[Cell], x: &[f64], b: usize) -> f64 {
    let slope_above = |b: usize| if b + 1 < x.len() { (x[b + 1] - x[b]) / cells[b].next } else { 0.0 };
    let below = if b > 0 { slope_above(b - 1) } else { 0.0 };
    let Cell { limits: [low, high], sharpness, .. } = cells[b];
    let integral = power_integral(below + 1.0, low, 0.0) + power_integral(slope_above(b) + 1.0, 0.0, high);
    x[b].exp() * sharpness * integral
}

/// Integral of exp(q u) du from `from` to `to`.
fn power_integral(q: f64, from: f64, to: f64) -> f64 {
    let span = q * (to - from);
    let mean = if span.abs() < 1e-9 { 1.0 + 0.5 * span } else { span.exp_m1() / span };
    (q * from).exp() * mean * (to - from)
}

/// Gives each silent band the value of the nearest band with sound.
pub(super) fn fill_silent(values: &mut [f64], silent: &[bool]) {
    let sounding: Vec<usize> = (0..values.len()).filter(|b| !silent[*b]).collect();
    for b in (0..values.len()).filter(|b| silent[*b]) {
        if let Some(nearest) = sounding.iter().min_by_key(|s| s.abs_diff(b)) {
            values[b] = values[*nearest];
        }
    }
}

/// Factor that silences the silent bands: 0 over the whole band, and beyond the outermost band if that is silent; a raised
/// cosine inside the neighbours, over a third of their width in octaves; 1 elsewhere.
pub(super) fn fade(bands: &[Band], silent: &[bool], hz: f64) -> f64 {
    let Some(b) = bands.iter().position(|b| hz <= b.high_hz).or(bands.len().checked_sub(1)) else { return 1.0 };
    if silent[b] {
        return 0.0;
    }
    let width = FADE_SHARE * (bands[b].high_hz / bands[b].low_hz).ln();
    let rise = |distance: f64| 0.5 - 0.5 * (std::f64::consts::PI * (distance / width).clamp(0.0, 1.0)).cos();
    let mut factor = 1.0;
    if b > 0 && silent[b - 1] {
        factor *= rise((hz / bands[b].low_hz).ln());
    }
    if b + 1 < bands.len() && silent[b + 1] {
        factor *= rise((bands[b].high_hz / hz).ln());
    }
    factor
}

/// The fade of one set of silent bands on the pulse grid, with its minimum phase.
struct Fade {
    magnitude: Vec<f64>,
    phase: Vec<f64>,
}

/// Minimum phase of ln |H| = `ln_magnitude` (bins 0 to half of an even transform length), from the folded real cepstrum
/// (A. V. Oppenheim and R. W. Schafer, Discrete-Time Signal Processing, chapter on cepstrum analysis).
pub(super) fn minimum_phase(ln_magnitude: &[f64], transform: &Transform) -> Vec<f64> {
    let mut spectrum: Vec<Complex64> = ln_magnitude.iter().map(|ln| Complex64::new(*ln, 0.0)).collect();
    let mut cepstrum = transform.samples(&mut spectrum);
    let half = cepstrum.len() / 2;
    cepstrum[1..half].iter_mut().for_each(|c| *c *= 2.0);
    cepstrum[half + 1..].fill(0.0);
    transform.spectrum(cepstrum).iter().map(|s| s.im).collect()
}

/// Makes pulses with given band values, as near to minimum phase as their peak allows.
pub(super) struct Shaper<'a> {
    bands: &'a [Band],
    /// Length of a pulse in samples, a power of two, about 0.17 s.
    length: usize,
    sample_rate_hz: f64,
    places: Vec<Between>,
    /// The last polygon's support points in Hz and the places of the bins between them.
    polygon: (Vec<f64>, Vec<Between>),
    /// Minimum phase of ln |H| = 1 at one centre and 0 at the others; `[band][bin]`.
    unit_phase: Vec<Vec<f64>>,
    fades: BTreeMap<Vec<bool>, Fade>,
    transform: Transform,
    spectrum: Vec<Complex64>,
    pulse: Vec<f64>,
}

impl<'a> Shaper<'a> {
    /// Prepares the grid for `bands` (at least one).
    pub(super) fn new(bands: &'a [Band], sample_rate_hz: f64) -> Self {
        let length = ((0.17 * sample_rate_hz) as usize).next_power_of_two().max(64);
        let centres = centres_hz(bands);
        let places = between_bins(&centres, sample_rate_hz / length as f64, length / 2 + 1);
        let mut shaper = Self {
            bands,
            length,
            sample_rate_hz,
            places,
            polygon: (Vec::new(), Vec::new()),
            unit_phase: Vec::new(),
            fades: BTreeMap::new(),
            spectrum: vec![Complex64::ZERO; length / 2 + 1],
            pulse: Vec::new(),
            transform: Transform::new(length),
        };
        for b in 0..bands.len() {
            let unit: Vec<f64> = (0..bands.len()).map(|i| f64::from(u8::from(i == b))).collect();
            let ln: Vec<f64> = shaper.places.iter().map(|p| p.of(&unit)).collect();
            let phase = shaper.minimum_phase(&ln);
            shaper.unit_phase.push(phase);
        }
        shaper
    }

    /// The bands.
    pub(super) fn bands(&self) -> &'a [Band] {
        self.bands
    }

    /// Sample rate in Hz.
    pub(super) fn sample_rate_hz(&self) -> f64 {
        self.sample_rate_hz
    }

    /// Length of a pulse in samples.
    pub(super) fn length(&self) -> usize {
        self.length
    }

    /// Minimum phase of `ln_magnitude` on the pulse grid.
    fn minimum_phase(&mut self, ln_magnitude: &[f64]) -> Vec<f64> {
        minimum_phase(ln_magnitude, &self.transform)
    }

    /// Computes the fade of a set of silent bands, unless all sound or it is there already.
    fn prepare_fade(&mut self, silent: &[bool]) {
        if !silent.contains(&true) || self.fades.contains_key(silent) {
            return;
        }
        let magnitude: Vec<f64> = self.frequencies().map(|hz| fade(self.bands, silent, hz)).collect();
        let ln: Vec<f64> = magnitude.iter().map(|m| m.ln().max(SILENT_LN)).collect();
        let phase = self.minimum_phase(&ln);
        self.fades.insert(silent.to_vec(), Fade { magnitude, phase });
    }

    /// Frequencies of the pulse grid in Hz.
    fn frequencies(&self) -> impl Iterator<Item = f64> + use<> {
        let step = self.sample_rate_hz / self.length as f64;
        (0..=self.length / 2).map(move |k| k as f64 * step)
    }

    /// The pulse with the spectrum exp(`ln_magnitude`) at the band centres, delayed by `fraction` (0..1) of a sample.
    ///
    /// The pulse is circular: index 0 is its nominal arrival, the upper half lies before it. Its phase is the minimum
    /// phase if its largest sample is then within one sample of the nominal arrival; else (steep low-pass and narrow-band
    /// spectra, whose minimum-phase pulse swells later) the largest of 3/4, 1/2, 1/4, 0 times that phase which fulfils it:
    /// with phase 0 the peak is at the arrival always.
    pub(super) fn pulse(&mut self, ln_magnitude: &[f64], silent: &[bool], fraction: f64) -> &[f64] {
        self.prepare_fade(silent);
        let mut phase = vec![0.0; self.places.len()];
        for (ln, unit) in ln_magnitude.iter().zip(&self.unit_phase) {
            for (sum, u) in phase.iter_mut().zip(unit) {
                *sum += ln * u;
            }
        }
        let mut magnitude: Vec<f64> = self.places.iter().map(|p| p.of(ln_magnitude).exp()).collect();
        if let Some(fade) = self.fades.get(silent) {
            for (k, (p, m)) in phase.iter_mut().zip(&mut magnitude).enumerate() {
                *p += fade.phase[k];
                *m *= fade.magnitude[k];
            }
        }
        self.settle(&magnitude, &mut phase, fraction);
        &self.pulse
    }

    /// The pulse with the polygon of ln |H| through `values` at `points_hz`, else as [`Self::pulse`].
    pub(super) fn pulse_of(&mut self, silent: &[bool], points_hz: &[f64], values: &[f64], fraction: f64) -> &[f64] {
        self.shape(silent, points_hz, values, fraction);
        &self.pulse
    }

    /// The gain whose ln is the polygon through `values` at `points_hz`, on the pulse grid, as its logarithm, with the phase chosen as
    /// for a pulse; and its share of the minimum phase. The fade of `silent` bands is in the phase alone.
    pub(super) fn gain(&mut self, silent: &[bool], points_hz: &[f64], values: &[f64]) -> (Vec<Complex64>, f64) {
        let (ln, phase, share) = self.shape(silent, points_hz, values, 0.0);
        (ln.into_iter().zip(phase).map(|(ln, phase)| Complex64::new(ln, phase)).collect(), share)
    }

    /// Makes the pulse of a polygon; returns ln |H| without the fade, the phase and its share of the minimum phase.
    fn shape(
        &mut self,
        silent: &[bool],
        points_hz: &[f64],
        values: &[f64],
        fraction: f64,
    ) -> (Vec<f64>, Vec<f64>, f64) {
        self.prepare_fade(silent);
        if self.polygon.0 != points_hz {
            let places = between_bins(points_hz, self.sample_rate_hz / self.length as f64, self.places.len());
            self.polygon = (points_hz.to_vec(), places);
        }
        let ln: Vec<f64> = self.polygon.1.iter().map(|place| place.of(values)).collect();
        let mut phase = self.minimum_phase(&ln);
        let mut magnitude: Vec<f64> = ln.iter().map(|ln| ln.exp()).collect();
        if let Some(fade) = self.fades.get(silent) {
            for (k, (p, m)) in phase.iter_mut().zip(&mut magnitude).enumerate() {
                *p += fade.phase[k];
                *m *= fade.magnitude[k];
            }
        }
        let share = self.settle(&magnitude, &mut phase, fraction);
        (ln, phase, share)
    }

    /// Makes the pulse of a spectrum and reduces its phase until the peak is in time, to the share returned.
    fn settle(&mut self, magnitude: &[f64], phase: &mut [f64], fraction: f64) -> f64 {
        let turn = Complex64::cis(-std::f64::consts::TAU * fraction / self.length as f64);
        let mut share = 1.0;
        loop {
            let mut delay = Complex64::ONE;
            for (k, s) in self.spectrum.iter_mut().enumerate() {
                let (sin, cos) = (share * phase[k]).sin_cos();
                *s = Complex64::new(magnitude[k] * cos, magnitude[k] * sin) * delay;
                delay *= turn;
            }
            self.pulse = self.transform.samples(&mut self.spectrum);
            if share == 0.0 || self.peak_is_in_time(fraction) {
                break;
            }
            share -= 0.25;
        }
        for p in phase {
            *p *= share;
        }
        share
    }

    /// Whether the largest sample lies within one sample of the nominal arrival.
    fn peak_is_in_time(&self, fraction: f64) -> bool {
        let near = [(self.length - 1, -1.0), (0, 0.0), (1, 1.0), (2, 2.0)];
        let peak = near
            .iter()
            .filter(|(_, t)| (t - fraction).abs() <= 1.0)
            .map(|(i, _)| self.pulse[*i].abs())
            .fold(0.0, f64::max);
        self.pulse.iter().all(|p| p.abs() <= peak * (1.0 + 1e-12))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_lie_where_their_frequencies_do() {
        for (points_hz, step_hz) in [(vec![40.0, 100.0, 1000.0], 7.0), (vec![50.0], 25.0), (vec![1.0, 3.0, 3.5], 10.0)]
        {
            let values: Vec<f64> = points_hz.iter().map(|hz| hz * hz).collect();
            let places = between_bins(&points_hz, step_hz, 300);
            assert_eq!(places.len(), 300);
            for (k, place) in places.iter().enumerate() {
                let (found, expected) = (place.of(&values), between_hz(&points_hz, k as f64 * step_hz).of(&values));
                assert!((found - expected).abs() <= 1e-9 * expected, "{k}: {found}, not {expected}");
            }
        }
    }

    fn octaves() -> Vec<Band> {
        (0..8)
            .map(|i| {
                let centre = 1000.0 * 2f64.powi(i - 4);
                Band { nominal_hz: centre, low_hz: centre / 2f64.sqrt(), high_hz: centre * 2f64.sqrt() }
            })
            .collect()
    }

    /// White mean of the polygon by brute force (midpoints).
    fn mean_by_sampling(bands: &[Band], ln: &[f64], b: usize) -> f64 {
        let (n, centres) = (20_000, centres_hz(bands));
        let step = (bands[b].high_hz - bands[b].low_hz) / f64::from(n);
        (0..n)
            .map(|i| (2.0 * between_hz(&centres, bands[b].low_hz + (f64::from(i) + 0.5) * step).of(ln)).exp())
            .sum::<f64>()
            / f64::from(n)
    }

    #[test]
    fn the_polygon_has_the_band_means_asked_for() {
        let bands = octaves();
        for wanted in [
            [1.0; 8],
            [1.0, 0.5, 0.25, 0.125, 0.0625, 0.03, 0.015, 0.008],
            [1e-3, 1.0, 1e-3, 0.3, 0.31, 1e-4, 2e-4, 1.0],
        ] {
            let ln = ln_magnitude(&bands, &wanted);
            for (b, wanted) in wanted.iter().enumerate() {
                let mean = mean_by_sampling(&bands, &ln, b);
                // 1e-6: the midpoint rule's own error over 20000 points.
                assert!((mean / wanted - 1.0).abs() < 1e-6, "{b}: {mean} {wanted}");
            }
        }
    }

    #[test]
    fn a_power_law_is_met_exactly_inside_the_range() {
        let bands = octaves();
        let wanted: Vec<f64> = bands.iter().map(|b| (b.high_hz / b.low_hz).ln() / (b.high_hz - b.low_hz)).collect();
        let ln = ln_magnitude(&bands, &wanted);
        for b in 2..6 {
            // |H|^2 = 1/f; the held ends (bands 0 and 7) reach in by less than a percent.
            let power = (2.0 * ln[b]).exp() * centre_hz(&bands[b]);
            assert!((power - 1.0).abs() < 0.01, "{b}: {power}");
        }
    }

    #[test]
    fn a_minimum_phase_pulse_has_nothing_before_its_arrival() {
        let bands = octaves();
        let mut shaper = Shaper::new(&bands, 48_000.0);
        let ln: Vec<f64> = bands.iter().map(|b| -0.5 * centre_hz(b).ln()).collect();
        let pulse = shaper.pulse(&ln, &[false; 8], 0.0);
        let half = pulse.len() / 2;
        let before: f64 = pulse[half..].iter().map(|p| p * p).sum();
        let after: f64 = pulse[..half].iter().map(|p| p * p).sum();
        // The cepstrum's aliasing on a grid of 0.17 s is the only thing left before the arrival.
        assert!(before < 1e-6 * after, "{before} {after}");
        let peak = pulse.iter().copied().fold(0.0, f64::max);
        assert_eq!(pulse[0], peak);
    }

    #[test]
    fn the_peak_is_in_time_even_when_only_one_low_band_sounds() {
        let bands = octaves();
        let mut shaper = Shaper::new(&bands, 48_000.0);
        let silent: Vec<bool> = (0..8).map(|b| b != 2).collect();
        let pulse = shaper.pulse(&[0.0; 8], &silent, 0.3);
        let peak = (0..pulse.len()).max_by(|a, b| pulse[*a].abs().total_cmp(&pulse[*b].abs()));
        assert!(matches!(peak, Some(0 | 1)), "{peak:?}");
    }
}
