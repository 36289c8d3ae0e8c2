//! From byte positions to errors a person can act on: file, line and column, or the option that said it.

use std::ops::Range;
use std::path::Path;

use crate::error::{Error, Place};

/// Finds the place of every value of a room file, overridden or not.
///
/// Values given by an option live behind the end of the text: their spans start at [`Locator::first_free`].
#[derive(Debug)]
pub(super) struct Locator<'a> {
    file: &'a Path,
    text: &'a str,
    options: Vec<(Range<usize>, String)>,
}

impl<'a> Locator<'a> {
    /// A locator for the text of `file`, without options yet.
    pub(super) fn new(file: &'a Path, text: &'a str) -> Self {
        Self { file, text, options: Vec::new() }
    }

    /// Reserves a span of `length` bytes behind the text for a value given by the option `label`.
    pub(super) fn reserve(&mut self, length: usize, label: &str) -> Range<usize> {
        let start = self.options.last().map_or(self.text.len() + 1, |(span, _)| span.end + 1);
        let span = start..start + length.max(1);
        self.options.push((span.clone(), label.to_owned()));
        span
    }

    /// The place of a byte of the text; line and column are counted from 1, columns in characters.
    pub(super) fn place(&self, offset: usize) -> Place {
        let mut offset = offset.min(self.text.len());
        while !self.text.is_char_boundary(offset) {
            offset -= 1;
        }
        let before = &self.text[..offset];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        Place {
            file: self.file.to_owned(),
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
        }
    }

    /// An error about the value at `span`.
    pub(super) fn error(&self, span: Range<usize>, message: impl Into<String>, hint: impl Into<String>) -> Error {
        let (message, hint) = (message.into(), hint.into());
        let hint = (!hint.is_empty()).then_some(hint);
        match self.options.iter().find(|(range, _)| range.contains(&span.start)) {
            Some((_, label)) => Error::Input { place: None, message: format!("{label}: {message}"), hint },
            None => Error::Input { place: Some(self.place(span.start)), message, hint },
        }
    }

    /// The error of the TOML reader in the words of this program.
    pub(super) fn toml_error(&self, error: &toml::de::Error) -> Error {
        let (message, hint) = reword(error.message());
        self.error(error.span().unwrap_or(0..0), message, hint)
    }
}

/// Rust's type names and serde's habits, translated.
const WORDS: [(&str, &str); 13] = [
    ("unknown field", "unknown key"),
    ("missing field", "missing key"),
    ("duplicate field", "duplicate key"),
    ("expected f64", "expected a number"),
    ("expected u32", "expected a whole number"),
    ("expected u64", "expected a whole number"),
    ("floating point", "number"),
    ("a borrowed string", "a string"),
    ("expected a map", "expected a table"),
    ("invalid type: map", "invalid type: table"),
    ("an array of length 3", "three numbers [x, y, z]"),
    ("an array of length 2", "two numbers [from, to]"),
    ("invalid type: sequence", "invalid type: list"),
];

/// Splits a message of the TOML reader into a sentence and a hint.
fn reword(message: &str) -> (String, String) {
    let mut text = message.to_owned();
    for (from, to) in WORDS {
        text = text.replace(from, to);
    }
    if let Some(at) = text.find("expected struct ") {
        text.truncate(at);
        text.push_str("expected a table");
    }
    text = text.replace("expected a sequence", "expected a list");
    let hint = if text.starts_with("unknown key") {
        let mut names = text.split('`').skip(1).step_by(2);
        let unknown = names.next().unwrap_or_default().to_owned();
        let allowed: Vec<&str> = names.collect();
        nearest(&unknown, allowed.iter().copied()).map(|name| format!("did you mean `{name}`?")).unwrap_or_default()
    } else if text.contains("invalid type: string") && text.contains("expected a number") {
        "numbers stand without quotes and without unit".to_owned()
    } else if text.contains("expected a string") {
        "put the text in quotes".to_owned()
    } else {
        String::new()
    };
    (text, hint)
}

/// The candidate most like `name`, if any is like it: at most a third of its letters differ, or one is the
/// beginning of the other.
pub(super) fn nearest<'c>(name: &str, candidates: impl Iterator<Item = &'c str>) -> Option<&'c str> {
    let name = name.to_lowercase();
    let limit = (name.chars().count() / 3).max(1);
    candidates
        .filter_map(|candidate| {
            let other = candidate.to_lowercase();
            let distance = edit_distance(&name, &other);
            let shorter = name.len().min(other.len());
            let related = shorter >= 3 && (other.starts_with(&name) || name.starts_with(&other));
            (distance <= limit || related).then_some((distance, candidate))
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, candidate)| candidate)
}

/// "did you mean `x`?" if something is near, else what there is.
pub(super) fn hint_for<'c>(name: &str, what: &str, candidates: impl Iterator<Item = &'c str> + Clone) -> String {
    if let Some(near) = nearest(name, candidates.clone()) {
        return format!("did you mean `{near}`?");
    }
    let all: Vec<&str> = candidates.take(40).collect();
    if all.is_empty() { format!("the file has no {what}") } else { format!("{what}: {}", all.join(", ")) }
}

/// Edit distance with transpositions of neighbours (optimal string alignment).
fn edit_distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut two_above = vec![0; b.len() + 1];
    let mut above: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let substitution = above[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            row[j] = substitution.min(above[j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                row[j] = row[j].min(two_above[j - 2] + 1);
            }
        }
        two_above = above;
        above = row;
    }
    above[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_count_characters_not_bytes() {
        let locator = Locator::new(Path::new("room.toml"), "name = \"Ä\"\nx = \"öö\" # ü\n");
        let place = locator.place("name = \"Ä\"\nx = \"öö\"".len());
        assert_eq!((place.line, place.column), (2, 9));
    }

    #[test]
    fn a_slip_of_the_finger_finds_its_word() {
        let words = ["concrete", "curtain", "carpet"];
        assert_eq!(nearest("conrcete", words.into_iter()), Some("concrete"));
        assert_eq!(nearest("Concrete", words.into_iter()), Some("concrete"));
        assert_eq!(nearest("curtains", words.into_iter()), Some("curtain"));
        assert_eq!(nearest("water", words.into_iter()), None);
    }

    #[test]
    fn edit_distance_counts_insertions_deletions_changes_and_swaps() {
        assert_eq!(edit_distance("", "abc"), 3);
        assert_eq!(edit_distance("kitten", "sitting"), 3);
        assert_eq!(edit_distance("dor", "door"), 1);
        assert_eq!(edit_distance("odor", "door"), 1);
    }
}
