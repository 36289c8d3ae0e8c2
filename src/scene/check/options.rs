//! Air, bands, run options, output options and the sweep.

use serde_spanned::Spanned;

use super::clearance::Matter;
use super::values::{Limits, choice, choice_or, number, number_or};
use crate::error::{Result, Warning};
use crate::scene::air::{attenuation_db_per_m, intensity_attenuation_per_m, midband_hz, speed_of_sound_m_s};
use crate::scene::bands::{band, bands_between};
use crate::scene::locate::Locator;
use crate::scene::overrides::range_values;
use crate::scene::room_file::{AirTable, BandsTable, OutputTable, SimulationTable, SweepTable, Whole};
use crate::scene::{Air, Band, Edges, Output, RAY_TOLERANCE, Simulation, Spacing, Sweep, Transport};

/// Most bands of a scene.
const MOST_BANDS: usize = 64;

/// The medium, with its attenuation in each band.
pub(super) fn air(table: &AirTable, bands: &[Band], spacing: Spacing, at: &Locator<'_>) -> Result<Air> {
    use Limits::Within;
    let temperature_c =
        number_or(table.temperature_c.as_ref(), 20.0, "temperature_c", Within(-50.0, 60.0), "in degrees Celsius", at)?;
    let relative_humidity_percent = number_or(
        table.relative_humidity_percent.as_ref(),
        50.0,
        "relative_humidity_percent",
        Within(0.0, 100.0),
        "",
        at,
    )?;
    let pressure_kpa = number_or(
        table.pressure_kpa.as_ref(),
        101.325,
        "pressure_kpa",
        Within(10.0, 200.0),
        "in kPa: 1013 hPa = 101.3",
        at,
    )?;
    let default_speed = speed_of_sound_m_s(temperature_c, relative_humidity_percent, pressure_kpa);
    let speed_of_sound_m_s = number_or(
        table.speed_of_sound_m_s.as_ref(),
        default_speed,
        "speed_of_sound_m_s",
        Within(100.0, 2000.0),
        "343 in air of 20 degrees Celsius",
        at,
    )?;
    let absorption = table.absorption.as_ref().is_none_or(|absorption| *absorption.get_ref());
    let attenuation = |band: &Band| {
        let midband = midband_hz(band, spacing);
        let db_per_m = attenuation_db_per_m(midband, temperature_c, relative_humidity_percent, pressure_kpa);
        intensity_attenuation_per_m(db_per_m)
    };
    let attenuation_per_m = bands.iter().map(|band| if absorption { attenuation(band) } else { 0.0 }).collect();
    Ok(Air {
        temperature_c,
        relative_humidity_percent,
        pressure_kpa,
        speed_of_sound_m_s,
        absorption,
        attenuation_per_m,
    })
}

/// The bands in ascending order.
pub(super) fn bands(table: &BandsTable, at: &Locator<'_>) -> Result<(Spacing, Vec<Band>)> {
    const SPACINGS: [(&str, Spacing); 3] =
        [("octave", Spacing::Octave), ("third-octave", Spacing::ThirdOctave), ("tones", Spacing::Tones)];
    let spacing = choice_or(table.spacing.as_ref(), Spacing::Octave, "spacing", &SPACINGS, at)?;
    if spacing == Spacing::Tones {
        return tones(table, at).map(|tones| (spacing, tones));
    }
    if let Some(frequencies) = &table.frequencies_hz {
        return Err(at.error(
            frequencies.span(),
            "frequencies_hz belongs to spacing = \"tones\"",
            "bands are chosen by from_hz and to_hz",
        ));
    }
    let limits = Limits::Within(1.0, 100_000.0);
    let from_hz = number_or(table.from_hz.as_ref(), 63.0, "from_hz", limits, "in Hz", at)?;
    let to_hz = number_or(table.to_hz.as_ref(), 8000.0, "to_hz", limits, "in Hz", at)?;
    let place = || table.to_hz.as_ref().or(table.from_hz.as_ref()).map_or(0..0, Spanned::span);
    if from_hz > to_hz {
        return Err(at.error(place(), format!("from_hz is {from_hz}, must not exceed to_hz, which is {to_hz}"), ""));
    }
    let bands = bands_between(spacing, from_hz, to_hz);
    if bands.is_empty() {
        return Err(at.error(
            place(),
            format!("no nominal band centre lies between {from_hz} and {to_hz} Hz"),
            "octaves: 16, 31.5, 63, 125, 250, 500, 1000, 2000, 4000, 8000, 16000 Hz",
        ));
    }
    Ok((spacing, bands))
}

