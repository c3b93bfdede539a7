//! Threads of calls from Python.
//!
//! Calls have a pool of their own, because a method under evaluation may call the package while the evaluation's threads wait for
//! that method. After a fork, as in PyTorch's data loaders, the parent's threads do not exist: the child starts another pool.

use std::sync::{Arc, Mutex, PoisonError};

use pyo3::Python;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::Failure;

static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Does work on the threads of calls, without the GIL.
pub(crate) fn work<T: Send>(py: Python<'_>, work: impl FnOnce() -> Result<T, Failure> + Send) -> Result<T, Failure> {
    py.detach(|| pool()?.install(work))
}

/// A pool for one evaluation.
pub(crate) fn evaluation() -> Result<ThreadPool, Failure> {
    ThreadPoolBuilder::new().build().map_err(|error| Failure::invalid("threads", error))
}

fn pool() -> Result<Arc<ThreadPool>, Failure> {
    let process = std::process::id();
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    match pool.take() {
        Some((owner, own)) if owner == process => {
            *pool = Some((owner, Arc::clone(&own)));
            Ok(own)
        }
        inherited => {
            #[expect(
                clippy::mem_forget,
                reason = "dropping it would wait for threads that this process does not have"
            )]
            std::mem::forget(inherited);
            let own = Arc::new(evaluation()?);
            *pool = Some((process, Arc::clone(&own)));
            Ok(own)
        }
    }
}
