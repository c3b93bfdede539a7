//! Live progress, the record next to the scene file, and plots.

use std::fmt;
use std::io::{IsTerminal as _, stderr};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use atsplat_fit::density::Changes;
use atsplat_fit::{Fit, FitConfig, Score, StepRecord, TrainingView};
use atsplat_pixels::{Image, Rounding};
use atsplat_report::plot::{ContactRow, ContactSheet, LearningCurve, PlotFormat};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde::Serialize;

use crate::output::{PendingFile, warn};

/// Interval of lines if standard error is not a terminal.
const LOG_INTERVAL: Duration = Duration::from_secs(30);
/// Views on the contact sheet.
const SHEET_VIEWS: usize = 6;

/// Mean scores of the held-out views after some steps.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Evaluation {
    pub(super) step: u64,
    pub(super) gaussians: usize,
    pub(super) psnr: f64,
    pub(super) ssim: f64,
}

/// Scores of the held-out views at a multiple of their size.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct AtScale {
    pub(super) scale: f64,
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) psnr: f64,
    pub(super) ssim: f64,
}

/// Scores the held-out views at each scale.
pub(super) fn at_scales(fit: &mut Fit, scaled: &[(f64, Vec<TrainingView>)]) -> anyhow::Result<Vec<AtScale>> {
    let mut rows = Vec::new();
    for (scale, views) in scaled {
        let Some(size) = views.first().map(|view| view.view.size) else { continue };
        let Score { psnr, ssim } = mean_score(fit, views)?;
        rows.push(AtScale { scale: *scale, width: size.width, height: size.height, psnr, ssim });
    }
    Ok(rows)
}

fn mean_score(fit: &mut Fit, views: &[TrainingView]) -> anyhow::Result<Score> {
    let scores = views.iter().map(|view| fit.score(view)).collect::<Result<Vec<Score>, _>>()?;
    let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
    Ok(Score { psnr: mean(|score| score.psnr), ssim: mean(|score| score.ssim) })
}

/// Everything that the Gaussians depend on, and how good they are. Independent of date and speed of the machine, unless the
/// budget was a time.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Record {
    pub(super) atsplat: &'static str,
    pub(super) data: PathBuf,
    pub(super) scene: String,
    pub(super) views: Vec<String>,
    pub(super) held_out: Vec<String>,
    pub(super) start: String,
    pub(super) start_gaussians: usize,
    /// Gaussians of the start that were invalid, and dropped.
    pub(super) dropped: usize,
    pub(super) extent: f64,
    pub(super) configuration: FitConfig,
    /// Graphics adapter and driver, or `cpu`.
    pub(super) device: String,
    pub(super) steps: u64,
    pub(super) file: PathBuf,
    pub(super) gaussians: usize,
    /// Of the training views, if cameras or exposures were optimised.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) corrections: Vec<Correction>,
    /// Mean PSNR of the last step on each training view, in dB.
    pub(super) training_psnr: Option<f64>,
    pub(super) evaluations: Vec<Evaluation>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) at_scales: Vec<AtScale>,
}

/// What was optimised for one view.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Correction {
    pub(super) view: String,
    /// Row-major 3×4 matrix.
    pub(super) camera_from_world: Vec<f64>,
    /// As 3DGS stores it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) exposure: Option<[[f64; 4]; 3]>,
}

/// The printed report.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Report {
    #[serde(flatten)]
    pub(super) record: Record,
    pub(super) seconds: f64,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Record { scene, views, configuration, device, steps, file, gaussians, training_psnr, evaluations, .. } =
            &self.record;
        let strategy = configuration.strategy.name();
        let (views, seconds) = (views.len(), self.seconds);
        writeln!(f, "scene {scene}, {views} views, {strategy}, {steps} steps in {seconds:.1} s on {device}")?;
        writeln!(f, "{gaussians} Gaussians into {}", file.display())?;
        if let Some(psnr) = training_psnr {
            writeln!(f, "{psnr:.2} dB on the training views")?;
        }
        if let Some(Evaluation { psnr, ssim, .. }) = evaluations.last() {
            writeln!(f, "{psnr:.2} dB, SSIM {ssim:.3} on {} held-out views", self.record.held_out.len())?;
        }
        for AtScale { scale, width, height, psnr, ssim } in &self.record.at_scales {
            writeln!(f, "{psnr:.2} dB, SSIM {ssim:.3} on them at {scale} times their size, {width}x{height}")?;
        }
        Ok(())
    }
}

/// Follows a run: progress, curves and held-out views.
pub(super) struct Log<'a> {
    held_out: &'a [TrainingView],
    every: u64,
    bar: ProgressBar,
    plain: bool,
    last_line: Instant,
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
        let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr());
        if let Ok(style) = ProgressStyle::with_template("{bar:24} {pos}/{len} {msg}") {
            bar.set_style(style);
        }
        Self {
            held_out,
            // Not just after a reset of opacities, which comes every tenth of a run.
            every: every.unwrap_or_else(|| (steps / 8).max(1)),
            bar,
            plain: !stderr().is_terminal(),
            last_line: Instant::now(),
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
        self.bar.set_length(fit.config().steps);
        self.bar.set_position(record.step);
        if self.plain && self.last_line.elapsed() >= LOG_INTERVAL {
            self.last_line = Instant::now();
            warn(&format!("step {}/{} {line}", record.step, fit.config().steps));
        }
        self.bar.set_message(line);
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
        let Score { psnr, ssim } = mean_score(fit, self.held_out)?;
        self.evaluations.push(Evaluation { step, gaussians: fit.len(), psnr, ssim });
        let Changes { cloned, split, pruned, relocated, added, .. } = self.changes;
        let text = format!(
            "after {step} steps: {psnr:.2} dB, SSIM {ssim:.3} on {} held-out views; {} Gaussians; last change: {cloned} \
             cloned, {split} split, {pruned} pruned, {relocated} relocated, {added} added",
            self.held_out.len(),
            fit.len()
        );
        if self.plain {
            warn(&text);
        } else {
            self.bar.println(text);
        }
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
        for format in [PlotFormat::Svg, PlotFormat::Png] {
            let file = folder.join(format!("learning-curve.{}", format.extension()));
            PendingFile::open(&file)?.finish(&curve.draw().encode(format)?)?;
        }
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

impl Drop for Log<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

/// Mean PSNR of copying the training picture of the nearest camera; `None` without held-out views, or for pictures of other
/// sizes.
fn nearest_view_psnr(held_out: &[TrainingView], training: &[TrainingView]) -> Option<f64> {
    let centre = |view: &TrainingView| view.view.camera.camera_from_world.inverse().centre();
    let psnr = |view: &TrainingView| {
        let distance = |other: &&TrainingView| centre(other).distance(centre(view));
        let nearest = training.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let pairs = nearest.rgb.as_flattened().iter().zip(view.rgb.as_flattened());
        let squared: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let same = nearest.view.size == view.view.size;
        same.then(|| -10.0 * (squared / (3.0 * view.rgb.len() as f64)).log10())
    };
    let all = held_out.iter().map(psnr).collect::<Option<Vec<f64>>>().filter(|all| !all.is_empty())?;
    Some(all.iter().sum::<f64>() / all.len() as f64)
}
