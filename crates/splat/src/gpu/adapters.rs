use std::fmt::{self, Display, Formatter};

use super::GpuError;

/// Which adapter to render on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// What the environment variable [`ADAPTER_VARIABLE`] names; without it the first discrete one, else integrated,
    /// else virtual, else software, Vulkan, Metal and DX12 before GL.
    #[default]
    Automatic,
    /// Position in the list of [`adapters`].
    Index(usize),
    /// Part of its name or of its backend's, in any case, as `radeon`, `gl` or `llvmpipe`.
    Name(String),
}

/// Overrides [`AdapterChoice::Automatic`]: a position in the list of [`adapters`] or part of a name.
pub const ADAPTER_VARIABLE: &str = "ATSPLAT_ADAPTER";

/// What kind of processor an adapter is, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A graphics card.
    Discrete,
    /// Part of the main processor.
    Integrated,
    /// Inside a virtual machine.
    Virtual,
    /// The driver does not say.
    Unknown,
    /// The main processor itself.
    Software,
}

/// One way to reach a graphics processor.
#[derive(Clone, Debug, PartialEq)]
pub struct AdapterDescription {
    /// As its driver calls it.
    pub name: String,
    /// As `Vulkan` or `Gl`.
    pub backend: String,
    /// What it is.
    pub kind: AdapterKind,
    /// Name and version of the driver, as far as it tells.
    pub driver: String,
    /// Bytes that a kernel can see of one buffer.
    pub largest_binding: u64,
    /// Bytes of the largest buffer.
    pub largest_buffer: u64,
    /// Buffers that one kernel can see.
    pub storage_buffers: u32,
    /// Workgroups along one dimension of a dispatch.
    pub workgroups: u32,
    /// Whether it can time its own work.
    pub timestamps: bool,
}

impl AdapterDescription {
    fn of(adapter: &wgpu::Adapter) -> Self {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        Self {
            name: info.name,
            backend: format!("{:?}", info.backend),
            kind: match info.device_type {
                wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
                wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
                wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
                wgpu::DeviceType::Cpu => AdapterKind::Software,
                wgpu::DeviceType::Other => AdapterKind::Unknown,
            },
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            largest_binding: limits.max_storage_buffer_binding_size,
            largest_buffer: limits.max_buffer_size,
            storage_buffers: limits.max_storage_buffers_per_shader_stage,
            workgroups: limits.max_compute_workgroups_per_dimension,
            timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
        }
    }

    /// Smaller is better.
    fn rank(&self) -> (AdapterKind, bool) {
        (self.kind, self.backend == "Gl")
    }

    fn answers_to(&self, name: &str) -> bool {
        self.to_string().to_lowercase().contains(&name.to_lowercase())
    }
}

impl Display for AdapterDescription {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} ({})", self.name, self.backend)
    }
}

/// Every adapter that Vulkan, Metal, DX12 and GL offer, in the drivers' order. Empty where there is none.
pub fn adapters() -> Vec<AdapterDescription> {
    found().into_iter().map(|(_, description)| description).collect()
}

fn found() -> Vec<(wgpu::Adapter, AdapterDescription)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    adapters
        .into_iter()
        .map(|adapter| {
            let description = AdapterDescription::of(&adapter);
            (adapter, description)
        })
        .collect()
}

/// The adapter that a choice means.
pub(super) fn choose(choice: &AdapterChoice) -> Result<(wgpu::Adapter, AdapterDescription), GpuError> {
    let found = found();
    let names = || found.iter().map(|(_, description)| description.to_string()).collect::<Vec<_>>().join(", ");
    let listed = if found.is_empty() { "none".to_owned() } else { names() };
    let choice = match (choice, std::env::var(ADAPTER_VARIABLE)) {
        (AdapterChoice::Automatic, Ok(wanted)) if !wanted.is_empty() => {
            wanted.parse().map_or_else(|_| AdapterChoice::Name(wanted.clone()), AdapterChoice::Index)
        }
        _ => choice.clone(),
    };
    let at = position(&choice, &found.iter().map(|(_, description)| description.clone()).collect::<Vec<_>>());
    let expected = match &choice {
        AdapterChoice::Automatic => "any".to_owned(),
        AdapterChoice::Index(index) => format!("number {index}"),
        AdapterChoice::Name(name) => format!("one named '{name}'"),
    };
    at.and_then(|at| found.into_iter().nth(at)).ok_or(GpuError::NoAdapter { expected, found: listed })
}

fn position(choice: &AdapterChoice, found: &[AdapterDescription]) -> Option<usize> {
    let best = |wanted: &dyn Fn(&AdapterDescription) -> bool| {
        let fitting = found.iter().enumerate().filter(|(_, description)| wanted(description));
        fitting.min_by_key(|(at, description)| (description.rank(), *at)).map(|(at, _)| at)
    };
    match choice {
        AdapterChoice::Automatic => best(&|_| true),
        AdapterChoice::Index(index) => (*index < found.len()).then_some(*index),
        AdapterChoice::Name(name) => best(&|description| description.answers_to(name)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(name: &str, backend: &str, kind: AdapterKind) -> AdapterDescription {
        AdapterDescription {
            name: name.to_owned(),
            backend: backend.to_owned(),
            kind,
            driver: String::new(),
            largest_binding: 1 << 27,
            largest_buffer: 1 << 28,
            storage_buffers: 8,
            workgroups: 65_535,
            timestamps: false,
        }
    }

    #[test]
    fn cards_come_before_software_and_names_are_found() {
        let found = [
            one("llvmpipe", "Vulkan", AdapterKind::Software),
            one("Radeon", "Gl", AdapterKind::Discrete),
            one("Radeon", "Vulkan", AdapterKind::Discrete),
            one("UHD 630", "Vulkan", AdapterKind::Integrated),
        ];
        assert_eq!(position(&AdapterChoice::Automatic, &found), Some(2));
        assert_eq!(position(&AdapterChoice::Name("radeon".to_owned()), &found), Some(2));
        assert_eq!(position(&AdapterChoice::Name("(gl)".to_owned()), &found), Some(1));
        assert_eq!(position(&AdapterChoice::Name("uhd".to_owned()), &found), Some(3));
        assert_eq!(position(&AdapterChoice::Name("apple".to_owned()), &found), None);
        assert_eq!(position(&AdapterChoice::Index(4), &found), None);
        assert_eq!(position(&AdapterChoice::Automatic, &[]), None);
    }
}
