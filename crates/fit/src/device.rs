//! Where images are rendered and differentiated.

use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::gpu::{GpuRenderer, ScreenGradients, Uploaded};
use atsplat_splat::{
    Exposure, GaussianCounts, Gaussians, Gradients, ImageGradients, RenderOptions, Renderer, Rendering, SplatError,
    View,
};

use crate::loss::Terms;

/// A renderer that others use too.
type Shared = Arc<Mutex<Box<dyn Renderer>>>;

/// Where the images of an optimisation are rendered and differentiated: the CPU, or a graphics adapter. Loss, Adam, density
/// control and filters run on the CPU in both cases.
#[derive(Clone, Default)]
pub struct FitDevice(Option<Adapter>);

#[derive(Clone)]
struct Adapter {
    renderer: Shared,
    name: String,
}

impl FitDevice {
    /// The CPU's name in checkpoints.
    pub(crate) const CPU: &str = "cpu";

    /// A graphics adapter by its renderer, which others may use between the passes of a step; `name` tells adapters and
    /// drivers apart, because their bits differ. `None` if the renderer is not one of an adapter.
    pub fn adapter(renderer: Shared, name: String) -> Option<Self> {
        let is_of_adapter = renderer.lock().unwrap_or_else(PoisonError::into_inner).on_adapter().is_some();
        is_of_adapter.then_some(Self(Some(Adapter { renderer, name })))
    }

    /// Name of the adapter with its driver, or `cpu`.
    pub fn name(&self) -> &str {
        self.0.as_ref().map_or(Self::CPU, |adapter| &adapter.name)
    }
}

impl fmt::Debug for FitDevice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Renders and differentiates on a device.
#[derive(Debug)]
pub(crate) struct StepRenderer {
    pub(crate) cpu: CpuRenderer,
    pub(crate) device: FitDevice,
}

/// What to differentiate.
#[derive(Clone, Copy)]
pub(crate) struct Job<'a> {
    pub(crate) gaussians: &'a Gaussians,
    pub(crate) view: &'a View,
    pub(crate) options: &'a RenderOptions,
    /// Whether absolute gradients of the projected means are needed.
    pub(crate) absolute: bool,
}

/// The gradients of a step, whose memory is reused, and what its image showed.
#[derive(Debug)]
pub(crate) struct StepGradients {
    images: ImageGradients<f32>,
    /// Of the Gaussians' parameters and the camera's pose.
    pub(crate) gaussians: Gradients<f32>,
    pub(crate) screen: ScreenGradients,
    pub(crate) counts: GaussianCounts,
}

impl Default for StepGradients {
    fn default() -> Self {
        let images = ImageGradients { rgb: Vec::new(), alpha: None, depth: None, scalar: None };
        let (gaussians, screen, counts) = (Gradients::default(), ScreenGradients::default(), GaussianCounts::default());
        Self { images, gaussians, screen, counts }
    }
}

/// The loss of an image and the gradient of its exposure.
type Evaluated = (Terms, Option<Exposure>);

impl StepRenderer {
    pub(crate) fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        match &self.device.0 {
            None => self.cpu.render(gaussians, view, options),
            Some(Adapter { renderer, .. }) => {
                renderer.lock().unwrap_or_else(PoisonError::into_inner).render(gaussians, view, options)
            }
        }
    }

    /// Forward pass, `loss` of the image with its gradient, and backward pass, unless the loss is not finite.
    pub(crate) fn differentiate(
        &mut self,
        job: Job<'_>,
        into: &mut StepGradients,
        loss: impl FnOnce(&[[f32; 3]], &mut Vec<[f32; 3]>) -> Result<Evaluated, SplatError>,
    ) -> Result<Evaluated, SplatError> {
        let Job { gaussians, view, options, absolute } = job;
        let StepGradients { images, gaussians: gradients, screen, counts } = into;
        let Some(Adapter { renderer, .. }) = &self.device.0 else {
            let mut recording = self.cpu.record(gaussians, view, options)?;
            *counts = recording.rendering().counts;
            let evaluated = loss(&recording.rendering().rgb, &mut images.rgb)?;
            if evaluated.0.total.is_finite() {
                if absolute {
                    recording.backward_with_absolute(images, gradients, &mut screen.absolute_2d)?;
                } else {
                    recording.backward_into(images, gradients)?;
                }
                screen.drawn.clear();
                screen.drawn.extend(recording.drawn());
            }
            self.cpu.reuse(recording);
            return Ok(evaluated);
        };
        // Not locked during the loss, which uses many threads.
        let locked = || renderer.lock().unwrap_or_else(PoisonError::into_inner);
        let (uploaded, rendering) = {
            let mut renderer = locked();
            let renderer = on_adapter(&mut renderer);
            let uploaded = renderer.upload(gaussians)?;
            let rendering = renderer.render_uploaded(&uploaded, view, options)?;
            (uploaded, rendering)
        };
        *counts = rendering.counts;
        let evaluated = loss(&rendering.rgb, &mut images.rgb)?;
        if evaluated.0.total.is_finite() {
            let uploaded = Uploaded { host: gaussians, device: &uploaded };
            (*gradients, *screen) =
                on_adapter(&mut locked()).backward_with_screen(uploaded, view, options, images, absolute)?;
        }
        Ok(evaluated)
    }
}

#[expect(clippy::expect_used, reason = "checked when the device was made")]
fn on_adapter(renderer: &mut Box<dyn Renderer>) -> &mut GpuRenderer {
    renderer.on_adapter().expect("the renderer of an adapter")
}
