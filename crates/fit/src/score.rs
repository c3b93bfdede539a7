//! How well renders of a scene match images.

use atsplat_camera::ImageSize;
use atsplat_metrics::ssim::{Ssim, ssim};
use atsplat_metrics::{Pair, Values, mean_squared_error};
use atsplat_numeric::mean;
use atsplat_pixels::Image;
use serde::Serialize;

use crate::checkpoint::views_hash;
use crate::{Fit, FitError, TrainingView};

/// How well an image matches, by the metrics `psnr` and `ssim` of tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// PSNR of colours clamped to [0, 1], not rounded to 8 bits; in dB. Infinite for equal ones, NaN for a render that is not finite.
    pub psnr: f64,
    /// SSIM of skimage with a Gaussian window, of colours as rendered; `None` for images of fewer than 11 pixels a side, and for a
    /// render that is not finite.
    pub ssim: Option<f64>,
    /// Whether the render and the image have the same bits.
    pub is_identical: bool,
}

impl Score {
    /// Compares an image with that of a view of its size.
    pub(crate) fn of(rgb: &[[f32; 3]], view: &TrainingView) -> Self {
        let ImageSize { width, height } = view.view.size;
        let image = |rgb: &[[f32; 3]]| Image::new(width, height, rgb.as_flattened().to_vec()).ok();
        let images = image(rgb).zip(image(&view.rgb));
        let pair = images.as_ref().and_then(|(render, truth)| Pair::new(render, truth).ok());
        pair.map_or(Self { psnr: f64::NAN, ssim: None, is_identical: false }, |pair| Self {
            psnr: psnr(mean_squared_error(&pair, Values::Clipped)),
            ssim: ssim(&pair, Values::AsRendered, Ssim::SKIMAGE_GAUSSIAN).ok(),
            is_identical: pair.is_identical(),
        })
    }
}

/// Mean scores of views. As in tables, views whose render is identical to their image are counted and left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeanScore {
    /// Mean of [`Score::psnr`] without those of equal images; `None` if none is left, or if a render is not finite.
    pub psnr: Option<f64>,
    /// Mean of [`Score::ssim`]; `None` if no view is left, or if one of them has no SSIM.
    pub ssim: Option<f64>,
    /// How many views were left out.
    pub identical: usize,
}

impl MeanScore {
    fn of(scores: &[Score]) -> Self {
        let counted = || scores.iter().filter(|score| !score.is_identical);
        let ssims: Option<Vec<f64>> = counted().map(|score| score.ssim).collect();
        Self {
            psnr: mean_of_psnrs(counted().map(|score| score.psnr)),
            ssim: ssims.and_then(mean),
            identical: scores.iter().filter(|score| score.is_identical).count(),
        }
    }

    /// In words, such as `28.53 dB, SSIM 0.888 on 7 held-out views` of what is scored.
    pub fn on(&self, views: &str) -> String {
        let ssim = self.ssim.map_or_else(|| "no SSIM".to_owned(), |ssim| format!("SSIM {ssim:.3}"));
        let left_out = match self.identical {
            0 => String::new(),
            count => format!(" ({count} identical to the photo, left out)"),
        };
        format!("{}, {ssim} on {views}{left_out}", decibels(self.psnr))
    }
}

/// A PSNR in words.
pub(crate) fn decibels(psnr: Option<f64>) -> String {
    psnr.map_or_else(|| "no PSNR".to_owned(), |psnr| format!("{psnr:.2} dB"))
}

/// The mean of PSNRs without those of equal images, which are infinite; `None` without any, or if one is NaN.
pub(crate) fn mean_of_psnrs(psnrs: impl Iterator<Item = f64>) -> Option<f64> {
    mean(psnrs.filter(|psnr| !psnr.is_infinite())).filter(|psnr| !psnr.is_nan())
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
    /// The scores.
    #[serde(flatten)]
    pub score: MeanScore,
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
    /// The scores.
    #[serde(flatten)]
    pub score: MeanScore,
}

impl Fit {
    /// Compares the render of a view with its image.
    ///
    /// # Errors
    /// As [`Self::render`].
    pub fn score(&mut self, view: &TrainingView) -> Result<Score, FitError> {
        view.check()?;
        let rendering = self.render(&view.view)?;
        Ok(Score::of(&rendering.rgb, view))
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
        let score = self.mean_score(held_out)?;
        let evaluation = Evaluation { step, gaussians: self.len(), score };
        self.history.add_evaluation(evaluation, views_hash(held_out));
        Ok(Some(evaluation))
    }

