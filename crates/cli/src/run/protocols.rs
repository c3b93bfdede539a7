//! Arguments that select protocols, data and index.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use atsplat_camera::ImageSize;
use atsplat_eval::runner::{Dataset, IndexChoice, IndexFolder, PlannedIndex};
use atsplat_protocol::{DropReason, Preset};
use atsplat_results::{Results, SkippedEntry};
use atsplat_scene::{Fetch as _, ImageFolder, SceneSource, Warnings};

use crate::dataset_args::ImageArgs;
use crate::objects::{CacheArgs, RemoteData, with_urls};
use crate::overwrite::check_results_folder;
use crate::parse;

#[derive(Debug, clap::Args)]
pub(crate) struct ProtocolArgs {
    /// Protocols: names of `atsplat protocol list`, or paths that end in .toml.
    #[arg(value_name = "PRESET|FILE", required = true, value_parser = parse::preset)]
    presets: Vec<String>,

    /// Dataset, in any supported format, or its URL (s3, gs, az): then only what trials need is fetched.
    #[arg(long, value_name = "PATH")]
    data: PathBuf,

    #[command(flatten)]
    images: ImageArgs,

    /// Evaluation index (JSON), or a folder in which each protocol's published index is found by its hash, at any depth. By
    /// default the first of PRESET.json, `evaluation_index_DATASET.json` (such as `evaluation_index_re10k.json`) and
    /// `evaluation_index.json` in the dataset's folder.
    #[arg(long, value_name = "INDEX|DIR", conflicts_with = "sampler")]
    index: Option<PathBuf>,

    /// For data without a published index: a sampling rule of `eval/samplers/`, or a path that ends in .toml.
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
    /// Rejects a protocol that is given twice, before anything is read.
    pub(crate) fn check(&self) -> Result<(), clap::Error> {
        parse::once("the protocols", &self.presets).map_err(parse::usage_error)
    }

    /// Rejects the dataset's own folder as that of results.
    pub(crate) fn check_out(&self, out: &Path) -> anyhow::Result<()> {
        check_results_folder(out, &self.data)
    }

    /// The data, if they are in object storage.
    pub(crate) fn remote(&self) -> anyhow::Result<Option<Arc<RemoteData>>> {
        self.cache().dataset(&self.data)
    }

    /// Where copies of objects are kept.
    pub(crate) const fn cache(&self) -> &CacheArgs {
        &self.images.cache
    }

    /// Opens the data, which are those of [`Self::remote`], and finds each protocol's index.
    pub(crate) fn open(
        &self,
        remote: Option<&Arc<RemoteData>>,
        warnings: &mut Warnings,
    ) -> anyhow::Result<Vec<Dataset>> {
        let data = remote.map_or(self.data.as_path(), |remote| remote.path());
        let presets = self.presets.iter().map(|name| Ok((name, Preset::resolve(name)?)));
        let presets = presets.collect::<anyhow::Result<Vec<_>>>()?;
        let expected_size = self.expected_size(&presets);
        let source: Arc<dyn SceneSource> =
            Arc::new(self.images.open_at(&self.data, remote, expected_size, warnings)?);
        let opening = warnings.clone();
        let rule =
            self.sampler.as_deref().map(|name| Ok::<_, anyhow::Error>((name, parse::rule(name)?))).transpose()?;
        // Searched once for all protocols.
        let folder = self.index.as_deref().filter(|path| path.is_dir()).map(IndexFolder::search).transpose()?;
        let index = match (&rule, &folder, &self.index) {
            (Some((name, rule)), ..) => IndexChoice::Sampled(name, rule),
            (None, Some(folder), _) => IndexChoice::Below(folder),
            (None, None, Some(path)) => IndexChoice::At(path),
            (None, None, None) => IndexChoice::NextToData,
        };
        let open = |name: &String, preset: Preset, warnings: &mut Warnings| -> anyhow::Result<Dataset> {
            if let (Some(remote), IndexChoice::NextToData) = (remote, index) {
                remote.fetch(PlannedIndex::next_to(data, &preset).as_slice())?;
            }
            let opened = Dataset::new(preset, Arc::clone(&source), data, index, self.any_size, warnings);
            let mut opened = opened.with_context(|| format!("protocol {name}"))?;
            if rule.is_some() {
                opened.index.note_unread(&opening);
            }
            // Records of a run do not depend on where copies are.
            opened.description = with_urls(&opened.description);
            opened.index.description = with_urls(&opened.index.description);
            Ok(opened)
        };
        presets.into_iter().map(|(name, preset)| open(name, preset, warnings)).collect()
    }

    /// The size of images that all of the protocols expect, if it is one.
    fn expected_size(&self, presets: &[(&String, Preset)]) -> Option<ImageSize> {
        if self.any_size {
            return None;
        }
        let mut sizes = presets.iter().map(|(_, preset)| preset.preprocessing.expected_size);
        let first = sizes.next()??;
        sizes.all(|size| size == Some(first)).then_some(first)
    }

    /// Which other copy of a capture's images has the size that a protocol expects, if it skipped a scene for the size of its
    /// images; `None` for data without copies, and for data in object storage, whose copies were not fetched.
    pub(super) fn images_of_expected_size(&self, datasets: &[Dataset], results: &Results) -> Option<u32> {
        if atsplat_objects::url(&self.data).is_some() {
            return None;
        }
        let of_size = |skipped: &&SkippedEntry| skipped.reason == DropReason::ImageSize.name();
        let (skipped, dataset) = results.provenance.skipped.iter().filter(of_size).find_map(|skipped| {
            let dataset = datasets.iter().find(|dataset| dataset.name == skipped.preset)?;
            Some((skipped, dataset))
        })?;
        let expected = dataset.preset.preprocessing.expected_size?;
        // All images count: the copy may be the one with the rejected image, or stand for a folder that does not exist.
        let have_size = |factor: u32| {
            let mut unread = Warnings::new();
            let copy = self.images.with_images(factor).open(&self.data, &mut unread).ok()?;
            let scene = copy.load(&skipped.scene, &mut unread).ok()?;
            let available = scene.frames.iter().enumerate().filter(|(_, frame)| frame.image.is_available());
            let mut sizes = available.map(|(at, frame)| frame.size(&scene.key, at).ok()).peekable();
            Some(sizes.peek().is_some() && sizes.all(|size| size == Some(expected)))
        };
        std::iter::once(1).chain(ImageFolder::FACTORS).find(|factor| have_size(*factor) == Some(true))
    }

    /// Whether images of any size are accepted.
    pub(super) const fn takes_any_size(&self) -> bool {
        self.any_size
    }
}
