use std::fmt;
use std::ops::{Deref, Range};
use std::sync::Arc;

/// A range of bytes that many owners share without a copy: part of a memory-mapped chunk, or of a buffer.
#[derive(Clone)]
pub struct SharedBytes {
    owner: Arc<dyn AsRef<[u8]> + Send + Sync>,
    range: Range<usize>,
}

impl SharedBytes {
    /// All of `owner`'s bytes.
    pub fn new(owner: impl AsRef<[u8]> + Send + Sync + 'static) -> Self {
        let range = 0..owner.as_ref().len();
        Self { owner: Arc::new(owner), range }
    }

    /// A part of these bytes, sharing their owner; `None` where `range` reaches outside.
    #[must_use]
    pub fn slice(&self, range: Range<usize>) -> Option<Self> {
        let start = self.range.start.checked_add(range.start)?;
        let end = self.range.start.checked_add(range.end)?;
        (start <= end && end <= self.range.end).then(|| Self { owner: Arc::clone(&self.owner), range: start..end })
    }
}

impl Deref for SharedBytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        let bytes = (*self.owner).as_ref().get(self.range.clone());
        bytes.unwrap_or_else(|| unreachable!("a range lies inside its owner"))
    }
}

impl fmt::Debug for SharedBytes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "SharedBytes({} bytes)", self.range.len())
    }
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
        assert!(middle.slice(0..4).is_none(), "past the slice though inside the owner");
        assert!(all.slice(usize::MAX..usize::MAX).is_none());
    }
}
