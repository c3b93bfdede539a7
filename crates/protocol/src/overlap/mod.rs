//! How much two views overlap: three named estimators, each a number in [0, 1] that is the smaller of its two
//! directions. They measure different things: do not mix numbers of different estimators, or the numbers that NoPoSplat
//! publishes (`RoMa` matches, code never released), in one set of bins.
//!
//! Against the true co-visibility of simulated scenes (`atsplat protocol estimators`: 192 pairs of rooms, 192 of yards),
//! rays along epipolar lines have Spearman's rank correlation of 0.49 in rooms and −0.27 in yards, and are too large by 0.33 and
//! 0.58 on average: they ignore occlusion, and around an object in the middle, nearly every ray of one view crosses the other
//! one. Overlaps recorded as `depth-covisibility` have the right order, with 1.00 and 0.98, but are too small, by 0.04 and 0.08 on
//! average and by up to 0.29, and the more so the smaller the depth maps are: on surfaces at a grazing angle, the depth of the
//! nearest pixel was too far from the point's. Those of today's estimator by depth have another name, `depth-covisibility-2x2`.

mod annotate;
mod binned;
mod covisibility;
mod depth_folder;
mod epipolar;

pub(crate) use annotate::context_overlap;
pub use annotate::{OverlapReport, UnmeasuredExample, annotate_overlaps, chain_overlap};
pub use binned::BinnedOverlaps;
pub use covisibility::DepthMap;
pub use depth_folder::{DepthFolder, LoadedDepth, SceneDepths};
pub use epipolar::EpipolarRays;

use atsplat_camera::Camera;
use atsplat_pixels::ImageU8;
use serde::{Deserialize, Serialize};

use crate::ProtocolError;

/// A named definition of overlap with its settings; in TOML and JSON, `estimator = "epipolar-ray"` and its settings.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
#[serde(tag = "estimator", rename_all = "kebab-case", deny_unknown_fields)]
pub enum OverlapEstimator {
    /// Rays of one view whose epipolar line crosses the other view (pixelSplat). Needs cameras only.
    EpipolarRay(EpipolarRays),
    /// Part of a view with features matched to the other view. Needs images, and OpenCV to match them.
    FeatureCoverage {
        /// How it is measured: see [`Self::with_features`].
        #[serde(skip)]
        measure: Option<FeatureOverlap>,
    },
    /// Pixels whose surface point the other view also sees, through the lenses that the cameras state. Needs depth maps.
    // With braces, because serde ignores unknown settings of a variant without.
    DepthCovisibility {},
}

/// Measures the overlap of two images with their cameras by matched features; symmetric in its arguments.
pub type FeatureOverlap = fn((&Camera, &ImageU8), (&Camera, &ImageU8)) -> Result<f64, ProtocolError>;

/// The data of a view that an estimator may need.
#[derive(Clone, Copy, Debug)]
pub struct OverlapView<'a> {
    /// The view's camera.
    pub camera: &'a Camera,
    /// Its image, for [`OverlapEstimator::FeatureCoverage`].
    pub image: Option<&'a ImageU8>,
    /// Its depth, for [`OverlapEstimator::DepthCovisibility`].
    pub depth: Option<DepthMap<'a>>,
}

impl OverlapEstimator {
    /// The same estimator; feature coverage is measured by `measure` (`atsplat_opencv::feature_overlap`), which is not
    /// stored in files.
    #[must_use]
    pub fn with_features(self, measure: Option<FeatureOverlap>) -> Self {
        if let Self::FeatureCoverage { .. } = self { Self::FeatureCoverage { measure } } else { self }
    }

