//! What is checked before anything is read: options, inputs that would be overwritten, outputs that cannot be written.

use std::path::PathBuf;

use anyhow::{Context as _, ensure};
use atsplat_files::canonical_path;
use atsplat_fit::{Background, Fit, Strategy};
use atsplat_scene::Frame;
use atsplat_splat::Gaussians;
use atsplat_splat::files::Output;

use super::Args;
use super::output::ply_instead;
use crate::alpha::Alpha;
use crate::output_lock::OutputFiles;
use crate::overwrite::{Input, check_output, check_outputs, photos};
use crate::parse;
use crate::paths::{check_writable, record_path};
use crate::print::note;
use crate::requirements::{Requirement, check_all};

/// The files of --plots.
const PLOTS: [&str; 3] = ["learning-curve.svg", "learning-curve.png", "contact-sheet.png"];

impl Args {
    pub(super) fn check(&self) -> anyhow::Result<()> {
        self.start.check()?;
        self.check_requirements().map_err(parse::usage_error)?;
        self.check_results()?;
        self.check_inputs()?;
        self.check_checkpoint()
    }

    fn check_requirements(&self) -> Result<(), String> {
        let optimisation = &self.optimisation;
        let is_adaptive = matches!(optimisation.strategy, Some(Strategy::Gaussians3d | Strategy::MipSplatting));
        check_all(&[
            Requirement {
                options: &[("--absolute-gradients", optimisation.absolute_gradients)],
                requires: "--strategy 3dgs or mip-splatting",
                satisfied: is_adaptive,
            },
            Requirement {
                options: &[("--alpha composite", self.input.alpha == Alpha::Composite)],
                requires: "--background black or white",
                satisfied: matches!(optimisation.background, Background::Black | Background::White),
            },
            Requirement {
                options: &[("--start points", self.start.is_points())],
                requires: "DATA on this machine, or a folder with a points3D file in place of points",
                satisfied: atsplat_objects::url(&self.input.data).is_none(),
            },
            Requirement {
                options: &[("--strategy mip-splatting", optimisation.strategy == Some(Strategy::MipSplatting))],
                requires: "--out with a file that ends in .ply, because SPZ stores no 3D filters",
                satisfied: self.stores_filters(),
            },
        ])
    }

    /// Whether the file of the Gaussians can have 3D filters.
    fn stores_filters(&self) -> bool {
        Output::of_path(&self.out).is_ok_and(Output::is_lossless)
    }

    /// Rejects initial Gaussians that the file cannot store: the strategies other than Mip-Splatting keep their 3D filters.
    pub(super) fn check_start(&self, start: &Gaussians) -> anyhow::Result<()> {
        ensure!(
            start.parts().filter_3d.is_none() || self.stores_filters(),
            "--out {}: expected a file that ends in .ply, because the initial Gaussians have 3D filters (filter_3D), which SPZ does \
             not store",
            self.out.display()
        );
        Ok(())
    }

    /// The cameras of the views, next to the Gaussians. The name is not one that a dataset may have.
    pub(super) fn cameras_file(&self) -> PathBuf {
        self.out.with_added_extension("cameras.json")
    }

    /// The files that --out stands for, with the one that is written if SPZ cannot store the Gaussians.
    fn results(&self) -> Vec<PathBuf> {
        let ply = (!self.stores_filters()).then(|| ply_instead(&self.out));
        [self.out.clone(), record_path(&self.out), self.cameras_file()].into_iter().chain(ply).collect()
    }

    /// The files of --plots.
    fn plot_files(&self) -> impl Iterator<Item = PathBuf> {
        self.plots.iter().flat_map(|folder| PLOTS.map(|name| folder.join(name)))
    }

    /// Rejects results and plots that would overwrite the checkpoint.
    fn check_results(&self) -> anyhow::Result<()> {
        let Some(checkpoint) = &self.checkpoint else { return Ok(()) };
        let kept = canonical_path(checkpoint)?;
        let results = self.results().into_iter().map(|file| ("--out", file));
        for (option, file) in results.chain(self.plot_files().map(|file| ("--plots", file))) {
            if canonical_path(&file)? == kept {
                let (checkpoint, file) = (checkpoint.display(), file.display());
                let text = format!(
                    "--checkpoint {checkpoint}: {option} writes {file}; choose another file for the checkpoint"
                );
                return Err(parse::usage_error(text).into());
            }
        }
        Ok(())
    }

    /// Rejects outputs that would overwrite the dataset or the start.
    fn check_inputs(&self) -> anyhow::Result<()> {
        let start = self.start.path().map(|start| match start {
            folder if folder.is_dir() => Input::Dataset(folder),
            file => Input::File("start", file),
        });
        let weights = self.start.refine.as_deref().map(|weights| Input::File("weights file", weights));
        let inputs: Vec<Input<'_>> =
            [Input::Dataset(&self.input.data)].into_iter().chain(start).chain(weights).collect();
        self.results().iter().try_for_each(|file| check_output("--out", file, &inputs))?;
        let checkpoint = self.checkpoint.as_deref();
        checkpoint.map_or(Ok(()), |file| check_output("--checkpoint", file, &inputs))
    }

    /// Rejects a checkpoint that would overwrite a file of another kind, or the state of another run.
    fn check_checkpoint(&self) -> anyhow::Result<()> {
        let Some(checkpoint) = self.checkpoint.as_deref() else { return Ok(()) };
        let shown = checkpoint.display();
        if !checkpoint.is_file() {
            if self.resume {
                note(&format!("--resume: no checkpoint at {shown}; starting from step 0"));
            }
            return Ok(());
        }
        let is_checkpoint =
            Fit::is_checkpoint(checkpoint).with_context(|| format!("reading the checkpoint {shown}"))?;
        ensure!(
            is_checkpoint,
            "--checkpoint: {shown} is not a checkpoint written by `atsplat fit`; choose another file"
        );
        ensure!(
            self.resume,
            "--checkpoint: {shown} is the state of a run; --resume continues it, otherwise choose another file or remove it"
        );
        Ok(())
    }

    /// Fails before long work if a file cannot be written, or another process writes it. None stays open meanwhile: a run that is
    /// interrupted leaves no part of one.
    pub(super) fn lock_outputs(&self) -> anyhow::Result<OutputFiles> {
        let plot = self.plots.as_deref().map(|folder| folder.join(PLOTS[0]));
        let mut outputs = OutputFiles::default();
        for file in [Some(self.out.as_path()), self.checkpoint.as_deref(), plot.as_deref()].into_iter().flatten() {
            outputs.add(file)?;
        }
        check_writable(&record_path(&self.out))?;
        check_writable(&self.cameras_file())?;
        Ok(outputs)
    }

    /// Rejects plots that would overwrite photos.
    pub(super) fn check_photos(&self, photographed: &[Frame]) -> anyhow::Result<()> {
        check_outputs("--plots", self.plot_files(), photos(photographed))
    }
}
