use std::sync::Arc;

use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::trial::{ContextView, TargetView};
use atsplat_results::MethodRecord;

use super::{Method, MethodError, Prediction, Rendered, Timed, TrialInput, render_each};

/// A lower baseline: copies the context image whose camera is closest to the target's. Ties, to a relative 1e-9, go to
/// the first in the trial's order.
#[derive(Clone, Copy, Debug, Default)]
pub struct NearestView;

/// Relative rounding error that pose normalisation may add to a distance.
const ROUNDING: f64 = 1e-9;

impl Method for NearestView {
    fn record(&self) -> MethodRecord {
        MethodRecord {
            name: "nearest-view".to_owned(),
            kind: "nearest-view".to_owned(),
            title: "nearest view".to_owned(),
            deterministic: true,
            ..MethodRecord::default()
        }
    }

    fn timed(&self) -> Timed {
        Timed::RENDERING
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(Box::new(Copied(input)))
    }
}

struct Copied<'a>(TrialInput<'a>);

impl Prediction for Copied<'_> {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        render_each(self.0.trial, targets, |target| {
            Ok(Image::from_u8(nearest(&self.0, target).ok_or("no context view")?))
        })
    }
}

/// The context image whose camera is closest to a target's.
pub(super) fn nearest<'a>(input: &TrialInput<'a>, target: &TargetView) -> Option<&'a Arc<ImageU8>> {
    let centre = target.camera.camera_from_world.inverse().centre();
    let distance = |view: &ContextView| view.camera.camera_from_world.inverse().centre().distance(centre);
    let distances: Vec<f64> = input.trial.context().iter().map(distance).collect();
    let least = distances.iter().copied().min_by(f64::total_cmp)?;
    let first = distances.iter().position(|distance| *distance <= least * (1.0 + ROUNDING))?;
    input.images.get(first)
}
