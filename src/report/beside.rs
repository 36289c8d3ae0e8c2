//! The levels of a sweep beside the reference curves of its room file.

use super::series::{Rise, Series, SeriesPoint, rises};
use super::{ReferenceCurve, Swept};
use crate::probe::BandLevel;
use crate::scene::Reference;

/// Values of the swept parameter closer than this share of the range are the same value.
const SAME_VALUE: f64 = 1e-9;

/// One series of a sweep beside the reference curve of the same source, probe and band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison<'a> {
    /// The levels of this run.
    pub series: &'a Series,
    /// The levels from elsewhere.
    pub reference: &'a ReferenceCurve,
    /// Largest rise of this run while the value falls, at the values that both have.
    pub rise: Option<Rise>,
    /// Largest rise of the reference, at the same values.
    pub reference_rise: Option<Rise>,
    /// Number of values that both have with finite levels.
    pub common: usize,
    /// Median of the absolute difference in dB at these values.
    pub median_db: f64,
    /// (value, this run minus the reference in dB) where the difference is largest.
    pub largest: Option<(f64, f64)>,
}

impl ReferenceCurve {
    /// The curves of a reference table, one a source, probe and band.
    pub fn collect(table: &Reference) -> Vec<ReferenceCurve> {
        let mut curves: Vec<ReferenceCurve> = Vec::new();
        for row in &table.rows {
            let point = (row.value, row.level_db);
            let known =
                curves.iter_mut().find(|c| c.source == row.source && c.probe == row.probe && c.band_hz == row.band_hz);
            match known {
                Some(curve) => curve.points.push(point),
                None => curves.push(ReferenceCurve {
                    label: table.file.display().to_string(),
                    source: row.source.clone(),
                    probe: row.probe.clone(),
                    band_hz: row.band_hz,
                    points: vec![point],
                }),
            }
        }
        for curve in &mut curves {
            curve.points.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        curves
    }
}

/// A level from elsewhere as a point of a series, without error.
fn exact(band_hz: f64, value: f64, level_db: f64) -> SeriesPoint {
    let intensity = 10f64.powf(level_db / 10.0);
    SeriesPoint {
        value,
        level: BandLevel { band_hz, intensity, intensity_error: 0.0, early_share: 1.0 },
        spl_1m_db: None,
    }
}

/// Every series of `swept` that has a reference curve, beside it.
pub fn comparisons(swept: &Swept) -> Vec<Comparison<'_>> {
    let pairs = swept.series.iter().flat_map(|s| {
        let same = |r: &&ReferenceCurve| r.source == s.source && r.probe == s.probe && r.band_hz == s.band_hz;
        swept.references.iter().filter(same).map(move |r| (s, r))
    });
    pairs.map(|(series, reference)| compare(series, reference)).collect()
}

fn compare<'a>(series: &'a Series, reference: &'a ReferenceCurve) -> Comparison<'a> {
    let range = reference.points.iter().map(|p| p.0.abs()).fold(0.0, f64::max);
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for point in &series.points {
        let same = |p: &&(f64, f64)| (p.0 - point.value).abs() <= SAME_VALUE * range;
        let Some(&(_, level_db)) = reference.points.iter().find(same) else { continue };
        if level_db.is_finite() && point.level.level_db().is_finite() {
            ours.push(*point);
            theirs.push(exact(reference.band_hz, point.value, level_db));
        }
    }
    let difference = |(a, b): (&SeriesPoint, &SeriesPoint)| (a.value, a.level.level_db() - b.level.level_db());
    let mut differences: Vec<(f64, f64)> = ours.iter().zip(&theirs).map(difference).collect();
    differences.sort_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let largest = |points: &[SeriesPoint]| rises(points).into_iter().max_by(|a, b| a.rise_db.total_cmp(&b.rise_db));
    Comparison {
        series,
        reference,
        rise: largest(&ours),
        reference_rise: largest(&theirs),
        common: differences.len(),
        median_db: differences.get(differences.len() / 2).map_or(0.0, |d| d.1.abs()),
        largest: differences.last().copied(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ReferenceRow;

    fn row(value: f64, level_db: f64) -> ReferenceRow {
        ReferenceRow { source: "s".into(), probe: "p".into(), band_hz: 500.0, value, level_db }
    }

    #[test]
    fn only_values_that_both_have_are_compared() {
        let rows = vec![row(0.4, -7.0), row(0.0, f64::NEG_INFINITY), row(0.2, -6.0), row(0.3, -6.5)];
        let curves = ReferenceCurve::collect(&Reference { file: "exact.csv".into(), rows });
        assert_eq!(curves.len(), 1);
        assert_eq!(curves[0].points.iter().map(|p| p.0).collect::<Vec<_>>(), [0.0, 0.2, 0.3, 0.4]);
        let ours = [(0.0, f64::NEG_INFINITY), (0.1, -9.0), (0.1 + 0.1, -6.1), (0.4, -6.7)];
        let points = ours.iter().map(|&(value, db)| exact(500.0, value, db)).collect();
        let series = Series { source: "s".into(), probe: "p".into(), band_hz: 500.0, points };
        let found = compare(&series, &curves[0]);
        assert_eq!(found.common, 2);
        let (value, difference) = found.largest.unwrap();
        assert!(value == 0.4 && (difference - 0.3).abs() < 1e-9, "{difference}");
        let rise = |r: Option<Rise>| r.unwrap().rise_db;
        assert!((rise(found.rise) - 0.6).abs() < 1e-9 && (rise(found.reference_rise) - 1.0).abs() < 1e-9);
    }
}
