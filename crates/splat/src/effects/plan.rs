use std::time::Instant;

use serde::Serialize;

use super::{EFFECTS, Effect, EffectSelection, Judgement, Request};
use crate::{Gaussians, RenderOptions, Renderer, Rendering, SplatError, View};

/// Which effects of a request run for a scene, and why.
#[derive(Clone, Debug)]
pub struct EffectPlan {
    asked: Request,
    reduced: Request,
    /// One per effect, in the order of [`EFFECTS`].
    decisions: Vec<Decision>,
    tolerance: f64,
    secs: f64,
}

/// What becomes of an effect.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Decision {
    /// Name of the effect.
    pub effect: &'static str,
    /// What becomes of it.
    pub verdict: Verdict,
    /// See [`Judgement::bound`].
    pub bound: Option<f64>,
    /// In words.
    pub reason: String,
}

/// What becomes of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// The request does without.
    NotAsked,
    /// It runs as asked for.
    Runs,
    /// Part of it runs.
    Reduced,
    /// It was asked for, and is left out.
    LeftOut,
}

impl EffectPlan {
    /// Largest change of a picture unless another is given: a quarter of a step of 8 bits.
    pub const TOLERANCE: f64 = 1.0 / 1024.0;

    /// Decides for a scene.
    ///
    /// Under [`EffectSelection::Auto`] the changes that are made in order to save time add up to at most `tolerance`
    /// in every sample of colour, in units of display range, and no other image changes. Under the other selections
    /// bounds are told, not kept.
    ///
    /// # Errors
    /// [`SplatError::Tolerance`] for one that is negative or not finite, [`SplatError::Options`] for options that cannot
    /// be rendered, [`SplatError::View`] and [`SplatError::Camera`] for such a view.
    pub fn for_scene(
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        selection: &EffectSelection,
        tolerance: f64,
    ) -> Result<Self, SplatError> {
        let start = Instant::now();
        if !(tolerance >= 0.0 && tolerance.is_finite()) {
            return Err(SplatError::Tolerance { found: tolerance });
        }
        options.check()?;
        view.optics(&options.constants)?;
        let asked = Request { view: *view, options: options.clone() };
        let mut planning = Planning { gaussians, selection, reduced: asked.clone(), budget: tolerance };
        let decisions = EFFECTS.iter().map(|effect| planning.decide(*effect)).collect();
        let reduced = planning.reduced;
        Ok(Self { asked, reduced, decisions, tolerance, secs: start.elapsed().as_secs_f64() })
    }

    /// What was asked for.
    pub const fn asked(&self) -> &Request {
        &self.asked
    }

    /// What is rendered instead. Its derivatives are not those of what was asked for.
    pub const fn reduced(&self) -> &Request {
        &self.reduced
    }

    /// What becomes of each effect.
    pub fn decisions(&self) -> &[Decision] {
        &self.decisions
    }

    /// Largest change that was allowed.
    pub const fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// Wall-clock seconds that deciding took.
    pub const fn secs(&self) -> f64 {
        self.secs
    }

    /// Renders what is left of the request, and fills images that are known to be zero.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn render(&self, renderer: &mut dyn Renderer, gaussians: &Gaussians) -> Result<Rendering<f32>, SplatError> {
        let mut rendering = renderer.render(gaussians, &self.reduced.view, &self.reduced.options)?;
        let proved = |name| self.decisions.iter().any(|own| own.effect == name && own.bound == Some(0.0));
        let zeros = || vec![0.0; self.asked.view.pixels()];
        let channels = self.asked.options.channels;
        for (asked, name, image) in [
            (channels.depth, "depth", &mut rendering.depth),
            (channels.scalar, "scalar", &mut rendering.scalar),
            (channels.median_depth, "median-depth", &mut rendering.median_depth),
        ] {
            if asked && image.is_none() && proved(name) {
                *image = Some(zeros());
            }
        }
        Ok(rendering)
    }
}

/// A plan in the making.
struct Planning<'a> {
    gaussians: &'a Gaussians,
    selection: &'a EffectSelection,
    reduced: Request,
    /// What of the tolerance is left.
    budget: f64,
}

impl Planning<'_> {
    fn decide(&mut self, effect: &dyn Effect) -> Decision {
        let decision = |verdict, bound, reason: String| Decision { effect: effect.name(), verdict, bound, reason };
        if !effect.is_asked_for(self.gaussians, &self.reduced) {
            return decision(Verdict::NotAsked, Some(0.0), "not asked for".to_owned());
        }
        if *self.selection == EffectSelection::Auto {
            return self.judge(effect);
        }
        if self.selection.allows(effect.name()) {
            return decision(Verdict::Runs, None, format!("chosen by `{}`", self.selection));
        }
        // Whatever is finite is told as a bound.
        let Judgement { bound, reason, .. } = effect.judge(self.gaussians, &self.reduced, f64::MAX);
        effect.leave_out(&mut self.reduced);
        let reason = match bound {
            Some(_) => format!("left out by `{}`; {reason}", self.selection),
            None => format!("left out by `{}`, though {reason}", self.selection),
        };
        decision(Verdict::LeftOut, bound, reason)
    }

    fn judge(&mut self, effect: &dyn Effect) -> Decision {
        let Judgement { reduced, bound, reason } = effect.judge(self.gaussians, &self.reduced, self.budget);
        let (Some(reduced), Some(change)) = (reduced, bound) else {
            return Decision { effect: effect.name(), verdict: Verdict::Runs, bound, reason };
        };
        self.reduced = reduced;
        self.budget -= change;
        let verdict =
            if effect.is_asked_for(self.gaussians, &self.reduced) { Verdict::Reduced } else { Verdict::LeftOut };
        Decision { effect: effect.name(), verdict, bound, reason }
    }
}
