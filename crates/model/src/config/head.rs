use serde::{Deserialize, Serialize};

use super::{Grid, OffsetActivation, OpacityActivation, QuaternionActivation, ScaleActivation};

/// The Gaussian head: layer norm and a 2-layer MLP, from a token to `K` Gaussians (paper, "Anchors to local
/// 3D Gaussians").
///
/// A token's outputs are ordered by Gaussian; for each: centre (3, or 1 for a depth), quaternion `w, x, y, z`, scale (3),
/// opacity, then spherical harmonics, red, green, blue of the first coefficient before those of the second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct HeadConfig {
    /// Gaussians of a token; `K` = 16 in the paper.
    pub gaussians_per_token: usize,
    /// Cells into which a token's patch is divided, if they are more than the token's Gaussians, which then have the first of
    /// them: only the first Gaussians of each token are kept ([`Self::keeping_first`]). Used by [`HeadFrame::Patch`] and
    /// [`super::AnchorDesign::RayDepth`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub patch_cells: Option<usize>,
    /// Degree of the spherical harmonics, up to 4; the paper gives none, and iLRM's code uses only 0. Their coefficients are the
    /// raw outputs.
    pub sh_degree: u8,
    /// Frame of offsets and scales.
    #[serde(default, skip_serializing_if = "HeadFrame::is_world")]
    pub frame: HeadFrame,
    /// Offset from the anchor, or centre; in the world's frame.
    pub offset: OffsetActivation,
    /// Rotation.
    pub quaternion: QuaternionActivation,
    /// Standard deviations; in the world's frame.
    pub scale: ScaleActivation,
    /// Opacity.
    pub opacity: OpacityActivation,
}

/// Frame of a Gaussian's offset from its anchor and of its standard deviations. Rotations are relative to the world's axes
/// in both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum HeadFrame {
    /// The world's axes and scene units, with the activations [`HeadConfig::offset`] and [`HeadConfig::scale`].
    #[default]
    World,
    /// The axes of the context camera whose patch the token came from, in units of the patch's footprint, which is the
    /// anchor's depth · patch width / focal length. The patch is divided into as many cells as a token has Gaussians
    /// ([`HeadConfig::cells`]); an offset is `cell + 0.5 · x`, with `cell` the vector from the patch's centre to its cell's
    /// centre, and a scale is `e^min(x + ln(0.6 / columns), 0.7)`. Both are multiplied by the footprint; [`HeadConfig::offset`] and
    /// [`HeadConfig::scale`] are not used. Children keep their parent's frame.
    Patch,
}

impl HeadFrame {
    /// Whether the frame is the world's.
    pub const fn is_world(&self) -> bool {
        matches!(self, Self::World)
    }
}

impl HeadConfig {
    /// Grid of a patch's cells, one per Gaussian of a token unless [`Self::patch_cells`] says more: as square as possible, with at
    /// most as many rows as columns.
    pub fn cells(&self) -> Grid {
        let count = self.patch_cells.unwrap_or(self.gaussians_per_token);
        let divides = |rows: &usize| count.is_multiple_of(*rows) && rows * rows <= count;
        let rows = (1..=count).take_while(|rows| rows * rows <= count).filter(divides).last().unwrap_or(1);
        Grid { rows, columns: count / rows }
    }

    /// The head that gives only the first `count` Gaussians of each token, as they are now; it needs the first rows of the last
    /// layer's weights. If there are fewer, a head of `count` Gaussians.
    #[must_use]
    pub fn keeping_first(&self, count: usize) -> Self {
        let cells = self.patch_cells.unwrap_or(self.gaussians_per_token);
        Self { gaussians_per_token: count, patch_cells: (cells > count).then_some(cells), ..self.clone() }
    }

    /// Spherical-harmonics coefficients per colour channel.
    pub const fn sh_coefficients(&self) -> usize {
        (self.sh_degree as usize + 1) * (self.sh_degree as usize + 1)
    }

    /// Number of outputs for one Gaussian whose centre takes `centre_channels`.
    pub const fn channels(&self, centre_channels: usize) -> usize {
        centre_channels + 4 + 3 + 1 + 3 * self.sh_coefficients()
    }
}
