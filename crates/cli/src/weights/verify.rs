use std::path::PathBuf;

use atsplat_files::Sha256Digest;
use atsplat_model::ModelConfig;
use atsplat_model::weights::{ModelWeights, Verification};

use crate::embedded;
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

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let config = args.model.as_deref().map(ModelConfig::resolve).transpose()?;
    let expected = args.sha256.map(|hash| hash.to_string());
    let file = embedded::find(&args.file, || match &config {
        Some(config) => ModelWeights::advice(config, expected.as_deref()),
        None => embedded::or_a_file("a file of weights"),
    })?;
    print_report(&Verification::new(file, config.as_ref(), expected.as_deref())?, args.json)?;
    Ok(true)
}
