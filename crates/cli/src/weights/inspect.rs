use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use atsplat_model::weights::{KnownFile, ModelWeights, StoredTensor, TensorFile};
use clap::Args;
use serde::Serialize;

use super::backbone::Backbone;
use crate::memory::for_people;
use crate::output::print_report;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Safetensors, or a checkpoint of PyTorch.
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
    /// How many tensors are of each type.
    types: BTreeMap<String, usize>,
    what: What,
    /// What the file is, if its hash is known.
    known: Option<KnownRow>,
    metadata: BTreeMap<String, String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    list: Option<Vec<TensorRow>>,
}

#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
enum What {
    /// The toolkit's own file.
    Atsplat { model: String, hash: String },
    /// The toolkit's own file, and something is wrong with it.
    Broken { fault: String },
    /// A backbone.
    Backbone(Backbone),
    /// Tensors of which nothing is known.
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

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let file = crate::carried::find(&words.file, || "a file of weights".to_owned())?;
    print_report(&Report::of(words, file)?, words.json)?;
    Ok(true)
}

impl Report {
    fn of(words: &Words, file: TensorFile) -> anyhow::Result<Self> {
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
            file: words.file.clone(),
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
            list: words.tensors.then(|| stored.tensors.iter().map(row).collect()),
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
            What::Other => writeln!(f, "what      tensors of nothing that is known")?,
        }
        if let Some(KnownRow { name, what, source }) = &self.known {
            writeln!(f, "known as  {name}: {what} (from {source})")?;
        }
        let (tensors, numbers, bytes) = (self.tensors, self.numbers, for_people(self.bytes));
        writeln!(f, "tensors   {tensors} ({}), {numbers} numbers, {bytes}", types.join(", "))?;
        // A configuration is a page of its own: JSON has it.
        for (key, value) in self.metadata.iter().filter(|(_, value)| !value.contains('\n')) {
            writeln!(f, "          {key} = {value}")?;
        }
        for TensorRow { name, r#type, shape } in self.list.iter().flatten() {
            writeln!(f, "{name}  {type} {shape:?}")?;
        }
        Ok(())
    }
}
