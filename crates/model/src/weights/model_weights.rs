use std::collections::BTreeMap;
use std::path::Path;

use sha2::{Digest as _, Sha256};

use super::{KeyMap, KnownFile, LeftOver, StoredTensors, TensorFile};
use crate::ModelError;
use crate::config::{BackboneConfig, ModelConfig};
use crate::parameters::parameters;

const WHAT: &str = "ATSplat weights";
const FORMAT_KEY: &str = "atsplat.format";
/// What is written: the metadata have a hash too.
const FORMAT: &str = "2";
/// Files of earlier versions, whose metadata nothing covers.
const BARE_FORMAT: &str = "1";
const CONFIGURATION_KEY: &str = "atsplat.configuration";
const DIGEST_KEY: &str = "atsplat.tensors-sha256";
const METADATA_DIGEST_KEY: &str = "atsplat.metadata-sha256";
const PROVENANCE_PREFIX: &str = "atsplat.provenance.";

/// A network's weights with all that is needed to use and to trust them.
///
/// In a file they are safetensors whose metadata hold `atsplat.format`, `atsplat.configuration` (the TOML text),
/// `atsplat.tensors-sha256` ([`StoredTensors::digest`]), `atsplat.provenance.<key>` for each entry of the provenance, and
/// `atsplat.metadata-sha256` over all of these. `NAMES.md` explains the tensors' names.
#[derive(Clone, Debug)]
pub struct ModelWeights {
    /// The network.
    pub config: ModelConfig,
    /// How the weights came to be: data, steps, seed, commit, command, and whatever else matters.
    pub provenance: BTreeMap<String, String>,
    /// Every parameter of the network, in the element types of the file. Empty metadata.
    pub tensors: StoredTensors,
    /// sha256 of the file that they were read from, in hexadecimal; none where they were not.
    pub sha256: Option<String>,
    /// Whether configuration and provenance are known to be those that were written: `false` for files of a format that
    /// kept no hash of them.
    pub metadata_covered: bool,
}

/// Which numbers a file stores.
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
    /// Takes tensors that are exactly the network's parameters.
    ///
    /// # Errors
    /// [`ModelError::Unfit`] where one is missing, of another shape, or not finite; [`ModelError::Malformed`]
    /// where one is no parameter.
    pub fn new(
        config: ModelConfig,
        provenance: BTreeMap<String, String>,
        stored: &StoredTensors,
    ) -> Result<Self, ModelError> {
        let (tensors, report) = KeyMap::identity().import(stored, &parameters(&config))?;
        if let Some(LeftOver { tensor, found }) = report.left_over.first() {
            return Err(ModelError::malformed(WHAT, format!("tensor {tensor}"), "a parameter of the network", found));
        }
        Ok(Self { config, provenance, tensors, sha256: None, metadata_covered: true })
    }

    /// Reads the toolkit's own file. Nothing is returned unless every tensor is there, of its shape, finite,
    /// and what was hashed when the file was written.
    ///
    /// # Errors
    /// [`ModelError::MissingWeights`] where there is no file, [`ModelError::InFile`] around the errors of
    /// [`Self::from_stored`].
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let expected =
            "a weights file of this toolkit, which `atsplat weights import` makes of a checkpoint of PyTorch";
        Self::of_file(&TensorFile::find(path, || expected.to_owned())?)
    }

    /// [`Self::read`], of a file that is open already.
    ///
    /// # Errors
    /// [`ModelError::InFile`] around the errors of [`Self::from_stored`].
    pub fn of_file(file: &TensorFile) -> Result<Self, ModelError> {
        let weights = Self::from_stored(&file.stored).map_err(|error| error.in_file(&file.path))?;
        Ok(Self { sha256: Some(file.sha256.clone()), ..weights })
    }

    /// Whether a file says that it is one of this toolkit.
    pub fn is_one(stored: &StoredTensors) -> bool {
        stored.metadata.contains_key(FORMAT_KEY)
    }

    /// The configuration that a file says it was written for; its tensors are not looked at.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where the metadata are not this toolkit's, or hold no configuration.
    pub fn config_of(stored: &StoredTensors) -> Result<ModelConfig, ModelError> {
        format_of(stored)?;
        ModelConfig::from_toml(entry(stored, CONFIGURATION_KEY, "a model configuration")?)
    }

    /// What to tell a user who lacks the weights of a network, and their hash where one is known.
    pub fn advice(config: &ModelConfig, sha256: Option<&str>) -> String {
        let hash = sha256.map_or_else(String::new, |hash| format!(" of sha256 {hash}"));
        let name = &config.name;
        let mut text = format!(
            "a weights file{hash} of the model {name}, which `atsplat weights import CHECKPOINT --model {name}` makes of \
             a checkpoint of PyTorch"
        );
        if let BackboneConfig::DinoV2 { .. } = config.backbone {
            text.push_str("; its frozen backbone is ");
            text.push_str(&KnownFile::advice(&config.backbone));
        }
        text
    }

    /// The same numbers as weights of another network, whose parameters have to be the very same ones.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn for_network(self, config: ModelConfig) -> Result<Self, ModelError> {
        let Self { sha256, metadata_covered, .. } = self;
        Ok(Self { sha256, metadata_covered, ..Self::new(config, self.provenance, &self.tensors)? })
    }

    /// What [`Self::to_stored`] gave.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where the metadata are not this toolkit's or the hash differs, and as
    /// [`Self::new`].
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

    /// The contents of a file, which [`Self::from_stored`] takes back.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where a number is beyond the precision's range.
    pub fn to_stored(&self, precision: Precision) -> Result<StoredTensors, ModelError> {
        let mut stored = StoredTensors::default();
        for (name, tensor) in &self.tensors.tensors {
            let tensor = match precision {
                Precision::Single => super::StoredTensor::from_f32(tensor.shape().to_vec(), &tensor.to_f32()?)?,
                Precision::Half => tensor.to_half()?,
                Precision::Brain => tensor.to_brain()?,
            };
            stored.tensors.insert(name.clone(), tensor);
        }
        stored.metadata.insert(FORMAT_KEY.to_owned(), FORMAT.to_owned());
        stored.metadata.insert(CONFIGURATION_KEY.to_owned(), self.config.to_toml()?);
        stored.metadata.insert(DIGEST_KEY.to_owned(), stored.digest());
        for (key, value) in &self.provenance {
            stored.metadata.insert(format!("{PROVENANCE_PREFIX}{key}"), value.clone());
        }
        stored.metadata.insert(METADATA_DIGEST_KEY.to_owned(), metadata_digest(stored.metadata.iter()));
        Ok(stored)
    }

    /// Writes a file; it appears whole under its name, or not at all, and the same weights give the same bytes.
    ///
    /// # Errors
    /// [`ModelError::Io`], and as [`Self::to_stored`].
    pub fn write(&self, path: &Path, precision: Precision) -> Result<(), ModelError> {
        self.to_stored(precision)?.write(path)
    }
}

