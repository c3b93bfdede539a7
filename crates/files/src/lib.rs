//! Files that appear whole or not at all, and SHA-256 digests.
//!
//! Everything that atsplat writes goes through [`write`], [`write_with`], [`write_unsynced`] or an [`AtomicFile`]: into a
//! temporary file of a unique name beside the target, which is renamed once it is complete. A reader sees the old file or
//! the new one, never a part, and two processes that write the same file do not meet.

mod atomic;
mod digest;

pub use atomic::{AtomicFile, PARTIAL, Writer, write, write_unsynced, write_with};
pub use digest::{NotADigest, Sha256Digest, hexadecimal};
