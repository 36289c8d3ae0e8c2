//! What is made of responses: directional channels, INFO chunks, parameters as measured, speech transmission, listening.

use std::f64::consts::TAU;
use std::path::Path;
use std::process::Command;

use diffray::probe::{BandLevel, EarlyPath, Echogram, Reception};
use diffray::response::{
    RenderOptions, Response, metrics, octave_levels_db, render, response_metrics, speech_transmission_index,
};
use diffray::scene::{Band, Directivity, ProbeFormat, Spacing, bands_between};
use glam::DVec3;

/// ln(10^6): the decay rate of a reverberation time T is this over T.
const SIXTY_DB: f64 = 13.815510557964274;

fn bands() -> Vec<Band> {
    bands_between(Spacing::Octave, 63.0, 8000.0)
}

fn reception(paths: &[(f64, f64, DVec3)], late: f64, t60_s: f64) -> Reception {
    let paths: Vec<EarlyPath> = paths
        .iter()
        .map(|&(delay_s, energy, from)| EarlyPath {
            course: Vec::new(),
            label: "path".into(),
            reflections: 0,
            from,
            delay_s,
            intensity: vec![energy; 8],
            error: vec![0.0; 8],
        })
        .collect();
    let rate = SIXTY_DB / t60_s;
    let bins = (0..(1200.0 * t60_s) as usize).map(|i| late * (-rate * 1e-3 * i as f64).exp() * rate * 1e-3);
    let echogram = Echogram {
        bin_s: 1e-3,
        energy: vec![bins.collect(); 8],
        bin_error: Vec::new(),
        reflections_per_s3: None,
        std_error: vec![0.0; 8],
    };
    let early: f64 = paths.iter().map(|p| p.intensity[0]).sum();
    let intensity = early + echogram.energy[0].iter().sum::<f64>();
    let level = |band: Band| BandLevel {
        band_hz: band.nominal_hz,
        intensity,
        intensity_error: 0.0,
        early_share: early / intensity,
    };
    let levels = bands().into_iter().map(level).collect();
    let echogram = (late > 0.0).then_some(echogram);
    Reception { source: "s".into(), probe: "p".into(), paths, echogram, levels }
}

fn rendered(reception: &Reception, format: ProbeFormat) -> Response {
    let options = RenderOptions { sample_rate_hz: 48_000, length_s: None, seed: 3, format };
    render(reception, &bands(), &options).unwrap_or_else(|w| panic!("{w}"))
}

fn energy(samples: &[f32]) -> f64 {
    samples.iter().map(|s| f64::from(*s).powi(2)).sum()
}

#[test]
fn ambisonic_channels_hold_the_direction_of_paths_and_diffuse_late_sound() {
    let from = DVec3::new(0.48, -0.6, 0.64);
    let response = rendered(&reception(&[(0.01, 0.25, from)], 0.0, 1.0), ProbeFormat::Ambix(3));
    assert_eq!(response.others.len(), 15);
    let (x, y, z) = (0.48, -0.6, 0.64);
    // ACN 1 to 4, 6 and 12, SN3D.
    let expected =
        [(1, y), (2, z), (3, x), (4, 3f64.sqrt() * x * y), (6, 1.5 * z * z - 0.5), (12, 2.5 * z * z * z - 1.5 * z)];
    for (channel, weight) in expected {
        for (w, other) in response.samples.iter().zip(&response.others[channel - 1]) {
            assert!((f64::from(*other) - weight * f64::from(*w)).abs() < 1e-6, "{channel}");
        }
    }
    let late = rendered(&reception(&[], 0.1, 0.8), ProbeFormat::Ambix(2));
    for (channel, samples) in late.others.iter().enumerate() {
        // 15 %: random noise of 24 kHz by 0.2 s has 10^4 degrees of freedom, but its lowest bands few.
        let share = energy(samples) / energy(&late.samples) * if channel < 3 { 3.0 } else { 5.0 };
        assert!((share - 1.0).abs() < 0.15, "{channel}: {share}");
    }
}

#[test]
fn a_cardioid_turns_its_back_on_a_path_and_halves_nothing_else() {
    let paths = [(0.01, 0.25, DVec3::X), (0.02, 0.25, -DVec3::X)];
    let cardioid = ProbeFormat::Pattern(Directivity { omni_share: 0.5, axis: DVec3::X });
    let (omni, cardioid) =
        (rendered(&reception(&paths, 0.0, 1.0), ProbeFormat::Omni), rendered(&reception(&paths, 0.0, 1.0), cardioid));
    assert!(cardioid.others.is_empty());
    assert!((cardioid.samples[480] / omni.samples[480] - 1.0).abs() < 0.02);
    assert!(cardioid.samples[960].abs() < 0.02 * omni.samples[960].abs());
}

