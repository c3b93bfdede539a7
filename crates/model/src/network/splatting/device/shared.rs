//! The renderer that shares burn's device.

use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use atsplat_splat::gpu::{GpuCounts, GpuOptions, GpuRenderer};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Cube, CubeDevice, DispatchDevice, TensorMetadata as _};
use burn::tensor::Device;
use burn::tensor::wgpu::WgpuSetup;

/// The renderer that shares burn's device, or why there is none.
static SHARED: OnceLock<Result<Shared, String>> = OnceLock::new();

struct Shared {
    device: CubeDevice,
    renderer: Mutex<GpuRenderer>,
}

/// Opens a renderer on burn's device, if it passes its self-test there.
pub(in crate::network) fn share(device: &Device, setup: &WgpuSetup) {
    let open = || {
        let DispatchDevice::Cube(device) = device.as_dispatch() else {
            return Err("the device is not a GPU".to_owned());
        };
        let opened = GpuRenderer::with_device(setup.device.clone(), setup.queue.clone(), GpuOptions::default());
        let mut renderer = opened.map_err(|error| error.to_string())?;
        renderer.self_test().map_err(|error| error.to_string())?;
        renderer.free_buffers();
        Ok(Shared { device: device.clone(), renderer: Mutex::new(renderer) })
    };
    SHARED.get_or_init(open);
}

/// Whether a renderer shares burn's device.
pub(in crate::network) fn is_shared() -> bool {
    SHARED.get().is_some_and(Result::is_ok)
}

/// What passed between the host and the device in renderings, if a renderer shares burn's device.
pub(in crate::network) fn counts() -> Option<GpuCounts> {
    let shared = SHARED.get()?.as_ref().ok()?;
    Some(shared.renderer.lock().unwrap_or_else(PoisonError::into_inner).counts())
}

/// Why no renderer shares burn's device, if opening one failed.
pub(in crate::network) fn render_error() -> Option<String> {
    SHARED.get().and_then(|shared| shared.as_ref().err().cloned())
}

/// The renderer of a tensor's device.
pub(super) fn renderer_of(tensor: &FloatTensor<Cube>) -> Option<MutexGuard<'static, GpuRenderer>> {
    let shared = SHARED.get()?.as_ref().ok().filter(|shared| shared.device == tensor.device())?;
    Some(shared.renderer.lock().unwrap_or_else(PoisonError::into_inner))
}
