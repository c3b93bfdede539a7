//! Effects that rendering may skip, one per file, and the plan that runs only what a scene needs.
//!
//! A plan is a reduced request, which every backend renders like any other, so that a skipped effect costs nothing.
//! Bounds are proved from the data in exact arithmetic; f32 rounding comes on top, as between any two backends. Shapes,
//! positions and opacities stay, and with them every threshold decision and the alpha, depth and scalar images.
//!
//! **For rendering, not for training.** A reduced request has other gradients: SH coefficients that are all zero have a
//! gradient, which the reduced options would drop. Differentiate the original request, never the reduced one.

mod amplitude;
mod antialiasing;
mod background;
mod channels;
mod explain;
mod exposure;
mod geometry;
mod lens;
mod plan;
mod scene;
mod selection;
mod summary;
mod view_dependence;

use std::fmt::Debug;

use crate::{Gaussians, RenderOptions, View};

pub use channels::ExtraImage;
pub use explain::{Cost, Explanation};
pub use plan::{Decision, EffectOutcome, EffectPlan};
pub use scene::Scene;
pub use selection::EffectSelection;
pub use summary::EffectSummary;

/// A view and options to render, in full or after effects were removed.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Camera and size.
    pub view: View,
    /// All other options.
    pub options: RenderOptions,
}

/// An effect that rendering may skip.
pub trait Effect: Debug + Send + Sync {
    /// Name, as in `--effects`.
    fn name(&self) -> &'static str;

    /// The image that it renders in addition to colour and alpha; `None` if it changes these.
    fn image(&self) -> Option<ExtraImage> {
        None
    }

    /// Whether the request includes it at all.
    fn is_requested(&self, gaussians: &Gaussians, request: &Request) -> bool;

    /// Removes it from the request.
    fn remove_from(&self, request: &mut Request);

    /// Finds the smallest part of it that this scene needs if colour may change by `budget`, see [`Assessment::bound`].
    fn assess(&self, scene: &Scene<'_>, request: &Request, budget: f64) -> Assessment;
}

/// Whether a scene needs an effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Assessment {
    /// The request with as little of the effect as suffices; `None` if all of it has to run.
    pub reduced: Option<Request>,
    /// Upper bound on how much this changes any sample of any image, in units of display range; `None` if none was
    /// proved, and never infinite.
    pub bound: Option<f64>,
    /// Explanation for the user.
    pub reason: String,
}

impl Assessment {
    /// The whole effect has to run.
    fn keep(reason: impl Into<String>) -> Self {
        Self { reduced: None, bound: None, reason: reason.into() }
    }

    /// The whole effect can be removed.
    fn remove(effect: &dyn Effect, request: &Request, bound: f64, reason: impl Into<String>) -> Self {
        let mut reduced = request.clone();
        effect.remove_from(&mut reduced);
        Self { reduced: Some(reduced), bound: Some(bound), reason: reason.into() }
    }
}

/// Every effect, in order of assessment: exposure first, because it scales the changes of the others.
pub const EFFECTS: [&dyn Effect; 8] = [
    &exposure::ExposureEffect,
    &view_dependence::ViewDependence,
    &lens::LensEffect,
    &antialiasing::Antialiasing,
    &background::Background,
    &ExtraImage::Depth,
    &ExtraImage::Scalar,
    &ExtraImage::MedianDepth,
];

/// The image of its own that the effect of this name has.
fn image_of(effect: &str) -> Option<ExtraImage> {
    EFFECTS.iter().find(|known| known.name() == effect)?.image()
}

impl Request {
    /// The degree of spherical harmonics that is evaluated.
    const fn degree(&self, gaussians: &Gaussians) -> u8 {
        self.options.sh_degree(gaussians.sh_degree())
    }

    /// Factor by which exposure amplifies a change of composited colour.
    fn gain(&self) -> f64 {
        self.options.exposure.map_or(1.0, |exposure| exposure.gain())
    }
}
