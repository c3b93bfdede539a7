//! Memory estimates, made before anything is allocated.

use super::bins::{self, Entry, RUN};
use super::frame::Frame;
use super::images::Layout;
use super::pixel_sums::SUMS;
use crate::{Gaussians, RenderOptions, SplatError, View};

/// Remainder of a memory limit.
#[derive(Clone, Copy, Debug)]
pub(super) struct MemoryBudget {
    pub(super) left: u64,
    pub(super) limit: u64,
}

impl MemoryBudget {
    pub(super) const fn new(limit: u64) -> Self {
        Self { left: limit, limit }
    }

    /// Reserves bytes that are, or are about to be, in use.
    ///
    /// # Errors
    /// [`SplatError::Memory`] if fewer bytes are left.
    pub(super) fn reserve(&mut self, bytes: u64) -> Result<(), SplatError> {
        let Self { left, limit } = *self;
        let needed = (limit - left).saturating_add(bytes);
        self.left = left.checked_sub(bytes).ok_or(SplatError::Memory { needed, limit })?;
        Ok(())
    }
}

/// Bytes of a view's [`Frame`], excluding tile lists, whose length is known later.
pub(super) fn frame(gaussians: &Gaussians, view: &View, options: &RenderOptions, tile: u32) -> u64 {
    let layout = Layout::of(view, options, tile);
    let pixels = times(4 * layout.per_tile(), layout.tiling.len());
    let starts = times(bins::start_bytes(layout.tiling), gaussians.len().div_ceil(RUN));
    times(super::frame::BYTES_EACH, gaussians.len()).saturating_add(pixels).saturating_add(starts)
}

/// Bytes of all threads' sort buffers, given the length of the longest tile list.
pub(super) fn sorters(longest_list: usize) -> u64 {
    // Entries twice, and the list that they index.
    times((2 * size_of::<Entry>() + size_of::<u32>()) * longest_list, rayon::current_num_threads())
}

/// Bytes of the backward pass in addition to the recording: gradients of every Gaussian and splat, sums over tiles and
/// their offsets, and `images` bytes of scaled image gradients.
pub(super) fn backward(gaussians: &Gaussians, frame: &Frame, entries: usize, images: u64) -> u64 {
    const TOTALS: usize = RUN * size_of::<[f64; SUMS]>();
    let tiles = frame.tiling().len();
    // Each Gaussian has five screen-space gradients in addition to its own, and a contribution to the pose gradient.
    let of_gaussians = gaussians.size_in_bytes().saturating_add(times(20 + size_of::<[f64; 6]>(), gaussians.len()));
    let sums = times(size_of::<[f32; SUMS]>(), entries);
    let places = times(size_of::<usize>() * tiles, frame.bins.len() + 2);
    let totals = times(TOTALS, rayon::current_num_threads());
    [of_gaussians, sums, places, images, totals].into_iter().fold(sorters(frame.longest_list()), u64::saturating_add)
}

fn times(bytes: usize, count: usize) -> u64 {
    (bytes as u64).saturating_mul(count as u64)
}
