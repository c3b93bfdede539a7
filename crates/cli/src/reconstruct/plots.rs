//! Plots of what expansion did, beside the Gaussians.

use std::path::PathBuf;

use atsplat_model::network::Network;
use atsplat_report::figures::of_expansion;
use atsplat_report::plot::PlotFormat;
use atsplat_splat::RenderOptions;
use clap::Args;
use serde::Serialize;

use super::input::Input;
use crate::expansion::studied;
use crate::output::PendingFile;

/// Targets that are shown with their truths.
const TARGETS: usize = 4;

#[derive(Debug, Args)]
pub(super) struct PlotWords {
    /// Folder for plots of what expansion did, each as .svg and .png: children around their parents; and with --targets
    /// renders with expansion in ever more blocks, and predicted uncertainty beside the error. The network runs once more
    /// for each block that expands.
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

impl PlotWords {
    pub(super) const fn asked(&self) -> bool {
        self.plots.is_some()
    }

    /// Makes and tries the folder before long work starts.
    pub(super) fn open(&self) -> anyhow::Result<()> {
        let Some(folder) = &self.plots else { return Ok(()) };
        PendingFile::open(&folder.join("uncertainty.svg")).map(drop)
    }

    /// Draws what was asked for; `subject` names network and weights.
    pub(super) fn draw(
        &self,
        network: &Network,
        input: &Input,
        options: RenderOptions,
        seed: u64,
        subject: &str,
    ) -> anyhow::Result<Option<PlotsRecord>> {
        let Some(folder) = &self.plots else { return Ok(None) };
        let scene = studied(network, (&input.trial, &input.truths), options, seed, TARGETS)?;
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
