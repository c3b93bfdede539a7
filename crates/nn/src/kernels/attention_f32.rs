use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::attention::{Inputs, QUERIES, Results, Sizes, Tile};
use super::simd::{self, Exp};
use super::softmax::weigh;

/// Rows of a product that are computed together, each in [`VECTORS`] vectors: their sums fit into the registers and hide the
/// latency of multiply-adds.
const ROWS: usize = 4;
/// Vectors of queries that are handled together.
const VECTORS: usize = 2;
/// Largest number of keys of a tile, whose weights stay in the first-level cache.
const CACHED_KEYS: usize = 128;

/// [`super::attention::forward`] in f32: logits, weights and their products with the values, for a few queries and a tile of keys
/// at a time.
///
/// Every product is a chain of fused multiply-adds in order, over the elements of a head or the keys of a tile. An element's bits
/// depend only on its query, the keys and the values.
pub(super) fn forward(inputs: &Inputs<'_>, out: &mut [f32], log_sums: &mut [f32]) {
    let Sizes { queries, heads, .. } = inputs.sizes;
    let width = inputs.sizes.width();
    let samples = out.par_chunks_mut(queries * width).zip(log_sums.par_chunks_mut(queries * heads));
    samples.enumerate().for_each(|(sample, (out, log_sums))| {
        let packed: Vec<Vec<KeyTile>> =
            (0..heads).into_par_iter().map(|head| key_tiles(inputs, sample, head)).collect();
        let tiles = out.par_chunks_mut(QUERIES * width).zip(log_sums.par_chunks_mut(QUERIES * heads));
        tiles.enumerate().for_each_init(Scratch::default, |scratch, (tile, (out, log_sums))| {
            for (head, keys) in packed.iter().enumerate() {
                let at = Tile { sample, head, first: tile * QUERIES, count: out.len() / width };
                simd::run(Attend { inputs, at, keys, scratch, results: Results { out, log_sums } });
            }
        });
    });
}

/// Keys and values of one head, in the order in which products read them.
struct KeyTile {
    count: usize,
    /// By [`ROWS`] keys, then element: the element of each of these keys.
    keys: Vec<[f32; ROWS]>,
    /// By [`ROWS`] elements, then key: each of these elements of the key's value.
    values: Vec<[f32; ROWS]>,
}

/// The keys and values of one head, tile by tile.
fn key_tiles(inputs: &Inputs<'_>, sample: usize, head: usize) -> Vec<KeyTile> {
    let sizes = &inputs.sizes;
    let width = sizes.head_width;
    let pack = |(first, count): (usize, usize)| {
        let mut keys = vec![[0.0; ROWS]; count.div_ceil(ROWS) * width];
        let mut values = vec![[0.0; ROWS]; width.div_ceil(ROWS) * count];
        for place in 0..count {
            let key = first + place;
            for (element, &number) in inputs.keys.from(sample, head, key, sizes)[..width].iter().enumerate() {
                keys[place / ROWS * width + element][place % ROWS] = number;
            }
            for (group, numbers) in inputs.values.from(sample, head, key, sizes)[..width].chunks(ROWS).enumerate() {
                values[group * count + place][..numbers.len()].copy_from_slice(numbers);
            }
        }
        KeyTile { count, keys, values }
    };
    inputs.key_tiles(CACHED_KEYS).map(pack).collect()
}

/// Buffers for one tile of queries. Queries and sums are in groups of [`VECTORS`] vectors, and within a group by element, then
/// query.
#[derive(Default)]
struct Scratch {
    queries: Vec<f32>,
    sums: Vec<f32>,
    largest: Vec<f32>,
    totals: Vec<f32>,
    weights: Vec<f32>,
}

/// Attention of one head for a tile of queries.
struct Attend<'a, 'b> {
    inputs: &'a Inputs<'b>,
    at: Tile,
    keys: &'a [KeyTile],
    scratch: &'a mut Scratch,
    results: Results<'a>,
}

impl WithSimd for Attend<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { inputs, at, keys, scratch, results } = self;
        let lanes = VECTORS * S::F32_LANES;
        let (groups, width) = (at.count.div_ceil(lanes), inputs.sizes.head_width);
        let padded = width.next_multiple_of(ROWS);
        scratch.reset(inputs, at, lanes);
        {
            let queries = pairs::<S>(&mut scratch.queries);
            let sums = pairs::<S>(&mut scratch.sums);
            let (largest, totals) = (pairs::<S>(&mut scratch.largest), pairs::<S>(&mut scratch.totals));
            let weights = pairs::<S>(&mut scratch.weights);
            let exp = Exp::new(simd);
            for tile in keys {
                for group in 0..groups {
                    attend(
                        simd,
                        &exp,
                        tile,
                        &queries[group * width..][..width],
                        weights,
                        Running {
                            sums: &mut sums[group * padded..][..padded],
                            largest: &mut largest[group],
                            total: &mut totals[group],
                        },
                    );
                }
            }
        }
        scratch.write(results, at, &inputs.sizes, lanes);
    }
}

