//! The room file as typed: every value with its place in the text, nothing checked but types and keys.
//!
//! The meaning of each key stands in docs/room-file.md. Units are part of the keys.

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize;
use serde::de::{Deserializer, Visitor};
use serde_spanned::Spanned;

use super::spectrum::Spectrum;

/// A whole room file.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RoomFile {
    /// Title; default: the file's name without extension.
    pub name: Option<Spanned<String>>,
    /// The medium.
    #[serde(default)]
    pub air: AirTable,
    /// The frequency bands.
    #[serde(default)]
    pub bands: BandsTable,
    /// Materials by name.
    #[serde(default)]
    pub material: BTreeMap<Spanned<String>, Spanned<MaterialTable>>,
    /// Cuboid rooms.
    #[serde(default, rename = "box")]
    pub boxes: Vec<Spanned<BoxTable>>,
    /// Polygons.
    #[serde(default, rename = "wall")]
    pub walls: Vec<Spanned<WallTable>>,
    /// Geometry from other files.
    #[serde(default, rename = "mesh")]
    pub meshes: Vec<Spanned<MeshTable>>,
    /// Holes.
    #[serde(default, rename = "opening")]
    pub openings: Vec<Spanned<OpeningTable>>,
    /// Sources.
    #[serde(default, rename = "source")]
    pub sources: Vec<Spanned<SourceTable>>,
    /// Probes.
    #[serde(default, rename = "probe")]
    pub probes: Vec<Spanned<ProbeTable>>,
    /// Run options.
    #[serde(default)]
    pub simulation: SimulationTable,
    /// Impulse response options.
    #[serde(default)]
    pub output: OutputTable,
    /// A parameter sweep.
    pub sweep: Option<Spanned<SweepTable>>,
}

/// `[air]`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AirTable {
    /// Degrees Celsius.
    pub temperature_c: Option<Spanned<f64>>,
    /// Percent.
    pub relative_humidity_percent: Option<Spanned<f64>>,
    /// kPa.
    pub pressure_kpa: Option<Spanned<f64>>,
    /// m/s.
    pub speed_of_sound_m_s: Option<Spanned<f64>>,
    /// Whether the air absorbs.
    pub absorption: Option<Spanned<bool>>,
}

/// `[bands]`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BandsTable {
    /// "octave", "third-octave" or "tones".
    pub spacing: Option<Spanned<String>>,
    /// Lowest nominal centre in Hz.
    pub from_hz: Option<Spanned<f64>>,
    /// Highest nominal centre in Hz.
    pub to_hz: Option<Spanned<f64>>,
    /// Tones in Hz.
    pub frequencies_hz: Option<Spanned<Vec<Spanned<f64>>>>,
}

/// `[material.NAME]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialTable {
    /// Absorbed or transmitted share of the incident energy.
    pub absorption: Spanned<Spectrum>,
    /// Share of the reflected energy that is scattered.
    pub scattering: Option<Spanned<Spectrum>>,
    /// Transmission loss in dB.
    pub transmission_loss_db: Option<Spanned<Spectrum>>,
    /// What it is, for people.
    pub description: Option<Spanned<String>>,
    /// Where the numbers come from, for people.
    pub source: Option<Spanned<String>>,
}

/// `[[box]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoxTable {
    /// Name.
    pub name: Spanned<String>,
    /// Lower corner in m.
    pub min_m: Spanned<[f64; 3]>,
    /// Upper corner in m.
    pub max_m: Spanned<[f64; 3]>,
    /// Material of the faces not named in `faces`.
    pub material: Option<Spanned<String>>,
    /// Exceptions.
    #[serde(default)]
    pub faces: FacesTable,
}

/// `faces` of a box: material name or "none".
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FacesTable {
    /// x = min
    pub x_min: Option<Spanned<String>>,
    /// x = max
    pub x_max: Option<Spanned<String>>,
    /// y = min
    pub y_min: Option<Spanned<String>>,
    /// y = max
    pub y_max: Option<Spanned<String>>,
    /// z = min
    pub floor: Option<Spanned<String>>,
    /// z = max
    pub ceiling: Option<Spanned<String>>,
}

/// `[[wall]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WallTable {
    /// Name.
    pub name: Spanned<String>,
    /// Corners in m.
    pub corners_m: Spanned<Vec<Spanned<[f64; 3]>>>,
    /// Material of both sides; default "rigid".
    pub material: Option<Spanned<String>>,
    /// Thickness in m.
    pub thickness_m: Option<Spanned<f64>>,
    /// Whether it is the whole plane.
    pub unbounded: Option<Spanned<bool>>,
}

/// `[[mesh]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshTable {
    /// Path relative to the room file.
    pub file: Spanned<String>,
    /// Metres per unit of the file.
    pub scale: Option<Spanned<f64>>,
    /// The file's axis that points up, "y" or "z".
    pub up: Option<Spanned<String>>,
    /// Material of the triangles whose own is not named in `materials`.
    pub material: Option<Spanned<String>>,
    /// The file's material name -> material.
    #[serde(default)]
    pub materials: BTreeMap<Spanned<String>, Spanned<String>>,
}

