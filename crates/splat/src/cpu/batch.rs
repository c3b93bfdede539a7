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
    ///
    /// In whitened coordinates the ellipse is a disc `u² + v² ≤ cut` and a row is a strip of `v`. Within a strip the
    /// disc extends furthest right where `√(cut − v²) − v·shear/down` is largest: at its unconstrained maximum, or at
    /// the end of the strip nearest to it.
    #[inline(always)]
    fn find_blocks<S: Simd>(&mut self, simd: S, across: usize) {
        const MARGIN: f32 = 0.05;
        const BITS: [u32; 32] = bits();
        const LAST: f32 = (BLOCK - 1) as f32;
        let splat = |value: f32| simd.splat_f32s(value);
        let (zero, one, most) = (splat(0.0), splat(1.0), splat(across as f32));
        let (quarter, rows) = (splat(0.25), splat((across * BLOCK) as f32));
        // Adding 2²³ moves a small integer into the low bits.
        let (rounder, bits) = (splat(8_388_608.0), simd.splat_u32s(31));
        let row = |values: &[f32; GROUP], at: usize| S::as_simd_f32s(values).0[at];
        for at in 0..GROUP / S::F32_LANES {
            let [along, shear, down] = [0, 1, 2].map(|n| row(&self.whitener[n], at));
            let [shift_u, shift_v] = [0, 1].map(|n| row(&self.shift[n], at));
            let [from_x, from_y] = [0, 1].map(|n| row(&self.from_base[n], at));
            let cut = row(&self.cut, at);
            let slack = simd.mul_f32s(cut, splat(-ROUNDING));
            let slope = simd.div_f32s(shear, down);
            let middle = {
                let bounded = simd.min_f32s(simd.max_f32s(slope, splat(-STEEPEST)), splat(STEEPEST));
                let stretched = simd.mul_add_e_f32s(bounded, bounded, one);
                simd.mul_f32s(bounded, simd.sqrt_f32s(simd.div_f32s(cut, stretched)))
            };
            let per_pixel = simd.div_f32s(one, along);
            // Pixels from the cell's left edge, where u is 0 in row v: (centre − v·slope) / along.
            let centre = simd.sub_f32s(simd.mul_f32s(slope, shift_v), simd.mul_add_e_f32s(along, from_x, shift_u));
            let margin = {
                let size = |a, b| simd.abs_f32s(simd.mul_f32s(a, b));
                let terms = simd.add_f32s(size(slope, shift_v), simd.abs_f32s(shift_u));
                let terms = simd.add_f32s(terms, size(along, from_x));
                let rows = simd.add_f32s(simd.abs_f32s(from_y), rows);
                let terms = simd.mul_add_e_f32s(simd.abs_f32s(shear), rows, terms);
                simd.mul_add_e_f32s(simd.mul_f32s(terms, per_pixel), splat(TERM_ROUNDING), splat(MARGIN))
            };
            let margin = simd.mul_f32s(margin, quarter);
            let (low, high) = (simd.sub_f32s(splat(0.5 - LAST / 4.0), margin), simd.add_f32s(splat(0.5), margin));
            let mut found = [simd.splat_u32s(0); 2];
            for block_row in 0..across {
                let edge = |pixel: usize| {
                    let y = simd.add_f32s(from_y, splat(pixel as f32));
                    simd.mul_add_e_f32s(down, y, shift_v)
                };
                let (top, bottom) = (edge(block_row * BLOCK), edge(block_row * BLOCK + BLOCK - 1));
                let within = |v| simd.min_f32s(simd.max_f32s(v, top), bottom);
                let (v_right, v_left) = (within(simd.neg_f32s(middle)), within(middle));
                let half = |v| {
                    let left = simd.sub_f32s(cut, simd.mul_f32s(v, v));
                    (left, simd.sqrt_f32s(simd.max_f32s(left, zero)))
                };
                let ((inside, right), (_, left)) = (half(v_right), half(v_left));
                let pixel = |u, v| {
                    let x = simd.mul_f32s(simd.sub_f32s(simd.add_f32s(centre, u), simd.mul_f32s(slope, v)), per_pixel);
                    simd.mul_f32s(x, quarter)
                };
                let clamp = |x, most| simd.min_f32s(simd.max_f32s(x, zero), most);
                let past = clamp(simd.add_f32s(pixel(right, v_right), high), most);
                let from = clamp(simd.add_f32s(pixel(simd.neg_f32s(left), v_left), low), past);
                let ones = |x| {
                    let count = simd.and_u32s(simd.transmute_u32s_f32s(simd.add_f32s(x, rounder)), bits);
                    simd.wrapping_dyn_shl_u32s(simd.splat_u32s(1), count)
                };
                let columns = simd.sub_u32s(ones(past), ones(from));
                let touched = simd.greater_than_or_equal_f32s(inside, slack);
                let columns = simd.select_u32s(touched, columns, simd.splat_u32s(0));
                let index = block_row * across;
                let shifted = simd.wrapping_dyn_shl_u32s(columns, simd.splat_u32s(BITS[index % 32]));
                let word = &mut found[index / 32 % 2];
                *word = simd.or_u32s(*word, shifted);
            }
            for (words, found) in self.ellipse.iter_mut().zip(found) {
                S::as_mut_simd_u32s(words).0[at] = found;
            }
        }
    }
}

/// The integers from 0 to 31.
const fn bits() -> [u32; 32] {
    let mut bits = [0; 32];
    let mut at = 1;
    while at < 32 {
        bits[at] = bits[at - 1] + 1;
        at += 1;
    }
    bits
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
