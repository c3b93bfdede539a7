//! How well renders of a scene match images.

use std::fmt;

use atsplat_camera::ImageSize;
use atsplat_metrics::ssim::{Ssim, ssim};
use atsplat_metrics::{MetricError, Pair, Score as PairScore, Values, mean_squared_error, psnr_of_mean_squared_error};
use atsplat_numeric::mean;
use atsplat_pixels::Image;
use serde::Serialize;

use crate::checkpoint::views_hash;
use crate::{Fit, FitError, TrainingView};

/// How well a render matches an image, by the metrics `psnr` and `ssim` of tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Score {
    /// The two have the same bits.
    Identical,
    /// The render is not finite.
    NotFinite,
    /// The others.
    Compared {
        /// PSNR of colours clamped to [0, 1], not rounded to 8 bits; in dB. `None` if clamping makes them equal.
        psnr: Option<f64>,
        /// SSIM of skimage with a Gaussian window, of colours as rendered; `None` for images of fewer than 11 pixels a side.
        ssim: Option<f64>,
    },
}

impl Score {
    /// Compares an image with that of a view of its size.
    ///
    /// # Errors
    /// [`FitError::View`] for images of other sizes.
    pub(crate) fn of(rgb: &[[f32; 3]], view: &TrainingView) -> Result<Self, FitError> {
        let ImageSize { width, height } = view.view.size;
        let wrong = |error: &dyn fmt::Display| FitError::View {
            name: view.name.clone(),
            expected: format!("images of {width}×{height} pixels"),
            found: error.to_string(),
        };
        let image =
            |rgb: &[[f32; 3]]| Image::new(width, height, rgb.as_flattened().to_vec()).map_err(|error| wrong(&error));
        let (render, truth) = (image(rgb)?, image(&view.rgb)?);
        let pair = match Pair::new(&render, &truth) {
            Ok(pair) => pair,
            Err(MetricError::NonFinite(_)) => return Ok(Self::NotFinite),
            Err(error) => return Err(wrong(&error)),
        };
        if pair.is_identical() {
            return Ok(Self::Identical);
        }
        // The only error is that no window fits.
        let ssim = ssim(&pair, Values::AsRendered, Ssim::SKIMAGE_GAUSSIAN).ok();
        Ok(Self::Compared { psnr: psnr(mean_squared_error(&pair, Values::Clipped)), ssim })
    }

    /// PSNR in dB; `None` for equal images, and for a render that is not finite.
    pub const fn psnr(&self) -> Option<f64> {
        match self {
            Self::Compared { psnr, .. } => *psnr,
            Self::Identical | Self::NotFinite => None,
        }
    }
}

/// The PSNR, or why there is none.
impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Compared { psnr: Some(psnr), .. } => write!(f, "{psnr:.2} dB"),
            Self::Compared { psnr: None, .. } => f.write_str("equal once clamped"),
            Self::Identical => f.write_str("identical"),
            Self::NotFinite => f.write_str("not finite"),
        }
    }
}

/// Mean scores of views. As in tables, views whose render is identical to their image are counted and left out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeanScore {
    /// Mean PSNR of the views that differ from their image after clamping; `None` if there is none, or if a render is not finite.
    pub psnr: Option<f64>,
    /// Mean SSIM of the views that are not identical; `None` if there is none, or if one of them has no SSIM.
    pub ssim: Option<f64>,
    /// How many views were left out of both.
    pub identical: usize,
    /// How many views were left out of the mean PSNR alone, because clamping makes them equal.
    #[serde(skip_serializing_if = "is_zero")]
    pub equal_when_clamped: usize,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes fields by reference")]
const fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl MeanScore {
    fn of(scores: &[Score]) -> Self {
        let compared = || {
            scores.iter().filter_map(|score| match score {
                Score::Compared { psnr, ssim } => Some((*psnr, *ssim)),
                Score::Identical | Score::NotFinite => None,
            })
        };
        let is_finite = !scores.contains(&Score::NotFinite);
        let psnrs = MeanPsnr::of(compared().map(|(psnr, _)| psnr));
        let ssims: Option<Vec<f64>> = compared().map(|(_, ssim)| ssim).collect();
        Self {
            psnr: psnrs.mean.filter(|_| is_finite),
            ssim: ssims.filter(|_| is_finite).and_then(mean),
            identical: scores.iter().filter(|score| **score == Score::Identical).count(),
            equal_when_clamped: psnrs.equal,
        }
    }

    /// In words, such as `28.53 dB, SSIM 0.888 on 7 held-out views` of what is scored.
    pub fn on(&self, views: &str) -> String {
        let ssim = self.ssim.map_or_else(|| "no SSIM".to_owned(), |ssim| format!("SSIM {ssim:.3}"));
        let left_out = [
            (self.identical, "identical to the photo, left out"),
            (self.equal_when_clamped, "equal to the photo once clamped, left out of the PSNR"),
        ];
        let left_out = left_out.iter().filter(|(count, _)| *count > 0);
        let left_out: Vec<String> = left_out.map(|(count, what)| format!("{count} {what}")).collect();
        let left_out = if left_out.is_empty() { String::new() } else { format!(" ({})", left_out.join("; ")) };
        format!("{}, {ssim} on {views}{left_out}", decibels(self.psnr))
    }
}