fn tones(table: &BandsTable, at: &Locator<'_>) -> Result<Vec<Band>> {
    const EXAMPLE: &str = "as frequencies_hz = [500, 1000]";
    if let Some(unused) = table.from_hz.as_ref().or(table.to_hz.as_ref()) {
        return Err(at.error(unused.span(), "from_hz and to_hz do not belong to spacing = \"tones\"", EXAMPLE));
    }
    let Some(list) = &table.frequencies_hz else {
        let place = table.spacing.as_ref().map_or(0..0, Spanned::span);
        return Err(at.error(place, "spacing = \"tones\" needs frequencies_hz", EXAMPLE));
    };
    if list.get_ref().is_empty() || list.get_ref().len() > MOST_BANDS {
        return Err(at.error(
            list.span(),
            format!("frequencies_hz has {} tones, must have 1 to {MOST_BANDS}", list.get_ref().len()),
            EXAMPLE,
        ));
    }
    let mut tones: Vec<Band> = Vec::with_capacity(list.get_ref().len());
    for value in list.get_ref() {
        let frequency = number(value, "a tone", Limits::Within(1.0, 100_000.0), "in Hz", at)?;
        if tones.iter().any(|tone| tone.nominal_hz == frequency) {
            return Err(at.error(value.span(), format!("the tone {frequency} Hz is given twice"), ""));
        }
        tones.push(band(frequency, Spacing::Tones));
    }
    tones.sort_by(|a, b| a.nominal_hz.total_cmp(&b.nominal_hz));
    Ok(tones)
}

/// A whole number within limits.
fn whole(value: Option<&Spanned<Whole>>, default: u64, name: &str, range: [u64; 2], at: &Locator<'_>) -> Result<u64> {
    let Some(value) = value else { return Ok(default) };
    let Whole(number) = *value.get_ref();
    let [low, high] = range;
    if (low..=high).contains(&number) {
        return Ok(number);
    }
    Err(at.error(value.span(), format!("{name} is {number}, must lie in {low}..={high}"), ""))
}

/// Options of a run.
pub(super) fn simulation(table: &SimulationTable, at: &Locator<'_>) -> Result<Simulation> {
    const EDGES: [(&str, Edges); 3] = [("auto", Edges::Auto), ("openings", Edges::Openings), ("off", Edges::Off)];
    const TRANSPORTS: [(&str, Transport); 5] = [
        ("wbsdf", Transport::Wbsdf),
        ("paraxial", Transport::Paraxial),
        ("geometric", Transport::Geometric),
        ("utd", Transport::Utd),
        ("exact", Transport::Exact),
    ];
    let target = Limits::PositiveUpTo(20.0);
    // Orders beyond these limits would never end; the limits keep them far from overflow.
    let reflection_order = whole(table.reflection_order.as_ref(), 3, "reflection_order", [0, 100], at)?;
    let diffraction_order = whole(table.diffraction_order.as_ref(), 2, "diffraction_order", [0, 10], at)?;
    Ok(Simulation {
        seed: whole(table.seed.as_ref(), 1, "seed", [0, u64::MAX], at)?,
        target_db: number_or(table.target_db.as_ref(), 0.5, "target_db", target, "a standard error in dB", at)?,
        max_rays: whole(table.max_rays.as_ref(), 10_000_000, "max_rays", [0, 1_000_000_000_000_000], at)?,
        max_time_s: number_or(
            table.max_time_s.as_ref(),
            600.0,
            "max_time_s",
            Limits::PositiveUpTo(1e9),
            "in seconds",
            at,
        )?,
        reflection_order: reflection_order as usize,
        diffraction_order: diffraction_order as usize,
        edges: choice_or(table.edges.as_ref(), Edges::Auto, "edges", &EDGES, at)?,
        transport: choice_or(table.transport.as_ref(), Transport::Wbsdf, "transport", &TRANSPORTS, at)?,
        interference: table.interference.unwrap_or(false),
        ray_tolerance: RAY_TOLERANCE,
    })
}

