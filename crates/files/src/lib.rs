//! Atomic file writes, locks of folders, embedded files, CSV, SHA-256 digests, dates, changes of records, escaped Markdown,
//! messages of panics, where paths lead, and the parts that errors about files share.
//!
//! Everything that atsplat writes goes through [`write()`], [`write_with`], [`write_unsynced`] or an [`AtomicFile`]: to a
//! temporary file with a unique name in the target's folder, which is renamed when it is complete. Readers see the old
//! file or the new one, never a part, and processes that write the same file do not interfere.

mod atomic;
mod cache;
mod changes;
pub mod csv;
mod date;
mod digest;
mod embedded;
mod error;
mod existing;
mod folder;
mod lock;
mod markdown;
mod panic;
mod place;
mod regular;
mod toml_error;

pub use atomic::{AtomicFile, PARTIAL, Writer, remove_abandoned, write, write_unsynced, write_with};
pub use cache::cache_folder;
pub use changes::changes;
pub use date::{date, unix_seconds};
pub use digest::{InvalidDigest, Sha256Digest, hexadecimal};
pub use embedded::{Embedded, is_toml_path};
pub use error::{FileError, InvalidText, Malformed, quoted, shortened};
pub use existing::{entries_if_exists, read_if_exists, remove_if_exists};
pub use folder::create_folder;
pub use lock::{FileLock, FolderLock, LockError, this_process};
pub use markdown::escaped_markdown;
pub use panic::{catch_silently, panic_message};
pub use place::{canonical_path, is_at};
pub use regular::{open, read, read_to_string};
pub use toml_error::{malformed_toml, toml_problem};

/// Text without the byte order mark of UTF-8 at its beginning, which some editors write.
pub fn without_byte_order_mark(text: &[u8]) -> &[u8] {
    text.strip_prefix(b"\xef\xbb\xbf").unwrap_or(text)
}

/// Whether bytes are a Git LFS pointer, the placeholder of a file that was not fetched (git-lfs `docs/spec.md`).
pub fn is_lfs_pointer(bytes: &[u8]) -> bool {
    bytes.starts_with(b"version https://git-lfs.github.com/spec/")
}

/// The last part of a path, or all of it if it ends in `..` or is a root.
pub fn name_of(path: &std::path::Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Whether text is at most one component of a path on every system, so that a file written under it cannot end up in another folder:
/// keys of chunks and indices, names of frames and of objects are untrusted text. A system may refuse it nevertheless, as Windows does
/// `a?`, or give it a meaning of its own, as it does `CON`.
pub fn is_plain_name(name: &str) -> bool {
    !matches!(name, "" | "." | "..") && !name.contains(['/', '\\', ':', '\0'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pointers_begin_with_the_address_of_their_specification() {
        assert!(is_lfs_pointer(b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"));
        assert!(!is_lfs_pointer(b"version https://git-lfs.github.com/spec") && !is_lfs_pointer(b"version 1.0\n"));
    }

    #[test]
    fn only_the_mark_at_the_beginning_is_left_out() {
        for (text, expected) in [("\u{feff}\u{feff}a", "\u{feff}a"), ("a\u{feff}", "a\u{feff}"), ("", "")] {
            assert_eq!(without_byte_order_mark(text.as_bytes()), expected.as_bytes());
        }
    }
}
