//! The allocator keeps the memory of freed tensors for the next ones. Returning it to the system, which clears it again, takes a tenth to a
//! fifth of a step.

/// How long mimalloc keeps freed memory, in milliseconds; -1 is for ever. It reads this before `main`, so only a new program can have
/// another value.
const DELAY: &str = "MIMALLOC_PURGE_DELAY";

/// Replaces this process by the same command with an allocator that keeps freed memory, unless the environment says how long it does.
#[cfg(unix)]
pub(super) fn keep() {
    use std::os::unix::process::CommandExt as _;
    use std::process::Command;

    if std::env::var_os(DELAY).is_some() {
        return;
    }
    // Returns only if it fails.
    let error = std::env::current_exe().map_or_else(
        |error| error,
        |program| Command::new(program).args(std::env::args_os().skip(1)).env(DELAY, "-1").exec(),
    );
    crate::print::note(&format!("freed memory is returned to the system, which makes steps longer: {error}"));
}

#[cfg(not(unix))]
pub(super) fn keep() {}
