use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use atsplat_model::weights::{KnownFile, ModelWeights, StoredTensor, TensorFile};
use serde::Serialize;

use super::backbone::Backbone;
use crate::output::print_report;
use crate::process::format_bytes;

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

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    file: PathBuf,
    sha256: String,
    tensors: usize,
    numbers: u64,
    bytes: u64,
    /// Number of tensors per type.
    types: BTreeMap<String, usize>,
    what: What,
    /// The published file with this hash, if any.
    known: Option<KnownRow>,
    metadata: BTreeMap<String, String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    list: Option<Vec<TensorRow>>,
}

#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
enum What {
    /// A weights file of this toolkit.
    Atsplat { model: String, hash: String },
    /// A broken weights file of this toolkit.
    Broken { fault: String },
    /// A backbone.
    Backbone(Backbone),
    /// Unknown tensors.
    Other,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct KnownRow {
    name: &'static str,
    what: &'static str,
    source: &'static str,
}

#[derive(Debug, Serialize)]
struct TensorRow {
    name: String,
    r#type: String,
    shape: Vec<usize>,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let file = crate::embedded::find(&args.file, || "a file of weights".to_owned())?;
    print_report(&Report::of(args, file)?, args.json)?;
    Ok(true)
}

impl Report {
    fn of(args: &Args, file: TensorFile) -> anyhow::Result<Self> {
        let TensorFile { sha256, stored, .. } = file;
        let what = if ModelWeights::is_one(&stored) {
            match ModelWeights::from_stored(&stored) {
                Ok(weights) => What::Atsplat { model: weights.config.name.clone(), hash: weights.config.hash()? },
                Err(error) => What::Broken { fault: error.to_string() },
            }
        } else {
            Backbone::in_file(&stored)?.map_or(What::Other, What::Backbone)
        };
        let mut types = BTreeMap::new();
        for tensor in stored.tensors.values() {
            *types.entry(tensor.dtype().to_string()).or_default() += 1;
        }
        let each = || stored.tensors.values();
        let row = |(name, tensor): (&String, &StoredTensor)| TensorRow {
            name: name.clone(),
            r#type: tensor.dtype().to_string(),
            shape: tensor.shape().to_vec(),
        };
        Ok(Self {
            file: args.file.clone(),
            tensors: stored.tensors.len(),
            numbers: each().map(|tensor| tensor.shape().iter().map(|&size| size as u64).product::<u64>()).sum(),
            bytes: each().map(|tensor| tensor.bytes().len() as u64).sum(),
            types,
            what,
            known: KnownFile::with_sha256(&sha256).map(|known| KnownRow {
                name: known.name,
                what: known.what,
                source: known.source,
            }),
            list: args.tensors.then(|| stored.tensors.iter().map(row).collect()),
            sha256,
            metadata: stored.metadata,
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let types: Vec<String> = self.types.iter().map(|(name, count)| format!("{count} {name}")).collect();
        writeln!(f, "file      {}", self.file.display())?;
        writeln!(f, "sha256    {}", self.sha256)?;
        match &self.what {
            What::Atsplat { model, hash } => writeln!(f, "what      weights of the model {model} (hash {hash})")?,
            What::Broken { fault } => writeln!(f, "what      BROKEN weights of this toolkit: {fault}")?,
            What::Backbone(backbone) => writeln!(f, "what      {backbone}")?,
            What::Other => writeln!(f, "what      unknown tensors")?,
        }
        if let Some(KnownRow { name, what, source }) = &self.known {
            writeln!(f, "known as  {name}: {what} (from {source})")?;
        }
        let (tensors, numbers, bytes) = (self.tensors, self.numbers, format_bytes(self.bytes));
        writeln!(f, "tensors   {tensors} ({}), {numbers} numbers, {bytes}", types.join(", "))?;
        // The configuration is long: only JSON has it.
        for (key, value) in self.metadata.iter().filter(|(_, value)| !value.contains('\n')) {
            writeln!(f, "          {key} = {value}")?;
        }
        for TensorRow { name, r#type, shape } in self.list.iter().flatten() {
            writeln!(f, "{name}  {type} {shape:?}")?;
        }
        Ok(())
    }
}
