//! Tile lists: which splats reach which tiles. Each run of Gaussians has its own lists, so that threads share nothing;
//! a tile reads the runs in order.

use atsplat_camera::ImageSize;

use super::project::Splat;

/// Gaussians per run: projected by one task, and listed together.
pub(super) const RUN: usize = 4096;

/// Slopes in whitened coordinates are clamped to this before they are squared, because the square of a long needle's slope
/// overflows. From far smaller slopes on, the disc's extreme is at `±√cut` in f32.
pub(super) const STEEPEST: f32 = 1e15;

/// Share of `cut` by which a steep slope's extreme may exceed it: far above the rounding errors of its square.
pub(super) const ROUNDING: f32 = 1e-5;

/// Share of the terms of a whitened coordinate by which rounding may change it: several times the errors of all operations. The
/// terms are large for needles whose centres are far outside the image.
pub(super) const TERM_ROUNDING: f32 = 8.0 * f32::EPSILON;

/// Half-open range of tile columns, then of tile rows.
pub(super) type Reach = [[u16; 2]; 2];

/// The tiles of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Tiling {
    /// Side of a tile in pixels.
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

    /// The tiles that a splat's rectangle of pixels overlaps.
    fn reach_of(self, splat: &Splat) -> Reach {
        // Tile sides are powers of two.
        let log2 = self.side.trailing_zeros();
        let past_of = |past: u16| if past == 0 { 0 } else { ((past - 1) >> log2) + 1 };
        splat.reach.map(|[from, past]| [from >> log2, past_of(past)])
    }

    /// Calls `with` for each tile that a splat may reach: the tiles of its rectangle, without the corners that
    /// the ellipse misses if there are many.
    #[inline(always)]
    fn for_each_tile(self, reach: Reach, splat: &Splat, mut with: impl FnMut(usize)) {
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

    /// Range of tile columns within `first..past` that a splat's ellipse touches in a tile row; conservatively, perhaps
    /// a few too many. See [`super::batch`] for the geometry.
    fn columns(self, splat: &Splat, row: usize, (first, past): (usize, usize)) -> (usize, usize) {
        // In pixels, far above rounding errors if the centre is near.
        const MARGIN: f32 = 0.5;
        let ([along, shear, down], [shift_u, shift_v]) = (splat.whitener, splat.shift);
        let side = self.side as f32;
        let start = row as f32 * side - splat.base[1] as f32;
        let (top, bottom) = (down * (start - MARGIN) + shift_v, down * (start + side - 1.0 + MARGIN) + shift_v);
        let slope = shear / down;
        let bounded = slope.clamp(-STEEPEST, STEEPEST);
        let middle = bounded * (splat.cut / (1.0 + bounded * bounded)).sqrt();
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
        if v_right * v_right > splat.cut * (1.0 + ROUNDING) {
            return (first, first);
        }
        let half = |v: f32| (splat.cut - v * v).abs().sqrt();
        let pixel = |u: f32, v: f32| (slope * (shift_v - v) - shift_u + u) / along + splat.base[0] as f32;
        let terms = |v: f32| slope.abs() * (shift_v.abs() + v.abs()) + shift_u.abs();
        let margin = |v: f32| MARGIN + TERM_ROUNDING * terms(v) / along;
        let from = ((pixel(-half(v_left), v_left) - margin(v_left)) / side).floor();
        let to = ((pixel(half(v_right), v_right) + margin(v_right)) / side).floor() + 1.0;
        // A NaN leaves the range as it is.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the columns")]
        let narrow = |value: f32, otherwise: usize| {
            if value > first as f32 && value < past as f32 { value as usize } else { otherwise }
        };
        let empty = from >= past as f32 || to <= first as f32;
        if empty { (first, first) } else { (narrow(from, first), narrow(to, past)) }
    }
}

/// A splat in a tile's list.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Entry {
    /// [`depth_key`].
    pub(super) key: u32,
    /// Index among all splats.
    pub(super) splat: u32,
}

/// Bytes of one run's lists without their entries.
pub(super) const fn start_bytes(tiling: Tiling) -> usize {
    size_of::<Bins>() + size_of::<u32>() * (tiling.len() + 2)
}

