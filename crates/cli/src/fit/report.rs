//! Live progress and plots.

use std::path::Path;

use atsplat_fit::density::Changes;
use atsplat_fit::loss::Terms;
use atsplat_fit::{Evaluation, Fit, StepRecord, TrainingView, nearest_view_psnr};
use atsplat_pixels::{Image, Rounding};
use atsplat_report::plot::{ContactRow, ContactSheet, LearningCurve, PlotFormat};

use crate::paths::PendingFile;
use crate::plot::write_both;
use crate::progress::StepProgress;

/// Views on the contact sheet.
const SHEET_VIEWS: usize = 6;

/// Follows a run: progress and held-out views.
pub(super) struct Log<'a> {
    held_out: &'a [TrainingView],
    every: u64,
    progress: StepProgress,
}

impl<'a> Log<'a> {
    pub(super) fn new(fit: &Fit, held_out: &'a [TrainingView], every: Option<u64>) -> Self {
        let steps = fit.config().steps;
        Self {
            held_out,
            // Not just after a reset of opacities, which happens at every tenth of a run.
            every: every.unwrap_or_else(|| (steps / 8).max(1)),
            progress: StepProgress::new(steps, fit.step_count()),
        }
    }

    pub(super) fn step(&mut self, fit: &mut Fit, record: &StepRecord) -> anyhow::Result<()> {
        let psnr = fit.history().training_psnr().unwrap_or(f64::NAN);
        let line = format!("loss {:.4}, {psnr:.2} dB, {} Gaussians", record.terms.total, record.gaussians);
        // With --seconds, the planned number of steps changes during the run.
        self.progress.reach(record.step, fit.config().steps, line);
        if record.step.is_multiple_of(self.every) {
            self.evaluate(fit)?;
        }
        Ok(())
    }

    /// Scores the held-out views, unless they were scored after this step already.
    pub(super) fn evaluate(&self, fit: &mut Fit) -> anyhow::Result<()> {
        let Some(Evaluation { step, gaussians, psnr, ssim }) = fit.evaluate(self.held_out)? else { return Ok(()) };
        let Changes { cloned, split, pruned, relocated, added, .. } = fit.history().changes;
        self.progress.print(&format!(
            "after {step} steps: {psnr:.2} dB, SSIM {ssim:.3} on {} held-out views; {gaussians} Gaussians; last \
             change: {cloned} cloned, {split} split, {pruned} pruned, {relocated} relocated, {added} added",
            self.held_out.len()
        ));
        Ok(())
    }

    /// Writes the learning curve and a contact sheet: images above, renders below.
    pub(super) fn draw(&self, folder: &Path, fit: &mut Fit, training: &[TrainingView]) -> anyhow::Result<()> {
        let nearest = nearest_view_psnr(self.held_out, training);
        let history = fit.history();
        let evaluations: Vec<_> =
            history.evaluations.iter().map(|evaluation| (evaluation.step, evaluation.psnr, nearest)).collect();
        let steps: Vec<u64> = (1..=fit.step_count()).collect();
        let losses_by =
            |term: fn(&Terms) -> f64| history.losses.iter().map(|terms| Some(term(terms))).collect::<Vec<_>>();
        let losses = [
            ("total", losses_by(|terms| terms.total)),
            ("L1", losses_by(|terms| terms.l1)),
            ("D-SSIM", losses_by(|terms| terms.d_ssim)),
        ];
        let title = format!("{}, {} steps", fit.config().strategy.name(), fit.step_count());
        let (kind, shown) = if self.held_out.is_empty() { ("training", training) } else { ("held-out", self.held_out) };
        let curve = LearningCurve {
            title: &title,
            subtitle: &format!("{} training and {} held-out views", training.len(), self.held_out.len()),
            steps: &steps,
            losses: &losses,
            evaluations: &evaluations,
        };
        write_both(folder, "learning-curve", &curve.draw())?;
        let mut rows = Vec::new();
        for view in shown.iter().take(SHEET_VIEWS) {
            let size = view.view.size;
            let image = |rgb: Vec<[f32; 3]>| {
                Image::new(size.width, size.height, rgb.into_flattened())?.to_u8(Rounding::Nearest)
            };
            let targets = vec![[image(fit.render(&view.view)?.rgb)?, image(view.rgb.clone())?]];
            let label = format!("{}, {:.2} dB", view.name, fit.score(view)?.psnr);
            rows.push(ContactRow { label, context: Vec::new(), targets });
        }
        let subtitle = format!("{} of {} {kind} views", rows.len(), shown.len());
        let sheet = ContactSheet { title, subtitle, rows }.draw().encode(PlotFormat::Png)?;
        PendingFile::open(&folder.join("contact-sheet.png"))?.finish(&sheet)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_fit::start::in_frustums;
    use atsplat_fit::{FitConfig, Strategy};
    use atsplat_splat::View;
    use glam::{DMat3, DVec3};

    use super::*;

    fn view(x: f64, side: u32, grey: f32) -> TrainingView {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
        let view = View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: side, height: side } };
        TrainingView { name: format!("x = {x}"), rgb: vec![[grey; 3]; view.pixels()], view }
    }

    #[test]
    fn held_out_photos_of_another_size_are_on_the_curve() {
        let training = vec![view(0.0, 24, 0.5), view(0.5, 24, 0.75)];
        for (side, has_baseline) in [(24, true), (16, false)] {
            let held_out = [view(0.125, side, 0.625)];
            let start = in_frustums(&training, 50, Some([1.0, 4.0]), 0, Strategy::Fixed).unwrap();
            let mut fit = Fit::new(FitConfig::new(Strategy::Fixed, 1), training.clone(), &start).unwrap();
            fit.step().unwrap();
            let log = Log::new(&fit, &held_out, None);
            log.evaluate(&mut fit).unwrap();
            let folder = tempfile::tempdir().unwrap();
            log.draw(folder.path(), &mut fit, &training).unwrap();
            let curve = std::fs::read_to_string(folder.path().join("learning-curve.svg")).unwrap();
            let is_drawn = |series: &str| curve.contains(&format!("data-role=\"data\" data-series=\"{series}\""));
            let drawn = (is_drawn("renders"), is_drawn("nearest context view"));
            assert_eq!(drawn, (true, has_baseline), "held-out photos of {side}×{side} pixels");
        }
    }
}
