//! Runs that are stopped, and trials that are evaluated alone.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::common::{Run, Walls, baselines, dataset, entry, rows};
use atsplat_eval::EvalError;
use atsplat_eval::method::{Method, MethodError, NearestView, Prediction, TrialInput, Warp};
use atsplat_eval::runner::{Selection, evaluate_trial, run_until};
use atsplat_eval::timing::TimingPlan;
use atsplat_protocol::trial::{Prefetch, TrialRecipe, Trials};
use atsplat_results::{MethodRecord, Results};
use atsplat_tests::on_threads;

/// The plane warp, which counts its calls and knows one at which it was interrupted.
#[derive(Debug)]
struct Counted {
    calls: AtomicUsize,
    last: usize,
}

impl Method for Counted {
    fn record(&self) -> MethodRecord {
        Warp.record()
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        if self.calls.fetch_add(1, Ordering::Relaxed) + 1 >= self.last {
            return Err(MethodError::Failed("interrupted".to_owned()));
        }
        Warp.predict(input)
    }
}

fn walls(methods: Vec<Arc<dyn Method>>) -> Run {
    Run::new(vec![dataset(Walls::new(6, 8), &[entry(&[0, 4], &[1, 6])])], methods)
}

#[test]
fn a_stopped_run_keeps_what_was_finished_and_resumes() {
    let folder = tempfile::tempdir().unwrap();
    let method = Arc::new(Counted { calls: AtomicUsize::new(0), last: 4 });
    let run = walls(vec![Arc::clone(&method) as Arc<dyn Method>]);
    let (plan, store) = (run.plan(), run.store(folder.path()).unwrap());
    let stop = || method.calls.load(Ordering::Relaxed) >= method.last;
    let stopped = on_threads(1, || run_until(&plan, store, &|_| (), &stop)).unwrap_err();
    assert!(matches!(stopped, EvalError::Stopped), "{stopped}");
    let kept = Results::read(folder.path()).unwrap();
    assert_eq!(kept.trials.len(), 3, "three were finished, and the interrupted one has no row");
    assert!(kept.trials.iter().all(|trial| trial.detail.is_none()));
    let (resumed, summary) = walls(vec![Arc::new(Warp)]).run(folder.path()).unwrap();
    assert_eq!((summary.resumed, summary.evaluated), (3, 3));
    let whole = walls(vec![Arc::new(Warp)]).run(tempfile::tempdir().unwrap().path()).unwrap().0;
    assert_eq!(rows(&resumed), rows(&whole));
}

/// The second of two methods is interrupted at its first timed trial.
#[test]
fn a_stopped_timing_pass_keeps_the_times_of_finished_methods() {
    let folder = tempfile::tempdir().unwrap();
    let timed = |methods: Vec<Arc<dyn Method>>| {
        let timing = TimingPlan { trials: 2, warm_up: 0, repetitions: 1, ..TimingPlan::default() };
        Run { timing: Some(timing), ..walls(methods) }
    };
    let method = Arc::new(Counted { calls: AtomicUsize::new(0), last: 7 });
    let run = timed(vec![Arc::new(NearestView), Arc::clone(&method) as Arc<dyn Method>]);
    let (plan, store) = (run.plan(), run.store(folder.path()).unwrap());
    let stop = || method.calls.load(Ordering::Relaxed) >= method.last;
    let stopped = run_until(&plan, store, &|_| (), &stop).unwrap_err();
    assert!(matches!(stopped, EvalError::Stopped), "{stopped}");
    assert_eq!(method.calls.load(Ordering::Relaxed), 7, "six trials, and no timed one after the first");
    let kept = Results::read(folder.path()).unwrap();
    let timed_methods: Vec<&str> = kept.timings.iter().map(|row| row.key.method.as_str()).collect();
    assert_eq!((kept.trials.len(), timed_methods), (12, vec!["nearest-view"; 2]));
    let (resumed, summary) = timed(baselines()).run(folder.path()).unwrap();
    assert_eq!((summary.resumed, resumed.timings.len()), (12, 4));
    assert!(resumed.timings.iter().all(|row| row.detail.is_none()), "an interrupted trial was not rejected");
}

#[test]
fn a_trial_alone_has_the_rows_of_a_run() {
    let run = walls(baselines());
    let (results, _) = run.run(tempfile::tempdir().unwrap().path()).unwrap();
    let dataset = &run.datasets[0];
    let index = Selection { limit: Some(2), shard: None }.index_of(dataset);
    let recipe = TrialRecipe::of(&dataset.preset, "ATSplat");
    let mut seen = 0;
    for outcome in Trials::new(Arc::clone(&dataset.source), &index, recipe, Prefetch::default()) {
        let (trial, truth) = outcome.unwrap();
        for method in &run.methods {
            let (row, targets) = evaluate_trial(dataset, &run.suite, trial.clone(), &truth, method.as_ref()).unwrap();
            let ran: Vec<_> = results.targets.iter().filter(|target| target.key == row.key).cloned().collect();
            assert!(results.trials.contains(&row) && targets == ran, "{row:?}");
            seen += 1;
        }
    }
    assert_eq!(seen, 4);
}
