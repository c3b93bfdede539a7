use atsplat_splat::{Exposure, RenderOptions, Rendering, View};

use super::Fit;
use crate::{FitError, Score};

impl Fit {
    /// A training view with its optimised camera, by position.
    ///
    /// # Errors
    /// [`FitError::Camera`] for a motion that is not finite.
    pub fn optimised_view(&self, number: usize) -> Result<Option<View>, FitError> {
        self.views.get(number).map(|view| self.corrections.view(number, &view.view)).transpose()
    }

    /// The optimised exposure of a training view, by position; `None` if exposures are not optimised.
    pub fn exposure(&self, number: usize) -> Option<Exposure> {
        self.config.exposure_rate.and_then(|_| self.corrections.exposure(number))
    }

    /// Renders a view as the optimisation does, on the configured background, black for a random one.
    ///
    /// # Errors
    /// [`FitError::Splat`].
    pub fn render(&mut self, view: &View) -> Result<Rendering<f32>, FitError> {
        self.render_exposed(view, None)
    }

    fn render_exposed(&mut self, view: &View, exposure: Option<Exposure>) -> Result<Rendering<f32>, FitError> {
        let options = RenderOptions { exposure, ..self.options() };
        let Self { scene, renderer, .. } = self;
        Ok(scene.with_gaussians(|gaussians| renderer.render(gaussians, view, &options))?)
    }

    /// Renders a training view, by position, as the optimisation does, with its optimised camera and exposure, and compares it with
    /// its image; `None` if there is no such view.
    ///
    /// # Errors
    /// As [`Self::render`] and [`Self::optimised_view`].
    pub fn render_training(&mut self, number: usize) -> Result<Option<(Rendering<f32>, Score)>, FitError> {
        let Some(view) = self.optimised_view(number)? else { return Ok(None) };
        let rendering = self.render_exposed(&view, self.exposure(number))?;
        let score = self.views.get(number).map(|view| Score::of(&rendering.rgb, view)).transpose()?;
        Ok(score.map(|score| (rendering, score)))
    }
}
