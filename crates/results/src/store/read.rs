use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use super::hashes::{self, TableHashes};
use super::parts::{self, Part};
use super::schema::{self, SCHEMA_VERSION, Schema};
use super::table::Table;
use super::{PROVENANCE, TARGETS, TRIALS, disk, targets, timings, trials};
use crate::times::TimingRow;
use crate::{Provenance, Results, ResultsError, TargetRow, TrialKey, TrialRow};

/// The content of a store on disk.
#[derive(Debug)]
pub(super) struct Content {
    pub(super) provenance: Provenance,
    pub(super) hashes: TableHashes,
    pub(super) rows: Rows,
    pub(super) timings: Vec<TimingRow>,
    /// Part files whose rows are included, and unfinished files left by a crash.
    pub(super) parts: Vec<PathBuf>,
}

/// How often reading is retried if the store changes meanwhile.
const ATTEMPTS: usize = 100;

impl Content {
    /// A consistent snapshot, although another process may move parts into the tables meanwhile.
    pub(super) fn read(folder: &Path) -> Result<Self, ResultsError> {
        let mut attempts = 0..ATTEMPTS;
        loop {
            let before = stamps(folder);
            let content = Self::once(folder);
            if stamps(folder) == before {
                return content;
            }
            if attempts.next().is_none() {
                let found = format!("{ATTEMPTS} changes while they were read");
                return Err(ResultsError::malformed(
                    folder,
                    "tables",
                    "files that another process leaves alone",
                    found,
                ));
            }
        }
    }

    #[expect(clippy::expect_used, reason = "tests parse every committed schema")]
    fn once(folder: &Path) -> Result<Self, ResultsError> {
        let (provenance, hashes) = records(folder)?;
        let version = provenance.schema_version;
        let schema = Schema::of_version(version).expect("a version with a known hash has a schema");
        // Parts before tables: a part that is removed meanwhile is in the tables.
        let (read, unfinished) = parts::read(folder)?;
        let replaced = read.iter().map(|(_, part)| part.trial.key.clone()).collect();
        let mut rows = tables(folder, &schema, &hashes, &replaced)?;
        let mut files = unfinished;
        for (path, Part { trial, mut targets }) in read {
            check_targets(&path, &trial, &mut targets)?;
            check_possible(&path, &trial, &targets)?;
            rows.insert(trial.key.clone(), (trial, targets));
            files.push(path);
        }
        let timings = timings::read(folder, &schema, &hashes)?;
        Ok(Self { provenance, hashes, rows, timings, parts: files })
    }

    pub(super) fn into_results(self) -> Results {
        let mut results = Results { provenance: self.provenance, timings: self.timings, ..Results::default() };
        for (trial, targets) in self.rows.into_values() {
            results.trials.push(trial);
            results.targets.extend(targets);
        }
        results
    }
}

/// Size and modification time of the files, which change if one is replaced.
fn stamps(folder: &Path) -> [Option<(u64, SystemTime)>; 4] {
    [PROVENANCE, TRIALS, TARGETS, timings::TIMINGS].map(|name| {
        let metadata = fs::metadata(folder.join(name)).ok()?;
        Some((metadata.len(), metadata.modified().ok()?))
    })
}

