use crate::cpu::CpuRenderer;
use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, Rendering, SplatError, View, reference};

/// One way to render and to differentiate: what a caller holds where a user chose among them.
pub trait Renderer: Send {
    /// For people, as `reference` or `cpu, avx2`.
    fn name(&self) -> String;

    /// Renders a view.
    ///
    /// # Errors
    /// [`SplatError::View`], [`SplatError::Camera`], [`SplatError::Options`] and [`SplatError::Constants`] for what
    /// cannot be rendered, [`SplatError::Memory`] before more is allocated than is allowed; those of the backend.
    fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError>;

    /// Derivatives of a loss by everything that made the images, from its derivatives by the images. Needs no
    /// rendering before it.
    ///
    /// # Errors
    /// As [`Renderer::render`], and [`SplatError::Length`] for an image of another size than the view's,
    /// [`SplatError::NonFinite`] for a derivative that is not finite.
    fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError>;

    /// Where the time of the last rendering went, in the order of the work.
    fn stages(&self) -> Vec<Stage>;
}

/// A part of the work and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// As `project` or `sort`.
    pub name: &'static str,
    /// Wall-clock seconds.
    pub secs: f64,
}

/// [`reference`](mod@crate::reference), rounded to f32 at the end.
#[derive(Clone, Copy, Debug, Default)]
pub struct ReferenceRenderer;

impl Renderer for ReferenceRenderer {
    fn name(&self) -> String {
        "reference".to_owned()
    }

    fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        Ok(reference::render(gaussians, view, options)?.map(saturated))
    }

    fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        Ok(reference::backward(gaussians, view, options, &images.map(f64::from))?.map(saturated))
    }

    fn stages(&self) -> Vec<Stage> {
        Vec::new()
    }
}

impl Renderer for CpuRenderer {
    fn name(&self) -> String {
        format!("cpu, {}", self.simd())
    }

    fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        Self::render(self, gaussians, view, options)
    }

    fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        Self::backward(self, gaussians, view, options, images)
    }

    fn stages(&self) -> Vec<Stage> {
        let timings = self.timings();
        vec![
            Stage { name: "project", secs: timings.project_secs },
            Stage { name: "bin", secs: timings.bin_secs },
            Stage { name: "composite", secs: timings.raster_secs },
            Stage { name: "write", secs: timings.write_secs },
        ]
    }
}

/// The nearest f32, the largest where f32 would be infinite: a derivative keeps its sign and stays finite.
#[expect(clippy::cast_possible_truncation, reason = "clamped before")]
#[inline(always)]
pub(crate) const fn saturated(value: f64) -> f32 {
    value.clamp(f32::MIN as f64, f32::MAX as f64) as f32
}