#[test]
fn the_file_says_what_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.wav");
    let mut response = rendered(&reception(&[(0.01, 0.25, DVec3::X)], 0.0, 1.0), ProbeFormat::Ambix(1));
    response.title = "Hall: s at p".into();
    response.write_wav(&file).unwrap();
    let bytes = std::fs::read(&file).unwrap();
    assert_eq!(u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize, bytes.len() - 8);
    let list = bytes.windows(8).position(|w| w[..4] == *b"LIST").unwrap();
    assert_eq!(u32::from_le_bytes(bytes[list + 4..list + 8].try_into().unwrap()) as usize, bytes.len() - list - 8);
    let text = String::from_utf8_lossy(&bytes[list..]);
    assert!(text.contains("INFOINAM") && text.contains("Hall: s at p\0") && text.contains("diffray "), "{text:?}");
    let reader = hound::WavReader::open(&file).unwrap();
    assert_eq!((reader.spec().channels, reader.duration() as usize), (4, response.samples.len()));
}

#[test]
fn the_response_has_the_parameters_of_its_echogram() {
    // Just noticeable differences of ISO 3382-1 from 500 Hz on; T30 within 2 % from 125 Hz on.
    for (direct, late, t60_s) in [(0.01, 0.05, 1.0), (0.05, 0.05, 0.6), (0.002, 0.1, 1.8)] {
        let reception = reception(&[(0.02, direct, DVec3::X)], late, t60_s);
        let response = rendered(&reception, ProbeFormat::Omni);
        let pairs = metrics(&reception, &bands()).into_iter().zip(response_metrics(&reception, &response, &bands()));
        for (a, b) in pairs.skip(1) {
            let of = |x: Option<f64>| x.unwrap_or(f64::NAN);
            let ratio = |a: Option<f64>, b: Option<f64>| (of(b) / of(a) - 1.0).abs();
            let apart = |a: Option<f64>, b: Option<f64>| (of(b) - of(a)).abs();
            println!(
                "{} Hz: T30 {:.3} T20 {:.3} EDT {:.3} C80 {:.2} D50 {:.3} Ts {:.4} G {:.2}",
                a.band_hz,
                ratio(a.t30.seconds, b.t30.seconds),
                ratio(a.t20.seconds, b.t20.seconds),
                ratio(a.edt.seconds, b.edt.seconds),
                apart(a.c80_db, b.c80_db),
                apart(a.d50, b.d50),
                apart(a.ts_s, b.ts_s),
                apart(a.g_db, b.g_db)
            );
            assert!(ratio(a.t30.seconds, b.t30.seconds) <= 0.02, "{} Hz: {:?} {:?}", a.band_hz, a.t30, b.t30);
            if a.band_hz < 500.0 {
                continue;
            }
            assert!(ratio(a.t20.seconds, b.t20.seconds) <= 0.05, "{} Hz: {:?} {:?}", a.band_hz, a.t20, b.t20);
            assert!(apart(a.c80_db, b.c80_db) <= 1.0 && apart(a.c50_db, b.c50_db) <= 1.0, "{} Hz", a.band_hz);
            assert!(apart(a.d50, b.d50) <= 0.05 && apart(a.ts_s, b.ts_s) <= 0.01, "{} Hz", a.band_hz);
            assert!(apart(a.g_db, b.g_db) <= 1.0, "{} Hz", a.band_hz);
        }
    }
}

#[test]
fn speech_transmission_of_a_decay_and_of_noise_has_its_closed_form() {
    // m(F) = 1/sqrt(1 + (2 pi F T/13.8)^2) in every octave: the index is TI times the sum of alpha - beta.
    const MODULATION_HZ: [f64; 14] = [0.63, 0.8, 1.0, 1.25, 1.6, 2.0, 2.5, 3.15, 4.0, 5.0, 6.3, 8.0, 10.0, 12.5];
    let weight = 1.381 - 0.381;
    for (t60_s, snr_db) in [(0.5, f64::INFINITY), (1.5, f64::INFINITY), (1.0, 5.0)] {
        let response = rendered(&reception(&[], 0.1, t60_s), ProbeFormat::Omni);
        let noise = 1.0 / (1.0 + 10f64.powf(-0.1 * snr_db));
        let index = MODULATION_HZ.map(|f| {
            let m = noise / (1.0 + (TAU * f * t60_s / SIXTY_DB).powi(2)).sqrt();
            ((10.0 * (m / (1.0 - m)).log10()).clamp(-15.0, 15.0) + 15.0) / 30.0
        });
        let expected = weight * index.iter().sum::<f64>() / 14.0;
        let found = speech_transmission_index(&response, snr_db, None).unwrap();
        // 0.02: the noise's own modulation, mostly in the 125 Hz octave.
        assert!((found - expected).abs() < 0.02, "{t60_s} s, {snr_db} dB: {found} {expected}");
    }
    let free = rendered(&reception(&[(0.01, 0.25, DVec3::X)], 0.0, 1.0), ProbeFormat::Omni);
    // 0.02: the lowest octave's filter lets an impulse last some milliseconds.
    assert!((speech_transmission_index(&free, f64::INFINITY, None).unwrap() - 1.0).abs() < 0.02);
    assert!((speech_transmission_index(&free, 0.0, None).unwrap() - 0.5).abs() < 0.02);
}

