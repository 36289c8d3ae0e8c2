//! The checked scene: everything of a room file in SI units, ready to be planned and run.
//!
//! `room.toml` (text) -> [`RoomFile`] (as typed) -> [`Scene`] (checked). Nothing downstream of [`Scene`] meets
//! an impossible value.

mod air;
mod bands;
mod check;
mod locate;
mod materials;
mod mesh;
mod overrides;
mod polygon;
mod reference;
mod room;
pub mod room_file;
mod spectrum;

use std::path::PathBuf;

use glam::{DVec2, DVec3};

pub use air::{
    attenuation_db_per_m, intensity_attenuation_per_m, midband_hz, speed_of_sound_m_s, water_vapour_percent,
};
pub use bands::{band, bands_between, nominal_centres_hz};
pub use materials::{LibraryEntry, library};
pub use overrides::{Override, parse_sweep};
pub use reference::{Reference, ReferenceRow};
pub use room::{Loaded, Room, RoomSource};
pub use room_file::RoomFile;
pub use spectrum::Spectrum;

/// One frequency band, or one tone.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Band {
    /// Nominal centre in Hz as in IEC 61260-1 (what is printed); the frequency itself for a tone.
    pub nominal_hz: f64,
    /// Lower edge in Hz; equal to `high_hz` for a tone.
    pub low_hz: f64,
    /// Upper edge in Hz.
    pub high_hz: f64,
}

impl Band {
    /// Whether this is a single frequency rather than a band.
    pub fn is_tone(&self) -> bool {
        self.low_hz == self.high_hz
    }

    /// `count` bands of the same width in octaves that make up this one, each named by its geometric centre.
    pub fn parts(&self, count: usize) -> impl Iterator<Item = Self> + use<> {
        let Self { low_hz, high_hz, .. } = *self;
        let at = move |i: usize| low_hz * (high_hz / low_hz).powf(i as f64 / count as f64);
        (0..count).map(move |i| Self { nominal_hz: (at(i) * at(i + 1)).sqrt(), low_hz: at(i), high_hz: at(i + 1) })
    }
}

/// How the bands were asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spacing {
    /// Edges at nominal centre * 2^(+-1/2).
    Octave,
    /// Edges at nominal centre * 2^(+-1/6).
    ThirdOctave,
    /// Single frequencies, no mean.
    Tones,
}

/// The medium.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Air {
    /// Temperature in degrees Celsius.
    pub temperature_c: f64,
    /// Relative humidity in percent.
    pub relative_humidity_percent: f64,
    /// Static pressure in kPa.
    pub pressure_kpa: f64,
    /// Speed of sound in m/s.
    pub speed_of_sound_m_s: f64,
    /// Whether the air absorbs (ISO 9613-1).
    pub absorption: bool,
    /// Intensity attenuation in Np/m (exp(-m r)), one a band; zero without absorption.
    pub attenuation_per_m: Vec<f64>,
}

/// A surface material; every spectrum has one value a band of the scene.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Material {
    /// Its name in the room file or the library.
    pub name: String,
    /// Absorbed (or transmitted) share of the incident energy, 0..=1.
    pub absorption: Vec<f64>,
    /// Share of the reflected energy that leaves by Lambert's law, 0..=1.
    pub scattering: Vec<f64>,
    /// Transmitted share of the incident energy, 10^(-TL/10); `None`: nothing passes.
    pub transmission: Option<Vec<f64>>,
}

/// Index of a material in [`Scene::materials`].
pub type MaterialId = usize;

/// The faces of a box in the order of [`BoxRoom::faces`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Face {
    /// x = min.x
    XMin,
    /// x = max.x
    XMax,
    /// y = min.y
    YMin,
    /// y = max.y
    YMax,
    /// z = min.z
    Floor,
    /// z = max.z
    Ceiling,
}

impl Face {
    /// All six, in index order.
    pub const ALL: [Face; 6] = [Face::XMin, Face::XMax, Face::YMin, Face::YMax, Face::Floor, Face::Ceiling];

    /// Its name in a room file.
    pub fn name(self) -> &'static str {
        match self {
            Face::XMin => "x_min",
            Face::XMax => "x_max",
            Face::YMin => "y_min",
            Face::YMax => "y_max",
            Face::Floor => "floor",
            Face::Ceiling => "ceiling",
        }
    }
}

