//! Error against time, both logarithmic: one mark a method, budgets of one method joined by a line.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::charts::{FONT, draw, text_style};
use super::ink::Ink;
use crate::error::Result;

/// Errors below this many dB are drawn there.
pub(crate) const FLOOR_DB: f64 = 1e-4;

/// The marks of one method.
pub(crate) struct Marks {
    /// Its colour.
    pub(crate) ink: Ink,
    /// Its name, written beside the first mark.
    pub(crate) name: String,
    /// Time in s and error in dB of each budget.
    pub(crate) points: Vec<(f64, f64)>,
}

/// "1 µs", "10 ms": a time that is a power of ten.
fn decade_time(exponent: f64) -> String {
    let (unit, above) = match exponent {
        e if e < -6.5 => ("ns", -9.0),
        e if e < -3.5 => ("µs", -6.0),
        e if e < -0.5 => ("ms", -3.0),
        _ => ("s", 0.0),
    };
    format!("{:.0} {unit}", 10f64.powf(exponent - above))
}

/// The chart; marks of infinite error are left out. `None` if there is no other.
pub(crate) fn chart(title: &str, y_name: &str, methods: &[Marks]) -> Result<Option<String>> {
    let place = |&(time_s, error_db): &(f64, f64)| (time_s.log10(), error_db.max(FLOOR_DB).log10());
    let marks: Vec<Vec<(f64, f64)>> = methods
        .iter()
        .map(|m| m.points.iter().map(place).filter(|(x, y)| x.is_finite() && y.is_finite()).collect())
        .collect();
    let all = || marks.iter().flatten();
    if all().next().is_none() {
        return Ok(None);
    }
    let ends = |pick: fn(&(f64, f64)) -> f64| {
        all().map(pick).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let (x, y) = (ends(|p| p.0), ends(|p| p.1));
    // Whole decades, with room for the names.
    let (x, y) = ((x.0 - 0.2).floor()..(x.1 + 0.2).ceil(), (y.0 - 0.1).floor()..(y.1 + 0.2).ceil());
    let decades = |range: &std::ops::Range<f64>| (range.end - range.start) as usize + 1;
    draw(title, |area| {
        let mut chart = ChartBuilder::on(area)
            .margin_top(14)
            .margin_right(40)
            .margin_bottom(4)
            .margin_left(4)
            .x_label_area_size(84)
            .y_label_area_size(118)
            .build_cartesian_2d(x.clone(), y.clone())?;
        let whole = |v: &f64| (v - v.round()).abs() < 1e-6;
        let time = |v: &f64| if whole(v) { decade_time(v.round()) } else { String::new() };
        let error = |v: &f64| if whole(v) { format!("{}", 10f64.powi(v.round() as i32)) } else { String::new() };
        let label = text_style(Pos::new(HPos::Center, VPos::Center));
        chart
            .configure_mesh()
            .bold_line_style(Ink::Grid.line(2))
            .light_line_style(TRANSPARENT)
            .axis_style(Ink::Axis.line(2))
            .label_style(label.clone())
            .axis_desc_style(label)
            .x_desc("time per level")
            .y_desc(y_name)
            .x_labels(decades(&x))
            .y_labels(decades(&y))
            .x_label_formatter(&time)
            .y_label_formatter(&error)
            .draw()?;
        for (method, points) in methods.iter().zip(&marks) {
            chart.draw_series([PathElement::new(points.clone(), method.ink.line(4))])?;
            chart.draw_series(points.iter().map(|&at| Circle::new(at, 10, method.ink.fill())))?;
        }
        let plotting = chart.plotting_area();
        let mut taken: Vec<(i32, i32)> = Vec::new();
        for (method, points) in methods.iter().zip(&marks) {
            let Some(last) = points.last() else { continue };
            let at = plotting.map_coordinate(last);
            // Beside the mark, on the side with more room.
            let right = last.0 < 0.5 * (x.start + x.end);
            let (anchor, shift) = if right { (HPos::Left, 18) } else { (HPos::Right, -18) };
            // Names of marks close to each other go one below the other.
            let near = |y: i32| taken.iter().any(|t| (t.0 - at.0).abs() < 160 && (t.1 - y).abs() < FONT as i32);
            let mut steps = (0..6).map(|i| at.1 + i * FONT as i32 - 4);
            let y = steps.find(|y| !near(*y)).unwrap_or(at.1);
            taken.push((at.0, y));
            area.draw_text(&method.name, &text_style(Pos::new(anchor, VPos::Bottom)), (at.0 + shift, y))?;
        }
        Ok(())
    })
    .map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_spelt_in_the_unit_that_fits() {
        let spelt: Vec<String> = [-7.0, -6.0, -4.0, -3.0, -1.0, 0.0, 1.0].into_iter().map(decade_time).collect();
        assert_eq!(spelt, ["100 ns", "1 µs", "100 µs", "1 ms", "100 ms", "1 s", "10 s"]);
    }

    #[test]
    fn silence_has_no_place_on_the_chart() {
        let marks = |error_db| [Marks { ink: Ink::Level, name: "a".into(), points: vec![(1e-6, error_db)] }];
        assert!(chart("t", "e", &marks(f64::INFINITY)).unwrap().is_none());
        assert!(chart("t", "e", &marks(0.0)).unwrap().unwrap().contains("<circle"));
    }
}
