use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf, absolute};

use anyhow::Context as _;
use atsplat_eval::{Results, WarningCount};
use atsplat_files::{AtomicFile, Writer};
use atsplat_scene::Warnings;
use serde::Serialize;

/// Prints a report on standard output, as text or as JSON.
pub(crate) fn print_report<R: Display + Serialize>(report: &R, json: bool) -> anyhow::Result<()> {
    if json { print_json(report) } else { print_text(&report.to_string()) }
}

/// Prints JSON on standard output.
pub(crate) fn print_json<T: Serialize + ?Sized>(value: &T) -> anyhow::Result<()> {
    print_text(&format!("{}\n", serde_json::to_string_pretty(value)?))
}

/// Prints text on standard output; a closed pipe is not an error.
pub(crate) fn print_text(text: &str) -> anyhow::Result<()> {
    let mut stdout = std::io::stdout().lock();
    match stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush()) {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        outcome => outcome.context("writing to standard output"),
    }
}

/// Prints a line on standard error, where progress and warnings go.
pub(crate) fn warn(line: &str) {
    writeln!(std::io::stderr(), "{line}").ok();
}

/// The place of a file or folder, whichever path leads to it. Links to one that does not exist are not followed.
pub(crate) fn place(path: &Path) -> std::io::Result<PathBuf> {
    Path::new(".").join(path).canonicalize().or_else(|_missing| absolute(path))
}

/// Folders that were created before the work started. Dropped, those that are still empty are removed: a command that fails
/// leaves none behind.
#[derive(Debug, Default)]
pub(crate) struct NewFolders(Vec<PathBuf>);

impl NewFolders {
    /// Creates a folder, and those above it that are missing.
    pub(crate) fn of(folder: &Path) -> anyhow::Result<Self> {
        let mut folders = Self::default();
        folders.create(folder)?;
        Ok(folders)
    }

    /// Creates the folder of a file.
    pub(crate) fn create_for(&mut self, file: &Path) -> anyhow::Result<()> {
        file.parent().filter(|folder| !folder.as_os_str().is_empty()).map_or(Ok(()), |folder| self.create(folder))
    }

    fn create(&mut self, folder: &Path) -> anyhow::Result<()> {
        let is_missing = |folder: &&Path| !folder.as_os_str().is_empty() && !folder.exists();
        let missing: Vec<&Path> = folder.ancestors().take_while(is_missing).collect();
        self.0.extend(missing.into_iter().rev().map(Path::to_owned));
        std::fs::create_dir_all(folder).with_context(|| format!("creating the folder {}", folder.display()))
    }
}

impl Drop for NewFolders {
    fn drop(&mut self) {
        // From the inside out. One that holds something cannot be removed.
        for folder in self.0.iter().rev() {
            std::fs::remove_dir(folder).ok();
        }
    }
}

/// A file opened before long work starts, which replaces its target only when the work is done.
#[derive(Debug)]
pub(crate) struct PendingFile {
    /// Before the folders, which are empty only without its temporary file.
    file: AtomicFile,
    _folders: NewFolders,
}

impl PendingFile {
    /// Opens a temporary file next to `target`, creating missing folders.
    pub(crate) fn open(target: &Path) -> anyhow::Result<Self> {
        let mut folders = NewFolders::default();
        folders.create_for(target)?;
        let file = AtomicFile::create(target).with_context(|| format!("writing {}", target.display()))?;
        Ok(Self { file, _folders: folders })
    }

    /// Writes the contents and moves the file to its target.
    pub(crate) fn finish(self, bytes: &[u8]) -> anyhow::Result<()> {
        self.writer().write_all(bytes).with_context(|| format!("writing {}", self.file.target().display()))?;
        self.commit()
    }

    /// A writer for incremental output.
    pub(crate) fn writer(&self) -> Writer {
        self.file.writer()
    }

    /// Moves the file to its target.
    pub(crate) fn commit(self) -> anyhow::Result<()> {
        let writing = format!("writing {}", self.file.target().display());
        self.file.commit().map(drop).context(writing)
    }
}

/// Prints the warnings of runs, about their data and their trials, counted by protocol and kind, with the first of each.
/// Warnings in `printed` were already printed when the data were opened and sampled.
pub(crate) fn print_findings(stores: &[&Results], printed: &Warnings) {
    for ((preset, kind), (count, example)) in findings(stores, printed) {
        warn(&format!("warning: {preset}: {count} × {kind}"));
        warn(&format!("    {example}"));
    }
    for results in stores {
        print_notes(results);
    }
}

