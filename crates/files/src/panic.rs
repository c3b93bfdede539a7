use std::any::Any;

/// The message of a caught panic ([`std::panic::catch_unwind`]); `None` if it has none.
pub fn panic_message(panic: &(dyn Any + Send)) -> Option<&str> {
    panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literals_and_formatted_messages_are_read() {
        let panics: [Box<dyn Any + Send>; 3] = [Box::new("a literal"), Box::new("formatted".to_owned()), Box::new(7)];
        assert_eq!(
            panics.each_ref().map(|panic| panic_message(panic.as_ref())),
            [Some("a literal"), Some("formatted"), None]
        );
    }
}
