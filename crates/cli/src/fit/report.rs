//! Live progress and plots.

use std::path::Path;

use atsplat_fit::density::Changes;
use atsplat_fit::{Evaluation, Fit, Score, StepRecord, TrainingView, nearest_view_psnr};
use atsplat_pixels::{Image, Rounding};
use atsplat_report::plot::{ContactRow, ContactSheet, LearningCurve, PlotFormat};

use crate::output::PendingFile;
use crate::plot::write_both;
use crate::progress::StepProgress;

/// Views on the contact sheet.
const SHEET_VIEWS: usize = 6;

/// Follows a run: progress, curves and held-out views.
pub(super) struct Log<'a> {
    held_out: &'a [TrainingView],
    every: u64,
    progress: StepProgress,
    pub(super) steps: Vec<u64>,
    l1: Vec<Option<f64>>,
    d_ssim: Vec<Option<f64>>,
    total: Vec<Option<f64>>,
    /// PSNR of the last step on each training view.
    training: Vec<Option<f64>>,
    pub(super) evaluations: Vec<Evaluation>,
    changes: Changes,
}

impl<'a> Log<'a> {
    pub(super) fn new(fit: &Fit, held_out: &'a [TrainingView], every: Option<u64>, views: usize) -> Self {
        let steps = fit.config().steps;
        Self {
            held_out,
            // Not just after a reset of opacities, which comes every tenth of a run.
            every: every.unwrap_or_else(|| (steps / 8).max(1)),
            progress: StepProgress::new(steps, 0),
            steps: Vec::new(),
            l1: Vec::new(),
            d_ssim: Vec::new(),
            total: Vec::new(),
            training: vec![None; views],
            evaluations: Vec::new(),
            changes: Changes::default(),
        }
    }

    pub(super) fn step(&mut self, fit: &mut Fit, record: &StepRecord) -> anyhow::Result<()> {
        self.steps.push(record.step);
        self.l1.push(Some(record.terms.l1));
        self.d_ssim.push(Some(record.terms.d_ssim));
        self.total.push(Some(record.terms.total));
        if let Some(slot) = self.training.get_mut(record.view) {
            *slot = Some(record.psnr());
        }
        if record.changes != Changes::default() {
            self.changes = record.changes;
        }
        let psnr = self.training_psnr().unwrap_or(f64::NAN);
        let line = format!("loss {:.4}, {psnr:.2} dB, {} Gaussians", record.terms.total, record.gaussians);
        // Of a number of seconds, the number of steps is planned again and again.
        self.progress.reach(record.step, fit.config().steps, line);
        if record.step.is_multiple_of(self.every) {
            self.evaluate(fit)?;
        }
        Ok(())
    }

    /// Scores the held-out views, unless that was just done.
    pub(super) fn evaluate(&mut self, fit: &mut Fit) -> anyhow::Result<()> {
        let step = fit.step_count();
        if self.held_out.is_empty() || self.evaluations.last().is_some_and(|last| last.step == step) {
            return Ok(());
        }
        let Score { psnr, ssim } = fit.mean_score(self.held_out)?;
        self.evaluations.push(Evaluation { step, gaussians: fit.len(), psnr, ssim });
        let Changes { cloned, split, pruned, relocated, added, .. } = self.changes;
        self.progress.print(&format!(
            "after {step} steps: {psnr:.2} dB, SSIM {ssim:.3} on {} held-out views; {} Gaussians; last change: {cloned} \
             cloned, {split} split, {pruned} pruned, {relocated} relocated, {added} added",
            self.held_out.len(),
            fit.len()
        ));
        Ok(())
    }

    /// Mean PSNR of the last step on each training view; `None` before the first step.
    pub(super) fn training_psnr(&self) -> Option<f64> {
        let known: Vec<f64> = self.training.iter().flatten().copied().collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    }

    /// Writes the learning curve and a contact sheet: pictures above, renders below.
    pub(super) fn draw(&self, folder: &Path, fit: &mut Fit, training: &[TrainingView]) -> anyhow::Result<()> {
        let nearest = nearest_view_psnr(self.held_out, training);
        let evaluations: Vec<_> = nearest.map_or_else(Vec::new, |nearest| {
            self.evaluations.iter().map(|evaluation| (evaluation.step, evaluation.psnr, nearest)).collect()
        });
        let losses = [("total", self.total.clone()), ("L1", self.l1.clone()), ("D-SSIM", self.d_ssim.clone())];
        let title = format!("{}, {} steps", fit.config().strategy.name(), fit.step_count());
        let (kind, shown) = if self.held_out.is_empty() { ("training", training) } else { ("held-out", self.held_out) };
        let curve = LearningCurve {
            title: &title,
            subtitle: &format!("{} training and {} held-out views", training.len(), self.held_out.len()),
            steps: &self.steps,
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
