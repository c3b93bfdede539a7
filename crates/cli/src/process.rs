//! This process: the binary and command line it runs, and the memory it holds.

use std::path::Path;

use atsplat_eval::Provenance;
pub(crate) use atsplat_eval::timing::memory::peak_bytes;
pub(crate) use atsplat_numeric::format_bytes;

/// Provenance of a run of this process. The folder of the binary is dropped: results are published.
pub(crate) fn provenance() -> Provenance {
    let mut command: Vec<String> = std::env::args().collect();
    if let Some(binary) = command.first_mut() {
        let name = Path::new(binary).file_name().map(|name| name.to_string_lossy().into_owned());
        *binary = name.unwrap_or_else(|| "atsplat".to_owned());
    }
    atsplat_eval::runner::here(env!("CARGO_PKG_VERSION"), option_env!("ATSPLAT_COMMIT"), command)
}
