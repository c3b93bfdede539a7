//! What the label of a measured row has to add: untrained, zero-shot, changed at inference only, and the like.

use atsplat_eval::MethodRecord;

use super::comparable::{ComparableResults, MethodRun};
use crate::definition::{by_quantile, is_ablation, is_full, is_trained_separately, zero_shot_note};

/// Remark on a row that shares its weights with another row and differs at inference.
pub(crate) const INFERENCE_ONLY: &str = "changed at inference only";
/// Remark on a row without the targets that are also context frames.
pub(crate) const LEAKED_EXCLUDED: &str = "leaked targets excluded";

impl ComparableResults<'_> {
    /// What the name of a method has to add under a protocol.
    pub(super) fn remarks(&self, run: MethodRun<'_>) -> Vec<String> {
        let record = run.record;
        let untrained = (record.untrained && !record.title.contains("untrained")).then(|| "untrained".to_owned());
        let zero_shot = zero_shot_note(record, &run.part.protocol.dataset);
        let thresholds = by_quantile(record).map(|thresholds| format!("thresholds {thresholds}"));
        let inference_only = self.is_inference_only(record).then(|| INFERENCE_ONLY.to_owned());
        [untrained, zero_shot, thresholds, inference_only].into_iter().flatten().collect()
    }

    /// Whether an ablation that the paper trains has the weights of another network of any store, so that it was changed only
    /// after training.
    pub(super) fn is_not_retrained(&self, record: &MethodRecord) -> bool {
        is_trained_separately(record) && self.has_weights_of(record, |other| !is_trained_separately(other))
    }

    /// Whether a method runs the weights of another method under another configuration that expands or selects differently.
    pub(super) fn is_inference_only(&self, record: &MethodRecord) -> bool {
        let is_trained = |other: &MethodRecord| is_full(other) || (is_ablation(record) && !is_ablation(other));
        (!is_full(record) && self.has_weights_of(record, is_trained)) || self.is_not_retrained(record)
    }

    /// Whether any such method of any store has the weights of this one.
    fn has_weights_of(&self, record: &MethodRecord, is_such: impl Fn(&MethodRecord) -> bool) -> bool {
        let mut methods = self.parts.iter().flat_map(|part| &part.source.results.provenance.methods);
        record.weights_sha256.is_some()
            && methods.any(|other| other.weights_sha256 == record.weights_sha256 && is_such(other))
    }
}
