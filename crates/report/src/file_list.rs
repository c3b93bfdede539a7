//! The files of a report in its folder: the next report there removes those that it does not write again, and nothing else.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use atsplat_files::{FileError, Sha256Digest, entries_if_exists, is_plain_name, name_of, read_if_exists, shortened};

use crate::ReportError;

/// Name of the list of a report's files, in the format of `sha256sum`.
const LIST: &str = "report.sha256";
/// The files that a report wrote so far, until it is done; it may be about to write the last of them.
const UNFINISHED: &str = "report.unfinished.sha256";
/// The folders that contain only files of reports.
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

/// SHA-256 of a report's files by their paths in its folder, with `/` between their parts; two of a file that a report was about to
/// replace when it was interrupted.
#[derive(Debug, Default)]
pub(crate) struct FileList(BTreeMap<String, Vec<Sha256Digest>>);

/// A report that is being written.
#[derive(Debug)]
pub(crate) struct Writing<'a> {
    folder: &'a Path,
    before: FileList,
    list: BTreeMap<String, Sha256Digest>,
    files: Vec<PathBuf>,
}

impl FileList {
    /// The files of the report in a folder, and of one that was interrupted there; empty if there is none.
    ///
    /// # Errors
    /// [`ReportError::Io`] for a list that cannot be read, or that names something outside the folder.
    pub(crate) fn read(folder: &Path) -> Result<Self, ReportError> {
        let mut all = Self::default();
        for path in [LIST, UNFINISHED].map(|name| folder.join(name)) {
            let text = read_if_exists(&path).and_then(|bytes| {
                String::from_utf8(bytes.unwrap_or_default())
                    .map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
            });
            let added = text.and_then(|text| all.add(&text));
            added.map_err(FileError::during::<ReportError>("reading the list of an earlier report's files", path))?;
        }
        Ok(all)
    }

    fn add(&mut self, text: &str) -> io::Result<()> {
        const SHOWN: usize = 80;
        // A line without an end is one whose writing was interrupted.
        for (number, line) in (1..).zip(text.split_inclusive('\n').filter_map(|line| line.strip_suffix('\n'))) {
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
            self.0.entry(name.to_owned()).or_default().push(digest);
        }
        Ok(())
    }
}

fn line_of(name: &str, digest: &Sha256Digest) -> String {
    format!("{digest}  {name}\n")
}

impl<'a> Writing<'a> {
    /// Begins to write these files.
    ///
    /// # Errors
    /// [`ReportError::NotOfReport`] for the first that is there already, but is not as a report before wrote it;
    /// [`ReportError::Io`].
    pub(crate) fn new(folder: &'a Path, before: FileList, names: &[String]) -> Result<Self, ReportError> {
        for name in names {
            let path = folder.join(name);
            let known = before.0.get(name).map_or(&[][..], Vec::as_slice);
            if path.symlink_metadata().is_ok() && !is_one_of(&path, known)? {
                return Err(ReportError::NotOfReport { path });
            }
        }
        // Again from the start, without a line whose writing was interrupted.
        let of_file = |(name, digests): (&String, &Vec<Sha256Digest>)| -> String {
            digests.iter().map(|digest| line_of(name, digest)).collect()
        };
        let known: String = before.0.iter().map(of_file).collect();
        write_file(folder.join(UNFINISHED), known.as_bytes())?;
        Ok(Self { folder, before, list: BTreeMap::new(), files: Vec::new() })
    }

    /// Writes a file of this name in the report's folder, creating the folder in its name if necessary.
    pub(crate) fn write(&mut self, name: String, bytes: &[u8]) -> Result<(), ReportError> {
        let digest = Sha256Digest::of(bytes);
        self.announce(&line_of(&name, &digest))?;
        self.files.push(write_file(self.folder.join(&name), bytes)?);
        self.list.insert(name, digest);
        Ok(())
    }

    /// Notes a file before it is replaced: if this report is interrupted, the next one knows it nevertheless.
    fn announce(&self, line: &str) -> Result<(), ReportError> {
        let path = self.folder.join(UNFINISHED);
        let append = || std::fs::OpenOptions::new().append(true).open(&path)?.write_all(line.as_bytes());
        append().map_err(FileError::during("writing a report", &path))
    }