/// Warnings about data by protocol and kind, with the first of each. Stores of one protocol's data all have them: they count
/// once. Those of which as many were printed are left out.
fn findings<'a>(stores: &[&'a Results], printed: &Warnings) -> BTreeMap<(&'a str, &'a str), (u64, &'a str)> {
    let printed: BTreeMap<String, u64> = printed.counts().map(|(kind, count)| (kind.to_string(), count)).collect();
    let all = stores.iter().copied().flat_map(|own| &own.provenance.warnings);
    let mut findings: BTreeMap<(&str, &str), (u64, &str)> = BTreeMap::new();
    for WarningCount { preset, kind, count, example } in all {
        if printed.get(kind).is_none_or(|printed| printed < count) {
            let known = findings.entry((preset, kind)).or_insert((*count, example));
            if known.0 < *count {
                *known = (*count, example);
            }
        }
    }
    findings
}

/// Prints the notes of trials by protocol, method and kind.
fn print_notes(results: &Results) {
    let mut notes: BTreeMap<(&str, &str, &str), (u64, String)> = BTreeMap::new();
    for trial in &results.trials {
        for note in &trial.notes {
            let kind = note.split_once(": ").map_or(note.as_str(), |(kind, _)| kind);
            let example = || (0, format!("{}: {note}", trial.key.scene));
            notes.entry((&trial.key.preset, &trial.key.method, kind)).or_insert_with(example).0 += 1;
        }
    }
    for ((preset, method, kind), (count, example)) in notes {
        warn(&format!("warning: {preset}: {count} × {kind}, in trials of {method}"));
        warn(&format!("    {example}"));
    }
}

/// Prints counted warnings on standard error, by kind, with the first few of each.
pub(crate) fn print_warnings(warnings: &Warnings) {
    const SHOWN: usize = 3;
    for (kind, count) in warnings.counts() {
        warn(&format!("warning: {count} × {kind}"));
        for warning in warnings.kept().iter().filter(|warning| warning.kind == kind).take(SHOWN) {
            warn(&format!("    {warning}"));
        }
        if count > SHOWN as u64 {
            warn(&format!("    and {} more", count - SHOWN as u64));
        }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_eval::Provenance;
    use atsplat_scene::WarningKind;

    use super::*;

    #[test]
    fn new_folders_stay_only_if_something_is_in_them() {
        let root = tempfile::tempdir().unwrap();
        let [old, kept, file] = ["old", "new/kept", "new/empty/above/file"].map(|path| root.path().join(path));
        std::fs::create_dir(&old).unwrap();
        let mut folders = NewFolders::of(&old).unwrap();
        folders.create_for(&old.join("empty/file")).unwrap();
        folders.create(&kept).unwrap();
        drop(PendingFile::open(&file).unwrap());
        assert!(!root.path().join("new/empty").exists(), "the folders of a file that was not written");
        PendingFile::open(&file).unwrap().finish(b"written").unwrap();
        drop(folders);
        assert!(old.is_dir() && !old.join("empty").exists() && !kept.exists() && file.is_file());
        assert!(NewFolders::of(&file.join("inside")).is_err(), "a file in the place of a folder");
    }

    fn store(warnings: &[(&str, &str, u64)]) -> Results {
        let warning = |(preset, kind, count): &(&str, &str, u64)| WarningCount {
            preset: (*preset).to_owned(),
            kind: (*kind).to_owned(),
            count: *count,
            example: format!("one of {count}"),
        };
        let warnings = warnings.iter().map(warning).collect();
        Results { provenance: Provenance { warnings, ..Provenance::default() }, ..Results::default() }
    }

    /// Networks and their ablations are in two stores, on the same data; a few unreadable scenes were known when it was opened.
    #[test]
    fn findings_of_stores_with_the_same_data_count_once() {
        let networks = store(&[("rooms", "missing-image", 5), ("yards", "missing-image", 2)]);
        let ablations = store(&[("rooms", "missing-image", 5), ("rooms", "unreadable-scene", 3)]);
        let mut printed = Warnings::new();
        for scene in ["a", "b", "c"] {
            let found: Vec<_> = findings(&[&networks, &ablations], &printed).into_iter().collect();
            let expected = [
                (("rooms", "missing-image"), (5, "one of 5")),
                (("rooms", "unreadable-scene"), (3, "one of 3")),
                (("yards", "missing-image"), (2, "one of 2")),
            ];
            assert_eq!(found, expected, "fewer were printed than there are");
            printed.push(WarningKind::UnreadableScene, scene, "cut off");
        }
        let kinds: Vec<&str> = findings(&[&ablations], &printed).into_keys().map(|(_, kind)| kind).collect();
        assert_eq!(kinds, ["missing-image"], "all three were printed");
    }
}
