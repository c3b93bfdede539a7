//! Turns panics of wgpu, which occur if a device is lost while waiting for it, into errors without printing them.

use std::panic::AssertUnwindSafe;

use atsplat_files::{catch_silently, panic_message};

use super::GpuError;

/// Runs `work`, and returns a panic in it as a [`GpuError::Device`] with the panic message.
pub(super) fn catch_panics<T>(adapter: &str, work: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
    catch_silently(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let reason = single_line(panic_message(panic.as_ref()).unwrap_or("the driver panicked without a message"));
        Err(GpuError::Device { adapter: adapter.to_owned(), reason })
    })
}

/// Joins the lines of wgpu's multi-line messages.
fn single_line(text: &str) -> String {
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_caught_panic_is_a_single_line() {
        let caught = catch_panics::<()>("H100 (Gl)", || panic!("Error in Device::poll: \n  Parent device is lost\n"));
        let message = caught.unwrap_err().to_string();
        assert_eq!(message, "H100 (Gl): device: Error in Device::poll: Parent device is lost");
    }
}
