//! The charts of the report as inline SVG, coloured by the page's style sheet (see [`super::ink`]).

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::ReferenceCurve;
use super::ink::{Ink, with_classes};
use super::notation;
use super::series::{Rise, SeriesPoint};
use crate::error::{Error, Result};
use crate::probe::BandLevel;
use crate::response::Response;
use crate::scene::Band;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = std::result::Result<(), Box<dyn std::error::Error>>;

/// The library places everything on whole units; drawing twice as large makes them half a pixel.
const WIDTH: u32 = 820;
const HEIGHT: u32 = 500;
pub(super) const FONT: u32 = 29;

/// Levels lower than this below the highest one are cut off at the bottom of a chart, in dB.
const SPAN_DB: f64 = 60.0;

/// An early part more than this below the lowest level is not shown, in dB.
const EARLY_SPAN_DB: f64 = 15.0;

pub(super) fn draw(label: &str, content: impl FnOnce(&Area) -> Drawn) -> Result<String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        content(&area).map_err(|e| Error::Run(format!("cannot draw \"{label}\": {e}")))?;
        area.present().map_err(|e| Error::Run(format!("cannot draw \"{label}\": {e}")))?;
    }
    // Inside HTML the namespace is implied, and the size comes from the style sheet.
    let fixed = format!("<svg width=\"{WIDTH}\" height=\"{HEIGHT}\"");
    let label = notation::escaped(label);
    let svg = svg.replacen(&fixed, &format!("<svg role=\"img\" aria-label=\"{label}\""), 1).replacen(
        " xmlns=\"http://www.w3.org/2000/svg\"",
        "",
        1,
    );
    Ok(with_classes(&svg))
}

pub(super) fn text_style(anchor: Pos) -> TextStyle<'static> {
    ("sans-serif", FONT).into_font().color(&Ink::Text.color()).pos(anchor)
}

/// Limits of a level axis around the finite ones of `levels_db`; `None` if there are none.
fn level_range(levels_db: impl Iterator<Item = f64>, margin_db: f64) -> Option<Range<f64>> {
    let (low, high) = levels_db
        .filter(|l| l.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), l| (low.min(l), high.max(l)));
    if low > high {
        return None;
    }
    Some(rounded(low.max(high - SPAN_DB), high, margin_db))
}

fn rounded(low: f64, high: f64, margin_db: f64) -> Range<f64> {
    let step = if high - low > 20.0 { 5.0 } else { 1.0 };
    ((low - margin_db) / step).floor() * step..((high + margin_db) / step).ceil() * step
}

/// Limits of the level axis of a sweep. The few lowest levels (a door all but closed) may lie far below the others and
/// would flatten the rest: the axis spans 1.6 times what nine tenths of the levels need, at least 6 dB.
fn sweep_range(levels_db: impl Iterator<Item = f64>) -> Option<Range<f64>> {
    let mut levels: Vec<f64> = levels_db.filter(|l| l.is_finite()).collect();
    levels.sort_by(f64::total_cmp);
    let (&low, &high) = (levels.first()?, levels.last()?);
    let usual = levels[levels.len() / 10];
    let low = low.max(high - (1.6 * (high - usual)).max(6.0));
    // Room for the words above the highest level.
    Some(rounded(low, high + 0.12 * (high - low), 0.5))
}

/// Sets up axes with grid; `x_ticks` overrides the positions and texts of the ticks below.
fn axes<'a, 'b>(
    area: &'a Area<'b>,
    x: Range<f64>,
    y: Range<f64>,
    names: [&str; 2],
    x_format: &dyn Fn(&f64) -> String,
    grid_x: bool,
) -> std::result::Result<Chart<'a, 'b>, Box<dyn std::error::Error>>
where
    'b: 'a,
{
    let mut chart = ChartBuilder::on(area)
        .margin_top(14)
        .margin_right(26)
        .margin_bottom(4)
        .margin_left(4)
        .x_label_area_size(84)
        .y_label_area_size(118)
        .build_cartesian_2d(x, y)?;
    let y_format = |v: &f64| notation::trimmed(*v, 6).replace('-', "−");
    let label = text_style(Pos::new(HPos::Center, VPos::Center));
    let mut mesh = chart.configure_mesh();
    mesh.bold_line_style(Ink::Grid.line(2))
        .light_line_style(TRANSPARENT)
        .axis_style(Ink::Axis.line(2))
        .label_style(label.clone())
        .axis_desc_style(label)
        .x_desc(names[0])
        .y_desc(names[1])
        .x_labels(7)
        .y_labels(6)
        .x_label_formatter(x_format)
        .y_label_formatter(&y_format);
    if !grid_x {
        mesh.disable_x_mesh();
    }
    mesh.draw()?;
    Ok(chart)
}

