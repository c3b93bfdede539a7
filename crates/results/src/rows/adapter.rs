use std::fmt;

use serde::{Deserialize, Serialize};

/// A graphics adapter that computed results. [`Display`](fmt::Display) writes `NAME (BACKEND), DRIVER`.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct AdapterRecord {
    /// Name reported by the driver.
    pub name: String,
    /// The graphics interface, such as `Vulkan`.
    pub backend: String,
    /// Name and version of the driver.
    pub driver: String,
}

impl fmt::Display for AdapterRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, backend, driver } = self;
        write!(f, "{name} ({backend}), {driver}")
    }
}

/// `network and renderer on …`, or each by itself; `None` if the CPU does both.
pub(crate) fn placement(network: Option<&str>, renderer: Option<&str>) -> Option<String> {
    match (network, renderer) {
        (None, None) => None,
        (Some(network), Some(renderer)) if network == renderer => Some(format!("network and renderer on {network}")),
        (Some(network), Some(renderer)) => Some(format!("network on {network}, renderer on {renderer}")),
        (Some(network), None) => Some(format!("network on {network}")),
        (None, Some(renderer)) => Some(format!("renderer on {renderer}")),
    }
}