    /// The name that indices record and reports print. It is not the name in settings where overlaps under that name were
    /// measured otherwise and must not share bins with these: without a crop, or by an older `depth-covisibility`.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::EpipolarRay(EpipolarRays { crop: Some(_), .. }) => "epipolar-ray-crop",
            Self::EpipolarRay(_) => "epipolar-ray",
            Self::FeatureCoverage { .. } => "feature-coverage",
            Self::DepthCovisibility {} => covisibility::NAME,
        }
    }

    /// The definition in one sentence, for reports.
    pub const fn definition(&self) -> &'static str {
        match self {
            Self::EpipolarRay(EpipolarRays { crop: Some(_), .. }) => {
                "as epipolar-ray, of the centre of the images that a crop leaves (latentSplat's index generator)"
            }
            Self::EpipolarRay(_) => {
                "smaller of the two fractions of one view's pixel-centre rays, from its centre to infinity, that project into the other view's image (pixelSplat's index generator)"
            }
            Self::FeatureCoverage { .. } => {
                "smaller of the two fractions of one view's grid cells that contain a feature matched into the other view and verified by epipolar geometry"
            }
            Self::DepthCovisibility {} => {
                "smaller of the two fractions of one view's pixels with depth whose surface point lands in the other view, within 1 % of the range of depths at the four pixel centres around it"
            }
        }
    }

    /// Whether [`OverlapView::image`] is used.
    pub const fn needs_images(&self) -> bool {
        matches!(self, Self::FeatureCoverage { .. })
    }

    /// Whether [`OverlapView::depth`] is used.
    pub const fn needs_depth(&self) -> bool {
        matches!(self, Self::DepthCovisibility {})
    }

    /// Overlap of two views in [0, 1], the smaller of the two directions; symmetric in its arguments.
    ///
    /// # Errors
    /// [`ProtocolError::Overlap`] if a view lacks what the estimator needs, or the geometry cannot be computed.
    pub fn estimate(&self, a: &OverlapView<'_>, b: &OverlapView<'_>) -> Result<f64, ProtocolError> {
        let missing = |what: &str| ProtocolError::Overlap { estimator: self.name(), reason: what.to_owned() };
        match self {
            Self::EpipolarRay(rays) => rays.overlap(a.camera, b.camera),
            Self::DepthCovisibility {} => match (&a.depth, &b.depth) {
                (Some(depth_a), Some(depth_b)) => covisibility::overlap((a.camera, depth_a), (b.camera, depth_b)),
                _ => Err(missing("a view has no depth map")),
            },
            Self::FeatureCoverage { measure: None } => {
                Err(missing("this build was compiled without the cargo feature `opencv`"))
            }
            Self::FeatureCoverage { measure: Some(measure) } => match (a.image, b.image) {
                (Some(image_a), Some(image_b)) => measure((a.camera, image_a), (b.camera, image_b)),
                _ => Err(missing("a view has no image")),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_an_estimator_does_not_have_are_errors() {
        for (name, recorded) in [
            ("epipolar-ray", "epipolar-ray"),
            ("feature-coverage", "feature-coverage"),
            ("depth-covisibility", "depth-covisibility-2x2"),
        ] {
            let read = |rest: &str| {
                let json = format!(r#"{{"estimator": "{name}"{rest}}}"#);
                serde_json::from_str::<OverlapEstimator>(&json).map_err(|error| error.to_string())
            };
            let estimator = read("").unwrap();
            assert_eq!(estimator.name(), recorded);
            assert_eq!(serde_json::to_value(estimator).unwrap()["estimator"], name);
            let error = read(r#", "cells": 9"#).unwrap_err();
            assert!(error.contains("unknown field `cells`"), "{name}: {error}");
        }
    }

    /// Overlaps of whole images and of crops must not share bins.
    #[test]
    fn rays_of_a_crop_are_another_estimator() {
        let json = r#"{"estimator": "epipolar-ray", "crop": {"width": 256, "height": 256}}"#;
        assert_eq!(serde_json::from_str::<OverlapEstimator>(json).unwrap().name(), "epipolar-ray-crop");
    }

    #[test]
    fn each_estimator_says_what_it_measures_and_needs() {
        for (estimator, measured, images, depth) in [
            (OverlapEstimator::EpipolarRay(EpipolarRays::default()), "rays", false, false),
            (OverlapEstimator::FeatureCoverage { measure: None }, "feature", true, false),
            (OverlapEstimator::DepthCovisibility {}, "depth", false, true),
        ] {
            assert!(estimator.definition().contains(measured), "{}: {}", estimator.name(), estimator.definition());
            assert_eq!((estimator.needs_images(), estimator.needs_depth()), (images, depth), "{}", estimator.name());
        }
    }
}
