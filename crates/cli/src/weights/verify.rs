use std::fmt;
use std::path::PathBuf;

use anyhow::bail;
use atsplat_files::Sha256Digest;
use atsplat_model::ModelConfig;
use atsplat_model::config::BackboneConfig;
use atsplat_model::weights::{Backbone, KnownFile, ModelWeights, TensorFile, read_backbone};
use serde::Serialize;

use crate::model_args::model;
use crate::output::print_report;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A weights file of this toolkit, or DINOv2's.
    file: PathBuf,

    /// Expected sha256 of the file.
    #[arg(long, value_name = "HEX")]
    sha256: Option<Sha256Digest>,

    /// Configuration that the weights must fit: a name, or a path that ends in .toml. DINOv2 weights must fit its backbone.
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

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let config = args.model.as_deref().map(ModelConfig::resolve).transpose()?;
    let expected = args.sha256.map(|hash| hash.to_string());
    let file = crate::embedded::find(&args.file, || match &config {
        Some(config) => ModelWeights::advice(config, expected.as_deref()),
        None => "a file of weights".to_owned(),
    })?;
    file.check_sha256(expected.as_deref())?;
    let (what, parameters, metadata_covered) = if ModelWeights::is_one(&file.stored) {
        let (what, parameters, covered) = own(&file, config.as_ref())?;
        (what, parameters, Some(covered))
    } else {
        let (what, parameters) = backbone(args, &file, config.as_ref())?;
        (what, parameters, None)
    };
    let known = KnownFile::with_sha256(&file.sha256);
    let report = Report {
        file: args.file.clone(),
        sha256_expected: args.sha256.is_some() || known.is_some(),
        sha256: file.sha256,
        what: known.map_or(what.clone(), |known| format!("{what}; {}", known.what)),
        metadata_covered,
        parameters,
        fits: config.map(|config| config.name),
    };
    print_report(&report, args.json)?;
    Ok(true)
}

/// Checks a weights file of this toolkit: all tensors present, of the right shape, finite, and matching their hash. Returns
/// its description, the number of parameters, and whether the metadata are hashed, too.
fn own(file: &TensorFile, config: Option<&ModelConfig>) -> anyhow::Result<(String, usize, bool)> {
    let weights = ModelWeights::of_file(file)?;
    let (what, parameters) = (format!("weights of the model {}", weights.config.name), weights.tensors.tensors.len());
    let covered = weights.metadata_covered;
    if let Some(config) = config {
        weights.for_network(config.clone()).map_err(|error| error.in_file(&file.path))?;
    }
    Ok((what, parameters, covered))
}

/// Checks any other file: a complete backbone, that of the model if one is given.
fn backbone(args: &Args, file: &TensorFile, config: Option<&ModelConfig>) -> anyhow::Result<(String, usize)> {
    match config {
        Some(config) if matches!(config.backbone, BackboneConfig::DinoV2 { .. }) => {
            read_backbone(&args.file, config, None)?;
        }
        Some(config) => bail!(
            "weights: expected a file of this toolkit, because the model {} has no DINOv2 backbone, found one without its \
             metadata ({})",
            config.name,
            args.file.display()
        ),
        None => {}
    }
    let Some(backbone) = Backbone::in_file(&file.stored)? else {
        bail!(
            "weights: expected a file of this toolkit or a complete DINOv2, found {} other tensors; `atsplat weights \
             inspect --tensors` lists them ({})",
            file.stored.tensors.len(),
            args.file.display()
        )
    };
    Ok((backbone.to_string(), backbone.parameters))
}

impl fmt::Display for Report {
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
