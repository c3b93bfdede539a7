//! The results of a run: Gaussians, cameras, plots and the record.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_eval::fitting::FittedCameras;
use atsplat_eval::reconstruct::rounding_warning;
use atsplat_fit::{Fit, FitConfig, FitRecord, ScaleEvaluation, TrainingView};
use atsplat_splat::files::{self, Output};
use atsplat_splat::{Gaussians, SplatError};

use super::Args;
use super::input::Input;
use super::optimise::Log;
use super::plots::draw;
use super::prepare::StartSummary;
use crate::COMMIT;
use crate::paths::{PendingFile, record_path, remove_old, write_record};
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
        let cameras_file = self.cameras_file();
        remove_old(&record_path(&self.out))?;
        remove_old(&cameras_file)?;
        let clamped = write_gaussians(&self.out, &gaussians)?;
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
        write_record(&record, &self.out)?;
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
            commit: COMMIT,
            data: self.input.data.clone(),
            scene: input.photos.trial().scene().to_owned(),
            views: names(&input.training),
            held_out: names(&input.held_out),
            alpha: self.input.alpha.name(),
            inputs: fit.inputs(&input.held_out),
            start: start.name,
            start_gaussians: start.gaussians,
            dropped: start.removed + fit.start_validation().rejected,
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

/// Writes the Gaussians, and returns warnings of what the format changed in them. Those that it cannot store, which is known only when they
/// have been optimised, are written as PLY next to the file.
fn write_gaussians(out: &Path, gaussians: &Gaussians) -> anyhow::Result<Vec<String>> {
    let format = Output::of_path(out)?;
    match files::write(out, gaussians, format) {
        Ok(export) => Ok(export.warnings()),
        Err(error @ SplatError::Format { .. }) if !format.is_lossless() => {
            let ply = ply_instead(out);
            files::write(&ply, gaussians, Output::of_path(&ply)?).with_context(|| error.to_string())?;
            Err(anyhow::Error::from(error).context(format!("{} contains the Gaussians instead", ply.display())))
        }
        Err(error) => Err(error.into()),
    }
}

/// Where Gaussians are written that the format of a file cannot store.
pub(super) fn ply_instead(out: &Path) -> PathBuf {
    out.with_added_extension("ply")
}

#[cfg(test)]
mod tests {
    use atsplat_splat::GaussianParts;

    use super::*;

    /// SPZ has 24 bits for a coordinate.
    #[test]
    fn gaussians_that_spz_cannot_store_are_kept_as_ply() {
        let gaussians = |x: f32| {
            let parts = GaussianParts {
                means: vec![[0.0; 3], [x, 2.0, -3.0]],
                quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 2],
                log_scales: vec![[-1.0; 3]; 2],
                opacity_logits: vec![0.5; 2],
                sh_degree: 0,
                sh: vec![[0.25; 3]; 2],
                ..GaussianParts::default()
            };
            Gaussians::new(parts).unwrap()
        };
        let folder = tempfile::tempdir().unwrap();
        let [spz, ply] = ["fitted.spz", "fitted.spz.ply"].map(|name| folder.path().join(name));
        assert_eq!(write_gaussians(&spz, &gaussians(1.0)).unwrap(), Vec::<String>::new());
        assert!(spz.is_file() && !ply.exists());
        std::fs::remove_file(&spz).unwrap();
        let error = format!("{:#}", write_gaussians(&spz, &gaussians(1e7)).unwrap_err());
        let expected = "fitted.spz.ply contains the Gaussians instead: ";
        let cause = "expected centres within ±8388607, found one beyond";
        assert!(error.contains(expected) && error.ends_with(cause), "{error}");
        assert!(!spz.exists());
        assert_eq!(files::read(&ply).unwrap().0, gaussians(1e7));
    }
}
