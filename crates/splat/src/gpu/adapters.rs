use std::fmt::{self, Display, Formatter};

use super::panics::catch_panics;
use super::{GpuError, GpuOptions, GpuRenderer, SelfTestKey, SelfTestObserver, SelfTestResult};

/// Which adapter to render on.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The adapter named by the environment variable [`ADAPTER_VARIABLE`]; without it the first discrete one, then
    /// integrated, virtual and software, with Vulkan, Metal and DX12 before GL.
    #[default]
    Automatic,
    /// Index in the list of [`adapters`]. From 100 on, beyond the list, a model number in the name, such as 630 or
    /// 4090.
    Index(usize),
    /// Case-insensitive part of the adapter's or backend's name, such as `radeon`, `gl` or `llvmpipe`.
    Name(String),
}

/// Environment variable that overrides [`AdapterChoice::Automatic`]: an index in the list of [`adapters`], or part of a
/// name.
pub const ADAPTER_VARIABLE: &str = "ATSPLAT_ADAPTER";

/// Smaller numbers are always indices.
const MODEL_NUMBERS: usize = 100;

/// Kind of an adapter, best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A discrete GPU.
    Discrete,
    /// A GPU integrated into the CPU.
    Integrated,
    /// A virtual GPU.
    Virtual,
    /// Not reported by the driver.
    Unknown,
    /// A software renderer on the CPU.
    Software,
}

impl AdapterKind {
    /// Name, for display and files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Discrete => "discrete",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Unknown => "unknown",
            Self::Software => "software",
        }
    }
}

/// A GPU, as reached through one backend.
#[derive(Clone, Debug, PartialEq)]
pub struct AdapterDescription {
    /// Name reported by the driver.
    pub name: String,
    /// Such as `Vulkan` or `Gl`.
    pub backend: String,
    /// Its kind.
    pub kind: AdapterKind,
    /// Name and version of the driver, as far as reported.
    pub driver: String,
    /// Largest binding of a storage buffer, in bytes.
    pub largest_binding: u64,
    /// Largest buffer, in bytes.
    pub largest_buffer: u64,
    /// Storage buffers per kernel.
    pub storage_buffers: u32,
    /// Workgroups along one dimension of a dispatch.
    pub workgroups: u32,
    /// Whether it supports timestamp queries.
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

    fn matches_name(&self, name: &str) -> bool {
        self.to_string().to_lowercase().contains(&name.to_lowercase())
    }

    fn has_number(&self, number: usize) -> bool {
        self.name.split(|c: char| !c.is_ascii_digit()).any(|digits| digits == number.to_string())
    }
}

impl Display for AdapterDescription {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} ({})", self.name, self.backend)
    }
}

/// Every adapter of Vulkan, Metal, DX12 and GL, in the drivers' order. May be empty.
pub fn adapters() -> Vec<AdapterDescription> {
    found().into_iter().map(|(_, description)| description).collect()
}

/// Number in the list of [`adapters`], and description, of the adapter that a choice selects.
///
/// # Errors
/// [`GpuError::NoAdapter`], which lists the adapters.
pub fn select(choice: &AdapterChoice) -> Result<(usize, AdapterDescription), GpuError> {
    let found = adapters();
    let (requested, choice) = (choice, resolve(choice));
    let at = positions(&choice, &found).first().copied();
    at.and_then(|at| Some((at, found.get(at)?.clone()))).ok_or_else(|| no_adapter(requested, &choice, &found))
}

/// An adapter and the result of its self-test.
#[derive(Clone, Debug)]
pub struct ExaminedAdapter {
    /// The adapter.
    pub description: AdapterDescription,
    /// Why it cannot be used, if so.
    pub outcome: Result<(), GpuError>,
    /// Whether the result is that of an earlier test, which was cached.
    pub cached: bool,
}

