//! Prefix sums and the radix sort.

use bytemuck::{Pod, Zeroable};

use super::GpuError;
use super::kernels::{Kernel, Pool};
use super::record::Recorder;

/// Numbers summed by one workgroup.
const BLOCK: u64 = 2048;
/// Keys sorted by one workgroup.
const SORT_BLOCK: u64 = 2048;
const DIGIT_BITS: u32 = 8;

/// How many items there are.
#[derive(Clone, Copy)]
pub(super) enum Items<'a> {
    Known(u64),
    /// Counted by an earlier kernel: a word of a buffer, and the most that is possible. Of more, none are processed.
    Counted {
        totals: &'a wgpu::Buffer,
        at: u64,
        bound: u64,
    },
}

impl Items<'_> {
    /// The number, or the most that is possible.
    const fn bound(self) -> u64 {
        match self {
            Self::Known(bound) | Self::Counted { bound, .. } => bound,
        }
    }

    fn work(self) -> Work {
        let (bound, at) = match self {
            Self::Known(count) => (count, u64::from(KNOWN)),
            Self::Counted { at, bound, .. } => (bound, at),
        };
        Work { bound: word(bound), at: word(at), ..Work::zeroed() }
    }

    /// The buffer with the number, or an unused one.
    fn totals(self, recorder: &Recorder<'_>, pool: &mut Pool) -> Result<wgpu::Buffer, GpuError> {
        match self {
            Self::Known(_) => pool.get(recorder.context(), "no totals", 0, 4),
            Self::Counted { totals, .. } => Ok(totals.clone()),
        }
    }
}

/// `KNOWN` of `counted.wgsl`.
const KNOWN: u32 = u32::MAX;

/// `struct Work` of `counted.wgsl`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Work {
    bound: u32,
    at: u32,
    shift: u32,
    mask: u32,
    level: u32,
    is_last: u32,
    is_table: u32,
    spare: u32,
}

/// Exclusive prefix sum of the first `count` numbers, saturating at the largest u32.
pub(super) fn scan(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    numbers: &wgpu::Buffer,
    count: u64,
) -> Result<(), GpuError> {
    let items = Items::Known(count);
    let totals = items.totals(recorder, pool)?;
    scan_level(recorder, pool, numbers, (count, &totals), items.work())
}

/// One level of the prefix sum: at most `bound` numbers, each the sum of a block of the level below.
fn scan_level(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    numbers: &wgpu::Buffer,
    (bound, totals): (u64, &wgpu::Buffer),
    work: Work,
) -> Result<(), GpuError> {
    let blocks = bound.div_ceil(BLOCK);
    let sums = pool.get(recorder.context(), "block sums", work.level as usize, 4 * blocks)?;
    let is_last = blocks <= 1;
    let work = Work { is_last: is_last.into(), ..work };
    if !is_last {
        recorder.dispatch(Kernel::ScanSums, bytemuck::bytes_of(&work), &[totals, numbers, &sums], blocks)?;
        scan_level(recorder, pool, &sums, (blocks, totals), Work { level: work.level + 1, ..work })?;
    }
    recorder.dispatch(Kernel::ScanApply, bytemuck::bytes_of(&work), &[totals, &sums, numbers], blocks)
}

/// Keys and their values.
pub(super) struct Sorted {
    pub(super) keys: wgpu::Buffer,
    pub(super) values: wgpu::Buffer,
}

/// Stable radix sort by the lowest `bits` of the keys. Overwrites `pairs` and `spare`; returns the one that holds the
/// result.
pub(super) fn sort(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    pairs: Sorted,
    spare: Sorted,
    items: Items<'_>,
    bits: u32,
) -> Result<Sorted, GpuError> {
    let blocks = items.bound().div_ceil(SORT_BLOCK);
    let numbers = blocks << DIGIT_BITS;
    let table = pool.get(recorder.context(), "digits", 0, 4 * numbers)?;
    let totals = items.totals(recorder, pool)?;
    let (mut from, mut to) = (pairs, spare);
    for shift in (0..bits).step_by(DIGIT_BITS as usize) {
        let mask = (1 << DIGIT_BITS.min(bits - shift)) - 1;
        let work = Work { shift, mask, is_table: 1, ..items.work() };
        let uniform = bytemuck::bytes_of(&work);
        recorder.dispatch(Kernel::SortCount, uniform, &[&totals, &from.keys, &table], blocks)?;
        scan_level(recorder, pool, &table, (numbers, &totals), work)?;
        let buffers = [&totals, &from.keys, &from.values, &table, &to.keys, &to.values];
        recorder.dispatch(Kernel::SortScatter, uniform, &buffers, blocks)?;
        std::mem::swap(&mut from, &mut to);
    }
    Ok(from)
}

