//! The built-in materials and the choice between them and those of the room file.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::LazyLock;

use serde::Deserialize;
use serde_spanned::Spanned;
use toml::de::{DeTable, DeValue};

use super::locate::{Locator, hint_for};
use super::room_file::MaterialTable;
use super::spectrum::{Quantity, Spectrum};
use super::{Band, Material, MaterialId};
use crate::error::{Result, Warning};

const LIBRARY_TEXT: &str = include_str!("materials.toml");
const LIBRARY_FILE: &str = "built-in materials";

/// `material` of the room file, and the whole of the library file.
pub(super) type MaterialTables = BTreeMap<Spanned<String>, Spanned<MaterialTable>>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LibraryFile {
    material: MaterialTables,
}

/// The built-in materials as typed. A unit test reads them, so that a shipped library is never empty.
static LIBRARY: LazyLock<MaterialTables> =
    LazyLock::new(|| toml::from_str::<LibraryFile>(LIBRARY_TEXT).map(|file| file.material).unwrap_or_default());

/// The same as TOML values, for overrides of a single key of a built-in material.
static LIBRARY_VALUES: LazyLock<DeTable<'static>> =
    LazyLock::new(|| match DeTable::parse(LIBRARY_TEXT).map(Spanned::into_inner) {
        Ok(mut root) => match root.remove("material").map(Spanned::into_inner) {
            Some(DeValue::Table(materials)) => materials,
            _ => DeTable::new(),
        },
        Err(_) => DeTable::new(),
    });

/// One built-in material, for listings.
#[derive(Debug, Clone, PartialEq)]
pub struct LibraryEntry {
    /// Name to use in a room file.
    pub name: String,
    /// What it is.
    pub description: String,
    /// Where its numbers come from.
    pub source: String,
    /// Its spectra in the octave bands 63 to 8000 Hz.
    pub material: Material,
}

/// All built-in materials in alphabetical order, in the octave bands 63 to 8000 Hz.
///
/// # Errors
/// None in a released version: the tests read the whole library.
pub fn library() -> Result<Vec<LibraryEntry>> {
    let at = Locator::new(Path::new(LIBRARY_FILE), LIBRARY_TEXT);
    let bands = super::bands::bands_between(super::Spacing::Octave, 63.0, 8000.0);
    let text = |value: &Option<Spanned<String>>| value.as_ref().map(|t| t.get_ref().clone()).unwrap_or_default();
    LIBRARY
        .iter()
        .map(|(name, table)| {
            let (material, _) = in_bands(name.get_ref(), table.get_ref(), &bands, &at)?;
            Ok(LibraryEntry {
                name: name.get_ref().clone(),
                description: text(&table.get_ref().description),
                source: text(&table.get_ref().source),
                material,
            })
        })
        .collect()
}

/// The keys of a built-in material as TOML values.
pub(super) fn library_values(name: &str) -> Option<&'static DeValue<'static>> {
    LIBRARY_VALUES.get(name).map(Spanned::get_ref)
}

/// Names of all built-in materials.
pub(super) fn library_names<'n>() -> impl Iterator<Item = &'n str> + Clone {
    LIBRARY.keys().map(|name| name.get_ref().as_str())
}

/// The materials in use, filled as walls ask for them.
#[derive(Debug)]
pub(super) struct Palette<'a> {
    defined: &'a MaterialTables,
    bands: &'a [Band],
    at: &'a Locator<'a>,
    used: Vec<Material>,
}

impl<'a> Palette<'a> {
    /// A palette over the room file's own materials; all of them are checked, used or not.
    pub(super) fn new(
        defined: &'a MaterialTables,
        bands: &'a [Band],
        at: &'a Locator<'a>,
        warnings: &mut Vec<Warning>,
    ) -> Result<Self> {
        for (name, table) in defined {
            if name.get_ref() == "none" || name.get_ref().is_empty() {
                return Err(at.error(
                    name.span(),
                    format!("a material cannot be called `{}`", name.get_ref()),
                    "\"none\" removes a face of a box",
                ));
            }
            let (_, raised) = in_bands(name.get_ref(), table.get_ref(), bands, at)?;
            if raised {
                warnings.push(Warning {
                    observation: format!(
                        "material `{}` lets more pass than it absorbs; its absorption is raised to the transmitted share",
                        name.get_ref()
                    ),
                    remedy: "absorption counts all that is not reflected: give at least 10^(-transmission_loss_db/10)"
                        .to_owned(),
                });
            }
        }
        Ok(Self { defined, bands, at, used: Vec::new() })
    }

    /// Index of the material called `name`, which stands at the span.
    pub(super) fn id(&mut self, name: &Spanned<String>) -> Result<MaterialId> {
        self.id_of(name.get_ref(), name.span())
    }

