use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::attention_f32;
use super::matrix::{Factor, Matrix, Output, Write, multiply_factors};
use super::simd::{self, Exp};
use super::softmax::weigh;
use crate::MatmulPrecision;

/// Queries of a tile, which are the lanes of vectors.
pub(super) const QUERIES: usize = 64;
/// Largest number of keys of a tile that the products of [`super::matrix`] work on.
pub(super) const MATRIX_KEYS: usize = 256;
/// The number of queries in a tile is rounded up to this.
const LANES: usize = 16;

/// Sizes of an attention.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sizes {
    pub(crate) batch: usize,
    pub(crate) queries: usize,
    pub(crate) keys: usize,
    pub(crate) heads: usize,
    pub(crate) head_width: usize,
}

impl Sizes {
    /// Elements of a token, all heads together.
    pub(crate) const fn width(&self) -> usize {
        self.heads * self.head_width
    }

    /// Factor of the dot products.
    pub(crate) fn scale(&self) -> f64 {
        1.0 / (self.head_width as f64).sqrt()
    }

    /// [`Self::scale`] in the kernels' precision.
    #[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is meant")]
    pub(super) fn narrow_scale(&self) -> f32 {
        self.scale() as f32
    }

    /// Keys in a tile, at most `largest`: a function of the number of keys alone, so that the order of sums does not depend on the
    /// queries.
    pub(super) fn key_tile(&self, largest: usize) -> usize {
        self.keys.div_ceil(self.keys.div_ceil(largest).max(1)).max(1)
    }
}

/// Queries, keys or values inside a packed tensor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tokens<'a> {
    pub(crate) data: &'a [f32],
    /// Number of tokens of a sample.
    pub(crate) count: usize,
    /// Elements from one token to the next.
    pub(crate) stride: usize,
    /// Elements of a token before the first head's.
    pub(crate) offset: usize,
}

impl<'a> Tokens<'a> {
    /// One head's part of some tokens of a sample.
    pub(super) fn tile(&self, sample: usize, head: usize, first: usize, count: usize, sizes: &Sizes) -> Matrix<'a> {
        Matrix::new(self.from(sample, head, first, sizes), count, sizes.head_width, self.stride)
    }

    pub(super) fn from(&self, sample: usize, head: usize, first: usize, sizes: &Sizes) -> &'a [f32] {
        let start = (sample * self.count + first) * self.stride + self.offset + head * sizes.head_width;
        &self.data[start..]
    }

    /// One head's part of some tokens of a sample, tokens in rows, without gaps: in the packed tensor, each row would be on a memory
    /// page of its own, and products read them again and again.
    pub(super) fn rows(&self, sample: usize, head: usize, first: usize, count: usize, sizes: &Sizes) -> Vec<f32> {
        let source = self.from(sample, head, first, sizes);
        let mut out = Vec::with_capacity(count * sizes.head_width);
        for token in 0..count {
            out.extend_from_slice(&source[token * self.stride..][..sizes.head_width]);
        }
        out
    }

    /// [`Self::rows`] with tokens in columns.
    pub(super) fn columns(&self, sample: usize, head: usize, first: usize, count: usize, sizes: &Sizes) -> Vec<f32> {
        let mut out = vec![0.0; count * sizes.head_width];
        self.transpose(&mut out, (sample, head, first), (count, count), 1.0, sizes);
        out
    }

    /// Writes a tile with tokens in columns, times `scale`; columns without a token are zero.
    pub(super) fn transpose_into(&self, out: &mut [f32], at: Tile, scale: f32, sizes: &Sizes) {
        out.fill(0.0);
        self.transpose(out, (at.sample, at.head, at.first), (at.count, at.lanes()), scale, sizes);
    }

    /// Writes `count` tokens into the first of `columns` columns, times `scale`.
    pub(super) fn transpose(
        &self,
        out: &mut [f32],
        (sample, head, first): (usize, usize, usize),
        (count, columns): (usize, usize),
        scale: f32,
        sizes: &Sizes,
    ) {
        let source = self.from(sample, head, first, sizes);
        for token in 0..count {
            let row = &source[token * self.stride..][..sizes.head_width];
            for (column, &value) in out.chunks_exact_mut(columns).zip(row) {
                column[token] = value * scale;
            }
        }
    }
}

/// Queries of one head of a sample.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub(super) sample: usize,
    pub(super) head: usize,
    pub(super) first: usize,
    pub(super) count: usize,
}