fn plain(v: &f64) -> String {
    notation::trimmed(*v, 6)
}

/// Left and right end of a band's bar on the logarithmic (base 2) axis; a tone gets a sixth of an octave.
fn bar(band: &Band) -> (f64, f64) {
    let (low, high) = (band.low_hz.log2(), band.high_hz.log2());
    if high > low { (low, high) } else { (low - 1.0 / 12.0, high + 1.0 / 12.0) }
}

/// Level of the deterministic paths alone in dB.
fn early_db(level: &BandLevel) -> f64 {
    BandLevel { intensity: level.intensity * level.early_share, ..*level }.level_db()
}

/// Band levels of one pair as bars over a logarithmic frequency axis, with standard errors; `None` if nothing arrives
/// in any band.
pub(super) fn levels(title: &str, bands: &[Band], levels: &[BandLevel]) -> Result<Option<String>> {
    let bars: Vec<((f64, f64), &BandLevel)> = bands.iter().map(bar).zip(levels).collect();
    let lowest = levels.iter().map(BandLevel::level_db).filter(|l| l.is_finite()).fold(f64::INFINITY, f64::min);
    // The early part is shown as far as it does not flatten the rest.
    let early = levels.iter().map(|l| early_db(l).max(lowest - EARLY_SPAN_DB));
    let range = level_range(levels.iter().map(BandLevel::level_db).chain(early.filter(|_| lowest.is_finite())), 3.0);
    let (Some(y), Some(first), Some(last)) = (range, bars.first(), bars.last()) else { return Ok(None) };
    let x = first.0.0 - 0.15..last.0.1 + 0.15;
    let svg = draw(title, |area| {
        let none = |_: &f64| String::new();
        let mut chart = axes(area, x, y.clone(), ["", "level re 1 m (dB)"], &none, false)?;
        let visible = |db: f64| db.clamp(y.start, y.end);
        for ((low, high), level) in &bars {
            let gap = 0.06 * (high - low);
            let (low, high, db) = (low + gap, high - gap, level.level_db());
            if !db.is_finite() {
                continue;
            }
            let top = visible(db);
            chart.draw_series([Rectangle::new([(low, y.start), (high, top)], Ink::Level.fill())])?;
            chart.draw_series([PathElement::new([(low, top), (high, top)], Ink::Level.line(4))])?;
            let early = early_db(level);
            if early > y.start && early < db - 0.05 {
                chart.draw_series([PathElement::new([(low, early), (high, early)], Ink::Early.line(4))])?;
            }
            let error = level.std_error_db();
            if error > 0.0 && error.is_finite() {
                let centre = 0.5 * (low + high);
                let ends = [(centre, visible(db - error)), (centre, visible(db + error))];
                chart.draw_series([PathElement::new(ends, Ink::Error.line(4))])?;
            }
        }
        // Ticks at the band centres, thinned out so that the words do not touch.
        let every = bars.len().div_ceil(11);
        let plotting = chart.plotting_area();
        for (i, ((low, high), level)) in bars.iter().enumerate() {
            let centre = 0.5 * (low + high);
            let below = plotting.map_coordinate(&(centre, y.start));
            if i % every == 0 {
                let style = text_style(Pos::new(HPos::Center, VPos::Top));
                area.draw_text(&notation::band_tick(level.band_hz), &style, (below.0, below.1 + 12))?;
            }
            let db = level.level_db();
            if bars.len() <= 11 && db.is_finite() {
                let error = Some(level.std_error_db()).filter(|e| e.is_finite()).unwrap_or(0.0);
                let above = plotting.map_coordinate(&(centre, visible(db + error)));
                let style = text_style(Pos::new(HPos::Center, VPos::Bottom));
                let words = notation::level(db, 1).replace('-', "−");
                area.draw_text(&words, &style, (above.0, above.1 - 8))?;
            }
        }
        let middle = plotting.get_x_axis_pixel_range();
        let style = text_style(Pos::new(HPos::Center, VPos::Bottom));
        area.draw_text("band centre (Hz)", &style, ((middle.start + middle.end) / 2, HEIGHT as i32 - 8))?;
        Ok(())
    })?;
    Ok(Some(svg))
}

