use std::sync::{Mutex, MutexGuard, PoisonError};

/// A value computed on first use, without ever blocking: concurrent first uses each compute it, and the first result is
/// kept.
///
/// Blocking would deadlock: computations run on rayon's threads and may use rayon themselves, and a waiting rayon thread
/// may pick up work that needs this very value.
pub(super) struct LazyValue<T>(Mutex<Option<T>>);

impl<T: Clone> LazyValue<T> {
    pub(super) const fn new() -> Self {
        Self(Mutex::new(None))
    }

    /// The value; `compute` must give equal values on every call.
    pub(super) fn get(&self, compute: impl FnOnce() -> T) -> T {
        if let Some(value) = self.get_if_computed() {
            return value;
        }
        let computed = compute();
        self.lock().get_or_insert(computed).clone()
    }

    /// The value, if it has been computed.
    pub(super) fn get_if_computed(&self) -> Option<T> {
        self.lock().clone()
    }

    fn lock(&self) -> MutexGuard<'_, Option<T>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use atsplat_tests::on_threads;
    use rayon::prelude::*;

    use super::*;

    #[test]
    fn sequential_uses_compute_once() {
        let value = LazyValue::new();
        assert_eq!((value.get(|| 3), value.get(|| 4)), (3, 3));
    }

    #[test]
    fn computations_that_use_rayon_do_not_deadlock() {
        on_threads(2, || {
            for _ in 0..50 {
                let value = LazyValue::new();
                let compute =
                    || (0..64u64).into_par_iter().map(|n| (0..2000).fold(n, |sum, k| sum ^ (k * n))).sum::<u64>();
                let all: Vec<u64> = (0..16).into_par_iter().map(|_| value.get(compute)).collect();
                assert!(all.iter().all(|one| *one == all[0]));
            }
        });
    }
}
