use std::path::PathBuf;

use atsplat_model::weights::Inspection;
use atsplat_train::CheckpointFile;

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

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let file = embedded::find(&args.file, || embedded::or_a_file("a file of weights"))?;
    let checkpoint = CheckpointFile::is_one(&file.stored).then(|| match CheckpointFile::read(&file) {
        Ok(checkpoint) => checkpoint.to_string(),
        Err(error) => format!("a training checkpoint that cannot be read: {error}"),
    });
    let inspection = Inspection::new(args.file.clone(), file, args.tensors)?;
    let inspection = match checkpoint {
        Some(description) => inspection.of_checkpoint(description),
        None => inspection,
    };
    print_report(&inspection, args.json)
}