/// `[[opening]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpeningTable {
    /// Name.
    pub name: Spanned<String>,
    /// Name of a wall, or BOX.FACE.
    pub wall: Spanned<String>,
    /// Limits along local x in m.
    pub x_m: Spanned<[f64; 2]>,
    /// Limits along local y in m.
    pub y_m: Option<Spanned<[f64; 2]>>,
    /// Door leaf.
    pub door: Option<Spanned<DoorTable>>,
}

/// `door` of an opening.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DoorTable {
    /// "sliding".
    pub kind: Option<Spanned<String>>,
    /// Width left open in m.
    pub open_m: Spanned<f64>,
    /// "x_min" or "x_max": the jamb at which the door opens.
    pub fixed_jamb: Option<Spanned<String>>,
    /// Material of the leaf; default "rigid".
    pub material: Option<Spanned<String>>,
    /// Thickness of the leaf in m.
    pub thickness_m: Option<Spanned<f64>>,
}

/// `[[source]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceTable {
    /// Name.
    pub name: Spanned<String>,
    /// Position in m.
    pub position_m: Spanned<[f64; 3]>,
    /// "point", "line" or "plane".
    pub kind: Option<Spanned<String>>,
    /// Direction of a line source.
    pub axis: Option<Spanned<[f64; 3]>>,
    /// Direction of a plane wave, axis of a directivity.
    pub direction: Option<Spanned<[f64; 3]>>,
    /// Sound power level in dB re 1 pW.
    pub power_db: Option<Spanned<Spectrum>>,
    /// Name of a directivity.
    pub directivity: Option<Spanned<String>>,
}

/// `[[probe]]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ProbeTable {
    /// Name.
    pub name: Spanned<String>,
    /// Position in m.
    pub position_m: Spanned<[f64; 3]>,
    /// What its impulse response records.
    pub format: Option<Spanned<String>>,
    /// The axis of its pattern.
    pub direction: Option<Spanned<[f64; 3]>>,
}

/// `[simulation]`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulationTable {
    /// Seed.
    pub seed: Option<Spanned<Whole>>,
    /// Standard error in dB to reach.
    pub target_db: Option<Spanned<f64>>,
    /// Upper bound of rays.
    pub max_rays: Option<Spanned<Whole>>,
    /// Upper bound of time in s.
    pub max_time_s: Option<Spanned<f64>>,
    /// Deterministic reflections.
    pub reflection_order: Option<Spanned<Whole>>,
    /// Diffractions in a row.
    pub diffraction_order: Option<Spanned<Whole>>,
    /// "auto", "openings" or "off".
    pub edges: Option<Spanned<String>>,
    /// "wbsdf", "paraxial", "geometric", "utd" or "exact".
    pub transport: Option<Spanned<String>>,
    /// Whether deterministic paths add as pressures.
    pub interference: Option<bool>,
}

/// `[output]`
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OutputTable {
    /// Hz.
    pub sample_rate_hz: Option<Spanned<Whole>>,
    /// s.
    pub response_length_s: Option<Spanned<f64>>,
    /// dB.
    pub signal_to_noise_db: Option<Spanned<f64>>,
}

/// `[sweep]`
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SweepTable {
    /// Path of a number in the room file.
    pub parameter: Spanned<String>,
    /// First value.
    pub from: Option<Spanned<f64>>,
    /// Last value.
    pub to: Option<Spanned<f64>>,
    /// Step.
    pub step: Option<Spanned<f64>>,
    /// All values, instead.
    pub values: Option<Spanned<Vec<Spanned<f64>>>>,
    /// CSV file of levels to compare with, relative to the room file.
    pub reference: Option<Spanned<String>>,
}

/// A whole number from 0, which may be written 1e7.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Whole(pub u64);

impl<'de> Deserialize<'de> for Whole {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(WholeVisitor)
    }
}

struct WholeVisitor;

impl Visitor<'_> for WholeVisitor {
    type Value = Whole;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a whole number from 0")
    }

    fn visit_u64<E>(self, value: u64) -> Result<Whole, E> {
        Ok(Whole(value))
    }

    fn visit_i64<E: serde::de::Error>(self, value: i64) -> Result<Whole, E> {
        u64::try_from(value).map(Whole).map_err(|_| E::custom(format!("{value} is negative, must be at least 0")))
    }

    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<Whole, E> {
        /// Whole numbers up to here are exact in f64.
        const EXACT: f64 = 9_007_199_254_740_992.0;
        if value.fract() == 0.0 && (0.0..=EXACT).contains(&value) {
            Ok(Whole(value as u64))
        } else {
            Err(E::custom(format!("{value} is not a whole number from 0")))
        }
    }
}
