//! `--set PATH=VALUE`: values of the room file replaced before it is checked, and the values of a sweep.

use std::borrow::Cow;
use std::ops::Range;

use serde_spanned::Spanned;
use toml::de::{DeTable, DeValue};

use super::Sweep;
use super::locate::{Locator, hint_for};
use super::materials::{library_names, library_values};
use crate::error::{Error, Result};

/// The top level of a room file.
const SECTIONS: [&str; 13] = [
    "name",
    "air",
    "bands",
    "material",
    "box",
    "wall",
    "mesh",
    "opening",
    "source",
    "probe",
    "simulation",
    "output",
    "sweep",
];
/// Sections that are lists, and the key that tells their elements apart.
const LISTS: [(&str, &str); 6] =
    [("box", "name"), ("wall", "name"), ("mesh", "file"), ("opening", "name"), ("source", "name"), ("probe", "name")];
/// Keys of a door leaf, which `opening.NAME.KEY` reaches without a further `door.`.
const DOOR_KEYS: [&str; 5] = ["kind", "open_m", "fixed_jamb", "material", "thickness_m"];
/// Longest list of sweep values.
const MOST_VALUES: usize = 100_000;

/// One value of the room file, replaced by an option of the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Override {
    path: String,
    value: String,
    label: String,
}

impl Override {
    /// Reads `PATH=VALUE`, the argument of `--set`.
    ///
    /// # Errors
    /// No `=`, an empty path or an empty value.
    pub fn parse(text: &str) -> Result<Self> {
        let (path, value) = split_setting(text)?;
        Ok(Self { path: path.to_owned(), value: value.to_owned(), label: format!("--set {path}={value}") })
    }

    /// The value of an option of its own, as `--seed 5` for `simulation.seed`; errors name that option.
    pub fn option(option: &str, path: &str, value: &str) -> Self {
        Self { path: path.to_owned(), value: value.to_owned(), label: format!("{option} {value}") }
    }

    /// One value of a sweep.
    pub fn sweep_value(parameter: &str, value: f64) -> Self {
        // Whole numbers are written as such: a parameter may be an integer.
        let value = if value.fract() == 0.0 && value.abs() < 1e15 { format!("{value:.0}") } else { format!("{value}") };
        Self { path: parameter.to_owned(), label: format!("sweep value {parameter}={value}"), value }
    }

    /// The path, as `opening.door.open_m`.
    pub fn path(&self) -> &str {
        &self.path
    }

    /// The value as typed.
    pub fn value(&self) -> &str {
        &self.value
    }

    /// The option as the user typed it, for messages.
    pub fn label(&self) -> &str {
        &self.label
    }

    fn error(&self, message: impl std::fmt::Display, hint: impl Into<String>) -> Error {
        let hint = hint.into();
        let hint = (!hint.is_empty()).then_some(hint);
        Error::Input { place: None, message: format!("{}: {message}", self.label), hint }
    }

    /// Replaces the value in a parsed room file.
    pub(super) fn apply<'t>(&'t self, root: &mut DeTable<'t>, at: &mut Locator<'_>) -> Result<()> {
        let segments = split_path(&self.path).map_err(|message| self.error(message, "a path is KEY.NAME.KEY"))?;
        let span = at.reserve(self.value.len(), &self.label);
        let value = self.parsed_value(&span)?;
        Walk { of: self, span }.root(root, &segments, value)
    }

    /// The value as TOML; what is not TOML and has no quotes or brackets is a text.
    fn parsed_value<'t>(&'t self, span: &Range<usize>) -> Result<Spanned<DeValue<'t>>> {
        match DeValue::parse(&self.value) {
            Ok(mut value) => {
                shift(&mut value, span.start);
                Ok(value)
            }
            Err(_) if !self.value.starts_with(['[', '{', '"', '\'']) => {
                Ok(Spanned::new(span.clone(), DeValue::String(Cow::Borrowed(&self.value))))
            }
            Err(error) => Err(self.error(
                format!("the value is not valid TOML: {}", error.message()),
                "as 0.3, [1.0, 2.0, 1.5] or concrete",
            )),
        }
    }
}

