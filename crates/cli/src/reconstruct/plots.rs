//! Plots of the token expansion.

use std::path::PathBuf;

use atsplat_model::network::Network;
use atsplat_report::figures::of_expansion;
use atsplat_report::plot::PlotFormat;
use atsplat_splat::RenderOptions;
use serde::Serialize;

use super::input::Input;
use crate::expansion::study_trial;
use crate::output::PendingFile;

/// Targets that are shown next to their ground truth.
const MAX_TARGETS: usize = 4;

#[derive(Debug, clap::Args)]
pub(super) struct PlotArgs {
    /// Folder for plots of the token expansion, each as .svg and .png: children around their parents; and with --targets
    /// renders with expansion in ever more blocks, and predicted uncertainty next to the error. The network runs once more
    /// for each expanding block.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
}

/// The plots.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct PlotsRecord {
    pub(super) folder: PathBuf,
    pub(super) files: Vec<String>,
}

impl PlotArgs {
    pub(super) const fn requested(&self) -> bool {
        self.plots.is_some()
    }

    /// Creates the folder before long work starts.
    pub(super) fn open(&self) -> anyhow::Result<()> {
        let Some(folder) = &self.plots else { return Ok(()) };
        PendingFile::open(&folder.join("uncertainty.svg")).map(drop)
    }

    /// Draws the requested plots; `subject` names network and weights.
    pub(super) fn draw(
        &self,
        network: &Network,
        input: &Input,
        options: RenderOptions,
        seed: u64,
        subject: &str,
    ) -> anyhow::Result<Option<PlotsRecord>> {
        let Some(folder) = &self.plots else { return Ok(None) };
        let scene = study_trial(network, (&input.trial, &input.truths), options, seed, MAX_TARGETS)?;
        let mut files = Vec::new();
        for (name, drawing) in of_expansion(subject, &[scene])? {
            for format in [PlotFormat::Svg, PlotFormat::Png] {
                let file = format!("{name}.{}", format.extension());
                PendingFile::open(&folder.join(&file))?.finish(&drawing.encode(format)?)?;
                files.push(file);
            }
        }
        Ok(Some(PlotsRecord { folder: folder.clone(), files }))
    }
}
