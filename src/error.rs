//! Errors in full sentences with their place in the room file, and warnings as values.

use std::fmt;
use std::path::PathBuf;

/// Where in a text file something stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    /// The file as the user named it.
    pub file: PathBuf,
    /// Line, counted from 1.
    pub line: usize,
    /// Column in characters, counted from 1.
    pub column: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}", self.file.display(), self.line, self.column)
    }
}

/// Everything that can go wrong, as one sentence, its place and a hint.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The room file (or a `--set` value) says something that cannot be.
    #[error("{}{message}{}", place_prefix(.place), hint_suffix(.hint))]
    Input {
        /// Where, if the mistake has a place in a file.
        place: Option<Place>,
        /// What is wrong and what is allowed.
        message: String,
        /// What the user may have meant.
        hint: Option<String>,
    },
    /// A file could not be read or written.
    #[error("{}: cannot {action}: {source}", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What was tried, as a verb: "read", "write".
        action: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// The run itself failed.
    #[error("{0}")]
    Run(String),
}

impl Error {
    /// An input error without a place in a file.
    pub fn input(message: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Input { place: None, message: message.into(), hint: Some(hint.into()) }
    }
}

impl Error {
    /// The line of `text` in which the mistake stands with a caret under it, for a terminal; `None` where the error has no
    /// place in it. `text` is the room file.
    pub fn excerpt(&self, text: &str) -> Option<String> {
        let Self::Input { place: Some(place), .. } = self else { return None };
        let line = text.lines().nth(place.line.checked_sub(1)?)?;
        let number = place.line.to_string();
        // Tabs are kept, so that the caret stands where the terminal puts the character.
        let before = line.chars().take(place.column.saturating_sub(1)).map(|c| if c == '\t' { '\t' } else { ' ' });
        let gutter = " ".repeat(number.len());
        Some(format!("{gutter} |\n{number} | {line}\n{gutter} | {}^", before.collect::<String>()))
    }
}

fn place_prefix(place: &Option<Place>) -> String {
    place.as_ref().map(|p| format!("{p}: ")).unwrap_or_default()
}

fn hint_suffix(hint: &Option<String>) -> String {
    hint.as_ref().map(|h| format!("\nhint: {h}")).unwrap_or_default()
}

/// The crate's result type.
pub type Result<T> = std::result::Result<T, Error>;

/// Something the user should know about a result that exists all the same.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Warning {
    /// What was observed.
    pub observation: String,
    /// What to do about it.
    pub remedy: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "warning: {}\n  {}", self.observation, self.remedy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mistake(line: usize, column: usize) -> Error {
        let place = Place { file: "rooms/hall.toml".into(), line, column };
        Error::Input {
            place: Some(place),
            message: "absorption is 1.3, must lie in 0..=1".to_owned(),
            hint: Some("a share of the energy, not a percentage".to_owned()),
        }
    }

    #[test]
    fn a_message_says_where_what_and_a_hint() {
        assert_eq!(
            mistake(12, 14).to_string(),
            "rooms/hall.toml:12:14: absorption is 1.3, must lie in 0..=1\nhint: a share of the energy, not a percentage"
        );
        assert_eq!(Error::input("no", "yes").to_string(), "no\nhint: yes");
    }

    #[test]
    fn the_caret_stands_under_the_mistake() {
        let text = "name = \"Ä\"\nabsorption = 1.3\n";
        assert_eq!(mistake(2, 14).excerpt(text).as_deref(), Some("  |\n2 | absorption = 1.3\n  |              ^"));
        assert_eq!(mistake(1, 9).excerpt("name = \"Ä\"").as_deref(), Some("  |\n1 | name = \"Ä\"\n  |         ^"));
        assert_eq!(mistake(9, 1).excerpt(text), None);
        assert_eq!(Error::input("no", "yes").excerpt(text), None);
    }
}
