//! What rendering may skip: each effect in its file, and the plan that runs those that a scene calls for.
//!
//! A plan is the request with less in it, so that every backend renders it as it is, and what is skipped costs
//! nothing there. Bounds are proved from the data in exact arithmetic; the rounding of f32 comes on top, as between
//! any two backends. Only colour ever changes: shapes, places and opacities stay, and with them opacity, depth and
//! scalar images and everything that a cut-off decides.
//!
//! **For pictures, not for training.** A request with less in it has other derivatives: harmonics that are all zero
//! have a gradient, and the plan's options would give none. Differentiate what was asked for, never the plan.

mod amplitude;
mod antialiasing;
mod background;
mod channels;
mod explain;
mod exposure;
mod geometry;
mod lens;
mod plan;
mod selection;
mod summary;
mod view_dependence;

use std::fmt::Debug;

use crate::{Gaussians, RenderOptions, View};

pub use explain::{Cost, Explanation};
pub use plan::{Decision, EffectPlan, Verdict};
pub use selection::EffectSelection;
pub use summary::EffectSummary;

/// What is to be rendered: by itself, or after effects were taken out.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Camera and size.
    pub view: View,
    /// Everything else.
    pub options: RenderOptions,
}

/// Something that rendering may skip.
pub trait Effect: Debug + Send + Sync {
    /// As in `--effects`.
    fn name(&self) -> &'static str;

    /// Whether the request has it at all.
    fn is_asked_for(&self, gaussians: &Gaussians, request: &Request) -> bool;

    /// Takes all of it out of the request.
    fn leave_out(&self, request: &mut Request);

    /// Finds the least that does for this scene where images may change by `budget`, see [`Judgement::bound`].
    fn judge(&self, gaussians: &Gaussians, request: &Request, budget: f64) -> Judgement;
}

/// What an effect does to a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// The request with as little of the effect as does; `None` where all of it has to run.
    pub reduced: Option<Request>,
    /// Largest change that this makes of any sample of any image, in units of display range; `None` where none was
    /// proved, and never infinite.
    pub bound: Option<f64>,
    /// In words.
    pub reason: String,
}

impl Judgement {
    /// The effect has to run.
    fn runs(reason: impl Into<String>) -> Self {
        Self { reduced: None, bound: None, reason: reason.into() }
    }

    /// All of the effect can be left out.
    fn leaves_out(effect: &dyn Effect, request: &Request, bound: f64, reason: impl Into<String>) -> Self {
        let mut reduced = request.clone();
        effect.leave_out(&mut reduced);
        Self { reduced: Some(reduced), bound: Some(bound), reason: reason.into() }
    }
}

/// Every effect, in the order in which they are judged: exposure first, because it scales what the others change.
pub const EFFECTS: [&dyn Effect; 8] = [
    &exposure::ExposureEffect,
    &view_dependence::ViewDependence,
    &lens::LensEffect,
    &antialiasing::Antialiasing,
    &background::Background,
    &channels::Depth,
    &channels::Scalar,
    &channels::MedianDepth,
];

impl Request {
    /// How much larger a change of composited colour is in the picture.
    fn gain(&self) -> f64 {
        self.options.exposure.map_or(1.0, |exposure| exposure.gain())
    }
}