/// The lists of one run of Gaussians.
#[derive(Debug, Default)]
pub(super) struct Bins {
    reaches: Vec<(u32, Reach)>,
    /// Offsets of the tiles' lists in `entries`: list `i` is `starts[i]..starts[i + 1]`.
    starts: Vec<u32>,
    entries: Vec<Entry>,
}

impl Bins {
    /// Counts the entries of each list; returns the total.
    pub(super) fn count(&mut self, splats: &[Splat], tiling: Tiling) -> u64 {
        let Self { reaches, starts, .. } = self;
        reaches.clear();
        reaches.extend(splats.iter().map(|splat| (depth_key(splat.depth), tiling.reach_of(splat))));
        starts.clear();
        starts.resize(tiling.len() + 2, 0);
        let mut total = 0;
        // Counted two slots ahead, because filling advances each start to the end of its list.
        for ((_, reach), splat) in reaches.iter().zip(splats) {
            tiling.for_each_tile(*reach, splat, |tile| {
                starts[tile + 2] += 1;
                total += 1;
            });
        }
        total
    }

    /// Fills the lists with the counted splats; `first` is the index of the first among all.
    pub(super) fn fill(&mut self, first: usize, splats: &[Splat], tiling: Tiling) {
        let mut total = 0;
        for start in &mut self.starts {
            total += *start;
            *start = total;
        }
        self.entries.clear();
        self.entries.resize(total as usize, Entry::default());
        for (((key, reach), splat), number) in self.reaches.iter().zip(splats).zip(first..) {
            #[expect(clippy::cast_possible_truncation, reason = "renderers reject more Gaussians than a u32 counts")]
            let number = number as u32;
            tiling.for_each_tile(*reach, splat, |tile| {
                let next = &mut self.starts[tile + 1];
                self.entries[*next as usize] = Entry { key: *key, splat: number };
                *next += 1;
            });
        }
    }

    /// Allocated bytes of all buffers.
    pub(super) fn allocated_bytes(&self) -> usize {
        self.reaches.capacity() * size_of::<(u32, Reach)>()
            + self.starts.capacity() * size_of::<u32>()
            + self.entries.capacity() * size_of::<Entry>()
    }

    /// A tile's splats, in order of the Gaussians.
    pub(super) fn list(&self, tile: usize) -> &[Entry] {
        &self.entries[self.starts[tile] as usize..self.starts[tile + 1] as usize]
    }
}

/// An integer that orders like the depth, including negative depths, and equal for both zeros.
pub(super) const fn depth_key(depth: f32) -> u32 {
    let bits = (depth + 0.0).to_bits();
    if bits >> 31 == 0 { bits | 1 << 31 } else { !bits }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The end of a needle far longer than the image, at 45°: on the centre line only rounding decides whether the
    /// extreme of the ellipse is within it.
    #[test]
    fn the_end_of_a_steep_needle_is_listed() {
        let tiling = Tiling { side: 32, columns: 2, rows: 2 };
        for slope in 4000..5800u16 {
            let (along, cut) = (0.85f32, 8.0f32);
            let down = along / f32::from(slope);
            // Pixel (20, 20) is the last on the centre line with `u² + v² ≤ cut`.
            #[expect(clippy::cast_possible_truncation, reason = "a few ten thousand pixels")]
            let base = 20 - (cut.sqrt() / down).round() as i32;
            let splat = Splat {
                whitener: [along, -along, down],
                base: [base, base],
                cut: cut * 1.001 + 0.001,
                reach: [[0, 64]; 2],
                ..Splat::default()
            };
            let (from, past) = tiling.columns(&splat, 0, (0, 2));
            assert!(from == 0 && past > 0, "slope {slope}: {from}..{past}");
            assert_eq!(tiling.columns(&splat, 1, (0, 2)), (0, 0), "slope {slope}: past the end");
        }
    }

    #[test]
    fn lists_without_entries_take_the_bytes_that_are_reserved_for_them() {
        let tiling = Tiling { side: 16, columns: 5, rows: 3 };
        let mut bins = Bins::default();
        assert_eq!(bins.count(&[], tiling), 0);
        bins.fill(0, &[], tiling);
        assert_eq!(start_bytes(tiling), size_of::<Bins>() + bins.allocated_bytes());
    }
}
