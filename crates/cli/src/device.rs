//! `--device`: where networks run and Gaussians are rendered.

use anyhow::Context as _;
use atsplat_eval::ComputeDevice;
use atsplat_model::network::Processor;

use crate::adapter_tests::AdapterTests;

#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct DeviceArgs {
    /// Where networks run and Gaussians are rendered: cpu, wgpu (the best graphics adapter) or wgpu:N (number N of
    /// `atsplat adapters`). The adapter must pass its test and is recorded. Networks run on one only in builds with
    /// `--features gpu-network`.
    #[arg(long = "device", value_name = "cpu|wgpu[:N]", default_value = "cpu")]
    pub(crate) processor: Processor,
}

impl DeviceArgs {
    /// Rejects an adapter that nothing would run on.
    pub(crate) fn check(self, is_used: bool) -> Result<(), String> {
        if is_used || self.processor == Processor::Cpu {
            return Ok(());
        }
        Err(format!("{}: no method has a network or Gaussians to render; images are compared on the CPU", self.name()))
    }

    /// Opens the device of an evaluation, and tests an adapter that was not tested before.
    pub(crate) fn open(self) -> anyhow::Result<ComputeDevice> {
        if self.processor == Processor::Cpu {
            return Ok(ComputeDevice::default());
        }
        let tests = AdapterTests::new(false);
        let device = ComputeDevice::open(self.processor, &tests);
        tests.finish();
        device.with_context(|| self.name())
    }

    /// Like [`Self::open`], for networks: a build that cannot run them on an adapter is rejected first.
    pub(crate) fn open_for_networks(self) -> anyhow::Result<ComputeDevice> {
        self.processor.check_build().with_context(|| self.name())?;
        self.open()
    }

    fn name(self) -> String {
        format!("--device {}", self.processor)
    }
}
