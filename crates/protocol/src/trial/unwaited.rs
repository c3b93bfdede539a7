use std::sync::{Mutex, MutexGuard, PoisonError};

/// A value that is made when it is first asked for. Whoever asks while another makes it makes one of its own.
///
/// Nobody waits, because makers run on rayon's threads and may use rayon themselves: a thread that waits there takes up
/// other work, and that work may ask for this very value. With a lock in its place both would wait for ever.
pub(super) struct Unwaited<T> {
    state: Mutex<State<T>>,
}

enum State<T> {
    Unmade,
    InTheMaking,
    Made(T),
}

impl<T: Clone> Unwaited<T> {
    pub(super) const fn new() -> Self {
        Self { state: Mutex::new(State::Unmade) }
    }

    /// The value; `make` makes equal ones whenever it is called.
    pub(super) fn get(&self, make: impl FnOnce() -> T) -> T {
        let mut state = self.state();
        match &*state {
            State::Made(value) => return value.clone(),
            State::Unmade => *state = State::InTheMaking,
            State::InTheMaking => {}
        }
        drop(state);
        let made = make();
        let mut state = self.state();
        // Whoever was first made the value of all.
        if let State::Made(value) = &*state {
            return value.clone();
        }
        *state = State::Made(made.clone());
        made
    }

    /// The value, if somebody made it.
    pub(super) fn made(&self) -> Option<T> {
        match &*self.state() {
            State::Made(value) => Some(value.clone()),
            State::Unmade | State::InTheMaking => None,
        }
    }

    fn state(&self) -> MutexGuard<'_, State<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use rayon::prelude::*;

    use super::*;

    #[test]
    fn made_once_by_those_who_ask_one_after_another() {
        let value = Unwaited::new();
        assert_eq!((value.get(|| 3), value.get(|| 4)), (3, 3));
    }

    #[test]
    fn makers_that_work_on_the_same_threads_do_not_wait_for_each_other() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        for _ in 0..50 {
            let value = Unwaited::new();
            let made = AtomicUsize::new(0);
            let make = || {
                made.fetch_add(1, Ordering::Relaxed);
                (0..64u64).into_par_iter().map(|n| (0..2000).fold(n, |sum, k| sum ^ (k * n))).sum::<u64>()
            };
            let all: Vec<u64> = pool.install(|| (0..16).into_par_iter().map(|_| value.get(make)).collect());
            assert!(all.iter().all(|one| *one == all[0]));
            assert!(made.into_inner() < 16, "most find it made");
        }
    }
}
