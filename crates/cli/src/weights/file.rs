//! Files of weights: found, hashed, and what to tell of those that are not there.

use std::path::Path;

use anyhow::bail;
use atsplat_model::config::BackboneConfig;
use atsplat_model::weights::{KnownFile, TensorFile};
use atsplat_model::{ModelConfig, ModelError};
use atsplat_protocol::Sha256Digest;

/// Metadata by which the toolkit's own files are told from others.
pub(crate) const FORMAT_KEY: &str = "atsplat.format";

/// Maps and hashes a file; nothing in it is trusted yet.
pub(crate) fn open(path: &Path, expected: impl FnOnce() -> String) -> Result<TensorFile, ModelError> {
    TensorFile::open(path).map_err(|error| match error {
        ModelError::Io { ref source, .. } if source.kind() == std::io::ErrorKind::NotFound => {
            ModelError::MissingWeights { expected: expected(), path: path.to_owned() }
        }
        other => other,
    })
}

/// Refuses a file of another hash than the one that was asked for.
pub(crate) fn check_sha256(path: &Path, file: &TensorFile, asked: Option<&Sha256Digest>) -> anyhow::Result<()> {
    match asked.map(ToString::to_string) {
        Some(asked) if asked != file.sha256 => {
            bail!("weights: expected a file of sha256 {asked}, found {} ({})", file.sha256, path.display())
        }
        _ => Ok(()),
    }
}

/// What a user who lacks the weights of a network should know.
pub(crate) fn advice(config: &ModelConfig, sha256: Option<&Sha256Digest>) -> String {
    let hash = sha256.map_or_else(String::new, |hash| format!(" of sha256 {hash}"));
    let name = &config.name;
    let mut text = format!(
        "a weights file{hash} of the model {name}, which `atsplat weights import CHECKPOINT --model {name}` makes of a \
         checkpoint of PyTorch"
    );
    if let BackboneConfig::DinoV2 { .. } = config.backbone {
        text.push_str("; its frozen backbone is ");
        text.push_str(&KnownFile::advice(&config.backbone));
    }
    text.push_str("; `random:SEED` in place of a file runs the network untrained");
    text
}

/// The configuration that a file of this toolkit says it was written for; its tensors are not looked at.
pub(crate) fn config(path: &Path, file: &TensorFile) -> anyhow::Result<ModelConfig> {
    let text = |key: &str| file.stored.metadata.get(key);
    match (text(FORMAT_KEY), text("atsplat.configuration")) {
        (Some(_), Some(text)) => Ok(ModelConfig::from_toml(text).map_err(|error| in_file(path, error))?),
        _ => bail!(
            "weights: expected a file of this toolkit, found {} tensors without its metadata: `atsplat weights import {} \
             --model NAME --out FILE` makes one ({})",
            file.stored.tensors.len(),
            path.display(),
            path.display()
        ),
    }
}

/// The error, with the file that it is in.
pub(crate) fn in_file(path: &Path, error: ModelError) -> ModelError {
    ModelError::InFile { path: path.to_owned(), source: Box::new(error) }
}
