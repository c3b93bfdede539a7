//! What a job takes, estimated before it is allocated.

use super::bins::{self, Entry, RUN, Tiling};
use super::differentiate::SUMS;
use super::frame::Frame;
use super::images::Layout;
use super::{TileSize, kept_extra};
use crate::{Gaussians, RenderOptions, SplatError, View};

/// What may still be allocated of a limit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Room {
    pub(super) left: u64,
    pub(super) limit: u64,
}

impl Room {
    pub(super) const fn new(limit: u64) -> Self {
        Self { left: limit, limit }
    }

    /// Takes bytes that are, or are about to be, in use.
    ///
    /// # Errors
    /// [`SplatError::Memory`] where they are not left.
    pub(super) fn take(&mut self, bytes: u64) -> Result<(), SplatError> {
        let Self { left, limit } = *self;
        let needed = (limit - left).saturating_add(bytes);
        self.left = left.checked_sub(bytes).ok_or(SplatError::Memory { needed, limit })?;
        Ok(())
    }
}

/// Bytes of a view's [`Frame`], but for tile lists, whose length is known later.
pub(super) fn frame(gaussians: &Gaussians, view: &View, options: &RenderOptions, tile: TileSize) -> u64 {
    let layout = Layout::new(Tiling::new(view.size, tile.pixels()), kept_extra(options));
    let pixels = times(4 * layout.per_tile(), layout.tiling.len());
    let starts = times(bins::start_bytes(layout.tiling), gaussians.len().div_ceil(RUN));
    times(super::frame::BYTES_EACH, gaussians.len()).saturating_add(pixels).saturating_add(starts)
}

/// Bytes that all threads together sort tiles with, of which the longest has so many splats.
pub(super) fn sorters(longest: usize) -> u64 {
    // Entries twice, and the list that their places are in.
    times((2 * size_of::<Entry>() + size_of::<u32>()) * longest, rayon::current_num_threads())
}

/// Bytes of the derivative, beside what was recorded: those of every Gaussian and splat, sums over tiles, and where
/// they are found; `images` bytes of scaled derivatives by images.
pub(super) fn backward(gaussians: &Gaussians, frame: &Frame, entries: usize, images: u64) -> u64 {
    const TOTALS: usize = RUN * size_of::<[f64; SUMS]>();
    let tiles = frame.tiling().len();
    // On the screen there are five numbers for each Gaussian beside its own; shares of the pose come on top.
    let own = gaussians.size_in_bytes().saturating_add(times(20 + size_of::<[f64; 6]>(), gaussians.len()));
    let sums = times(size_of::<[f32; SUMS]>(), entries);
    let places = times(size_of::<usize>() * tiles, frame.bins.len() + 2);
    let totals = times(TOTALS, rayon::current_num_threads());
    [own, sums, places, images, totals].into_iter().fold(sorters(frame.longest()), u64::saturating_add)
}

fn times(bytes: usize, count: usize) -> u64 {
    (bytes as u64).saturating_mul(count as u64)
}
