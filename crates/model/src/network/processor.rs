use std::fmt;

use burn::tensor::Device;
use serde::Serialize;

use crate::ModelError;

/// The processor that runs a network.
///
/// On [`Processor::Wgpu`], operations use their generic implementation, and bits differ: see [`Processor::open`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Processor {
    /// The CPU: kernels of this toolkit, the same bits for any number of threads.
    #[default]
    Cpu,
    /// A GPU through Vulkan, Metal or Direct3D 12; in builds with the feature `gpu-network`.
    Wgpu,
}

impl Processor {
    /// Whether [`GaussianTensors::render`](super::GaussianTensors::render) also runs there, forward and backward, without
    /// copies to the host. It does not before [`Self::open`], nor on an adapter that fails the renderer's self-test.
    pub fn renders(self) -> bool {
        match self {
            Self::Cpu => true,
            #[cfg(feature = "gpu-network")]
            Self::Wgpu => super::splatting::is_shared(),
            #[cfg(not(feature = "gpu-network"))]
            Self::Wgpu => false,
        }
    }

    /// Why pictures are not rendered there after [`Self::open`]: the error of the adapter or of the self-test. `None` if they
    /// are.
    pub fn refusal(self) -> Option<String> {
        match self {
            Self::Cpu => None,
            #[cfg(feature = "gpu-network")]
            Self::Wgpu => super::splatting::refusal(),
            #[cfg(not(feature = "gpu-network"))]
            Self::Wgpu => None,
        }
    }

    /// The device, for [`Network::new`](super::Network::new).
    ///
    /// On Mesa's software Vulkan, outputs of a network on wgpu are within 2e-5 of those on the CPU, absolute or relative,
    /// images of its Gaussians within 5e-5, and a parameter's gradients through them within 5e-4 of the largest; a token
    /// whose score is within 1e-6 of the last selected one may be selected differently.
    ///
    /// wgpu takes the fastest adapter that it finds; the environment variable `CUBECL_WGPU_DEFAULT_DEVICE` names another
    /// (`DiscreteGpu(1)`, `IntegratedGpu(0)`, `Cpu`).
    ///
    /// # Errors
    /// [`ModelError::Processor`] if the build lacks wgpu or there is no adapter.
    pub fn open(self) -> Result<Device, ModelError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            Self::Wgpu => wgpu(),
        }
    }
}

impl fmt::Display for Processor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cpu => "cpu",
            Self::Wgpu => "wgpu",
        })
    }
}

#[cfg(not(feature = "gpu-network"))]
fn wgpu() -> Result<Device, ModelError> {
    let why = "this build runs networks only on the CPU; build with `cargo build --features gpu-network` for wgpu";
    Err(ModelError::Processor { processor: Processor::Wgpu, why: why.to_owned() })
}

/// Opens wgpu once per process: burn does not allow a second time.
#[cfg(feature = "gpu-network")]
fn wgpu() -> Result<Device, ModelError> {
    static OPENED: std::sync::OnceLock<Result<Device, String>> = std::sync::OnceLock::new();
    let opened = OPENED.get_or_init(|| {
        let (device, setup) = Device::wgpu_options().init_with_setup().map_err(|error| error.to_string())?;
        super::splatting::share(&device, &setup);
        Ok(device)
    });
    opened.clone().map_err(|why| ModelError::Processor { processor: Processor::Wgpu, why })
}