    /// Means over views.
    ///
    /// # Errors
    /// As [`Self::score`].
    pub fn mean_score(&mut self, views: &[TrainingView]) -> Result<MeanScore, FitError> {
        let scores = views.iter().map(|view| self.score(view)).collect::<Result<Vec<Score>, _>>()?;
        Ok(MeanScore::of(&scores))
    }

    /// Means over views at each multiple of their size.
    ///
    /// # Errors
    /// As [`Self::score`].
    pub fn at_scales(&mut self, scaled: &[(f64, Vec<TrainingView>)]) -> Result<Vec<ScaleEvaluation>, FitError> {
        let mut rows = Vec::new();
        for (scale, views) in scaled {
            let Some(size) = views.first().map(|view| view.view.size) else { continue };
            let score = self.mean_score(views)?;
            rows.push(ScaleEvaluation { scale: *scale, width: size.width, height: size.height, score });
        }
        Ok(rows)
    }
}

/// Mean PSNR of copying the training image of the nearest camera, without those of equal images; `None` without held-out views, or
/// for images of other sizes.
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
    mean_of_psnrs(held_out.iter().map(of_nearest).collect::<Option<Vec<f64>>>()?.into_iter())
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
        let psnr = nearest_view_psnr(&[view(-3.0, 0.0), view(7.0, 0.6)], &training).unwrap();
        Tolerance::absolute(1e-4).assert([psnr], [20.0], "the first copy is exact");
    }

    /// Only windows inside the image count, and colours are not clamped: zeros around the image and clamped colours give other numbers.
    /// With constant colours, SSIM is its luminance term.
    #[test]
    fn ssim_is_that_of_tables() {
        let size = ImageSize { width: 13, height: 12 };
        let mut truth = view(0.0, 0.75);
        (truth.view.size, truth.rgb) = (size, vec![[0.75; 3]; 13 * 12]);
        let score = Score::of(&[[1.25; 3]; 13 * 12], &truth);
        let (a, b) = (1.25, 0.75);
        let luminance = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
        Tolerance::absolute(1e-6).assert([score.ssim.unwrap()], [luminance], "SSIM as rendered");
        Tolerance::absolute(1e-6).assert([score.psnr], [-20.0 * 0.25_f64.log10()], "PSNR of the clamped colour");
        assert!(!score.is_identical);
        let small = Score::of(&[[0.5; 3]; 2], &view(0.0, 0.25));
        assert_eq!(small.ssim, None, "no window fits");
        let broken = Score::of(&[[f32::NAN; 3]; 2], &view(0.0, 0.25));
        assert!(broken.psnr.is_nan() && broken.ssim.is_none() && !broken.is_identical, "{broken:?}");
    }

    /// The first render is exact, the second only after clamping.
    #[test]
    fn identical_views_are_counted_and_left_out_of_means() {
        let score = |psnr: f64, ssim: f64, is_identical: bool| Score { psnr, ssim: Some(ssim), is_identical };
        let exact = score(f64::INFINITY, 1.0, true);
        let scores = [exact, score(f64::INFINITY, 0.5, false), score(20.0, 0.25, false), score(30.0, 0.75, false)];
        let means = MeanScore::of(&scores);
        assert_eq!(means, MeanScore { psnr: Some(25.0), ssim: Some(0.5), identical: 1 });
        let text = "25.00 dB, SSIM 0.500 on 4 views (1 identical to the photo, left out)";
        assert_eq!(means.on("4 views"), text);
        let all = MeanScore::of(&[exact; 2]);
        assert_eq!(all, MeanScore { psnr: None, ssim: None, identical: 2 });
        assert_eq!(all.on("them"), "no PSNR, no SSIM on them (2 identical to the photo, left out)");
        let broken = Score { psnr: f64::NAN, ssim: None, is_identical: false };
        let means = MeanScore::of(&[score(20.0, 0.25, false), broken]);
        assert_eq!(means, MeanScore::default(), "a mean over the other view alone would hide it");
        let same = Score::of(&view(0.0, 0.25).rgb, &view(0.0, 0.25));
        assert!(same.is_identical && same.psnr.is_infinite(), "{same:?}");
    }
}
