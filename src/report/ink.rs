//! Colours of the charts by role. The drawing library writes fixed colours; each role has a reserved one that is
//! exchanged for a CSS class afterwards, so that the page's style sheet decides (light, dark, print).

use plotters::style::{Color, RGBColor, ShapeStyle};

/// Number of colours in the ramp over the bands.
pub(crate) const RAMP: usize = 10;

/// What a line or area in a chart stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Ink {
    /// Words and numbers.
    Text,
    /// Grid lines.
    Grid,
    /// Axis lines.
    Axis,
    /// The result itself.
    Level,
    /// Its standard error.
    Error,
    /// The part that arrives on deterministic paths, or the energy decay.
    Early,
    /// Intervals in which closing raises the level.
    Rise,
    /// Curves from elsewhere.
    Reference,
    /// One of the bands, 0 to [`RAMP`] - 1 from low to high frequency.
    Band(usize),
}

impl Ink {
    const ROLES: [(Ink, &'static str); 8] = [
        (Ink::Text, "text"),
        (Ink::Grid, "grid"),
        (Ink::Axis, "axis"),
        (Ink::Level, "level"),
        (Ink::Error, "error"),
        (Ink::Early, "early"),
        (Ink::Rise, "rise"),
        (Ink::Reference, "reference"),
    ];

    /// The colour of band `index` of `count`.
    pub(super) fn of_band(index: usize, count: usize) -> Ink {
        Ink::Band(if count < 2 { 0 } else { (index * (RAMP - 1) + (count - 1) / 2) / (count - 1) })
    }

    /// Name of the role in the style sheet.
    pub(super) fn name(self) -> String {
        match Ink::ROLES.iter().find(|(ink, _)| *ink == self) {
            Some((_, name)) => (*name).to_owned(),
            None => format!("band{}", self.code()),
        }
    }

    fn code(self) -> u8 {
        match self {
            // A ramp index is below RAMP.
            Ink::Band(i) => i as u8,
            role => 0x80 | role.index(),
        }
    }

    fn index(self) -> u8 {
        // There are eight roles.
        Ink::ROLES.iter().position(|(ink, _)| *ink == self).unwrap_or(0) as u8
    }

    /// The reserved colour.
    pub(super) fn color(self) -> RGBColor {
        RGBColor(0x01, self.code(), 0xD1)
    }

    /// A filled area.
    pub(super) fn fill(self) -> ShapeStyle {
        self.color().filled()
    }

    /// A line of this width in units of the drawing.
    pub(super) fn line(self, width: u32) -> ShapeStyle {
        self.color().stroke_width(width)
    }
}

/// Exchanges the reserved colours for CSS classes: `f-level` for areas, `s-level` for lines.
pub(super) fn with_classes(svg: &str) -> String {
    let roles = Ink::ROLES.iter().map(|(ink, _)| *ink).chain((0..RAMP).map(Ink::Band));
    roles.fold(svg.to_owned(), |svg, ink| {
        let RGBColor(r, g, b) = ink.color();
        let (hex, name) = (format!("#{r:02X}{g:02X}{b:02X}"), ink.name());
        svg.replace(&format!("fill=\"{hex}\""), &format!("class=\"f-{name}\""))
            .replace(&format!("stroke=\"{hex}\""), &format!("class=\"s-{name}\""))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ramp_spans_all_bands_and_ends_at_its_ends() {
        for count in 2..40 {
            assert_eq!(Ink::of_band(0, count), Ink::Band(0));
            assert_eq!(Ink::of_band(count - 1, count), Ink::Band(RAMP - 1));
        }
        assert_eq!(Ink::of_band(0, 1), Ink::Band(0));
    }

    #[test]
    fn every_role_has_a_colour_of_its_own() {
        let all: Vec<Ink> = Ink::ROLES.iter().map(|(i, _)| *i).chain((0..RAMP).map(Ink::Band)).collect();
        for (i, a) in all.iter().enumerate() {
            for b in &all[i + 1..] {
                assert_ne!(a.color(), b.color(), "{a:?} {b:?}");
                assert_ne!(a.name(), b.name());
            }
        }
    }
}
