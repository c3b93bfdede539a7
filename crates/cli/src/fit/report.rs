//! Live progress and plots.

use std::path::Path;

use atsplat_fit::density::Changes;
use atsplat_fit::loss::Terms;
use atsplat_fit::{Background, Evaluation, Fit, Schedule, StepRecord, TrainingView, nearest_view_psnr};
use atsplat_pixels::{Image, Rounding};
use atsplat_report::plot::{ContactRow, ContactSheet, LearningCurve, PlotFormat};

use crate::paths::PendingFile;
use crate::plot::write_both;
use crate::progress::StepProgress;

/// Views on the contact sheet.
const SHEET_VIEWS: usize = 6;
/// Comparisons with the held-out photos in a run whose number of steps stays as it is, if no option says how often.
const COMPARISONS: u64 = 8;

/// Follows a run: progress and held-out views.
pub(super) struct Log<'a> {
    held_out: &'a [TrainingView],
    /// Steps between two comparisons, if it was given.
    every: Option<u64>,
    last_reset: Option<u64>,
    progress: StepProgress,
}

impl<'a> Log<'a> {
    pub(super) fn new(fit: &Fit, held_out: &'a [TrainingView], every: Option<u64>) -> Self {
        let (config, done) = (fit.config(), fit.step_count());
        let on_white = config.background == Background::White;
        Self {
            held_out,
            every,
            last_reset: Schedule::of(config.steps).last_reset(config.strategy, on_white, done),
            progress: StepProgress::new(config.steps, done),
        }
    }

