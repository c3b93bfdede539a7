use std::fmt;

use burn::tensor::Device;
use serde::Serialize;

use crate::ModelError;

/// Where a network computes.
///
/// On [`Processor::Wgpu`], operations take their generic form and the bits are other ones: see [`Processor::open`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Processor {
    /// The central processor: kernels of this toolkit, the same bits for any number of threads.
    #[default]
    Cpu,
    /// A graphics processor behind Vulkan, Metal or Direct3D 12; in builds with the feature `gpu-network`.
    Wgpu,
}

impl Processor {
    /// Whether [`GaussianTensors::render`](super::GaussianTensors::render) renders there too, forward and backward, without
    /// its numbers coming to the host. On an adapter that fails the splatter's self-test it does not, nor before
    /// [`Self::open`].
    pub fn renders(self) -> bool {
        match self {
            Self::Cpu => true,
            #[cfg(feature = "gpu-network")]
            Self::Wgpu => super::splatting::is_shared(),
            #[cfg(not(feature = "gpu-network"))]
            Self::Wgpu => false,
        }
    }

    /// Why pictures are not rendered there after [`Self::open`]: the adapter's or the self-test's words. `None` where they
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
    /// On Mesa's software Vulkan the numbers of a network on wgpu are within 2e-5 of those here, absolute or relative, images of
    /// its Gaussians within 5e-5, and a parameter's gradients through them within 5e-4 of the largest; a score nearer than
    /// 1e-6 to the last that is selected may fall on the other side.
    ///
    /// wgpu takes the fastest adapter that it finds; the environment variable `CUBECL_WGPU_DEFAULT_DEVICE` names another
    /// (`DiscreteGpu(1)`, `IntegratedGpu(0)`, `Cpu`).
    ///
    /// # Errors
    /// [`ModelError::Processor`] where the build lacks it, or where there is no adapter.
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
    let why = "this build computes networks on the central processor alone; `cargo build --features gpu-network` \
               makes one that has wgpu";
    Err(ModelError::Processor { processor: Processor::Wgpu, why: why.to_owned() })
}

/// A process opens it once: burn refuses a second time.
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
