//! A batch of splats, and for each block of a cell the splats whose ellipse touches it.

use pulp::Simd;

use super::bins::{Entry, ROUNDING, STEEPEST, TERM_ROUNDING};
use super::project::Splat;

/// Side of a block in pixels; a block's state stays in registers while its splats are composited.
pub(super) const BLOCK: usize = 4;
/// Pixels in a block.
pub(super) const LANES: usize = BLOCK * BLOCK;
/// Side of the largest cell in pixels: its 64 blocks fit a 64-bit mask.
pub(super) const CELL: usize = 32;
/// Blocks in a cell.
pub(super) const BLOCKS: usize = 64;
/// Splats tested together.
const GROUP: usize = 16;
/// Splats in a batch; at most 255, so that indices fit a byte.
pub(super) const BATCH: usize = 240;

/// A square of blocks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub(super) left: usize,
    pub(super) top: usize,
    /// Blocks per row: 4 or 8.
    pub(super) across: usize,
}

/// A splat's data relative to one cell.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct Record {
    pub(super) whitener: [f32; 3],
    pub(super) shift: [f32; 2],
    /// From the splat's base to the cell's first pixel, in whole pixels.
    pub(super) from_base: [f32; 2],
    pub(super) opacity: f32,
    pub(super) rgb: [f32; 3],
    pub(super) depth: f32,
    pub(super) scalar: f32,
    /// Index in the list that the batch was filled from.
    pub(super) index: u32,
}

/// Splats, and for each block the indices of those that touch it.
#[derive(Debug)]
pub(super) struct Batch {
    /// Copies of the splats.
    copies: [Splat; BATCH],
    records: [Record; 256],
    used: u8,
    lists: [[u8; 256]; BLOCKS],
    lengths: [u8; BLOCKS],
}

impl Default for Batch {
    fn default() -> Self {
        Self {
            copies: [Splat::default(); BATCH],
            records: [Record::default(); 256],
            used: 0,
            lists: [[0; 256]; BLOCKS],
            lengths: [0; BLOCKS],
        }
    }
}

impl Batch {
    /// Takes at most [`BATCH`] splats, in order; `open` has a bit for each unfinished block. Entries are indices into
    /// `list`, or into all splats if there is no list.
    #[inline(always)]
    pub(super) fn fill<S: Simd>(
        &mut self,
        simd: S,
        cell: Cell,
        open: u64,
        entries: &[Entry],
        list: Option<&[u32]>,
        splats: &[Splat],
    ) {
        self.used = 0;
        self.lengths = [0; BLOCKS];
        // A tight loop of loads overlaps their memory latencies.
        for (copies, entry) in self.copies.iter_mut().zip(entries) {
            let splat = list.map_or(entry.splat, |list| list[entry.splat as usize]);
            *copies = splats[splat as usize];
        }
        let count = if entries.len() < BATCH { entries.len() } else { BATCH };
        for start in (0..count).step_by(GROUP) {
            let first = self.used;
            let mut group = Group::default();
            let count = if count - start < GROUP { count - start } else { GROUP };
            let copies = self.copies.iter().zip(entries).skip(start).take(count);
            for ((lane, index), (splat, entry)) in (first..).enumerate().zip(copies) {
                // Stored after the records in use until it is known which of them touch a block.
                let record = record(cell, entry.splat, splat);
                self.records[usize::from(index)] = record;
                group.set(lane, cell, splat, &record);
            }
            group.find_blocks::<S>(simd, cell.across);
            for (lane, index) in (first..).enumerate().take(count) {
                let mut blocks = group.blocks(lane) & open;
                if blocks == 0 {
                    continue;
                }
                self.records[usize::from(self.used)] = self.records[usize::from(index)];
                while blocks != 0 {
                    let block = blocks.trailing_zeros() as usize % BLOCKS;
                    let length = &mut self.lengths[block];
                    self.lists[block][usize::from(*length)] = self.used;
                    *length += 1;
                    blocks &= blocks - 1;
                }
                self.used += 1;
            }
        }
    }

    /// The record indices of the splats that touch a block, in order.
    #[inline(always)]
    pub(super) fn list(&self, block: usize) -> &[u8] {
        let block = block % BLOCKS;
        &self.lists[block][..usize::from(self.lengths[block])]
    }

