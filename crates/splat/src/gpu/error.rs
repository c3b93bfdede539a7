use thiserror::Error;

/// What can go wrong with a graphics processor.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum GpuError {
    /// No adapter fits what was asked for.
    #[error("graphics adapter: expected {expected}, found {found}")]
    NoAdapter {
        /// What was asked for.
        expected: String,
        /// Adapters that there are.
        found: String,
    },
    /// An adapter that lacks what compute kernels need.
    #[error("{adapter}: {what}: expected {expected}, found {found}")]
    Unfit {
        /// Its name.
        adapter: String,
        /// The limit or ability that falls short.
        what: &'static str,
        /// What is needed.
        expected: String,
        /// What it has.
        found: String,
    },
    /// The driver refused a device or lost it.
    #[error("{adapter}: device: {reason}")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// The adapter's memory does not suffice.
    #[error("{adapter}: out of memory: {reason}")]
    OutOfMemory {
        /// Name of the adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// A command that the driver or wgpu refused.
    #[error("{adapter}: refused: {reason}")]
    Refused {
        /// Name of the adapter.
        adapter: String,
        /// The words of wgpu.
        reason: String,
    },
    /// More than the adapter can bind at once, however it is cut.
    #[error("{adapter}: {what} take {needed} {unit}, at most {limit} are possible")]
    TooLarge {
        /// Name of the adapter.
        adapter: String,
        /// What is too large.
        what: &'static str,
        /// What is counted, as `bytes`.
        unit: &'static str,
        /// Of these, needed.
        needed: u64,
        /// Allowed.
        limit: u64,
    },
    /// The adapter computes wrong numbers.
    #[error("{adapter}: self-test: {what} differs by {difference:e}, expected at most {bound:e}")]
    SelfTest {
        /// Name of the adapter.
        adapter: String,
        /// The image or gradient.
        what: String,
        /// Largest difference found.
        difference: f64,
        /// Largest difference allowed.
        bound: f64,
    },
}
