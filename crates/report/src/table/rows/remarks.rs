//! What the label of a measured row has to add: untrained, zero-shot, changed at inference only, and the like.

use atsplat_results::MethodRecord;
pub(crate) use atsplat_results::statistics::LEAKED_EXCLUDED;

use crate::definition::{by_quantile, is_ablation, is_full, is_trained_separately, zero_shot_note};
use crate::table::selection::{ComparableResults, MethodRun};

/// Remark on a row that shares its weights with another row and differs at inference.
pub(crate) const INFERENCE_ONLY: &str = "changed at inference only";

impl ComparableResults<'_> {
    /// What the name of a method has to add under a protocol.
    pub(in crate::table) fn remarks(&self, run: MethodRun<'_>) -> Vec<String> {
        let record = run.record;
        let untrained = (record.untrained && !record.title.contains("untrained")).then(|| "untrained".to_owned());
        let zero_shot = zero_shot_note(record, run.part.dataset.as_deref().unwrap_or_default());
        let thresholds = by_quantile(record).map(|thresholds| format!("thresholds {thresholds}"));
        let inference_only = self.is_inference_only(record).then(|| INFERENCE_ONLY.to_owned());
        let machines = run.results().optimised_on(run.preset_name(), run.method_name()).len();
        let machines = (machines > 1).then(|| format!("optimised for the same time on {machines} machines"));
        [untrained, zero_shot, thresholds, inference_only, machines].into_iter().flatten().collect()
    }

    /// Whether an ablation that the paper trains has the weights of another network of any store, so that it was changed only
    /// after training.
    pub(in crate::table) fn is_not_retrained(&self, record: &MethodRecord) -> bool {
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

#[cfg(test)]
mod tests {
    use crate::plot::Origin;
    use crate::sample::{atsplat, preset, results};
    use crate::table::{Mixing, Source, protocol_tables};

    /// Machines take different numbers of steps in the same time.
    #[test]
    fn rows_of_an_optimisation_for_a_time_name_several_machines() {
        let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ())]);
        let mut are_named = |machines: [&str; 2]| {
            for (trial, machine) in results.trials.iter_mut().zip(machines.into_iter().cycle()) {
                trial.notes = vec![format!("optimisation: 9 steps in its time on {machine}")];
            }
            let source = Source { label: "run", results: &results };
            let table = protocol_tables(&[source], Mixing::Apart).unwrap().swap_remove(0);
            let remark = "optimised for the same time on 2 machines";
            let mut measured = table.rows.iter().filter(|row| row.origin == Origin::Measured);
            measured.any(|row| row.remarks.iter().any(|said| said == remark))
        };
        assert!(!are_named(["one", "one"]) && are_named(["one", "other"]));
    }
}
