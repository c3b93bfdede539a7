use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;
use thiserror::Error;

use super::SCHEMA_VERSION;
use super::data::check_consistent;
use crate::rows::Shards;
use crate::times::{TimingRow, merged};
use crate::{MetricRecord, Provenance, Results, ResultsError, Shard, TargetRow, TrialKey, TrialRow};

/// A store that is given twice, even by another path, and the name that it has first; `None` if there is none.
pub fn repeated_store(stores: &[PathBuf]) -> Option<[&Path; 2]> {
    let mut seen: Vec<(PathBuf, &Path)> = Vec::new();
    for store in stores {
        // A missing store is reported when it is read.
        let place = store.canonicalize().unwrap_or_else(|_missing| store.clone());
        if let Some((_, first)) = seen.iter().find(|(other, _)| *other == place) {
            return Some([store.as_path(), *first]);
        }
        seen.push((place, store.as_path()));
    }
    None
}

/// Several stores merged into one.
#[derive(Clone, Debug, PartialEq)]
pub struct Merged {
    /// Their rows, in the order of keys.
    pub results: Results,
    /// Numbers of missing shards, from 1.
    pub missing_shards: Vec<u32>,
    /// Stores whose run is unfinished.
    pub unfinished: Vec<Unfinished>,
    /// Number of results that an earlier store already had, with equal values.
    pub repeated: u64,
}

/// Why stores cannot be merged.
#[derive(Debug, Error)]
#[error("{source}")]
pub struct MergeError {
    /// Position of the store that does not fit those before it; `None` if only all of them together are at fault.
    pub part: Option<usize>,
    /// The reason.
    pub source: Box<ResultsError>,
}

impl From<ResultsError> for MergeError {
    /// Of all stores together.
    fn from(error: ResultsError) -> Self {
        Self { part: None, source: Box::new(error) }
    }
}

/// A store that lacks results of its run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Unfinished {
    /// Which part of the run, if it is divided.
    pub shard: Option<Shard>,
    /// Name of the preset in the rows.
    pub preset: String,
    /// Name of the method in the rows.
    pub method: String,
    /// Index entries with a result, or with a reason why there is none.
    pub entries: u64,
    /// Index entries of the part.
    pub total: u64,
    /// The metric that results lack which do not count therefore, although others have it: it was being added.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lacking: Option<String>,
}

impl fmt::Display for Unfinished {
    /// `shard 2 of 8 is not done: 14 of 20 entries of rooms-2v-128 under warp`, and ` with l1` if the others lack that metric.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { shard, preset, method, entries, total, lacking } = self;
        match shard {
            Some(Shard { number, count }) => write!(f, "shard {number} of {count}")?,
            None => f.write_str("a store")?,
        }
        write!(f, " is not done: {entries} of {total} entries of {preset} under {method}")?;
        lacking.iter().try_for_each(|metric| write!(f, " with {metric}"))
    }
}

impl Merged {
    /// Why the results are not those of the whole run: missing shards, and stores that are not done. Empty if they are.
    pub fn why_incomplete(&self) -> Vec<String> {
        let missing: Vec<String> = self.missing_shards.iter().map(ToString::to_string).collect();
        let missing = match missing.as_slice() {
            [] => None,
            [one] => Some(format!("shard {one} is missing")),
            several => Some(format!("shards {} are missing", several.join(", "))),
        };
        missing.into_iter().chain(self.unfinished.iter().map(ToString::to_string)).collect()
    }
}

impl Results {
    /// The protocols and methods whose run into this store is unfinished: entries have neither a row nor a reason, or their row lacks
    /// a metric that other rows have.
    pub fn unfinished(&self) -> Vec<Unfinished> {
        let Provenance { shard, presets, methods, skipped, .. } = &self.provenance;
        let mut unfinished = Vec::new();
        for (preset, method) in presets.iter().flat_map(|preset| methods.iter().map(move |method| (preset, method))) {
            let keys = self.trials_of(&preset.name, &method.name).map(|trial| &trial.key);
            let mut known: BTreeSet<(&str, u32)> = keys.map(|key| (key.scene.as_str(), key.entry)).collect();
            let lacking = self.lacking(&preset.name, &method.name);
            for (row, _) in &lacking {
                known.remove(&(row.key.scene.as_str(), row.key.entry));
            }
            let skipped =
                skipped.iter().filter(|skipped| skipped.preset == preset.name && skipped.concerns(&method.name));
            known.extend(skipped.map(|skipped| (skipped.scene.as_str(), skipped.entry)));
            let entries = known.len() as u64;
            if entries < preset.entries {
                let (preset, method, total) = (preset.name.clone(), method.name.clone(), preset.entries);
                let lacking = lacking.first().map(|(_, metric)| metric.id.clone());
                unfinished.push(Unfinished { shard: *shard, preset, method, entries, total, lacking });
            }
        }
        unfinished
    }

