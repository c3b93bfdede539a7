use std::sync::Arc;

use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::trial::{ContextView, TargetView};

use super::{Answer, Cost, Method, Question, Refusal, Rendered, Timed};
use crate::MethodRecord;

/// A floor: the context picture whose camera stands closest to the target's, as it is. Of several that are equally close,
/// to a billionth, the first in the trial's order.
#[derive(Clone, Copy, Debug, Default)]
pub struct NearestView;

/// What normalising poses may do to a distance, in parts of it.
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

    fn begin<'a>(&'a self, question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal> {
        Ok(Box::new(Copied { question, cost: Cost::default() }))
    }
}

struct Copied<'a> {
    question: Question<'a>,
    cost: Cost,
}

impl Answer for Copied<'_> {
    fn cost(&self) -> &Cost {
        &self.cost
    }

    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let views = self.question.trial.targets();
        let one = |position: &usize| {
            let target = views.get(*position).ok_or_else(|| format!("no target {position}"))?;
            let nearest = nearest(&self.question, target).ok_or("no context view")?;
            Ok(Rendered::plain(Image::from_u8(nearest)))
        };
        targets.iter().map(one).collect()
    }
}

/// The context picture whose camera is closest to a target's.
pub(super) fn nearest<'a>(question: &Question<'a>, target: &TargetView) -> Option<&'a Arc<ImageU8>> {
    let place = target.camera.camera_from_world.inverse().centre();
    let distance = |view: &ContextView| view.camera.camera_from_world.inverse().centre().distance(place);
    let distances: Vec<f64> = question.trial.context().iter().map(distance).collect();
    let least = distances.iter().copied().min_by(f64::total_cmp)?;
    let first = distances.iter().position(|distance| *distance <= least * (1.0 + ROUNDING))?;
    question.pictures.get(first)
}