impl Tile {
    pub(super) const fn lanes(&self) -> usize {
        self.count.next_multiple_of(LANES)
    }
}

/// Where the results of a tile of queries go, the heads of a query side by side.
pub(super) struct Results<'a> {
    pub(super) out: &'a mut [f32],
    pub(super) log_sums: &'a mut [f32],
}

impl Results<'_> {
    /// Writes the result of one query and head: weighted sums of values relative to the largest logit, and the total of weights.
    pub(super) fn write(
        &mut self,
        (query, head): (usize, usize),
        sums: impl Iterator<Item = f32>,
        (largest, total): (f32, f32),
        sizes: &Sizes,
    ) {
        let nothing = total == 0.0;
        let factor = 1.0 / total;
        let row = &mut self.out[query * sizes.width() + head * sizes.head_width..][..sizes.head_width];
        for (slot, sum) in row.iter_mut().zip(sums) {
            *slot = if nothing { 0.0 } else { sum * factor };
        }
        self.log_sums[query * sizes.heads + head] = if nothing { f32::INFINITY } else { largest + total.ln() };
    }
}

/// Inputs of an attention.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inputs<'a> {
    pub(crate) queries: Tokens<'a>,
    pub(crate) keys: Tokens<'a>,
    pub(crate) values: Tokens<'a>,
    pub(crate) sizes: Sizes,
    pub(crate) precision: MatmulPrecision,
}

impl Inputs<'_> {
    /// The tiles of at most `largest` keys of one head of a sample: the first key of each, and their number.
    pub(super) fn key_tiles(&self, largest: usize) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (tile, keys) = (self.sizes.key_tile(largest), self.sizes.keys);
        (0..keys).step_by(tile).map(move |first| (first, tile.min(keys - first)))
    }
}

/// `softmax(scale · q kᵀ) v` per head, and the log-sum-exp of each row, by token and head: +∞ for a query without keys, whose
/// result is 0.
pub(crate) fn forward(inputs: &Inputs<'_>) -> (Vec<f32>, Vec<f32>) {
    let sizes = inputs.sizes;
    let (queries, width, heads) = (sizes.queries, sizes.width(), sizes.heads);
    let mut out = vec![0.0; sizes.batch * queries * width];
    let mut log_sums = vec![f32::INFINITY; sizes.batch * queries * heads];
    if out.is_empty() || sizes.keys == 0 {
        return (out, log_sums);
    }
    match inputs.precision {
        MatmulPrecision::F32 | MatmulPrecision::F16 => attention_f32::forward(inputs, &mut out, &mut log_sums),
        MatmulPrecision::Bf16 => forward_rounded(inputs, &mut out, &mut log_sums),
    }
    (out, log_sums)
}

/// [`forward`] with products of rounded factors, which have kernels of their own.
fn forward_rounded(inputs: &Inputs<'_>, out: &mut [f32], log_sums: &mut [f32]) {
    let sizes = inputs.sizes;
    let (queries, width, heads) = (sizes.queries, sizes.width(), sizes.heads);
    let samples = out.par_chunks_mut(queries * width).zip(log_sums.par_chunks_mut(queries * heads));
    samples.enumerate().for_each(|(sample, (out, log_sums))| {
        let packed: Vec<Head> = (0..heads).into_par_iter().map(|head| Head::new(inputs, sample, head)).collect();
        let keys: Vec<Vec<KeyTile<'_>>> = packed.par_iter().map(|head| head.tiles(inputs)).collect();
        let tiles = out.par_chunks_mut(QUERIES * width).zip(log_sums.par_chunks_mut(QUERIES * heads));
        tiles.enumerate().for_each_init(
            || Scratch::new(&sizes),
            |scratch, (tile, (out, log_sums))| {
                for (head, keys) in keys.iter().enumerate() {
                    let at = Tile { sample, head, first: tile * QUERIES, count: out.len() / width };
                    attend(inputs, at, keys, scratch);
                    scratch.write(Results { out, log_sums }, at, &sizes);
                }
            },
        );
    });
}

/// Keys of one head of a sample in rows, and values in columns, tile by tile.
struct Head {
    keys: Vec<f32>,
    values: Vec<f32>,
}

