use std::fmt;
use std::path::PathBuf;

use anyhow::ensure;
use atsplat_model::weights::{KeyMap, ModelWeights};
use serde::Serialize;

use super::import::key_map;
use crate::embedded;
use crate::output_lock::OutputFiles;
use crate::overwrite::{Input, check_output};
use crate::paths::PendingFile;
use crate::print::print_report;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A weights file of this toolkit.
    file: PathBuf,

    /// The key map with which `weights import` reads the result; it is applied in reverse.
    #[arg(long, value_name = "NAME|FILE", value_parser = key_map)]
    key_map: String,

    /// Only tensors whose names in FILE start with this prefix, such as `backbone.`.
    #[arg(long, value_name = "PREFIX", default_value = "")]
    only: String,

    /// Safetensors file to write.
    #[arg(long, short, value_name = "FILE")]
    out: PathBuf,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    file: PathBuf,
    key_map: String,
    parameters: usize,
    tensors: usize,
    out: PathBuf,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let inputs = [Input::File("weights file", &args.file), Input::Toml("key map", &args.key_map)];
    check_output("--out", &args.out, &inputs)?;
    let map = KeyMap::resolve(&args.key_map)?;
    let _outputs = OutputFiles::of([args.out.as_path()])?;
    let out = PendingFile::open(&args.out)?;
    let source = embedded::find(&args.file, || embedded::or_a_file("a weights file of this toolkit"))?;
    let mut weights = ModelWeights::of_file(&source)?;
    weights.tensors.tensors.retain(|name, _| name.starts_with(&args.only));
    let (file, only) = (args.file.display(), &args.only);
    ensure!(!weights.tensors.tensors.is_empty(), "--only {only}: {file} has no tensor whose name starts with it");
    let exported = map.export(&weights.tensors)?;
    out.finish(&exported.to_safetensors()?)?;
    let report = Report {
        file: args.file.clone(),
        key_map: args.key_map.clone(),
        parameters: weights.tensors.tensors.len(),
        tensors: exported.tensors.len(),
        out: args.out.clone(),
    };
    print_report(&report, args.json)
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { key_map, parameters, tensors, out, .. } = self;
        writeln!(f, "{parameters} parameters into {tensors} tensors by key map {key_map}, in {}", out.display())
    }
}