/// Smallest and largest sample of each of at most `columns` equal pieces, with the index of the piece's first sample.
fn envelope(samples: &[f32], columns: usize) -> Vec<(usize, f64, f64)> {
    let piece = samples.len().div_ceil(columns).max(1);
    samples
        .chunks(piece)
        .enumerate()
        .map(|(i, c)| {
            let (low, high) = c.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &s| (l.min(s), h.max(s)));
            (i * piece, f64::from(low), f64::from(high))
        })
        .collect()
}

/// Time axis in ms below 1 s, in s above: (factor from seconds, name).
fn time_axis(length_s: f64) -> (f64, &'static str) {
    if length_s < 1.0 { (1e3, "time (ms)") } else { (1.0, "time (s)") }
}

/// Pressure over time; `None` for a silent response.
pub(super) fn waveform(title: &str, response: &Response) -> Result<Option<String>> {
    let peak = response.samples.iter().fold(0.0f32, |peak, s| peak.max(s.abs()));
    if !(peak > 0.0 && peak.is_finite()) || response.sample_rate_hz == 0 {
        return Ok(None);
    }
    let rate = f64::from(response.sample_rate_hz);
    let length_s = response.samples.len() as f64 / rate;
    let (factor, name) = time_axis(length_s);
    let limit = 1.08 * f64::from(peak);
    draw(title, |area| {
        let names = [name, "pressure re 1 m"];
        let mut chart = axes(area, 0.0..length_s * factor, -limit..limit, names, &plain, true)?;
        let points = envelope(&response.samples, WIDTH as usize).into_iter().flat_map(|(i, low, high)| {
            let t = i as f64 / rate * factor;
            [(t, low), (t, high)]
        });
        chart.draw_series([PathElement::new(points.collect::<Vec<_>>(), Ink::Level.line(2))])?;
        Ok(())
    })
    .map(Some)
}

/// Squared pressure over time in dB re its peak, with the backward-integrated decay; `None` for a silent response.
pub(super) fn energy_time_curve(title: &str, response: &Response) -> Result<Option<String>> {
    let total: f64 = response.samples.iter().map(|&s| f64::from(s).powi(2)).sum();
    if !(total > 0.0 && total.is_finite()) || response.sample_rate_hz == 0 {
        return Ok(None);
    }
    let rate = f64::from(response.sample_rate_hz);
    let length_s = response.samples.len() as f64 / rate;
    let (factor, name) = time_axis(length_s);
    let columns = envelope(&response.samples, WIDTH as usize / 2);
    let peak = columns.iter().fold(0.0f64, |peak, (_, low, high)| peak.max(low.abs()).max(high.abs()));
    let decibels = |ratio: f64| (10.0 * ratio.log10()).max(-SPAN_DB);
    draw(title, |area| {
        let names = [name, "re maximum (dB)"];
        let mut chart = axes(area, 0.0..length_s * factor, -SPAN_DB..3.0, names, &plain, true)?;
        let squares = columns
            .iter()
            .map(|&(i, low, high)| (i as f64 / rate * factor, decibels((low.abs().max(high.abs()) / peak).powi(2))));
        chart.draw_series([PathElement::new(squares.collect::<Vec<_>>(), Ink::Level.line(2))])?;
        let mut remaining = total;
        let mut decay = Vec::with_capacity(columns.len());
        for (i, sample) in response.samples.iter().enumerate() {
            if decay.len() < columns.len() && i == columns[decay.len()].0 {
                decay.push((i as f64 / rate * factor, decibels(remaining.max(0.0) / total)));
            }
            remaining -= f64::from(*sample).powi(2);
        }
        let visible = decay.into_iter().take_while(|(_, db)| *db > -SPAN_DB);
        chart.draw_series([PathElement::new(visible.collect::<Vec<_>>(), Ink::Early.line(5))])?;
        Ok(())
    })
    .map(Some)
}

