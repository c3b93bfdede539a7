use serde::{Deserialize, Serialize};

use super::{OffsetActivation, OpacityActivation, QuaternionActivation, ScaleActivation};

/// The Gaussian head: layer norm and a 2-layer MLP, from a token to `K` Gaussians (paper, "Anchors to local
/// 3D Gaussians").
///
/// A token's outputs are those of its first Gaussian, then those of its second, …; of each: centre (3, or 1
/// for a depth), quaternion `w, x, y, z`, scale (3), opacity, then spherical harmonics, red, green, blue of the
/// first coefficient before those of the second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct HeadConfig {
    /// Gaussians of a token; `K` = 16 in the paper.
    pub gaussians_per_token: usize,
    /// Degree of the spherical harmonics, up to 4; iLRM's code uses 0 alone. Their coefficients are the raw outputs.
    pub sh_degree: u8,
    /// Offset from the anchor, or centre.
    pub offset: OffsetActivation,
    /// Rotation.
    pub quaternion: QuaternionActivation,
    /// Standard deviations.
    pub scale: ScaleActivation,
    /// Opacity.
    pub opacity: OpacityActivation,
}

impl HeadConfig {
    /// Spherical-harmonics coefficients per colour channel.
    pub const fn sh_coefficients(&self) -> usize {
        (self.sh_degree as usize + 1) * (self.sh_degree as usize + 1)
    }

    /// Outputs for one Gaussian whose centre takes `centre_channels`.
    pub const fn channels(&self, centre_channels: usize) -> usize {
        centre_channels + 4 + 3 + 1 + 3 * self.sh_coefficients()
    }
}
