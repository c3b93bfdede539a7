//! Products by Intel's Advanced Matrix Extensions: eight registers of 16×64 bytes, and an instruction that adds to a 16×16 tile of f32
//! the product of two tiles of bfloat16 with 32 terms ("Intel 64 and IA-32 Architectures Software Developer's Manual", volume 1, chapter 18).

#![expect(unsafe_code, reason = "tile registers are reached by assembly alone")]

use std::arch::asm;
use std::cell::Cell;
use std::marker::PhantomData;
use std::sync::OnceLock;

use rayon::prelude::*;

use super::super::matrix::{Matrix, Output, Threads, Write};
use super::pack::{self, LANES, Order, TERMS, Tile, pack};

/// Rows and columns of a block of the result, which is four tiles.
const BLOCK: usize = 2 * LANES;
/// Products of fewer multiplications stay on one thread.
const LEAST_PARALLEL: usize = 1 << 18;

/// Whether the processor has the instructions and Linux lets this process use their registers.
pub(super) fn is_available() -> bool {
    static AVAILABLE: OnceLock<bool> = OnceLock::new();
    *AVAILABLE.get_or_init(|| has_instructions() && pack::has_instructions() && registers_are_granted())
}

fn has_instructions() -> bool {
    use std::arch::x86_64::{__cpuid, __cpuid_count};
    const EXTENDED_FEATURES: u32 = 7;
    const AMX_BF16: u32 = 1 << 22;
    const AMX_TILE: u32 = 1 << 24;
    if __cpuid(0).eax < EXTENDED_FEATURES {
        return false;
    }
    let features = __cpuid_count(EXTENDED_FEATURES, 0).edx;
    features & AMX_BF16 != 0 && features & AMX_TILE != 0
}

/// Requests tile registers for every thread of this process (Linux, `Documentation/arch/x86/xstate.rst`). Systems that do not know
/// of them return an error.
fn registers_are_granted() -> bool {
    const ARCH_PRCTL: i64 = 158;
    const REQUEST_PERMISSION: u64 = 0x1023;
    const TILE_DATA: u64 = 18;
    let result: i64;
    // SAFETY: this system call changes nothing but the permission; `syscall` overwrites rcx and r11.
    unsafe {
        asm!(
            "syscall",
            inlateout("rax") ARCH_PRCTL => result,
            in("rdi") REQUEST_PERMISSION,
            in("rsi") TILE_DATA,
            lateout("rcx") _,
            lateout("r11") _,
            options(nostack),
        );
    }
    result == 0
}

/// `left · right` into `out`, blocks of rows in parallel if requested.
///
/// # Panics
/// If the shapes do not fit together, or without [`is_available`].
pub(super) fn multiply(out: Output<'_>, left: Matrix<'_>, right: Matrix<'_>, write: Write, threads: Threads) {
    assert!(is_available(), "tile registers");
    assert_eq!(left.columns, right.rows, "inner sizes of a product");
    let Output { data, rows: count, columns: width, row_stride: stride } = out;
    assert_eq!([count, width], [left.rows, right.columns], "outer sizes of a product");
    if count == 0 || width == 0 {
        return;
    }
    let (columns, add) = (right.transposed(), write == Write::Add);
    let parallel =
        threads == Threads::All && count.saturating_mul(width).saturating_mul(left.columns) >= LEAST_PARALLEL;
    let depth = left.columns.div_ceil(TERMS);
    let mut packed = Buffer::take(&RIGHT, width.div_ceil(BLOCK) * 2 * depth);
    let pack_right = |(at, tiles): (usize, &mut [Tile])| pack(columns, at * LANES, Order::Pairs, tiles);
    // Without terms there is nothing to pack.
    let panel = depth.max(1);
    if parallel {
        packed.tiles.par_chunks_mut(panel).enumerate().for_each(pack_right);
    } else {
        packed.tiles.chunks_mut(panel).enumerate().for_each(pack_right);
    }
    let right = Packed { tiles: &packed.tiles, depth };
    let needed = (count - 1) * stride + width;
    let rows = |(at, data): (usize, &mut [f32])| {
        let first = at * BLOCK;
        let out = Output { data, rows: BLOCK.min(count - first), columns: width, row_stride: stride };
        multiply_rows(out, left, first, &right, add);
    };
    let data = &mut data[..needed];
    if parallel {
        data.par_chunks_mut(BLOCK * stride).enumerate().for_each(rows);
    } else {
        data.chunks_mut(BLOCK * stride).enumerate().for_each(rows);
    }
}

/// The right matrix in tiles, all terms of 16 columns after each other.
struct Packed<'a> {
    tiles: &'a [Tile],
    depth: usize,
}

/// Up to 32 rows of the result, `first` the first of them in `left`.
fn multiply_rows(mut out: Output<'_>, left: Matrix<'_>, first: usize, right: &Packed<'_>, add: bool) {
    let depth = right.depth;
    let mut packed = Buffer::take(&LEFT, 2 * depth);
    let (upper, lower) = packed.tiles.split_at_mut(depth);
    pack(left, first, Order::Lanes, upper);
    pack(left, first + LANES, Order::Lanes, lower);
    let registers = Registers::configure();
    for at in 0..out.columns.div_ceil(BLOCK) {
        let first_column = at * BLOCK;
        let [one, two] = [2 * at, 2 * at + 1].map(|panel| &right.tiles[panel * depth..(panel + 1) * depth]);
        let factors = [&*upper, &*lower, one, two];
        let columns = BLOCK.min(out.columns - first_column);
        if out.rows == BLOCK && columns == BLOCK {
            registers.multiply(factors, &mut out.data[first_column..], out.row_stride, add);
            continue;
        }
        // A block at the edge is computed beside the matrix.
        let mut block = [0.0; BLOCK * BLOCK];
        let own_rows = |out: &mut Output<'_>, copy: &mut dyn FnMut(usize, &mut [f32])| {
            for row in 0..out.rows {
                copy(row, &mut out.data[row * out.row_stride + first_column..][..columns]);
            }
        };
        if add {
            own_rows(&mut out, &mut |row, own| block[row * BLOCK..][..columns].copy_from_slice(own));
        }
        registers.multiply(factors, &mut block, BLOCK, add);
        own_rows(&mut out, &mut |row, own| own.copy_from_slice(&block[row * BLOCK..][..columns]));
    }
}

