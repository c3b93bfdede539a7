//! Arguments of the output files: Gaussians, renders and plots.

use std::path::PathBuf;

use atsplat_eval::expansion::study_trial;
use atsplat_eval::method::Backend;
use atsplat_eval::reconstruct::{PhotoSelection, Photos, PlotsRecord, RendersRecord, write_renders};
use atsplat_eval::rendering::frame_file_name;
use atsplat_model::network::Network;
use atsplat_protocol::NearFar;
use atsplat_report::plot_data::expansion_plots;
use atsplat_scene::Frame;
use atsplat_splat::{Gaussians, RenderOptions};

use crate::output_lock::OutputFiles;
use crate::overwrite::photos;
use crate::parse;
use crate::plot::write_both;
use crate::requirements::{Requirement, check_all};

#[derive(Debug, clap::Args)]
pub(super) struct RenderArgs {
    /// Folder for images: `inputs/` as given to the network, `context/` renders of the same views, and `targets/`.
    #[arg(long, value_name = "DIR")]
    renders: Option<PathBuf>,

    /// Constants and rules of a published rasterizer, by name (exact by default) or in a .toml.
    #[arg(long, value_name = "PRESET", value_parser = parse::ConstantsName)]
    constants: Option<String>,

    /// black (the default), white, or R,G,B from 0 to 1.
    #[arg(long, value_name = "COLOUR", value_parser = parse::background)]
    background: Option<[f64; 3]>,
}

const CONSTANTS: &str = "exact";
const BLACK: [f64; 3] = [0.0; 3];

impl RenderArgs {
    /// Rejects options about renders without any. Photos can be composited over the background too.
    pub(super) fn check(&self, has_targets: bool, has_plots: bool, composites: bool) -> Result<(), String> {
        let has_renders = self.renders.is_some() || has_plots;
        check_all(&[
            Requirement {
                options: &[("--targets", has_targets), ("--constants", self.constants.is_some())],
                requires: "--renders or --plots",
                satisfied: has_renders,
            },
            Requirement {
                options: &[("--background", self.background.is_some())],
                requires: "--renders, --plots or --alpha composite",
                satisfied: has_renders || composites,
            },
        ])
    }

    /// The background of photos, rounded to 8 bits.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "channels are from 0 to 1")]
    pub(super) fn background_of_photos(&self) -> [u8; 3] {
        self.background.unwrap_or(BLACK).map(|channel| (channel * 255.0).round() as u8)
    }

    /// Fails before long work if the folder cannot be written.
    pub(super) fn lock(&self, outputs: &mut OutputFiles) -> anyhow::Result<()> {
        let Some(folder) = &self.renders else { return Ok(()) };
        outputs.add(&folder.join("inputs").join(frame_file_name(0, "png")))
    }

    /// The files of these photos.
    pub(super) fn files(&self, PhotoSelection { context, targets }: &PhotoSelection) -> Vec<PathBuf> {
        let of = |(subfolder, frames): (&str, &[usize])| -> Vec<PathBuf> {
            let folder = self.renders.iter().map(|folder| folder.join(subfolder));
            folder
                .flat_map(|folder| frames.iter().map(move |frame| folder.join(frame_file_name(*frame, "png"))))
                .collect()
        };
        [("inputs", context.as_slice()), ("context", context), ("targets", targets)].into_iter().flat_map(of).collect()
    }

    /// Render options, with lengths in the network's unit.
    pub(super) fn options(&self, near_far: NearFar) -> anyhow::Result<RenderOptions> {
        let constants = self.constants.as_deref().unwrap_or(CONSTANTS);
        let mut options = RenderOptions {
            constants: parse::constants(constants)?,
            background: self.background.unwrap_or(BLACK),
            ..RenderOptions::default()
        };
        (options.constants.near, options.constants.far) = (near_far.near, near_far.far);
        options.constants.name = format!("{constants} with near {} and far {}", near_far.near, near_far.far);
        Ok(options)
    }

    /// Renders the requested views.
    pub(super) fn render(
        &self,
        gaussians: &Gaussians,
        photos: &Photos,
        backend: &Backend,
    ) -> anyhow::Result<Option<RendersRecord>> {
        let Some(folder) = &self.renders else { return Ok(None) };
        let options = self.options(photos.trial().near_far())?;
        Ok(Some(write_renders(folder, gaussians, photos, &options, backend)?))
    }
}

/// Maximum number of targets that are shown next to their ground truth.
const MAX_TARGETS: usize = 4;

#[derive(Debug, clap::Args)]
pub(super) struct PlotArgs {
    /// Folder for plots of the token expansion, each as .svg and .png: children around their parents; and with
    /// --targets renders with expansion in more and more blocks, and predicted uncertainty next to the error. The
    /// network runs once more for each expanding block.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

impl PlotArgs {
    pub(super) const fn requested(&self) -> bool {
        self.plots.is_some()
    }

    /// Fails before long work if the folder cannot be written.
    pub(super) fn lock(&self, outputs: &mut OutputFiles) -> anyhow::Result<()> {
        let Some(folder) = &self.plots else { return Ok(()) };
        outputs.add(&folder.join("uncertainty.svg"))
    }

    /// The photos that have names of plots, as files of the folder: which plots there are is known after the network has run.
    pub(super) fn files(&self, frames: &[Frame]) -> Vec<PathBuf> {
        const NAMES: [&str; 3] = ["token-expansion-", "expansion-strips.", "uncertainty."];
        let Some(folder) = &self.plots else { return Vec::new() };
        let names = photos(frames).filter_map(|(_, file)| file.file_name()?.to_str());
        let of_plots = names.filter(|name| NAMES.iter().any(|plot| name.starts_with(plot)));
        of_plots.map(|name| folder.join(name)).collect()
    }

    /// Draws the requested plots; `subject` names network and weights.
    pub(super) fn draw(
        &self,
        network: &Network,
        photos: &Photos,
        options: RenderOptions,
        seed: u64,
        subject: &str,
    ) -> anyhow::Result<Option<PlotsRecord>> {
        let Some(folder) = &self.plots else { return Ok(None) };
        let (scene, _) = study_trial(network, (photos.trial(), photos.ground_truth()), options, seed, MAX_TARGETS)?;
        let mut files = Vec::new();
        for (name, drawing) in expansion_plots(subject, &[scene])? {
            files.extend(write_both(folder, &name, &drawing)?);
        }
        Ok(Some(PlotsRecord { folder: folder.clone(), files }))
    }
}
