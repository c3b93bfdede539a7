use std::fmt;
use std::path::PathBuf;

use atsplat_files::Sha256Digest;
use serde::Serialize;

use super::backbone::backbone_of;
use super::{Backbone, KnownFile, ModelWeights, TensorFile};
use crate::ModelError;
use crate::config::{BackboneConfig, ModelConfig};

/// A complete file of weights. [`Display`](fmt::Display) prints what was verified.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Verification {
    file: PathBuf,
    sha256: Sha256Digest,
    /// Whether the hash was given, or is that of a published file.
    sha256_expected: bool,
    /// Description of the contents.
    what: String,
    /// Whether the metadata (configuration and provenance) are hashed. `None` for files without metadata.
    metadata_covered: Option<bool>,
    /// Number of parameters, all finite and of the right shape.
    parameters: usize,
    fits: Option<String>,
}

impl Verification {
    /// Checks a file: of this toolkit's, that all tensors are there, of the right shape, finite and match their hash, and
    /// that they fit `config`, if given; of others', that they are a complete DINOv2, the one of `config`.
    ///
    /// # Errors
    /// [`ModelError`] for anything that is wrong, or if the file's sha256 is not `expected_sha256`.
    pub fn new(
        file: TensorFile,
        config: Option<&ModelConfig>,
        expected_sha256: Option<Sha256Digest>,
    ) -> Result<Self, ModelError> {
        file.check_sha256(expected_sha256)?;
        let found = if ModelWeights::is_one(&file.stored) {
            of_this_toolkit(&file, config)?
        } else {
            let found = backbone(&file, config)?;
            (found.to_string(), found.parameters, None)
        };
        Ok(Self::of(file, found, config, expected_sha256))
    }

    /// The verification of a checkpoint of a training that was read completely: `what` it is, its weights, and whether its metadata
    /// are hashed. The weights must fit `config`, if given.
    ///
    /// # Errors
    /// [`ModelError`] if they do not, or if the file's sha256 is not `expected_sha256`.
    pub fn of_checkpoint(
        file: TensorFile,
        what: String,
        weights: ModelWeights,
        metadata_covered: bool,
        config: Option<&ModelConfig>,
        expected_sha256: Option<Sha256Digest>,
    ) -> Result<Self, ModelError> {
        file.check_sha256(expected_sha256)?;
        let found = (what, weights.tensors.tensors.len(), Some(metadata_covered));
        if let Some(config) = config {
            weights.for_network(config.clone()).map_err(|error| error.in_file(&file.path))?;
        }
        Ok(Self::of(file, found, config, expected_sha256))
    }

    fn of(file: TensorFile, found: Found, config: Option<&ModelConfig>, expected_sha256: Option<Sha256Digest>) -> Self {
        let (what, parameters, metadata_covered) = found;
        let known = KnownFile::with_sha256(file.sha256);
        Self {
            file: file.path,
            sha256: file.sha256,
            sha256_expected: expected_sha256.is_some() || known.is_some(),
            what: known.map_or(what.clone(), |known| format!("{what}; {}", known.what)),
            metadata_covered,
            parameters,
            fits: config.map(|config| config.name.clone()),
        }
    }
}

/// The description of a file, the number of parameters, and whether the metadata are hashed; `None` for files without metadata.
type Found = (String, usize, Option<bool>);

/// What a file of this toolkit contains.
fn of_this_toolkit(file: &TensorFile, config: Option<&ModelConfig>) -> Result<Found, ModelError> {
    let weights = ModelWeights::of_file(file)?;
    let (what, parameters) = (format!("weights of the model {}", weights.config.name), weights.tensors.tensors.len());
    let covered = weights.metadata_covered;
    if let Some(config) = config {
        weights.for_network(config.clone()).map_err(|error| error.in_file(&file.path))?;
    }
    Ok((what, parameters, Some(covered)))
}

/// The complete backbone in any other file; that of the model if one is given.
fn backbone(file: &TensorFile, config: Option<&ModelConfig>) -> Result<Backbone, ModelError> {
    let wrong = |expected: String, found: String| {
        Err(ModelError::malformed("weights", "file", expected, found).in_file(&file.path))
    };
    match config {
        Some(config) if matches!(config.backbone, BackboneConfig::DinoV2 { .. }) => {
            backbone_of(file, config)?;
        }
        Some(config) => {
            let expected = format!("a file of this toolkit, because the model {} has no DINOv2 backbone", config.name);
            return wrong(expected, "a file without its metadata".to_owned());
        }
        None => {}
    }
    match Backbone::in_file(&file.stored)? {
        Some(backbone) => Ok(backbone),
        None => wrong(
            "a file of this toolkit or a complete DINOv2".to_owned(),
            format!("{} other tensors; `atsplat weights inspect --tensors` lists them", file.stored.tensors.len()),
        ),
    }
}

impl fmt::Display for Verification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let expected =
            if self.sha256_expected { "as expected" } else { "not compared: no expected hash is known or given" };
        writeln!(f, "{}\nsha256 {}, {expected}", self.file.display(), self.sha256)?;
        let (what, parameters) = (&self.what, self.parameters);
        if self.metadata_covered == Some(false) {
            writeln!(f, "{what}; {parameters} parameters, as written, finite and of the right shape")?;
            writeln!(f, "configuration and provenance: no hash recorded, so they may have been edited")?;
        } else {
            writeln!(f, "complete: {what}; {parameters} parameters, finite and of the right shape")?;
        }
        match &self.fits {
            Some(model) => writeln!(f, "fits the model {model}"),
            None => Ok(()),
        }
    }
}
