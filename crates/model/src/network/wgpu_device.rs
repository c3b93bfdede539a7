//! Opens graphics adapters for burn by their number.

use std::sync::OnceLock;

use atsplat_splat::gpu::{AdapterDescription, AdapterKind, adapters};
use burn::backend::DispatchDevice;
use burn::tensor::wgpu::{WgpuBackend, WgpuSetup};
use burn::tensor::{Device, DeviceKind};

use super::splatting;

/// The adapter that this process opened: burn opens a device once.
static OPENED: OnceLock<Opened> = OnceLock::new();

struct Opened {
    number: usize,
    adapter: AdapterDescription,
    device: Result<Device, String>,
}

/// The adapter's device; a renderer shares it.
pub(super) fn open(number: usize, adapter: AdapterDescription) -> Result<Device, String> {
    let opened = OPENED.get_or_init(|| {
        let device = started(number, &adapter);
        Opened { number, adapter, device }
    });
    if opened.number == number {
        return opened.device.clone();
    }
    Err(format!("expected adapter {}, which this process opened before, found {number}", opened.number))
}

/// The adapter of a device; `None` for the CPU.
pub(super) fn adapter_of(device: &Device) -> Option<AdapterDescription> {
    let is_opened = matches!(device.as_dispatch(), DispatchDevice::Cube(_));
    OPENED.get().filter(|_| is_opened).map(|opened| opened.adapter.clone())
}

fn started(number: usize, expected: &AdapterDescription) -> Result<Device, String> {
    let api = match expected.backend.as_str() {
        "Vulkan" => WgpuBackend::Vulkan,
        "Metal" => WgpuBackend::Metal,
        "Dx12" => WgpuBackend::Dx12,
        "Gl" => WgpuBackend::Gl,
        other => return Err(format!("expected Vulkan, Metal, Dx12 or Gl, found {other}")),
    };
    // burn counts the adapters of each interface by their kind.
    let same = |other: &&AdapterDescription| (other.kind, &other.backend) == (expected.kind, &expected.backend);
    let at = adapters().iter().take(number).filter(same).count();
    let kind = match expected.kind {
        AdapterKind::Discrete => DeviceKind::DiscreteGpu(at),
        AdapterKind::Integrated => DeviceKind::IntegratedGpu(at),
        AdapterKind::Virtual => DeviceKind::VirtualGpu(at),
        AdapterKind::Software => DeviceKind::Cpu,
        AdapterKind::Unknown => {
            return Err(format!("the driver of {expected} does not say which kind of adapter it is"));
        }
    };
    let options = Device::wgpu_options().graphics_api(api).device_kind(kind);
    let (device, setup) = options.init_with_setup().map_err(|error| error.to_string())?;
    check(&setup, expected)?;
    splatting::share(&device, &setup);
    Ok(device)
}

/// Rejects another adapter than the expected one, in case the driver lists them in another order.
fn check(setup: &WgpuSetup, expected: &AdapterDescription) -> Result<(), String> {
    let info = setup.adapter.get_info();
    let driver = format!("{} {}", info.driver, info.driver_info);
    if info.name == expected.name && driver.trim() == expected.driver {
        return Ok(());
    }
    Err(format!("expected the adapter {expected}, {}, found {}, {}", expected.driver, info.name, driver.trim()))
}
