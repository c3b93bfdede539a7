//! Images and times that a store keeps next to its rows.

use std::collections::BTreeMap;

use super::read::Content;
use super::{Store, timings};
use crate::runner::{CONTEXT, TRUTH};
use crate::{EvalError, TargetRow, TargetStatus, TrialKey, TrialRow};

/// An image that belongs to a result.
#[derive(Debug)]
pub(crate) struct OwnImage {
    /// The result, or its trial's ground truth or context.
    pub(crate) key: TrialKey,
    pub(crate) frame: u64,
    /// The hash of its samples in the rows.
    pub(crate) hash: Option<String>,
}

impl Store {
    /// The images of each result: the renders that were compared, and what they were compared with and made from.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub(crate) fn own_images(&self) -> Result<BTreeMap<TrialKey, Vec<OwnImage>>, EvalError> {
        let rows = Content::read(&self.folder)?.rows;
        Ok(rows.into_iter().map(|(key, (trial, targets))| (key, own_images(&trial, &targets))).collect())
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

fn own_images(trial: &TrialRow, targets: &[TargetRow]) -> Vec<OwnImage> {
    let is_compared = |row: &&TargetRow| matches!(row.status, TargetStatus::Scored | TargetStatus::Identical);
    let mut own = Vec::new();
    for TargetRow { key, frame, render_hash, truth_hash, .. } in targets.iter().filter(is_compared) {
        own.push(OwnImage { key: key.clone(), frame: *frame, hash: render_hash.clone() });
        own.push(OwnImage { key: key.of_method(TRUTH), frame: *frame, hash: truth_hash.clone() });
    }
    if !own.is_empty() {
        let context = trial.context.iter().zip(&trial.context_hashes);
        let key = trial.key.of_method(CONTEXT);
        for (frame, hash) in context {
            own.push(OwnImage { key: key.clone(), frame: *frame, hash: Some(hash.clone()) });
        }
    }
    own
}
