//! How well a scene matches views that it was not optimised on.

use serde::Serialize;

use crate::{Fit, FitError, Score, TrainingView};

/// Mean scores of held-out views after some steps.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Evaluation {
    /// Steps done.
    pub step: u64,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// As [`Score::psnr`].
    pub psnr: f64,
    /// As [`Score::ssim`].
    pub ssim: f64,
}

/// Mean scores of held-out views at a multiple of their size.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct AtScale {
    /// The multiple.
    pub scale: f64,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// As [`Score::psnr`].
    pub psnr: f64,
    /// As [`Score::ssim`].
    pub ssim: f64,
}

impl Fit {
    /// Means over views; NaN for none.
    ///
    /// # Errors
    /// As [`Self::score`].
    pub fn mean_score(&mut self, views: &[TrainingView]) -> Result<Score, FitError> {
        let scores = views.iter().map(|view| self.score(view)).collect::<Result<Vec<Score>, _>>()?;
        let mean = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
        Ok(Score { psnr: mean(|score| score.psnr), ssim: mean(|score| score.ssim) })
    }

    /// Means over views at each multiple of their size.
    ///
    /// # Errors
    /// As [`Self::score`].
    pub fn at_scales(&mut self, scaled: &[(f64, Vec<TrainingView>)]) -> Result<Vec<AtScale>, FitError> {
        let mut rows = Vec::new();
        for (scale, views) in scaled {
            let Some(size) = views.first().map(|view| view.view.size) else { continue };
            let Score { psnr, ssim } = self.mean_score(views)?;
            rows.push(AtScale { scale: *scale, width: size.width, height: size.height, psnr, ssim });
        }
        Ok(rows)
    }
}

/// Mean PSNR of copying the training picture of the nearest camera; `None` without held-out views, or for pictures of other
/// sizes.
pub fn nearest_view_psnr(held_out: &[TrainingView], training: &[TrainingView]) -> Option<f64> {
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
