use std::path::PathBuf;

use atsplat_model::weights::Inspection;

use crate::embedded;
use crate::print::print_report;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Safetensors, or a PyTorch checkpoint.
    file: PathBuf,

    /// Print the name, type and shape of every tensor.
    #[arg(long)]
    tensors: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let file = embedded::find(&args.file, || embedded::or_a_file("a file of weights"))?;
    print_report(&Inspection::new(args.file.clone(), file, args.tensors)?, args.json)?;
    Ok(true)
}
