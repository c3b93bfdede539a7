use std::path::PathBuf;

use anyhow::Context as _;
use atsplat_files::Sha256Digest;
use atsplat_model::ModelConfig;
use atsplat_model::weights::{ModelWeights, TensorFile, Verification};
use atsplat_train::CheckpointFile;

use crate::embedded;
use crate::model_args::model;
use crate::print::print_report;
use crate::reconstruct::network::same_network;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A weights file of this toolkit, a checkpoint of its training, or DINOv2's.
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

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let config = args.model.as_deref().map(ModelConfig::resolve).transpose()?;
    let file = embedded::find(&args.file, || match &config {
        Some(config) => ModelWeights::advice(config, args.sha256),
        None => embedded::or_a_file("a file of weights"),
    })?;
    if CheckpointFile::is_one(&file.stored) {
        return print_report(&of_checkpoint(file, config.as_ref(), args.sha256)?, args.json);
    }
    // A configuration that cannot be read is an error of the verification.
    let stored = ModelWeights::is_one(&file.stored).then(|| ModelWeights::config_of(&file.stored));
    let written_for = stored.and_then(Result::ok);
    let verification = Verification::new(file, config.as_ref(), args.sha256)?;
    if let Some((requested, written_for)) = config.as_ref().zip(written_for.as_ref()) {
        same_network(requested, written_for).context("--model")?;
    }
    print_report(&verification, args.json)
}

fn of_checkpoint(
    file: TensorFile,
    config: Option<&ModelConfig>,
    expected_sha256: Option<Sha256Digest>,
) -> anyhow::Result<Verification> {
    file.check_sha256(expected_sha256)?;
    let checkpoint = CheckpointFile::read(&file)?;
    if let Some(requested) = config {
        same_network(requested, &checkpoint.weights.config).context("--model")?;
    }
    let what = checkpoint.to_string();
    let CheckpointFile { weights, metadata_covered, .. } = checkpoint;
    Ok(Verification::of_checkpoint(file, what, weights, metadata_covered, config, expected_sha256)?)
}
