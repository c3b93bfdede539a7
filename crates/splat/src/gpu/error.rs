use thiserror::Error;

/// Errors of the GPU renderer.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum GpuError {
    /// No adapter matches the choice.
    #[error("graphics adapter: expected {expected}, found {found}")]
    NoAdapter {
        /// The choice.
        expected: String,
        /// The available adapters.
        found: String,
    },
    /// The adapter lacks a capability that the kernels need.
    #[error("{adapter}: {what}: expected {expected}, found {found}")]
    Unfit {
        /// Name of the adapter.
        adapter: String,
        /// The limit or capability.
        what: &'static str,
        /// The required value.
        expected: String,
        /// The adapter's value.
        found: String,
    },
    /// The device could not be opened or was lost.
    #[error("{adapter}: device: {reason}")]
    Device {
        /// Name of the adapter.
        adapter: String,
        /// The driver's message.
        reason: String,
    },
    /// The adapter ran out of memory.
    #[error("{adapter}: out of memory: {reason}")]
    OutOfMemory {
        /// Name of the adapter.
        adapter: String,
        /// The driver's message.
        reason: String,
    },
    /// The driver or wgpu rejected a command.
    #[error("{adapter}: rejected command: {reason}")]
    Rejected {
        /// Name of the adapter.
        adapter: String,
        /// wgpu's message.
        reason: String,
    },
    /// More than the adapter can bind, even when split.
    #[error("{adapter}: {what} need {needed} {unit}, the limit is {limit}")]
    TooLarge {
        /// Name of the adapter.
        adapter: String,
        /// What is too large.
        what: &'static str,
        /// The unit, such as `bytes`.
        unit: &'static str,
        /// Required amount.
        needed: u64,
        /// Allowed amount.
        limit: u64,
    },
    /// The adapter computes wrong results.
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
