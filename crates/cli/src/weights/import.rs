use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{Context as _, bail, ensure};
use atsplat_files::Sha256Digest;
use atsplat_model::ModelConfig;
use atsplat_model::config::BackboneConfig;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{
    ImportedBackbone, ImportedFile, KeyMap, KnownFile, ModelWeights, Precision, StoredTensors, TensorFile,
    read_backbone, training_data,
};
use atsplat_train::CheckpointFile;

use crate::model_args::model;
use crate::output_lock::OutputFiles;
use crate::overwrite::{Input, check_output};
use crate::parse::{name_or_path, named, once, usage_error};
use crate::paths::PendingFile;
use crate::print::{print_report, print_status};
use crate::reconstruct::network::same_network;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// PyTorch checkpoint (.pt, .pth, .ckpt; read by an allow-list, never executed) or safetensors. Of a checkpoint of `atsplat
    /// train`, the weights are imported, averaged if its run averages them.
    file: PathBuf,

    /// Configuration of the network: a name, or a path that ends in .toml. Files of this toolkit contain theirs.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: Option<String>,

    /// Key map from the file's tensor names to this toolkit's: identity, dinov2-official, dinov2-hugging-face, or a path that ends in
    /// .toml.
    #[arg(long, value_name = "NAME|FILE", default_value = "identity", value_parser = key_map)]
    key_map: String,

    /// DINOv2 weights, if FILE does not include the frozen backbone.
    #[arg(long, value_name = "FILE")]
    backbone: Option<PathBuf>,

    /// Expected sha256 of FILE.
    #[arg(long, value_name = "HEX")]
    sha256: Option<Sha256Digest>,

    /// Expected sha256 of the backbone file.
    #[arg(long, value_name = "HEX", requires = "backbone")]
    backbone_sha256: Option<Sha256Digest>,

    /// Weights file to write. Without it, only the report is printed.
    #[arg(long, short, value_name = "FILE")]
    out: Option<PathBuf>,

    /// Stored number type: f32 as trained; f16, half the size, numbers up to 65504; bf16, half the size, f32's range with
    /// three digits. The network computes with f32.
    #[arg(long, value_name = "TYPE", default_value = "f32", value_parser = named(PRECISIONS), requires = "out")]
    precision: Precision,

    /// Provenance note on the weights, such as `data=re10k`; kept in the file and with every result. A key that FILE states or the
    /// import records already is an error, and so is a repeated one.
    #[arg(long, value_name = "KEY=VALUE", value_parser = note, requires = "out")]
    note: Vec<(String, String)>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

const PRECISIONS: [(&str, Precision); 3] =
    [("f32", Precision::Single), ("f16", Precision::Half), ("bf16", Precision::Brain)];

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    args.check()?;
    let requested = args.model.as_deref().map(ModelConfig::resolve).transpose()?;
    let map = KeyMap::resolve(&args.key_map)?;
    let _outputs = OutputFiles::of(args.out.as_deref())?;
    let source = TensorFile::find(&args.file, || "a checkpoint or safetensors to import".to_owned())?;
    source.check_sha256(args.sha256)?;
    let (source, imported) = of_this_toolkit(source)?;
    let config = args.network(requested, imported.as_ref())?;
    if args.backbone.is_some() && !matches!(config.backbone, BackboneConfig::DinoV2 { .. }) {
        bail!("--backbone: the model {} has no DINOv2 backbone", config.name);
    }
    let out = args.out.as_deref().map(PendingFile::open).transpose()?;
    let backbone = match &args.backbone {
        Some(path) => Some(read_backbone(path, &config, args.backbone_sha256)?),
        None => None,
    };
    let mut expected = parameters(&config);
    if backbone.is_some() {
        expected.retain(|parameter| parameter.trained);
    }
    let (mut tensors, found) = map.apply(&source.stored, &expected);
    let complete = found.is_complete();
    let lacks_backbone = found.missing.iter().any(|missing| missing.parameter.starts_with("backbone."));
    let mut report = ImportedFile {
        file: args.file.clone(),
        sha256: source.sha256,
        model: config.name.clone(),
        complete,
        found,
        backbone: args.backbone.clone().zip(backbone.as_ref()).map(|(file, read)| ImportedBackbone::new(file, read)),
        out: None,
    };
    if !complete {
        print_report(&report, args.json)?;
        if lacks_backbone && let BackboneConfig::DinoV2 { .. } = config.backbone {
            print_status(&format!(
                "set the backbone's weights with --backbone: {}",
                KnownFile::advice(&config.backbone)
            ));
        }
        bail!("{} does not contain the model {}; nothing was written", args.file.display(), config.name);
    }
    if let Some(out) = out {
        // What a weights file says about its training is also true for a copy.
        let mut provenance = imported.map(|weights| weights.provenance).unwrap_or_default();
        for (key, value) in report.provenance() {
            // Of weights that were imported before, this file is not the origin.
            let value = match provenance.get(&key) {
                Some(before) => training_data::continued(&value, before),
                None => value,
            };
            provenance.insert(key, value);
        }
        args.add_notes(&mut provenance)?;
        tensors.tensors.extend(backbone.into_iter().flat_map(|backbone| backbone.tensors.tensors));
        let weights = ModelWeights::new(config, provenance, &tensors)?;
        let bytes = weights.to_stored(args.precision).context("--precision")?.to_safetensors()?;
        out.finish(&bytes)?;
        report.out.clone_from(&args.out);
    }
    print_report(&report, args.json)
}

