//! Everything that is written for people or programs: CSV tables, `run.json`, tables on the terminal and one
//! self-contained `report.html`.
//!
//! The functions here take plain data (what was asked, what was received) and compute nothing physical beyond
//! decibels. Files are first written to a [`Folder`] and moved to their place together when all of them are complete.

mod beside;
mod charts;
pub(crate) mod console;
mod folder;
pub(crate) mod html;
pub(crate) mod ink;
pub(crate) mod notation;
pub(crate) mod pareto;
mod record;
mod series;
mod tables;

use std::io::Write as _;

use crate::error::{Result, Warning};
use crate::probe::{Reception, TableCost};
use crate::response::{Metrics, Response};
use crate::scene::{Air, Band, Output, RoomSource, Scene, Simulation, Source, SourceKind};

use record::Record;

pub use beside::{Comparison, comparisons};
pub use console::{levels_table, rises_table};
pub use folder::{Folder, check_writable};
pub use series::{Rise, Series, SeriesPoint, SweepValue, rises};
pub use tables::{write_bands, write_closing, write_metrics, write_sweep};

/// What was asked for and how the run went; shared by simulations and sweeps.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Name of the scene.
    pub name: String,
    /// The room file.
    pub source: RoomSource,
    /// The values that were changed on the command line, as `PATH=VALUE`.
    pub set: Vec<String>,
    /// The bands in ascending order.
    pub bands: Vec<Band>,
    /// Run options.
    pub simulation: Simulation,
    /// Impulse response options.
    pub output: Output,
    /// Sound pressure level in dB re 20 uPa of each source's free field at 1 m, one a band; only sources with a power.
    pub spl_1m_db: Vec<(String, Vec<f64>)>,
    /// The plan as data.
    pub plan: serde_json::Value,
    /// The plan in words, as `diffray plan` prints it.
    pub plan_text: String,
    /// Number of rays traced.
    pub rays: u64,
    /// Why the tracing ended.
    pub stop: String,
    /// Seconds spent, by phase, in order.
    pub times_s: Vec<(String, f64)>,
    /// What the openings on deterministic paths cost.
    pub opening_tables: Vec<TableCost>,
    /// What the user should know about the results.
    pub warnings: Vec<Warning>,
}

impl Run {
    /// What was asked for, before anything ran.
    pub fn of(scene: &Scene, source: RoomSource, set: Vec<String>) -> Run {
        Run {
            name: scene.name.clone(),
            source,
            set,
            bands: scene.bands.clone(),
            simulation: scene.simulation.clone(),
            output: scene.output.clone(),
            spl_1m_db: spl_of_sources(scene),
            plan: serde_json::Value::Null,
            plan_text: String::new(),
            rays: 0,
            stop: String::new(),
            times_s: Vec::new(),
            opening_tables: Vec::new(),
            warnings: Vec::new(),
        }
    }

    /// Sound pressure level in dB re 20 uPa of a source's free field at 1 m in the band with this index.
    fn spl_1m_db(&self, source: &str, band: usize) -> Option<f64> {
        self.spl_1m_db.iter().find(|(name, _)| name == source).and_then(|(_, levels)| levels.get(band).copied())
    }
}

/// Sound pressure level of each source's free field at 1 m, one a band (see [`spl_at_1m_db`]), with the source's name; only
/// sources with a power.
pub fn spl_of_sources(scene: &Scene) -> Vec<(String, Vec<f64>)> {
    let with_power = |s: &Source| spl_at_1m_db(s, &scene.air).map(|levels| (s.name.clone(), levels));
    scene.sources.iter().filter_map(with_power).collect()
}

/// Sound pressure level in dB re 20 uPa of the source's free field at 1 m (on its axis), one a band, from its power.
///
/// L_p = L_W - 10 lg(S / 1 m^2) + 10 lg Q + 10 lg(rho c / 400 Pa s/m), S = 4 pi for a point source (power re 1 pW),
/// 2 pi for a line source (power per metre re 1 pW/m), 1 for a plane wave (intensity re 1 pW/m^2); Q is the axial
/// factor of the directivity, 1/(a^2 + (1-a)^2/3), for point sources and 1 for the others. rho c from the ideal gas
/// law with R = 287.05 J/(kg K) and the scene's speed of sound.
pub fn spl_at_1m_db(source: &Source, air: &Air) -> Option<Vec<f64>> {
    use std::f64::consts::PI;
    let power_db = source.power_db.as_ref()?;
    let a = source.directivity.omni_share;
    let (area_m2, axial_factor) = match source.kind {
        SourceKind::Point => (4.0 * PI, 1.0 / (a * a + (1.0 - a) * (1.0 - a) / 3.0)),
        SourceKind::Line(_) => (2.0 * PI, 1.0),
        SourceKind::Plane(_) => (1.0, 1.0),
    };
    let density_kg_m3 = 1000.0 * air.pressure_kpa / (287.05 * (air.temperature_c + 273.15));
    let impedance = density_kg_m3 * air.speed_of_sound_m_s;
    let offset_db = 10.0 * (axial_factor * impedance / (400.0 * area_m2)).log10();
    Some(power_db.iter().map(|p| p + offset_db).collect())
}

