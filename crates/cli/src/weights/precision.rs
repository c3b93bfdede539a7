//! Which numbers a file stores.

use anyhow::{Context as _, bail};
use atsplat_model::weights::{DType, ModelWeights, Precision, StoredTensor, StoredTensors};
use atsplat_pickle::SharedBytes;
use clap::ValueEnum;
use half::bf16;

/// Metadata that [`ModelWeights::to_stored`] writes over the tensors (`crates/model/NAMES.md`).
const DIGEST_KEY: &str = "atsplat.tensors-sha256";

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum PrecisionWord {
    /// As trained.
    F32,
    /// Half the size, numbers up to 65504.
    F16,
    /// Half the size, f32's range with three digits.
    Bf16,
}

impl PrecisionWord {
    /// The contents of a weights file with numbers of this precision.
    pub(super) fn stored(self, weights: &ModelWeights) -> anyhow::Result<StoredTensors> {
        match self {
            Self::F32 => Ok(weights.to_stored(Precision::Single)?),
            Self::F16 => Ok(weights.to_stored(Precision::Half)?),
            Self::Bf16 => {
                let mut stored = weights.to_stored(Precision::Single)?;
                for (name, tensor) in &mut stored.tensors {
                    *tensor = brain_float(tensor).with_context(|| format!("tensor {name}"))?;
                }
                let digest = stored.digest();
                stored.metadata.insert(DIGEST_KEY.to_owned(), digest);
                Ok(stored)
            }
        }
    }
}

/// Rounded to nearest even, as the other precisions are.
fn brain_float(tensor: &StoredTensor) -> anyhow::Result<StoredTensor> {
    let values: Vec<bf16> = tensor.to_f32()?.into_iter().map(bf16::from_f32).collect();
    if let Some(at) = values.iter().position(|value| !value.is_finite()) {
        bail!("number {at} is beyond what bf16 can hold");
    }
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
    Ok(StoredTensor::new(DType::Bf16, tensor.shape().to_vec(), SharedBytes::new(bytes))?)
}
