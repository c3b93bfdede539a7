use std::collections::BTreeMap;

use atsplat_protocol::Preset;
use serde::{Deserialize, Serialize};

use crate::EvalError;

/// What was run, with what, where: one record for a store.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Provenance {
    /// Version of the rows' schema.
    pub schema_version: u32,
    /// Hash of the rows' schema.
    pub schema_hash: String,
    /// Version of atsplat.
    pub atsplat: String,
    /// Commit that atsplat was built from; `None` where it was built outside its repository.
    pub commit: Option<String>,
    /// Operating system and architecture.
    pub platform: String,
    /// The processor's name and its vector instructions.
    pub processor: String,
    /// The adapter, where one rendered.
    pub adapter: Option<String>,
    /// Worker threads.
    pub threads: u32,
    /// Seconds since 1970 when the run began.
    pub started: u64,
    /// The command line.
    pub command: Vec<String>,
    /// Which part of a run this is; `None` for a whole one.
    #[serde(default)]
    pub shard: Option<Shard>,
    /// How many scenes of each dataset were asked for; `None` for all.
    #[serde(default)]
    pub limit: Option<u64>,
    /// Every protocol that was run.
    pub presets: Vec<PresetRecord>,
    /// Every method that was run.
    pub methods: Vec<MethodRecord>,
    /// Every metric that was asked for.
    pub metrics: Vec<MetricRecord>,
    /// What was wrong with datasets without stopping anything.
    pub warnings: Vec<WarningCount>,
    /// Index entries that made no trial.
    pub skipped: Vec<SkippedEntry>,
}

/// One of several parts of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Shard {
    /// Which, from 1.
    pub number: u32,
    /// How many there are.
    pub of: u32,
}

/// A protocol as it was run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PresetRecord {
    /// Name in the rows; that of the preset, with a suffix where one preset ran on several datasets.
    pub name: String,
    /// Name of the preset.
    pub preset: String,
    /// The published preset that it stands for, as [`atsplat_protocol::Preset::stands_for`].
    #[serde(default)]
    pub stands_for: Option<String>,
    /// One line for people.
    pub title: String,
    /// [`atsplat_protocol::Preset::hash`] in hexadecimal: results whose hashes differ do not share a table.
    pub hash: String,
    /// The whole preset as TOML.
    pub toml: String,
    /// The dataset's path as the user gave it, or what it was simulated from.
    pub dataset: String,
    /// The evaluation index's path, or how it was made.
    pub index: String,
    /// SHA-256 of the index.
    pub index_sha256: String,
    /// The known published index that it is, if any.
    pub index_name: Option<String>,
    /// Estimators of overlap that the index records; none where it ships values without saying whose they are.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub overlap_estimators: Vec<String>,
    /// Index entries that were gone through, those without a trial among them.
    pub entries: u64,
    /// How many entries the index has, those of scenes that the dataset lacks and of other shards among them.
    pub entries_of_index: u64,
}

impl PresetRecord {
    /// The published preset whose tables these results belong into: its own, or the one that it stands for.
    pub fn published(&self) -> &str {
        self.stands_for.as_deref().unwrap_or(&self.preset)
    }

    /// The protocol itself. Records of a store that was read all hold one.
    ///
    /// # Errors
    /// [`EvalError::Preset`] for text that is no protocol of this version, with its field.
    pub fn protocol(&self) -> Result<Preset, EvalError> {
        Preset::from_toml(&self.toml)
            .map_err(|source| EvalError::Preset { name: self.name.clone(), source: Box::new(source) })
    }
}

/// A method as it was run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct MethodRecord {
    /// Name in the rows: `atsplat`, `nearest-view`, a folder's name for imported renders.
    pub name: String,
    /// `atsplat`, `renders`, `ply`, `nearest-view` or `warp`.
    pub kind: String,
    /// What a table says.
    pub title: String,
    /// Everything that decides its renders: configuration, constants, precision, as JSON values by name.
    pub parameters: BTreeMap<String, serde_json::Value>,
    /// SHA-256 of its weights; `None` for methods without, and for untrained ones.
    pub weights_sha256: Option<String>,
    /// Whether its weights are random.
    pub untrained: bool,
    /// Name of the renderer's constants.
    pub constants: Option<String>,
    /// Name of the rendering backend.
    pub backend: Option<String>,
    /// Whether equal inputs give equal bits on one machine.
    pub deterministic: bool,
}

/// A metric as it was computed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct MetricRecord {
    /// Id of the [`atsplat_metrics::Definition`].
    pub id: String,
    /// Convention in words.
    pub convention: String,
    /// SHA-256 of learned weights.
    pub weights_sha256: Option<String>,
    /// Why it was not computed at all.
    pub absent: Option<String>,
}

/// A kind of warning, counted.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct WarningCount {
    /// Preset whose dataset it is.
    pub preset: String,
    /// Kind.
    pub kind: String,
    /// How often.
    pub count: u64,
    /// The first of them.
    pub example: String,
}

/// An index entry that made no trial.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct SkippedEntry {
    /// Preset that it belongs to.
    pub preset: String,
    /// Key of the scene.
    pub scene: String,
    /// Position among the scene's entries.
    pub entry: u32,
    /// Name of the reason, as [`atsplat_protocol::trial::SkipReason::name`].
    pub reason: String,
    /// Frame, limit and value, or the error's text.
    pub detail: String,
}
