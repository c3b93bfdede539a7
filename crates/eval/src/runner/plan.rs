use std::collections::BTreeSet;
use std::sync::Arc;

use atsplat_metrics::Suite;
use atsplat_protocol::Preset;
use atsplat_protocol::trial::Prefetch;
use atsplat_scene::SceneSource;
use serde::Serialize;

use super::selection::Selected;
use super::{KeepPictures, PlannedIndex, Selection, metric_records};
use crate::method::Method;
use crate::timing::TimingPlan;
use crate::{EvalError, PresetRecord, Provenance};

/// A protocol on a dataset.
pub struct Dataset {
    /// Name in the rows.
    pub name: String,
    /// The protocol.
    pub preset: Preset,
    /// The scenes.
    pub source: Arc<dyn SceneSource>,
    /// Where they are, in the user's words.
    pub told: String,
    /// What is asked.
    pub index: PlannedIndex,
}

/// Everything that a run is about.
#[derive(Clone, Copy)]
pub struct Plan<'a> {
    /// Protocols.
    pub datasets: &'a [Dataset],
    /// Methods.
    pub methods: &'a [Arc<dyn Method>],
    /// Metrics.
    pub suite: &'a Suite,
    /// Which scenes.
    pub selection: Selection,
    /// The timing pass after the evaluation; `None` for none.
    pub timing: Option<TimingPlan>,
    /// Which pictures are kept.
    pub pictures: KeepPictures,
    /// How far ahead trials are prepared.
    pub prefetch: Prefetch,
}

/// What became of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Summary {
    /// Trials that were evaluated now.
    pub evaluated: u64,
    /// Trials that were there.
    pub resumed: u64,
    /// Trials, new and old, that are not whole: failed ones and those with failed targets.
    pub incomplete: u64,
    /// Targets, new and old, with samples that are no numbers.
    pub non_finite: u64,
    /// Index entries without a trial.
    pub skipped: u64,
    /// Scenes that indices name and datasets lack.
    pub not_there: u64,
}

impl Summary {
    /// Whether every question of every index was answered whole.
    pub const fn is_complete(&self) -> bool {
        self.incomplete == 0 && self.non_finite == 0 && self.skipped == 0 && self.not_there == 0
    }
}

impl std::fmt::Debug for Dataset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dataset").field("name", &self.name).field("told", &self.told).finish_non_exhaustive()
    }
}

impl Plan<'_> {
    /// How many results the run will have, those that are there already and index entries without a trial among them.
    pub fn results(&self) -> u64 {
        let of = |dataset: &Dataset| self.selected(dataset).index.entries().count() as u64;
        self.datasets.iter().map(of).sum::<u64>() * self.methods.len() as u64
    }

    /// How often the run calls its `step`: for each result, and for each method and protocol that is timed.
    pub fn steps(&self) -> u64 {
        let timed = self.timing.map_or(0, |_| self.datasets.len() * self.methods.len());
        self.results() + timed as u64
    }

    /// What a store says of this run; `here` is what it says of the machine.
    ///
    /// # Errors
    /// [`EvalError::Protocol`] for a preset that cannot be written, [`EvalError::Settings`] for methods or presets of one
    /// name and a shard that is none.
    pub fn provenance(&self, here: Provenance) -> Result<Provenance, EvalError> {
        let methods: Vec<_> = self.methods.iter().map(|method| method.record()).collect();
        unique("methods", methods.iter().map(|method| method.name.as_str()))?;
        unique("presets", self.datasets.iter().map(|dataset| dataset.name.as_str()))?;
        if let Some(shard) = self.selection.shard.filter(|shard| shard.number == 0 || shard.number > shard.of) {
            let found = format!("{} of {}", shard.number, shard.of);
            return Err(EvalError::Settings {
                what: "shard",
                expected: "a number from 1 to how many".to_owned(),
                found,
            });
        }
        let preset = |dataset: &Dataset| {
            let Dataset { name, preset, told, index, .. } = dataset;
            Ok(PresetRecord {
                name: name.clone(),
                preset: preset.name.clone(),
                stands_for: preset.stands_for.clone(),
                title: preset.title.clone(),
                hash: preset.hash()?.to_string(),
                toml: preset.to_toml()?,
                dataset: told.clone(),
                index: index.told.clone(),
                index_sha256: index.sha256.to_string(),
                index_name: index.name.clone(),
                overlap_estimators: index.index.overlap_estimators(),
                entries: self.selected(dataset).index.entries().count() as u64,
                entries_of_index: index.index.entries().count() as u64,
            })
        };
        Ok(Provenance {
            shard: self.selection.shard,
            limit: self.selection.limit,
            presets: self.datasets.iter().map(preset).collect::<Result<_, EvalError>>()?,
            methods,
            metrics: metric_records(self.suite),
            ..here
        })
    }

    pub(crate) fn selected(&self, dataset: &Dataset) -> Selected {
        self.selection.of(&dataset.index.index, dataset.source.keys())
    }
}

fn unique<'a>(what: &'static str, names: impl Iterator<Item = &'a str>) -> Result<(), EvalError> {
    let mut seen = BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            let found = format!("{name} twice: name one of them otherwise");
            return Err(EvalError::Settings { what, expected: "every name once".to_owned(), found });
        }
    }
    Ok(())
}

impl std::fmt::Debug for Plan<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { datasets, methods, selection, timing, pictures, prefetch, suite: _ } = self;
        f.debug_struct("Plan")
            .field("datasets", datasets)
            .field("methods", methods)
            .field("selection", selection)
            .field("timing", timing)
            .field("pictures", pictures)
            .field("prefetch", prefetch)
            .finish_non_exhaustive()
    }
}
