use std::any::Any;
use std::cell::Cell;
use std::panic::{UnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;
use std::thread;

thread_local! {
    /// Whether panics of this thread become errors and are not printed.
    static CATCHING: Cell<bool> = const { Cell::new(false) };
}

/// [`catch_unwind`] for work of a library whose panics become errors: they are not printed. Those of other threads are, also of threads
/// that the work starts.
///
/// # Errors
/// The panic, for [`panic_message`].
pub fn catch_silently<T>(work: impl FnOnce() -> T + UnwindSafe) -> thread::Result<T> {
    silence_caught_panics();
    let outer = CATCHING.replace(true);
    let outcome = catch_unwind(work);
    CATCHING.set(outer);
    outcome
}

/// Installs, once, a panic hook that suppresses caught panics and forwards all others to the previous hook.
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

/// The message of a caught panic ([`std::panic::catch_unwind`]); `None` if it has none.
pub fn panic_message(panic: &(dyn Any + Send)) -> Option<&str> {
    panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied())
}

#[cfg(test)]
mod tests {
    use std::panic::panic_any;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    #[test]
    fn caught_panics_alone_are_not_printed() {
        static PRINTED: AtomicUsize = AtomicUsize::new(0);
        const MARK: &str = "the mark of this test";
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            let is_ours = panic.payload().downcast_ref::<&str>().is_some_and(|text| *text == MARK);
            PRINTED.fetch_add(usize::from(is_ours), Ordering::SeqCst);
            if !is_ours {
                before(panic);
            }
        }));
        let printed = || PRINTED.load(Ordering::SeqCst);
        let nested = catch_silently::<()>(|| {
            assert_eq!(catch_silently(|| 7).unwrap(), 7);
            panic_any(MARK)
        });
        let panic = nested.unwrap_err();
        assert_eq!((panic_message(panic.as_ref()), printed()), (Some(MARK), 0));
        let panics_elsewhere = || thread::scope(|scope| scope.spawn::<_, ()>(|| panic_any(MARK)).join().is_err());
        assert!(catch_silently(panics_elsewhere).unwrap());
        assert_eq!(printed(), 1, "of another thread");
        assert!(catch_unwind(|| panic_any(MARK)).is_err());
        assert_eq!(printed(), 2, "after the work");
    }

    #[test]
    fn literals_and_formatted_messages_are_read() {
        let panics: [Box<dyn Any + Send>; 3] = [Box::new("a literal"), Box::new("formatted".to_owned()), Box::new(7)];
        assert_eq!(
            panics.each_ref().map(|panic| panic_message(panic.as_ref())),
            [Some("a literal"), Some("formatted"), None]
        );
    }
}
