//! What this process has taken.

pub(crate) use atsplat_eval::timing::memory::{forget_peak, peak_bytes};

/// Bytes for people.
pub(crate) fn for_people(bytes: u64) -> String {
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
    fn bytes_have_the_unit_that_suits_them() {
        let told = [0, 1023, 1536, 300 << 20, 5 << 30, 1 << 50].map(for_people);
        assert_eq!(told, ["0 B", "1023 B", "1.5 KiB", "300 MiB", "5.0 GiB", "1048576 GiB"]);
    }
}
