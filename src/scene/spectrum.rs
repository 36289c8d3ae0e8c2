//! A quantity that may depend on frequency, in the three forms of the room file.

use std::fmt;
use std::ops::RangeInclusive;

use serde::Deserialize;
use serde::de::{Deserializer, MapAccess, SeqAccess, Visitor};
use serde_spanned::Spanned;

use super::Band;
use super::locate::Locator;
use crate::error::Result;

/// The octave bands of a list in a material, in Hz.
pub(super) const LIST_HZ: [f64; 8] = [63.0, 125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0];

/// One number, one number an octave band, or a table from frequency to number.
#[derive(Debug, Clone)]
pub enum Spectrum {
    /// The same at every frequency.
    Constant(f64),
    /// A list; what its places mean is for the key to say.
    List(Vec<Spanned<f64>>),
    /// Frequency in Hz (as typed) and value.
    Table(Vec<(Spanned<String>, Spanned<f64>)>),
}

impl<'de> Deserialize<'de> for Spectrum {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        deserializer.deserialize_any(SpectrumVisitor)
    }
}

struct SpectrumVisitor;

impl<'de> Visitor<'de> for SpectrumVisitor {
    type Value = Spectrum;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a number, a list of numbers, or a table such as { 125 = 0.02, 1000 = 0.04 }")
    }

    fn visit_f64<E>(self, value: f64) -> std::result::Result<Spectrum, E> {
        Ok(Spectrum::Constant(value))
    }

    fn visit_i64<E>(self, value: i64) -> std::result::Result<Spectrum, E> {
        Ok(Spectrum::Constant(value as f64))
    }

    fn visit_u64<E>(self, value: u64) -> std::result::Result<Spectrum, E> {
        Ok(Spectrum::Constant(value as f64))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<Spectrum, A::Error> {
        let mut list = Vec::new();
        while let Some(value) = seq.next_element()? {
            list.push(value);
        }
        Ok(Spectrum::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> std::result::Result<Spectrum, A::Error> {
        let mut table = Vec::new();
        while let Some(entry) = map.next_entry()? {
            table.push(entry);
        }
        Ok(Spectrum::Table(table))
    }
}

/// What a spectrum means and may be, for its error messages.
#[derive(Debug, Clone)]
pub(super) struct Quantity<'a> {
    /// The key, as "absorption".
    pub(super) name: &'a str,
    /// What each value may be.
    pub(super) range: RangeInclusive<f64>,
    /// Said when a value lies outside.
    pub(super) hint: &'a str,
}

impl Spectrum {
    /// One value a band: lists stand for the octaves of [`LIST_HZ`]; between given frequencies the value is
    /// interpolated linearly on the logarithm of frequency, beyond the ends it stays constant.
    ///
    /// # Errors
    /// A value outside the allowed range, a list of another length, a frequency that is none or is given twice.
    pub(super) fn in_bands(
        spectrum: &Spanned<Spectrum>,
        bands: &[Band],
        quantity: &Quantity<'_>,
        at: &Locator<'_>,
    ) -> Result<Vec<f64>> {
        let points = match spectrum.get_ref() {
            Spectrum::Constant(value) => {
                check_value(*value, spectrum.span(), quantity, at)?;
                return Ok(vec![*value; bands.len()]);
            }
            Spectrum::List(list) => {
                if list.len() != LIST_HZ.len() {
                    return Err(at.error(
                        spectrum.span(),
                        format!(
                            "{} has {} values, must have one number, or 8: one an octave band from 63 to 8000 Hz",
                            quantity.name,
                            list.len()
                        ),
                        "give single frequencies as a table: { 125 = 0.02, 1000 = 0.04 }",
                    ));
                }
                let mut points = Vec::with_capacity(LIST_HZ.len());
                for (frequency, value) in LIST_HZ.iter().zip(list) {
                    check_value(*value.get_ref(), value.span(), quantity, at)?;
                    points.push((frequency.ln(), *value.get_ref()));
                }
                points
            }
            Spectrum::Table(table) => table_points(table, spectrum, quantity, at)?,
        };
        Ok(bands.iter().map(|band| interpolate(&points, band.nominal_hz.ln())).collect())
    }
}

fn table_points(
    table: &[(Spanned<String>, Spanned<f64>)],
    spectrum: &Spanned<Spectrum>,
    quantity: &Quantity<'_>,
    at: &Locator<'_>,
) -> Result<Vec<(f64, f64)>> {
    let mut points: Vec<(f64, f64)> = Vec::with_capacity(table.len());
    for (key, value) in table {
        let frequency = key.get_ref().parse::<f64>().ok().filter(|f| f.is_finite() && *f > 0.0);
        let Some(frequency) = frequency else {
            return Err(at.error(
                key.span(),
                format!("`{}` is not a frequency in Hz", key.get_ref()),
                "as { 125 = 0.02, 1000 = 0.04 }, with quotes round a fraction: { \"31.5\" = 0.02 }",
            ));
        };
        check_value(*value.get_ref(), value.span(), quantity, at)?;
        points.push((frequency.ln(), *value.get_ref()));
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    if points.is_empty() {
        return Err(at.error(
            spectrum.span(),
            format!("{} is an empty table, must have at least one frequency", quantity.name),
            "as { 125 = 0.02, 1000 = 0.04 }",
        ));
    }
    if points.windows(2).any(|pair| pair[0].0 == pair[1].0) {
        return Err(at.error(spectrum.span(), format!("{} gives a frequency twice", quantity.name), ""));
    }
    Ok(points)
}

fn check_value(value: f64, span: std::ops::Range<usize>, quantity: &Quantity<'_>, at: &Locator<'_>) -> Result<()> {
    if quantity.range.contains(&value) {
        return Ok(());
    }
    let (low, high) = (quantity.range.start(), quantity.range.end());
    Err(at.error(span, format!("{} is {value}, must lie in {low}..={high}", quantity.name), quantity.hint))
}

/// Piecewise linear through ascending points, constant beyond the ends.
fn interpolate(points: &[(f64, f64)], x: f64) -> f64 {
    let after = points.partition_point(|(px, _)| *px < x);
    match (after.checked_sub(1).and_then(|before| points.get(before)), points.get(after)) {
        (Some((x0, y0)), Some((x1, y1))) => {
            let t = (x - x0) / (x1 - x0);
            y0 * (1.0 - t) + y1 * t
        }
        (Some((_, y)), None) | (None, Some((_, y))) => *y,
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_is_linear_on_the_logarithm_of_frequency_and_constant_outside() {
        let points = [(125f64.ln(), 0.1), (500f64.ln(), 0.3)];
        let at = |f: f64| interpolate(&points, f.ln());
        // 250 Hz is half way between 125 and 500 Hz on a logarithmic scale; rounding only.
        assert!((at(250.0) - 0.2).abs() < 1e-12);
        assert!((at(125.0) - 0.1).abs() < 1e-12 && (at(500.0) - 0.3).abs() < 1e-12);
        assert_eq!(at(63.0), 0.1);
        assert_eq!(at(8000.0), 0.3);
    }
}
