//! The files of a report in its folder: the next report there removes those that it does not write again, and nothing else.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use atsplat_files::{FileError, Sha256Digest, is_plain_name, shortened};

use crate::ReportError;

/// Name of the list of a report's files, in the format of `sha256sum`.
const LIST: &str = "report.sha256";
/// The folders that hold files of reports alone.
const FOLDERS: [&str; 3] = ["tables", "plots", "films"];

/// What a report did in its folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// The files of the report, in the order of writing.
    pub files: Vec<PathBuf>,
    /// The files of an earlier report that were removed.
    pub removed: Vec<PathBuf>,
    /// Other files in the folders of tables, plots and films, which stay: not of a report, or changed since.
    pub others: Vec<PathBuf>,
}

/// SHA-256 of a report's files by their paths in its folder, with `/` between their parts.
#[derive(Debug, Default)]
pub(crate) struct FileList(BTreeMap<String, Sha256Digest>);

/// A report that is being written.
#[derive(Debug)]
pub(crate) struct Writing<'a> {
    folder: &'a Path,
    list: FileList,
    files: Vec<PathBuf>,
}

impl FileList {
    /// The list of the report in a folder; empty if there is none.
    ///
    /// # Errors
    /// [`ReportError::Io`] for a list that cannot be read, or that names something outside the folder.
    pub(crate) fn read(folder: &Path) -> Result<Self, ReportError> {
        let path = folder.join(LIST);
        let text = match std::fs::read_to_string(&path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::default()),
            read => read,
        };
        let parsed = text.and_then(|text| Self::parse(&text));
        parsed.map_err(FileError::during("reading the list of an earlier report's files", path))
    }

    fn parse(text: &str) -> io::Result<Self> {
        const SHOWN: usize = 80;
        let mut files = BTreeMap::new();
        for (number, line) in (1..).zip(text.lines()) {
            let parts = line.split_once("  ").filter(|(_, name)| name.split('/').all(is_plain_name));
            let entry = parts.and_then(|(digest, name)| Some((digest.parse::<Sha256Digest>().ok()?, name)));
            let Some((digest, name)) = entry else {
                let found = shortened(line, SHOWN);
                let expected = "a SHA-256, two spaces and a path within the folder";
                return Err(io::Error::new(
                    io::ErrorKind::InvalidData,
                    format!("line {number}: expected {expected}, found {found}"),
                ));
            };
            files.insert(name.to_owned(), digest);
        }
        Ok(Self(files))
    }

    fn text(&self) -> String {
        self.0.iter().map(|(name, digest)| format!("{digest}  {name}\n")).collect()
    }
}

impl<'a> Writing<'a> {
    pub(crate) fn new(folder: &'a Path) -> Self {
        Self { folder, list: FileList::default(), files: Vec::new() }
    }

    /// Writes a file of this name in the report's folder, creating its own folder if necessary.
    pub(crate) fn write(&mut self, name: String, bytes: &[u8]) -> Result<(), ReportError> {
        self.files.push(write_file(self.folder.join(&name), bytes)?);
        self.list.0.insert(name, Sha256Digest::of(bytes));
        Ok(())
    }

    /// Removes the files of the report before this one that are not part of it, then writes the list.
    pub(crate) fn finish(mut self, before: &FileList) -> Result<Written, ReportError> {
        let mut removed = Vec::new();
        for (name, digest) in before.0.iter().filter(|(name, _)| !self.list.0.contains_key(*name)) {
            let path = self.folder.join(name);
            if is_unchanged(&path, digest)? {
                std::fs::remove_file(&path)
                    .map_err(FileError::during::<ReportError>("removing a file of an earlier report", &path))?;
                removed.push(path);
            }
        }
        let others = others(self.folder, &self.files)?;
        self.files.push(write_file(self.folder.join(LIST), self.list.text().as_bytes())?);
        Ok(Written { files: self.files, removed, others })
    }
}