/// Tests every adapter; those whose result `observer` has cached are not tested again.
pub fn examine(observer: &dyn SelfTestObserver) -> Vec<ExaminedAdapter> {
    let examined = found().into_iter().map(|candidate| {
        let description = candidate.1.clone();
        let known = cached_result(&description, &GpuOptions::default(), observer);
        let cached = known.is_some();
        let outcome = match known {
            Some(result) => result.outcome(&description.to_string()),
            None => GpuRenderer::open(&candidate, GpuOptions::default(), observer).map(drop),
        };
        ExaminedAdapter { description, outcome, cached }
    });
    examined.collect()
}

/// The cached result of an earlier test.
pub(super) fn cached_result(
    description: &AdapterDescription,
    options: &GpuOptions,
    observer: &dyn SelfTestObserver,
) -> Option<SelfTestResult> {
    cache_key(description, options).and_then(|key| observer.cached(&key))
}

/// The key of a result that stays valid: of a test with default options, on a driver that reports its version. Metal reports none,
/// so that an update of the system would not be noticed.
pub(super) fn cache_key(description: &AdapterDescription, options: &GpuOptions) -> Option<SelfTestKey> {
    let stays_valid = *options == GpuOptions::default() && !description.driver.is_empty();
    stays_valid.then(|| SelfTestKey::of(description))
}

/// All adapters; a driver that panics while listing them counts as having none.
fn found() -> Vec<(wgpu::Adapter, AdapterDescription)> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters_of = |backend: wgpu::Backends| {
        let listed = catch_panics("adapters", || Ok(pollster::block_on(instance.enumerate_adapters(backend))));
        listed.unwrap_or_default().into_iter().map(|adapter| {
            let description = AdapterDescription::of(&adapter);
            (adapter, description)
        })
    };
    let backends = [wgpu::Backends::VULKAN, wgpu::Backends::METAL, wgpu::Backends::DX12, wgpu::Backends::GL];
    backends.into_iter().flat_map(adapters_of).collect()
}

/// An adapter and its description.
pub(super) type Candidate = (wgpu::Adapter, AdapterDescription);

/// The best adapter for a choice.
pub(super) fn choose(choice: &AdapterChoice) -> Result<Candidate, GpuError> {
    let found = found();
    let (requested, choice) = (choice, resolve(choice));
    let descriptions: Vec<_> = found.iter().map(|(_, description)| description.clone()).collect();
    let at = positions(&choice, &descriptions).first().copied();
    at.and_then(|at| found.get(at).cloned()).ok_or_else(|| no_adapter(requested, &choice, &descriptions))
}

/// The error of a choice that matches none of these adapters; the environment variable may have resolved it from the one requested.
fn no_adapter(requested: &AdapterChoice, choice: &AdapterChoice, found: &[AdapterDescription]) -> GpuError {
    let mut expected = match choice {
        AdapterChoice::Automatic => "any".to_owned(),
        AdapterChoice::Index(index) => format!("number {index}"),
        AdapterChoice::Name(name) => format!("one named '{name}'"),
    };
    if requested != choice {
        expected.push_str(", by the environment variable ");
        expected.push_str(ADAPTER_VARIABLE);
    }
    let names: Vec<String> = found.iter().enumerate().map(|(at, adapter)| format!("{at} {adapter}")).collect();
    GpuError::NoAdapter { expected, found: if names.is_empty() { "none".to_owned() } else { names.join(", ") } }
}

/// The choice, with [`AdapterChoice::Automatic`] replaced by the environment variable if set.
fn resolve(choice: &AdapterChoice) -> AdapterChoice {
    match (choice, std::env::var_os(ADAPTER_VARIABLE)) {
        (AdapterChoice::Automatic, Some(value)) if !value.is_empty() => {
            let value = value.to_string_lossy();
            value.parse().map_or_else(|_| AdapterChoice::Name(value.clone().into_owned()), AdapterChoice::Index)
        }
        _ => choice.clone(),
    }
}