/// Moves a value and all within it behind the end of the room file's text.
fn shift(value: &mut Spanned<DeValue<'_>>, by: usize) {
    match value.get_mut() {
        DeValue::Array(items) => items.iter_mut().for_each(|item| shift(item, by)),
        DeValue::Table(table) => {
            let moved = std::mem::take(table).into_iter().map(|(key, mut value)| {
                shift(&mut value, by);
                let span = key.span();
                (Spanned::new(span.start + by..span.end + by, key.into_inner()), value)
            });
            *table = moved.collect();
        }
        _ => {}
    }
    let span = value.span();
    let inner = std::mem::replace(value.get_mut(), DeValue::Boolean(false));
    *value = Spanned::new(span.start + by..span.end + by, inner);
}

/// Gives a value and all within it one span.
fn stamp(value: &DeValue<'static>, span: &Range<usize>) -> DeValue<'static> {
    match value {
        DeValue::Table(table) => DeValue::Table(
            table
                .iter()
                .map(|(key, value)| {
                    (
                        Spanned::new(span.clone(), key.get_ref().clone()),
                        Spanned::new(span.clone(), stamp(value.get_ref(), span)),
                    )
                })
                .collect(),
        ),
        DeValue::Array(items) => {
            let mut stamped = items.clone();
            for (to, from) in stamped.iter_mut().zip(items.iter()) {
                *to = Spanned::new(span.clone(), stamp(from.get_ref(), span));
            }
            DeValue::Array(stamped)
        }
        other => other.clone(),
    }
}

/// The way from the root of the room file to the value.
struct Walk<'t> {
    of: &'t Override,
    span: Range<usize>,
}

impl<'t> Walk<'t> {
    fn insert(&self, table: &mut DeTable<'t>, key: &str, value: Spanned<DeValue<'t>>) {
        table.insert(Spanned::new(self.span.clone(), Cow::Owned(key.to_owned())), value);
    }

