use std::cell::Cell;

use crate::kernels::bf16;

/// Precision of the matrix products; everything else, and every sum, is in f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MatmulPrecision {
    /// Inputs as they are.
    #[default]
    F32,
    /// On the CPU, inputs rounded to bfloat16: several times as fast on processors with AMX, twice with AVX-512's instructions for it,
    /// slower on others. Other devices compute in f32.
    Bf16,
    /// On graphics adapters whose shaders have 16-bit floats, inputs and results rounded to float16: a result above 65 504 is infinite.
    /// Other devices compute in f32.
    F16,
}

thread_local! {
    static CURRENT: Cell<MatmulPrecision> = const { Cell::new(MatmulPrecision::F32) };
}

impl MatmulPrecision {
    /// As configurations spell it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::Bf16 => "bf16",
            Self::F16 => "f16",
        }
    }

    /// Whether this precision is faster than [`Self::F32`] on the CPU.
    pub fn is_fast(self) -> bool {
        self == Self::Bf16 && bf16::is_fast()
    }

    /// Runs `work` with this precision: operations that this thread calls, with all their tasks. Their gradients have it too,
    /// wherever they are computed.
    pub fn scope<R>(self, work: impl FnOnce() -> R) -> R {
        let _restored = Restore(CURRENT.replace(self));
        work()
    }

    /// That of the innermost scope.
    pub(crate) fn current() -> Self {
        CURRENT.get()
    }
}

/// Ends a scope, even if it panics.
struct Restore(MatmulPrecision);

impl Drop for Restore {
    fn drop(&mut self) {
        CURRENT.set(self.0);
    }
}
