//! Methods made of a closure.

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::Duration;

use atsplat_eval::method::{Cost, Method, MethodError, Prediction, Rendered, Timed, TrialInput};
use atsplat_results::MethodRecord;

use super::{grey, record};

/// What a method predicts for a trial, or why it does not.
pub(crate) type Predicted = Result<Box<dyn Prediction>, MethodError>;

/// A method that predicts what the closure does; a timing pass times all of it.
pub(crate) fn method<F>(name: &str, predict: F) -> Arc<dyn Method>
where
    F: Fn(TrialInput<'_>) -> Predicted + Send + Sync + 'static,
{
    timed_method(name, Timed { encoding: true, rendering: true }, predict)
}

/// As [`method`], of which a timing pass times these parts.
pub(crate) fn timed_method<F>(name: &str, timed: Timed, predict: F) -> Arc<dyn Method>
where
    F: Fn(TrialInput<'_>) -> Predicted + Send + Sync + 'static,
{
    Arc::new(OfClosure { name: name.to_owned(), timed, predict })
}

/// As [`method`], with the number of its calls so far.
pub(crate) fn counted_method<F>(name: &str, predict: F) -> (Arc<dyn Method>, Arc<AtomicUsize>)
where
    F: Fn(TrialInput<'_>) -> Predicted + Send + Sync + 'static,
{
    let calls = Arc::new(AtomicUsize::new(0));
    let counter = Arc::clone(&calls);
    let counted = method(name, move |input| {
        counter.fetch_add(1, Ordering::Relaxed);
        predict(input)
    });
    (counted, calls)
}

struct OfClosure<F> {
    name: String,
    timed: Timed,
    predict: F,
}

impl<F> fmt::Debug for OfClosure<F> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl<F> Method for OfClosure<F>
where
    F: Fn(TrialInput<'_>) -> Predicted + Send + Sync,
{
    fn record(&self) -> MethodRecord {
        record(&self.name)
    }

    fn timed(&self) -> Timed {
        self.timed
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        (self.predict)(input)
    }
}

/// Grey images of the walls' size.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grey {
    /// How long rendering one takes.
    pub(crate) wait: Duration,
    pub(crate) cost: Cost,
}

impl Prediction for Grey {
    fn cost(&self) -> Cost {
        self.cost.clone()
    }

    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        let one = |_: &usize| {
            sleep(self.wait);
            Ok(grey())
        };
        targets.iter().map(one).collect()
    }
}

/// Grey images, each of which takes this long.
pub(crate) fn grey_after(wait: Duration) -> Box<dyn Prediction> {
    Box::new(Grey { wait, ..Grey::default() })
}
