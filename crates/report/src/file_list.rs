//! The files of a report in its folder: the next report there removes those that it does not write again, and nothing else.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use atsplat_files::{FileError, Sha256Digest, entries_if_exists, is_plain_name, name_of, read_if_exists, shortened};

use crate::ReportError;

/// Name of the list of a report's files, in the format of `sha256sum`.
const LIST: &str = "report.sha256";
/// While a report is written: its files, and those of the reports before it.
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

/// SHA-256 of a report's files by their paths in its folder, with `/` between their parts; several of a file that an
/// interrupted report replaced or was about to.
#[derive(Debug, Default)]
struct FileList(BTreeMap<String, Vec<Sha256Digest>>);

impl FileList {
    /// The files of the report in a folder, and of one that was interrupted there; empty if there is none.
    ///
    /// # Errors
    /// [`ReportError::Io`] for a list that cannot be read, or that names something outside the folder.
    fn read(folder: &Path) -> Result<Self, ReportError> {
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
        // The end of a list may be lost if the power fails.
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
            let known = self.0.entry(name.to_owned()).or_default();
            if !known.contains(&digest) {
                known.push(digest);
            }
        }
        Ok(())
    }

    /// The list as text.
    fn lines(&self) -> String {
        self.0.iter().flat_map(|(name, digests)| digests.iter().map(move |digest| line_of(name, digest))).collect()
    }

    /// The hashes of a file; none if it is not of a report.
    fn digests(&self, name: &str) -> &[Sha256Digest] {
        self.0.get(name).map_or(&[][..], Vec::as_slice)
    }

    /// Removes the files that are not among `kept`, unless they were changed since a report wrote them; returns their paths.
    fn remove_all_but(&self, folder: &Path, kept: &BTreeMap<&str, Sha256Digest>) -> Result<Vec<PathBuf>, ReportError> {
        let mut removed = Vec::new();
        for (name, digests) in self.0.iter().filter(|(name, _)| !kept.contains_key(name.as_str())) {
            let path = folder.join(name);
            if is_one_of(&path, digests)? {
                std::fs::remove_file(&path)
                    .map_err(FileError::during::<ReportError>("removing a file of an earlier report", &path))?;
                removed.push(path);
            }
        }
        Ok(removed)
    }
}

fn line_of(name: &str, digest: &Sha256Digest) -> String {
    format!("{digest}  {name}\n")
}

/// Writes the files of a report into a folder, by their paths there, in this order, and a list of them with their hashes. Then
/// removes the files of the report before it that are not part of it.
///
/// If this is interrupted, the next report in the folder knows the files of both reports.
///
/// # Errors
/// Before anything is written, [`ReportError::NotOfReport`] for the first file that is there already, but is not as a report before
/// wrote it, and those of [`FileList::read`]; then [`ReportError::Io`].
pub(crate) fn write(folder: &Path, files: &[(String, Vec<u8>)]) -> Result<Written, ReportError> {
    let before = FileList::read(folder)?;
    for (name, _) in files {
        let path = folder.join(name);
        if path.symlink_metadata().is_ok() && !is_one_of(&path, before.digests(name))? {
            return Err(ReportError::NotOfReport { path });
        }
    }
    let list: BTreeMap<&str, Sha256Digest> =
        files.iter().map(|(name, bytes)| (name.as_str(), Sha256Digest::of(bytes))).collect();
    let lines: String = list.iter().map(|(name, digest)| line_of(name, digest)).collect();
    let unfinished = write_file(folder.join(UNFINISHED), (before.lines() + &lines).as_bytes())?;
    let mut written = Vec::new();
    for (name, bytes) in files {
        written.push(write_file(folder.join(name), bytes)?);
    }
    let removed = before.remove_all_but(folder, &list)?;
    let others = others(folder, &written)?;
    written.push(write_file(folder.join(LIST), lines.as_bytes())?);
    std::fs::remove_file(&unfinished).map_err(FileError::during::<ReportError>("writing a report", &unfinished))?;
    Ok(Written { files: written, removed, others })
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

    fn written(folder: &Path, files: &[(&str, &str)]) -> Written {
        write_texts(folder, files).unwrap()
    }

    fn write_texts(folder: &Path, files: &[(&str, &str)]) -> Result<Written, ReportError> {
        let files: Vec<(String, Vec<u8>)> =
            files.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect();
        write(folder, &files)
    }

    #[test]
    fn a_report_removes_what_the_one_before_wrote_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let files = [("tables/a.md", "a"), ("tables/edited.md", "b"), ("plots/p.svg", "p"), ("index.html", "1")];
        let first = written(folder.path(), &files);
        assert_eq!((first.files.len(), first.removed.len(), first.others.len()), (5, 0, 0));
        for (name, text) in [("tables/edited.md", "changed"), ("tables/mine.md", "mine"), ("notes.txt", "mine")] {
            fs::write(at(name), text).unwrap();
        }
        let second = written(folder.path(), &[("tables/a-1.md", "a"), ("plots/p.svg", "q"), ("index.html", "2")]);
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
        let third = written(folder.path(), &[("index.html", "3")]);
        assert_eq!(third.removed, [at("plots/p.svg"), at("tables/a-1.md")]);
    }

    #[test]
    fn files_that_are_not_of_a_report_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let files = [("tables/a.md", "a"), ("index.html", "1")];
        fs::write(at("index.html"), "mine").unwrap();
        let rejected = |files: &[(&str, &str)]| match write_texts(folder.path(), files) {
            Err(ReportError::NotOfReport { path }) => path,
            other => panic!("{other:?}"),
        };
        assert_eq!(rejected(&files), at("index.html"));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing was written");
        fs::remove_file(at("index.html")).unwrap();
        written(folder.path(), &files);
        written(folder.path(), &[("tables/a.md", "b"), ("index.html", "1")]);
        fs::write(at("tables/a.md"), "edited").unwrap();
        assert_eq!(rejected(&files), at("tables/a.md"));
        assert_eq!(fs::read_to_string(at("tables/a.md")).unwrap(), "edited");
    }

    #[test]
    fn the_files_of_an_interrupted_report_are_known() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        written(folder.path(), &[("tables/a.md", "a"), ("index.html", "1")]);
        // Twice ended after the tables, before the page was written, with a list that lost its end.
        fs::write(at("films"), "mine").unwrap();
        for text in ["b", "d"] {
            let files = [("tables/a.md", text), ("tables/b.md", text), ("films/f.png", text), ("index.html", text)];
            assert!(matches!(write_texts(folder.path(), &files), Err(ReportError::Io(_))), "`films` is no folder");
            assert_eq!(fs::read_to_string(at("tables/b.md")).unwrap(), text);
            assert_eq!(fs::read_to_string(at("index.html")).unwrap(), "1");
            let list = fs::read_to_string(at(UNFINISHED)).unwrap();
            fs::write(at(UNFINISHED), format!("{list}3f")).unwrap();
        }
        fs::remove_file(at("films")).unwrap();
        let next = written(folder.path(), &[("tables/a.md", "c"), ("index.html", "2")]);
        assert_eq!((next.removed, next.others), (vec![at("tables/b.md")], Vec::new()));
        assert!(!at(UNFINISHED).exists());
        assert_eq!(written(folder.path(), &[("index.html", "3")]).removed, [at("tables/a.md")]);
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