    /// The table under `key`, made if it is not there.
    fn child<'m>(&self, table: &'m mut DeTable<'t>, key: &str) -> Result<&'m mut DeValue<'t>> {
        if !table.contains_key(key) {
            self.insert(table, key, Spanned::new(self.span.clone(), DeValue::Table(DeTable::new())));
        }
        // The key was there, or has just been put there.
        table.get_mut(key).map(Spanned::get_mut).ok_or_else(|| self.of.error("the path does not exist", ""))
    }

    fn root(&self, root: &mut DeTable<'t>, segments: &[String], value: Spanned<DeValue<'t>>) -> Result<()> {
        // split_path gives at least one segment.
        let Some((section, rest)) = segments.split_first() else { return Ok(()) };
        if !SECTIONS.contains(&section.as_str()) {
            let hint = hint_for(section, "sections", SECTIONS.into_iter());
            return Err(self.of.error(format!("a room file has no section `{section}`"), hint));
        }
        if section != "name" && rest.is_empty() {
            return Err(self.of.error(
                format!("`{section}` is a section, not a value"),
                if LISTS.iter().any(|(list, _)| list == section) {
                    "name an element and a key: probe.mic-1.position_m"
                } else {
                    "name a key of it: simulation.seed"
                },
            ));
        }
        if let Some((_, key)) = LISTS.iter().find(|(list, _)| list == section) {
            let Some(DeValue::Array(elements)) = root.get_mut(section.as_str()).map(Spanned::get_mut) else {
                return Err(self.of.error(format!("the room file has no [[{section}]]"), ""));
            };
            return self.element(section, key, elements, rest, value);
        }
        if section == "material" {
            self.copy_built_in(root, rest)?;
        }
        self.table(root, section, segments, value)
    }

    /// Makes a room-file entry of a built-in material whose single key is to be set.
    fn copy_built_in(&self, root: &mut DeTable<'t>, rest: &[String]) -> Result<()> {
        let [name, _, ..] = rest else {
            return Err(self.of.error("the path ends at a material", "name a key of it: material.plaster.absorption"));
        };
        let DeValue::Table(materials) = self.child(root, "material")? else { return Ok(()) };
        if materials.contains_key(name.as_str()) {
            return Ok(());
        }
        let Some(built_in) = library_values(name) else {
            let own: Vec<&str> = materials.keys().map(|key| key.get_ref().as_ref()).collect();
            let hint = hint_for(name, "materials", own.into_iter().chain(library_names()));
            return Err(self.of.error(format!("there is no material `{name}`"), hint));
        };
        self.insert(materials, name, Spanned::new(self.span.clone(), stamp(built_in, &self.span)));
        Ok(())
    }

    /// Down one table: `segments[0]` is a key of it.
    fn table(
        &self,
        table: &mut DeTable<'t>,
        trail: &str,
        segments: &[String],
        value: Spanned<DeValue<'t>>,
    ) -> Result<()> {
        match segments {
            [] => Ok(()),
            [key] => {
                self.insert(table, key, value);
                Ok(())
            }
            [key, rest @ ..] => match self.child(table, key)? {
                DeValue::Table(inner) => self.table(inner, key, rest, value),
                DeValue::Array(items) => self.item(key, items, rest, value),
                other => Err(self.of.error(
                    format!("`{key}` of `{trail}` is a {}, it has no part `{}`", other.type_str(), rest[0]),
                    "",
                )),
            },
        }
    }

    /// Down one list of tables: the next segments (a name may contain dots) name the element.
    fn element(
        &self,
        section: &str,
        name_key: &str,
        elements: &mut [Spanned<DeValue<'t>>],
        segments: &[String],
        value: Spanned<DeValue<'t>>,
    ) -> Result<()> {
        let name_of = |element: &Spanned<DeValue<'t>>| -> Option<String> {
            element.get_ref().get(name_key).and_then(|name| name.get_ref().as_str().map(str::to_owned))
        };
        for length in 1..=segments.len() {
            let name = segments[..length].join(".");
            let Some(found) = elements.iter().position(|element| name_of(element).as_ref() == Some(&name)) else {
                continue;
            };
            let DeValue::Table(table) = elements[found].get_mut() else { continue };
            let rest = &segments[length..];
            let Some(key) = rest.first() else {
                return Err(self.of.error(format!("the path ends at the {section} `{name}`"), "name a key of it"));
            };
            if section == "opening" && DOOR_KEYS.contains(&key.as_str()) {
                let Some(DeValue::Table(door)) = table.get_mut("door").map(Spanned::get_mut) else {
                    return Err(self.of.error(
                        format!("opening `{name}` has no door, so no `{key}`"),
                        "give it one in the room file: door = { kind = \"sliding\", open_m = 0.3 }",
                    ));
                };
                return self.table(door, "door", rest, value);
            }
            return self.table(table, &name, rest, value);
        }
        let names: Vec<String> = elements.iter().filter_map(name_of).collect();
        let hint = hint_for(&segments[0], &format!("{section} names"), names.iter().map(String::as_str));
        Err(self.of.error(format!("the room file has no {section} `{}`", segments[0]), hint))
    }

    /// One item of a list of numbers, by number from 0 or by coordinate.
    fn item(
        &self,
        key: &str,
        items: &mut [Spanned<DeValue<'t>>],
        segments: &[String],
        value: Spanned<DeValue<'t>>,
    ) -> Result<()> {
        // Called with at least one segment left.
        let Some((place, rest)) = segments.split_first() else { return Ok(()) };
        let index = match place.as_str() {
            "x" if items.len() == 3 => Some(0),
            "y" if items.len() == 3 => Some(1),
            "z" if items.len() == 3 => Some(2),
            number => number.parse::<usize>().ok().filter(|index| *index < items.len()),
        };
        let Some(index) = index else {
            let hint = if items.len() == 3 {
                "x, y, z or 0, 1, 2".to_owned()
            } else {
                format!("items are counted from 0; there are {}", items.len())
            };
            return Err(self.of.error(format!("`{key}` has no item `{place}`"), hint));
        };
        match (rest, items[index].get_mut()) {
            ([], _) => {
                items[index] = value;
                Ok(())
            }
            (_, DeValue::Array(inner)) => self.item(key, inner, rest, value),
            _ => Err(self.of.error(format!("`{key}.{place}` has no part `{}`", rest[0]), "")),
        }
    }
}

