use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use atsplat_files::Sha256Digest;
use atsplat_numeric::format_bytes;
use serde::Serialize;

use super::{KnownFile, ModelWeights, StoredTensor, StoredTensors, TensorFile};
use crate::ModelError;
use crate::config::{BackboneConfig, DinoSize};

/// The contents of any file of tensors, valid or not. [`Display`](fmt::Display) prints them.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Inspection {
    file: PathBuf,
    sha256: Sha256Digest,
    tensors: usize,
    numbers: u64,
    bytes: u64,
    /// Number of tensors per type.
    types: BTreeMap<String, usize>,
    what: Contents,
    /// The published file with this hash, if any.
    known: Option<KnownRow>,
    metadata: BTreeMap<String, String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    list: Option<Vec<TensorRow>>,
}

#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
enum Contents {
    /// A weights file of this toolkit.
    Atsplat { model: String, hash: String },
    /// A broken weights file of this toolkit.
    Broken { fault: String },
    /// A checkpoint of a training.
    Checkpoint { description: String },
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

impl Inspection {
    /// Describes a file, with all tensors if `list_tensors` is set.
    ///
    /// # Errors
    /// [`ModelError`] if a configuration or key map cannot be read.
    pub fn new(path: PathBuf, file: TensorFile, list_tensors: bool) -> Result<Self, ModelError> {
        let TensorFile { sha256, stored, .. } = file;
        let what = if ModelWeights::is_one(&stored) {
            match ModelWeights::from_stored(&stored) {
                Ok(weights) => Contents::Atsplat { model: weights.config.name.clone(), hash: weights.config.hash()? },
                Err(error) => Contents::Broken { fault: error.to_string() },
            }
        } else {
            Backbone::in_file(&stored)?.map_or(Contents::Other, Contents::Backbone)
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
            file: path,
            tensors: stored.tensors.len(),
            numbers: each().map(|tensor| tensor.shape().iter().map(|&size| size as u64).product::<u64>()).sum(),
            bytes: each().map(|tensor| tensor.bytes().len() as u64).sum(),
            types,
            what,
            known: KnownFile::with_sha256(sha256).map(|known| KnownRow {
                name: known.name,
                what: known.what,
                source: known.source,
            }),
            list: list_tensors.then(|| stored.tensors.iter().map(row).collect()),
            sha256,
            metadata: stored.metadata,
        })
    }

    /// The same of a checkpoint of a training, with what it is.
    #[must_use]
    pub fn of_checkpoint(self, description: String) -> Self {
        Self { what: Contents::Checkpoint { description }, ..self }
    }
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let types: Vec<String> = self.types.iter().map(|(name, count)| format!("{count} {name}")).collect();
        writeln!(f, "file      {}", self.file.display())?;
        writeln!(f, "sha256    {}", self.sha256)?;
        match &self.what {
            Contents::Atsplat { model, hash } => writeln!(f, "what      weights of the model {model} (hash {hash})")?,
            Contents::Broken { fault } => writeln!(f, "what      BROKEN weights of this toolkit: {fault}")?,
            Contents::Checkpoint { description } => writeln!(f, "what      {description}")?,
            Contents::Backbone(backbone) => writeln!(f, "what      {backbone}")?,
            Contents::Other => writeln!(f, "what      unknown tensors")?,
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

/// A published network that a file contains completely.
#[derive(Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Backbone {
    size: DinoSize,
    registers: bool,
    key_map: String,
    /// Number of the network's parameters in the file.
    pub parameters: usize,
    /// Number of other tensors in the file.
    left_over: usize,
}

impl Backbone {
    /// Detects a backbone by tensor names and shapes.
    ///
    /// # Errors
    /// [`ModelError`] if a built-in key map cannot be read.
    pub fn in_file(stored: &StoredTensors) -> Result<Option<Self>, ModelError> {
        let found = BackboneConfig::in_file(stored)?;
        Ok(found.and_then(|(backbone, report)| match backbone {
            BackboneConfig::DinoV2 { size, registers } => {
                let (parameters, left_over) = (report.matched.len(), report.left_over.len());
                Some(Self { size, registers, key_map: report.key_map, parameters, left_over })
            }
            BackboneConfig::Patch { .. } => None,
        }))
    }
}

impl fmt::Display for Backbone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = match self.size {
            DinoSize::Tiny => "the tests' tiny size",
            DinoSize::Small => "ViT-S/14",
            DinoSize::Base => "ViT-B/14",
            DinoSize::Large => "ViT-L/14",
        };
        let registers = if self.registers { "with" } else { "without" };
        write!(f, "shape of DINOv2 {size} {registers} registers, by key map {}", self.key_map)
    }
}
