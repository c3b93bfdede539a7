use std::collections::{BTreeMap, BTreeSet};
use std::mem::take;

use atsplat_metrics::definition;
use atsplat_metrics::learned::WeightsAbsent;
use atsplat_protocol::Preset;
use serde::{Deserialize, Deserializer, Serialize};

use super::{AdapterRecord, RecordKind, StatedCost};
use crate::{ResultsError, Shard};

/// What was run, how and where: one record per store.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Provenance {
    /// Schema version of the rows.
    pub schema_version: u32,
    /// Schema hash of the rows.
    pub schema_hash: String,
    /// Version of atsplat.
    pub atsplat: String,
    /// Commit that atsplat was built from; `None` if it was built outside its repository.
    pub commit: Option<String>,
    /// Operating system and architecture.
    pub platform: String,
    /// The processor's name and its vector instructions; of rows made on several processors, all of them, separated by `; `.
    pub processor: String,
    /// The graphics adapters that ran networks or rendered, if any.
    pub adapter: Option<String>,
    /// Worker threads.
    pub threads: u32,
    /// Start of the run in seconds since 1970.
    pub started: u64,
    /// The command line of the first run.
    pub command: Vec<String>,
    /// Other command lines that made these results, each once: of later runs into the store, of other parts and of their merge. Empty in
    /// stores of older versions.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub more_commands: Vec<Vec<String>>,
    /// Which part of a run this is; `None` for a whole run.
    #[serde(default)]
    pub shard: Option<Shard>,
    /// The numbers of the shards, in order, if several were merged without the others; `shard` is one of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub merged_shards: Vec<u32>,
    /// Maximum number of scenes of each dataset; `None` for all.
    #[serde(default)]
    pub limit: Option<u64>,
    /// Every protocol that was run.
    pub presets: Vec<PresetRecord>,
    /// Every method that was run.
    pub methods: Vec<MethodRecord>,
    /// Every requested metric.
    pub metrics: Vec<MetricRecord>,
    /// Problems with datasets that did not stop the run.
    pub warnings: Vec<WarningCount>,
    /// Index entries without a trial.
    pub skipped: Vec<SkippedEntry>,
}

/// A protocol as it was run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PresetRecord {
    /// Name in the rows: that of the preset, with a suffix if the preset ran on several datasets.
    pub name: String,
    /// Name of the preset.
    pub preset: String,
    /// The published preset that it represents, as [`atsplat_protocol::Preset::stands_for`].
    #[serde(default)]
    pub stands_for: Option<String>,
    /// One-line description.
    pub title: String,
    /// [`atsplat_protocol::Preset::hash`] in hexadecimal: results whose hashes differ do not share a table.
    pub hash: String,
    /// The whole preset as TOML.
    pub toml: String,
    /// The dataset's path as given by the user, or the description of a simulated one.
    pub dataset: String,
    /// The evaluation index's path, or how it was generated.
    pub index: String,
    /// SHA-256 that identifies the index's entries, however their file is formatted: that of the published file that has them, or
    /// else of the entries as pixelSplat's files are formatted. Earlier versions wrote that of the file.
    pub index_sha256: String,
    /// The published index that it equals or was derived from, if any.
    pub index_name: Option<String>,
    /// The published index from which it differs only in context views that its entries leave out, if any; `None` in stores of older
    /// versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reduced_from: Option<String>,
    /// Overlap estimators named in the index; empty if it has values without naming their estimator.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub overlap_estimators: Vec<String>,
    /// Index entries that were processed, including those without a trial.
    pub entries: u64,
    /// Entries of the whole index, including those of missing scenes and other shards.
    pub entries_of_index: u64,
    /// Scenes with entries of the whole index; `None` if only a part of it was known, and in stores of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenes_of_index: Option<u64>,
    /// SHA-256 over the keys of the scenes of which a limit and shards take their parts, each followed by a line feed: those with
    /// entries that are in the data, in the order of the index, and again in that of the data. `None` in stores of older versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenes_sha256: Option<String>,
}

impl PresetRecord {
    /// The published preset in whose tables these results belong: this one, or the one that it represents.
    pub fn published(&self) -> &str {
        self.stands_for.as_deref().unwrap_or(&self.preset)
    }

    /// Parses the protocol. In a store that was read, every record's protocol is valid.
    ///
    /// # Errors
    /// [`ResultsError::Preset`] for text that is not a protocol of this version, with the field.
    pub fn protocol(&self) -> Result<Preset, ResultsError> {
        Preset::from_toml(&self.toml)
            .map_err(|source| ResultsError::Preset { name: self.name.clone(), source: Box::new(source) })
    }
}

