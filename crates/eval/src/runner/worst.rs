use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

use atsplat_protocol::EvaluationIndex;
use atsplat_protocol::trial::Trials;

use super::evaluate::{Decoded, Evaluation};
use super::plan::{Dataset, Plan};
use super::walk::{key_of, recipe};
use crate::method::{Method, Repetitions};
use crate::{EvalError, Results, TrialKey};

/// Trials that are kept with pictures where only the worst are.
const WORST: usize = 10;

/// Makes the pictures of each method's worst trials once more, and keeps them.
pub(super) fn keep_worst(
    plan: &Plan<'_>,
    dataset: &Dataset,
    methods: &[Arc<dyn Method>],
    results: &Results,
    folder: &Path,
) -> Result<(), EvalError> {
    for method in methods {
        let name = method.record().name;
        let worst = worst(results, &dataset.name, &name);
        let of = |scene: &&String| Some(((*scene).clone(), dataset.index.index.scenes.get(*scene)?.clone()));
        let scenes: BTreeSet<&String> = worst.iter().map(|key| &key.scene).collect();
        let index = EvaluationIndex { scenes: scenes.iter().filter_map(of).collect() };
        let recipe = recipe(dataset, methods);
        for (trial, targets) in Trials::new(Arc::clone(&dataset.source), &index, recipe, plan.prefetch).flatten() {
            let key = key_of(dataset, method.as_ref(), trial.scene(), trial.entry_number());
            if worst.contains(&key) {
                let evaluation = Evaluation {
                    preset: &dataset.preset,
                    suite: plan.suite,
                    repetitions: Repetitions::ONCE,
                    alone: false,
                    pictures: Some(folder),
                };
                evaluation.rows(key, &Decoded::new(trial, &targets), method.as_ref())?;
            }
        }
    }
    Ok(())
}

/// Keys of the trials with the lowest mean PSNR, whichever the protocol means, the worst first.
fn worst(results: &Results, preset: &str, method: &str) -> Vec<TrialKey> {
    let mut sums: BTreeMap<&TrialKey, (f64, u64)> = BTreeMap::new();
    for row in results.targets.iter().filter(|row| row.key.preset == preset && row.key.method == method) {
        if let Some((_, score)) = row.scores.iter().find(|(id, _)| id.starts_with("psnr")) {
            let (sum, count) = sums.entry(&row.key).or_default();
            *sum += score;
            *count += 1;
        }
    }
    let mut means: Vec<(f64, &TrialKey)> = sums.into_iter().map(|(key, (sum, n))| (sum / n as f64, key)).collect();
    means.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    means.into_iter().take(WORST).map(|(_, key)| key.clone()).collect()
}
