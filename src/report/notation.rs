//! How numbers, bands and units are spelt for people.

use std::fmt::Write as _;

/// A band's centre: "63 Hz", "1 kHz", "3.15 kHz".
pub(crate) fn band(hz: f64) -> String {
    if hz >= 1000.0 { format!("{} kHz", trimmed(hz / 1000.0, 3)) } else { format!("{} Hz", trimmed(hz, 2)) }
}

/// A band's centre without its unit for axis ticks: "63", "1k", "3.15k".
pub(super) fn band_tick(hz: f64) -> String {
    if hz >= 1000.0 { format!("{}k", trimmed(hz / 1000.0, 3)) } else { trimmed(hz, 2) }
}

/// At most `digits` decimals, without trailing zeros.
pub(crate) fn trimmed(x: f64, digits: usize) -> String {
    let text = format!("{x:.digits$}");
    if !text.contains('.') {
        return text;
    }
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// A level in dB with `digits` decimals; "-inf" where nothing arrives.
pub(super) fn level(db: f64, digits: usize) -> String {
    if db == f64::NEG_INFINITY { "-inf".to_owned() } else { format!("{db:.digits$}") }
}

/// The unit that the last part of a parameter's name ends in: `opening.door.open_m` -> "m"; empty if none.
pub(super) fn unit_of(parameter: &str) -> &'static str {
    const UNITS: [(&str, &str); 11] = [
        ("_m_s", "m/s"),
        ("_kpa", "kPa"),
        ("_percent", "%"),
        ("_hz", "Hz"),
        ("_deg", "°"),
        ("_db", "dB"),
        ("_c", "°C"),
        ("_m", "m"),
        ("_s", "s"),
        ("_k", "K"),
        ("_rad", "rad"),
    ];
    UNITS.iter().find(|(ending, _)| parameter.ends_with(ending)).map_or("", |(_, unit)| unit)
}

/// What it is called when the swept value becomes smaller: "closing" for an opening, else "lowering the value".
pub(super) fn act_of(parameter: &str) -> &'static str {
    if parameter.ends_with("open_m") { "closing" } else { "lowering the value" }
}

/// A duration for people: "0.42 s", "3 min 12 s".
pub(crate) fn duration(seconds: f64) -> String {
    if seconds < 1e-3 {
        format!("{:.0} µs", seconds * 1e6)
    } else if seconds < 1.0 {
        format!("{:.0} ms", seconds * 1e3)
    } else if seconds < 60.0 {
        format!("{seconds:.1} s")
    } else {
        format!("{} min {:.0} s", (seconds / 60.0).floor(), seconds % 60.0)
    }
}

/// An integer with thin groups of three digits: "1 234 567".
pub(crate) fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(' ');
        }
        text.push(c);
    }
    text
}

/// Text made safe for the inside of HTML elements and quoted attributes.
pub(crate) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c if c.is_control() && !matches!(c, '\n' | '\t') => {
                // Control characters are not allowed in HTML; show their code instead. Writing to a String cannot fail.
                let _ = write!(out, "\\x{:02x}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_are_spelt_as_on_a_sound_level_meter() {
        assert_eq!(band(63.0), "63 Hz");
        assert_eq!(band(31.5), "31.5 Hz");
        assert_eq!(band(1000.0), "1 kHz");
        assert_eq!(band(3150.0), "3.15 kHz");
        assert_eq!(band_tick(12500.0), "12.5k");
    }

    #[test]
    fn the_unit_comes_from_the_parameter_name() {
        assert_eq!(unit_of("opening.door.open_m"), "m");
        assert_eq!(unit_of("air.speed_of_sound_m_s"), "m/s");
        assert_eq!(unit_of("air.temperature_c"), "°C");
        assert_eq!(unit_of("material.plaster.scattering"), "");
    }

    #[test]
    fn markup_in_names_is_escaped() {
        assert_eq!(escaped("<b a=\"1\">&'\u{7}"), "&lt;b a=&quot;1&quot;&gt;&amp;&#39;\\x07");
    }

    #[test]
    fn large_counts_are_grouped_in_threes() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1234567), "1 234 567");
    }

    #[test]
    fn trailing_zeros_are_dropped_but_the_value_stays() {
        assert_eq!(trimmed(0.50, 3), "0.5");
        assert_eq!(trimmed(100.0, 0), "100");
        assert_eq!(trimmed(-0.0001, 2), "0");
    }
}
