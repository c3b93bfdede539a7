//! Prefix sums and the radix sort.

use super::GpuError;
use super::kernels::{Kernel, Pool};
use super::record::Recorder;

/// Numbers that one workgroup sums up.
const BLOCK: u64 = 2048;
/// Keys that one thread counts and moves.
const RUN: u64 = 32;
const DIGIT_BITS: u32 = 4;
const THREADS: u64 = 64;

/// Replaces each of the first `count` numbers by the sum of those before it; sums beyond u32 stay at its largest.
pub(super) fn scan(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    numbers: &wgpu::Buffer,
    count: u64,
) -> Result<(), GpuError> {
    scan_level(recorder, pool, numbers, count, 0)
}

fn scan_level(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    numbers: &wgpu::Buffer,
    count: u64,
    level: usize,
) -> Result<(), GpuError> {
    let blocks = count.div_ceil(BLOCK);
    let sums = pool.get(recorder.context(), "block sums", level, 4 * blocks)?;
    let is_last = blocks <= 1;
    let uniform = words(&[count, blocks, u64::from(is_last), 0]);
    if !is_last {
        recorder.dispatch(Kernel::ScanSums, &uniform, &[numbers, &sums], blocks)?;
        scan_level(recorder, pool, &sums, blocks, level + 1)?;
    }
    recorder.dispatch(Kernel::ScanApply, &uniform, &[&sums, numbers], blocks)
}

/// Keys, and what they stand for, in the order of the keys.
pub(super) struct Sorted {
    pub(super) keys: wgpu::Buffer,
    pub(super) values: wgpu::Buffer,
}

/// Sorts by the lowest `bits` of the keys; equal ones keep their order. Reads from `keys` and `values`, which it may
/// overwrite, and from their `spare` fellows.
pub(super) fn sort(
    recorder: &mut Recorder<'_>,
    pool: &mut Pool,
    pairs: Sorted,
    spare: Sorted,
    count: u64,
    bits: u32,
) -> Result<Sorted, GpuError> {
    let runs = count.div_ceil(RUN);
    let table = pool.get(recorder.context(), "digits", 0, 4 * (runs << DIGIT_BITS))?;
    let (mut from, mut to) = (pairs, spare);
    for shift in (0..bits).step_by(DIGIT_BITS as usize) {
        let uniform = words(&[count, runs, u64::from(shift), 0]);
        let groups = runs.div_ceil(THREADS);
        recorder.dispatch(Kernel::SortCount, &uniform, &[&from.keys, &table], groups)?;
        scan(recorder, pool, &table, runs << DIGIT_BITS)?;
        let buffers = [&from.keys, &from.values, &table, &to.keys, &to.values];
        recorder.dispatch(Kernel::SortScatter, &uniform, &buffers, groups)?;
        std::mem::swap(&mut from, &mut to);
    }
    Ok(from)
}

/// A uniform block of four words; what is too large for one counts as all there are and is refused elsewhere.
pub(super) fn words(values: &[u64; 4]) -> Vec<u8> {
    values.iter().flat_map(|value| u32::try_from(*value).unwrap_or(u32::MAX).to_le_bytes()).collect()
}