/// A method as it was run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct MethodRecord {
    /// Name in the rows: `atsplat`, `nearest-view`, a folder's name for imported renders.
    pub name: String,
    /// `atsplat`, `atsplat+refine`, `renders`, `ply`, `exec`, `python`, `nearest-view` or `warp`, or the strategy of an optimisation
    /// from scratch: `3dgs`, `mip-splatting`, `mcmc` or `fixed`.
    pub kind: String,
    /// Title in tables.
    pub title: String,
    /// Everything that determines its renders: configuration, constants, precision, as JSON values by name.
    #[serde(deserialize_with = "parameters")]
    pub parameters: BTreeMap<String, serde_json::Value>,
    /// SHA-256 of its weights; `None` for methods without weights and for untrained ones.
    pub weights_sha256: Option<String>,
    /// Whether its weights are random.
    pub untrained: bool,
    /// How its weights were trained, if their file says so.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingRecord>,
    /// Name of the renderer's constants.
    pub constants: Option<String>,
    /// Name of the rendering backend.
    pub backend: Option<String>,
    /// The graphics adapter of its network; `None` on the CPU, and for methods without a network of this toolkit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub network_adapter: Option<AdapterRecord>,
    /// The graphics adapter that renders its Gaussians; `None` on the CPU, and for methods without Gaussians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub renderer_adapter: Option<AdapterRecord>,
    /// Whether equal inputs give bit-identical results on one machine.
    pub deterministic: bool,
    /// What imported images cost under each preset, by its name in the rows, as their user states it.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub stated: BTreeMap<String, StatedCost>,
}

/// The parameters of a record. Where no limit on the number of Gaussians applied, earlier versions wrote the largest number there is.
fn parameters<'de, D: Deserializer<'de>>(record: D) -> Result<BTreeMap<String, serde_json::Value>, D::Error> {
    let mut parameters = BTreeMap::<String, serde_json::Value>::deserialize(record)?;
    parameters.retain(|name, value| name != "max-gaussians" || value.as_u64() != Some(u64::MAX));
    Ok(parameters)
}

impl Provenance {
    /// The record of the protocol with this name in the rows.
    pub fn preset(&self, name: &str) -> Option<&PresetRecord> {
        self.presets.iter().find(|preset| preset.name == name)
    }

    /// The record of the method with this name in the rows.
    pub fn method(&self, name: &str) -> Option<&MethodRecord> {
        self.methods.iter().find(|method| method.name == name)
    }

    /// All command lines that made these results, in the order in which they were recorded.
    pub fn commands(&self) -> impl Iterator<Item = &[String]> {
        std::iter::once(&self.command).chain(&self.more_commands).map(Vec::as_slice)
    }

    /// Records another command line, unless it is there.
    pub fn add_command(&mut self, command: &[String]) {
        if !command.is_empty() && !self.commands().any(|known| known == command) {
            self.more_commands.push(command.to_vec());
        }
    }

    /// Records the command lines of another run.
    pub(crate) fn add_commands(&mut self, other: &Self) {
        other.commands().for_each(|command| self.add_command(command));
    }

    /// The graphics adapters of the methods, each once.
    pub fn adapters(methods: &[MethodRecord]) -> Option<String> {
        let both = |method: &'_ MethodRecord| [method.network_adapter.clone(), method.renderer_adapter.clone()];
        let adapters: BTreeSet<AdapterRecord> = methods.iter().flat_map(both).flatten().collect();
        let names: Vec<String> = adapters.iter().map(ToString::to_string).collect();
        (!names.is_empty()).then(|| names.join("; "))
    }

    /// Drops the reasons that concern only these methods, which are replaced by others of their names.
    pub(crate) fn forget_skipped(&mut self, methods: &BTreeSet<String>) {
        let all = take(&mut self.skipped).into_iter();
        let kept = |found: SkippedEntry| if found.methods.is_empty() { Some(found) } else { found.for_others(methods) };
        self.skipped = all.filter_map(kept).collect();
    }
}

impl Provenance {
    /// The numbers of its shards; empty for a whole run.
    pub(crate) fn shards(&self) -> BTreeSet<u32> {
        let single = self.shard.filter(|_| self.merged_shards.is_empty()).map(|shard| shard.number);
        single.into_iter().chain(self.merged_shards.iter().copied()).collect()
    }

    /// Which part of a run it is, such as `shard 2 of 8` or `shards 1 and 2 of 3`; `None` for a whole run.
    pub fn part(&self) -> Option<String> {
        let count = self.shard?.count;
        let numbers: Vec<String> = self.shards().iter().map(ToString::to_string).collect();
        Some(match numbers.as_slice() {
            [one] => format!("shard {one} of {count}"),
            [first @ .., last] => format!("shards {} and {last} of {count}", first.join(", ")),
            [] => return None,
        })
    }
}

impl MethodRecord {
    /// What it is, by [`Self::kind`].
    pub fn record_kind(&self) -> RecordKind {
        RecordKind::of(&self.kind)
    }

    /// Whether it ran as a separate process, whose timed answers include reading and writing of files.
    pub fn is_process(&self) -> bool {
        self.record_kind() == RecordKind::Exec
    }

    /// Whether its images were imported finished, so that nothing of it can be timed.
    pub fn has_finished_images(&self) -> bool {
        self.record_kind() == RecordKind::Renders
    }

    /// Records where its network runs: on this adapter, or on the CPU.
    pub fn record_network(&mut self, adapter: Option<AdapterRecord>) {
        self.deterministic &= adapter.is_none();
        self.network_adapter = adapter;
    }
}

