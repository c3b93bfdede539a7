use serde::{Deserialize, Serialize};

use super::adapters::AdapterDescription;
use super::kernels::Kernel;
use super::{GpuError, self_test};

/// What the verdict of a self-test is about: it stands until the adapter, its driver, the kernels or the test change.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct VerdictKey {
    /// As its driver calls it.
    pub adapter: String,
    /// As `Vulkan` or `Gl`.
    pub backend: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Hash of the kernels and of what is tested.
    pub version: String,
}

/// What a self-test came to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Verdict {
    /// What is computed wrong; `None` where the picture and its derivative are right.
    pub fault: Option<WrongNumber>,
}

/// A number beyond its bound.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct WrongNumber {
    /// The image or gradient.
    pub what: String,
    /// Largest difference found; `None` for NaN.
    pub difference: Option<f64>,
    /// Largest difference allowed.
    pub bound: f64,
}

/// What is done to an adapter; each may take minutes where a driver compiles kernels slowly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProbeStage {
    /// The device is opened and its loops are counted.
    Opening,
    /// A picture is rendered and compared.
    Picture,
    /// Its derivative is computed and compared.
    Derivative,
}

/// Hears what is done to adapters, and may remember what came of it.
pub trait Watcher {
    /// A stage begins.
    fn begins(&self, _adapter: &AdapterDescription, _stage: ProbeStage) {}

    /// The verdict of an earlier test, which is then not repeated.
    fn recall(&self, _key: &VerdictKey) -> Option<Verdict> {
        None
    }

    /// A test was passed, or failed for good. What may be otherwise next time, as a lost device, is not kept.
    fn keep(&self, _key: &VerdictKey, _verdict: &Verdict) {}
}

/// Hears nothing and remembers nothing.
impl Watcher for () {}

impl VerdictKey {
    /// Of an adapter as it is now.
    pub fn of(description: &AdapterDescription) -> Self {
        Self {
            adapter: description.name.clone(),
            backend: description.backend.clone(),
            driver: description.driver.clone(),
            version: version(),
        }
    }
}

impl Verdict {
    /// What a test came to; `None` where it may come to something else next time.
    pub(super) fn of(outcome: &Result<(), GpuError>) -> Option<Self> {
        match outcome {
            Ok(()) => Some(Self { fault: None }),
            Err(GpuError::SelfTest { what, difference, bound, .. }) => {
                let difference = difference.is_finite().then_some(*difference);
                Some(Self { fault: Some(WrongNumber { what: what.clone(), difference, bound: *bound }) })
            }
            Err(_) => None,
        }
    }

    /// The outcome again.
    ///
    /// # Errors
    /// [`GpuError::SelfTest`].
    pub fn outcome(&self, adapter: &str) -> Result<(), GpuError> {
        let Some(WrongNumber { what, difference, bound }) = &self.fault else { return Ok(()) };
        Err(GpuError::SelfTest {
            adapter: adapter.to_owned(),
            what: what.clone(),
            difference: difference.unwrap_or(f64::NAN),
            bound: *bound,
        })
    }
}

/// FNV-1a over the kernels' sources and the test's: no secret, only a sign of change.
fn version() -> String {
    let texts = Kernel::ALL.iter().map(|kernel| kernel.source()).chain(self_test::SOURCES);
    let hash = texts
        .flat_map(str::bytes)
        .fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3));
    format!("{hash:016x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_certain_is_kept_and_comes_back() {
        let wrong = |difference: f64| {
            let (adapter, what) = ("a".to_owned(), "depth".to_owned());
            Err(GpuError::SelfTest { adapter, what, difference, bound: 1e-4 })
        };
        for outcome in [Ok(()), wrong(0.5)] {
            assert_eq!(Verdict::of(&outcome).unwrap().outcome("a"), outcome);
        }
        let nan = Verdict::of(&wrong(f64::NAN)).unwrap().outcome("a").unwrap_err().to_string();
        assert!(nan.contains("depth differs by NaN"), "{nan}");
        let lost = Err(GpuError::Device { adapter: "a".to_owned(), reason: "lost".to_owned() });
        assert_eq!(Verdict::of(&lost), None, "it may be there next time");
    }

    #[test]
    fn the_version_is_a_function_of_the_sources() {
        assert_eq!(version(), version());
        assert_eq!(version().len(), 16);
    }
}