/// Vectors of a buffer, [`VECTORS`] together.
#[inline(always)]
fn pairs<S: Simd>(buffer: &mut [f32]) -> &mut [[S::f32s; VECTORS]] {
    S::as_mut_simd_f32s(buffer).0.as_chunks_mut().0
}

/// What earlier tiles of keys gave a group of queries.
struct Running<'a, V> {
    /// By element.
    sums: &'a mut [[V; VECTORS]],
    largest: &'a mut [V; VECTORS],
    total: &'a mut [V; VECTORS],
}

/// Adds a tile of keys to a group of queries.
#[inline(always)]
fn attend<S: Simd>(
    simd: S,
    exp: &Exp<S>,
    tile: &KeyTile,
    queries: &[[S::f32s; VECTORS]],
    weights: &mut [[S::f32s; VECTORS]],
    running: Running<'_, S::f32s>,
) {
    let Running { sums, largest, total } = running;
    let logits = weights.as_chunks_mut::<ROWS>().0;
    for (keys, logits) in tile.keys.chunks_exact(queries.len()).zip(logits) {
        *logits = products(simd, keys, queries);
    }
    let weights = &mut weights[..tile.count];
    let mut factors = [simd.splat_f32s(0.0); VECTORS];
    for (vector, factor) in factors.iter_mut().enumerate() {
        let running = (&mut largest[vector], &mut total[vector]);
        *factor = weigh(simd, exp, weights.as_flattened_mut(), (VECTORS, vector), running);
    }
    for (values, sums) in tile.values.chunks_exact(tile.count).zip(sums.as_chunks_mut::<ROWS>().0) {
        let added = products(simd, values, weights);
        for (sums, added) in sums.iter_mut().zip(added) {
            for vector in 0..VECTORS {
                sums[vector] = simd.mul_add_e_f32s(sums[vector], factors[vector], added[vector]);
            }
        }
    }
}

/// `Σ left[i] · right[i]`, each number on the left times each vector on the right.
#[inline(always)]
fn products<S: Simd>(simd: S, left: &[[f32; ROWS]], right: &[[S::f32s; VECTORS]]) -> [[S::f32s; VECTORS]; ROWS] {
    let mut sums = [[simd.splat_f32s(0.0); VECTORS]; ROWS];
    for (left, right) in left.iter().zip(right) {
        for (sums, &left) in sums.iter_mut().zip(left) {
            let left = simd.splat_f32s(left);
            for (sum, &right) in sums.iter_mut().zip(right) {
                *sum = simd.mul_add_e_f32s(left, right, *sum);
            }
        }
    }
    sums
}

impl Scratch {
    /// Reads the queries of a tile, in groups of `lanes`, and forgets the previous tile.
    fn reset(&mut self, inputs: &Inputs<'_>, at: Tile, lanes: usize) {
        let sizes = &inputs.sizes;
        let (width, groups) = (sizes.head_width, at.count.div_ceil(lanes));
        for (buffer, value, elements) in [
            (&mut self.queries, 0.0, width * groups),
            (&mut self.sums, 0.0, width.next_multiple_of(ROWS) * groups),
            (&mut self.largest, f32::NEG_INFINITY, groups),
            (&mut self.totals, 0.0, groups),
        ] {
            buffer.clear();
            buffer.resize(elements * lanes, value);
        }
        self.weights.resize(CACHED_KEYS.next_multiple_of(ROWS) * lanes, 0.0);
        for (group, out) in self.queries.chunks_exact_mut(width * lanes).enumerate() {
            let first = group * lanes;
            let from = (at.sample, at.head, at.first + first);
            inputs.queries.transpose(out, from, (lanes.min(at.count - first), lanes), sizes.narrow_scale(), sizes);
        }
    }

    fn write(&self, mut results: Results<'_>, at: Tile, sizes: &Sizes, lanes: usize) {
        let padded = sizes.head_width.next_multiple_of(ROWS);
        for query in 0..at.count {
            let group = &self.sums[query / lanes * padded * lanes..];
            let sums = group.chunks_exact(lanes).map(|column| column[query % lanes]);
            results.write((query, at.head), sums, (self.largest[query], self.totals[query]), sizes);
        }
    }
}
