//! This binary, on this machine, now.

use atsplat_eval::Provenance;

/// What a run says of itself.
pub(crate) fn here() -> Provenance {
    atsplat_eval::runner::here(env!("CARGO_PKG_VERSION"), option_env!("ATSPLAT_COMMIT"), std::env::args().collect())
}