    #[inline(always)]
    pub(super) const fn record(&self, number: u8) -> &Record {
        &self.records[number as usize]
    }

    pub(super) fn records(&self) -> &[Record] {
        &self.records[..usize::from(self.used)]
    }
}

#[inline(always)]
fn record(cell: Cell, index: u32, splat: &Splat) -> Record {
    #[expect(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "an image side fits 16 bits")]
    let from_base = |start: usize, base: i32| (start as i32 - base) as f32;
    Record {
        whitener: splat.whitener,
        shift: splat.shift,
        from_base: [from_base(cell.left, splat.base[0]), from_base(cell.top, splat.base[1])],
        opacity: splat.opacity,
        rgb: splat.rgb,
        depth: splat.depth,
        scalar: splat.scalar,
        index,
    }
}

/// The data that decides which blocks splats touch, one lane per splat.
#[derive(Default)]
struct Group {
    whitener: [[f32; GROUP]; 3],
    shift: [[f32; GROUP]; 2],
    from_base: [[f32; GROUP]; 2],
    cut: [f32; GROUP],
    /// Mask of the blocks in the splat's bounding rectangle.
    rectangle: [u64; GROUP],
    /// Mask of the blocks that the ellipse touches, in two words.
    ellipse: [[u32; GROUP]; 2],
}

impl Group {
    #[inline(always)]
    fn set(&mut self, lane: usize, cell: Cell, splat: &Splat, record: &Record) {
        let lane = lane % GROUP;
        for (row, value) in self.whitener.iter_mut().zip(record.whitener) {
            row[lane] = value;
        }
        for (row, value) in self.shift.iter_mut().zip(record.shift) {
            row[lane] = value;
        }
        for (row, value) in self.from_base.iter_mut().zip(record.from_base) {
            row[lane] = value;
        }
        self.cut[lane] = splat.cut;
        self.rectangle[lane] = rectangle(cell, splat.reach);
    }

    #[inline(always)]
    const fn blocks(&self, lane: usize) -> u64 {
        let lane = lane % GROUP;
        self.rectangle[lane] & (self.ellipse[0][lane] as u64 | (self.ellipse[1][lane] as u64) << 32)
    }

    /// Finds the blocks that the ellipses touch, row by row; conservatively, perhaps a few too many.
    #[inline(always)]
    fn find_blocks<S: Simd>(&mut self, simd: S, across: usize) {
        for vector in 0..GROUP / S::F32_LANES {
            let discs = Discs::<S>::new(simd, self, vector, across);
            let mut found = [simd.splat_u32s(0); 2];
            for row in 0..across {
                let first = row * across;
                #[expect(clippy::cast_possible_truncation, reason = "a remainder of 32")]
                let bit = (first % 32) as u32;
                let columns = simd.wrapping_dyn_shl_u32s(discs.columns(simd, row), simd.splat_u32s(bit));
                let word = &mut found[first / 32 % 2];
                *word = simd.or_u32s(*word, columns);
            }
            for (words, found) in self.ellipse.iter_mut().zip(found) {
                S::as_mut_simd_u32s(words).0[vector] = found;
            }
        }
    }
}

/// A vector of ellipses. In whitened coordinates each is a disc `u² + v² ≤ cut`, and a row of blocks is a strip of `v`.
///
/// Within a strip the disc extends furthest right where `√(cut − v²) − v·shear/down` is largest: at its unconstrained maximum,
/// or at the end of the strip nearest to it.
struct Discs<S: Simd> {
    cut: S::f32s,
    /// Least `cut − v²` of a strip that touches the disc: below 0, because of rounding.
    slack: S::f32s,
    /// Where an unconstrained disc extends furthest left; furthest right at the negative.
    middle: S::f32s,
    /// `v` is `down·y + shift`, with `y` in rows from the base; `from_base` is that of the cell's first row.
    down: S::f32s,
    shift: S::f32s,
    from_base: S::f32s,
    /// The pixel at `u` and `v`, from the cell's left edge, is `(centre + u − slope·v) · per_pixel`.
    centre: S::f32s,
    slope: S::f32s,
    per_pixel: S::f32s,
    /// Added to the ends of a strip in blocks before they are rounded to the first block and past the last.
    to_first: S::f32s,
    to_past: S::f32s,
    /// Number of blocks in a row.
    across: S::f32s,
}

