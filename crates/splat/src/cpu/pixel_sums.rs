//! What the backward pass sums over a cell's pixels for each splat, by index.
//!
//! Moments come first: of the gradient `e` with respect to the exponent `½ dᵀ Σ⁻¹ d`, with `x` and `y` in pixels from the
//! splat's base. For a splat that [`is_slanted`](super::project::is_slanted), the whitened coordinate `u` takes the place of
//! `x`. Then come the gradients with respect to the splat's channels.

pub(super) const E: usize = 0;
pub(super) const EX: usize = 1;
pub(super) const EY: usize = 2;
pub(super) const EXX: usize = 3;
pub(super) const EXY: usize = 4;
pub(super) const EYY: usize = 5;
/// Red; then green and blue.
pub(super) const RGB: usize = 6;
pub(super) const DEPTH: usize = 9;
pub(super) const SCALAR: usize = 10;

/// Number of sums.
pub(super) const SUMS: usize = 11;
/// Number of sums without depth and scalar, which come last.
pub(super) const SUMS_OF_COLOUR: usize = DEPTH;

/// In place of depth and scalar: the gradient's magnitude with respect to the centre, along columns and rows, divided by
/// [`ABSOLUTE_UNIT`].
pub(super) const ABSOLUTE: [usize; 2] = [DEPTH, SCALAR];

/// The exponent is `ln 2` times a sum of two squares.
pub(super) const ABSOLUTE_UNIT: f64 = 2.0 * std::f64::consts::LN_2;
