//! The output directory: files are staged beside their place and moved there when all of them are complete.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};

use serde_json::Value;

use super::record::PROGRAM;
use crate::error::{Error, Result};

/// Name of the record of a run; it lists the other files.
const RECORD: &str = "run.json";

/// The results of one run on their way to the output directory.
///
/// Dropping a folder that was not published removes everything that was staged and leaves the output directory as
/// it was.
#[derive(Debug)]
pub struct Folder {
    target: PathBuf,
    staging: tempfile::TempDir,
    files: BTreeSet<String>,
}

impl Folder {
    /// Prepares a staging directory on the file system of `target`; `target` itself is not touched.
    ///
    /// # Errors
    /// [`Error::File`] if `target` is not a directory or nothing can be written there.
    pub fn stage(target: &Path) -> Result<Folder> {
        if target.as_os_str().is_empty() {
            return Err(Error::input("the output directory has no name", "give --out a directory, as --out results"));
        }
        let base = if target.exists() { target.to_owned() } else { parent_of(target) };
        if target.exists() && !target.is_dir() {
            return Err(failed(target, "write")(io::Error::new(
                io::ErrorKind::AlreadyExists,
                "it is a file, not a directory",
            )));
        }
        fs::create_dir_all(&base).map_err(failed(&base, "create"))?;
        let staging = tempfile::Builder::new().prefix(".diffray-").tempdir_in(&base).map_err(failed(&base, "write"))?;
        let folder = Folder { target: target.to_owned(), staging, files: BTreeSet::new() };
        fs::create_dir(folder.root()).map_err(failed(target, "write"))?;
        Ok(folder)
    }

    fn root(&self) -> PathBuf {
        self.staging.path().join("results")
    }

    /// Where to write the file that will be `name` (parts separated by `/`) in the output directory.
    ///
    /// # Errors
    /// [`Error::File`] if its directory cannot be made.
    pub fn path(&mut self, name: &str) -> Result<PathBuf> {
        let path = self.root().join(name);
        let directory = path.parent().unwrap_or(&path);
        fs::create_dir_all(directory).map_err(failed(&self.target.join(name), "create"))?;
        self.files.insert(name.to_owned());
        Ok(path)
    }

    /// Where to write a file that will be called `stem` + `ending`, or `stem-2` + `ending` and so on if there is one
    /// already.
    ///
    /// # Errors
    /// [`Error::File`] if its directory cannot be made.
    pub fn new_path(&mut self, stem: &str, ending: &str) -> Result<PathBuf> {
        let numbered = (2..).map(|n: u64| format!("{stem}-{n}{ending}"));
        let name = std::iter::once(format!("{stem}{ending}")).chain(numbered).find(|name| !self.files.contains(name));
        // The numbers do not end before the names do.
        self.path(&name.unwrap_or_default())
    }

    /// Stages one file by writing it through `content`.
    ///
    /// # Errors
    /// [`Error::File`] with the final path if anything of it cannot be written.
    pub fn write(
        &mut self,
        name: &str,
        content: impl FnOnce(&mut BufWriter<fs::File>) -> io::Result<()>,
    ) -> Result<()> {
        let path = self.path(name)?;
        let save = || -> io::Result<()> {
            let mut out = BufWriter::new(fs::File::create(&path)?);
            content(&mut out)?;
            out.flush()?;
            out.get_ref().sync_all()
        };
        save().map_err(failed(&self.target.join(name), "write"))
    }

    /// Names of the files of this run in the order of their names, `run.json` included.
    pub(super) fn files(&self) -> Vec<String> {
        let mut names = self.files.clone();
        names.insert(RECORD.to_owned());
        names.into_iter().collect()
    }

    /// Stages `run.json`.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be written.
    pub(super) fn write_record(&mut self, record: &impl serde::Serialize) -> Result<()> {
        self.write(RECORD, |out| {
            serde_json::to_writer_pretty(&mut *out, record)?;
            out.write_all(b"\n")
        })
    }

    /// Moves the staged files into the output directory, replacing those of an earlier run, and returns the directory.
    ///
    /// A directory that does not exist yet appears with all its files at once; in an existing one each file is replaced
    /// whole, files that only the earlier run had (by its `run.json`) are removed, and others are left alone.
    ///
    /// # Errors
    /// [`Error::File`] if a file cannot be moved.
    pub fn publish(self) -> Result<PathBuf> {
        let (root, target) = (self.root(), &self.target);
        if !target.exists() {
            fs::rename(&root, target).map_err(failed(target, "create"))?;
            return Ok(self.target);
        }
        if let Some(name) = self.files.iter().find(|name| target.join(name).is_dir()) {
            return Err(failed(&target.join(name), "replace")(io::Error::new(
                io::ErrorKind::IsADirectory,
                "it is a directory",
            )));
        }
        for stale in files_of_earlier_run(target).into_iter().filter(|name| !self.files.contains(name)) {
            let path = target.join(&stale);
            if path.is_file() {
                fs::remove_file(&path).map_err(failed(&path, "remove"))?;
                // The directory of the file goes too if that was the last one in it; if not, the call does nothing.
                if let Some(directory) = path.parent().filter(|d| *d != target.as_path()) {
                    let _ = fs::remove_dir(directory);
                }
            }
        }
        // The record comes last: while it is missing or old, the set is not complete.
        let results = self.files.iter().filter(|n| *n != RECORD);
        for name in results.chain(self.files.get(RECORD)) {
            let path = target.join(name);
            if let Some(directory) = path.parent() {
                fs::create_dir_all(directory).map_err(failed(directory, "create"))?;
            }
            fs::rename(root.join(name), &path).map_err(failed(&path, "write"))?;
        }
        Ok(self.target)
    }
}

