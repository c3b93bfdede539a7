/// One Gaussian as the picture sees it, in one line of the cache.
///
/// Pixels are counted from `base`, a pixel near the centre: the differences are whole numbers, which f32 holds
/// exactly, so that a pixel's value does not depend on the tile that it is composited in.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct Splat {
    /// `√(½ log₂e)` times the Cholesky factor `(l₁₁, l₁₂, l₂₂)` of the inverse screen covariance: the exponent to
    /// base 2 is `−(l₁₁·dx + l₁₂·dy)² − (l₂₂·dy)²`. A sum of squares does not cancel where the Gaussian is a needle.
    pub(super) whitener: [f32; 3],
    /// What the whitener makes of the way from the centre to the base.
    pub(super) shift: [f32; 2],
    pub(super) base: [i32; 2],
    pub(super) opacity: f32,
    pub(super) rgb: [f32; 3],
    pub(super) depth: f32,
    pub(super) scalar: f32,
    /// `log₂(opacity / min_alpha)`, a little more: beyond this exponent nothing is drawn.
    pub(super) cut: f32,
    /// First and one past the last column, then row, that it may reach.
    pub(super) reach: [[u16; 2]; 2],
}

/// `√(½ log₂e)`.
pub(super) const HALF_LOG2_E: f64 = 0.849_321_800_288_019;
