use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

/// How far [`super::Trials`] works ahead of its consumer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Prefetch {
    /// Maximum number of trials in preparation or ready, on rayon's threads. 0 prepares each trial on demand.
    pub trials: usize,
    /// Which images are decoded ahead.
    pub decode: DecodeAhead,
    /// Maximum bytes of preprocessed images that were decoded ahead and are still alive, in the iterator *or* in
    /// trials taken from it. A trial that does not fit is returned undecoded and decodes on demand. Source images
    /// being decoded, one per thread, are not counted.
    pub max_bytes: u64,
}

/// Which images are decoded ahead.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DecodeAhead {
    /// None: cameras only.
    Nothing,
    /// Context images.
    Context,
    /// Context and target images.
    #[default]
    All,
}

impl Prefetch {
    /// Nothing is prepared or decoded ahead.
    pub const NONE: Self = Self { trials: 0, decode: DecodeAhead::Nothing, max_bytes: 0 };
}

impl Default for Prefetch {
    /// Four trials, 512 MiB: one trial of 12 + 100 views of 512×960 takes 165 MB.
    fn default() -> Self {
        Self { trials: 4, decode: DecodeAhead::All, max_bytes: 512 << 20 }
    }
}

/// A limit on bytes decoded ahead, and the bytes in use.
#[derive(Debug)]
pub(super) struct Budget {
    limit: u64,
    state: Mutex<BytesInUse>,
}

#[derive(Clone, Copy, Debug, Default)]
struct BytesInUse {
    now: u64,
    peak: u64,
}

/// A part of a budget, released on drop.
#[derive(Debug)]
pub(super) struct Reservation {
    budget: Arc<Budget>,
    bytes: u64,
}

impl Budget {
    pub(super) fn new(limit: u64) -> Arc<Self> {
        Arc::new(Self { limit, state: Mutex::default() })
    }

    /// Reserves `bytes` of the budget, or returns `None` if they are not free. Never waits, because a later trial in the
    /// queue may have reserved what an earlier one needs.
    pub(super) fn reserve(self: &Arc<Self>, bytes: u64) -> Option<Arc<Reservation>> {
        let mut held = locked(&self.state);
        let now = held.now.checked_add(bytes).filter(|now| *now <= self.limit)?;
        *held = BytesInUse { now, peak: held.peak.max(now) };
        Some(Arc::new(Reservation { budget: Arc::clone(self), bytes }))
    }

    pub(super) fn peak(&self) -> u64 {
        locked(&self.state).peak
    }
}

impl Drop for Reservation {
    fn drop(&mut self) {
        locked(&self.budget.state).now -= self.bytes;
    }
}

/// Jobs that run on rayon's threads and whose results are returned in the order they were pushed.
///
/// If no thread has started a job when its result is needed, the caller runs it: nothing waits for a free thread, so
/// neither a single thread nor a caller on a rayon thread can deadlock. Jobs may use rayon: no job waits for
/// another. Only [`Self::pop`] waits, so it is not called inside a job.
pub(super) struct OrderedJobs<T> {
    slots: VecDeque<Arc<Slot<T>>>,
}

type Job<T> = Box<dyn FnOnce() -> T + Send>;

struct Slot<T> {
    state: Mutex<State<T>>,
    done: Condvar,
}

enum State<T> {
    Waiting(Job<T>),
    Running,
    Done(thread::Result<T>),
    /// Cancelled, or its result has been taken.
    Gone,
}

impl<T: Send + 'static> OrderedJobs<T> {
    pub(super) const fn new() -> Self {
        Self { slots: VecDeque::new() }
    }

    pub(super) fn len(&self) -> usize {
        self.slots.len()
    }

    /// Adds a job; with `ahead`, rayon's threads may start it before its result is needed.
    pub(super) fn push(&mut self, job: Job<T>, ahead: bool) {
        let slot = Arc::new(Slot { state: Mutex::new(State::Waiting(job)), done: Condvar::new() });
        if ahead {
            let offered = Arc::clone(&slot);
            rayon::spawn_fifo(move || offered.run());
        }
        self.slots.push_back(slot);
    }

    /// The result of the job that was pushed first; a panic in the job resumes here.
    pub(super) fn pop(&mut self) -> Option<T> {
        let slot = self.slots.pop_front()?;
        slot.run();
        let mut state = locked(&slot.state);
        loop {
            match std::mem::replace(&mut *state, State::Gone) {
                State::Done(Ok(result)) => return Some(result),
                State::Done(Err(panic)) => resume_unwind(panic),
                State::Gone => return None,
                other => {
                    *state = other;
                    state = slot.done.wait(state).unwrap_or_else(PoisonError::into_inner);
                }
            }
        }
    }
}

impl<T> Slot<T> {
    /// Runs the job unless it has been started or cancelled.
    fn run(&self) {
        let mut state = locked(&self.state);
        match std::mem::replace(&mut *state, State::Running) {
            State::Waiting(job) => {
                drop(state);
                let result = catch_unwind(AssertUnwindSafe(job));
                // The previous state is dropped without holding the lock.
                let previous = std::mem::replace(&mut *locked(&self.state), State::Done(result));
                drop(previous);
                self.done.notify_all();
            }
            other => *state = other,
        }
    }
}

impl<T> Drop for OrderedJobs<T> {
    /// Cancels jobs that have not started.
    fn drop(&mut self) {
        for slot in &self.slots {
            let mut state = locked(&slot.state);
            if matches!(*state, State::Waiting(_)) {
                *state = State::Gone;
            }
        }
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use atsplat_tests::on_threads;

    use super::*;

    #[test]
    fn results_are_in_order_for_any_number_of_threads() {
        for threads in [1, 2, 7] {
            let taken = on_threads(threads, || {
                let mut ordered = OrderedJobs::new();
                for number in 0..50u64 {
                    let job = move || {
                        thread::sleep(std::time::Duration::from_micros((number * 37) % 11 * 50));
                        number
                    };
                    ordered.push(Box::new(job), number % 3 != 0);
                }
                std::iter::from_fn(|| ordered.pop()).collect::<Vec<_>>()
            });
            assert_eq!(taken, (0..50).collect::<Vec<_>>(), "{threads} threads");
        }
    }

    #[test]
    fn a_panic_in_a_job_resumes_when_its_result_is_taken() {
        let caught = catch_unwind(|| {
            let mut ordered: OrderedJobs<()> = OrderedJobs::new();
            ordered.push(Box::new(|| panic!("inside the job")), true);
            ordered.pop()
        });
        assert_eq!(caught.unwrap_err().downcast_ref(), Some(&"inside the job"));
    }

    #[test]
    fn dropping_cancels_jobs_that_have_not_started() {
        let started = Arc::new(AtomicUsize::new(0));
        on_threads(1, || {
            let mut ordered = OrderedJobs::new();
            for _ in 0..10 {
                let started = Arc::clone(&started);
                ordered.push(Box::new(move || started.fetch_add(1, Ordering::SeqCst)), true);
            }
            assert_eq!(ordered.pop(), Some(0), "the only thread runs the job itself");
        });
        assert_eq!(started.load(Ordering::SeqCst), 1);
    }

    #[test]
    fn a_budget_is_enforced_and_released() {
        let budget = Budget::new(100);
        let first = budget.reserve(60).unwrap();
        assert!(budget.reserve(41).is_none(), "one byte too many");
        assert!(budget.reserve(u64::MAX).is_none(), "no overflow");
        let second = budget.reserve(40).unwrap();
        drop(first);
        assert!(budget.reserve(60).is_some());
        drop(second);
        assert_eq!(budget.peak(), 100);
    }
}
