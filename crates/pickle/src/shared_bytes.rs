use std::fmt;
use std::ops::{Deref, Range};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::TorchError;

/// A range of bytes of a memory-mapped file or buffer, shared without a copy.
#[derive(Clone)]
pub struct SharedBytes {
    owner: Arc<dyn AsRef<[u8]> + Send + Sync>,
    range: Range<usize>,
    /// Of the zip entry that the bytes are in.
    checksum: Option<Arc<Checksum>>,
    /// The file that the bytes are from, for messages.
    file: Option<Arc<Path>>,
}

/// The CRC-32 of a zip entry, which is compared once.
#[derive(Debug)]
pub(crate) struct Checksum {
    /// The entry, for messages.
    location: String,
    content: SharedBytes,
    crc: u32,
    is_verified: AtomicBool,
}

impl Checksum {
    pub(crate) fn new(location: String, content: SharedBytes, crc: u32) -> Self {
        Self { location, content, crc, is_verified: AtomicBool::new(false) }
    }

    fn verify(&self) -> Result<(), TorchError> {
        if self.is_verified.load(Ordering::Relaxed) {
            return Ok(());
        }
        let crc = crc32fast::hash(&self.content);
        if crc != self.crc {
            let expected = format!("content with the CRC-32 {:08x} of the zip directory", self.crc);
            return Err(TorchError::malformed(&self.location, expected, format!("damaged content with {crc:08x}")));
        }
        self.is_verified.store(true, Ordering::Relaxed);
        Ok(())
    }
}

impl SharedBytes {
    /// All of `owner`'s bytes.
    pub fn new(owner: impl AsRef<[u8]> + Send + Sync + 'static) -> Self {
        let range = 0..owner.as_ref().len();
        Self { owner: Arc::new(owner), range, checksum: None, file: None }
    }

    /// These bytes, and all parts of them, as from a file, for messages.
    #[must_use]
    pub fn in_file(self, path: &Path) -> Self {
        Self { file: Some(path.into()), ..self }
    }

    /// The file that the bytes are from, if that is known.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// A part of these bytes with the same owner; `None` if `range` is not inside.
    #[must_use]
    pub fn slice(&self, range: Range<usize>) -> Option<Self> {
        let start = self.range.start.checked_add(range.start)?;
        let end = self.range.start.checked_add(range.end)?;
        (start <= end && end <= self.range.end).then(|| Self { range: start..end, ..self.clone() })
    }

    /// Compares the zip entry that the bytes are in with its CRC-32, if they are in one that has it: bytes of
    /// [`Tensor::to_unread_bytes`](crate::Tensor::to_unread_bytes) must be verified before they are used. The first call reads
    /// the entry, later ones for the same entry do not.
    ///
    /// # Errors
    /// [`TorchError::Malformed`] for an entry that was damaged after it was written.
    pub fn verify(&self) -> Result<(), TorchError> {
        self.checksum.as_ref().map_or(Ok(()), |checksum| checksum.verify())
    }

    /// These bytes as a part of the entry with this checksum.
    pub(crate) fn with_checksum(self, checksum: Arc<Checksum>) -> Self {
        Self { checksum: Some(checksum), ..self }
    }
}

impl Deref for SharedBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        let bytes = (*self.owner).as_ref().get(self.range.clone());
        bytes.unwrap_or_else(|| unreachable!("a range is inside its owner"))
    }
}

impl fmt::Debug for SharedBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SharedBytes({} bytes)", self.range.len())
    }
}

/// The range of `count` bytes from `start`; `None` on overflow.
pub(crate) fn span(start: usize, count: u64) -> Option<Range<usize>> {
    let end = start.checked_add(usize::try_from(count).ok()?)?;
    Some(start..end)
}

/// The `N` bytes at `at`; `None` past the end.
pub(crate) fn array_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

/// A little-endian u16 at `at`.
pub(crate) fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    array_at(bytes, at).map(u16::from_le_bytes)
}

/// A little-endian u32 at `at`.
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    array_at(bytes, at).map(u32::from_le_bytes)
}

/// A little-endian u64 at `at`.
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    array_at(bytes, at).map(u64::from_le_bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_share_and_stay_inside() {
        let all = SharedBytes::new(vec![0u8, 1, 2, 3, 4]);
        let middle = all.slice(1..4).unwrap();
        assert_eq!(&*middle, &[1, 2, 3]);
        assert_eq!(&*middle.slice(1..3).unwrap(), &[2, 3]);
        assert!(middle.slice(0..4).is_none(), "outside the slice, but inside the owner");
        assert!(all.slice(usize::MAX..usize::MAX).is_none());
        assert_eq!(middle.file(), None);
        let of_file = all.in_file(Path::new("a.torch")).slice(1..4).unwrap();
        assert_eq!((&*of_file, of_file.file()), (&[1, 2, 3][..], Some(Path::new("a.torch"))));
    }

    #[test]
    fn parts_are_verified_with_the_entry_that_they_are_in() {
        // The CRC-32 of "123456789" is the check value of its catalogues.
        let entry = SharedBytes::new(*b"x123456789").slice(1..10).unwrap();
        let with = |crc| {
            let checksum = Checksum::new("entry".to_owned(), entry.clone(), crc);
            entry.clone().with_checksum(Arc::new(checksum)).slice(2..4).unwrap()
        };
        let part = with(0xcbf4_3926);
        assert_eq!((&*part, part.verify(), part.verify()), (&b"34"[..], Ok(()), Ok(())));
        let message = with(0xcbf4_3927).verify().unwrap_err().to_string();
        let expected = "content with the CRC-32 cbf43927 of the zip directory, found damaged content with cbf43926";
        assert_eq!(message, format!("entry: expected {expected}"));
        assert_eq!(entry.verify(), Ok(()), "bytes without a checksum");
    }
}
