//! Reading room files: text, overrides, types, checks.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use sha2::{Digest, Sha256};
use toml::de::DeTable;

use super::Scene;
use super::check::{Surroundings, check};
use super::locate::Locator;
use super::mesh::MeshFiles;
use super::overrides::Override;
use super::room_file::RoomFile;
use crate::error::{Error, Result, Warning};

/// The text a scene was made from, for records and reports.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct RoomSource {
    /// The file as the user named it.
    pub file: PathBuf,
    /// Its text.
    pub text: String,
    /// SHA-256 of the text in hexadecimal digits.
    pub sha256: String,
}

/// A checked scene with its text and what the user should know about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Its text, without overrides.
    pub source: RoomSource,
    /// Observations that do not prevent a run.
    pub warnings: Vec<Warning>,
}

/// A room file that can be turned into scenes, once or for many values of a parameter.
#[derive(Debug)]
pub struct Room {
    source: RoomSource,
    meshes: MeshFiles,
}

impl Room {
    /// Reads a room file; nothing is checked but that it is text.
    ///
    /// # Errors
    /// The file cannot be read or is not UTF-8.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes =
            std::fs::read(path).map_err(|source| Error::File { path: path.to_owned(), action: "read", source })?;
        match String::from_utf8(bytes) {
            Ok(text) => Ok(Self::new(text, path)),
            Err(error) => {
                let valid = error.utf8_error().valid_up_to();
                let text = String::from_utf8_lossy(error.as_bytes()).into_owned();
                let hint = "save the file as UTF-8";
                Err(Locator::new(path, &text).error(valid..valid, "this is not UTF-8 text", hint))
            }
        }
    }

    /// A room file from its text. `file` is used in messages, and meshes are looked up beside it.
    pub fn new(text: impl Into<String>, file: impl Into<PathBuf>) -> Self {
        let (text, file) = (text.into(), file.into());
        let sha256 = Sha256::digest(text.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        Self { source: RoomSource { file, text, sha256 }, meshes: MeshFiles::default() }
    }

    /// The text and its hash.
    pub fn source(&self) -> &RoomSource {
        &self.source
    }

    /// The scene with some values replaced. A `[sweep]` is tried at its smallest and largest value.
    ///
    /// # Errors
    /// The first mistake: where, what is wrong, what is allowed, and a hint.
    pub fn load(&self, overrides: &[Override]) -> Result<Loaded> {
        let (scene, warnings) = self.check(overrides, true, |scene, at, place| {
            let Some(sweep) = &scene.sweep else { return Ok(()) };
            let lowest = sweep.values.iter().copied().fold(f64::INFINITY, f64::min);
            let highest = sweep.values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            for value in [lowest, highest] {
                self.scene_at(overrides, &sweep.parameter, value).map_err(|error| match error {
                    Error::Input { message, hint, .. } => at.error(place.clone(), message, hint.unwrap_or_default()),
                    other => other,
                })?;
            }
            Ok(())
        })?;
        Ok(Loaded { scene, source: self.source.clone(), warnings })
    }

    /// The scene of one value of a sweep, on top of other overrides; it has no sweep of its own. Geometry files are read
    /// once for all values.
    ///
    /// # Errors
    /// As [`Room::load`].
    pub fn scene_at(&self, overrides: &[Override], parameter: &str, value: f64) -> Result<Scene> {
        let mut all = overrides.to_vec();
        all.push(Override::sweep_value(parameter, value));
        self.check(&all, false, |_, _, _| Ok(())).map(|(scene, _)| scene)
    }

    /// Text -> values -> overrides -> types -> checks; `last` has the final word, with the place of `[sweep]`, which is
    /// taken out unless it is wanted.
    fn check(
        &self,
        overrides: &[Override],
        with_sweep: bool,
        last: impl FnOnce(&Scene, &Locator<'_>, std::ops::Range<usize>) -> Result<()>,
    ) -> Result<(Scene, Vec<Warning>)> {
        let RoomSource { file, text, .. } = &self.source;
        let mut at = Locator::new(file, text);
        let mut root = DeTable::parse(text).map_err(|error| at.toml_error(&error))?;
        for one in overrides {
            one.apply(root.get_mut(), &mut at)?;
        }
        if !with_sweep {
            root.get_mut().remove("sweep");
        }
        let room = RoomFile::deserialize(toml::Deserializer::from(root)).map_err(|error| at.toml_error(&error))?;
        let surroundings = Surroundings {
            title: file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default(),
            folder: file.parent().unwrap_or(Path::new("")),
            meshes: &self.meshes,
        };
        let (scene, warnings) = check(&room, &at, &surroundings).map_err(|error| mention(error, overrides))?;
        last(&scene, &at, room.sweep.as_ref().map_or(0..0, |sweep| sweep.get_ref().parameter.span()))?;
        Ok((scene, warnings))
    }
}

/// A mistake that stands in the file may come from an override elsewhere: say that there are some.
fn mention(error: Error, overrides: &[Override]) -> Error {
    match error {
        Error::Input { place: Some(place), message, hint } if !overrides.is_empty() => {
            let labels: Vec<&str> = overrides.iter().map(Override::label).collect();
            Error::Input { place: Some(place), message: format!("{message} (read with {})", labels.join(", ")), hint }
        }
        other => other,
    }
}

impl Scene {
    /// Reads and checks a room file.
    ///
    /// # Errors
    /// As [`Room::read`] and [`Room::load`].
    pub fn load(path: &Path, overrides: &[Override]) -> Result<Loaded> {
        Room::read(path)?.load(overrides)
    }

    /// Reads and checks the text of a room file; `file_name` is used in messages, and meshes are looked up beside it.
    ///
    /// # Errors
    /// As [`Room::load`].
    pub fn from_str(text: &str, file_name: &str, overrides: &[Override]) -> Result<Loaded> {
        Room::new(text, file_name).load(overrides)
    }
}
