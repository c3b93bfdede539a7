use atsplat_camera::ImageSize;
use atsplat_numeric::narrowed;
use atsplat_splat::{Exposure, Gradients};
use pulp::Arch;
use rayon::prelude::*;

use super::Fit;
use crate::corrections::CorrectionGradients;
use crate::density::ViewGradients;
use crate::device::{Job, StepGradients};
use crate::loss::Terms;
use crate::view::{TrainingView, TrainingViews};
use crate::{FitError, StopReason};

/// Gradients that are checked at once.
const CHUNK: usize = 1 << 14;

impl Fit {
    /// Forward and backward pass of one training view.
    pub(super) fn differentiate(&mut self, number: usize) -> Result<(Terms, CorrectionGradients), FitError> {
        let exposure = self.exposure(number);
        let Self { views, scene, options, renderer, loss, gradients, config, .. } = self;
        let TrainingView { view, rgb, .. } = view_of_run(views, number);
        let view = &self.corrections.view(number, view)?;
        scene.with_gaussians(|gaussians| {
            let absolute = config.absolute_gradients;
            let job = Job { gaussians, view, options, absolute };
            let (terms, d_exposure) = renderer.differentiate(job, gradients, |rendered, d_rgb| {
                let exposed = exposure.map(|exposure| exposed(&exposure, rendered));
                let shown = exposed.as_deref().unwrap_or(rendered);
                let terms = loss.evaluate(shown, rgb, view.size, config.d_ssim, d_rgb);
                let d_exposure = exposure.map(|_| Exposure::gradient(rendered, d_rgb)).transpose()?;
                if let Some(exposure) = exposure {
                    for gradient in d_rgb.iter_mut() {
                        *gradient = exposure.composited_gradient(*gradient).map(narrowed);
                    }
                }
                Ok((terms, d_exposure))
            })?;
            Ok((terms, CorrectionGradients { pose: gradients.gaussians.pose, exposure: d_exposure }))
        })
    }

    /// Shows the gradients of a training view, which are finite, to density control.
    pub(super) fn observe(&mut self, number: usize) {
        let Self { views, scene, gradients, density, config, .. } = self;
        let StepGradients { gaussians, screen, .. } = gradients;
        let means_2d = if config.absolute_gradients { &screen.absolute_2d } else { &gaussians.means_2d };
        let ImageSize { width, height } = view_of_run(views, number).view.size;
        let size = [f64::from(width), f64::from(height)];
        density.observe(&ViewGradients { drawn: &screen.drawn, means_2d, size, count: scene.len() });
    }

    /// The first parameter with gradients that are not finite, of those that the step changes.
    pub(super) fn non_finite_gradients(&self, of_view: &CorrectionGradients) -> Option<StopReason> {
        // Those that nothing is optimised by are named, so that a new one is not left out by accident.
        let Gradients {
            means,
            quaternions,
            log_scales,
            opacity_logits,
            sh,
            // Of the view, with its corrections.
            pose: _,
            scalars: _,
            means_2d: _,
            conics: _,
            background: _,
        } = &self.gradients.gaussians;
        let fields: [(&'static str, &[f32]); 5] = [
            ("means", means.as_flattened()),
            ("quaternions", quaternions.as_flattened()),
            ("log_scales", log_scales.as_flattened()),
            ("opacity_logits", opacity_logits),
            ("sh", sh.as_flattened()),
        ];
        let of_gaussians = fields.into_iter().find_map(|(parameter, values)| {
            let non_finite = |values: &[f32]| values.iter().filter(|value| !value.is_finite()).count();
            let count =
                values.par_chunks(CHUNK).map(|values| if all_finite(values) { 0 } else { non_finite(values) }).sum();
            (count > 0).then_some(StopReason::NonFiniteGradients { parameter, count })
        });
        of_gaussians.or_else(|| self.corrections.non_finite(of_view))
    }
}

/// The view of a step.
#[expect(clippy::expect_used, reason = "the order of views is a permutation")]
fn view_of_run(views: &TrainingViews, number: usize) -> &TrainingView {
    views.get(number).expect("a view of the run")
}

/// The image as an exposure shows it.
fn exposed(exposure: &Exposure, rgb: &[[f32; 3]]) -> Vec<[f32; 3]> {
    rgb.iter().map(|rgb| exposure.apply(rgb.map(f64::from)).map(narrowed)).collect()
}

/// Whether all values are finite: infinities and NaN have the largest exponents.
fn all_finite(values: &[f32]) -> bool {
    const MAGNITUDE: u32 = u32::MAX >> 1;
    let largest = |most: u32, value: &f32| most.max(value.to_bits() & MAGNITUDE);
    Arch::new().dispatch(|| values.iter().fold(0, largest)) < f32::INFINITY.to_bits()
}
