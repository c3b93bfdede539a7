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
    use std::panic::{catch_unwind, set_hook, take_hook};
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn a_caught_panic_is_a_single_line_and_not_printed() {
        static PRINTED: AtomicUsize = AtomicUsize::new(0);
        const MARK: &str = "Error in Device::poll: \n  Parent device is lost\n";
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            let is_ours = panic.payload().downcast_ref::<&str>().is_some_and(|text| *text == MARK);
            PRINTED.fetch_add(usize::from(is_ours), Ordering::SeqCst);
            if !is_ours {
                before(panic);
            }
        }));
        let nested = catch_panics::<()>("outer", || {
            let inner = catch_panics::<()>("H100 (Gl)", || panic!("{MARK}"));
            let message = inner.unwrap_err().to_string();
            assert_eq!(message, "H100 (Gl): device: Error in Device::poll: Parent device is lost");
            std::panic::panic_any(MARK)
        });
        assert!(matches!(nested, Err(GpuError::Device { adapter, .. }) if adapter == "outer"));
        assert_eq!(PRINTED.load(Ordering::SeqCst), 0, "caught panics are not printed");
        assert!(catch_unwind(|| std::panic::panic_any(MARK)).is_err());
        assert_eq!(PRINTED.load(Ordering::SeqCst), 1, "other panics are printed");
    }
}
