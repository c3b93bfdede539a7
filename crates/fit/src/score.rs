//! How well renders of a scene match images.

use atsplat_numeric::mean;
use serde::Serialize;

use crate::checkpoint::views_hash;
use crate::loss::PhotometricLoss;
use crate::{Fit, FitError, TrainingView};

/// How well an image matches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// PSNR of colours clamped to [0, 1], not rounded to 8 bits; in dB.
    pub psnr: f64,
    /// SSIM as the loss computes it.
    pub ssim: f64,
}

impl Score {
    /// Compares an image with that of a view of its size.
    pub(crate) fn of(rgb: &[[f32; 3]], view: &TrainingView, loss: &mut PhotometricLoss) -> Self {
        let terms = loss.evaluate(rgb, &view.rgb, view.view.size, 1.0, &mut Vec::new());
        Self { psnr: psnr(terms.mse), ssim: 1.0 - terms.d_ssim }
    }
}

/// In dB, of values in [0, 1].
pub(crate) fn psnr(mse: f64) -> f64 {
    -10.0 * mse.log10()
}

/// Mean scores of held-out views after some steps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
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
pub struct ScaleEvaluation {
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
    /// Compares the render of a view with its image.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn score(&mut self, view: &TrainingView) -> Result<Score, FitError> {
        view.check()?;
        let rendering = self.render(&view.view)?;
        Ok(Score::of(&rendering.rgb, view, &mut self.loss))
    }

    /// Compares with the held-out views, always the same ones, and adds the scores to the [history](Self::history). `None` if there
    /// are no views, or if they were compared after this step already.
    ///
    /// # Errors
    /// As [`Self::score`].
    pub fn evaluate(&mut self, held_out: &[TrainingView]) -> Result<Option<Evaluation>, FitError> {
        let step = self.step;
        if held_out.is_empty() || self.history.evaluations.last().is_some_and(|last| last.step == step) {
            return Ok(None);
        }
        let Score { psnr, ssim } = self.mean_score(held_out)?;
        let evaluation = Evaluation { step, gaussians: self.len(), psnr, ssim };
        self.history.add_evaluation(evaluation, views_hash(held_out));
        Ok(Some(evaluation))
    }

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
    pub fn at_scales(&mut self, scaled: &[(f64, Vec<TrainingView>)]) -> Result<Vec<ScaleEvaluation>, FitError> {
        let mut rows = Vec::new();
        for (scale, views) in scaled {
            let Some(size) = views.first().map(|view| view.view.size) else { continue };
            let Score { psnr, ssim } = self.mean_score(views)?;
            rows.push(ScaleEvaluation { scale: *scale, width: size.width, height: size.height, psnr, ssim });
        }
        Ok(rows)
    }
}

/// Mean PSNR of copying the training image of the nearest camera; `None` without held-out views, or for images of other
/// sizes.
pub fn nearest_view_psnr(held_out: &[TrainingView], training: &[TrainingView]) -> Option<f64> {
    let centre = |view: &TrainingView| view.view.camera.camera_from_world.inverse().centre();
    let of_nearest = |view: &TrainingView| {
        let distance = |other: &&TrainingView| centre(other).distance(centre(view));
        let nearest = training.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let pairs = nearest.rgb.as_flattened().iter().zip(view.rgb.as_flattened());
        let squared: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let same = nearest.view.size == view.view.size;
        same.then(|| psnr(squared / (3.0 * view.rgb.len() as f64)))
    };
    mean(held_out.iter().map(of_nearest).collect::<Option<Vec<f64>>>()?)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;
    use atsplat_splat::View;
    use glam::{DMat3, DVec3};

    use super::*;

    /// A grey image of two pixels, seen from a place on the x axis.
    fn view(x: f64, grey: f32) -> TrainingView {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
        let size = ImageSize { width: 2, height: 1 };
        TrainingView {
            name: format!("x = {x}"),
            view: View { camera: Camera::pinhole(pose, intrinsics), size },
            rgb: vec![[grey; 3]; 2],
        }
    }

    #[test]
    fn the_nearest_view_is_the_one_of_the_nearest_camera() {
        let training = [view(0.0, 0.0), view(10.0, 0.5)];
        let psnr = nearest_view_psnr(&[view(7.0, 0.6), view(-3.0, 0.01)], &training).unwrap();
        Tolerance::absolute(1e-4).assert([psnr], [30.0], "20 dB to the second view, 40 dB to the first");
        assert_eq!(nearest_view_psnr(&[], &training), None);
        let mut other = view(7.0, 0.6);
        other.view.size.height = 2;
        assert_eq!(nearest_view_psnr(&[other], &training), None, "of another size");
    }
}
