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
