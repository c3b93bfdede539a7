//! Counts what passes between the host and the device.

use std::ops::Sub;
use std::sync::atomic::{AtomicU64, Ordering};

/// What a renderer asked of its device: times on a busy machine differ, these do not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GpuCounts {
    /// Command buffers submitted.
    pub submissions: u64,
    /// Waits of the host until the device has finished.
    pub waits: u64,
    /// Kernels dispatched.
    pub dispatches: u64,
    /// Renderings and backward passes repeated, because their lists had been too short.
    pub repeats: u64,
    /// Bytes copied to the device.
    pub bytes_up: u64,
    /// Bytes copied to the host.
    pub bytes_down: u64,
}

/// Later counts minus earlier ones.
impl Sub for GpuCounts {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        Self {
            submissions: self.submissions - earlier.submissions,
            waits: self.waits - earlier.waits,
            dispatches: self.dispatches - earlier.dispatches,
            repeats: self.repeats - earlier.repeats,
            bytes_up: self.bytes_up - earlier.bytes_up,
            bytes_down: self.bytes_down - earlier.bytes_down,
        }
    }
}

/// A number of [`GpuCounts`].
#[derive(Debug, Default)]
pub(super) struct Counter(AtomicU64);

impl Counter {
    pub(super) fn add(&self, count: u64) {
        self.0.fetch_add(count, Ordering::Relaxed);
    }

    fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// The running counts of a device.
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) submissions: Counter,
    pub(super) waits: Counter,
    pub(super) dispatches: Counter,
    pub(super) repeats: Counter,
    pub(super) bytes_up: Counter,
    pub(super) bytes_down: Counter,
}

impl Counters {
    pub(super) fn counts(&self) -> GpuCounts {
        GpuCounts {
            submissions: self.submissions.get(),
            waits: self.waits.get(),
            dispatches: self.dispatches.get(),
            repeats: self.repeats.get(),
            bytes_up: self.bytes_up.get(),
            bytes_down: self.bytes_down.get(),
        }
    }
}