/// The exact transport solves infinitely long openings of one unbounded wall, and nothing else.
pub(super) fn exact_fits(
    table: &SimulationTable,
    simulation: &Simulation,
    matter: &Matter<'_>,
    at: &Locator<'_>,
) -> Result<()> {
    let Some(transport) = table.transport.as_ref().filter(|_| simulation.transport == Transport::Exact) else {
        return Ok(());
    };
    let one_screen = matter.boxes.is_empty()
        && matter.meshes.is_empty()
        && matches!(matter.walls, [wall] if wall.unbounded)
        && matter.openings.iter().all(|opening| opening.is_slit());
    if one_screen {
        return Ok(());
    }
    Err(at.error(
        transport.span(),
        "transport = \"exact\" solves a single unbounded wall with infinitely long openings only",
        "\"wbsdf\" models this scene, and \"utd\" gives a second opinion",
    ))
}

/// Options of the impulse responses.
pub(super) fn output(
    table: &OutputTable,
    bands: &[Band],
    at: &Locator<'_>,
    warnings: &mut Vec<Warning>,
) -> Result<Output> {
    let rate = whole(table.sample_rate_hz.as_ref(), 48_000, "sample_rate_hz", [8_000, 192_000], at)?;
    let response_length_s = match &table.response_length_s {
        None => None,
        Some(length) => Some(number(length, "response_length_s", Limits::PositiveUpTo(100.0), "in seconds", at)?),
    };
    let signal_to_noise_db = match &table.signal_to_noise_db {
        None => None,
        Some(ratio) => Some(number(
            ratio,
            "signal_to_noise_db",
            Limits::Within(-100.0, 100.0),
            "in dB, the same in every octave",
            at,
        )?),
    };
    if let Some(highest) = bands.last().filter(|band| band.high_hz >= rate as f64 / 2.0) {
        warnings.push(Warning {
            observation: format!(
                "the band {} Hz reaches beyond half the sample rate of {rate} Hz; impulse responses lack its upper part",
                highest.nominal_hz
            ),
            remedy: "raise output.sample_rate_hz or lower bands.to_hz; levels in tables are not affected".to_owned(),
        });
    }
    // At most 192 000.
    Ok(Output { sample_rate_hz: rate as u32, response_length_s, signal_to_noise_db })
}

/// The file's own sweep, without its reference.
pub(super) fn sweep(table: &Spanned<SweepTable>, at: &Locator<'_>) -> Result<Sweep> {
    const FORMS: &str = "from, to and step, or values = [0.0, 0.1]";
    let SweepTable { parameter, from, to, step, values, reference: _ } = table.get_ref();
    let values = match (from, to, step, values) {
        (Some(from), Some(to), Some(step), None) => range_values(*from.get_ref(), *to.get_ref(), *step.get_ref())
            .map_err(|(message, hint)| at.error(step.span(), message, hint))?,
        (None, None, None, Some(values)) => {
            let list: Vec<f64> = values.get_ref().iter().map(|value| *value.get_ref()).collect();
            if list.is_empty() || list.len() > 100_000 {
                let message = format!("the sweep has {} values, must have 1 to 100000", list.len());
                return Err(at.error(values.span(), message, FORMS));
            }
            if let Some(bad) = values.get_ref().iter().find(|value| !value.get_ref().is_finite()) {
                return Err(at.error(bad.span(), format!("a sweep value is {}, must be finite", bad.get_ref()), ""));
            }
            list
        }
        (_, _, _, Some(values)) => {
            return Err(at.error(values.span(), "a sweep has either values or from, to and step, not both", FORMS));
        }
        _ => return Err(at.error(table.span(), "the sweep lacks its values", FORMS)),
    };
    if parameter.get_ref().starts_with("sweep") {
        return Err(at.error(parameter.span(), "a sweep cannot change itself", "as opening.door.open_m"));
    }
    Ok(Sweep { parameter: parameter.get_ref().clone(), values, reference: None })
}

/// The kinds of a source.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    Point,
    Line,
    Plane,
}

/// The kind of a source by its word.
pub(super) fn kind(value: Option<&Spanned<String>>, at: &Locator<'_>) -> Result<Kind> {
    const KINDS: [(&str, Kind); 3] = [("point", Kind::Point), ("line", Kind::Line), ("plane", Kind::Plane)];
    value.map_or(Ok(Kind::Point), |value| choice(value, "kind", &KINDS, at))
}
