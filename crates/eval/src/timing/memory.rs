//! Memory use of this process.

use std::fs;

/// Peak resident memory in bytes since [`reset_peak`] or the start of the process; `None` if the system does not report
/// it.
pub fn peak_bytes() -> Option<u64> {
    status_bytes(&fs::read_to_string("/proc/self/status").ok()?, "VmHWM:")
}

/// Resident memory in bytes; `None` if the system does not report it.
pub fn held_bytes() -> Option<u64> {
    status_bytes(&fs::read_to_string("/proc/self/status").ok()?, "VmRSS:")
}

/// Resets the peak to the current value; `false` if the system does not allow it.
pub fn reset_peak() -> bool {
    // 5 resets the high-water mark of the resident set (Linux, proc_pid_clear_refs(5)).
    fs::write("/proc/self/clear_refs", "5").is_ok()
}

/// A field of `/proc/PID/status` in bytes.
pub(crate) fn status_bytes(status: &str, field: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    let kibibytes: u64 = line.split_whitespace().next()?.parse().ok()?;
    kibibytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Other tests of this process may free as much at the same moment, but not every time.
    #[test]
    fn the_peak_includes_an_allocation_after_a_reset() {
        if peak_bytes().is_none() || !reset_peak() {
            return;
        }
        let grows = |_| {
            assert!(reset_peak());
            let before = peak_bytes().unwrap();
            let held = vec![1u8; 64 << 20];
            let with = peak_bytes().unwrap();
            assert_eq!(held.iter().map(|&byte| usize::from(byte)).sum::<usize>(), 64 << 20);
            with >= before + (60 << 20)
        };
        assert!((0..20).any(grows));
    }

    #[test]
    fn reads_fields_of_a_status_file() {
        let status = "VmPeak:\t   9 kB\nVmHWM:\t    7 kB\nVmRSS:\t    3 kB\n";
        assert_eq!((status_bytes(status, "VmHWM:"), status_bytes(status, "VmRSS:")), (Some(7168), Some(3072)));
        assert_eq!(status_bytes(status, "VmSwap:"), None);
    }
}
