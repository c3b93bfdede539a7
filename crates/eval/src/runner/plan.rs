use std::collections::BTreeSet;
use std::sync::Arc;

use atsplat_files::unix_seconds;
use atsplat_metrics::Suite;
use atsplat_protocol::Preset;
use atsplat_protocol::trial::Prefetch;
use atsplat_results::store::images::{CONTEXT, TRUTH};
use atsplat_results::times::Machine;
use atsplat_results::{MethodRecord, PresetRecord, Provenance};
use atsplat_scene::SceneSource;

use super::selection::Selected;
use super::{KeepImages, PlannedIndex, Selection, metric_records};
use crate::EvalError;
use crate::method::Method;
use crate::timing::{TimingPlan, this_machine};

/// A dataset with the protocol that it is evaluated under.
#[derive(Clone)]
pub struct Dataset {
    /// Name in the rows.
    pub name: String,
    /// Protocol under which the scenes are evaluated.
    pub preset: Preset,
    /// Loads the scenes by key.
    pub source: Arc<dyn SceneSource>,
    /// Where they come from, as the user gave it.
    pub description: String,
    /// The evaluation index.
    pub index: PlannedIndex,
}

/// Everything that defines a run.
#[derive(Clone, Copy, Debug)]
pub struct Plan<'a> {
    /// Protocols.
    pub datasets: &'a [Dataset],
    /// Methods.
    pub methods: &'a [Arc<dyn Method>],
    /// Metrics.
    pub suite: &'a Suite,
    /// Limit and shard: the part of the scenes to run.
    pub selection: Selection,
    /// The timing pass after the evaluation, if any.
    pub timing: Option<TimingPlan>,
    /// Which images are stored.
    pub images: KeepImages,
    /// How far ahead trials are prepared.
    pub prefetch: Prefetch,
}

impl std::fmt::Debug for Dataset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dataset")
            .field("name", &self.name)
            .field("description", &self.description)
            .finish_non_exhaustive()
    }
}

