//! The results of a run: Gaussians, cameras, plots and the record.

use std::path::Path;

use anyhow::Context as _;
use atsplat_eval::fitting::FittedCameras;
use atsplat_eval::reconstruct::rounding_warning;
use atsplat_fit::{Fit, FitConfig, FitRecord, ScaleEvaluation, TrainingView};
use atsplat_splat::files::{self, Output};

use super::Args;
use super::input::Input;
use super::optimise::Log;
use super::plots::draw;
use super::prepare::StartSummary;
use crate::paths::PendingFile;
use crate::print::warn;

impl Args {
    /// Writes the results. Unless the run `can_render`, nothing is compared or drawn.
    pub(super) fn write_results(
        &self,
        fit: &mut Fit,
        input: &Input,
        mut start: StartSummary,
        log: &Log<'_>,
        can_render: bool,
    ) -> anyhow::Result<FitRecord> {
        // Written before further renders, which may fail; after a fault these are the Gaussians of the last good state.
        let gaussians = input.photos.in_scene(&fit.gaussians())?;
        if let Some(text) = rounding_warning(&gaussians) {
            warn(&text);
            start.warnings.push(text);
        }
        let (record_file, cameras_file) = (self.record_file(), self.cameras_file());
        remove_old(&record_file)?;
        remove_old(&cameras_file)?;
        let clamped = files::write(&self.out, &gaussians, Output::of_path(&self.out)?)?.warnings();
        for text in &clamped {
            warn(text);
        }
        start.warnings.extend(clamped);
        let cameras = serde_json::to_string_pretty(&FittedCameras::of(&input.photos, fit)?)?;
        PendingFile::open(&cameras_file)?.finish(format!("{cameras}\n").as_bytes())?;
        let mut at_scales = Vec::new();
        if can_render {
            log.evaluate(fit)?;
            if let Some(folder) = &self.plots {
                draw(folder, fit, &input.training, &input.held_out)?;
            }
            at_scales = fit.at_scales(&input.scaled)?;
        }
        let record = self.record(fit, input, start, gaussians.len(), at_scales)?;
        PendingFile::open(&record_file)?.finish_record(&record, &self.out)?;
        Ok(record)
    }

    fn record(
        &self,
        fit: &Fit,
        input: &Input,
        start: StartSummary,
        gaussians: usize,
        at_scales: Vec<ScaleEvaluation>,
    ) -> anyhow::Result<FitRecord> {
        let normalisation = input.photos.trial().normalisation().new_from_old;
        let names = |views: &[TrainingView]| views.iter().map(|view| view.name.clone()).collect();
        Ok(FitRecord {
            atsplat: env!("CARGO_PKG_VERSION"),
            data: self.input.data.clone(),
            scene: input.photos.trial().scene().to_owned(),
            views: names(&input.training),
            held_out: names(&input.held_out),
            alpha: self.input.alpha.name(),
            inputs: fit.inputs(&input.held_out),
            start: start.name,
            start_gaussians: start.gaussians,
            dropped: start.removed + fit.dropped(),
            extent: fit.extent() / normalisation.scale,
            configuration: FitConfig {
                extent: self.optimisation.extent,
                constants: fit.options().constants,
                ..fit.config().clone()
            },
            device: fit.device().to_owned(),
            steps: fit.step_count(),
            file: self.out.clone(),
            gaussians,
            corrections: fit.corrections(&normalisation)?,
            last_steps: fit.history().last_steps(),
            evaluations: fit.history().evaluations.clone(),
            at_scales,
            warnings: start.warnings,
        })
    }
}

/// Removes the record or the cameras of an earlier run, which say nothing about the Gaussians of this one.
fn remove_old(file: &Path) -> anyhow::Result<()> {
    atsplat_files::remove_if_exists(file).with_context(|| format!("removing {}", file.display()))
}
