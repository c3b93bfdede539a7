//! Merges the provenance of two runs.

use std::collections::BTreeSet;
use std::mem::take;

use serde::Serialize;

use super::difference::differences;
use super::{MethodRecord, PresetRecord, Provenance, SkippedEntry, WarningCount};
use crate::{ResultsError, RunWarning};

/// Whether the shards of a store that is merged were merged before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Shards {
    /// None of them.
    New,
    /// All of them: what they have counts once.
    Repeated,
}

impl Shards {
    /// The count of something in what was merged before and in these shards.
    fn total(self, merged: u64, these: u64) -> u64 {
        match self {
            Self::New => merged + these,
            Self::Repeated => merged.max(these),
        }
    }
}

impl Provenance {
    /// Adds another store of the same run. Its data, indices and folders may be in other places: the record keeps the first, and
    /// warnings count the others. All shards must be parts of the same scenes in the same order.
    ///
    /// # Errors
    /// [`ResultsError::Differences`] naming what differs; nothing is added then.
    pub(crate) fn merge_shard(&mut self, other: Self, shards: Shards) -> Result<(), ResultsError> {
        self.check_same_run(&other)?;
        self.warn_of_other_places(&other);
        self.add_commands(&other);
        for known in &mut self.presets {
            known.entries = shards.total(known.entries, other.preset(&known.name).map_or(0, |preset| preset.entries));
        }
        self.started = self.started.min(other.started);
        self.add_processors(&other.processor);
        self.merge_warnings(other.warnings, shards);
        let skipped = take(&mut self.skipped).into_iter().chain(other.skipped);
        self.skipped = SkippedEntry::joined(skipped.collect());
        Ok(())
    }

    /// Checks that another store is of the same run, except for the places of its data and files, and the number of its entries.
    fn check_same_run(&self, other: &Self) -> Result<(), ResultsError> {
        const ADVICE: &str = "; only shards of one run can be merged; `atsplat report` takes the stores of several";
        const EQUAL_COPIES: &str = "; run all shards on equal copies of the data";
        self.check_same_program(other, ADVICE)?;
        self.check_metrics(&other.metrics, ADVICE)?;
        self.check_limit(other, ADVICE)?;
        // They may have been added to the shards in another order.
        check_same("presets", None, &names(&self.presets), &names(&other.presets), ADVICE)?;
        let methods = other.methods.iter().map(|method| method.clone().with_places_recorded_in(self));
        check_same("methods", None, &by_name(self.methods.clone()), &by_name(methods.collect()), ADVICE)?;
        for preset in &other.presets {
            if let Some(known) = self.preset(&preset.name) {
                check_same_scenes(known, preset, EQUAL_COPIES)?;
                let preset = PresetRecord { entries: known.entries, ..preset.clone() }.with_places_of(known);
                check_same("presets", Some(&known.name), known, &preset, ADVICE)?;
            }
        }
        Ok(())
    }

    /// Adds the warnings of other shards, in the order of one run's, whichever shard reported a kind first.
    fn merge_warnings(&mut self, others: Vec<WarningCount>, shards: Shards) {
        for warning in others {
            let WarningCount { preset, kind, count, .. } = &warning;
            let is_of_run = RunWarning::of(kind).is_some_and(|(kind, _)| kind.is_of_run());
            match self.warnings.iter_mut().find(|known| known.preset == *preset && known.kind == *kind) {
                Some(known) if is_of_run => known.count = known.count.max(*count),
                Some(known) => known.count = shards.total(known.count, *count),
                None => self.warnings.push(warning),
            }
        }
        self.warnings.sort_by(|a, b| (&a.preset, &a.kind).cmp(&(&b.preset, &b.kind)));
    }

    /// Resumes a run with the same settings; presets, methods, metrics, scenes, stated costs and titles of imported files may be new,
    /// and the data may have scenes of the index that they lacked.
    /// Data, indices and folders may be in other places, which [`Self::take_places`] takes over once the run has found the same
    /// contents there. Its command is not recorded yet: it may make nothing.
    ///
    /// # Errors
    /// [`ResultsError::Differences`] naming what differs.
    pub(crate) fn resume_with(&mut self, other: Self) -> Result<(), ResultsError> {
        self.check_same_program(&other, NOT_RESUMED)?;
        self.add_metrics(&other.metrics)?;
        let is_part = self.limit.is_some() || self.shard.is_some();
        self.extend_limit(&other)?;
        check_same("schema versions", None, &self.schema_version, &crate::store::SCHEMA_VERSION, NOT_RESUMED)?;
        let part = |run: &Self| run.part().unwrap_or_else(|| "the whole run".to_owned());
        check_same("shards", None, &part(self), &part(&other), NOT_RESUMED)?;
        for preset in other.presets {
            self.add_preset(preset, is_part)?;
        }
        for method in other.methods {
            self.add_method(method)?;
        }
        self.adapter = Self::adapters(&self.methods).or(self.adapter.take());
        self.add_processors(&other.processor);
        Ok(())
    }