    /// Index of the given material, or of "rigid".
    pub(super) fn id_or_rigid(&mut self, name: Option<&Spanned<String>>) -> Result<MaterialId> {
        match name {
            Some(name) => self.id(name),
            None => self.id_of("rigid", 0..0),
        }
    }

    /// Whether there is such a material.
    pub(super) fn has(&self, name: &str) -> bool {
        self.defined.contains_key(name) || LIBRARY.contains_key(name)
    }

    fn id_of(&mut self, name: &str, span: std::ops::Range<usize>) -> Result<MaterialId> {
        if let Some(id) = self.used.iter().position(|material| material.name == name) {
            return Ok(id);
        }
        let material = match (self.defined.get(name), LIBRARY.get(name)) {
            (Some(table), _) => in_bands(name, table.get_ref(), self.bands, self.at)?.0,
            (None, Some(table)) => {
                let at = Locator::new(Path::new(LIBRARY_FILE), LIBRARY_TEXT);
                in_bands(name, table.get_ref(), self.bands, &at)?.0
            }
            (None, None) => {
                let own = self.defined.keys().map(|key| key.get_ref().as_str());
                return Err(self.at.error(
                    span,
                    format!("there is no material `{name}`, neither in this file nor built in"),
                    hint_for(name, "materials", own.chain(library_names())),
                ));
            }
        };
        self.used.push(material);
        Ok(self.used.len() - 1)
    }

    /// The materials in the order of their indices.
    pub(super) fn into_used(self) -> Vec<Material> {
        self.used
    }
}

/// A material's spectra in the given bands, and whether its absorption had to be raised to its transmission:
/// transmitted energy counts as absorbed, so that absorbed + reflected = 1.
fn in_bands(name: &str, table: &MaterialTable, bands: &[Band], at: &Locator<'_>) -> Result<(Material, bool)> {
    const SHARE: &str = "a share of the energy, not a percentage";
    let absorption = Quantity { name: "absorption", range: 0.0..=1.0, hint: SHARE };
    let mut absorption = Spectrum::in_bands(&table.absorption, bands, &absorption, at)?;
    let scattering = match &table.scattering {
        None => vec![0.0; bands.len()],
        Some(spectrum) => {
            let quantity = Quantity { name: "scattering", range: 0.0..=1.0, hint: SHARE };
            Spectrum::in_bands(spectrum, bands, &quantity, at)?
        }
    };
    let transmission = match &table.transmission_loss_db {
        None => None,
        Some(spectrum) if matches!(spectrum.get_ref(), Spectrum::Constant(f64::INFINITY)) => None,
        Some(spectrum) => {
            let hint = "in dB; leave it out (or write inf) where nothing passes through";
            let quantity = Quantity { name: "transmission_loss_db", range: 0.0..=200.0, hint };
            let loss_db = Spectrum::in_bands(spectrum, bands, &quantity, at)?;
            Some(loss_db.into_iter().map(|loss| 10f64.powf(-loss / 10.0)).collect::<Vec<_>>())
        }
    };
    let mut raised = false;
    for (absorbed, passed) in absorption.iter_mut().zip(transmission.iter().flatten()) {
        if passed > absorbed {
            *absorbed = *passed;
            raised = true;
        }
    }
    Ok((Material { name: name.to_owned(), absorption, scattering, transmission }, raised))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_library_reads_and_names_a_source_for_every_material() {
        let library = library().expect("the built-in materials must read");
        assert!(library.len() >= 25);
        for entry in &library {
            assert!(!entry.source.is_empty() && !entry.description.is_empty(), "{}", entry.name);
        }
        for name in ["rigid", "concrete", "brick", "plaster", "gypsum", "parquet", "curtain", "wood", "glass", "carpet"]
        {
            assert!(library.iter().any(|entry| entry.name == name), "{name}");
        }
    }

    #[test]
    fn no_built_in_material_lets_more_pass_than_it_absorbs_in_any_octave() {
        let bands = super::super::bands::bands_between(super::super::Spacing::Octave, 63.0, 8000.0);
        let at = Locator::new(Path::new(LIBRARY_FILE), LIBRARY_TEXT);
        for (name, table) in LIBRARY.iter() {
            let (_, raised) = in_bands(name.get_ref(), table.get_ref(), &bands, &at).expect("reads");
            assert!(!raised, "{}", name.get_ref());
        }
    }

    #[test]
    fn rigid_reflects_everything() {
        let library = library().expect("the built-in materials must read");
        let rigid = library.iter().find(|entry| entry.name == "rigid").expect("there is a rigid material");
        assert!(rigid.material.absorption.iter().all(|a| *a == 0.0));
        assert!(rigid.material.transmission.is_none());
    }
}
