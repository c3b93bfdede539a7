use atsplat_files::Sha256Digest;
use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_model::ModelConfig;
use atsplat_model::config::BackboneConfig;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ImportReport, KeyMap, KnownFile, ModelWeights, TensorFile, read_backbone};
use clap::Args;
use serde::Serialize;

use super::precision::PrecisionWord;
use crate::model_words::{is_toml, model};
use crate::output::{PendingFile, complain, print_report};

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// A checkpoint of PyTorch (.pt, .pth, .ckpt; read by an allow-list, never executed) or safetensors.
    file: PathBuf,

    /// Configuration of the network that the tensors are of: a name, or a path that ends in .toml.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: String,

    /// How the file's names become this toolkit's: identity, dinov2-official, dinov2-hugging-face, or a path that ends in
    /// .toml.
    #[arg(long, value_name = "NAME|FILE", default_value = "identity", value_parser = key_map)]
    key_map: String,

    /// DINOv2 weights, where FILE does not hold the frozen backbone.
    #[arg(long, value_name = "FILE")]
    backbone: Option<PathBuf>,

    /// sha256 that FILE must have.
    #[arg(long, value_name = "HEX")]
    sha256: Option<Sha256Digest>,

    /// sha256 that the backbone's file must have.
    #[arg(long, value_name = "HEX", requires = "backbone")]
    backbone_sha256: Option<Sha256Digest>,

    /// Weights file to write; it appears whole, or not at all. Without it, only the report is printed.
    #[arg(long, short, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Which numbers are stored; the network computes with f32.
    #[arg(long, value_name = "TYPE", default_value = "f32")]
    precision: PrecisionWord,

    /// What else is to be known of how the weights came to be, as `data=re10k`; kept in the file, and with every result.
    #[arg(long, value_name = "KEY=VALUE", value_parser = note)]
    note: Vec<(String, String)>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    file: PathBuf,
    sha256: String,
    model: String,
    complete: bool,
    #[serde(flatten)]
    found: ImportReport,
    backbone: Option<BackboneRow>,
    out: Option<PathBuf>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct BackboneRow {
    file: PathBuf,
    sha256: String,
    known: Option<&'static str>,
    matched: usize,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let config = ModelConfig::resolve(&words.model)?;
    let map = KeyMap::resolve(&words.key_map)?;
    if words.backbone.is_some() && !matches!(config.backbone, BackboneConfig::DinoV2 { .. }) {
        bail!("--backbone: the model {} has no DINOv2 backbone", config.name);
    }
    let out = words.out.as_deref().map(PendingFile::open).transpose()?;
    let source = TensorFile::find(&words.file, || "a checkpoint or safetensors to import".to_owned())?;
    source.check_sha256(words.sha256.map(|hash| hash.to_string()).as_deref())?;
    let backbone = match &words.backbone {
        Some(path) => {
            let asked = words.backbone_sha256.map(|hash| hash.to_string());
            Some(read_backbone(path, &config, asked.as_deref())?)
        }
        None => None,
    };
    let mut expected = parameters(&config);
    if backbone.is_some() {
        expected.retain(|parameter| parameter.trained);
    }
    let (mut tensors, found) = map.apply(&source.stored, &expected);
    let complete = found.is_complete();
    let lacks_backbone = found.missing.iter().any(|missing| missing.parameter.starts_with("backbone."));
    let row = words.backbone.clone().zip(backbone.as_ref()).map(|(file, backbone)| BackboneRow {
        file,
        sha256: backbone.sha256.clone(),
        known: backbone.known.map(|known| known.what),
        matched: backbone.report.matched.len(),
    });
    let mut report = Report {
        file: words.file.clone(),
        sha256: source.sha256,
        model: config.name.clone(),
        complete,
        found,
        backbone: row,
        out: None,
    };
    if !complete {
        print_report(&report, words.json)?;
        if lacks_backbone && let BackboneConfig::DinoV2 { .. } = config.backbone {
            complain(&format!("the backbone's weights go behind --backbone: {}", KnownFile::advice(&config.backbone)));
        }
        bail!("{} does not hold the model {}: nothing was written", words.file.display(), config.name);
    }
    if let Some(out) = out {
        let provenance = report.provenance(&words.note);
        tensors.tensors.extend(backbone.into_iter().flat_map(|backbone| backbone.tensors.tensors));
        let weights = ModelWeights::new(config, provenance, &tensors)?;
        let bytes = weights.to_stored(words.precision.into()).context("--precision")?.to_safetensors()?;
        out.finish(&bytes)?;
        report.out.clone_from(&words.out);
    }
    print_report(&report, words.json)?;
    Ok(true)
}

impl Report {
    /// What the file will say of itself; notes of the user's come last and win.
    fn provenance(&self, notes: &[(String, String)]) -> BTreeMap<String, String> {
        let name = self.file.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut known = BTreeMap::from([
            ("imported-by".to_owned(), format!("atsplat {}", env!("CARGO_PKG_VERSION"))),
            ("imported-from".to_owned(), name),
            ("imported-sha256".to_owned(), self.sha256.clone()),
            ("key-map".to_owned(), self.found.key_map.clone()),
        ]);
        if let Some(BackboneRow { sha256, known: what, .. }) = &self.backbone {
            known.insert("backbone-sha256".to_owned(), sha256.clone());
            known.insert("backbone".to_owned(), what.unwrap_or("of no hash that is known").to_owned());
        }
        known.extend(notes.iter().cloned());
        known
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} (sha256 {})\n{}", self.file.display(), self.sha256, self.found)?;
        if let Some(BackboneRow { file, sha256, known, matched }) = &self.backbone {
            let known = known.unwrap_or("a file of no hash that is known");
            writeln!(f, "backbone: {matched} parameters of {} (sha256 {sha256}): {known}", file.display())?;
        }
        match &self.out {
            Some(out) => writeln!(f, "the model {} into {}", self.model, out.display()),
            None if self.complete => writeln!(f, "whole: --out writes it"),
            None => Ok(()),
        }
    }
}

/// A key map's name, or the path of one.
pub(super) fn key_map(text: &str) -> Result<String, atsplat_model::ModelError> {
    if !is_toml(text) {
        KeyMap::resolve(text)?;
    }
    Ok(text.to_owned())
}

fn note(text: &str) -> Result<(String, String), String> {
    let pair = text.split_once('=').map(|(key, value)| (key.trim(), value.trim()));
    let pair = pair.filter(|(key, value)| !key.is_empty() && !value.is_empty());
    let (key, value) = pair.ok_or_else(|| format!("expected KEY=VALUE, found {text:?}"))?;
    Ok((key.to_owned(), value.to_owned()))
}
