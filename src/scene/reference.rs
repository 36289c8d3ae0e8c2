//! Reference levels beside a sweep: a table from theory or measurement that a room file names.
//!
//! A CSV file with the columns `source,probe,band_hz,value,level_db` in any order; lines that begin with `#` are comments.

use std::path::{Path, PathBuf};

use serde_spanned::Spanned;

use super::locate::Locator;
use crate::error::{Error, Place, Result};

/// The columns of a reference table.
const COLUMNS: [&str; 5] = ["source", "probe", "band_hz", "value", "level_db"];

/// Levels to be shown beside those of a sweep.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Reference {
    /// The table, as the room file names it.
    pub file: PathBuf,
    /// Its rows in the order of the file.
    pub rows: Vec<ReferenceRow>,
}

/// One level of a reference table.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ReferenceRow {
    /// Name of the source.
    pub source: String,
    /// Name of the probe.
    pub probe: String,
    /// Nominal centre of the band in Hz.
    pub band_hz: f64,
    /// Value of the swept parameter in its own unit.
    pub value: f64,
    /// Level in dB re the source's free field at 1 m; negative infinity where nothing arrives.
    pub level_db: f64,
}

/// Reads the table `name` in `folder`; every row must name one of the sources and one of the probes.
///
/// # Errors
/// The file cannot be read (the error is told at the place of its name), or a row of it is not what it should be (with
/// its file and line).
pub(super) fn read(
    name: &Spanned<String>,
    folder: &Path,
    sources: &[&str],
    probes: &[&str],
    at: &Locator<'_>,
) -> Result<Reference> {
    let path = folder.join(name.get_ref());
    let bytes = std::fs::read(&path).map_err(|error| {
        let message = format!("reference `{}`: cannot read it: {error}", name.get_ref());
        at.error(name.span(), message, "the path starts from the folder of the room file")
    })?;
    let rows = Table { path: &path }.rows(&bytes, sources, probes)?;
    Ok(Reference { file: PathBuf::from(name.get_ref()), rows })
}

struct Table<'a> {
    path: &'a Path,
}

impl Table<'_> {
    fn error(&self, line: usize, message: impl Into<String>, hint: impl Into<String>) -> Error {
        let place = Place { file: self.path.to_owned(), line, column: 1 };
        Error::Input { place: Some(place), message: message.into(), hint: Some(hint.into()) }
    }

    fn rows(&self, bytes: &[u8], sources: &[&str], probes: &[&str]) -> Result<Vec<ReferenceRow>> {
        let mut lines = self.records(bytes)?.into_iter();
        let columns = format!("the columns are {}", COLUMNS.join(","));
        let Some((line, header)) = lines.next() else {
            return Err(self.error(1, "the reference table is empty", columns));
        };
        let mut index = [0; COLUMNS.len()];
        for (at, name) in index.iter_mut().zip(COLUMNS) {
            *at = header.iter().position(|h| h == name).ok_or_else(|| {
                self.error(line, format!("the reference table has no column {name}"), columns.clone())
            })?;
        }
        let mut rows: Vec<ReferenceRow> = Vec::new();
        for (line, record) in lines {
            if record.len() != header.len() {
                let message = format!("the row has {} fields, the header has {}", record.len(), header.len());
                return Err(self.error(line, message, "fields are separated by commas"));
            }
            let field = |column: usize| record[index[column]].as_str();
            let known = |column: usize, names: &[&str]| {
                let name = field(column);
                if names.contains(&name) {
                    return Ok(name.to_owned());
                }
                let what = COLUMNS[column];
                let message = format!("the room file has no {what} `{name}`");
                Err(self.error(line, message, format!("it has: {}", names.join(", "))))
            };
            let number = |column: usize, allowed: fn(f64) -> bool, hint: &str| match field(column).parse::<f64>() {
                Ok(x) if allowed(x) => Ok(x),
                _ => Err(self.error(
                    line,
                    format!("{} is `{}`, must be {hint}", COLUMNS[column], field(column)),
                    &columns,
                )),
            };
            let row = ReferenceRow {
                source: known(0, sources)?,
                probe: known(1, probes)?,
                band_hz: number(2, |x| x.is_finite() && x > 0.0, "a frequency in Hz")?,
                value: number(3, f64::is_finite, "a finite number")?,
                level_db: number(4, |x| x < f64::INFINITY, "a level in dB or -inf")?,
            };
            rows.push(row);
        }
        Ok(rows)
    }

    /// The fields of every line that is neither empty nor a comment, with its number.
    fn records(&self, bytes: &[u8]) -> Result<Vec<(usize, Vec<String>)>> {
        let mut records = Vec::new();
        for (i, line) in bytes.split(|b| *b == b'\n').enumerate() {
            let number = i + 1;
            let not_text = |_| self.error(number, "this is not UTF-8 text", "save the file as UTF-8");
            let line = std::str::from_utf8(line).map_err(not_text)?.trim();
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let mut reader =
                csv::ReaderBuilder::new().has_headers(false).trim(csv::Trim::All).from_reader(line.as_bytes());
            let Some(record) = reader.records().next() else { continue };
            let record = record.map_err(|e| self.error(number, format!("the row cannot be read: {e}"), "as CSV"))?;
            records.push((number, record.iter().map(str::to_owned).collect()));
        }
        Ok(records)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(text: &str) -> std::result::Result<Vec<ReferenceRow>, String> {
        let table = Table { path: Path::new("exact.csv") };
        table.rows(text.as_bytes(), &["line"], &["mic, left", "mic-1"]).map_err(|e| e.to_string())
    }

    #[test]
    fn comments_and_the_order_of_the_columns_do_not_matter() {
        let text = "# exact\r\nlevel_db,source,probe,band_hz,value,region\r\n\r\n# theory\r\n-9.5,line,\"mic, left\",500,0.2,lit\r\n-inf,line,mic-1,500,0,shadow\r\n";
        let rows = rows(text).unwrap();
        assert_eq!(rows.len(), 2);
        assert_eq!((rows[0].probe.as_str(), rows[0].value, rows[0].level_db), ("mic, left", 0.2, -9.5));
        assert_eq!(rows[1].level_db, f64::NEG_INFINITY);
    }

    #[test]
    fn a_bad_row_is_told_with_its_line() {
        let head = "# exact\nsource,probe,band_hz,value,level_db\n";
        for (row, expected) in [
            ("line,mic-1,500,0.2", "exact.csv:3:1: the row has 4 fields"),
            ("line,mic-9,500,0.2,-3", "exact.csv:3:1: the room file has no probe `mic-9`"),
            ("line,mic-1,500,wide,-3", "exact.csv:3:1: value is `wide`"),
            ("line,mic-1,0,0.2,-3", "exact.csv:3:1: band_hz is `0`"),
            ("line,mic-1,500,0.2,NaN", "exact.csv:3:1: level_db is `NaN`"),
        ] {
            let message = rows(&format!("{head}{row}\n")).unwrap_err();
            assert!(message.starts_with(expected), "{message}");
        }
        assert!(rows("source,probe,band_hz,value\n").unwrap_err().contains("exact.csv:1:1"), "no column");
        assert!(rows("# nothing\n").unwrap_err().contains("empty"));
    }
}