    /// The targets that lack a metric which others have under this protocol and method, with the metric. It is added to all or to
    /// none, so that a run was cut off, or failed to evaluate them again.
    fn lacking(&self, preset: &str, method: &str) -> Vec<(&TargetRow, &MetricRecord)> {
        let scored: Vec<&TargetRow> =
            self.targets_of(preset, method).filter(|target| target.status.is_scored()).collect();
        let is_there = |metric: &&MetricRecord| scored.iter().any(|target| target.scores.contains_key(&metric.id));
        let there: Vec<&MetricRecord> = self.provenance.metrics.iter().filter(is_there).collect();
        let pairs = scored.iter().flat_map(|target| there.iter().map(move |metric| (*target, *metric)));
        pairs.filter(|(target, metric)| target.lacks(metric)).collect()
    }

    /// Those of [`Self::unfinished`] with a row: without any, a method may never have been requested under that protocol, as runs
    /// of other methods under other protocols may share a store.
    pub fn interrupted(&self) -> Vec<Unfinished> {
        let mut interrupted = self.unfinished();
        interrupted.retain(|run| self.trials_of(&run.preset, &run.method).next().is_some());
        interrupted
    }

    /// Those of [`Self::unfinished`] that are known to have been cut off: with a row, and those that a run has not reached, because
    /// nothing under that protocol, or nothing of that method, has a row or is finished.
    pub fn cut_off(&self) -> Vec<Unfinished> {
        let unfinished = self.unfinished();
        let Provenance { presets, methods, .. } = &self.provenance;
        let rows: BTreeSet<(&str, &str)> =
            self.trials.iter().map(|trial| (trial.key.preset.as_str(), trial.key.method.as_str())).collect();
        let is_finished =
            |preset: &str, method: &str| !unfinished.iter().any(|run| run.preset == preset && run.method == method);
        let has_begun = |preset: &str, method: &str| rows.contains(&(preset, method)) || is_finished(preset, method);
        let is_cut_off = |run: &&Unfinished| {
            let (preset, method) = (run.preset.as_str(), run.method.as_str());
            rows.contains(&(preset, method))
                || !methods.iter().any(|other| has_begun(preset, &other.name))
                || !presets.iter().any(|other| has_begun(&other.name, method))
        };
        unfinished.iter().filter(is_cut_off).cloned().collect()
    }

    /// Merges shards of one run. Rows that several shards contain must agree; timings stay separate by machine. The data and imported
    /// files may have been in other places ([`crate::RunWarning::OtherData`]).
    ///
    /// # Errors
    /// [`MergeError`], which names the part that does not fit: [`ResultsError::Different`] and [`ResultsError::Differences`] if they are
    /// not of one run, or other scenes were divided, as of another copy of the data, [`ResultsError::Disagreement`],
    /// [`ResultsError::MixedData`], [`ResultsError::Invalid`] for an empty list.
    pub fn merge(parts: Vec<Self>) -> Result<Merged, MergeError> {
        let mut parts = parts.into_iter();
        let nothing =
            || ResultsError::Invalid { what: "merge", expected: "results".to_owned(), found: "none".to_owned() };
        let first = parts.next().ok_or_else(nothing)?;
        let mut unfinished = first.unfinished();
        let Self { mut provenance, trials, targets, timings } = first;
        let mut shards = provenance.shards();
        let count = provenance.shard.map(|shard| shard.count);
        let mut rows = Rows::default();
        let of_part = |at: usize| move |error: ResultsError| MergeError { part: Some(at), source: Box::new(error) };
        rows.add(trials, targets, timings).map_err(of_part(0))?;
        for (at, part) in (1..).zip(parts) {
            unfinished.extend(part.unfinished());
            check_same_count(count, part.provenance.shard.map(|shard| shard.count))
                .and_then(|()| rows.add_shard(part, &mut provenance, &mut shards))
                .map_err(of_part(at))?;
        }
        let all = count.into_iter().flat_map(|count| 1..=count);
        let missing_shards: Vec<u32> = all.filter(|number| !shards.contains(number)).collect();
        provenance.schema_version = SCHEMA_VERSION;
        provenance.schema_hash = super::schema_hash();
        let repeated = rows.repeated;
        let mut results = rows.into_results(provenance)?;
        // A store may contain runs of other methods under other protocols, or be an unfinished copy of another part.
        let cut_off = results.cut_off();
        let is_same = |a: &Unfinished, b: &Unfinished| (&a.preset, &a.method) == (&b.preset, &b.method);
        unfinished.retain(|run| cut_off.iter().any(|other| is_same(run, other)));
        // Each store may be done, but only some have a metric.
        let uneven = cut_off.into_iter().filter(|run| !unfinished.iter().any(|known| is_same(known, run)));
        let uneven: Vec<Unfinished> = uneven.map(|run| Unfinished { shard: None, ..run }).collect();
        unfinished.extend(uneven);
        if missing_shards.is_empty() && unfinished.is_empty() {
            results.provenance.shard = None;
        }
        let is_several = results.provenance.shard.is_some() && shards.len() > 1;
        results.provenance.merged_shards = if is_several { Vec::from_iter(shards) } else { Vec::new() };
        check_consistent(&results)?;
        Ok(Merged { results, missing_shards, unfinished, repeated })
    }
}