impl<S: Simd> Discs<S> {
    #[inline(always)]
    fn new(simd: S, group: &Group, vector: usize, across: usize) -> Self {
        // In pixels.
        const MARGIN: f32 = 0.05;
        const LAST: f32 = (BLOCK - 1) as f32;
        let one = simd.splat_f32s(1.0);
        let row = |values: &[f32; GROUP]| S::as_simd_f32s(values).0[vector];
        let [along, shear, down] = [0, 1, 2].map(|n| row(&group.whitener[n]));
        let shift = [0, 1].map(|n| row(&group.shift[n]));
        let from_base = [0, 1].map(|n| row(&group.from_base[n]));
        let cut = row(&group.cut);
        let slope = simd.div_f32s(shear, down);
        let middle = {
            let (least, most) = (simd.splat_f32s(-STEEPEST), simd.splat_f32s(STEEPEST));
            let bounded = simd.min_f32s(simd.max_f32s(slope, least), most);
            let stretched = simd.mul_add_e_f32s(bounded, bounded, one);
            simd.mul_f32s(bounded, simd.sqrt_f32s(simd.div_f32s(cut, stretched)))
        };
        let per_pixel = simd.div_f32s(one, along);
        // Where u is 0 in row v: (centre − v·slope) / along.
        let along_to_cell = simd.mul_add_e_f32s(along, from_base[0], shift[0]);
        let centre = simd.sub_f32s(simd.mul_f32s(slope, shift[1]), along_to_cell);
        let rows = simd.splat_f32s((across * BLOCK) as f32);
        let terms = size_of_terms(simd, [along, shear, slope], shift, from_base, rows);
        let margin = simd.mul_add_e_f32s(
            simd.mul_f32s(terms, per_pixel),
            simd.splat_f32s(TERM_ROUNDING),
            simd.splat_f32s(MARGIN),
        );
        let margin = simd.mul_f32s(margin, simd.splat_f32s(1.0 / BLOCK as f32));
        Self {
            cut,
            slack: simd.mul_f32s(cut, simd.splat_f32s(-ROUNDING)),
            middle,
            down,
            shift: shift[1],
            from_base: from_base[1],
            centre,
            slope,
            per_pixel,
            to_first: simd.sub_f32s(simd.splat_f32s(0.5 - LAST / BLOCK as f32), margin),
            to_past: simd.add_f32s(simd.splat_f32s(0.5), margin),
            across: simd.splat_f32s(across as f32),
        }
    }

    /// Masks of the blocks that the ellipses touch in a row of blocks.
    #[inline(always)]
    fn columns(&self, simd: S, row: usize) -> S::u32s {
        let (top, bottom) = (self.v_at(simd, row * BLOCK), self.v_at(simd, row * BLOCK + BLOCK - 1));
        let within = |v| simd.min_f32s(simd.max_f32s(v, top), bottom);
        let (v_right, v_left) = (within(simd.neg_f32s(self.middle)), within(self.middle));
        let ((inside, right), (_, left)) = (self.half_width(simd, v_right), self.half_width(simd, v_left));
        let past = simd.add_f32s(self.block_at(simd, right, v_right), self.to_past);
        let past = clamped(simd, past, self.across);
        let first = simd.add_f32s(self.block_at(simd, simd.neg_f32s(left), v_left), self.to_first);
        let first = clamped(simd, first, past);
        let columns = simd.sub_u32s(bit_at(simd, past), bit_at(simd, first));
        let touched = simd.greater_than_or_equal_f32s(inside, self.slack);
        simd.select_u32s(touched, columns, simd.splat_u32s(0))
    }

    /// `v` of a row of pixels of the cell.
    #[inline(always)]
    fn v_at(&self, simd: S, row: usize) -> S::f32s {
        let y = simd.add_f32s(self.from_base, simd.splat_f32s(row as f32));
        simd.mul_add_e_f32s(self.down, y, self.shift)
    }

    /// `cut − v²`, which is negative outside the disc, and the root of it, half the disc's width in `u`.
    #[inline(always)]
    fn half_width(&self, simd: S, v: S::f32s) -> (S::f32s, S::f32s) {
        let inside = simd.sub_f32s(self.cut, simd.mul_f32s(v, v));
        (inside, simd.sqrt_f32s(simd.max_f32s(inside, simd.splat_f32s(0.0))))
    }