/// Reads a store's provenance and checks its schema; with the hashes of its tables.
pub(super) fn records(folder: &Path) -> Result<(Provenance, TableHashes), ResultsError> {
    let path = folder.join(PROVENANCE);
    let Some(bytes) = disk::read(&path)? else { return Err(ResultsError::NoStore { folder: folder.to_owned() }) };
    let malformed =
        |error: serde_json::Error| ResultsError::malformed(&path, "file", "the provenance of results", error);
    // The version first: a newer one may have unknown fields.
    let mut value: serde_json::Value = serde_json::from_slice(&bytes).map_err(malformed)?;
    let version = value.get("schema-version").and_then(serde_json::Value::as_u64);
    let version = version.and_then(|version| u32::try_from(version).ok());
    let Some(found) = version.filter(|version| *version > 0) else {
        let stated = value.get("schema-version").map_or_else(|| "none".to_owned(), ToString::to_string);
        return Err(ResultsError::malformed(&path, "schema-version", "a version from 1", stated));
    };
    let Some(expected) = schema::hash(found) else {
        return Err(ResultsError::TooNew { path, found, newest: SCHEMA_VERSION });
    };
    let hashes = value.as_object_mut().and_then(|records| records.remove(hashes::FIELD));
    let hashes: Option<TableHashes> = hashes.map(serde_json::from_value).transpose().map_err(malformed)?;
    let provenance: Provenance = serde_json::from_value(value).map_err(malformed)?;
    if provenance.schema_hash != expected {
        return Err(ResultsError::SchemaHash { path, version: found, expected, found: provenance.schema_hash });
    }
    for preset in &provenance.presets {
        let malformed =
            |error: ResultsError| ResultsError::malformed(&path, "presets", "protocols of this version", error);
        preset.protocol().map_err(malformed)?;
    }
    Ok((provenance, hashes.unwrap_or_default()))
}

pub(super) type Rows = BTreeMap<TrialKey, (TrialRow, Vec<TargetRow>)>;

/// The rows of the compacted tables, except the trials that parts `replace`; none if there are no tables. A run may be
/// killed between writing the two tables: they then disagree about trials that the parts contain as well.
pub(super) fn tables(
    folder: &Path,
    schema: &Schema,
    hashes: &TableHashes,
    replaced: &BTreeSet<TrialKey>,
) -> Result<Rows, ResultsError> {
    let mut rows = Rows::new();
    let path = folder.join(TRIALS);
    if let Some(table) = Table::read(&path, &schema.trials, hashes)? {
        for trial in trials::rows(&table)?.into_iter().filter(|trial| !replaced.contains(&trial.key)) {
            let key = trial.key.clone();
            if rows.insert(key.clone(), (trial, Vec::new())).is_some() {
                return Err(ResultsError::malformed(&path, "rows", "every trial once", format!("{key} again")));
            }
        }
    }
    let path = folder.join(TARGETS);
    if let Some(table) = Table::read(&path, &schema.targets, hashes)? {
        for target in targets::rows(&table)?.into_iter().filter(|target| !replaced.contains(&target.key)) {
            let Some((_, targets)) = rows.get_mut(&target.key) else {
                let found = format!("a target of {}, which has no trial", target.key);
                return Err(ResultsError::malformed(&path, "rows", format!("targets of trials in {TRIALS}"), found));
            };
            targets.push(target);
        }
    }
    rows.values_mut().try_for_each(|(trial, targets)| check_targets(&path, trial, targets))?;
    Ok(rows)
}

/// Sorts the targets of a trial; each must be there once.
fn check_targets(path: &Path, trial: &TrialRow, targets: &mut [TargetRow]) -> Result<(), ResultsError> {
    targets.sort_by_key(|row| row.target);
    let in_order = targets.iter().zip(0..).all(|(row, position)| row.target == position && row.key == trial.key);
    if in_order && targets.len() as u64 == u64::from(trial.targets) {
        return Ok(());
    }
    let expected = format!("{} targets of {}, each once", trial.targets, trial.key);
    Err(ResultsError::malformed(path, "rows", expected, targets.len()))
}

/// Rejects a part with an impossible value; the tables are checked row by row.
fn check_possible(path: &Path, trial: &TrialRow, targets: &[TargetRow]) -> Result<(), ResultsError> {
    let of_target = |row: &TargetRow| {
        row.impossible().map(|found| (format!("field {} of target {}", found.field, row.target), found))
    };
    let of_trial = trial.impossible().map(|found| (format!("field {} of the trial", found.field), found));
    match of_trial.or_else(|| targets.iter().find_map(of_target)) {
        None => Ok(()),
        Some((place, found)) => Err(ResultsError::malformed(path, place, found.expected, found.found)),
    }
}