/// Splits a path at its dots; parts may stand in double quotes.
fn split_path(path: &str) -> std::result::Result<Vec<String>, String> {
    let mut segments = vec![String::new()];
    let mut quoted = false;
    for c in path.chars() {
        match (c, segments.last_mut()) {
            ('"', _) => quoted = !quoted,
            ('.', _) if !quoted => segments.push(String::new()),
            (c, Some(segment)) => segment.push(c),
            (_, None) => {}
        }
    }
    if quoted {
        return Err(format!("the path `{path}` has an unclosed quote"));
    }
    if segments.iter().any(|segment| segment.is_empty()) {
        return Err(format!("the path `{path}` has an empty part"));
    }
    Ok(segments)
}

fn split_setting(text: &str) -> Result<(&str, &str)> {
    match text.split_once('=').map(|(path, value)| (path.trim(), value.trim())) {
        Some((path, value)) if !path.is_empty() && !value.is_empty() => Ok((path, value)),
        _ => Err(Error::input(format!("--set {text}: must be PATH=VALUE"), "as --set opening.door.open_m=0.3")),
    }
}

impl Sweep {
    /// Reads `PATH=FROM:TO:STEP` or `PATH=V1,V2,...`, the argument of `--set` of a sweep.
    ///
    /// # Errors
    /// No `=`, or values that [`parse_sweep`] does not take.
    pub fn parse(text: &str) -> Result<Self> {
        let (path, values) = split_setting(text)?;
        let values = parse_sweep(values).map_err(|error| match error {
            Error::Input { message, hint, .. } => {
                Error::Input { place: None, message: format!("--set {path}={values}: {message}"), hint }
            }
            other => other,
        })?;
        Ok(Self { parameter: path.to_owned(), values, reference: None })
    }
}

/// Reads the values of a sweep: `FROM:TO:STEP`, both ends included, or `V1,V2,...`.
///
/// # Errors
/// Something that is not a finite number, a step of 0 or away from the end, or more than 100 000 values.
pub fn parse_sweep(text: &str) -> Result<Vec<f64>> {
    const FORMS: &str = "as 0:1.2:0.02 (from:to:step) or 0,0.01,0.05";
    let number = |part: &str| match part.trim().parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(Error::input(format!("`{}` is not a number", part.trim()), FORMS)),
    };
    if text.contains(':') {
        let parts = text.split(':').map(number).collect::<Result<Vec<_>>>()?;
        let [from, to, step] = parts[..] else {
            return Err(Error::input(format!("`{text}` has {} parts, must have 3", parts.len()), FORMS));
        };
        return range_values(from, to, step).map_err(|(message, hint)| Error::input(message, hint));
    }
    let values = text.split(',').map(number).collect::<Result<Vec<_>>>()?;
    if values.len() > MOST_VALUES {
        return Err(Error::input(format!("{} values, at most {MOST_VALUES} are allowed", values.len()), FORMS));
    }
    Ok(values)
}

