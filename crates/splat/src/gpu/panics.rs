//! wgpu panics where a device is lost while somebody waits for it: here that is an error, and nothing is printed.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

use super::GpuError;

thread_local! {
    /// Whether a panic of this thread becomes an error and is not to be printed.
    static CATCHING: Cell<bool> = const { Cell::new(false) };
}

/// Does something that a driver may bring to a panic; the panic is a [`GpuError::Device`] with its text.
pub(super) fn catch_panics<T>(adapter: &str, work: impl FnOnce() -> Result<T, GpuError>) -> Result<T, GpuError> {
    silence_caught_panics();
    let outer = CATCHING.replace(true);
    let outcome = catch_unwind(AssertUnwindSafe(work));
    CATCHING.set(outer);
    outcome.unwrap_or_else(|panic| {
        let reason = single_line(&panic_message(panic.as_ref()));
        Err(GpuError::Device { adapter: adapter.to_owned(), reason })
    })
}

/// Puts a hook before the one that prints panics: once, and for all threads, whose own panics it hands on.
fn silence_caught_panics() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let previous = take_hook();
        set_hook(Box::new(move |panic| {
            if !CATCHING.get() {
                previous(panic);
            }
        }));
    });
}

fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    text.unwrap_or("the driver panicked without a word").to_owned()
}

/// wgpu prints a tree of causes.
fn single_line(text: &str) -> String {
    text.lines().map(str::trim).filter(|line| !line.is_empty()).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn a_lost_device_is_one_line_and_nothing_is_printed() {
        static PRINTED: AtomicUsize = AtomicUsize::new(0);
        const MARK: &str = "Error in Device::poll: \n  Parent device is lost\n";
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            let told = panic.payload().downcast_ref::<&str>().is_some_and(|text| *text == MARK);
            PRINTED.fetch_add(usize::from(told), Ordering::SeqCst);
            if !told {
                before(panic);
            }
        }));
        let nested = catch_panics::<()>("outer", || {
            let inner = catch_panics::<()>("H100 (Gl)", || panic!("{MARK}"));
            let told = inner.unwrap_err().to_string();
            assert_eq!(told, "H100 (Gl): device: Error in Device::poll: Parent device is lost");
            std::panic::panic_any(MARK)
        });
        assert!(matches!(nested, Err(GpuError::Device { adapter, .. }) if adapter == "outer"));
        assert_eq!(PRINTED.load(Ordering::SeqCst), 0, "catch_panics panics are not printed");
        assert!(catch_unwind(|| std::panic::panic_any(MARK)).is_err());
        assert_eq!(PRINTED.load(Ordering::SeqCst), 1, "others are");
    }
}
