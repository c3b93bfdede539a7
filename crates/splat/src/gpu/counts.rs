//! Counts what passes between the host and the device.

use std::fmt;
use std::ops::{Add, Sub};
use std::sync::atomic::{AtomicU64, Ordering};

use serde::Serialize;

/// Requests of a renderer to its device: times on a busy machine differ, these do not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
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

impl GpuCounts {
    fn zip(self, other: Self, with: fn(u64, u64) -> u64) -> Self {
        Self {
            submissions: with(self.submissions, other.submissions),
            waits: with(self.waits, other.waits),
            dispatches: with(self.dispatches, other.dispatches),
            repeats: with(self.repeats, other.repeats),
            bytes_up: with(self.bytes_up, other.bytes_up),
            bytes_down: with(self.bytes_down, other.bytes_down),
        }
    }
}

impl Add for GpuCounts {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        self.zip(other, |one, other| one + other)
    }
}

/// Later counts minus earlier ones.
impl Sub for GpuCounts {
    type Output = Self;

    fn sub(self, earlier: Self) -> Self {
        self.zip(earlier, |later, earlier| later - earlier)
    }
}

impl fmt::Display for GpuCounts {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mebibytes = |bytes: u64| bytes as f64 / f64::from(1 << 20);
        write!(
            formatter,
            "{} submissions, {} waits, {} dispatches, {} repeats, {:.1} MiB up, {:.1} MiB down",
            self.submissions,
            self.waits,
            self.dispatches,
            self.repeats,
            mebibytes(self.bytes_up),
            mebibytes(self.bytes_down)
        )
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