    /// Removes the files of the report before this one that are not part of it, then writes the list.
    pub(crate) fn finish(mut self) -> Result<Written, ReportError> {
        let mut removed = Vec::new();
        for (name, digests) in self.before.0.iter().filter(|(name, _)| !self.list.contains_key(*name)) {
            let path = self.folder.join(name);
            if is_one_of(&path, digests)? {
                std::fs::remove_file(&path)
                    .map_err(FileError::during::<ReportError>("removing a file of an earlier report", &path))?;
                removed.push(path);
            }
        }
        let others = others(self.folder, &self.files)?;
        let list: String = self.list.iter().map(|(name, digest)| line_of(name, digest)).collect();
        self.files.push(write_file(self.folder.join(LIST), list.as_bytes())?);
        let unfinished = self.folder.join(UNFINISHED);
        std::fs::remove_file(&unfinished).map_err(FileError::during::<ReportError>("writing a report", &unfinished))?;
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

/// Whether a file, no link and no folder, has the contents of one of these hashes.
fn is_one_of(path: &Path, digests: &[Sha256Digest]) -> Result<bool, ReportError> {
    let compared = || -> io::Result<bool> {
        if !std::fs::symlink_metadata(path)?.file_type().is_file() {
            return Ok(false);
        }
        Ok(digests.contains(&Sha256Digest::of(&std::fs::read(path)?)))
    };
    match compared() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        outcome => outcome.map_err(FileError::during("reading a file of an earlier report", path)),
    }
}

/// The files in the folders of reports that are not among `files`, in the order of their paths; hidden ones do not count.
fn others(folder: &Path, files: &[PathBuf]) -> Result<Vec<PathBuf>, ReportError> {
    let written: BTreeSet<&PathBuf> = files.iter().collect();
    let mut found = BTreeSet::new();
    for folder in FOLDERS.map(|name| folder.join(name)) {
        let paths = entries_if_exists(&folder);
        let paths = paths.map_err(FileError::during::<ReportError>("reading the folder of a report", &folder))?;
        found.extend(paths.into_iter().filter(|path| !name_of(path).starts_with('.') && !written.contains(path)));
    }
    Ok(found.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn write(folder: &Path, files: &[(&str, &str)]) -> Written {
        begin(folder, files).unwrap().finish().unwrap()
    }

    /// Everything but the end of a report.
    fn begin<'a>(folder: &'a Path, files: &[(&str, &str)]) -> Result<Writing<'a>, ReportError> {
        let names: Vec<String> = files.iter().map(|(name, _)| (*name).to_owned()).collect();
        let mut writing = Writing::new(folder, FileList::read(folder)?, &names)?;
        for (name, text) in files {
            writing.write((*name).to_owned(), text.as_bytes())?;
        }
        Ok(writing)
    }

    #[test]
    fn a_report_removes_what_the_one_before_wrote_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let files = [("tables/a.md", "a"), ("tables/edited.md", "b"), ("plots/p.svg", "p"), ("index.html", "1")];
        let first = write(folder.path(), &files);
        assert_eq!((first.files.len(), first.removed.len(), first.others.len()), (5, 0, 0));
        for (name, text) in [("tables/edited.md", "changed"), ("tables/mine.md", "mine"), ("notes.txt", "mine")] {
            fs::write(at(name), text).unwrap();
        }
        let second = write(folder.path(), &[("tables/a-1.md", "a"), ("plots/p.svg", "q"), ("index.html", "2")]);
        assert_eq!(second.removed, [at("tables/a.md")]);
        assert_eq!(second.others, [at("tables/edited.md"), at("tables/mine.md")]);
        assert!(!at("tables/a.md").exists());
        for (name, text) in [
            ("tables/a-1.md", "a"),
            ("plots/p.svg", "q"),
            ("tables/edited.md", "changed"),
            ("tables/mine.md", "mine"),
            ("notes.txt", "mine"),
        ] {
            assert_eq!(fs::read_to_string(at(name)).unwrap(), text, "{name}");
        }
        let third = write(folder.path(), &[("index.html", "3")]);
        assert_eq!(third.removed, [at("plots/p.svg"), at("tables/a-1.md")]);
    }

    #[test]
    fn files_that_are_not_of_a_report_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let files = [("tables/a.md", "a"), ("index.html", "1")];
        fs::write(at("index.html"), "mine").unwrap();
        let rejected = |files: &[(&str, &str)]| match begin(folder.path(), files) {
            Err(ReportError::NotOfReport { path }) => path,
            other => panic!("{other:?}"),
        };
        assert_eq!(rejected(&files), at("index.html"));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was written");
        fs::remove_file(at("index.html")).unwrap();
        write(folder.path(), &files);
        write(folder.path(), &[("tables/a.md", "b"), ("index.html", "1")]);
        fs::write(at("tables/a.md"), "edited").unwrap();
        assert_eq!(rejected(&files), at("tables/a.md"));
        assert_eq!(fs::read_to_string(at("tables/a.md")).unwrap(), "edited");
    }

    #[test]
    fn the_files_of_an_interrupted_report_are_known() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write(folder.path(), &[("tables/a.md", "a"), ("index.html", "1")]);
        // Twice killed after the tables, before the page was written, while it was being announced.
        for text in ["b", "d"] {
            drop(begin(folder.path(), &[("tables/a.md", text), ("tables/b.md", text)]).unwrap());
            fs::write(at(UNFINISHED), format!("{}3f", fs::read_to_string(at(UNFINISHED)).unwrap())).unwrap();
        }
        let next = write(folder.path(), &[("tables/a.md", "c"), ("index.html", "2")]);
        assert_eq!((next.removed, next.others), (vec![at("tables/b.md")], Vec::new()));
        assert!(!at(UNFINISHED).exists());
        assert_eq!(write(folder.path(), &[("index.html", "3")]).removed, [at("tables/a.md")]);
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
