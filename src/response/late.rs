//! Late sound joined to early sound: noise with the energies of the echogram, and the band levels of both together.
//!
//! Noise of finite length misses its spectrum, and interferes with the early sound, so that band levels are some tenths of a dB off. A
//! gain on the sum would mend that but change decays. Instead one factor a band on the noise meets the white means, and where filtered
//! means still miss, the noise is made anew with a smooth gain, before its envelope, of which the early sound takes a part.

use realfft::num_complex::Complex64;

use super::balance::{self, Balance};
use super::directional;
use super::energy::EnergyCurve;
use super::gain::Matcher;
use super::noise::{Noise, TimeAxis};
use super::spectrum::Shaper;
use crate::probe::Reception;

/// Most rounds of making the noise anew.
const ROUNDS: usize = 3;
/// Change of the amplitude, as a share, below which noise stays as it is.
const UNCHANGED: f64 = 0.03;
/// Share of the gain (in dB) that the early sound takes, which has its own band energies already; clarity and early decay times keep best
/// with some 0.3.
const EARLY_SHARE: f64 = 0.3;
/// Below this frequency the last gain leaves alone what filters measure of a band, beyond its own energy: noise of few degrees of freedom
/// would be bent so much that the next band's decay would follow.
const FILTERS_FROM_HZ: f64 = 100.0;

/// Adds late sound (`curves`: the energies of the reception, one a band) to the early sound in `channels` (spherical harmonics) such
/// that the first has the means of |H|^2 in `target`, one a band. Returns the remaining errors in dB.
pub(super) fn join(
    channels: &mut [Vec<f64>],
    (reception, curves): (&Reception, &[EnergyCurve]),
    (axis, seed): (TimeAxis, u64),
    target: &[f64],
    shaper: &mut Shaper<'_>,
) -> Vec<f64> {
    let matcher = Matcher::new(shaper, axis.length);
    let transform = matcher.transform();
    let noise = Noise::new(reception, curves, shaper.bands(), axis, transform);
    let balance = Balance::new(reception, curves, shaper.bands(), axis, transform);
    let mut amplitudes = noise.amplitudes();
    let pulses = noise.pulses(seed, 0);
    let mut early: Vec<Vec<Complex64>> = channels.iter().map(|samples| transform.spectrum(samples.clone())).collect();
    let (mut layers, mut changed) = (Vec::new(), vec![true; amplitudes.len()]);
    let mut factors = Vec::new();
    for round in 0..=ROUNDS {
        noise.make(&mut layers, &pulses, &amplitudes, &changed);
        // What one band's factors do to its neighbours is left to a second round.
        let late = balance.balance(&mut layers, &early[0], if round == 0 { 2 } else { 1 });
        let late = transform.spectrum(late);
        // Band levels are those of the first channel, the pressure.
        let (found, whole) = matcher.joined(&early[0], &late, target);
        factors = found;
        if round == ROUNDS {
            break;
        }
        let Some(ln_gain) = matcher.fitted(&whole, target) else { break };
        let gain = matcher.gain(&ln_gain, EARLY_SHARE, shaper);
        for (spectrum, samples) in early.iter_mut().zip(channels.iter_mut()) {
            matcher.apply(&gain, spectrum, samples);
        }
        let gain = matcher.amplitudes(&ln_gain, shaper);
        changed = gain.iter().map(|g| (g - 1.0).abs() > UNCHANGED).collect();
        amplitudes.iter_mut().zip(&gain).for_each(|(a, g)| *a *= g);
    }
    // Once more with all factors, as bands overlap at their edges.
    let mut late = vec![0.0; axis.length];
    balance::add(&layers, |band| factors[band], &mut late);
    let (again, _) = matcher.joined(&early[0], &transform.spectrum(late), target);
    factors.iter_mut().zip(again).for_each(|(factor, again)| *factor *= again);
    for (c, samples) in channels.iter_mut().enumerate() {
        if c > 0 {
            layers.clear();
            noise.make(&mut layers, &noise.pulses(seed, c), &amplitudes, &changed);
            balance.balance(&mut layers, &early[c], 2);
        }
        // Rays do not tell their direction: late sound comes evenly from everywhere, so that the harmonics are independent and have
        // the mean power 1/(2 l + 1).
        let share = 1.0 / ((2 * directional::degree(c) + 1) as f64).sqrt();
        balance::add(&layers, |band| share * factors[band], samples);
    }
    matcher.match_bands(channels, target, FILTERS_FROM_HZ, shaper)
}
