use std::collections::BTreeMap;
use std::path::Path;

use super::{ImportReport, KeyMap, KnownFile, StoredTensors, TensorFile};
use crate::ModelError;
use crate::config::ModelConfig;
use crate::parameters::{Parameter, parameters};

const WHAT: &str = "ATSplat weights";
const FORMAT_KEY: &str = "atsplat.format";
const FORMAT: &str = "1";
const CONFIGURATION_KEY: &str = "atsplat.configuration";
const DIGEST_KEY: &str = "atsplat.tensors-sha256";
const PROVENANCE_PREFIX: &str = "atsplat.provenance.";

/// A network's weights with all that is needed to use and to trust them.
///
/// In a file they are safetensors whose metadata hold `atsplat.format`, `atsplat.configuration` (the TOML text),
/// `atsplat.tensors-sha256` ([`StoredTensors::digest`]) and `atsplat.provenance.<key>` for each entry of the
/// provenance. `NAMES.md` explains the tensors' names.
#[derive(Clone, Debug)]
pub struct ModelWeights {
    /// The network.
    pub config: ModelConfig,
    /// How the weights came to be: data, steps, seed, commit, command, and whatever else matters.
    pub provenance: BTreeMap<String, String>,
    /// Every parameter of the network, f32 or f16. Empty metadata.
    pub tensors: StoredTensors,
}

/// Which numbers a file stores.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// f32, as trained.
    Single,
    /// f16, half the size.
    Half,
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
        if let Some((name, tensor)) = report.left_over.first() {
            return Err(ModelError::malformed(WHAT, format!("tensor {name}"), "a parameter of the network", tensor));
        }
        Ok(Self { config, provenance, tensors })
    }

    /// Reads the toolkit's own file. Nothing is returned unless every tensor is there, of its shape, finite,
    /// and what was hashed when the file was written.
    ///
    /// # Errors
    /// [`ModelError::MissingWeights`] where there is no file, [`ModelError::InFile`] around the errors of
    /// [`Self::from_stored`].
    pub fn read(path: &Path) -> Result<Self, ModelError> {
        let file = open(path, || "a weights file of this toolkit".to_owned())?;
        Self::from_stored(&file.stored).map_err(|error| error.in_file(path))
    }

    /// What [`Self::to_stored`] gave.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where the metadata are not this toolkit's or the hash differs, and as
    /// [`Self::new`].
    pub fn from_stored(stored: &StoredTensors) -> Result<Self, ModelError> {
        let text = |key: &str, expected: &str| {
            let found = stored.metadata.get(key).map(String::as_str);
            found.ok_or_else(|| ModelError::malformed(WHAT, format!("metadata {key}"), expected, "no such entry"))
        };
        let format = text(FORMAT_KEY, "the format's version; other files are imported by a key map")?;
        if format != FORMAT {
            return Err(ModelError::malformed(WHAT, format!("metadata {FORMAT_KEY}"), FORMAT, format));
        }
        let config = ModelConfig::from_toml(text(CONFIGURATION_KEY, "a model configuration")?)?;
        let (digest, found) = (text(DIGEST_KEY, "a sha256")?, stored.digest());
        if digest != found {
            return Err(ModelError::malformed(WHAT, "tensors", format!("sha256 {digest}, as written"), found));
        }
        let provenance = stored
            .metadata
            .iter()
            .filter_map(|(key, value)| key.strip_prefix(PROVENANCE_PREFIX).map(|key| (key.to_owned(), value.clone())));
        Self::new(config, provenance.collect(), stored)
    }

    /// The contents of a file, which [`Self::from_stored`] takes back.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where a number does not fit f16.
    pub fn to_stored(&self, precision: Precision) -> Result<StoredTensors, ModelError> {
        let mut stored = StoredTensors::default();
        for (name, tensor) in &self.tensors.tensors {
            let tensor = match precision {
                Precision::Single => super::StoredTensor::from_f32(tensor.shape().to_vec(), &tensor.to_f32()?)?,
                Precision::Half => tensor.to_half()?,
            };
            stored.tensors.insert(name.clone(), tensor);
        }
        stored.metadata.insert(FORMAT_KEY.to_owned(), FORMAT.to_owned());
        stored.metadata.insert(CONFIGURATION_KEY.to_owned(), self.config.to_toml()?);
        stored.metadata.insert(DIGEST_KEY.to_owned(), stored.digest());
        for (key, value) in &self.provenance {
            stored.metadata.insert(format!("{PROVENANCE_PREFIX}{key}"), value.clone());
        }
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

/// The frozen backbone of a configuration, read from a published file.
#[derive(Clone, Debug)]
pub struct BackboneWeights {
    /// Parameters whose names begin with `backbone.`.
    pub tensors: StoredTensors,
    /// What became of the file's tensors.
    pub report: ImportReport,
    /// sha256 of the file, to be recorded with every result.
    pub sha256: String,
    /// What the file is, if its hash is known.
    pub known: Option<&'static KnownFile>,
}

/// Reads the frozen backbone from the authors' file or from Hugging Face's, told apart by the names in it.
///
/// # Errors
/// [`ModelError::MissingWeights`] with where to get them, [`ModelError::InFile`] around
/// [`ModelError::Unfit`], or around [`ModelError::Malformed`] where the file's sha256 is not `expected_sha256`.
pub fn read_backbone(
    path: &Path,
    config: &ModelConfig,
    expected_sha256: Option<&str>,
) -> Result<BackboneWeights, ModelError> {
    let file = open(path, || KnownFile::advice(&config.backbone))?;
    if let Some(expected) = expected_sha256.filter(|expected| !expected.eq_ignore_ascii_case(&file.sha256)) {
        let expected = format!("sha256 {expected}");
        return Err(ModelError::malformed("weights", "file", expected, &file.sha256).in_file(path));
    }
    let expected: Vec<Parameter> = parameters(config).into_iter().filter(|parameter| !parameter.trained).collect();
    let maps = ["dinov2-official", "dinov2-hugging-face"].map(KeyMap::resolve);
    let mut best: Option<(StoredTensors, ImportReport)> = None;
    for map in maps {
        let outcome = map?.apply(&file.stored, &expected);
        // Of two maps that fail, the one that knows more of the file's names has the better report.
        if best.as_ref().is_none_or(|(_, report)| report.missing.len() > outcome.1.missing.len()) {
            best = Some(outcome);
        }
    }
    match best {
        Some((tensors, report)) if report.is_complete() => {
            let known = KnownFile::with_sha256(&file.sha256);
            Ok(BackboneWeights { tensors, report, sha256: file.sha256, known })
        }
        best => {
            let report = best.map(|(_, report)| report).unwrap_or_default();
            Err(ModelError::Unfit(Box::new(report)).in_file(path))
        }
    }
}

fn open(path: &Path, expected: impl FnOnce() -> String) -> Result<TensorFile, ModelError> {
    TensorFile::open(path).map_err(|error| match error {
        ModelError::Io { ref source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
            ModelError::MissingWeights { expected: expected(), path: path.to_owned() }
        }
        other => other,
    })
}