/// How weights were trained, from the provenance in their file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct TrainingRecord {
    /// Description of the training data.
    pub data: String,
    /// Seed of the training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<String>,
}

/// The key of a weights file's provenance that names the pose normalisation of the training.
pub const TRAINED_POSES: &str = "pose-normalisation";

/// The key of the background of the training, as in `[0.0, 0.5, 1.0]`; absent in files of earlier versions.
pub const TRAINED_BACKGROUND: &str = "background";

impl TrainingRecord {
    /// From a weights file's provenance; `None` if it does not name its data.
    pub fn of(provenance: &BTreeMap<String, String>) -> Option<Self> {
        Some(Self { data: provenance.get("data")?.clone(), seed: provenance.get("seed").cloned() })
    }
}

/// A metric as it was computed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct MetricRecord {
    /// Id of the [`atsplat_metrics::Definition`].
    pub id: String,
    /// Description of the convention.
    pub convention: String,
    /// SHA-256 of learned weights.
    pub weights_sha256: Option<String>,
    /// Why it was not computed at all, if so.
    pub absent: Option<String>,
}

impl MetricRecord {
    /// Why it was not computed, without the folders that were searched for its weights: runs that differ in them are the same.
    pub fn reason_of_absence(&self) -> Option<&str> {
        self.absent.as_deref().map(WeightsAbsent::without_folders)
    }

    /// How its weights differ if they are not the published ones, so that its numbers are of another metric.
    pub fn unpublished(&self) -> Option<String> {
        let network = definition(&self.id)?.network()?;
        let (found, published) = (self.weights_sha256.as_deref()?, network.sha256_prefix());
        let difference = || format!("{}: expected weights of SHA-256 {published}…, found {found}", self.id);
        (!network.is_published(found)).then(difference)
    }

    pub(super) fn without_folders(&self) -> Self {
        Self { absent: self.reason_of_absence().map(str::to_owned), ..self.clone() }
    }
}

/// A kind of warning with its count.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct WarningCount {
    /// Preset of the dataset.
    pub preset: String,
    /// Kind.
    pub kind: String,
    /// Number of occurrences.
    pub count: u64,
    /// The first occurrence.
    pub example: String,
}

/// An index entry without a trial.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct SkippedEntry {
    /// Preset of the entry.
    pub preset: String,
    /// Key of the scene.
    pub scene: String,
    /// Position among the scene's entries.
    pub entry: u32,
    /// Name of the reason, as [`atsplat_protocol::trial::SkipReason::name`].
    pub reason: String,
    /// Frame, limit and value, or the error's text.
    pub detail: String,
    /// Methods with whose poses it was found, as other methods may have others; empty if the reason does not depend on poses, and
    /// in stores of older versions. It stays until one of these methods runs again.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub methods: BTreeSet<String>,
}

impl SkippedEntry {
    /// Whether a method has no trial for this reason.
    pub fn concerns(&self, method: &str) -> bool {
        self.methods.is_empty() || self.methods.contains(method)
    }

    /// The same for the methods that are not among `methods`; `None` if it names no other.
    pub fn for_others(&self, methods: &BTreeSet<String>) -> Option<Self> {
        let others: BTreeSet<String> = self.methods.difference(methods).cloned().collect();
        (!others.is_empty()).then(|| Self { methods: others, ..self.clone() })
    }

    /// Sorted, each reason of an entry once: independent of how the work was divided.
    pub fn joined(mut all: Vec<Self>) -> Vec<Self> {
        all.sort();
        all.dedup_by(|next, first| {
            let without_methods = |entry: &Self| Self { methods: BTreeSet::new(), ..entry.clone() };
            let is_same = without_methods(next) == without_methods(first);
            // An empty list means all methods, and sorts first.
            if is_same && !first.methods.is_empty() {
                first.methods.append(&mut next.methods);
            }
            is_same
        });
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As versions before wrote it for a refinement.
    #[test]
    fn the_largest_number_of_gaussians_is_not_a_limit() {
        let read = |limit: &str| {
            let stated = [("max-gaussians", "LIMIT"), ("seed", "7")];
            let parameters = stated.map(|(name, value)| (name.to_owned(), serde_json::Value::from(value))).into();
            let method = MethodRecord { parameters, ..MethodRecord::default() };
            let text = serde_json::to_string(&method).unwrap().replace("\"LIMIT\"", limit);
            let found: MethodRecord = serde_json::from_str(&text).unwrap();
            let value: serde_json::Value = serde_json::from_str(&text).unwrap();
            assert_eq!(serde_json::from_value::<MethodRecord>(value).unwrap(), found, "as a store is read");
            assert_eq!(found.parameters["seed"], "7");
            found.parameters.get("max-gaussians").cloned()
        };
        let largest_limit = u64::MAX - 1;
        assert_eq!(read("18446744073709551615"), None);
        assert_eq!(read(&largest_limit.to_string()), Some(serde_json::Value::from(largest_limit)));
    }
}
