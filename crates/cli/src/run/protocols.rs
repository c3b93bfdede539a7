//! Arguments that select protocols, data and index.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, bail};
use atsplat_eval::runner::{Dataset, PlannedIndex};
use atsplat_eval::sources::AlreadyCropped;
use atsplat_protocol::Preset;
use atsplat_scene::{SceneSource, Warnings};

use crate::dataset_args::PictureArgs;
use crate::parse;

#[derive(Debug, clap::Args)]
pub(crate) struct ProtocolArgs {
    /// Protocols: names of `atsplat protocol list`, or paths that end in .toml.
    #[arg(value_name = "PRESET|FILE", required = true, value_parser = parse::preset)]
    presets: Vec<String>,

    /// Dataset, in any supported format.
    #[arg(long, value_name = "PATH")]
    data: PathBuf,

    #[command(flatten)]
    pictures: PictureArgs,

    /// Evaluation index (JSON), or a folder in which each protocol's published index is found by its hash. By default the
    /// file PRESET.json or `evaluation_index.json` in the dataset's folder.
    #[arg(long, value_name = "INDEX|DIR", conflicts_with = "sampler")]
    index: Option<PathBuf>,

    /// For data without a published index: choose frames by a rule of `eval/samplers/`, or a path that ends in .toml.
    /// Results on a sampled index are not comparable with published ones.
    #[arg(long, value_name = "RULE", value_parser = parse::sampler)]
    sampler: Option<String>,

    /// Accept images of any size, even if a protocol requires one: preprocessing then starts from different images, and the
    /// protocol hash of the results changes. Images of the size that the protocol crops to are taken as already cropped, and
    /// their cameras are cropped accordingly.
    #[arg(long)]
    any_size: bool,
}

impl ProtocolArgs {
    /// Opens the data and finds each protocol's index.
    pub(crate) fn open(&self, warnings: &mut Warnings) -> anyhow::Result<Vec<Dataset>> {
        let source: Arc<dyn SceneSource> = Arc::new(self.pictures.open(&self.data, warnings)?);
        let mut datasets = Vec::with_capacity(self.presets.len());
        for name in &self.presets {
            let mut preset = Preset::resolve(name)?;
            let mut source = Arc::clone(&source);
            let mut description = self.data.display().to_string();
            if self.any_size {
                if let Some((cropped, adapted)) = AlreadyCropped::of(&source, &preset) {
                    (source, preset) = (Arc::new(cropped), adapted);
                    description.push_str(", pictures cropped beforehand");
                } else {
                    preset.preprocessing.expected_size = None;
                }
            }
            let index = self.index(&preset, source.as_ref(), warnings).with_context(|| format!("protocol {name}"))?;
            datasets.push(Dataset { name: preset.name.clone(), preset, source, description, index });
        }
        Ok(datasets)
    }

    /// Whether images of any size are accepted.
    pub(super) const fn takes_any_size(&self) -> bool {
        self.any_size
    }

    fn index(
        &self,
        preset: &Preset,
        source: &dyn SceneSource,
        warnings: &mut Warnings,
    ) -> anyhow::Result<PlannedIndex> {
        if let Some(sampler) = &self.sampler {
            return Ok(PlannedIndex::sampled(sampler, &parse::rule(sampler)?, source, warnings));
        }
        let default = || PlannedIndex::next_to(&self.data, preset);
        let Some(path) = self.index.clone().or_else(default) else {
            let accepted: Vec<&str> = preset.index.accepted.iter().map(|accepted| accepted.name.as_str()).collect();
            bail!(
                "no evaluation index in {}: give --index with the file of {}, or --sampler for data without an index",
                self.data.display(),
                accepted.join(" or ")
            )
        };
        Ok(PlannedIndex::read(&path, preset, source, warnings)?)
    }
}