/// Everything about one source at one probe.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    /// What arrived.
    pub reception: Reception,
    /// The impulse response, where there is one.
    pub response: Option<Response>,
    /// Decay and clarity, one entry a band; may be empty.
    pub metrics: Vec<Metrics>,
    /// The same as measured of the impulse response; may be empty.
    pub response_metrics: Vec<Metrics>,
    /// Speech transmission index of the impulse response, if there is one and it can be had.
    pub speech_transmission_index: Option<f64>,
}

/// A curve from elsewhere (theory, measurement) to be drawn over a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceCurve {
    /// What it is, for the legend.
    pub label: String,
    /// Name of the source it belongs to.
    pub source: String,
    /// Name of the probe it belongs to.
    pub probe: String,
    /// Nominal centre of the band in Hz.
    pub band_hz: f64,
    /// (value of the swept parameter, level in dB re the free field at 1 m), ascending in the value.
    pub points: Vec<(f64, f64)>,
}

/// The results of one simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Simulated {
    /// What was asked for and how it went.
    pub run: Run,
    /// One entry a source and probe.
    pub pairs: Vec<Pair>,
}

impl Simulated {
    /// What the probes received.
    fn receptions(&self) -> impl Iterator<Item = &Reception> + Clone {
        self.pairs.iter().map(|p| &p.reception)
    }

    /// Writes `bands.csv`, `ir/<source>-<probe>.wav`, `metrics.csv`, `report.html` and `run.json`; without impulse
    /// responses or metrics their files are left out.
    ///
    /// # Errors
    /// [`crate::error::Error::File`] if a file cannot be written.
    pub fn write(&self, folder: &mut Folder) -> Result<()> {
        folder.write("bands.csv", |out| write_bands(out, &self.run, self.receptions()))?;
        if self.pairs.iter().any(|p| !p.metrics.is_empty()) {
            folder.write("metrics.csv", |out| write_metrics(out, &self.pairs))?;
        }
        for pair in &self.pairs {
            if let Some(response) = &pair.response {
                let stem = format!("ir/{}-{}", file_part(&pair.reception.source), file_part(&pair.reception.probe));
                response.write_wav(&folder.new_path(&stem, ".wav")?)?;
            }
        }
        let page = html::simulation_page(self)?;
        folder.write("report.html", |out| out.write_all(page.as_bytes()))?;
        let files = folder.files();
        folder.write_record(&Record::of_simulation(self, files))
    }
}

/// A name as part of a file name: separators and what some systems refuse become `_`.
pub fn file_part(name: &str) -> String {
    let allowed = |c: char| !c.is_control() && !"/\\:*?\"<>|".contains(c);
    name.chars().map(|c| if allowed(c) { c } else { '_' }).collect()
}

/// The results of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Swept {
    /// What was asked for and how it went, all values together.
    pub run: Run,
    /// Path of the swept value in the room file, as `opening.door.open_m`.
    pub parameter: String,
    /// Level against value, one entry a source, probe and band.
    pub series: Vec<Series>,
    /// Curves from elsewhere to compare with; may be empty.
    pub references: Vec<ReferenceCurve>,
}

impl Swept {
    /// Writes `sweep.csv`, `closing.csv`, `run.json` and `report.html`.
    ///
    /// # Errors
    /// [`crate::error::Error::File`] if a file cannot be written.
    pub fn write(&self, folder: &mut Folder) -> Result<()> {
        folder.write("sweep.csv", |out| write_sweep(out, &self.series))?;
        folder.write("closing.csv", |out| write_closing(out, &self.series))?;
        let page = html::sweep_page(self)?;
        folder.write("report.html", |out| out.write_all(page.as_bytes()))?;
        let files = folder.files();
        folder.write_record(&Record::of_sweep(self, files))
    }
}
