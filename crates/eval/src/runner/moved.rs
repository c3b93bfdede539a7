//! Data and imported files that a run finds in another place than the results that it resumes: their contents must be the same. A
//! folder that was edited is read again; another one would replace results under a name that stands for the first.

use std::sync::Arc;

use atsplat_protocol::trial::{DecodeAhead, Prefetch, Skipped, Trial};
use atsplat_results::{Moved, ResultsError, Store, TrialKey};

use super::group_run::{groups, input_hash, key_of, trial_id, trials_of};
use super::plan::{Dataset, Plan};
use crate::EvalError;
use crate::method::Method;

/// Compares all results with scores, before the first row is written.
///
/// # Errors
/// [`ResultsError::Different`] with both places and the first result that was made from other contents; [`EvalError::Stopped`].
pub(super) fn check_moved(plan: &Plan<'_>, store: &Store, stop: &(dyn Fn() -> bool + Sync)) -> Result<(), EvalError> {
    let moved = store.moved();
    if moved == Moved::default() {
        return Ok(());
    }
    for dataset in plan.datasets {
        let (mut index, known) = (plan.selected(dataset).index, store.known().scenes(&dataset.name));
        index.scenes.retain(|scene, _| known.contains(scene.as_str()));
        let positions = dataset.index.index.first_positions();
        for methods in groups(&dataset.preset, plan.methods) {
            let ahead = Prefetch { decode: DecodeAhead::Nothing, ..plan.prefetch };
            for outcome in trials_of(dataset, &index, &positions, &methods, ahead) {
                if stop() {
                    return Err(EvalError::Stopped);
                }
                let (trial, targets) = match outcome {
                    Ok(trial) => trial,
                    Err(skipped) => {
                        check_skipped(&moved, dataset, store, &skipped, &methods)?;
                        continue;
                    }
                };
                let data = trial.data_hash(&targets, store.digests()).to_string();
                check_data(&moved, dataset, store, &trial, &data)?;
                check_files(&moved, dataset, store, &trial, &methods)?;
            }
        }
    }
    Ok(())
}

/// An entry that the data in the other place cannot fill has other contents there.
fn check_skipped(
    moved: &Moved,
    dataset: &Dataset,
    store: &Store,
    skipped: &Skipped,
    methods: &[Arc<dyn Method>],
) -> Result<(), ResultsError> {
    let Some(places) = moved.data.get(&dataset.name) else { return Ok(()) };
    let key = |method: &Arc<dyn Method>| key_of(dataset, method.as_ref(), &skipped.scene, skipped.entry_number);
    match methods.iter().map(key).find(|key| store.known().scored(key) > 0) {
        Some(key) => Err(other_contents("data", places, &key, ADVICE_OF_DATA)),
        None => Ok(()),
    }
}

const ADVICE_OF_DATA: &str = "; choose another folder for the results of other data";

/// Of all methods: the record of the data is theirs too.
fn check_data(
    moved: &Moved,
    dataset: &Dataset,
    store: &Store,
    trial: &Trial,
    data_hash: &str,
) -> Result<(), ResultsError> {
    let Some(places) = moved.data.get(&dataset.name) else { return Ok(()) };
    let known = store.known();
    let id = trial_id(&dataset.name, trial.scene(), trial.entry_number());
    let has_scores = |method: &&str| known.scored(&id.of_method(method)) > 0;
    match known.outdated(&id, data_hash).find(has_scores) {
        Some(method) => Err(other_contents("data", places, &id.of_method(method), ADVICE_OF_DATA)),
        None => Ok(()),
    }
}

fn check_files(
    moved: &Moved,
    dataset: &Dataset,
    store: &Store,
    trial: &Trial,
    methods: &[Arc<dyn Method>],
) -> Result<(), ResultsError> {
    const ADVICE: &str = "; choose another name for other files (--name of score, NAME=renders:DIR or NAME=ply:DIR of run), or another \
                          folder for the results";
    for method in methods {
        let key = key_of(dataset, method.as_ref(), trial.scene(), trial.entry_number());
        let Some(places) = moved.files.get(&key.method) else { continue };
        let hash = input_hash(method.as_ref(), trial, store.digests());
        if store.known().has_other_files(&key, hash.as_deref()) {
            return Err(other_contents("imported files", places, &key, ADVICE));
        }
    }
    Ok(())
}

fn other_contents(what: &'static str, places: &[String; 2], key: &TrialKey, advice: &'static str) -> ResultsError {
    let [first, found] = places;
    let expected = format!("the contents of {first}");
    let found = format!("others in {found}, the first of {key}");
    ResultsError::Different { what, expected, found, advice }
}
