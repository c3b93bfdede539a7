use atsplat_files::Sha256Digest;
use std::fmt;
use std::path::PathBuf;

use anyhow::bail;
use atsplat_model::ModelConfig;
use atsplat_model::config::BackboneConfig;
use atsplat_model::weights::{KnownFile, ModelWeights, TensorFile, read_backbone};
use clap::Args;
use serde::Serialize;

use super::backbone::Backbone;
use crate::model_words::model;
use crate::output::print_report;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// A weights file of this toolkit, or DINOv2's.
    file: PathBuf,

    /// sha256 that the file must have.
    #[arg(long, value_name = "HEX")]
    sha256: Option<Sha256Digest>,

    /// Configuration that the weights must fit: a name, or a path that ends in .toml. DINOv2's weights must be those of its
    /// backbone.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: Option<String>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    file: PathBuf,
    sha256: String,
    /// Whether that was asked for, or is the hash of a published file.
    sha256_expected: bool,
    /// What is whole.
    what: String,
    /// Whether a hash covers the metadata: configuration and provenance. `None` for files without such metadata.
    metadata_covered: Option<bool>,
    /// Parameters that were found, finite and of their shape.
    parameters: usize,
    fits: Option<String>,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let config = words.model.as_deref().map(ModelConfig::resolve).transpose()?;
    let asked = words.sha256.map(|hash| hash.to_string());
    let file = crate::carried::find(&words.file, || match &config {
        Some(config) => ModelWeights::advice(config, asked.as_deref()),
        None => "a file of weights".to_owned(),
    })?;
    file.check_sha256(asked.as_deref())?;
    let (what, parameters, metadata_covered) = if ModelWeights::is_one(&file.stored) {
        let (what, parameters, covered) = own(&file, config.as_ref())?;
        (what, parameters, Some(covered))
    } else {
        let (what, parameters) = backbone(words, &file, config.as_ref())?;
        (what, parameters, None)
    };
    let known = KnownFile::with_sha256(&file.sha256);
    let report = Report {
        file: words.file.clone(),
        sha256_expected: words.sha256.is_some() || known.is_some(),
        sha256: file.sha256,
        what: known.map_or(what.clone(), |known| format!("{what}; {}", known.what)),
        metadata_covered,
        parameters,
        fits: config.map(|config| config.name),
    };
    print_report(&report, words.json)?;
    Ok(true)
}

/// The toolkit's own: every tensor is there, of its shape, finite, and what was hashed when the file was written; and whether
/// the metadata were hashed too.
fn own(file: &TensorFile, config: Option<&ModelConfig>) -> anyhow::Result<(String, usize, bool)> {
    let weights = ModelWeights::of_file(file)?;
    let (what, parameters) = (format!("weights of the model {}", weights.config.name), weights.tensors.tensors.len());
    let covered = weights.metadata_covered;
    if let Some(config) = config {
        weights.for_network(config.clone()).map_err(|error| error.in_file(&file.path))?;
    }
    Ok((what, parameters, covered))
}

/// Somebody else's: a whole backbone, of the model's where one was asked for.
fn backbone(words: &Words, file: &TensorFile, config: Option<&ModelConfig>) -> anyhow::Result<(String, usize)> {
    match config {
        Some(config) if matches!(config.backbone, BackboneConfig::DinoV2 { .. }) => {
            read_backbone(&words.file, config, None)?;
        }
        Some(config) => bail!(
            "weights: expected a file of this toolkit, since the model {} has no DINOv2 backbone, found one without its \
             metadata ({})",
            config.name,
            words.file.display()
        ),
        None => {}
    }
    let Some(backbone) = Backbone::in_file(&file.stored)? else {
        bail!(
            "weights: expected a file of this toolkit or a whole DINOv2, found {} tensors of neither; `atsplat weights \
             inspect --tensors` lists them ({})",
            file.stored.tensors.len(),
            words.file.display()
        )
    };
    Ok((backbone.to_string(), backbone.parameters))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let expected =
            if self.sha256_expected { "as expected" } else { "not compared: none is known, and none was given" };
        writeln!(f, "{}\nsha256 {}, {expected}", self.file.display(), self.sha256)?;
        let (what, parameters) = (&self.what, self.parameters);
        if self.metadata_covered == Some(false) {
            writeln!(f, "{what}; {parameters} parameters, as they were written, finite and of their shape")?;
            writeln!(f, "configuration and provenance: no hash recorded, so that they may have been edited")?;
        } else {
            writeln!(f, "whole: {what}; {parameters} parameters, finite and of their shape")?;
        }
        match &self.fits {
            Some(model) => writeln!(f, "fits the model {model}"),
            None => Ok(()),
        }
    }
}
