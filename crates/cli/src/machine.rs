//! This binary, on this machine, now.

use std::path::Path;

use atsplat_eval::Provenance;

/// What a run says of itself. Where the binary lies is nobody's concern: results are published.
pub(crate) fn here() -> Provenance {
    let mut command: Vec<String> = std::env::args().collect();
    if let Some(binary) = command.first_mut() {
        let name = Path::new(binary).file_name().map(|name| name.to_string_lossy().into_owned());
        *binary = name.unwrap_or_else(|| "atsplat".to_owned());
    }
    atsplat_eval::runner::here(env!("CARGO_PKG_VERSION"), option_env!("ATSPLAT_COMMIT"), command)
}
