//! Threads of calls from Python.
//!
//! Calls have a pool of their own, because a method under evaluation may call the package while the evaluation's threads wait for
//! that method. After a fork, as in PyTorch's data loaders, the parent's threads do not exist: the child starts another pool.
//!
//! Stores are read and written by Polars, which has one pool for all. In a child, work on the parent's would wait forever.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use pyo3::Python;
use pyo3::exceptions::PyRuntimeError;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::Failure;

static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Does work on the threads of calls, without the GIL.
pub(crate) fn work<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T, Failure> + Send) -> Result<T, Failure> {
    py.detach(|| pool()?.install(work))
}

/// Does work with stores, as [`work`] does.
pub(crate) fn work_with_stores<T: Send>(
    py: Python<'_>,
    task: impl FnOnce() -> Result<T, Failure> + Send,
) -> Result<T, Failure> {
    check_process()?;
    work(py, task)
}

/// Rejects stores in a process that was forked from one that has used stores.
pub(crate) fn check_process() -> Result<(), Failure> {
    static FIRST: OnceLock<u32> = OnceLock::new();
    let process = std::process::id();
    if *FIRST.get_or_init(|| process) == process {
        return Ok(());
    }
    let text = "stores cannot be used in a process that was forked from one that has used stores: its threads do not exist here; start \
                processes with \"spawn\" or \"forkserver\", such as multiprocessing.get_context(\"spawn\")";
    Err(PyRuntimeError::new_err(text).into())
}

/// A pool for one evaluation.
pub(crate) fn evaluation() -> Result<ThreadPool, Failure> {
    ThreadPoolBuilder::new().build().map_err(|error| Failure::invalid("threads", error))
}

fn pool() -> Result<Arc<ThreadPool>, Failure> {
    let process = std::process::id();
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match pool.take() {
        Some((owner, threads)) if owner == process => {
            *pool = Some((owner, Arc::clone(&threads)));
            Ok(threads)
        }
        inherited => {
            #[expect(
                clippy::mem_forget,
                reason = "dropping it would wait for threads that this process does not have"
            )]
            std::mem::forget(inherited);
            let threads = Arc::new(evaluation()?);
            *pool = Some((process, Arc::clone(&threads)));
            Ok(threads)
        }
    }
}