impl Args {
    /// Rejects a note that is given twice, and an output that would overwrite an input.
    fn check(&self) -> anyhow::Result<()> {
        let keys: Vec<String> = self.note.iter().map(|(key, _)| key.clone()).collect();
        once("--note", &keys).map_err(usage_error)?;
        let Some(out) = &self.out else { return Ok(()) };
        let mut inputs = vec![Input::File("weights", &self.file), Input::Toml("key map", &self.key_map)];
        inputs.extend(self.model.as_deref().map(|model| Input::Toml("configuration", model)));
        inputs.extend(self.backbone.as_deref().map(|backbone| Input::File("backbone", backbone)));
        check_output("--out", out, &inputs)
    }

    /// The network: the requested one, which must be that of a file of this toolkit, or else that of the file.
    fn network(&self, requested: Option<ModelConfig>, imported: Option<&ModelWeights>) -> anyhow::Result<ModelConfig> {
        let file = self.file.display();
        match (requested, imported) {
            (Some(config), Some(weights)) => {
                let error = || format!("{file} is a file of this toolkit");
                same_network(&config, &weights.config).context("--model").with_context(error)?;
                Ok(config)
            }
            (Some(config), None) => Ok(config),
            (None, Some(weights)) => Ok(weights.config.clone()),
            (None, None) => {
                Err(usage_error(format!("--model NAME|FILE: expected the network of {file}, found none")).into())
            }
        }
    }

    /// Adds the notes; none may replace what the file and the import record.
    fn add_notes(&self, provenance: &mut BTreeMap<String, String>) -> anyhow::Result<()> {
        let stated = |(key, _): &(String, String)| provenance.get(key).map(|value| format!("{key} = {value:?}"));
        let stated: Vec<String> = self.note.iter().filter_map(stated).collect();
        let file = self.file.display();
        ensure!(
            stated.is_empty(),
            "--note: the provenance of {file} and of its import states {}; use other keys",
            stated.join(", ")
        );
        provenance.extend(self.note.iter().cloned());
        Ok(())
    }
}

/// The tensors to import, and the weights of a file of this toolkit: its own, or those in a checkpoint of a training.
fn of_this_toolkit(source: TensorFile) -> anyhow::Result<(TensorFile, Option<ModelWeights>)> {
    if CheckpointFile::is_one(&source.stored) {
        let weights = CheckpointFile::read(&source)?.weights;
        let stored = StoredTensors { tensors: weights.tensors.tensors.clone(), ..StoredTensors::default() };
        return Ok((TensorFile { stored, ..source }, Some(weights)));
    }
    let weights = ModelWeights::is_one(&source.stored).then(|| ModelWeights::of_file(&source)).transpose()?;
    Ok((source, weights))
}

/// Parses the name or path of a key map.
pub(super) fn key_map(text: &str) -> Result<String, atsplat_model::ModelError> {
    name_or_path(text, KeyMap::resolve)
}

fn note(text: &str) -> Result<(String, String), String> {
    let pair = text.split_once('=').map(|(key, value)| (key.trim(), value.trim()));
    let pair = pair.filter(|(key, value)| !key.is_empty() && !value.is_empty());
    let (key, value) = pair.ok_or_else(|| format!("expected KEY=VALUE, found {text:?}"))?;
    Ok((key.to_owned(), value.to_owned()))
}
