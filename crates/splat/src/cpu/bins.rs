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
        // Sides are powers of two.
        let log2 = self.side.trailing_zeros();
        let past_of = |past: u16| if past == 0 { 0 } else { ((past - 1) >> log2) + 1 };
        splat.reach.map(|[from, past]| [from >> log2, past_of(past)])
    }

    /// Calls `with` for each tile that a splat may reach: those of the rectangle, without the corners that the
    /// ellipse leaves out where there are many.
    #[inline(always)]
    fn each(self, reach: Reach, splat: &Splat, mut with: impl FnMut(usize)) {
        const FEW: usize = 6;
        let [[left, right], [top, bottom]] = reach.map(|range| range.map(usize::from));
        let many = (right - left) * (bottom - top) > FEW;
        for row in top..bottom {
            let (left, right) = if many { self.columns(splat, row, (left, right)) } else { (left, right) };
            for column in left..right {
                with(row * self.columns + column);
            }
        }
    }

    /// Columns of the tiles in a row of them that a splat's ellipse touches, of those from `first` to `past`, or a
    /// few too many; see [`super::batch`] for the geometry.
    fn columns(self, splat: &Splat, row: usize, (first, past): (usize, usize)) -> (usize, usize) {
        // Pixels, far beyond what rounding moves.
        const SPARE: f32 = 0.5;
        let ([along, shear, down], [shift_u, shift_v]) = (splat.whitener, splat.shift);
        let side = self.side as f32;
        let start = row as f32 * side - splat.base[1] as f32;
        let (top, bottom) = (down * (start - SPARE) + shift_v, down * (start + side - 1.0 + SPARE) + shift_v);
        let slope = shear / down;
        let middle = slope * (splat.cut / (1.0 + slope * slope)).sqrt();
        let within = |v: f32| {
            if v < top {
                top
            } else if v > bottom {
                bottom
            } else {
                v
            }
        };
        let (v_right, v_left) = (within(-middle), within(middle));
        let inside = splat.cut - v_right * v_right;
        if inside < 0.0 {
            return (first, first);
        }
        let half = |v: f32| (splat.cut - v * v).abs().sqrt();
        let pixel = |u: f32, v: f32| (slope * (shift_v - v) - shift_u + u) / along + splat.base[0] as f32;
        let from = ((pixel(-half(v_left), v_left) - SPARE) / side).floor();
        let to = ((pixel(half(v_right), v_right) + SPARE) / side).floor() + 1.0;
        // What is NaN narrows nothing.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the columns")]
        let narrowed = |value: f32, otherwise: usize| {
            if value > first as f32 && value < past as f32 { value as usize } else { otherwise }
        };
        let empty = from >= past as f32 || to <= first as f32;
        if empty { (first, first) } else { (narrowed(from, first), narrowed(to, past)) }
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

/// Bytes that one run's lists take, however short.
pub(super) const fn start_bytes(tiling: Tiling) -> usize {
    size_of::<Bins>() + size_of::<u32>() * (tiling.len() + 2)
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
        let Self { reaches, starts, .. } = self;
        reaches.clear();
        reaches.extend(splats.iter().map(|splat| (depth_key(splat.depth), tiling.of(splat))));
        starts.clear();
        starts.resize(tiling.len() + 2, 0);
        let mut total = 0;
        // Two places ahead: filling moves each start to the end of its list, one place too early.
        for ((_, reach), splat) in reaches.iter().zip(splats) {
            tiling.each(*reach, splat, |tile| {
                starts.get_mut(tile + 2).into_iter().for_each(|count| *count += 1);
                total += 1;
            });
        }
        total
    }

    /// Fills the lists with the counted splats, of which the first is `first` among all.
    pub(super) fn fill(&mut self, first: usize, splats: &[Splat], tiling: Tiling) {
        let mut total = 0;
        for start in &mut self.starts {
            total += *start;
            *start = total;
        }
        self.entries.clear();
        self.entries.resize(total as usize, Entry::default());
        for (((key, reach), splat), number) in self.reaches.iter().zip(splats).zip(first..) {
            #[expect(clippy::cast_possible_truncation, reason = "renderers refuse more Gaussians than a u32 counts")]
            let number = number as u32;
            tiling.each(*reach, splat, |tile| {
                let Some(next) = self.starts.get_mut(tile + 1) else { return };
                if let Some(slot) = self.entries.get_mut(*next as usize) {
                    *slot = Entry { key: *key, splat: number };
                }
                *next += 1;
            });
        }
    }

    /// Bytes of all buffers, used or not.
    pub(super) fn held(&self) -> usize {
        self.reaches.capacity() * size_of::<(u32, Reach)>()
            + self.starts.capacity() * size_of::<u32>()
            + self.entries.capacity() * size_of::<Entry>()
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
