/// A number of bytes with a readable unit, such as `1.5 KiB`: no decimals from 100 up.
pub fn format_bytes(bytes: u64) -> String {
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
