//! Keeps evaluations and timing passes of one process apart.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use crate::EvalError;

#[derive(Debug)]
struct Running {
    evaluations: usize,
    passes: usize,
}

static RUNNING: Mutex<Running> = Mutex::new(Running { evaluations: 0, passes: 0 });
static ENDED: Condvar = Condvar::new();

fn running() -> MutexGuard<'static, Running> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Guard of a running evaluation.
#[derive(Debug)]
pub(crate) struct EvaluationGuard(());

/// Guard of a running timing pass.
#[derive(Debug)]
pub(super) struct TimingGuard(());

/// Begins an evaluation; waits for running timing passes.
pub(crate) fn evaluating() -> EvaluationGuard {
    let mut running = running();
    // A running pass has its own threads and does not wait for evaluations, so it always ends.
    while running.passes > 0 {
        running = ENDED.wait(running).unwrap_or_else(PoisonError::into_inner);
    }
    running.evaluations += 1;
    EvaluationGuard(())
}

/// Begins a timing pass; waits for running evaluations and other passes.
///
/// # Errors
/// [`EvalError::Settings`] on a thread of a rayon pool while something else runs, which may be waiting for this very thread.
pub(super) fn exclusive() -> Result<TimingGuard, EvalError> {
    let mut running = running();
    while running.evaluations + running.passes > 0 {
        if rayon::current_thread_index().is_some() {
            return Err(EvalError::Settings {
                what: "timing pass",
                expected: "the process to itself".to_owned(),
                found: format!("{} evaluations and {} timing passes", running.evaluations, running.passes),
            });
        }
        running = ENDED.wait(running).unwrap_or_else(PoisonError::into_inner);
    }
    running.passes += 1;
    Ok(TimingGuard(()))
}

impl Drop for EvaluationGuard {
    fn drop(&mut self) {
        running().evaluations -= 1;
        ENDED.notify_all();
    }
}

impl Drop for TimingGuard {
    fn drop(&mut self) {
        running().passes -= 1;
        ENDED.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
    use std::time::Duration;

    use atsplat_tests::on_threads;

    use super::*;

    #[test]
    fn passes_and_evaluations_wait_for_each_other() {
        let (inside, clashes) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    let _evaluating = evaluating();
                    inside.fetch_add(1, Ordering::SeqCst);
                    std::thread::sleep(Duration::from_millis(20));
                    inside.fetch_sub(1, Ordering::SeqCst);
                });
                scope.spawn(|| {
                    let _exclusive = exclusive().unwrap();
                    clashes.fetch_add(inside.fetch_add(100, Ordering::SeqCst), Ordering::SeqCst);
                    std::thread::sleep(Duration::from_millis(20));
                    inside.fetch_sub(100, Ordering::SeqCst);
                });
            }
        });
        assert_eq!(clashes.into_inner(), 0);
    }

    #[test]
    fn an_evaluation_waits_until_a_running_pass_ends() {
        let ended = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let pass = exclusive().unwrap();
            let evaluation = scope.spawn(|| {
                let _evaluating = evaluating();
                ended.load(Ordering::SeqCst)
            });
            std::thread::sleep(Duration::from_millis(50));
            ended.store(true, Ordering::SeqCst);
            drop(pass);
            assert!(evaluation.join().unwrap(), "it began during the pass");
        });
    }

    #[test]
    fn a_pool_thread_does_not_wait_for_itself() {
        let refused = on_threads(1, || {
            let _evaluating = evaluating();
            exclusive().map(drop)
        });
        assert!(refused.unwrap_err().to_string().contains("the process to itself"));
    }
}