    pub(super) fn step(&mut self, fit: &mut Fit, record: &StepRecord) -> anyhow::Result<()> {
        let psnr = fit.history().training_psnr().unwrap_or(f64::NAN);
        let line = format!("loss {:.4}, {psnr:.2} dB, {} Gaussians", record.terms.total, record.gaussians);
        // With --seconds, the planned number of steps changes during the run.
        let (step, steps) = (record.step, fit.config().steps);
        self.progress.reach(step, steps, line);
        if record.changes.reset {
            self.last_reset = Some(step);
        }
        let last = fit.history().evaluations.last().map_or(0, |own| own.step);
        if self.every.map_or_else(|| due(step, steps, last, self.last_reset), |every| step.is_multiple_of(every)) {
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
        let curve = LearningCurve {
            title: &title,
            subtitle: &format!("{} training and {} held-out views", training.len(), self.held_out.len()),
            steps: &steps,
            losses: &losses,
            evaluations: &evaluations,
        };
        write_both(folder, "learning-curve", &curve.draw())?;
        let (kind, shown) = if self.held_out.is_empty() { ("training", training) } else { ("held-out", self.held_out) };
        let rows = self.rows(fit, shown)?;
        let subtitle = format!("{} of {} {kind} views", rows.len(), shown.len());
        let sheet = ContactSheet { title, subtitle, rows }.draw().encode(PlotFormat::Png)?;
        PendingFile::open(&folder.join("contact-sheet.png"))?.finish(&sheet)
    }

    /// The first of the shown views with their renders; training views have their optimised cameras and exposures.
    fn rows(&self, fit: &mut Fit, shown: &[TrainingView]) -> anyhow::Result<Vec<ContactRow>> {
        let mut rows = Vec::new();
        for (number, view) in shown.iter().take(SHEET_VIEWS).enumerate() {
            let size = view.view.size;
            let image = |rgb: Vec<[f32; 3]>| {
                Image::new(size.width, size.height, rgb.into_flattened())?.to_u8(Rounding::Nearest)
            };
            let as_trained = if self.held_out.is_empty() { fit.render_training(number)? } else { None };
            let (rendering, score) = match as_trained {
                Some(own) => own,
                None => (fit.render(&view.view)?, fit.score(view)?),
            };
            let targets = vec![[image(rendering.rgb)?, image(view.rgb.clone())?]];
            let label = format!("{}, {:.2} dB", view.name, score.psnr);
            rows.push(ContactRow { label, context: Vec::new(), targets });
        }
        Ok(rows)
    }
}

/// Whether the held-out photos are compared after a step, if no option says how often: an eighth of the run as it is planned now
/// after the `last` comparison (0 for none), but not before opacities have risen again after a reset.
fn due(step: u64, steps: u64, last: u64, last_reset: Option<u64>) -> bool {
    let has_risen = |reset: u64| step.saturating_sub(reset) >= Schedule::of(steps).reset_every / 2;
    step.saturating_sub(last) >= steps.div_ceil(COMPARISONS) && last_reset.is_none_or(has_risen)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_fit::start::in_frustums;
    use atsplat_fit::{FitConfig, Rates, Strategy};
    use atsplat_numeric::Tolerance;
    use atsplat_splat::View;
    use glam::{DMat3, DVec3};

    use super::*;

    fn view(x: f64, side: u32, grey: f32) -> TrainingView {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
        let view = View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: side, height: side } };
        TrainingView { name: format!("x = {x}"), rgb: vec![[grey; 3]; view.pixels()], view }
    }

    /// Steps after which a run compares that is planned anew as it goes on; the last one always does.
    fn compared(plan: impl Fn(u64) -> u64, strategy: Strategy) -> Vec<u64> {
        let (mut found, mut step) = (Vec::<u64>::new(), 0);
        while step < plan(step) {
            step += 1;
            let (steps, last) = (plan(step), found.last().copied().unwrap_or(0));
            let last_reset = Schedule::of(steps).last_reset(strategy, false, step);
            if due(step, steps, last, last_reset) || step == steps {
                found.push(step);
            }
        }
        found
    }

    #[test]
    fn photos_are_compared_about_eight_times_whatever_the_plan_becomes() {
        let planned =
            |first: u64, then: u64| compared(move |step| if step < 100 { first } else { then }, Strategy::Fixed);
        assert_eq!(planned(400, 400), [50, 100, 150, 200, 250, 300, 350, 400]);
        assert_eq!(planned(15, 15), [2, 4, 6, 8, 10, 12, 14, 15]);
        assert_eq!(planned(3, 3), [1, 2, 3]);
        assert_eq!(planned(250, 700), [32, 64, 96, 184, 272, 360, 448, 536, 624, 700]);
        assert_eq!(planned(4000, 200), [100, 125, 150, 175, 200]);
    }

    /// Every 300 steps opacities are reset, until step 1200.
    #[test]
    fn photos_are_not_compared_just_after_a_reset() {
        assert_eq!(compared(|_| 2400, Strategy::Gaussians3d), [450, 750, 1050, 1350, 1650, 1950, 2250, 2400]);
        assert_eq!(compared(|_| 2400, Strategy::Mcmc), [300, 600, 900, 1200, 1500, 1800, 2100, 2400]);
    }

    /// The next step of a view renders what the sheet shows, before it changes the camera or the exposure.
    #[test]
    fn training_views_are_shown_with_their_cameras_and_exposures() {
        let training = vec![view(0.0, 24, 0.5), view(0.5, 24, 0.75)];
        let start = in_frustums(&training, 50, Some([1.0, 4.0]), 0, Strategy::Fixed).unwrap();
        let (means, final_means, colours, opacities, scales, rotations) = (1e-9, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9);
        let rates = Rates { means, final_means, colours, opacities, scales, rotations };
        for (pose_rate, exposure_rate) in [(Some(0.02), None), (None, Some(0.02))] {
            let config = FitConfig { rates, pose_rate, exposure_rate, ..FitConfig::new(Strategy::Fixed, 100) };
            let mut fit = Fit::new(config, training.clone(), &start).unwrap();
            for _ in 0..60 {
                fit.step().unwrap();
            }
            let rows = Log::new(&fit, &[], None).rows(&mut fit, &training).unwrap();
            let as_given: Vec<f64> = training.iter().map(|view| fit.score(view).unwrap().psnr).collect();
            for _ in &training {
                let step = fit.step().unwrap();
                let label = rows[step.view].label.strip_prefix(&format!("{}, ", training[step.view].name)).unwrap();
                let shown: f64 = label.strip_suffix(" dB").unwrap().parse().unwrap();
                // Shown with two decimals.
                Tolerance::absolute(0.0051).assert([shown], [step.psnr()], label);
                let given = as_given[step.view];
                assert!((shown - given).abs() > 0.02, "{shown} dB, {given} dB with camera and exposure as given");
            }
        }
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