/// Indices of the adapters that match a choice, best first.
fn positions(choice: &AdapterChoice, found: &[AdapterDescription]) -> Vec<usize> {
    let best_first = |matches: &dyn Fn(&AdapterDescription) -> bool| {
        let mut fitting: Vec<usize> =
            found.iter().enumerate().filter(|(_, description)| matches(description)).map(|(at, _)| at).collect();
        fitting.sort_by_key(|at| found.get(*at).map(AdapterDescription::rank));
        fitting
    };
    match choice {
        AdapterChoice::Automatic => best_first(&|_| true),
        AdapterChoice::Index(index) if *index < found.len() => vec![*index],
        AdapterChoice::Index(index) if *index >= MODEL_NUMBERS => {
            best_first(&|description| description.has_number(*index))
        }
        AdapterChoice::Index(_) => Vec::new(),
        AdapterChoice::Name(name) => best_first(&|description| description.matches_name(name)),
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
    fn discrete_adapters_come_first_and_names_match() {
        let found = [
            one("llvmpipe", "Vulkan", AdapterKind::Software),
            one("Radeon", "Gl", AdapterKind::Discrete),
            one("Radeon", "Vulkan", AdapterKind::Discrete),
            one("UHD 630", "Vulkan", AdapterKind::Integrated),
        ];
        let position = |choice: &AdapterChoice| positions(choice, &found).first().copied();
        assert_eq!(position(&AdapterChoice::Automatic), Some(2));
        assert_eq!(position(&AdapterChoice::Name("radeon".to_owned())), Some(2));
        assert_eq!(position(&AdapterChoice::Name("(gl)".to_owned())), Some(1));
        assert_eq!(position(&AdapterChoice::Name("uhd".to_owned())), Some(3));
        assert_eq!(position(&AdapterChoice::Name("apple".to_owned())), None);
        assert_eq!(position(&AdapterChoice::Index(4)), None);
        assert_eq!(positions(&AdapterChoice::Automatic, &[]), [0; 0]);
        // The same GPU through another backend, then the next best.
        assert_eq!(positions(&AdapterChoice::Automatic, &found), [2, 1, 3, 0]);
    }

    #[test]
    fn an_error_about_the_environment_variable_names_it() {
        let choice = AdapterChoice::Name("apple".to_owned());
        let expected = |requested| no_adapter(requested, &choice, &[]).to_string();
        assert!(
            expected(&AdapterChoice::Automatic)
                .contains("one named 'apple', by the environment variable ATSPLAT_ADAPTER")
        );
        assert!(!expected(&choice).contains(ADAPTER_VARIABLE));
    }

    #[test]
    fn results_are_cached_for_drivers_that_report_a_version() {
        struct Passed;
        impl SelfTestObserver for Passed {
            fn cached(&self, _key: &SelfTestKey) -> Option<SelfTestResult> {
                Some(SelfTestResult { fault: None })
            }
        }
        let unnamed = one("Apple M2", "Metal", AdapterKind::Integrated);
        let named = AdapterDescription { driver: "Mesa 25.0".to_owned(), ..unnamed.clone() };
        let usual = GpuOptions::default();
        let limited = GpuOptions { memory_limit: 1 << 30, ..usual };
        let found = [(&named, &usual), (&unnamed, &usual), (&named, &limited)]
            .map(|(description, options)| cached_result(description, options, &Passed).is_some());
        assert_eq!(found, [true, false, false]);
    }

    #[test]
    fn model_numbers_match_names() {
        let found = [
            one("llvmpipe (LLVM 15.0.6, 256 bits)", "Vulkan", AdapterKind::Software),
            one("NVIDIA GeForce RTX 4090", "Vulkan", AdapterKind::Discrete),
            one("UHD 630", "Vulkan", AdapterKind::Integrated),
        ];
        for (number, expected) in [(0, Some(0)), (4090, Some(1)), (630, Some(2)), (409, None), (15, None), (3, None)] {
            assert_eq!(positions(&AdapterChoice::Index(number), &found).first().copied(), expected, "{number}");
        }
    }
}