/// The configuration of tile registers that `ldtilecfg` reads.
#[repr(C, align(64))]
struct Configuration {
    palette: u8,
    start_row: u8,
    reserved: [u8; 14],
    /// Bytes in a row of each register.
    row_bytes: [u16; 16],
    rows: [u8; 16],
}

static EIGHT_FULL_TILES: Configuration = Configuration {
    palette: 1,
    start_row: 0,
    reserved: [0; 14],
    row_bytes: [64, 64, 64, 64, 64, 64, 64, 64, 0, 0, 0, 0, 0, 0, 0, 0],
    rows: [16, 16, 16, 16, 16, 16, 16, 16, 0, 0, 0, 0, 0, 0, 0, 0],
};

/// This thread's tile registers, configured until the value is dropped.
struct Registers {
    not_send: PhantomData<*const ()>,
}

impl Registers {
    fn configure() -> Self {
        // SAFETY: `multiply` asserts that the registers are available; the configuration is valid.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const EIGHT_FULL_TILES, options(nostack, readonly)) };
        Self { not_send: PhantomData }
    }

    #[expect(clippy::unused_self, reason = "registers are configured while it lives")]
    /// A block of 32×32: `[upper, lower]` rows of the left matrix times `[first, second]` columns of the right one, over all terms.
    fn multiply(&self, factors: [&[Tile]; 4], out: &mut [f32], row_stride: usize, add: bool) {
        let [upper, lower, first, second] = factors;
        let depth = upper.len();
        assert!(factors.iter().all(|factor| factor.len() == depth), "terms of a block");
        assert!((BLOCK - 1) * row_stride + BLOCK <= out.len() && row_stride >= BLOCK, "a block of 32×32");
        // SAFETY: the loop reads `depth` tiles of 1024 bytes from each factor. Stores, and loads before them, touch 32 rows of 32
        // values, which the assertion puts inside `out`. The registers are configured while `self` lives, and belong to no other
        // code of this thread.
        unsafe {
            asm!(
                "test {add:e}, {add:e}",
                "jnz 2f",
                "tilezero tmm0",
                "tilezero tmm1",
                "tilezero tmm2",
                "tilezero tmm3",
                "jmp 3f",
                "2:",
                "tileloadd tmm0, [{top} + {stride}]",
                "tileloadd tmm1, [{top} + {stride} + 64]",
                "tileloadd tmm2, [{bottom} + {stride}]",
                "tileloadd tmm3, [{bottom} + {stride} + 64]",
                "3:",
                "test {depth}, {depth}",
                "jz 5f",
                "4:",
                "tileloadd tmm4, [{upper} + {row}]",
                "tileloadd tmm6, [{first} + {row}]",
                "tileloadd tmm7, [{second} + {row}]",
                "tileloadd tmm5, [{lower} + {row}]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                "add {upper}, 1024",
                "add {lower}, 1024",
                "add {first}, 1024",
                "add {second}, 1024",
                "dec {depth}",
                "jnz 4b",
                "5:",
                "tilestored [{top} + {stride}], tmm0",
                "tilestored [{top} + {stride} + 64], tmm1",
                "tilestored [{bottom} + {stride}], tmm2",
                "tilestored [{bottom} + {stride} + 64], tmm3",
                add = in(reg) u32::from(add),
                top = in(reg) out.as_mut_ptr(),
                bottom = in(reg) out.as_mut_ptr().add(LANES * row_stride),
                stride = in(reg) row_stride * size_of::<f32>(),
                row = in(reg) 64usize,
                upper = inout(reg) upper.as_ptr() => _,
                lower = inout(reg) lower.as_ptr() => _,
                first = inout(reg) first.as_ptr() => _,
                second = inout(reg) second.as_ptr() => _,
                depth = inout(reg) depth => _,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack),
            );
        }
    }
}

impl Drop for Registers {
    fn drop(&mut self) {
        // SAFETY: returns the registers to their initial state, so that the system need not save them.
        unsafe { asm!("tilerelease", options(nostack, nomem)) };
    }
}

thread_local! {
    static LEFT: Cell<Vec<Tile>> = const { Cell::new(Vec::new()) };
    static RIGHT: Cell<Vec<Tile>> = const { Cell::new(Vec::new()) };
}

/// Tiles of one product; their memory is kept for the next product of the thread.
struct Buffer {
    tiles: Vec<Tile>,
    home: &'static std::thread::LocalKey<Cell<Vec<Tile>>>,
}

impl Buffer {
    fn take(home: &'static std::thread::LocalKey<Cell<Vec<Tile>>>, count: usize) -> Self {
        // While this product waits for others, its thread may begin another one, which finds an empty buffer.
        let mut tiles = home.take();
        tiles.resize(count, Tile::ZERO);
        Self { tiles, home }
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        self.home.set(std::mem::take(&mut self.tiles));
    }
}
