//! Which methods are trainings of one network from different seeds.

use atsplat_results::MethodRecord;

use super::MethodRun;

/// Whether a method is another training of the network of `known`, from a seed that none of them has: stores may share some.
pub(in crate::table) fn is_further_training(known: &[MethodRun<'_>], run: MethodRun<'_>) -> bool {
    let is_other_seed = |other: &MethodRun<'_>| differs_only_in_seed(other.record, run.record);
    known.iter().all(|other| is_other_seed(other) && other.part.is_comparable_with(run.part))
}

/// Whether two methods are one network, trained on the same data from different seeds.
fn differs_only_in_seed(a: &MethodRecord, b: &MethodRecord) -> bool {
    let data = |record: &MethodRecord| record.training.as_ref().map(|training| training.data.clone());
    is_network_of_another_seed(a, b) && data(a) == data(b)
}

/// Whether two methods are one network, trained from different seeds, whatever is said of the data.
pub(in crate::table) fn is_network_of_another_seed(a: &MethodRecord, b: &MethodRecord) -> bool {
    let (Some(first), Some(second)) = (&a.training, &b.training) else { return false };
    let differ = a.weights_sha256 != b.weights_sha256 && first.seed != second.seed;
    differ && a.kind == b.kind && a.parameters == b.parameters
}
