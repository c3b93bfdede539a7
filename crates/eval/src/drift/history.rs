use serde::{Deserialize, Serialize};

/// Why a run was accepted as the baseline.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Acceptance {
    /// Date in UTC, such as `2026-02-28`.
    pub date: String,
    /// Why this run's numbers are correct.
    pub reason: String,
    /// Version of atsplat that computed them.
    pub atsplat: String,
    /// Commit that it was built from, if known.
    pub commit: Option<String>,
}
