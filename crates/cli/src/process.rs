//! This process: the binary and command line it runs, and the memory it holds.

use std::path::Path;

use atsplat_eval::Provenance;
pub(crate) use atsplat_eval::timing::memory::{forget_peak, peak_bytes};

/// Provenance of a run of this process. The folder of the binary is dropped: results are published.
pub(crate) fn provenance() -> Provenance {
    let mut command: Vec<String> = std::env::args().collect();
    if let Some(binary) = command.first_mut() {
        let name = Path::new(binary).file_name().map(|name| name.to_string_lossy().into_owned());
        *binary = name.unwrap_or_else(|| "atsplat".to_owned());
    }
    atsplat_eval::runner::here(env!("CARGO_PKG_VERSION"), option_env!("ATSPLAT_COMMIT"), command)
}

/// A number of bytes with a readable unit, as `1.5 KiB`.
pub(crate) fn format_bytes(bytes: u64) -> String {
    const UNITS: [&str; 4] = ["B", "KiB", "MiB", "GiB"];
    let (mut value, mut unit) = (bytes as f64, 0);
    while value >= 1024.0 && unit + 1 < UNITS.len() {
        value /= 1024.0;
        unit += 1;
    }
    let decimals = usize::from(unit > 0 && value < 100.0);
    format!("{value:.decimals$} {}", UNITS.get(unit).unwrap_or(&"B"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_bytes_with_a_readable_unit() {
        let formatted = [0, 1023, 1536, 300 << 20, 5 << 30, 1 << 50].map(format_bytes);
        assert_eq!(formatted, ["0 B", "1023 B", "1.5 KiB", "300 MiB", "5.0 GiB", "1048576 GiB"]);
    }
}
