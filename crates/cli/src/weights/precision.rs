//! Which numbers a file stores.

use atsplat_model::weights::Precision;
use clap::ValueEnum;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum PrecisionWord {
    /// As trained.
    F32,
    /// Half the size, numbers up to 65504.
    F16,
    /// Half the size, f32's range with three digits.
    Bf16,
}

impl From<PrecisionWord> for Precision {
    fn from(word: PrecisionWord) -> Self {
        match word {
            PrecisionWord::F32 => Self::Single,
            PrecisionWord::F16 => Self::Half,
            PrecisionWord::Bf16 => Self::Brain,
        }
    }
}
