use std::cell::Cell;

use crate::kernels::bf16;

/// Precision of the matrix products on the CPU; everything else, and every sum, is in f32.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MatmulPrecision {
    /// Inputs as they are.
    #[default]
    F32,
    /// Inputs rounded to bfloat16: several times as fast on processors with AMX, twice with AVX-512's instructions for it, slower on
    /// others.
    Bf16,
}

thread_local! {
    static CURRENT: Cell<MatmulPrecision> = const { Cell::new(MatmulPrecision::F32) };
}

impl MatmulPrecision {
    /// Whether this precision is faster than [`Self::F32`] on this processor.
    pub fn is_fast(self) -> bool {
        self == Self::Bf16 && bf16::is_fast()
    }

    /// Runs `work` with this precision: operations that this thread calls, with all their tasks, and their gradients if it calls
    /// those too.
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
