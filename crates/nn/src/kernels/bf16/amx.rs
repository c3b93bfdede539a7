//! Products by Intel's Advanced Matrix Extensions: eight registers of 16×64 bytes, and an instruction that adds to a 16×16 tile of f32
//! the product of two tiles of bfloat16 with 32 terms ("Intel 64 and IA-32 Architectures Software Developer's Manual", volume 1, chapter 18).

#![expect(unsafe_code, reason = "tile registers are reached by assembly alone")]

use std::arch::asm;
use std::marker::PhantomData;
use std::sync::OnceLock;

use super::blocks::{BlockFactors, Kernel};
use super::pack::{self, LANES};

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
pub(super) struct Registers {
    not_send: PhantomData<*const ()>,
}

impl Kernel for Registers {
    fn begin() -> Self {
        assert!(is_available(), "tile registers");
        // SAFETY: the registers are available, and the configuration is valid.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const EIGHT_FULL_TILES, options(nostack, readonly)) };
        Self { not_send: PhantomData }
    }

    fn multiply(&self, factors: BlockFactors<'_>, out: &mut [f32], row_stride: usize, add: bool) {
        let depth = factors.check(out, row_stride);
        let BlockFactors { rows: [upper, lower], columns: [first, second] } = factors;
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