/// The version of a file's format, which is one that is read.
fn format_of(stored: &StoredTensors) -> Result<&str, ModelError> {
    let format = entry(stored, FORMAT_KEY, "the format's version; other files are imported by a key map")?;
    if [BARE_FORMAT, FORMAT].contains(&format) {
        return Ok(format);
    }
    let expected = format!("{BARE_FORMAT} or {FORMAT}");
    Err(ModelError::malformed(WHAT, format!("metadata {FORMAT_KEY}"), expected, format))
}

/// Whether a hash covers the metadata; an error where it is that of others, or is missing from a file that should have one.
fn check_metadata(stored: &StoredTensors) -> Result<bool, ModelError> {
    let format = format_of(stored)?;
    let Some(recorded) = stored.metadata.get(METADATA_DIGEST_KEY) else {
        if format == BARE_FORMAT {
            return Ok(false);
        }
        return entry(stored, METADATA_DIGEST_KEY, "the hash of the metadata").map(|_| true);
    };
    let found = metadata_digest(stored.metadata.iter().filter(|(key, _)| *key != METADATA_DIGEST_KEY));
    if *recorded != found {
        let expected = format!("sha256 {recorded}, as written");
        return Err(ModelError::malformed(WHAT, "metadata (configuration, provenance)", expected, found));
    }
    Ok(true)
}

/// sha256 in hexadecimal of keys and values in the order of keys, each after its length in bytes as u64 little-endian.
fn metadata_digest<'a>(metadata: impl Iterator<Item = (&'a String, &'a String)>) -> String {
    let mut hash = Sha256::new();
    for text in metadata.flat_map(|(key, value)| [key, value]) {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    }
    atsplat_files::hexadecimal(&hash.finalize())
}

fn entry<'a>(stored: &'a StoredTensors, key: &str, expected: &str) -> Result<&'a str, ModelError> {
    let found = stored.metadata.get(key).map(String::as_str);
    found.ok_or_else(|| ModelError::malformed(WHAT, format!("metadata {key}"), expected, "no such entry"))
}
