//! Presets × methods × trials.

use crate::{SkippedEntry, WarningCount};

/// What was wrong with datasets.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    /// By preset and kind.
    pub warnings: Vec<WarningCount>,
    /// Index entries that made no trial.
    pub skipped: Vec<SkippedEntry>,
}
