//! Entries without targets.

use super::*;

/// Photos without ground truth are trials too, but not of an evaluation.
#[test]
fn entries_without_targets_are_skipped_where_targets_are_required() {
    let index = index(&[("s", vec![entry(&[2, 6], &[]), entry(&[2, 6], &[4])])]);
    let trials = || Trials::new(Arc::new(MemorySource::new([scene("s", 9, 5)])), &index, recipe(), Prefetch::default());
    let reasons = |trials: Trials| trials.map(|trial| trial.err().map(|skipped| skipped.reason)).collect::<Vec<_>>();
    assert_eq!(reasons(trials()), [None, None]);
    assert_eq!(reasons(trials().requiring_targets()), [Some(SkipReason::NoTargets), None]);
}
