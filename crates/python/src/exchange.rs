//! Calls of a Python method, which all happen on the thread that began the evaluation: what PyTorch, CUDA, debuggers and signals
//! keep for each thread (`no_grad`, the current device) is then what the user set. The evaluation's own threads send a trial and wait.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use atsplat_eval::method::MethodError;
use atsplat_protocol::trial::Trial;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::array::Images;
use crate::error::Failure;
use crate::gaussians::Gaussians;
use crate::method::Output;
use crate::trial::Input;

/// How often signals are looked at while the method is not called.
const INTERVAL: Duration = Duration::from_millis(50);

type Outcome = Result<Output, MethodError>;
type Reply = Sender<Outcome>;

/// What the calling thread has to do.
enum Task {
    Call(Box<Trial>, Arc<Py<PyAny>>, Reply),
    Step,
    Finished,
}

/// The evaluation's end of calls of one callable.
#[derive(Debug)]
pub(crate) struct Calls {
    callable: Arc<Py<PyAny>>,
    tasks: Mutex<Sender<Task>>,
}

impl Calls {
    /// What the callable makes of a trial.
    pub(crate) fn call(&self, trial: &Trial) -> Outcome {
        let (reply, outcome) = channel();
        let task = Task::Call(Box::new(trial.clone()), Arc::clone(&self.callable), reply);
        let sent = self.tasks.lock().unwrap_or_else(PoisonError::into_inner).send(task);
        let stopped = || MethodError::Failed("the evaluation was stopped".to_owned());
        sent.map_err(|_ended| stopped())?;
        outcome.recv().map_err(|_ended| stopped())?
    }
}

/// The calling thread's end.
pub(crate) struct Exchange {
    tasks: Mutex<Receiver<Task>>,
    sender: Sender<Task>,
}

/// Tells the calling thread about progress, from any thread, and at last that the evaluation has ended.
pub(crate) struct Steps(Mutex<Sender<Task>>);

impl Steps {
    pub(crate) fn step(&self) {
        self.send(Task::Step);
    }

    fn send(&self, task: Task) {
        // The receiver lives until the evaluation has ended.
        self.0.lock().unwrap_or_else(PoisonError::into_inner).send(task).ok();
    }
}

impl Drop for Steps {
    fn drop(&mut self) {
        self.send(Task::Finished);
    }
}

impl Exchange {
    pub(crate) fn new() -> Self {
        let (sender, tasks) = channel();
        Self { tasks: Mutex::new(tasks), sender }
    }

    pub(crate) fn calls(&self, callable: Py<PyAny>) -> Calls {
        Calls { callable: Arc::new(callable), tasks: Mutex::new(self.sender.clone()) }
    }

    /// Runs `evaluation` on another thread, and the calls that it makes on this one, until it is finished, the method is
    /// interrupted, or a signal's handler raises; `progress` is called after each result.
    pub(crate) fn run<T: Send>(
        self,
        py: Python<'_>,
        progress: Option<&Py<PyAny>>,
        evaluation: impl FnOnce(&Steps, &(dyn Fn() -> bool + Sync)) -> Result<T, Failure> + Send,
    ) -> Result<T, Failure> {
        let (steps, stopped) = (Steps(Mutex::new(self.sender.clone())), AtomicBool::new(false));
        let stopped = &stopped;
        std::thread::scope(|scope| {
            let evaluating = scope.spawn(move || evaluation(&steps, &|| stopped.load(Ordering::Acquire)));
            let served = self.serve(py, progress, stopped);
            if served.is_err() {
                // Threads that wait for a call get no answer, and the others end after their trial.
                py.detach(|| while !matches!(self.next(), Ok(Task::Finished)) {});
            }
            let outcome = py.detach(|| evaluating.join());
            served?;
            outcome.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    /// Does tasks until the evaluation has ended. An error sets `stopped` before the call that it interrupted is dropped: the
    /// waiting thread would otherwise take the missing answer for a failure of the method, and store it.
    fn serve(&self, py: Python<'_>, progress: Option<&Py<PyAny>>, stopped: &AtomicBool) -> PyResult<()> {
        let stop = |_: &PyErr| stopped.store(true, Ordering::Release);
        loop {
            match py.detach(|| self.next()) {
                Ok(Task::Call(trial, callable, reply)) => {
                    let outcome = answer(py, *trial, &callable).inspect_err(stop)?;
                    reply.send(outcome).ok();
                }
                Ok(Task::Step) => {
                    // While steps follow each other closely, nothing times out; without `progress`, no other Python code runs.
                    py.check_signals().inspect_err(stop)?;
                    if let Some(progress) = progress {
                        progress.call0(py).inspect_err(stop)?;
                    }
                }
                Ok(Task::Finished) => return Ok(()),
                // `self` has a sender: nothing else is an error.
                Err(_timeout) => py.check_signals().inspect_err(stop)?,
            }
        }
    }

    fn next(&self) -> Result<Task, RecvTimeoutError> {
        self.tasks.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(INTERVAL)
    }
}

/// Calls the method; an exception is its failure, but an interruption is an error.
fn answer(py: Python<'_>, trial: Trial, callable: &Py<PyAny>) -> PyResult<Outcome> {
    match output(py, trial, callable) {
        Ok(output) => Ok(Ok(output)),
        Err(error) if !error.is_instance_of::<PyException>(py) => Err(error),
        Err(error) => Ok(Err(failure(py, error)?)),
    }
}

fn output(py: Python<'_>, trial: Trial, callable: &Py<PyAny>) -> PyResult<Output> {
    let returned = callable.call1(py, (Input::new(trial),))?.into_bound(py);
    if let Ok(gaussians) = returned.cast::<Gaussians>() {
        return Ok(Output::Gaussians(Arc::clone(&gaussians.get().0)));
    }
    let (shape, kind, bytes): (Vec<usize>, String, Bound<'_, PyBytes>) = returned.extract()?;
    Ok(Output::Images(Images::of(&shape, &kind, bytes.as_bytes())?))
}

/// `ValueError: what it says (file.py:12)`.
fn failure(py: Python<'_>, error: PyErr) -> PyResult<MethodError> {
    let (kind, why): (String, String) =
        py.import("atsplat._methods")?.call_method1("describe", (error.into_value(py),))?.extract()?;
    Ok(if kind == "not-applicable" { MethodError::NotApplicable(why) } else { MethodError::Failed(why) })
}
