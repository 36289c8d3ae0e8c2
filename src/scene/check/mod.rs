//! From a typed room file to a checked scene: every mistake with its place, what is allowed, and a hint.

mod clearance;
mod geometry;
mod openings;
mod options;
mod sound;
mod values;

use std::path::Path;

use super::Scene;
use super::locate::Locator;
use super::materials::Palette;
use super::mesh::MeshFiles;
use super::reference;
use super::room_file::RoomFile;
use crate::error::{Result, Warning};

/// What lies round the text of a room file.
pub(super) struct Surroundings<'a> {
    /// Title of a room without a name.
    pub(super) title: String,
    /// Folder in which files are looked up.
    pub(super) folder: &'a Path,
    /// Geometry files.
    pub(super) meshes: &'a MeshFiles,
}

/// Checks a room file.
///
/// # Errors
/// The first mistake.
pub(super) fn check(
    room: &RoomFile,
    at: &Locator<'_>,
    surroundings: &Surroundings<'_>,
) -> Result<(Scene, Vec<Warning>)> {
    let mut warnings = Vec::new();
    let (spacing, bands) = options::bands(&room.bands, at)?;
    let air = options::air(&room.air, &bands, spacing, at)?;
    let simulation = options::simulation(&room.simulation, at)?;
    let output = options::output(&room.output, &bands, at, &mut warnings)?;

    let mut palette = Palette::new(&room.material, &bands, at, &mut warnings)?;
    let boxes = geometry::boxes(&room.boxes, &mut palette, at)?;
    geometry::overlapping_boxes(&boxes, &mut warnings);
    let walls = geometry::walls(&room.walls, &boxes, &mut palette, at)?;
    geometry::overlapping_walls(&walls, &mut warnings);
    let meshes = geometry::meshes(&room.meshes, surroundings, &mut palette, at, &mut warnings)?;
    let openings = openings::openings(&room.openings, &boxes, &walls, &mut palette, at, &mut warnings)?;
    let materials = palette.into_used();

    let matter = clearance::Matter { boxes: &boxes, walls: &walls, meshes: &meshes, openings: &openings };
    let sources = sound::sources(&room.sources, &bands, &matter, at, &mut warnings)?;
    let probes = sound::probes(&room.probes, &sources, &matter, at, &mut warnings)?;
    sound::outside(&sources, &probes, &matter, &mut warnings);
    options::exact_fits(&room.simulation, &simulation, &matter, at)?;
    let mut sweep = room.sweep.as_ref().map(|table| options::sweep(table, at)).transpose()?;
    if let (Some(sweep), Some(name)) = (&mut sweep, room.sweep.as_ref().and_then(|s| s.get_ref().reference.as_ref())) {
        let sources: Vec<&str> = sources.iter().map(|s| s.name.as_str()).collect();
        let probes: Vec<&str> = probes.iter().map(|p| p.name.as_str()).collect();
        sweep.reference = Some(reference::read(name, surroundings.folder, &sources, &probes, at)?);
    }

    let name = room.name.as_ref().map_or_else(|| surroundings.title.clone(), |name| name.get_ref().clone());
    let scene = Scene {
        name,
        air,
        spacing,
        bands,
        materials,
        boxes,
        walls,
        meshes,
        openings,
        sources,
        probes,
        simulation,
        output,
        sweep,
    };
    Ok((scene, warnings))
}