/// A uniform block of four words.
pub(super) fn words(values: &[u64; 4]) -> Vec<u8> {
    values.iter().flat_map(|value| word(*value).to_le_bytes()).collect()
}

/// A number of items as a word of a uniform block.
#[expect(clippy::expect_used, reason = "a buffer holds the items, and no binding has as many words as a u32 can count")]
pub(super) fn word(value: u64) -> u32 {
    u32::try_from(value).expect("the buffer of these items was allocated")
}

#[cfg(test)]
mod tests {
    use atsplat_tests::skip_without_graphics;
    use proptest::prelude::*;

    use super::*;
    use crate::gpu::adapters::{AdapterChoice, choose};
    use crate::gpu::context::Context;
    use crate::gpu::kernels::Pipelines;
    use crate::gpu::{GpuError, GpuOptions};

    /// `None` if there is no adapter and none is required.
    fn context() -> Option<Context> {
        match choose(&AdapterChoice::Automatic) {
            Ok((adapter, description)) => Some(Context::open(&adapter, &description, &GpuOptions::default()).unwrap()),
            Err(error @ GpuError::NoAdapter { .. }) => {
                skip_without_graphics("splat::gpu::sort", error);
                None
            }
            Err(error) => panic!("{error}"),
        }
    }

    fn upload(context: &Context, values: &[u32]) -> wgpu::Buffer {
        let buffer = context.buffer("test", 4 * values.len() as u64).unwrap();
        context.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(values));
        buffer
    }

    fn numbers(bytes: &[u8]) -> Vec<u32> {
        bytes.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect()
    }

    fn sorted(context: &Context, pipelines: &mut Pipelines, keys: &[u32], bits: u32) -> Vec<u32> {
        let values: Vec<u32> = (0..).take(keys.len()).collect();
        let [pairs, spare] = [(); 2].map(|()| Sorted { keys: upload(context, keys), values: upload(context, &values) });
        let spare_room = 100;
        let mut recorder = Recorder::new(context, pipelines);
        // As counted by an earlier kernel, with room for more.
        let totals = upload(context, &[u32::try_from(keys.len()).unwrap(), u32::MAX]);
        let items = Items::Counted { totals: &totals, at: 0, bound: keys.len() as u64 + spare_room };
        let sorted = sort(&mut recorder, &mut Pool::default(), pairs, spare, items, bits).unwrap();
        numbers(&recorder.submit_and_read(&[(&sorted.values, 4 * keys.len() as u64)]).unwrap().contents.concat())
    }

    fn expected(keys: &[u32], bits: u32) -> Vec<u32> {
        let mut order: Vec<u32> = (0..).take(keys.len()).collect();
        order.sort_by_key(|at| keys[*at as usize] & (u32::MAX >> (32 - bits)));
        order
    }

    #[test]
    fn sorts_stably() {
        let Some(context) = context() else { return };
        let mut pipelines = Pipelines::default();
        let key = prop_oneof![any::<u32>(), 0u32..4, Just(u32::MAX)];
        let case = (prop::collection::vec(key, 1..3000), prop::sample::select(vec![3u32, 12, 16, 32]));
        let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(24));
        runner
            .run(&case, |(keys, bits)| {
                prop_assert_eq!(sorted(&context, &mut pipelines.clone(), &keys, bits), expected(&keys, bits));
                Ok(())
            })
            .unwrap();
        for count in [127, 128, 129, 2047, 2048, 2049, 140_000] {
            let keys: Vec<u32> = (0u32..count).map(|n| n.wrapping_mul(2_654_435_769) >> 7).collect();
            assert!(sorted(&context, &mut pipelines, &keys, 28) == expected(&keys, 28), "{count}");
        }
    }

    /// Up to three levels of blocks, and saturating sums.
    #[test]
    fn prefix_sums_saturate() {
        let Some(context) = context() else { return };
        let mut pipelines = Pipelines::default();
        for (count, step) in [(1u32, 3), (2048, 1), (2049, 7), (70_000, 5), (4_200_000, 1), (9000, 1_000_000)] {
            let values: Vec<u32> = (0..count).map(|n| (n % 3) * step).collect();
            let buffer = upload(&context, &values);
            let mut recorder = Recorder::new(&context, &mut pipelines);
            scan(&mut recorder, &mut Pool::default(), &buffer, count.into()).unwrap();
            recorder.submit();
            let found = numbers(&context.read(&[(&buffer, 4 * u64::from(count))]).unwrap().concat());
            let running =
                values.iter().scan(0u32, |sum, value| Some(std::mem::replace(sum, sum.saturating_add(*value))));
            assert!(found == running.collect::<Vec<_>>(), "{count} by {step}");
        }
    }
}
