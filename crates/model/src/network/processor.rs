use std::fmt;
use std::str::FromStr;

use atsplat_splat::gpu::{AdapterChoice, AdapterDescription, GpuCounts, select};
use burn::tensor::Device;
use serde::Serialize;

use crate::ModelError;

/// The processor that runs a network.
///
/// On [`Processor::Wgpu`], operations use their generic implementation, and bits differ: see [`Processor::open`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Processor {
    /// The CPU: kernels of this toolkit, the same bits for any number of threads.
    #[default]
    Cpu,
    /// A graphics adapter through Vulkan, Metal, Direct3D 12 or OpenGL: that of this number in the list of
    /// [`atsplat_splat::gpu::adapters`], or the one that [`AdapterChoice::Automatic`] selects. Networks run there in builds
    /// with the feature `gpu-network`.
    Wgpu(Option<usize>),
}

impl Processor {
    /// # Errors
    /// [`ModelError::Processor`] if this build does not run networks there.
    pub fn check_build(self) -> Result<(), ModelError> {
        if self == Self::Cpu || cfg!(feature = "gpu-network") {
            return Ok(());
        }
        let why = "this build runs networks only on the CPU; `cargo install --path crates/cli --locked --features \
                   gpu-network` makes one for wgpu";
        Err(ModelError::Processor { processor: self, why: why.to_owned() })
    }

    /// Number and description of the adapter; `None` for the CPU.
    ///
    /// # Errors
    /// [`ModelError::Splat`] if there is no such adapter; the message lists the adapters.
    pub fn adapter(self) -> Result<Option<(usize, AdapterDescription)>, ModelError> {
        let Self::Wgpu(number) = self else { return Ok(None) };
        let choice = number.map_or(AdapterChoice::Automatic, AdapterChoice::Index);
        Ok(Some(select(&choice).map_err(atsplat_splat::SplatError::from)?))
    }

    /// Whether [`GaussianTensors::render`](super::GaussianTensors::render) also runs there, forward and backward, without
    /// copies to the host. It does not before [`Self::open`], nor on an adapter that fails the renderer's self-test.
    pub fn renders(self) -> bool {
        match self {
            Self::Cpu => true,
            #[cfg(feature = "gpu-network")]
            Self::Wgpu(_) => super::splatting::is_shared(),
            #[cfg(not(feature = "gpu-network"))]
            Self::Wgpu(_) => false,
        }
    }

    /// Why images are not rendered there after [`Self::open`]: the error of the adapter or of the self-test. `None` if they
    /// are.
    pub fn render_error(self) -> Option<String> {
        match self {
            Self::Cpu => None,
            #[cfg(feature = "gpu-network")]
            Self::Wgpu(_) => super::splatting::render_error(),
            #[cfg(not(feature = "gpu-network"))]
            Self::Wgpu(_) => None,
        }
    }

    /// What passed between the host and an adapter in renderings so far; `None` where nothing is rendered on an adapter.
    pub fn rendering_counts(self) -> Option<GpuCounts> {
        match self {
            Self::Cpu => None,
            #[cfg(feature = "gpu-network")]
            Self::Wgpu(_) => super::splatting::counts(),
            #[cfg(not(feature = "gpu-network"))]
            Self::Wgpu(_) => None,
        }
    }

    /// The device, for [`Network::new`](super::Network::new). A process opens one adapter.
    ///
    /// On Mesa's software Vulkan, outputs of a network on wgpu are within 2e-5 of those on the CPU, absolute or relative,
    /// images of its Gaussians within 5e-5, and a parameter's gradients through them within 5e-4 of the largest; a token
    /// whose score is within 1e-6 of the last selected one may be selected differently.
    ///
    /// # Errors
    /// [`ModelError::Processor`] if the build lacks wgpu, the adapter cannot be opened, or the process opened another one;
    /// those of [`Self::adapter`].
    pub fn open(self) -> Result<Device, ModelError> {
        self.check_build()?;
        #[cfg(feature = "gpu-network")]
        if let Some((number, description)) = self.adapter()? {
            let opened = super::wgpu_device::open(number, description);
            return opened.map_err(|why| ModelError::Processor { processor: self, why });
        }
        Ok(Device::flex())
    }
}

impl FromStr for Processor {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = text.strip_prefix("wgpu:").map(|number| number.parse().ok());
        match (text, number) {
            ("cpu", _) => Ok(Self::Cpu),
            ("wgpu", _) => Ok(Self::Wgpu(None)),
            (_, Some(Some(number))) => Ok(Self::Wgpu(Some(number))),
            _ => Err(format!("expected cpu, wgpu or wgpu:N, N as `atsplat adapters` numbers them, found {text:?}")),
        }
    }
}

impl fmt::Display for Processor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Wgpu(None) => f.write_str("wgpu"),
            Self::Wgpu(Some(number)) => write!(f, "wgpu:{number}"),
        }
    }
}

impl Serialize for Processor {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn devices_have_one_spelling() {
        let named = [("cpu", Processor::Cpu), ("wgpu", Processor::Wgpu(None)), ("wgpu:3", Processor::Wgpu(Some(3)))];
        for (text, processor) in named {
            assert_eq!((text.parse(), processor.to_string().as_str()), (Ok(processor), text));
        }
        for broken in ["", "gpu", "cpu:0", "wgpu:", "wgpu:-1", "wgpu:one", "wgpu 1", "WGPU"] {
            let error = broken.parse::<Processor>().unwrap_err();
            assert!(error.contains("wgpu:N") && error.contains(&format!("{broken:?}")), "{error}");
        }
    }
}
