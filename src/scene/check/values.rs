//! Single values: numbers in limits, choices, points, directions, names.

use std::collections::BTreeMap;
use std::ops::Range;

use glam::DVec3;
use serde_spanned::Spanned;

use crate::error::Result;
use crate::scene::locate::{Locator, hint_for};

/// Largest coordinate in m: far beyond every room, and small enough for lengths to keep a micrometre.
pub(super) const FARTHEST_M: f64 = 1e6;

/// What a number may be.
#[derive(Debug, Clone, Copy)]
pub(super) enum Limits {
    /// From the first to the second, both included.
    Within(f64, f64),
    /// Greater than 0 and up to the given.
    PositiveUpTo(f64),
}

/// A finite number within limits.
pub(super) fn number(value: &Spanned<f64>, name: &str, limits: Limits, hint: &str, at: &Locator<'_>) -> Result<f64> {
    let number = *value.get_ref();
    let (good, allowed) = match limits {
        Limits::Within(low, high) => ((low..=high).contains(&number), format!("must lie in {low}..={high}")),
        Limits::PositiveUpTo(high) => {
            (number > 0.0 && number <= high, format!("must be greater than 0 and at most {high}"))
        }
    };
    if good { Ok(number) } else { Err(at.error(value.span(), format!("{name} is {number}, {allowed}"), hint)) }
}

/// As [`number`], with a default where nothing is given.
pub(super) fn number_or(
    value: Option<&Spanned<f64>>,
    default: f64,
    name: &str,
    limits: Limits,
    hint: &str,
    at: &Locator<'_>,
) -> Result<f64> {
    value.map_or(Ok(default), |value| number(value, name, limits, hint, at))
}

/// One of several words.
pub(super) fn choice<T: Copy>(
    value: &Spanned<String>,
    name: &str,
    choices: &[(&'static str, T)],
    at: &Locator<'_>,
) -> Result<T> {
    if let Some((_, meaning)) = choices.iter().find(|(word, _)| word == value.get_ref()) {
        return Ok(*meaning);
    }
    let words: Vec<String> = choices.iter().map(|(word, _)| format!("\"{word}\"")).collect();
    let allowed = match words.as_slice() {
        [only] => format!("must be {only}"),
        [most @ .., last] => format!("must be {} or {last}", most.join(", ")),
        [] => String::new(),
    };
    let near = crate::scene::locate::nearest(value.get_ref(), choices.iter().map(|(word, _)| *word));
    let hint = near.map(|word| format!("did you mean \"{word}\"?")).unwrap_or_default();
    Err(at.error(value.span(), format!("{name} is \"{}\", {allowed}", value.get_ref()), hint))
}

/// As [`choice`], with a default where nothing is given.
pub(super) fn choice_or<T: Copy>(
    value: Option<&Spanned<String>>,
    default: T,
    name: &str,
    choices: &[(&'static str, T)],
    at: &Locator<'_>,
) -> Result<T> {
    value.map_or(Ok(default), |value| choice(value, name, choices, at))
}

/// A point in m.
pub(super) fn point(value: &Spanned<[f64; 3]>, name: &str, at: &Locator<'_>) -> Result<DVec3> {
    let point = DVec3::from_array(*value.get_ref());
    if point.is_finite() && point.abs().max_element() <= FARTHEST_M {
        return Ok(point);
    }
    let [x, y, z] = *value.get_ref();
    Err(at.error(
        value.span(),
        format!("{name} is [{x}, {y}, {z}], each coordinate must be finite and within {FARTHEST_M} m of the origin"),
        "lengths are in metres",
    ))
}

/// A direction of any length, as a unit vector.
pub(super) fn direction(value: &Spanned<[f64; 3]>, name: &str, at: &Locator<'_>) -> Result<DVec3> {
    let vector = DVec3::from_array(*value.get_ref());
    // Scaled first, so that neither tiny nor huge components are lost in the square.
    let largest = vector.abs().max_element();
    let unit = if largest > 0.0 && largest.is_finite() { (vector / largest).try_normalize() } else { None };
    unit.filter(|unit| unit.is_finite()).ok_or_else(|| {
        let [x, y, z] = *value.get_ref();
        at.error(
            value.span(),
            format!("{name} is [{x}, {y}, {z}], must be finite and not zero"),
            "as [0, 0, 1]; its length does not matter",
        )
    })
}

/// The names of one section, each once.
#[derive(Debug)]
pub(super) struct Names<'a> {
    what: &'static str,
    at: &'a Locator<'a>,
    seen: BTreeMap<String, Range<usize>>,
}

impl<'a> Names<'a> {
    /// No names yet; `what` is "box", "wall", ...
    pub(super) fn new(what: &'static str, at: &'a Locator<'a>) -> Self {
        Self { what, at, seen: BTreeMap::new() }
    }

    /// Adds a name, which must be new and fit for a file name.
    pub(super) fn add(&mut self, name: &Spanned<String>) -> Result<String> {
        let text = name.get_ref();
        let wrong =
            |message: String| Err(self.at.error(name.span(), message, "letters, digits, - and _ are always right"));
        if text.is_empty() || text.chars().count() > 64 {
            return wrong(format!("a {} name must have 1 to 64 characters", self.what));
        }
        if let Some(bad) = text.chars().find(|c| c.is_control() || "/\\:*?\"<>|=".contains(*c)) {
            return wrong(format!(
                "the {} name {text:?} has the character {bad:?}, which cannot stand in a file name",
                self.what
            ));
        }
        if text.starts_with(['.', ' ']) || text.ends_with(['.', ' ']) {
            return wrong(format!("the {} name {text:?} must not begin or end with a dot or a space", self.what));
        }
        if let Some(first) = self.seen.get(text) {
            let line = self.at.place(first.start).line;
            return Err(self.at.error(
                name.span(),
                format!("there are two of the {} name `{text}`", self.what),
                format!("the first stands in line {line}"),
            ));
        }
        self.seen.insert(text.clone(), name.span());
        Ok(text.clone())
    }
}

/// An error about a name that does not exist.
pub(super) fn unknown<'c>(
    name: &Spanned<String>,
    what: &str,
    candidates: impl Iterator<Item = &'c str> + Clone,
    at: &Locator<'_>,
) -> crate::error::Error {
    let hint = hint_for(name.get_ref(), &format!("{what}s"), candidates);
    at.error(name.span(), format!("there is no {what} `{}`", name.get_ref()), hint)
}