impl Head {
    fn new(inputs: &Inputs<'_>, sample: usize, head: usize) -> Self {
        let sizes = &inputs.sizes;
        let values = |(first, count)| inputs.values.columns(sample, head, first, count, sizes);
        Self {
            keys: inputs.keys.rows(sample, head, 0, sizes.keys, sizes),
            values: inputs.key_tiles(MATRIX_KEYS).flat_map(values).collect(),
        }
    }

    fn tiles(&self, inputs: &Inputs<'_>) -> Vec<KeyTile<'_>> {
        let width = inputs.sizes.head_width;
        let tile = |(first, count)| {
            let keys = Matrix::new(&self.keys[first * width..], count, width, width);
            let values = Matrix::new(&self.values[first * width..], width, count, count);
            let (keys, values) = (Factor::left(keys, inputs.precision), Factor::left(values, inputs.precision));
            KeyTile { first, count, keys, values }
        };
        inputs.key_tiles(MATRIX_KEYS).map(tile).collect()
    }
}

/// Some keys and values of one head, ready for all of its queries.
struct KeyTile<'a> {
    first: usize,
    count: usize,
    keys: Factor<'a>,
    /// Values in columns.
    values: Factor<'a>,
}

/// Buffers for one tile of queries, with one column per query.
struct Scratch {
    queries: Vec<f32>,
    weights: Vec<f32>,
    sums: Vec<f32>,
    largest: Vec<f32>,
    total: Vec<f32>,
}

impl Scratch {
    fn new(sizes: &Sizes) -> Self {
        Self {
            queries: vec![0.0; sizes.head_width * QUERIES],
            weights: vec![0.0; sizes.key_tile(MATRIX_KEYS) * QUERIES],
            sums: vec![0.0; sizes.head_width * QUERIES],
            largest: vec![0.0; QUERIES],
            total: vec![0.0; QUERIES],
        }
    }

    fn write(&self, mut results: Results<'_>, at: Tile, sizes: &Sizes) {
        for query in 0..at.count {
            let sums = self.sums.chunks_exact(at.lanes()).map(|column| column[query]);
            results.write((query, at.head), sums, (self.largest[query], self.total[query]), sizes);
        }
    }
}

fn attend(inputs: &Inputs<'_>, at: Tile, keys: &[KeyTile<'_>], scratch: &mut Scratch) {
    let sizes = &inputs.sizes;
    let lanes = at.lanes();
    let Scratch { queries, weights, sums, largest, total } = scratch;
    let queries = &mut queries[..sizes.head_width * lanes];
    let sums = &mut sums[..sizes.head_width * lanes];
    let (largest, total) = (&mut largest[..lanes], &mut total[..lanes]);
    inputs.queries.transpose_into(queries, at, sizes.narrow_scale(), sizes);
    let queries = Factor::right(Matrix::new(queries, sizes.head_width, lanes, lanes), inputs.precision);
    largest.fill(f32::NEG_INFINITY);
    total.fill(0.0);
    for tile in keys {
        let weights = &mut weights[..tile.count * lanes];
        multiply_factors(Output::new(weights, tile.count, lanes, lanes), &tile.keys, &queries, Write::Set);
        simd::run(Softmax { weights, sums, largest, total });
        let weights = Factor::right(Matrix::new(weights, tile.count, lanes, lanes), inputs.precision);
        let write = if tile.first == 0 { Write::Set } else { Write::Add };
        multiply_factors(Output::new(sums, sizes.head_width, lanes, lanes), &tile.values, &weights, write);
    }
}

/// Turns logits into weights relative to the largest logit so far, and rescales earlier sums.
struct Softmax<'a> {
    weights: &'a mut [f32],
    sums: &'a mut [f32],
    largest: &'a mut [f32],
    total: &'a mut [f32],
}

impl WithSimd for Softmax<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let exp = Exp::new(simd);
        let (weights, _) = S::as_mut_simd_f32s(self.weights);
        let (sums, _) = S::as_mut_simd_f32s(self.sums);
        let (largest, _) = S::as_mut_simd_f32s(self.largest);
        let (total, _) = S::as_mut_simd_f32s(self.total);
        let vectors = largest.len();
        for (at, (largest, total)) in largest.iter_mut().zip(total).enumerate() {
            let factor = weigh(simd, &exp, weights, (vectors, at), (largest, total));
            for row in sums.chunks_exact_mut(vectors) {
                row[at] = simd.mul_f32s(row[at], factor);
            }
        }
    }
}