/// Stretches of points whose level is finite.
fn finite_runs(points: &[SeriesPoint]) -> impl Iterator<Item = &[SeriesPoint]> {
    points.split(|p| !p.level.level_db().is_finite()).filter(|run| !run.is_empty())
}

/// The parts of a line that are not below `floor`, cut where it crosses it.
fn above(line: &[(f64, f64)], floor: f64) -> Vec<Vec<(f64, f64)>> {
    let mut parts: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    let mut previous: Option<(f64, f64)> = None;
    for &(x, y) in line {
        let crossing = previous.filter(|p| (p.1 < floor) != (y < floor)).map(|(x0, y0)| {
            // One of the two is below and the other is not, so that they differ.
            (x0 + (x - x0) * (floor - y0) / (y - y0), floor)
        });
        if let Some(part) = parts.last_mut() {
            part.extend(crossing);
            if y >= floor {
                part.push((x, y));
            } else {
                parts.push(Vec::new());
            }
        }
        previous = Some((x, y));
    }
    parts.retain(|part| part.len() > 1);
    parts
}

/// Limits of the axis of the swept value, a little wider than the values.
fn value_range(points: &[SeriesPoint]) -> Option<Range<f64>> {
    let (low, high) = (points.first()?.value, points.last()?.value);
    let margin = if high > low { 0.01 * (high - low) } else { 0.5 };
    Some(low - margin..high + margin)
}

/// Limits of the level axis for the points of a series and the curves drawn over them.
fn series_range(points: &[SeriesPoint], references: &[&ReferenceCurve]) -> Option<Range<f64>> {
    let own = points.iter().map(|p| p.level.level_db());
    sweep_range(own.chain(references.iter().flat_map(|r| r.points.iter().map(|p| p.1))))
}

/// Whether the chart of [`sweep`] leaves out levels that are too low for its axis.
pub(super) fn sweep_cuts_levels_off(points: &[SeriesPoint], references: &[&ReferenceCurve]) -> bool {
    series_range(points, references)
        .is_some_and(|y| points.iter().any(|p| (f64::MIN..y.start).contains(&p.level.level_db())))
}

