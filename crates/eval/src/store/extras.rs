//! What a store keeps beside rows that may be replaced.

use std::collections::BTreeMap;

use super::read::Content;
use super::{Store, timings};
use crate::{EvalError, TargetRow, TargetStatus, TrialKey};

impl Store {
    /// The frames of each result that were compared, whose renders can therefore be stored as pictures.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub(crate) fn compared_frames(&self) -> Result<BTreeMap<TrialKey, Vec<u64>>, EvalError> {
        let rows = Content::read(&self.folder)?.rows;
        Ok(rows.into_iter().map(|(key, (_, targets))| (key, compared(&targets))).collect())
    }

    /// Removes the times of one result, on every machine. Not to be called by two threads at once.
    ///
    /// # Errors
    /// Those of [`Self::timings`], and [`EvalError::Io`].
    pub(crate) fn remove_timings(&self, key: &TrialKey) -> Result<(), EvalError> {
        let mut rows = self.timings()?;
        rows.retain(|row| row.key != *key);
        timings::write(&self.folder, &rows)
    }
}

fn compared(targets: &[TargetRow]) -> Vec<u64> {
    let is_compared = |row: &&TargetRow| matches!(row.status, TargetStatus::Scored | TargetStatus::Identical);
    targets.iter().filter(is_compared).map(|row| row.frame).collect()
}
