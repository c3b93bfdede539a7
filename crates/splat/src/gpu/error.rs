use thiserror::Error;

/// Errors of the GPU renderer.
#[derive(Clone, Debug, Error, PartialEq)]
#[expect(missing_docs, reason = "the message explains the fields")]
pub enum GpuError {
    /// No adapter matches the choice.
    #[error("graphics adapter: expected {expected}, found {found}")]
    NoAdapter {
        /// The choice.
        expected: String,
        found: String,
    },
    /// The adapter lacks a capability that the kernels need.
    #[error("{adapter}: {what}: expected {expected}, found {found}")]
    Unfit {
        adapter: String,
        /// The limit or capability.
        what: &'static str,
        expected: String,
        found: String,
    },
    /// The device could not be opened or was lost.
    #[error("{adapter}: device: {reason}")]
    Device { adapter: String, reason: String },
    /// The adapter ran out of memory.
    #[error("{adapter}: out of memory: {reason}")]
    OutOfMemory { adapter: String, reason: String },
    /// The driver or wgpu rejected a command.
    #[error("{adapter}: rejected command: {reason}")]
    Rejected { adapter: String, reason: String },
    /// More than the adapter can bind, even when split.
    #[error("{adapter}: {what} need {needed} {unit}, the limit is {limit}")]
    TooLarge {
        adapter: String,
        what: &'static str,
        /// The unit, such as `bytes`.
        unit: &'static str,
        needed: u64,
        limit: u64,
    },
    /// The adapter computes wrong results.
    #[error("{adapter}: self-test: {what} differs by {difference:e}, expected at most {bound:e}")]
    SelfTest {
        adapter: String,
        /// The image or gradient.
        what: String,
        difference: f64,
        bound: f64,
    },
}