    /// Adds a preset of a run that resumes this one, or the scenes that it has more. A limit and shards take a part of the scenes,
    /// which stay the same.
    fn add_preset(&mut self, preset: PresetRecord, is_part: bool) -> Result<(), ResultsError> {
        match self.presets.iter_mut().find(|known| known.name == preset.name) {
            Some(known) => {
                if is_part {
                    check_same_scenes(known, &preset, NOT_RESUMED)?;
                } else {
                    // All scenes of the data were run, in whichever order.
                    known.add_scenes_of(&preset)?;
                }
                check_same("presets", Some(&known.name), known, &preset.with_places_of(known), NOT_RESUMED)?;
            }
            None => self.presets.push(preset),
        }
        Ok(())
    }

    /// Adds a method of a run that resumes this one, or what the run states about it.
    fn add_method(&mut self, method: MethodRecord) -> Result<(), ResultsError> {
        let method = method.with_places_recorded_in(self);
        match self.methods.iter_mut().find(|known| known.name == method.name) {
            Some(known) => {
                known.take_statements_of(&method);
                let method = method.with_statements_of(known);
                check_same("methods", Some(&known.name), known, &method, OTHER_METHOD)?;
            }
            None => self.methods.push(method),
        }
        Ok(())
    }

    /// Adds the processors of other rows; each is listed once.
    fn add_processors(&mut self, other: &str) {
        let known = self.processors().chain(processors(other)).map(str::to_owned);
        let all: BTreeSet<String> = known.collect();
        self.processor = all.into_iter().collect::<Vec<_>>().join(BETWEEN_PROCESSORS);
    }

    /// The processors on which rows were made.
    pub fn processors(&self) -> impl Iterator<Item = &str> {
        processors(&self.processor)
    }

    fn check_same_program(&self, other: &Self, advice: &'static str) -> Result<(), ResultsError> {
        check_same("versions of atsplat", None, &self.atsplat, &other.atsplat, advice)?;
        check_same("commits of atsplat", None, &self.commit, &other.commit, advice)?;
        check_same("platforms", None, &self.platform, &other.platform, advice)
    }
}

impl MethodRecord {
    /// Takes over the costs that a later run states for the method, and its title of imported files: no row depends on them. A title
    /// that is the name was not stated.
    fn take_statements_of(&mut self, later: &Self) {
        for (preset, cost) in &later.stated {
            let earlier = self.stated.remove(preset).unwrap_or_default();
            self.stated.insert(preset.clone(), cost.clone().or(earlier));
        }
        if later.record_kind().imports_files() && later.title != later.name {
            self.title.clone_from(&later.title);
        }
    }

    /// With the stated costs, and the title of imported files, of `known`.
    fn with_statements_of(self, known: &Self) -> Self {
        let title = if self.record_kind().imports_files() { known.title.clone() } else { self.title };
        Self { stated: known.stated.clone(), title, ..self }
    }
}

const OTHER_METHOD: &str = "; its existing results cannot be resumed: choose another name for the method (--name, or NAME= before it), or \
                            another folder for the results";
const NOT_RESUMED: &str = "; the existing results cannot be resumed: choose another folder for the new results";
const BETWEEN_PROCESSORS: &str = "; ";

fn processors(text: &str) -> impl Iterator<Item = &str> {
    text.split(BETWEEN_PROCESSORS).filter(|processor| !processor.is_empty())
}

fn names(presets: &[PresetRecord]) -> BTreeSet<&str> {
    presets.iter().map(|preset| preset.name.as_str()).collect()
}

fn by_name(mut methods: Vec<MethodRecord>) -> Vec<MethodRecord> {
    methods.sort_by(|a, b| a.name.cmp(&b.name));
    methods
}

/// Checks that a limit and shards take their parts of the same scenes in the same order; older versions did not record them.
fn check_same_scenes(first: &PresetRecord, second: &PresetRecord, advice: &'static str) -> Result<(), ResultsError> {
    const OTHERS: &str = "the data of one have other scenes, or its data or index are in another order, so that shards or a limit take \
                          other parts of them";
    match (&first.scenes_sha256, &second.scenes_sha256) {
        (Some(of_first), Some(of_second)) if of_first != of_second => Err(ResultsError::Differences {
            what: "scenes under",
            name: Some(first.name.clone()),
            differences: OTHERS.to_owned(),
            advice,
        }),
        _ => Ok(()),
    }
}

/// Checks that two records are the same; `name` says which of several they are.
fn check_same<T: Serialize + PartialEq>(
    what: &'static str,
    name: Option<&str>,
    first: &T,
    second: &T,
    advice: &'static str,
) -> Result<(), ResultsError> {
    if first == second {
        return Ok(());
    }
    let (name, differences) = (name.map(str::to_owned), differences(first, second));
    Err(ResultsError::Differences { what, name, differences, advice })
}

#[cfg(test)]
mod tests;