/// Makes sure that results can be written to `target`, before a long run; leaves nothing behind.
///
/// # Errors
/// [`Error::File`] as from [`Folder::stage`] if they cannot.
pub fn check_writable(target: &Path) -> Result<()> {
    let existing = target.ancestors().find(|p| p.exists() && !p.as_os_str().is_empty());
    Folder::stage(existing.unwrap_or(Path::new("."))).map(drop)
}

/// The directory that contains `path`.
fn parent_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// The files that the record in `target` lists; none if there is no readable record. Names that lead out of the
/// directory are left out.
fn files_of_earlier_run(target: &Path) -> Vec<String> {
    let Ok(text) = fs::read_to_string(target.join(RECORD)) else { return Vec::new() };
    let Ok(record) = serde_json::from_str::<Value>(&text) else { return Vec::new() };
    if record["program"] != PROGRAM {
        return Vec::new();
    }
    let names = record["files"].as_array().into_iter().flatten().filter_map(Value::as_str);
    names
        .filter(|name| Path::new(name).components().all(|c| matches!(c, Component::Normal(_))))
        .map(str::to_owned)
        .collect()
}

/// Turns what the system said into an error about `path`.
fn failed(path: &Path, action: &'static str) -> impl FnOnce(io::Error) -> Error {
    let path = path.to_owned();
    move |source| Error::File { path, action, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listing(directory: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(directory).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn stage_run(target: &Path, names: &[&str]) -> Folder {
        let mut folder = Folder::stage(target).unwrap();
        for name in names {
            folder.write(name, |out| out.write_all(name.as_bytes())).unwrap();
        }
        let files = folder.files();
        folder.write_record(&serde_json::json!({ "program": "diffray", "files": files })).unwrap();
        folder
    }

    #[test]
    fn a_new_directory_appears_whole() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out/door");
        let folder = stage_run(&target, &["bands.csv", "ir/s-p.wav"]);
        assert!(!target.exists());
        folder.publish().unwrap();
        assert_eq!(listing(&target), ["bands.csv", "ir", "run.json"]);
        assert_eq!(listing(&place.path().join("out")), ["door"]);
        assert_eq!(fs::read_to_string(target.join("ir/s-p.wav")).unwrap(), "ir/s-p.wav");
    }

    #[test]
    fn results_of_an_earlier_run_are_replaced_and_other_files_stay() {
        let place = tempfile::tempdir().unwrap();
        stage_run(place.path(), &["bands.csv", "ir/s-p.wav"]).publish().unwrap();
        fs::write(place.path().join("notes.txt"), "mine").unwrap();
        fs::write(place.path().join("bands.csv"), "old").unwrap();
        stage_run(place.path(), &["bands.csv", "sweep.csv"]).publish().unwrap();
        assert_eq!(listing(place.path()), ["bands.csv", "notes.txt", "run.json", "sweep.csv"]);
        assert_eq!(fs::read_to_string(place.path().join("bands.csv")).unwrap(), "bands.csv");
    }

    #[test]
    fn a_run_that_fails_leaves_nothing_behind() {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("bands.csv"), "old").unwrap();
        let mut folder = Folder::stage(place.path()).unwrap();
        folder.write("bands.csv", |out| out.write_all(b"half")).unwrap();
        let error = folder.write("sweep.csv", |_| Err(io::Error::other("disk full"))).unwrap_err();
        assert!(error.to_string().contains("sweep.csv: cannot write: disk full"), "{error}");
        drop(folder);
        assert_eq!(listing(place.path()), ["bands.csv"]);
        assert_eq!(fs::read_to_string(place.path().join("bands.csv")).unwrap(), "old");
    }

    #[test]
    fn a_record_cannot_make_us_remove_files_elsewhere() {
        let place = tempfile::tempdir().unwrap();
        let target = place.path().join("out");
        fs::create_dir(&target).unwrap();
        fs::write(place.path().join("mine.txt"), "mine").unwrap();
        let record = serde_json::json!({ "program": "diffray", "files": ["../mine.txt", "/etc/hostname"] });
        fs::write(target.join(RECORD), record.to_string()).unwrap();
        assert_eq!(files_of_earlier_run(&target), Vec::<String>::new());
        stage_run(&target, &["bands.csv"]).publish().unwrap();
        assert!(place.path().join("mine.txt").exists());
    }

    #[test]
    fn a_target_that_cannot_be_a_directory_is_refused_before_the_run() {
        let place = tempfile::tempdir().unwrap();
        let file = place.path().join("file");
        fs::write(&file, "").unwrap();
        assert!(check_writable(&file).unwrap_err().to_string().contains("not a directory"));
        assert!(check_writable(&file.join("below")).is_err());
        check_writable(&place.path().join("a/b/c")).unwrap();
        assert_eq!(listing(place.path()), ["file"]);
    }
}
