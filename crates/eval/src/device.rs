use atsplat_model::ModelError;
use atsplat_model::network::{Device, Processor};
use atsplat_results::AdapterRecord;
use atsplat_splat::SplatError;
use atsplat_splat::gpu::{AdapterChoice, AdapterDescription, GpuOptions, GpuRenderer, SelfTestObserver};

use crate::EvalError;
use crate::method::{Backend, Splatting};

/// How results name a graphics adapter.
pub fn adapter_record(adapter: &AdapterDescription) -> AdapterRecord {
    let AdapterDescription { name, backend, driver, .. } = adapter.clone();
    AdapterRecord { name, backend, driver }
}

/// Least limit on an adapter's memory: more than its self-test needs.
const MIN_MEMORY: u64 = 64 << 20;

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
        Self::open_within(processor, GpuOptions::default().memory_limit, observer)
    }

    /// Like [`Self::open`], with a limit on the bytes that a rendering or its gradients may take in the memory of an adapter, raised
    /// to 64 MiB if it is lower. `observer` caches results of the default limit, 8 GiB, alone: with another one, the self-test runs
    /// each time.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_within(
        processor: Processor,
        memory_limit: u64,
        observer: &dyn SelfTestObserver,
    ) -> Result<Self, EvalError> {
        let Some((number, description)) = processor.adapter()? else { return Ok(Self::default()) };
        tracing::info!(number, adapter = %description, "chose a graphics adapter");
        let options = GpuOptions { memory_limit: memory_limit.max(MIN_MEMORY), ..GpuOptions::default() };
        let renderer = GpuRenderer::observed(&AdapterChoice::Index(number), options, observer);
        let renderer = renderer.map_err(|error| ModelError::from(SplatError::from(error)))?;
        let backend = Backend::shared(Box::new(renderer), Some(adapter_record(&description)));
        Ok(Self { processor: Processor::Wgpu(Some(number)), backend })
    }

    /// The device of networks; the first call opens it.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the adapter cannot be opened, or the build runs networks on the CPU only.
    pub fn network(&self) -> Result<Device, EvalError> {
        Ok(self.processor.open()?)
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

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_splat::gpu::GpuError;
    use atsplat_splat::{GaussianParts, Gaussians, RenderOptions, View};

    use super::*;

    /// A byte is too little for the self-test, so that the least limit applies. It allows two million pixels.
    #[test]
    fn a_rendering_on_an_adapter_stays_within_the_limit() {
        let device = match ComputeDevice::open_within(Processor::Wgpu(None), 1, &()) {
            Ok(device) => device,
            Err(EvalError::Model(ModelError::Splat(SplatError::Gpu(error @ GpuError::NoAdapter { .. })))) => {
                return atsplat_tests::skip_without_graphics("eval device", error);
            }
            Err(error) => panic!("{error}"),
        };
        let Backend::Shared(renderer, _) = device.backend() else { panic!("an adapter has a renderer") };
        let parts = GaussianParts {
            means: vec![[0.0, 0.0, 2.0]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-2.0; 3]],
            opacity_logits: vec![1.0],
            sh: vec![[0.5; 3]],
            ..GaussianParts::default()
        };
        let gaussians = Gaussians::new(parts).unwrap();
        let render = |width: u32, height: u32| {
            let camera =
                Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
            let view = View { camera, size: ImageSize { width, height } };
            let rendered = renderer.lock().unwrap().render(&gaussians, &view, &RenderOptions::default());
            rendered.map(drop).map_err(|error| error.to_string())
        };
        assert_eq!(render(40, 30), Ok(()));
        let refused = render(3000, 2000).unwrap_err();
        assert!(refused.ends_with("the limit is 67108864"), "{refused}");
    }
}