    /// Blocks from the cell's left edge.
    #[inline(always)]
    fn block_at(&self, simd: S, u: S::f32s, v: S::f32s) -> S::f32s {
        let along = simd.sub_f32s(simd.add_f32s(self.centre, u), simd.mul_f32s(self.slope, v));
        simd.mul_f32s(simd.mul_f32s(along, self.per_pixel), simd.splat_f32s(1.0 / BLOCK as f32))
    }
}

/// Sum of the magnitudes of the terms of `u` in a cell with these `rows`: rounding errors are a share of it.
#[inline(always)]
fn size_of_terms<S: Simd>(
    simd: S,
    [along, shear, slope]: [S::f32s; 3],
    [shift_u, shift_v]: [S::f32s; 2],
    [from_x, from_y]: [S::f32s; 2],
    rows: S::f32s,
) -> S::f32s {
    let size = |a, b| simd.abs_f32s(simd.mul_f32s(a, b));
    let terms = simd.add_f32s(size(slope, shift_v), simd.abs_f32s(shift_u));
    let terms = simd.add_f32s(terms, size(along, from_x));
    let rows = simd.add_f32s(simd.abs_f32s(from_y), rows);
    simd.mul_add_e_f32s(simd.abs_f32s(shear), rows, terms)
}

#[inline(always)]
fn clamped<S: Simd>(simd: S, value: S::f32s, most: S::f32s) -> S::f32s {
    simd.min_f32s(simd.max_f32s(value, simd.splat_f32s(0.0)), most)
}

/// The power of two of a number of blocks, rounded: its difference from a smaller one has the bits between them.
#[inline(always)]
fn bit_at<S: Simd>(simd: S, blocks: S::f32s) -> S::u32s {
    // Adding 2²³ moves a small integer into the low bits.
    let rounded = simd.transmute_u32s_f32s(simd.add_f32s(blocks, simd.splat_f32s(8_388_608.0)));
    simd.wrapping_dyn_shl_u32s(simd.splat_u32s(1), simd.and_u32s(rounded, simd.splat_u32s(31)))
}

/// Mask of the blocks of a cell that overlap a rectangle of pixels.
#[inline(always)]
fn rectangle(cell: Cell, [columns, rows]: [[u16; 2]; 2]) -> u64 {
    let along = |[from, past]: [u16; 2], start: usize| {
        let block = |pixel: usize| {
            let block = pixel / BLOCK;
            if block < cell.across { block } else { cell.across }
        };
        let from = block(usize::from(from).saturating_sub(start));
        let past = block(usize::from(past).saturating_sub(start) + BLOCK - 1);
        (from, past)
    };
    let ((left, right), (top, bottom)) = (along(columns, cell.left), along(rows, cell.top));
    let below = |row: usize| if row * cell.across < BLOCKS { (1u64 << (row * cell.across)) - 1 } else { u64::MAX };
    let every_row = if cell.across == 8 { 0x0101_0101_0101_0101 } else { 0x1111 };
    let within = (1u64 << right).wrapping_sub(1 << left);
    // If the rectangle misses the cell, one of the ranges is empty.
    if right > left && bottom > top { (within * every_row) & below(bottom) & !below(top) } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The end of a needle far longer than the image, at 45°, is in pixel (22, 22): only rounding decides whether the
    /// extreme of the ellipse is within it.
    #[test]
    fn the_block_at_the_end_of_a_steep_needle_is_listed() {
        let cell = Cell { left: 0, top: 0, across: 8 };
        for slope in 4000..5800u16 {
            let (along, cut) = (0.85f32, 8.0f32);
            let down = along / f32::from(slope);
            #[expect(clippy::cast_possible_truncation, reason = "a few ten thousand pixels")]
            let base = 22 - (cut.sqrt() / down).round() as i32;
            let whitener = [along, -along, down];
            let splat = Splat { whitener, base: [base, base], cut, reach: [[0, 32]; 2], ..Splat::default() };
            let mut group = Group::default();
            group.set(0, cell, &splat, &record(cell, 0, &splat));
            group.find_blocks(pulp::Scalar256b, cell.across);
            let blocks = group.blocks(0);
            let (of_the_end, past_the_end) = ((blocks >> 45) & 1, blocks >> 48);
            assert_eq!((of_the_end, past_the_end), (1, 0), "slope {slope}: {blocks:x}");
        }
    }
}
