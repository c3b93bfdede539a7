use std::cell::RefCell;
use std::ops::{Deref, DerefMut};

use super::pack::Tile;

/// Buffers that a thread keeps.
const MAX_KEPT: usize = 64;

thread_local! {
    static KEPT: RefCell<Vec<Vec<Tile>>> = const { RefCell::new(Vec::new()) };
}

/// Tiles whose memory is kept for the next buffer of the thread that drops them: a fresh one would be cleared by the system.
#[derive(Debug)]
pub(super) struct Buffer(Vec<Tile>);

impl Buffer {
    /// `count` tiles of any content.
    pub(super) fn take(count: usize) -> Self {
        let mut tiles = KEPT.with_borrow_mut(Vec::pop).unwrap_or_default();
        tiles.resize(count, Tile::ZERO);
        Self(tiles)
    }
}

impl Deref for Buffer {
    type Target = [Tile];

    fn deref(&self) -> &[Tile] {
        &self.0
    }
}

impl DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [Tile] {
        &mut self.0
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let tiles = std::mem::take(&mut self.0);
        // At the end of a thread there is nothing left to keep them in.
        let _ended = KEPT.try_with(|kept| {
            let mut kept = kept.borrow_mut();
            if kept.len() < MAX_KEPT {
                kept.push(tiles);
            }
        });
    }
}