/// A closed cuboid seen from inside.
#[derive(Debug, Clone, PartialEq)]
pub struct BoxRoom {
    /// Name.
    pub name: String,
    /// Lower corner in m.
    pub min_m: DVec3,
    /// Upper corner in m.
    pub max_m: DVec3,
    /// Material of each face in the order of [`Face::ALL`]; `None`: the face is not there.
    pub faces: [Option<MaterialId>; 6],
}

impl BoxRoom {
    /// Material of a face; `None`: the face is not there.
    pub fn face(&self, face: Face) -> Option<MaterialId> {
        self.faces[face as usize]
    }

    /// Local frame of a face: local x and y run along the two increasing world axes in the face, in the order x, y, z;
    /// the origin is the face's corner with the smallest coordinates. The normal, x cross y, points into the box on
    /// x_min, y_max and floor, out of it on x_max, y_min and ceiling.
    pub fn face_frame(&self, face: Face) -> Frame {
        let (x, y) = match face {
            Face::XMin | Face::XMax => (DVec3::Y, DVec3::Z),
            Face::YMin | Face::YMax => (DVec3::X, DVec3::Z),
            Face::Floor | Face::Ceiling => (DVec3::X, DVec3::Y),
        };
        let mut origin_m = self.min_m;
        match face {
            Face::XMax => origin_m.x = self.max_m.x,
            Face::YMax => origin_m.y = self.max_m.y,
            Face::Ceiling => origin_m.z = self.max_m.z,
            Face::XMin | Face::YMin | Face::Floor => {}
        }
        Frame { origin_m, x, y, normal: x.cross(y) }
    }

    /// Lengths of a face along its local x and y in m.
    pub fn face_size_m(&self, face: Face) -> [f64; 2] {
        let size = self.max_m - self.min_m;
        match face {
            Face::XMin | Face::XMax => [size.y, size.z],
            Face::YMin | Face::YMax => [size.x, size.z],
            Face::Floor | Face::Ceiling => [size.x, size.y],
        }
    }
}

/// A planar, two-sided polygon.
#[derive(Debug, Clone, PartialEq)]
pub struct Wall {
    /// Name.
    pub name: String,
    /// At least three corners in m, planar to 1e-6 of their extent, simple, in order.
    pub corners_m: Vec<DVec3>,
    /// Material of both sides.
    pub material: MaterialId,
    /// Thickness in m, centred on the polygon.
    pub thickness_m: f64,
    /// Whether it is the whole plane of its corners.
    pub unbounded: bool,
    /// Local frame: origin at corner 1, x towards corner 2, y at right angles towards the other corners.
    pub frame: Frame,
}

impl Wall {
    /// Its corners in the local frame, in m.
    pub fn outline_m(&self) -> Vec<DVec2> {
        self.corners_m.iter().map(|corner| self.frame.local(*corner).truncate()).collect()
    }
}

/// A right-handed local frame of a plane: x, y in the plane, `normal` = x cross y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Origin in m.
    pub origin_m: DVec3,
    /// Unit vector along local x.
    pub x: DVec3,
    /// Unit vector along local y.
    pub y: DVec3,
    /// Unit normal.
    pub normal: DVec3,
}

impl Frame {
    /// World position of the local point (x, y) in m.
    pub fn point(&self, x_m: f64, y_m: f64) -> DVec3 {
        self.origin_m + self.x * x_m + self.y * y_m
    }

    /// Local coordinates (x, y, height over the plane) of a world point, in m.
    pub fn local(&self, p: DVec3) -> DVec3 {
        self.turn(p - self.origin_m)
    }

    /// Components of a direction along local x, y and the normal.
    pub fn turn(&self, d: DVec3) -> DVec3 {
        DVec3::new(d.dot(self.x), d.dot(self.y), d.dot(self.normal))
    }
}

/// Triangles read from a file next to the room file.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// The file as given.
    pub file: PathBuf,
    /// Corners of each triangle in m.
    pub triangles_m: Vec<[DVec3; 3]>,
    /// Material of each triangle.
    pub materials: Vec<MaterialId>,
}

/// What an opening is cut into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Host {
    /// Index in [`Scene::walls`].
    Wall(usize),
    /// A face of the box with this index in [`Scene::boxes`].
    BoxFace(usize, Face),
}

/// A door leaf: the part of the hole it covers.
#[derive(Debug, Clone, PartialEq)]
pub struct Leaf {
    /// Covered interval along local x in m, not empty.
    pub x_m: [f64; 2],
    /// Its material.
    pub material: MaterialId,
    /// Its thickness in m.
    pub thickness_m: f64,
}