#[test]
fn faint_speech_is_lost_below_the_threshold_and_loud_speech_masks_itself() {
    let free = rendered(&reception(&[(0.01, 0.25, DVec3::X)], 0.0, 1.0), ProbeFormat::Omni);
    let found = |db: f64| speech_transmission_index(&free, f64::INFINITY, Some([db; 7])).unwrap();
    // 30 dB: 16 dB below the threshold at 125 Hz, 3 dB above it at 250 Hz, far above it from 500 Hz on.
    let faint = 0.127 * 0.6 + 1.169 - 0.078 * 0.6_f64.sqrt() - 0.218;
    // 105 dB: every octave but the first hears the one below 10 dB under it.
    let ti: f64 = 25.0 / 30.0;
    let loud = 0.085 + ti * 1.296 - 0.085 * ti.sqrt() - ti * 0.296;
    for (db, expected) in [(30.0, faint), (105.0, loud), (70.0, 1.0)] {
        // 0.02: the lowest octave's filter lets an impulse last some milliseconds.
        assert!((found(db) - expected).abs() < 0.02, "{db} dB: {} {expected}", found(db));
    }
}

#[test]
fn octave_levels_are_sums_of_what_lies_in_them() {
    let level = |band: &Band, intensity| BandLevel {
        band_hz: band.nominal_hz,
        intensity,
        intensity_error: 0.0,
        early_share: 1.0,
    };
    for (spacing, at_1m_db, expected_db) in
        [(Spacing::Octave, 60.0, 50.0), (Spacing::ThirdOctave, 60.0, 50.0 + 10.0 * 3f64.log10())]
    {
        let bands = bands_between(spacing, if spacing == Spacing::Octave { 63.0 } else { 100.0 }, 10_000.0);
        let levels = bands.iter().map(|b| level(b, 0.1)).collect();
        let reception = Reception { source: "s".into(), probe: "p".into(), paths: vec![], echogram: None, levels };
        let found = octave_levels_db(&reception, &bands, &vec![at_1m_db; bands.len()]).unwrap();
        assert!(found.iter().all(|l| (l - expected_db).abs() < 1e-9), "{found:?}");
        let few = &bands[..bands.len() - 4];
        assert_eq!(octave_levels_db(&reception, few, &vec![at_1m_db; few.len()]), None);
    }
}

fn wav(path: &Path, rate: u32, samples: impl Iterator<Item = i16>) {
    let spec =
        hound::WavSpec { channels: 1, sample_rate: rate, bits_per_sample: 16, sample_format: hound::SampleFormat::Int };
    let mut file = hound::WavWriter::create(path, spec).unwrap();
    samples.for_each(|s| file.write_sample(s).unwrap());
    file.finalize().unwrap();
}

fn diffray(arguments: &[&str]) -> String {
    let out = Command::new(env!("CARGO_BIN_EXE_diffray")).args(arguments).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8_lossy(&out.stdout).into_owned()
}

#[test]
fn a_recording_is_heard_in_a_room_and_while_a_door_closes() {
    let folder = tempfile::tempdir().unwrap();
    let (dry, out) = (folder.path().join("voice.wav"), folder.path().join("out"));
    wav(&dry, 44_100, (0..4410).map(|i| ((TAU * 500.0 * f64::from(i) / 44_100.0).sin() * 8000.0) as i16));
    let (dry, place) = (dry.to_str().unwrap(), out.to_str().unwrap());
    let room = |name: &str| format!("{}/rooms/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    let text = diffray(&["listen", &room("free-field"), "--dry", dry, "--out", place, "-q"]);
    assert!(text.contains("gain of"), "{text}");
    let mut loudest = 0.0_f32;
    for entry in std::fs::read_dir(out.join("listen")).unwrap().map(|e| e.unwrap().path()) {
        let mut reader = hound::WavReader::open(&entry).unwrap();
        assert_eq!(reader.spec().sample_rate, 48_000);
        loudest = reader.samples::<f32>().fold(loudest, |a, s| a.max(s.unwrap().abs()));
    }
    // -1 dB of full scale.
    assert!((loudest - 0.891_25).abs() < 1e-3, "{loudest}");
    let set = ["--set", "opening.door.open_m=0.1,0.2,0.3"];
    diffray(&[&["sweep", &room("sliding-door"), "--out", place, "-q", "--listen", dry], &set[..]].concat());
    let files = std::fs::read_dir(out.join("listen")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let names: Vec<String> = files.filter(|n| n.contains("-000")).collect();
    for step in ["-0001-0.1", "-0002-0.2", "-0003-0.3"] {
        assert!(names.iter().any(|n| n.contains(step)), "{step}: {names:?}");
    }
}