/// Rejects parts of runs that were divided into different numbers of shards, or of which one was not divided.
fn check_same_count(expected: Option<u32>, found: Option<u32>) -> Result<(), ResultsError> {
    if expected == found {
        return Ok(());
    }
    let [expected, found] = [expected, found]
        .map(|count| count.map_or_else(|| "a whole run".to_owned(), |count| format!("{count} shards")));
    let advice = "; only shards of one run can be merged; `atsplat report` takes the stores of several";
    Err(ResultsError::Different { what: "numbers of shards", expected, found, advice })
}

/// Whether the shards of a part were merged before. If only some were, their entries could not be counted once.
fn repetition(merged: &BTreeSet<u32>, part: &Provenance) -> Result<Shards, ResultsError> {
    let shards = part.shards();
    if shards.is_subset(merged) {
        return Ok(Shards::Repeated);
    }
    match shards.intersection(merged).next() {
        None => Ok(Shards::New),
        Some(twice) => Err(ResultsError::Different {
            what: "shards",
            expected: "stores that have no shard in common, or the same ones".to_owned(),
            found: format!("shard {twice} in two of them"),
            advice: "; name each shard once",
        }),
    }
}

#[derive(Default)]
struct Rows {
    trials: BTreeMap<TrialKey, TrialRow>,
    targets: BTreeMap<(TrialKey, u32), TargetRow>,
    repeated: u64,
    timings: Vec<TimingRow>,
}

impl Rows {
    /// Adds a part, of which the provenance and the shards are added to those of the others.
    fn add_shard(
        &mut self,
        part: Results,
        provenance: &mut Provenance,
        shards: &mut BTreeSet<u32>,
    ) -> Result<(), ResultsError> {
        let repetition = repetition(shards, &part.provenance)?;
        shards.extend(part.provenance.shards());
        provenance.merge_shard(part.provenance, repetition)?;
        self.add(part.trials, part.targets, part.timings)
    }

    fn add(
        &mut self,
        trials: Vec<TrialRow>,
        targets: Vec<TargetRow>,
        timings: Vec<TimingRow>,
    ) -> Result<(), ResultsError> {
        self.timings.extend(timings);
        for trial in trials {
            match self.trials.get(&trial.key) {
                Some(known) => {
                    agree(&trial.key, known, &trial)?;
                    self.repeated += 1;
                }
                None => drop(self.trials.insert(trial.key.clone(), trial)),
            }
        }
        for target in targets {
            let key = (target.key.clone(), target.target);
            match self.targets.get(&key) {
                Some(known) => agree(&target.key, known, &target)?,
                None => drop(self.targets.insert(key, target)),
            }
        }
        Ok(())
    }

    fn into_results(self, provenance: Provenance) -> Result<Results, ResultsError> {
        let (trials, targets) = (self.trials.into_values().collect(), self.targets.into_values().collect());
        Ok(Results { provenance, trials, targets, timings: merged(self.timings)? })
    }
}

#[expect(clippy::expect_used, reason = "rows are representable in JSON")]
fn agree<R: Serialize + PartialEq>(key: &TrialKey, first: &R, second: &R) -> Result<(), ResultsError> {
    if first == second {
        return Ok(());
    }
    let fields = |row: &R| serde_json::to_value(row).expect("a row is a JSON object");
    let (first, second) = (fields(first), fields(second));
    let names = first.as_object().into_iter().flatten().map(|(name, _)| name);
    let differing = names.into_iter().find(|name| first.get(name) != second.get(name));
    // NaN differs from itself and is null in JSON.
    let field = differing.map_or("a non-finite number", String::as_str).to_owned();
    let value = |row: &serde_json::Value| row.get(&field).map_or_else(|| "none".to_owned(), ToString::to_string);
    Err(ResultsError::Disagreement { key: key.to_string(), first: value(&first), second: value(&second), field })
}