/// A hole in a wall or box face, in the host's local frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Opening {
    /// Name.
    pub name: String,
    /// What it is cut into.
    pub host: Host,
    /// The host's local frame (box faces: see docs/room-file.md).
    pub frame: Frame,
    /// Limits of the hole along local x in m, ascending; may be infinite on an unbounded wall.
    pub hole_x_m: [f64; 2],
    /// Limits along local y in m, ascending; infinite for a slit.
    pub y_m: [f64; 2],
    /// The part that the leaf leaves open, ascending; empty (equal limits) when the door is closed.
    pub open_x_m: [f64; 2],
    /// The door leaf, if it covers anything.
    pub leaf: Option<Leaf>,
}

impl Opening {
    /// Whether nothing is open.
    pub fn is_closed(&self) -> bool {
        self.open_x_m[1] <= self.open_x_m[0]
    }

    /// Whether it is infinitely long along local y.
    pub fn is_slit(&self) -> bool {
        self.y_m[0] == f64::NEG_INFINITY && self.y_m[1] == f64::INFINITY
    }
}

/// The kind of a source.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SourceKind {
    /// A point.
    Point,
    /// An infinite line through the position along this unit vector.
    Line(DVec3),
    /// A plane wave travelling along this unit vector.
    Plane(DVec3),
}

/// A first-order directivity |a + (1-a) cos| about an axis, 1 on the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Directivity {
    /// The omnidirectional share a: 1 omni, 0.5 cardioid, 0 dipole.
    pub omni_share: f64,
    /// Unit vector of the axis.
    pub axis: DVec3,
}

impl Directivity {
    /// Intensity towards the unit vector `d`, relative to the axis.
    pub fn intensity(&self, d: DVec3) -> f64 {
        let p = self.omni_share + (1.0 - self.omni_share) * d.dot(self.axis);
        p * p
    }
}

/// A sound source.
#[derive(Debug, Clone, PartialEq)]
pub struct Source {
    /// Name.
    pub name: String,
    /// Position in m.
    pub position_m: DVec3,
    /// Point, line or plane.
    pub kind: SourceKind,
    /// Sound power level in dB re 1 pW, one a band.
    pub power_db: Option<Vec<f64>>,
    /// Directivity.
    pub directivity: Directivity,
}

/// A microphone.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// Name.
    pub name: String,
    /// Position in m.
    pub position_m: DVec3,
    /// What its impulse response records.
    pub format: ProbeFormat,
}

/// What a probe's impulse response records.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProbeFormat {
    /// The pressure.
    Omni,
    /// All spherical harmonics up to this order (1 to 3), ACN order, SN3D normalisation.
    Ambix(usize),
    /// A pattern of first order, its axis towards what is heard best.
    Pattern(Directivity),
}

/// Which edges diffract.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Edges {
    /// Convex edges of the geometry and all openings.
    Auto,
    /// Openings only.
    Openings,
    /// None: the ablation. Openings are plain holes.
    Off,
}

/// How diffraction is modelled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Transport {
    /// Signed rays with the Keller-calibrated wave BSDF.
    Wbsdf,
    /// The published small-angle form.
    Paraxial,
    /// No diffraction.
    Geometric,
    /// The coherent second opinion: uniform theory of diffraction, pressures added over all paths.
    Utd,
    /// The exact solution at many frequencies a band: openings of one unbounded wall only.
    Exact,
}

/// Relative accuracy asked of the sums over signed rays: 0.01 dB, a tenth of what the model itself is off.
pub const RAY_TOLERANCE: f64 = 2e-3;

/// Options of a run.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Simulation {
    /// Seed of every random number.
    pub seed: u64,
    /// Standard error in dB at which the run stops.
    pub target_db: f64,
    /// Upper bound of traced rays, all sources together.
    pub max_rays: u64,
    /// Upper bound of tracing time in s.
    pub max_time_s: f64,
    /// Deterministic specular reflections.
    pub reflection_order: usize,
    /// 0: no diffraction; 1: a deterministic path bends over one edge or opening; from 2 on over two edges too.
    pub diffraction_order: usize,
    /// Which edges diffract.
    pub edges: Edges,
    /// How diffraction is modelled.
    pub transport: Transport,
    /// Whether the deterministic paths of a source add as pressures rather than as energies.
    pub interference: bool,
    /// Relative accuracy of the sums over signed rays; no key of the room file, `verify` varies it.
    pub ray_tolerance: f64,
}

