use serde::{Deserialize, Serialize};

use super::adapters::AdapterDescription;
use super::kernels::Kernel;
use super::layout::shared_constants;
use super::{GpuError, self_test};

/// Key of a self-test's result, which is valid until the adapter, its driver, wgpu, the kernels, the test or its reference change.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct SelfTestKey {
    /// Name reported by the driver.
    pub adapter: String,
    /// Such as `Vulkan` or `Gl`.
    pub backend: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Hash of the kernels, the test, the reference, and the versions of wgpu and its parts.
    pub version: String,
}

/// Result of a self-test.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct SelfTestResult {
    /// The wrong result, if any.
    pub fault: Option<WrongResult>,
}

/// A result that exceeds its error bound.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct WrongResult {
    /// The image or gradient.
    pub what: String,
    /// Largest difference found; `None` for NaN and infinity.
    pub difference: Option<f64>,
    /// Whether it is infinite.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_infinite: bool,
    /// Largest difference allowed.
    pub bound: f64,
}

/// Stage of examining an adapter; each may take minutes if a driver compiles kernels slowly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbeStage {
    /// The device is opened and its loop limit is probed.
    Opening,
    /// Images are rendered and compared.
    Image,
    /// Their gradients are computed and compared.
    Derivative,
}

/// Observes the examination of adapters, and may cache the results of tests.
pub trait SelfTestObserver {
    /// A stage begins.
    fn begins(&self, _adapter: &AdapterDescription, _stage: ProbeStage) {}

    /// The cached result of an earlier test, which is then not repeated.
    fn cached(&self, _key: &SelfTestKey) -> Option<SelfTestResult> {
        None
    }

    /// A test passed, or failed deterministically. Results that may differ next time, such as a lost device, are not
    /// stored.
    fn store(&self, _key: &SelfTestKey, _result: &SelfTestResult) {}
}

/// Ignores everything.
impl SelfTestObserver for () {}

impl SelfTestKey {
    /// The key of an adapter.
    pub fn of(description: &AdapterDescription) -> Self {
        Self {
            adapter: description.name.clone(),
            backend: description.backend.clone(),
            driver: description.driver.clone(),
            version: version(&LIBRARIES),
        }
    }
}

impl SelfTestResult {
    /// The result of a test; `None` if it may differ next time.
    pub(super) fn of(outcome: &Result<(), GpuError>) -> Option<Self> {
        match outcome {
            Ok(()) => Some(Self { fault: None }),
            Err(GpuError::SelfTest { what, difference, bound, .. }) => {
                let (what, is_infinite, bound) = (what.clone(), difference.is_infinite(), *bound);
                let difference = difference.is_finite().then_some(*difference);
                Some(Self { fault: Some(WrongResult { what, difference, is_infinite, bound }) })
            }
            Err(_) => None,
        }
    }

    /// Converts it back to what the test returned.
    ///
    /// # Errors
    /// [`GpuError::SelfTest`].
    pub fn outcome(&self, adapter: &str) -> Result<(), GpuError> {
        let Some(WrongResult { what, difference, is_infinite, bound }) = &self.fault else { return Ok(()) };
        Err(GpuError::SelfTest {
            adapter: adapter.to_owned(),
            what: what.clone(),
            difference: difference.unwrap_or(if *is_infinite { f64::INFINITY } else { f64::NAN }),
            bound: *bound,
        })
    }
}

/// What translates the kernels for a driver and runs them, with versions, which a program cannot query.
const LIBRARIES: [(&str, &str); 4] =
    [("naga", "30.0.1"), ("wgpu", "30.0.1"), ("wgpu-core", "30.0.1"), ("wgpu-hal", "30.0.1")];

/// FNV-1a over the sources of the kernels, the test and its reference, and these libraries, to detect changes.
fn version(libraries: &[(&'static str, &'static str)]) -> String {
    let sources = self_test::SOURCES.iter().chain(self_test::REFERENCE).map(|(_, text)| *text);
    let libraries = libraries.iter().flat_map(|(name, version)| [*name, *version]);
    let texts = Kernel::ALL.iter().map(|kernel| kernel.source()).chain(sources).chain(libraries);
    let hash = texts
        .flat_map(str::bytes)
        .chain(shared_constants().bytes())
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_deterministic_results_can_be_cached() {
        let wrong = |difference: f64| {
            let (adapter, what) = ("a".to_owned(), "depth".to_owned());
            Err(GpuError::SelfTest { adapter, what, difference, bound: 1e-4 })
        };
        let cached = |outcome: &Result<(), GpuError>| {
            let text = serde_json::to_string(&SelfTestResult::of(outcome).unwrap()).unwrap();
            let result: SelfTestResult = serde_json::from_str(&text).unwrap();
            (result.outcome("a"), text)
        };
        for outcome in [Ok(()), wrong(0.5), wrong(f64::INFINITY)] {
            assert_eq!(cached(&outcome).0, outcome);
        }
        let (nan, text) = cached(&wrong(f64::NAN));
        assert!(nan.unwrap_err().to_string().contains("depth differs by NaN"), "{text}");
        assert!(!text.contains("infinite"), "as before infinities were stored: {text}");
        let lost = Err(GpuError::Device { adapter: "a".to_owned(), reason: "lost".to_owned() });
        assert_eq!(SelfTestResult::of(&lost), None, "it may be there next time");
    }

    #[test]
    fn the_version_is_deterministic_and_changes_with_wgpu() {
        assert_eq!(version(&LIBRARIES), version(&LIBRARIES));
        assert_eq!(version(&LIBRARIES).len(), 16);
        for (at, (name, _)) in LIBRARIES.iter().enumerate() {
            let mut upgraded = LIBRARIES;
            upgraded[at].1 = "another";
            assert_ne!(version(&upgraded), version(&LIBRARIES), "{name}");
        }
    }

    /// Results of other versions would be taken for those of the locked ones.
    #[test]
    fn the_libraries_have_the_versions_of_the_lock_file() {
        let lock = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../Cargo.lock")).unwrap();
        let lines: Vec<&str> = lock.lines().collect();
        for (name, version) in LIBRARIES {
            let is_named = |pair: &&[&str]| pair[0] == format!("name = \"{name}\"");
            let found: Vec<&str> = lines.windows(2).filter(is_named).map(|pair| pair[1]).collect();
            assert_eq!(found, [format!("version = \"{version}\"")], "update the version of {name} in LIBRARIES");
        }
    }
}
