use std::time::Instant;

use serde::Serialize;

use super::{Assessment, EFFECTS, Effect, EffectSelection, Request, Scene};
use crate::{Gaussians, RenderOptions, Renderer, Rendering, SplatError, View};

/// Which requested effects run for a scene, and why.
#[derive(Clone, Debug)]
pub struct EffectPlan {
    requested: Request,
    reduced: Request,
    /// One per effect, in the order of [`EFFECTS`].
    decisions: Vec<Decision>,
    tolerance: f64,
    /// Seconds spent on each decision.
    secs: Vec<f64>,
}

/// The decision on an effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Decision {
    /// Name of the effect.
    pub effect: &'static str,
    /// Whether it runs.
    #[serde(rename = "verdict")]
    pub outcome: EffectOutcome,
    /// See [`Assessment::bound`].
    pub bound: Option<f64>,
    /// In words.
    pub reason: String,
}

/// Whether an effect runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EffectOutcome {
    /// The request does not include it.
    NotRequested,
    /// It runs as requested.
    Runs,
    /// Part of it runs.
    Reduced,
    /// It was requested, but is skipped.
    Skipped,
}

impl EffectPlan {
    /// Default tolerance: a quarter of a grey level of 8 bits.
    pub const TOLERANCE: f64 = 0.25 / 255.0;
    /// The budget of effects that are left out by name, so that any finite bound is reported.
    pub(super) const UNLIMITED: f64 = f64::MAX;

    /// Decides which effects a scene needs.
    ///
    /// Under [`EffectSelection::Auto`] the skipped effects together change each colour sample by at most `tolerance`,
    /// in units of display range, and no other image. The other selections report the bounds but do not enforce them.
    ///
    /// # Errors
    /// [`SplatError::Tolerance`] if it is negative or not finite, [`SplatError::Options`] for invalid options,
    /// [`SplatError::View`] and [`SplatError::Camera`] for an invalid view.
    pub fn for_scene(
        scene: &Scene<'_>,
        view: &View,
        options: &RenderOptions,
        selection: &EffectSelection,
        tolerance: f64,
    ) -> Result<Self, SplatError> {
        if !(tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(SplatError::Tolerance { found: tolerance });
        }
        options.check()?;
        view.optics(&options.constants)?;
        let requested = Request { view: *view, options: options.clone() };
        let mut planning = Planning { scene, selection, reduced: requested.clone(), budget: tolerance };
        let timed = |effect: &&dyn Effect| {
            let start = Instant::now();
            (planning.decide(*effect), start.elapsed().as_secs_f64())
        };
        let (decisions, secs) = EFFECTS.iter().map(timed).unzip();
        let reduced = planning.reduced;
        Ok(Self { requested, reduced, decisions, tolerance, secs })
    }

    /// The original request.
    pub const fn requested(&self) -> &Request {
        &self.requested
    }

    /// The request that is rendered instead. Its gradients are not those of the original.
    pub const fn reduced(&self) -> &Request {
        &self.reduced
    }

    /// The decision on each effect.
    pub fn decisions(&self) -> &[Decision] {
        &self.decisions
    }

    /// Largest allowed change.
    pub const fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// Wall-clock seconds spent planning.
    pub fn secs(&self) -> f64 {
        self.secs.iter().sum()
    }

    /// Wall-clock seconds spent on each decision.
    pub(super) fn secs_each(&self) -> &[f64] {
        &self.secs
    }

    /// Renders the reduced request, and fills in the images that are known to be zero.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn render(&self, renderer: &mut dyn Renderer, gaussians: &Gaussians) -> Result<Rendering<f32>, SplatError> {
        let mut rendering = renderer.render(gaussians, &self.reduced.view, &self.reduced.options)?;
        for (effect, decision) in EFFECTS.iter().zip(&self.decisions) {
            let Some(image) = effect.image() else { continue };
            let slot = image.slot(&mut rendering);
            let is_zero = decision.bound == Some(0.0);
            if is_zero && slot.is_none() && effect.is_requested(gaussians, &self.requested) {
                *slot = Some(vec![0.0; self.requested.view.pixels()]);
            }
        }
        Ok(rendering)
    }
}

/// State while planning.
struct Planning<'a> {
    scene: &'a Scene<'a>,
    selection: &'a EffectSelection,
    reduced: Request,
    /// Remaining tolerance.
    budget: f64,
}

impl Planning<'_> {
    fn decide(&mut self, effect: &dyn Effect) -> Decision {
        let decision = |outcome, bound, reason: String| Decision { effect: effect.name(), outcome, bound, reason };
        if !effect.is_requested(self.scene.gaussians(), &self.reduced) {
            return decision(EffectOutcome::NotRequested, Some(0.0), "not requested".to_owned());
        }
        if *self.selection == EffectSelection::Auto {
            return self.assess(effect);
        }
        if self.selection.allows(effect.name()) {
            return decision(EffectOutcome::Runs, None, format!("chosen by `{}`", self.selection));
        }
        let Assessment { bound, reason, .. } = effect.assess(self.scene, &self.reduced, EffectPlan::UNLIMITED);
        effect.remove_from(&mut self.reduced);
        let reason = match bound {
            Some(_) => format!("left out by `{}`; {reason}", self.selection),
            None => format!("left out by `{}`, though {reason}", self.selection),
        };
        decision(EffectOutcome::Skipped, bound, reason)
    }

    fn assess(&mut self, effect: &dyn Effect) -> Decision {
        let Assessment { reduced, bound, reason } = effect.assess(self.scene, &self.reduced, self.budget);
        let (Some(reduced), Some(change)) = (reduced, bound) else {
            return Decision { effect: effect.name(), outcome: EffectOutcome::Runs, bound, reason };
        };
        self.reduced = reduced;
        self.budget -= change;
        let outcome = if effect.is_requested(self.scene.gaussians(), &self.reduced) {
            EffectOutcome::Reduced
        } else {
            EffectOutcome::Skipped
        };
        Decision { effect: effect.name(), outcome, bound, reason }
    }
}
