use std::collections::BTreeMap;
use std::path::Path;

use atsplat_files::{Malformed, Sha256Digest};

use super::{KeyMap, KnownFile, StoredTensor, StoredTensors, TensorError, TensorFile, UnusedTensor};
use crate::ModelError;
use crate::config::{BackboneConfig, ModelConfig};
use crate::parameters::parameters;

const WHAT: &str = "ATSplat weights";
const FORMAT_KEY: &str = "atsplat.format";
/// The entry of the metadata by which a checkpoint of a training is known, with the version of its format.
pub const CHECKPOINT_KEY: &str = "atsplat.checkpoint";
/// The written format, with a hash of the metadata.
const FORMAT: &str = "2";
/// The earlier format, without a hash of the metadata.
const FORMAT_WITHOUT_HASH: &str = "1";
const CONFIGURATION_KEY: &str = "atsplat.configuration";
const DIGEST_KEY: &str = "atsplat.tensors-sha256";
const METADATA_DIGEST_KEY: &str = "atsplat.metadata-sha256";
const PROVENANCE_PREFIX: &str = "atsplat.provenance.";

/// A network's weights with configuration and provenance.
///
/// Stored as safetensors whose metadata contain `atsplat.format`, `atsplat.configuration` (the TOML text),
/// `atsplat.tensors-sha256` ([`StoredTensors::digest`]), `atsplat.provenance.<key>` for each entry of the provenance, and
/// `atsplat.metadata-sha256` over all of these. `NAMES.md` explains the tensors' names.
#[derive(Clone, Debug)]
pub struct ModelWeights {
    /// Configuration of the network.
    pub config: ModelConfig,
    /// How the weights were made: data, steps, seed, configuration, the builds that trained them with their commits, and others.
    pub provenance: BTreeMap<String, String>,
    /// Every parameter of the network, in the element types of the file, without metadata.
    pub tensors: StoredTensors,
    /// SHA-256 of the file that they were read from, in hexadecimal; none where they were not.
    pub sha256: Option<String>,
    /// Whether a hash verified configuration and provenance: `false` for files of the format without such a hash.
    pub metadata_covered: bool,
}

/// Element type of a weights file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// f32, as trained.
    Single,
    /// f16, half the size: four digits, up to 65504.
    Half,
    /// bf16, half the size: the range of f32, three digits.
    Brain,
}

impl ModelWeights {
    /// Weights from tensors that are exactly the network's parameters.
    ///
    /// # Errors
    /// [`ModelError::Unfit`] if one is missing, of another shape, or not finite; [`ModelError::Malformed`] if one is not a
    /// parameter.
    pub fn new(
        config: ModelConfig,
        provenance: BTreeMap<String, String>,
        stored: &StoredTensors,
    ) -> Result<Self, ModelError> {
        let (tensors, report) = KeyMap::identity().import(stored, &parameters(&config))?;
        if let Some(UnusedTensor { tensor, found }) = report.left_over.first() {
            return Err(ModelError::malformed(WHAT, format!("tensor {tensor}"), "a parameter of the network", found));
        }
        Ok(Self { config, provenance, tensors, sha256: None, metadata_covered: true })
    }

