use std::fmt::{self, Display, Formatter};

use pulp::{Scalar256b, Simd, WithSimd};

/// Instruction sets for compositing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SimdLevel {
    /// Available on every CPU; without fused multiply-add, so that results differ from the other levels in the last
    /// bits.
    Portable,
    /// 8 lanes: AVX2 and FMA.
    #[cfg(target_arch = "x86_64")]
    Avx2,
    /// 16 lanes: AVX-512 F, BW, CD, DQ and VL.
    #[cfg(target_arch = "x86_64")]
    Avx512,
    /// 4 lanes.
    #[cfg(target_arch = "aarch64")]
    Neon,
    /// 4 lanes, otherwise as [`Self::Portable`].
    #[cfg(test)]
    Lanes4,
    /// 16 lanes, otherwise as [`Self::Portable`].
    #[cfg(test)]
    Lanes16,
    /// 4 lanes with fused multiply-add.
    #[cfg(all(test, target_arch = "x86_64"))]
    Fused4,
    /// 16 lanes with fused multiply-add.
    #[cfg(all(test, target_arch = "x86_64"))]
    Fused16,
}

impl SimdLevel {
    /// The best level that this CPU supports.
    pub fn best() -> Self {
        Self::available().last().copied().unwrap_or(Self::Portable)
    }

    /// Every level that this CPU supports, best last.
    pub fn available() -> Vec<Self> {
        let mut levels = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            levels.extend(pulp::x86::V3::try_new().map(|_| Self::Avx2));
            levels.extend(pulp::x86::V4::try_new().map(|_| Self::Avx512));
        }
        #[cfg(target_arch = "aarch64")]
        levels.extend(pulp::aarch64::Neon::try_new().map(|_| Self::Neon));
        levels
    }

    /// Levels with fused multiply-add, including lane counts that this CPU does not have natively.
    #[cfg(test)]
    pub(super) fn with_fma() -> Vec<Self> {
        let mut levels = Self::available();
        levels.retain(|level| *level != Self::Portable);
        #[cfg(target_arch = "x86_64")]
        if !levels.is_empty() {
            levels.extend([Self::Fused4, Self::Fused16]);
        }
        levels
    }

    /// This level, or [`Self::Portable`] if the CPU lacks it: the level that [`Self::dispatch`] uses.
    pub(super) fn or_portable(self) -> Self {
        #[cfg(test)]
        if matches!(self, Self::Lanes4 | Self::Lanes16) || Self::with_fma().contains(&self) {
            return self;
        }
        if Self::available().contains(&self) { self } else { Self::Portable }
    }

    /// Runs an operation at this level, or portably if the CPU lacks it.
    pub(crate) fn dispatch<O: WithSimd>(self, operation: O) -> O::Output {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                if let Some(simd) = pulp::x86::V3::try_new() {
                    return Simd::vectorize(simd, operation);
                }
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                if let Some(simd) = pulp::x86::V4::try_new() {
                    return Simd::vectorize(simd, operation);
                }
            }
            #[cfg(target_arch = "aarch64")]
            Self::Neon => {
                if let Some(simd) = pulp::aarch64::Neon::try_new() {
                    return Simd::vectorize(simd, operation);
                }
            }
            Self::Portable => {}
            #[cfg(test)]
            Self::Lanes4 => return Simd::vectorize(pulp::Scalar128b, operation),
            #[cfg(test)]
            Self::Lanes16 => return Simd::vectorize(pulp::Scalar512b, operation),
            #[cfg(all(test, target_arch = "x86_64"))]
            Self::Fused4 => {
                if let Some(simd) = pulp::x86::V3::try_new() {
                    return Simd::vectorize(pulp::x86::V3_128b(simd), operation);
                }
            }
            #[cfg(all(test, target_arch = "x86_64"))]
            Self::Fused16 => {
                if let Some(simd) = pulp::x86::V3::try_new() {
                    return Simd::vectorize(pulp::x86::V3_512b(simd), operation);
                }
            }
        }
        Simd::vectorize(Scalar256b, operation)
    }
}

impl Display for SimdLevel {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Portable => "portable",
            #[cfg(test)]
            Self::Lanes4 => "4 lanes",
            #[cfg(test)]
            Self::Lanes16 => "16 lanes",
            #[cfg(all(test, target_arch = "x86_64"))]
            Self::Fused4 => "4 fused lanes",
            #[cfg(all(test, target_arch = "x86_64"))]
            Self::Fused16 => "16 fused lanes",
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => "avx2",
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => "avx512",
            #[cfg(target_arch = "aarch64")]
            Self::Neon => "neon",
        })
    }
}

impl Default for SimdLevel {
    fn default() -> Self {
        Self::best()
    }
}
