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
pub(super) struct Buffer {
    /// As many as were ever asked for: tiles that are added again would have to be cleared again.
    tiles: Vec<Tile>,
    count: usize,
}

impl Buffer {
    /// `count` tiles of any content.
    pub(super) fn take(count: usize) -> Self {
        let kept = KEPT.with_borrow_mut(|kept| {
            let sizes = kept.iter().map(Vec::len).enumerate();
            let smallest = sizes.clone().filter(|(_, size)| *size >= count).min_by_key(|(_, size)| *size);
            let largest = sizes.max_by_key(|(_, size)| *size);
            smallest.or(largest).map(|(at, _)| kept.swap_remove(at))
        });
        // One that is too small is not extended, which would copy it.
        let tiles = kept.filter(|tiles| tiles.len() >= count).unwrap_or_else(|| vec![Tile::ZERO; count]);
        Self { tiles, count }
    }
}

impl Deref for Buffer {
    type Target = [Tile];

    fn deref(&self) -> &[Tile] {
        &self.tiles[..self.count]
    }
}

impl DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [Tile] {
        &mut self.tiles[..self.count]
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let tiles = std::mem::take(&mut self.tiles);
        // At the end of a thread there is nothing left to keep them in.
        let _ended = KEPT.try_with(|kept| {
            let mut kept = kept.borrow_mut();
            if kept.len() < MAX_KEPT {
                kept.push(tiles);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_buffer_that_is_large_enough_is_used_again() {
        let place = |buffer: &Buffer| buffer.as_ptr();
        let [small, large] = [2, 9].map(Buffer::take);
        let places = [place(&small), place(&large)];
        drop((large, small));
        let again = [3, 1].map(Buffer::take);
        assert_eq!(again.each_ref().map(place), [places[1], places[0]]);
        assert_eq!(again.each_ref().map(|buffer| buffer.len()), [3, 1]);
        drop(again);
        assert_eq!(place(&Buffer::take(9)), places[1], "a shorter use has not shrunk it");
        // Too long for both: the smaller one is still there.
        assert_eq!(Buffer::take(10).len(), 10);
        assert_eq!(place(&Buffer::take(2)), places[0]);
    }
}
