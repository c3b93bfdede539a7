use std::collections::BTreeMap;
use std::fmt::Display;
use std::io::{ErrorKind, Write};
use std::path::Path;

use anyhow::Context as _;
use atsplat_eval::{Results, WarningCount};
use atsplat_files::{AtomicFile, Writer};
use atsplat_scene::Warnings;
use serde::Serialize;

/// Prints a report on standard output, as text or as JSON.
pub(crate) fn print_report<R: Display + Serialize>(report: &R, json: bool) -> anyhow::Result<()> {
    if json {
        print_text(&format!("{}\n", serde_json::to_string_pretty(report)?))
    } else {
        print_text(&report.to_string())
    }
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

/// A file opened before long work starts, which replaces its target only when the work is done.
#[derive(Debug)]
pub(crate) struct PendingFile(AtomicFile);

impl PendingFile {
    /// Opens a temporary file next to `target`, creating missing folders.
    pub(crate) fn open(target: &Path) -> anyhow::Result<Self> {
        if let Some(folder) = target.parent().filter(|parent| !parent.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).with_context(|| format!("creating the folder {}", folder.display()))?;
        }
        let file = AtomicFile::create(target).with_context(|| format!("writing {}", target.display()))?;
        Ok(Self(file))
    }

    /// Writes the contents and moves the file to its target.
    pub(crate) fn finish(self, bytes: &[u8]) -> anyhow::Result<()> {
        self.writer().write_all(bytes).with_context(|| format!("writing {}", self.0.target().display()))?;
        self.commit()
    }

    /// A writer for incremental output.
    pub(crate) fn writer(&self) -> Writer {
        self.0.writer()
    }

    /// Moves the file to its target.
    pub(crate) fn commit(self) -> anyhow::Result<()> {
        let writing = format!("writing {}", self.0.target().display());
        self.0.commit().map(drop).context(writing)
    }
}

/// Prints the warnings of a run, about its data and its trials, counted by protocol and kind, with the first of each.
/// Kinds in `printed` were already printed when the data were opened and sampled.
pub(crate) fn print_findings(results: &Results, printed: &Warnings) {
    let printed: Vec<String> = printed.counts().map(|(kind, _)| kind.to_string()).collect();
    let findings = results.provenance.warnings.iter().filter(|finding| !printed.contains(&finding.kind));
    for WarningCount { preset, kind, count, example } in findings {
        warn(&format!("warning: {preset}: {count} × {kind}"));
        warn(&format!("    {example}"));
    }
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