/// Options of the impulse responses.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Output {
    /// Sample rate in Hz.
    pub sample_rate_hz: u32,
    /// Length in s; `None`: from the decay.
    pub response_length_s: Option<f64>,
    /// Signal-to-noise ratio in dB for the speech transmission index; `None`: no noise.
    pub signal_to_noise_db: Option<f64>,
}

/// A parameter sweep.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Sweep {
    /// Path of the value in the room file, as `opening.door.open_m`.
    pub parameter: String,
    /// The values in the order given.
    pub values: Vec<f64>,
    /// Levels from elsewhere to be shown beside the results.
    pub reference: Option<Reference>,
}

/// A checked scene in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Name.
    pub name: String,
    /// The medium.
    pub air: Air,
    /// How the bands were asked for.
    pub spacing: Spacing,
    /// The bands in ascending order.
    pub bands: Vec<Band>,
    /// All materials in use.
    pub materials: Vec<Material>,
    /// Cuboid rooms.
    pub boxes: Vec<BoxRoom>,
    /// Polygons.
    pub walls: Vec<Wall>,
    /// Imported meshes.
    pub meshes: Vec<Mesh>,
    /// Holes.
    pub openings: Vec<Opening>,
    /// Sources.
    pub sources: Vec<Source>,
    /// Probes.
    pub probes: Vec<Probe>,
    /// Run options.
    pub simulation: Simulation,
    /// Impulse response options.
    pub output: Output,
    /// The file's own sweep.
    pub sweep: Option<Sweep>,
}

impl Scene {
    /// The edge along local x in m of the half-plane that `opening` leaves of an unbounded wall, and the direction (sign of
    /// local x) in which the wall lies; `None` for other openings, walls with several openings, and thick walls.
    pub fn half_plane(&self, opening: &Opening) -> Option<(f64, f64)> {
        let Host::Wall(wall) = opening.host else { return None };
        let alone = self.openings.iter().filter(|o| o.host == opening.host).count() == 1;
        if !(self.walls[wall].unbounded && self.walls[wall].thickness_m == 0.0 && alone && opening.is_slit()) {
            return None;
        }
        match opening.open_x_m {
            [low, high] if low.is_finite() && high == f64::INFINITY && opening.leaf.is_none() => Some((low, -1.0)),
            [low, high] if low == f64::NEG_INFINITY && high.is_finite() && opening.leaf.is_none() => Some((high, 1.0)),
            _ => None,
        }
    }

    /// The same scene with every band divided into `count` (see [`Band::parts`]), whose air absorbs as it does at their own centres.
    pub fn divided(&self, count: usize) -> Self {
        let mut scene = self.clone();
        let each = |values: &[f64]| values.iter().flat_map(|v| std::iter::repeat_n(*v, count)).collect::<Vec<f64>>();
        scene.bands = self.bands.iter().flat_map(|band| band.parts(count)).collect();
        for material in &mut scene.materials {
            material.absorption = each(&material.absorption);
            material.scattering = each(&material.scattering);
            material.transmission = material.transmission.as_deref().map(each);
        }
        for source in &mut scene.sources {
            source.power_db = source.power_db.as_deref().map(each);
        }
        let Air { temperature_c, relative_humidity_percent, pressure_kpa, .. } = self.air;
        if self.air.absorption {
            let at = |hz| attenuation_db_per_m(hz, temperature_c, relative_humidity_percent, pressure_kpa);
            scene.air.attenuation_per_m =
                scene.bands.iter().map(|band| intensity_attenuation_per_m(at(band.nominal_hz))).collect();
        } else {
            scene.air.attenuation_per_m = each(&self.air.attenuation_per_m);
        }
        scene
    }

    /// Whether the deterministic paths of a source add as pressures.
    pub fn adds_pressures(&self) -> bool {
        self.simulation.interference || self.simulation.transport == Transport::Utd
    }

    /// Depth in m of the gap that `opening` leaves: the thickness of its wall, or of the leaf beside the gap if that is
    /// given and less. 0 for faces of boxes.
    pub fn gap_depth_m(&self, opening: &Opening) -> f64 {
        let Host::Wall(wall) = opening.host else { return 0.0 };
        let leaf_m = opening.leaf.as_ref().map(|leaf| leaf.thickness_m).filter(|t| *t > 0.0);
        leaf_m.map_or(self.walls[wall].thickness_m, |t| t.min(self.walls[wall].thickness_m))
    }
}
