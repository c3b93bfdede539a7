//! The images that belong to the results of a store.

use std::collections::BTreeMap;

use super::Store;
use super::read::Content;
use crate::store::images::{CONTEXT, TRUTH};
use crate::{ResultsError, TargetRow, TargetStatus, TrialKey, TrialRow};

/// An image that belongs to a result.
#[derive(Debug)]
pub struct StoredImage {
    /// The result, or its trial's ground truth or context.
    pub key: TrialKey,
    /// Frame of the scene.
    pub frame: u64,
    /// The hash of its samples in the rows.
    pub hash: Option<String>,
}

impl Store {
    /// The images of each result: the renders that were compared, and what they were compared with and made from.
    ///
    /// # Errors
    /// Those of [`Self::open`].
    pub fn images_of_results(&self) -> Result<BTreeMap<TrialKey, Vec<StoredImage>>, ResultsError> {
        let rows = Content::read(&self.folder)?.rows;
        Ok(rows.into_iter().map(|(key, (trial, targets))| (key, images_of(&trial, &targets))).collect())
    }
}

fn images_of(trial: &TrialRow, targets: &[TargetRow]) -> Vec<StoredImage> {
    let is_compared = |row: &&TargetRow| matches!(row.status, TargetStatus::Scored | TargetStatus::Identical);
    let mut images = Vec::new();
    for TargetRow { key, frame, render_hash, truth_hash, .. } in targets.iter().filter(is_compared) {
        images.push(StoredImage { key: key.clone(), frame: *frame, hash: render_hash.clone() });
        images.push(StoredImage { key: key.of_method(TRUTH), frame: *frame, hash: truth_hash.clone() });
    }
    if !images.is_empty() {
        let key = trial.key.of_method(CONTEXT);
        for (frame, hash) in trial.context.iter().zip(&trial.context_hashes) {
            images.push(StoredImage { key: key.clone(), frame: *frame, hash: Some(hash.clone()) });
        }
    }
    images
}
