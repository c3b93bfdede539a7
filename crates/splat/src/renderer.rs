use crate::cpu::CpuRenderer;
use crate::gpu::{GpuCounts, GpuRenderer};
use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, Rendering, SplatError, View, reference};

/// A rendering backend with forward and backward passes, chosen at run time.
pub trait Renderer: Send {
    /// Display name, such as `reference` or `cpu, avx2`.
    fn name(&self) -> String;

    /// Renders a view.
    ///
    /// # Errors
    /// [`SplatError::View`], [`SplatError::Camera`], [`SplatError::Options`] and [`SplatError::Constants`] for invalid
    /// input, [`SplatError::Memory`] if more memory would be needed than allowed; the backend's own errors.
    fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError>;

    /// Backward pass: gradients of a loss with respect to every input, from its gradients with respect to the images.
    /// Needs no forward pass before it.
    ///
    /// # Errors
    /// As [`Renderer::render`], and [`SplatError::Length`] for an image whose size differs from the view's,
    /// [`SplatError::NonFinite`] for a gradient that is not finite.
    fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError>;

    /// Time spent in each stage of the last rendering, in order of execution.
    fn stages(&self) -> Vec<Stage>;

    /// What passed between the host and a graphics processor so far; `None` on the processor.
    fn device_counts(&self) -> Option<GpuCounts> {
        None
    }

    /// The renderer of a graphics adapter, with what it can do beyond this trait; `None` on the processor.
    fn on_adapter(&mut self) -> Option<&mut GpuRenderer> {
        None
    }
}

/// A stage of the pipeline and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stage {
    /// Such as `project` or `sort`.
    pub name: &'static str,
    /// Wall-clock seconds.
    pub secs: f64,
}

/// [`reference`](mod@crate::reference), with results rounded to f32.
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

/// The nearest finite f32: a gradient that would overflow keeps its sign and stays finite.
#[expect(clippy::cast_possible_truncation, reason = "clamped to f32's range")]
#[inline(always)]
pub(crate) const fn saturated(value: f64) -> f32 {
    value.clamp(f32::MIN as f64, f32::MAX as f64) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_has_a_name() {
        assert_eq!(ReferenceRenderer.name(), "reference");
    }
}