/// Writes a file, creating its folder if necessary.
fn write_file(path: PathBuf, bytes: &[u8]) -> Result<PathBuf, ReportError> {
    let created = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    let written = created.and_then(|()| atsplat_files::write_unsynced(&path, bytes));
    written.map_err(FileError::during::<ReportError>("writing a report", &path))?;
    Ok(path)
}

/// Whether a file, no link and no folder, still has the contents of this hash.
fn is_unchanged(path: &Path, digest: &Sha256Digest) -> Result<bool, ReportError> {
    let compared = || -> io::Result<bool> {
        if !std::fs::symlink_metadata(path)?.file_type().is_file() {
            return Ok(false);
        }
        Ok(Sha256Digest::of(&std::fs::read(path)?) == *digest)
    };
    match compared() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        outcome => outcome.map_err(FileError::during("reading a file of an earlier report", path)),
    }
}

/// The files in the folders of reports that are not among `files`, in the order of their paths; hidden ones do not count.
fn others(folder: &Path, files: &[PathBuf]) -> Result<Vec<PathBuf>, ReportError> {
    let own: BTreeSet<&PathBuf> = files.iter().collect();
    let mut found = BTreeSet::new();
    for folder in FOLDERS.map(|name| folder.join(name)) {
        let entries = match std::fs::read_dir(&folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
            entries => entries.and_then(Iterator::collect::<io::Result<Vec<_>>>),
        };
        let entries = entries.map_err(FileError::during::<ReportError>("reading the folder of a report", &folder))?;
        for entry in entries {
            let (path, hidden) = (entry.path(), entry.file_name().to_string_lossy().starts_with('.'));
            if !hidden && !own.contains(&path) {
                found.insert(path);
            }
        }
    }
    Ok(found.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn write(folder: &Path, files: &[(&str, &str)]) -> Written {
        let before = FileList::read(folder).unwrap();
        let mut writing = Writing::new(folder);
        for (name, text) in files {
            writing.write((*name).to_owned(), text.as_bytes()).unwrap();
        }
        writing.finish(&before).unwrap()
    }

    #[test]
    fn a_report_removes_what_the_one_before_wrote_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let files = [("tables/a.md", "a"), ("tables/edited.md", "b"), ("plots/p.svg", "p"), ("index.html", "1")];
        let first = write(folder.path(), &files);
        assert_eq!((first.files.len(), first.removed.len(), first.others.len()), (5, 0, 0));
        for (name, text) in [("tables/edited.md", "changed"), ("tables/own.md", "mine"), ("notes.txt", "mine")] {
            fs::write(at(name), text).unwrap();
        }
        let second = write(folder.path(), &[("tables/a-1.md", "a"), ("plots/p.svg", "q"), ("index.html", "2")]);
        assert_eq!(second.removed, [at("tables/a.md")]);
        assert_eq!(second.others, [at("tables/edited.md"), at("tables/own.md")]);
        assert!(!at("tables/a.md").exists());
        for (name, text) in [
            ("tables/a-1.md", "a"),
            ("plots/p.svg", "q"),
            ("tables/edited.md", "changed"),
            ("tables/own.md", "mine"),
            ("notes.txt", "mine"),
        ] {
            assert_eq!(fs::read_to_string(at(name)).unwrap(), text, "{name}");
        }
        let third = write(folder.path(), &[("index.html", "3")]);
        assert_eq!(third.removed, [at("plots/p.svg"), at("tables/a-1.md")]);
    }

    #[test]
    fn a_broken_list_and_one_that_leaves_the_folder_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let digest = Sha256Digest::of(b"1");
        for end in ["  ../index.html", "  /index.html", " index.html"] {
            fs::write(folder.path().join(LIST), format!("{digest}  index.html\n{digest}{end}\n")).unwrap();
            let error = FileList::read(folder.path()).unwrap_err().to_string();
            assert!(error.contains("line 2: expected a SHA-256") && error.contains(LIST), "{error}");
        }
    }
}
