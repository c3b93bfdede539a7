use atsplat_model::ModelError;
use atsplat_model::network::{Device, Processor};
use atsplat_splat::SplatError;
use atsplat_splat::gpu::{AdapterChoice, GpuOptions, GpuRenderer, SelfTestObserver};

use crate::EvalError;
use crate::method::{Backend, Splatting};

/// Where methods run their networks and render their Gaussians: the CPU, or one graphics adapter for both.
#[derive(Clone, Debug, Default)]
pub struct ComputeDevice {
    processor: Processor,
    backend: Backend,
}

impl ComputeDevice {
    /// Opens a processor. The renderer of an adapter must pass its self-test, unless `observer` has cached that it did;
    /// there is no fallback to another adapter or the CPU.
    ///
    /// # Errors
    /// [`EvalError::Model`] if there is no such adapter, with a list of them, or if it cannot be opened or fails its self-test.
    pub fn open(processor: Processor, observer: &dyn SelfTestObserver) -> Result<Self, EvalError> {
        let Some((number, description)) = processor.adapter()? else { return Ok(Self::default()) };
        let renderer = GpuRenderer::observed(&AdapterChoice::Index(number), GpuOptions::default(), observer);
        let renderer = renderer.map_err(|error| ModelError::from(SplatError::from(error)))?;
        let backend = Backend::shared(Box::new(renderer), Some((&description).into()));
        Ok(Self { processor: Processor::Wgpu(Some(number)), backend })
    }

    /// The device of networks; the first call opens it.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the adapter cannot be opened, or the build runs networks on the CPU only.
    pub fn network(&self) -> Result<Device, EvalError> {
        Ok(self.processor.open()?)
    }

    /// Whether this is a graphics adapter.
    pub fn is_adapter(&self) -> bool {
        self.processor != Processor::Cpu
    }

    /// The renderer.
    pub fn backend(&self) -> Backend {
        self.backend.clone()
    }

    /// [`Splatting::default`], the protocol's constants and background, rendered on this device.
    pub fn splatting(&self) -> Splatting {
        Splatting { backend: self.backend(), ..Splatting::default() }
    }
}
