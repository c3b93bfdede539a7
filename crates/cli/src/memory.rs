//! What this process has taken.

/// The most bytes of memory that the process has held since [`forget_peak`], or since it began; `None` where the system
/// does not tell.
pub(crate) fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    kibibytes.checked_mul(1024)
}

/// Begins to count anew from what is held now, where the system allows it.
pub(crate) fn forget_peak() {
    // 5 resets the high-water mark of the resident set (Linux, proc_pid_clear_refs(5)).
    std::fs::write("/proc/self/clear_refs", "5").ok();
}

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

    #[test]
    fn the_peak_covers_what_was_held_and_is_forgotten() {
        if peak_bytes().is_none() {
            return;
        }
        forget_peak();
        let before = peak_bytes().unwrap();
        let held = vec![1u8; 64 << 20];
        let with = peak_bytes().unwrap();
        assert_eq!(held.iter().map(|&byte| usize::from(byte)).sum::<usize>(), 64 << 20);
        assert!(with >= before + (60 << 20), "{before} {with}");
    }
}