impl Plan<'_> {
    /// How often the run calls `step`: once per method and entry, also if the store has its result or it has no trial, and once per
    /// timed method and protocol.
    pub fn steps(&self) -> u64 {
        let entries = |dataset: &Dataset| self.selected(dataset).index.entries().count() as u64;
        let results = self.datasets.iter().map(entries).sum::<u64>() * self.methods.len() as u64;
        let timed = self.timing.map_or(0, |_| self.datasets.len() * self.methods.len());
        results + timed as u64
    }

    /// The names of its methods.
    pub(super) fn method_names(&self) -> BTreeSet<String> {
        self.methods.iter().map(|method| method.record().name).collect()
    }

    /// The provenance record of this run; `here` is the part about this machine, see [`current_provenance`].
    ///
    /// # Errors
    /// [`EvalError::Protocol`] for a preset that cannot be serialised, [`EvalError::Settings`] for duplicate names of methods
    /// or presets and for an invalid shard, [`EvalError::Unknown`] for a method with the settings of one that no preset lists.
    pub fn provenance(&self, here: Provenance) -> Result<Provenance, EvalError> {
        let methods: Vec<MethodRecord> =
            self.methods.iter().map(|method| self.method_record(method.as_ref())).collect();
        unique("methods", methods.iter().map(|method| method.name.as_str()))?;
        methods.iter().try_for_each(check_name)?;
        unique("presets", self.datasets.iter().map(|dataset| dataset.name.as_str()))?;
        self.check_settings()?;
        if let Some(shard) = self.selection.shard.filter(|shard| shard.number == 0 || shard.number > shard.count) {
            let expected = "a number from 1 to the number of shards".to_owned();
            let found = format!("{} of {}", shard.number, shard.count);
            return Err(EvalError::Settings { what: "shard", expected, found });
        }
        Ok(Provenance {
            shard: self.selection.shard,
            limit: self.selection.limit,
            presets: self.datasets.iter().map(|dataset| self.preset_record(dataset)).collect::<Result<_, _>>()?,
            adapter: Provenance::adapters(&methods),
            methods,
            metrics: metric_records(self.suite),
            ..here
        })
    }

    /// The provenance record of several runs into one store: with the presets and methods of all, so that the store lacks what was
    /// not reached.
    ///
    /// # Errors
    /// Those of [`Self::provenance`], also for names that two of the runs have in common.
    pub fn joint_provenance(plans: &[Self], here: &Provenance) -> Result<Provenance, EvalError> {
        let mut joint = here.clone();
        let (mut presets, mut methods) = (Vec::new(), Vec::new());
        for plan in plans {
            joint = plan.provenance(here.clone())?;
            presets.append(&mut joint.presets);
            methods.append(&mut joint.methods);
        }
        unique("methods", methods.iter().map(|method| method.name.as_str()))?;
        unique("presets", presets.iter().map(|preset| preset.name.as_str()))?;
        Ok(Provenance { presets, adapter: Provenance::adapters(&methods), methods, ..joint })
    }

    /// A method's record with the costs that are stated for it under each protocol.
    fn method_record(&self, method: &dyn Method) -> MethodRecord {
        let stated = method.stated_cost();
        let of_dataset = |dataset: &Dataset| Some((dataset.name.clone(), stated.clone()?));
        MethodRecord { stated: self.datasets.iter().filter_map(of_dataset).collect(), ..method.record() }
    }

    fn preset_record(&self, dataset: &Dataset) -> Result<PresetRecord, EvalError> {
        let Dataset { name, preset, description, index, .. } = dataset;
        let selected = self.selected(dataset);
        Ok(PresetRecord {
            name: name.clone(),
            preset: preset.name.clone(),
            stands_for: preset.stands_for.clone(),
            title: preset.title.clone(),
            hash: preset.hash()?.to_string(),
            toml: preset.to_toml()?,
            dataset: description.clone(),
            index: index.description.clone(),
            index_sha256: index.sha256.to_string(),
            index_name: index.name.clone(),
            reduced_from: index.reduced_from.clone(),
            overlap_estimators: index.index.overlap_estimators(),
            entries: selected.index.entries().count() as u64,
            entries_of_index: index.entries_of_file(),
            scenes_of_index: (index.left_out == 0).then(|| index.index.scene_count() as u64),
            scenes_sha256: Some(selected.scenes_sha256.to_string()),
        })
    }

    /// A misspelt name of a published method would silently mean the preset's own settings. Names that another preset lists
    /// are accepted, see [`Findings`](super::Findings).
    fn check_settings(&self) -> Result<(), EvalError> {
        let is_stated = |name: &str| self.datasets.iter().any(|dataset| dataset.preset.has_setting_of(name));
        let Some(name) = self.methods.iter().map(|method| method.setting()).find(|name| !is_stated(name)) else {
            return Ok(());
        };
        let mut known = Preset::methods_with_settings()?;
        if known.iter().any(|method| method.eq_ignore_ascii_case(name)) {
            return Ok(());
        }
        let presets = self.datasets.iter().map(|dataset| &dataset.preset);
        known.extend(presets.flat_map(|preset| &preset.methods).map(|setting| setting.method.clone()));
        let known = known.into_iter().collect();
        Err(EvalError::Unknown { what: "setting of a method", found: name.to_owned(), known })
    }

    /// The methods, of which those that import files know the scenes of all indices.
    pub(super) fn methods_of_scenes(&self) -> Vec<Arc<dyn Method>> {
        let indices: Vec<_> = self.datasets.iter().map(|dataset| &dataset.index.index).collect();
        self.methods.iter().map(|method| method.for_scenes_of(&indices).unwrap_or_else(|| Arc::clone(method))).collect()
    }

    pub(crate) fn selected(&self, dataset: &Dataset) -> Selected {
        self.selection.select(&dataset.index.index, dataset.source.keys())
    }
}

/// Rejects `truth` and `context`, under which a store keeps ground-truth and context images. An imported method has the name of its folder
/// by default, which may be one of them.
fn check_name(method: &MethodRecord) -> Result<(), EvalError> {
    let name = method.name.trim();
    if ![TRUTH, CONTEXT].contains(&name) {
        return Ok(());
    }
    let expected = "other names than truth and context, which images of a store have (NAME=METHOD names a method of run, --name \
                    that of score)";
    Err(EvalError::Settings { what: "methods", expected: expected.to_owned(), found: name.to_owned() })
}

fn unique<'a>(what: &'static str, names: impl Iterator<Item = &'a str>) -> Result<(), EvalError> {
    let mut seen = BTreeSet::new();
    for name in names {
        if !seen.insert(name) {
            let found = format!("{name} twice: rename one of them");
            return Err(EvalError::Settings { what, expected: "unique names".to_owned(), found });
        }
    }
    Ok(())
}

/// The part of a provenance record that describes the machine and the moment. `commit` is the build's, `command` the
/// command line.
pub fn current_provenance(version: &str, commit: Option<&str>, command: Vec<String>) -> Provenance {
    let Machine { processor, platform, threads, .. } = this_machine();
    Provenance {
        atsplat: version.to_owned(),
        commit: commit.map(str::to_owned),
        platform,
        processor,
        threads,
        started: unix_seconds(),
        command,
        ..Provenance::default()
    }
}
