//! The processes of a method: as many as were asked for, each used by one trial at a time.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::process::Process;

/// Places for processes, each of which is started when it is first needed.
#[derive(Debug)]
pub(super) struct Pool {
    idle: Mutex<Vec<Slot>>,
    returned: Condvar,
}

/// A place for a process.
#[derive(Debug)]
pub(super) struct Slot {
    /// From 0.
    pub(super) number: usize,
    /// The process, if it runs.
    pub(super) process: Option<Process>,
}

/// A slot in use, which returns to the pool when it is dropped.
#[derive(Debug)]
pub(super) struct SlotGuard<'a> {
    pool: &'a Pool,
    slot: Option<Slot>,
}

impl Pool {
    /// A pool of `count` places, at least one, the first with a running process.
    pub(super) fn new(count: usize, first: Process) -> Self {
        let empty = (1..count).rev().map(|number| Slot { number, process: None });
        let idle = empty.chain([Slot { number: 0, process: Some(first) }]).collect();
        Self { idle: Mutex::new(idle), returned: Condvar::new() }
    }

    /// Waits for a place. The one that was used last is taken first, so that no process is started without need.
    pub(super) fn take(&self) -> SlotGuard<'_> {
        let mut idle = self.lock();
        loop {
            if let Some(slot) = idle.pop() {
                return SlotGuard { pool: self, slot: Some(slot) };
            }
            idle = self.returned.wait(idle).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// The result of `of` for each running process that is idle.
    pub(super) fn of_idle<T>(&self, of: impl Fn(&Process) -> T) -> Vec<T> {
        self.lock().iter().filter_map(|slot| slot.process.as_ref()).map(of).collect()
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Slot>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl SlotGuard<'_> {
    #[expect(clippy::expect_used, reason = "the slot is taken out on drop alone")]
    pub(super) const fn slot(&mut self) -> &mut Slot {
        self.slot.as_mut().expect("a slot in use")
    }
}

impl Drop for SlotGuard<'_> {
    fn drop(&mut self) {
        self.pool.lock().extend(self.slot.take());
        self.pool.returned.notify_one();
    }
}

impl Drop for Pool {
    /// Asks all processes to end before the first of them is waited for.
    fn drop(&mut self) {
        self.lock().iter_mut().filter_map(|slot| slot.process.as_mut()).for_each(Process::close);
        for why in self.lock().iter_mut().filter_map(|slot| slot.process.as_mut()).filter_map(Process::end) {
            // All trials have their results: nothing else can tell.
            tracing::warn!("a method's process: {why}");
        }
    }
}
