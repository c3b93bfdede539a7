//! Opens graphics adapters for burn by their number.

use std::sync::{Mutex, MutexGuard, PoisonError};

use atsplat_splat::gpu::{AdapterDescription, AdapterKind, adapters};
use burn::backend::DispatchDevice;
use burn::tensor::wgpu::{WgpuBackend, WgpuSetup};
use burn::tensor::{Device, DeviceKind};

use super::splatting;

/// The adapter that this process opened: burn opens a device once. One that could not be opened leaves room for another.
static OPENED: Mutex<Option<Opened>> = Mutex::new(None);

struct Opened {
    number: usize,
    adapter: AdapterDescription,
    device: Device,
}

/// The adapter's device; a renderer shares it.
pub(super) fn open(number: usize, adapter: AdapterDescription) -> Result<Device, String> {
    let mut slot = opened();
    match &*slot {
        Some(opened) if opened.number == number => Ok(opened.device.clone()),
        Some(Opened { number: before, .. }) => {
            Err(format!("expected adapter {before}, which this process opened before, found {number}"))
        }
        None => {
            let device = started(number, &adapter)?;
            *slot = Some(Opened { number, adapter, device: device.clone() });
            Ok(device)
        }
    }
}

/// The adapter of a device; `None` for the CPU.
pub(super) fn adapter_of(device: &Device) -> Option<AdapterDescription> {
    if !matches!(device.as_dispatch(), DispatchDevice::Cube(_)) {
        return None;
    }
    opened().as_ref().map(|opened| opened.adapter.clone())
}

fn opened() -> MutexGuard<'static, Option<Opened>> {
    OPENED.lock().unwrap_or_else(PoisonError::into_inner)
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

#[cfg(test)]
mod tests {
    use super::*;

    /// No adapter has such an interface.
    #[test]
    fn an_adapter_that_cannot_be_opened_does_not_stand_for_the_next_one() {
        let adapter = AdapterDescription {
            name: "a card".to_owned(),
            backend: "Glide".to_owned(),
            kind: AdapterKind::Discrete,
            driver: "a driver".to_owned(),
            largest_binding: 0,
            largest_buffer: 0,
            storage_buffers: 0,
            workgroups: 0,
            timestamps: false,
        };
        for number in [1, 0] {
            let error = open(number, adapter.clone()).unwrap_err();
            assert_eq!(error, "expected Vulkan, Metal, Dx12 or Gl, found Glide", "adapter {number}");
        }
    }
}
