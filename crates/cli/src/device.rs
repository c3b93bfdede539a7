//! `--device`: where networks run and Gaussians are rendered.

use std::str::FromStr;

use anyhow::{Context as _, anyhow};
use atsplat_eval::method::Backend;
use atsplat_eval::{ComputeDevice, EvalError};
use atsplat_model::network::Processor;
use atsplat_splat::ReferenceRenderer;

use crate::adapter_self_test::AdapterSelfTests;
use crate::requirements::GivenOption;

#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct DeviceArgs {
    /// Where networks run and Gaussians are rendered: cpu, wgpu (the best graphics adapter) or wgpu:N (number N of
    /// `atsplat adapters`). The adapter must pass its test and is recorded. Networks run on one only in builds with
    /// `--features gpu-network`.
    #[arg(long = "device", value_name = "cpu|wgpu[:N]", default_value = "cpu")]
    pub(crate) processor: Processor,
}

impl DeviceArgs {
    /// The option, if it names an adapter.
    pub(crate) fn option(self) -> GivenOption {
        ("--device", self.processor != Processor::Cpu)
    }

    /// Opens the device of an evaluation, and tests an adapter that was not tested before.
    pub(crate) fn open(self) -> anyhow::Result<ComputeDevice> {
        self.opened(|tests| ComputeDevice::open(self.processor, tests))
    }

    /// Like [`Self::open`], with a limit on the bytes of a rendering in an adapter's memory.
    pub(crate) fn open_within(self, memory_limit: u64) -> anyhow::Result<ComputeDevice> {
        self.opened(|tests| ComputeDevice::open_within(self.processor, memory_limit, tests))
    }

    fn opened(
        self,
        open: impl FnOnce(&AdapterSelfTests) -> Result<ComputeDevice, EvalError>,
    ) -> anyhow::Result<ComputeDevice> {
        if self.processor == Processor::Cpu {
            return Ok(ComputeDevice::default());
        }
        let tests = AdapterSelfTests::new(false);
        let device = open(&tests);
        tests.finish();
        device.map_err(|error| anyhow!("{}: {error}; {ADVICE}", self.name()))
    }

    /// Like [`Self::open`], for networks: a build that cannot run them on an adapter is rejected first.
    pub(crate) fn open_for_networks(self) -> anyhow::Result<ComputeDevice> {
        self.check_networks()?;
        self.open()
    }

    /// Rejects an adapter in a build that cannot run networks on one.
    pub(crate) fn check_networks(self) -> anyhow::Result<()> {
        self.processor.check_build().with_context(|| self.name())
    }

    fn name(self) -> String {
        format!("--device {}", self.processor)
    }
}

/// What helps if an adapter cannot be opened: nothing takes its place.
const ADVICE: &str = "`atsplat adapters` lists and tests all adapters, `--device cpu` needs none";

/// [`DeviceArgs`] of a command that runs no networks and has one renderer more.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct RendererArgs {
    /// Where Gaussians are rendered: cpu (all cores, vector instructions, f32 pixels), reference (the CPU, slow and simple, in
    /// f64), wgpu (the best graphics adapter) or wgpu:N (number N of `atsplat adapters`). The adapter must pass its test.
    #[arg(long = "device", value_name = "cpu|reference|wgpu[:N]", default_value = "cpu")]
    renderer: RendererArg,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RendererArg {
    Reference,
    On(Processor),
}

impl FromStr for RendererArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "reference" {
            return Ok(Self::Reference);
        }
        text.parse().map(Self::On).map_err(|error: String| format!("neither reference nor a device: {error}"))
    }
}

impl RendererArgs {
    /// Opens the renderer, and tests an adapter that was not tested before.
    pub(crate) fn open(self) -> anyhow::Result<Backend> {
        match self.renderer {
            RendererArg::Reference => Ok(Backend::shared(Box::new(ReferenceRenderer), None)),
            RendererArg::On(processor) => Ok(DeviceArgs { processor }.open()?.backend()),
        }
    }
}
