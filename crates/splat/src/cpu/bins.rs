//! Which splats reach which tiles: each run of Gaussians keeps its own lists, so that nothing is shared between
//! threads, and a tile reads the runs one after the other.

use atsplat_camera::ImageSize;

use super::splat::Splat;

/// Gaussians that one task projects, and that are listed together.
pub(super) const RUN: usize = 4096;

/// First and one past the last tile column, then row.
pub(super) type Reach = [[u16; 2]; 2];

/// The tiles of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Tiling {
    /// Of a tile, in pixels.
    pub(super) side: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Tiling {
    pub(super) fn new(size: ImageSize, side: u32) -> Self {
        let along = |pixels: u32| pixels.div_ceil(side) as usize;
        Self { side: side as usize, columns: along(size.width), rows: along(size.height) }
    }

    pub(super) const fn len(self) -> usize {
        self.columns * self.rows
    }

    fn of(self, splat: &Splat) -> Reach {
        let side = u16::try_from(self.side).unwrap_or(u16::MAX);
        splat.reach.map(|[from, past]| [from / side, past.div_ceil(side)])
    }

    /// Calls `with` for each tile of a rectangle.
    #[inline(always)]
    fn each(self, [[left, right], [top, bottom]]: Reach, mut with: impl FnMut(usize)) {
        for row in usize::from(top)..usize::from(bottom) {
            for column in usize::from(left)..usize::from(right) {
                with(row * self.columns + column);
            }
        }
    }
}

/// A splat in a tile's list.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Entry {
    /// [`depth_key`].
    pub(super) key: u32,
    /// Among all splats.
    pub(super) splat: u32,
}

/// The lists of one run of Gaussians.
#[derive(Debug, Default)]
pub(super) struct Bins {
    reaches: Vec<(u32, Reach)>,
    /// Where each tile's list ends, after the first entry: that it begins with nothing.
    starts: Vec<u32>,
    entries: Vec<Entry>,
}

impl Bins {
    /// Counts what the lists will hold; returns the total.
    pub(super) fn count(&mut self, splats: &[Splat], tiling: Tiling) -> u64 {
        self.reaches.clear();
        self.reaches.extend(splats.iter().map(|splat| (depth_key(splat.depth), tiling.of(splat))));
        let area = |[from, past]: [u16; 2]| u64::from(past.saturating_sub(from));
        self.reaches.iter().map(|(_, [columns, rows])| area(*columns) * area(*rows)).sum()
    }

    /// Fills the lists with the counted splats, of which the first is `first` among all.
    pub(super) fn fill(&mut self, first: usize, tiling: Tiling) {
        self.starts.clear();
        self.starts.resize(tiling.len() + 2, 0);
        // Two places ahead: filling moves each start to the end of its list, one place too early.
        for (_, reach) in &self.reaches {
            tiling.each(*reach, |tile| self.starts.get_mut(tile + 2).into_iter().for_each(|count| *count += 1));
        }
        let mut total = 0;
        for start in &mut self.starts {
            total += *start;
            *start = total;
        }
        self.entries.clear();
        self.entries.resize(total as usize, Entry::default());
        for ((key, reach), splat) in self.reaches.iter().zip(u32::try_from(first).unwrap_or(u32::MAX)..) {
            tiling.each(*reach, |tile| {
                let Some(next) = self.starts.get_mut(tile + 1) else { return };
                if let Some(slot) = self.entries.get_mut(*next as usize) {
                    *slot = Entry { key: *key, splat };
                }
                *next += 1;
            });
        }
    }

    /// A tile's splats, in the order of the Gaussians.
    pub(super) fn list(&self, tile: usize) -> &[Entry] {
        match self.starts.get(tile..tile + 2) {
            Some(&[from, to]) => self.entries.get(from as usize..to as usize).unwrap_or_default(),
            _ => &[],
        }
    }
}

/// A number whose order is that of the depths, negative ones and both zeros included.
pub(super) const fn depth_key(depth: f32) -> u32 {
    let bits = (depth + 0.0).to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}