    /// Reads a file of this toolkit. Every tensor must be present, of its shape, finite, and match the hash in the file.
    ///
    /// # Errors
    /// [`super::TensorError::Missing`] if there is no file, [`ModelError::InFile`] around the errors of
    /// [`Self::from_stored`].
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let expected = "a weights file of this toolkit, which `atsplat weights import` makes from a PyTorch checkpoint";
        Self::of_file(&TensorFile::find(path, || expected.to_owned())?)
    }

    /// [`Self::read`] for an open file.
    ///
    /// # Errors
    /// [`ModelError::InFile`] around the errors of [`Self::from_stored`].
    pub fn of_file(file: &TensorFile) -> Result<Self, ModelError> {
        let weights = Self::from_stored(&file.stored).map_err(|error| error.in_file(&file.path))?;
        Ok(Self { sha256: Some(file.sha256.to_string()), ..weights })
    }

    /// Whether the metadata are those of a weights file of this toolkit.
    pub fn is_one(stored: &StoredTensors) -> bool {
        stored.metadata.contains_key(FORMAT_KEY)
    }

    /// Whether the metadata are those of a checkpoint of a training, which contains weights, averages and moments.
    pub fn is_checkpoint(stored: &StoredTensors) -> bool {
        stored.metadata.contains_key(CHECKPOINT_KEY)
    }

    /// The configuration in a file's metadata; tensors are not read.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if the metadata are not this toolkit's, or contain no configuration.
    pub fn config_of(stored: &StoredTensors) -> Result<ModelConfig, ModelError> {
        format_of(stored)?;
        ModelConfig::from_toml(entry(stored, CONFIGURATION_KEY, "a model configuration")?)
    }

    /// Message for a user without the weights of a network, whose SHA-256 may be known.
    pub fn advice(config: &ModelConfig, sha256: Option<Sha256Digest>) -> String {
        let hash = sha256.map_or_else(String::new, |hash| format!(" of sha256 {hash}"));
        let name = &config.name;
        let mut text = format!(
            "a weights file{hash} of the model {name}, which `atsplat weights import CHECKPOINT --model {name}` makes from \
             a PyTorch checkpoint"
        );
        if let BackboneConfig::DinoV2 { .. } = config.backbone {
            text.push_str("; its frozen backbone is ");
            text.push_str(&KnownFile::advice(&config.backbone));
        }
        text
    }

    /// The same weights for another configuration with identical parameters.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn for_network(self, config: ModelConfig) -> Result<Self, ModelError> {
        let Self { sha256, metadata_covered, .. } = self;
        Ok(Self { sha256, metadata_covered, ..Self::new(config, self.provenance, &self.tensors)? })
    }

    /// The inverse of [`Self::to_stored`].
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if the metadata are not this toolkit's or a hash differs, and as [`Self::new`].
    pub fn from_stored(stored: &StoredTensors) -> Result<Self, ModelError> {
        let metadata_covered = check_metadata(stored)?;
        let config = Self::config_of(stored)?;
        let (digest, found) = (entry(stored, DIGEST_KEY, "a sha256")?, stored.digest());
        if digest != found {
            return Err(ModelError::malformed(WHAT, "tensors", format!("sha256 {digest}, as written"), found));
        }
        let provenance = stored
            .metadata
            .iter()
            .filter_map(|(key, value)| key.strip_prefix(PROVENANCE_PREFIX).map(|key| (key.to_owned(), value.clone())));
        Ok(Self { metadata_covered, ..Self::new(config, provenance.collect(), stored)? })
    }

    /// The contents of a file, which [`Self::from_stored`] reads.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if a value is beyond the precision's range.
    pub fn to_stored(&self, precision: Precision) -> Result<StoredTensors, ModelError> {
        let mut stored = StoredTensors::default();
        for (name, tensor) in &self.tensors.tensors {
            stored.tensors.insert(name.clone(), in_precision(name, tensor, precision)?);
        }
        stored.metadata.insert(FORMAT_KEY.to_owned(), FORMAT.to_owned());
        stored.metadata.insert(CONFIGURATION_KEY.to_owned(), self.config.to_toml()?);
        stored.metadata.insert(DIGEST_KEY.to_owned(), stored.digest());
        for (key, value) in &self.provenance {
            stored.metadata.insert(format!("{PROVENANCE_PREFIX}{key}"), value.clone());
        }
        let digest = stored.metadata_digest(METADATA_DIGEST_KEY);
        stored.metadata.insert(METADATA_DIGEST_KEY.to_owned(), digest);
        Ok(stored)
    }

    /// Writes a file atomically; the same weights give the same bytes.
    ///
    /// # Errors
    /// [`ModelError::Io`], and as [`Self::to_stored`].
    pub fn write(&self, path: &Path, precision: Precision) -> Result<(), ModelError> {
        Ok(self.to_stored(precision)?.write(path)?)
    }
}

/// A tensor in the element type of a file.
fn in_precision(name: &str, tensor: &StoredTensor, precision: Precision) -> Result<StoredTensor, TensorError> {
    let converted = match precision {
        Precision::Single => StoredTensor::from_f32(tensor.shape().to_vec(), &tensor.to_f32()?),
        Precision::Half => tensor.to_f16(),
        Precision::Brain => tensor.to_bf16(),
    };
    converted.map_err(|error| match error {
        TensorError::Malformed(found) => {
            TensorError::Malformed(Malformed { location: format!("tensor {name}"), ..found })
        }
        other => other,
    })
}

/// The version of a file's format, if it is supported.
fn format_of(stored: &StoredTensors) -> Result<&str, ModelError> {
    if ModelWeights::is_checkpoint(stored) {
        let found = "a training checkpoint: resume its run with --resume, or use weights.safetensors of its folder; \
                     `atsplat weights import CHECKPOINT --out FILE` writes the weights of an older one";
        return Err(ModelError::malformed(WHAT, "file", "a weights file", found));
    }
    let format = entry(stored, FORMAT_KEY, "the format's version; other files are imported by a key map")?;
    if [FORMAT_WITHOUT_HASH, FORMAT].contains(&format) {
        return Ok(format);
    }
    let expected = format!("{FORMAT_WITHOUT_HASH} or {FORMAT}");
    Err(ModelError::malformed(WHAT, format!("metadata {FORMAT_KEY}"), expected, format))
}

/// Whether a hash covers the metadata; an error if it does not match, or is missing from a format that has one.
fn check_metadata(stored: &StoredTensors) -> Result<bool, ModelError> {
    let format = format_of(stored)?;
    let Some(recorded) = stored.metadata.get(METADATA_DIGEST_KEY) else {
        if format == FORMAT_WITHOUT_HASH {
            return Ok(false);
        }
        return entry(stored, METADATA_DIGEST_KEY, "the hash of the metadata").map(|_| true);
    };
    let found = stored.metadata_digest(METADATA_DIGEST_KEY);
    if *recorded != found {
        let expected = format!("sha256 {recorded}, as written");
        return Err(ModelError::malformed(WHAT, "metadata (configuration, provenance)", expected, found));
    }
    Ok(true)
}

fn entry<'a>(stored: &'a StoredTensors, key: &str, expected: &str) -> Result<&'a str, ModelError> {
    let found = stored.metadata.get(key).map(String::as_str);
    found.ok_or_else(|| ModelError::malformed(WHAT, format!("metadata {key}"), expected, "no such entry"))
}