/// A PSNR in words.
pub(crate) fn decibels(psnr: Option<f64>) -> String {
    psnr.map_or_else(|| "no PSNR".to_owned(), |psnr| format!("{psnr:.2} dB"))
}

/// A mean of PSNRs, without those of equal images.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeanPsnr {
    /// In dB; `None` without any.
    pub(crate) mean: Option<f64>,
    /// How many the mean is over.
    pub(crate) views: usize,
    /// How many were left out.
    pub(crate) equal: usize,
}

impl MeanPsnr {
    /// `None` is the PSNR of equal images.
    pub(crate) fn of(psnrs: impl IntoIterator<Item = Option<f64>>) -> Self {
        let (mut finite, mut equal) = (Vec::new(), 0);
        for psnr in psnrs {
            match psnr {
                Some(psnr) => finite.push(psnr),
                None => equal += 1,
            }
        }
        let views = finite.len();
        Self { mean: mean(finite), views, equal }
    }
}

/// In dB, of values in [0, 1]; `None` for equal images, whose PSNR is infinite; NaN for an error that is not finite.
pub(crate) fn psnr(mse: f64) -> Option<f64> {
    match psnr_of_mean_squared_error(mse) {
        PairScore::NotComputed(_) => Some(f64::NAN),
        score => score.value(),
    }
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
        Score::of(&rendering.rgb, view)
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
        self.history.add_evaluation(evaluation, || views_hash(held_out));
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
    MeanPsnr::of(held_out.iter().map(of_nearest).collect::<Option<Vec<Option<f64>>>>()?).mean
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
        let score = Score::of(&[[1.25; 3]; 13 * 12], &truth).unwrap();
        let Score::Compared { psnr: Some(psnr), ssim: Some(ssim) } = score else { panic!("{score:?}") };
        let (a, b) = (1.25, 0.75);
        let luminance = (2.0 * a * b + 1e-4) / (a * a + b * b + 1e-4);
        Tolerance::absolute(1e-6).assert([ssim], [luminance], "SSIM as rendered");
        Tolerance::absolute(1e-6).assert([psnr], [-20.0 * 0.25_f64.log10()], "PSNR of the clamped colour");
        let small = Score::of(&[[0.5; 3]; 2], &view(0.0, 0.25)).unwrap();
        assert!(matches!(small, Score::Compared { psnr: Some(_), ssim: None }), "no window fits: {small:?}");
        let broken = Score::of(&[[f32::NAN; 3]; 2], &view(0.0, 0.25)).unwrap();
        assert_eq!(broken, Score::NotFinite);
        let error = Score::of(&[[0.5; 3]; 3], &view(0.0, 0.25)).unwrap_err().to_string();
        assert!(error.starts_with("view x = 0: expected images of 2×1 pixels, found "), "{error}");
    }

    /// The first render is exact, the second only after clamping, which leaves its SSIM as it is.
    #[test]
    fn identical_views_are_counted_and_left_out_of_means() {
        let score = |psnr: Option<f64>, ssim: f64| Score::Compared { psnr, ssim: Some(ssim) };
        let clamped = Score::of(&[[1.25; 3]; 2], &view(0.0, 1.0)).unwrap();
        assert_eq!(
            (clamped, clamped.to_string().as_str()),
            (Score::Compared { psnr: None, ssim: None }, "equal once clamped")
        );
        let others = [score(None, 0.5), score(Some(20.0), 0.25), score(Some(30.0), 0.75)];
        let means = MeanScore::of(&[&[Score::Identical; 2][..], &others[..]].concat());
        let expected = MeanScore { psnr: Some(25.0), ssim: Some(0.5), identical: 2, equal_when_clamped: 1 };
        assert_eq!(means, expected);
        let text = "25.00 dB, SSIM 0.500 on 5 views (2 identical to the photo, left out; 1 equal to the photo once clamped, left \
                    out of the PSNR)";
        assert_eq!(means.on("5 views"), text);
        let all = MeanScore::of(&[Score::Identical; 2]);
        assert_eq!(all, MeanScore { identical: 2, ..MeanScore::default() });
        assert_eq!(all.on("them"), "no PSNR, no SSIM on them (2 identical to the photo, left out)");
        let means = MeanScore::of(&[score(Some(20.0), 0.25), Score::NotFinite]);
        assert_eq!(means, MeanScore::default(), "a mean over the other view alone would hide it");
        assert_eq!(Score::of(&view(0.0, 0.25).rgb, &view(0.0, 0.25)).unwrap(), Score::Identical);
    }
}