/// Level against the swept value in one band, with the intervals of `rises` shaded and other curves dashed; `None` if
/// nothing arrives anywhere.
pub(super) fn sweep(
    title: &str,
    x_name: &str,
    points: &[SeriesPoint],
    rises: &[Rise],
    references: &[&ReferenceCurve],
) -> Result<Option<String>> {
    let (Some(y), Some(x)) = (series_range(points, references), value_range(points)) else { return Ok(None) };
    draw(title, |area| {
        let mut chart = axes(area, x.clone(), y.clone(), [x_name, "level re 1 m (dB)"], &plain, false)?;
        let visible = |db: f64| db.clamp(y.start, y.end);
        for rise in rises {
            let corners = [(rise.value_low, y.start), (rise.value_high, y.end)];
            chart.draw_series([Rectangle::new(corners, Ink::Rise.fill())])?;
        }
        for run in finite_runs(points) {
            let ends = |sign: f64| {
                move |p: &SeriesPoint| {
                    let error = Some(p.level.std_error_db()).filter(|e| e.is_finite()).unwrap_or(0.0);
                    (p.value, visible(p.level.level_db() + sign * error))
                }
            };
            if run.iter().any(|p| p.level.std_error_db() > 0.01) {
                let outline: Vec<(f64, f64)> =
                    run.iter().map(ends(1.0)).chain(run.iter().rev().map(ends(-1.0))).collect();
                chart.draw_series([Polygon::new(outline, Ink::Error.fill())])?;
            }
            let line: Vec<(f64, f64)> = run.iter().map(|p| (p.value, p.level.level_db())).collect();
            chart.draw_series(above(&line, y.start).into_iter().map(|l| PathElement::new(l, Ink::Level.line(5))))?;
            if points.len() <= 61 && references.is_empty() {
                let dots = line.iter().filter(|(_, db)| *db >= y.start);
                chart.draw_series(dots.map(|&at| Circle::new(at, 6, Ink::Level.fill())))?;
            }
        }
        // Last, so that it is seen where both agree.
        for curve in references {
            let inside = curve.points.iter().filter(|(v, db)| x.contains(v) && db.is_finite());
            let line: Vec<(f64, f64)> = inside.copied().collect();
            chart
                .draw_series(above(&line, y.start).into_iter().map(|l| PathElement::new(l, Ink::Reference.line(4))))?;
        }
        let plotting = chart.plotting_area();
        let mut labelled: Vec<&Rise> = rises.iter().filter(|r| r.rise_db.is_finite() && r.rise_db >= 0.1).collect();
        labelled.sort_by(|a, b| b.rise_db.total_cmp(&a.rise_db));
        let mut taken: Vec<i32> = Vec::new();
        for rise in labelled {
            let at = plotting.map_coordinate(&(0.5 * (rise.value_low + rise.value_high), y.end));
            if taken.iter().all(|other| (other - at.0).abs() > 4 * FONT as i32) {
                let style = text_style(Pos::new(HPos::Center, VPos::Top));
                area.draw_text(&format!("{:.1} dB", rise.rise_db), &style, (at.0, at.1 + 8))?;
                taken.push(at.0);
            }
        }
        Ok(())
    })
    .map(Some)
}

/// Level against the swept value, all bands of one pair in one chart; `None` if nothing arrives anywhere.
pub(super) fn sweep_overview(title: &str, x_name: &str, bands: &[(Ink, &[SeriesPoint])]) -> Result<Option<String>> {
    let levels = bands.iter().flat_map(|(_, points)| points.iter().map(|p| p.level.level_db()));
    let x = bands.first().and_then(|(_, points)| value_range(points));
    let (Some(y), Some(x)) = (sweep_range(levels), x) else { return Ok(None) };
    draw(title, |area| {
        let mut chart = axes(area, x, y.clone(), [x_name, "level re 1 m (dB)"], &plain, true)?;
        for (ink, points) in bands {
            for run in finite_runs(points) {
                let line: Vec<(f64, f64)> = run.iter().map(|p| (p.value, p.level.level_db())).collect();
                chart.draw_series(above(&line, y.start).into_iter().map(|l| PathElement::new(l, ink.line(4))))?;
            }
        }
        Ok(())
    })
    .map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_cut_where_it_crosses_the_floor() {
        let line = [(0.0, -4.0), (1.0, 4.0), (2.0, 2.0), (3.0, -2.0), (4.0, -3.0), (5.0, 3.0)];
        let parts = above(&line, 0.0);
        assert_eq!(parts, [vec![(0.5, 0.0), (1.0, 4.0), (2.0, 2.0), (2.5, 0.0)], vec![(4.5, 0.0), (5.0, 3.0)]]);
        assert_eq!(above(&[(0.0, -1.0)], 0.0), Vec::<Vec<_>>::new());
    }

    #[test]
    fn one_very_low_level_does_not_flatten_a_sweep() {
        let levels = std::iter::once(-60.0).chain((0..40).map(|i| -8.0 + 0.2 * f64::from(i)));
        let range = sweep_range(levels).unwrap();
        assert!(range.start > -16.0 && range.start < -8.0 && range.end >= -0.2, "{range:?}");
        assert_eq!(sweep_range([f64::NEG_INFINITY].into_iter()), None);
    }

    #[test]
    fn the_envelope_keeps_every_peak() {
        let mut samples = vec![0.0f32; 10_001];
        samples[7_777] = -3.0;
        let columns = envelope(&samples, 100);
        assert!(columns.len() <= 100);
        assert_eq!(columns.iter().map(|c| c.1).fold(0.0, f64::min), -3.0);
    }
}
