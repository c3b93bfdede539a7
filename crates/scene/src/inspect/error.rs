use polars::error::PolarsError;
use thiserror::Error;

/// Why a dataset cannot be summed up.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum InspectError {
    /// Polars refused.
    #[error("computing statistics: {0}")]
    Polars(#[from] PolarsError),
}
