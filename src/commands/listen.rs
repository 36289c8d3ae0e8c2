//! `diffray listen` and `sweep --listen`: recordings convolved with impulse responses.

use std::path::Path;

use diffray::error::{Error, Result};
use diffray::geometry::Geometry;
use diffray::plan::Plan;
use diffray::report::{self, Folder, file_part};
use diffray::response::{Dry, Response, heard};
use diffray::scene::{Loaded, Override, Room};
use diffray::simulate;
use diffray::sweep::SweepPoint;

use crate::cli::{self, ListenArgs};
use crate::progress::Bar;

/// Peak of the loudest file, full scale 1: -1 dB.
const PEAK: f64 = 0.891_250_938;

/// Files to be heard side by side: name without ending, and the sound; and the gain they share.
pub(super) struct Heard {
    files: Vec<(String, Response)>,
    gain: f64,
}

impl Heard {
    /// Brings the loudest of the files to -1 dB of full scale.
    fn new(mut files: Vec<(String, Response)>) -> Self {
        let samples = |r: &Response| r.others.iter().chain([&r.samples]).flatten().fold(0.0_f32, |a, b| a.max(b.abs()));
        let peak = files.iter().map(|(_, r)| f64::from(samples(r))).fold(0.0, f64::max);
        let gain = if peak > 0.0 { PEAK / peak } else { 1.0 };
        for (_, response) in &mut files {
            let channels = response.others.iter_mut().chain([&mut response.samples]);
            channels.flatten().for_each(|s| *s = (f64::from(*s) * gain) as f32);
        }
        Self { files, gain }
    }

    /// Writes all files; `prefix`: their folder, with a slash.
    pub(super) fn write(&self, folder: &mut Folder, prefix: &str) -> Result<()> {
        self.files
            .iter()
            .try_for_each(|(name, sound)| sound.write_wav(&folder.new_path(&format!("{prefix}{name}"), ".wav")?))
    }

    /// The gain in words.
    pub(super) fn text(&self) -> String {
        format!(
            "{} to listen to, all with a gain of {:+.1} dB (0 dB: the recording at 1 m in the free field)\n",
            super::counted(self.files.len(), "file"),
            20.0 * self.gain.log10()
        )
    }
}

/// `response` as the recording sounds through it, or itself if there is none.
fn through(dry: Option<&Dry>, response: Response) -> Result<Response> {
    let Some(dry) = dry else { return Ok(response) };
    let mut channels = heard(dry, &response)?.into_iter().map(|c| c.iter().map(|s| *s as f32).collect::<Vec<f32>>());
    Ok(Response { samples: channels.next().unwrap_or_default(), others: channels.collect(), ..response })
}

/// Runs, convolves and writes.
pub(super) fn run(args: &ListenArgs) -> Result<()> {
    let dry = Dry::read(&args.dry)?;
    let (Loaded { scene, warnings, .. }, _) = super::load(&args.run.room)?;
    // A folder of its own: what an earlier run left beside it stays.
    let out = args.run.out().join("listen");
    report::check_writable(&out)?;
    super::use_threads(args.run.threads)?;
    cli::warn(&warnings);
    let bar = Bar::new(1, &scene.simulation, args.run.quiet);
    let geometry = Geometry::new(&scene)?;
    let plan = Plan::new(&scene, &geometry);
    let outcome = simulate::run(&scene, &geometry, &plan, &|progress| bar.traced(0, "", &progress))?;
    drop(bar);
    cli::warn(&outcome.warnings);
    let mut files = Vec::new();
    for reception in &outcome.receptions {
        match super::rendered(&scene, reception) {
            Ok(response) => {
                cli::warn(&response.warnings);
                let name = format!("{}-{}", file_part(&reception.source), file_part(&reception.probe));
                files.push((name, through(Some(&dry), response)?));
            }
            Err(warning) => cli::warn(&[warning]),
        }
    }
    if files.is_empty() {
        return Err(Error::Run("there is no impulse response to listen to".to_owned()));
    }
    let heard = Heard::new(files);
    super::publish(&out, args.run.quiet, |folder| heard.write(folder, ""))?;
    cli::print(&heard.text())
}

/// One file a value of a sweep, source and probe; `dry`: the recording, or nothing for the impulse responses themselves.
pub(super) fn steps(
    room: &Room,
    overrides: &[Override],
    parameter: &str,
    points: &[SweepPoint],
    dry: &Path,
) -> Result<Heard> {
    let dry = (dry != Path::new("-")).then(|| Dry::read(dry)).transpose()?;
    let mut files = Vec::new();
    for (step, point) in points.iter().enumerate() {
        let scene = room.scene_at(overrides, parameter, point.value)?;
        for reception in &point.outcome.receptions {
            let (source, probe) = (file_part(&reception.source), file_part(&reception.probe));
            match super::rendered(&scene, reception) {
                Ok(response) => {
                    let name = format!("{source}-{probe}-{:04}-{}", step + 1, point.value);
                    files.push((name, through(dry.as_ref(), response)?));
                }
                Err(warning) => cli::warn(&[warning]),
            }
        }
    }
    Ok(Heard::new(files))
}