/// from, from + step, ... up to and including `to` (within 1e-6 of a step); rounded to 12 digits so that 3 * 0.1 reads
/// 0.3. The error is a message and a hint.
pub(super) fn range_values(from: f64, to: f64, step: f64) -> std::result::Result<Vec<f64>, (String, String)> {
    if ![from, to, step].into_iter().all(f64::is_finite) {
        return Err(("from, to and step must be finite".to_owned(), String::new()));
    }
    if from == to {
        return Ok(vec![from]);
    }
    if step == 0.0 || (to - from) * step < 0.0 {
        return Err((
            format!("the step {step} never leads from {from} to {to}"),
            format!("a step of {} leads there", if to > from { "more than 0" } else { "less than 0" }),
        ));
    }
    let steps = ((to - from) / step + 1e-6).floor();
    if steps >= MOST_VALUES as f64 {
        return Err((
            format!("{from} to {to} by {step} makes more than {MOST_VALUES} values"),
            "take a larger step".to_owned(),
        ));
    }
    // steps lies in 0..100 000 here.
    let last = steps as usize;
    Ok((0..=last)
        .map(|i| {
            let value = from + i as f64 * step;
            if i == last && (value - to).abs() <= 1e-6 * step.abs() {
                to
            } else {
                rounded(value, from.abs().max(to.abs()))
            }
        })
        .collect())
}

/// Rounds to 12 significant digits of `scale`.
fn rounded(value: f64, scale: f64) -> f64 {
    let decimals = (11.0 - scale.log10().floor()).clamp(0.0, 340.0) as usize;
    // A number printed by Rust parses.
    format!("{value:.decimals$}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_includes_its_end_and_reads_as_typed() {
        assert_eq!(parse_sweep("0:0.5:0.1").expect("valid"), [0.0, 0.1, 0.2, 0.3, 0.4, 0.5]);
        assert_eq!(parse_sweep("0:1.2:0.02").expect("valid").len(), 61);
        assert_eq!(parse_sweep("0:1.2:0.02").expect("valid")[60], 1.2);
        assert_eq!(parse_sweep("1:0:-0.25").expect("valid"), [1.0, 0.75, 0.5, 0.25, 0.0]);
        assert_eq!(parse_sweep("0:1:0.3").expect("valid"), [0.0, 0.3, 0.6, 0.9]);
        assert_eq!(parse_sweep("2:2:1").expect("valid"), [2.0]);
        assert_eq!(parse_sweep("1e6:1e6:0").expect("valid"), [1e6]);
    }

    #[test]
    fn a_list_keeps_its_order() {
        assert_eq!(parse_sweep("0.5, 0.1,-2").expect("valid"), [0.5, 0.1, -2.0]);
        assert_eq!(parse_sweep("0.5").expect("valid"), [0.5]);
    }

    #[test]
    fn endless_and_empty_sweeps_are_errors() {
        for text in ["0:1:0", "0:1:-0.1", "0:1:1e-9", "0:1", "0:1:2:3", "a:b:c", "", "1,,2", "nan", "0:inf:1", "1,x"] {
            assert!(parse_sweep(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_path_splits_at_dots_outside_quotes() {
        assert_eq!(split_path("probe.mic-1.position_m").expect("valid"), ["probe", "mic-1", "position_m"]);
        assert_eq!(split_path("probe.\"a.b\".position_m").expect("valid"), ["probe", "a.b", "position_m"]);
        assert!(split_path("probe..x").is_err());
        assert!(split_path("probe.\"x").is_err());
    }

    #[test]
    fn an_override_needs_a_path_and_a_value() {
        assert!(Override::parse("simulation.seed").is_err());
        assert!(Override::parse("=3").is_err());
        assert!(Override::parse("a=").is_err());
        let good = Override::parse(" simulation.seed = 3 ").expect("valid");
        assert_eq!((good.path(), good.value(), good.label()), ("simulation.seed", "3", "--set simulation.seed=3"));
    }
}
