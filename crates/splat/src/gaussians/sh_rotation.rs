//! Rotation of spherical-harmonics coefficients.

use std::f64::consts::TAU;

use atsplat_numeric::GAUSS_LEGENDRE;
use glam::{DMat3, DVec3};

use super::{MAX_SH_DEGREE, sh_coefficients};
use crate::sh::basis;

/// Azimuths per ring, exact up to frequency 10; with the five rings of [`GAUSS_LEGENDRE`], exact for products of two functions of degree 4.
const AZIMUTHS: u32 = 11;
/// Entries this close to −1, 0 or 1 are rounded to it, so that swapping or flipping axes is exact.
const ROUNDING: f64 = 1e-13;

/// Matrix from coefficients in old axes to coefficients in new axes, block-diagonal by band.
///
/// Band l's matrix is `∫ Y(d) Y(Rᵀd)ᵀ dd`, evaluated by a quadrature of 55 directions, exact up to rounding; unlike a
/// recursion, it follows the basis's signs and order by construction.
pub(super) struct ShRotation([[f64; 25]; 25]);

impl ShRotation {
    /// For directions that map as `new = new_from_old · old`; reflections are allowed too.
    pub(super) fn new(new_from_old: DMat3) -> Self {
        let mut matrix = [[0.0; 25]; 25];
        for (direction, weight) in sphere() {
            let new = basis(MAX_SH_DEGREE, direction.to_array());
            let old = basis(MAX_SH_DEGREE, (new_from_old.transpose() * direction).to_array());
            for (row, new) in matrix.iter_mut().zip(new) {
                for (entry, old) in row.iter_mut().zip(old) {
                    *entry += weight * new * old;
                }
            }
        }
        for entry in matrix.as_flattened_mut() {
            let rounded = entry.round();
            if (*entry - rounded).abs() < ROUNDING {
                *entry = rounded;
            }
        }
        Self(matrix)
    }

    /// Rotates the coefficients of one Gaussian.
    #[expect(clippy::cast_possible_truncation, reason = "coefficients are stored as f32")]
    pub(super) fn apply(&self, coefficients: &mut [[f32; 3]]) {
        for degree in 1..=MAX_SH_DEGREE {
            let band = sh_coefficients(degree - 1)..sh_coefficients(degree);
            let (Some(rows), Some(values)) = (self.0.get(band.clone()), coefficients.get_mut(band.clone())) else {
                return;
            };
            let mut old = [[0.0; 3]; 9];
            old.iter_mut().zip(&*values).for_each(|(old, value)| *old = value.map(f64::from));
            for (value, row) in values.iter_mut().zip(rows) {
                let mut sum = [0.0; 3];
                for (weight, old) in row.iter().skip(band.start).zip(&old).take(band.len()) {
                    sum.iter_mut().zip(old).for_each(|(sum, old)| *sum += weight * old);
                }
                *value = sum.map(|sum| sum as f32);
            }
        }
    }
}

/// Directions and weights that integrate polynomials up to degree 9 over the unit sphere.
fn sphere() -> impl Iterator<Item = (DVec3, f64)> {
    GAUSS_LEGENDRE.into_iter().flat_map(|(z, weight)| {
        let radius = (1.0 - z * z).sqrt();
        (0..AZIMUTHS).map(move |step| {
            let (sin, cos) = (TAU * f64::from(step) / f64::from(AZIMUTHS)).sin_cos();
            (DVec3::new(radius * cos, radius * sin, z), weight * TAU / f64::from(AZIMUTHS))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;
    use glam::DQuat;
    use proptest::prelude::*;

    fn value(coefficients: &[[f32; 3]], direction: DVec3) -> [f64; 3] {
        let basis = basis(MAX_SH_DEGREE, direction.to_array());
        [0, 1, 2]
            .map(|channel| basis.iter().zip(coefficients).map(|(basis, rgb)| basis * f64::from(rgb[channel])).sum())
    }

    fn unit() -> impl Strategy<Value = DVec3> {
        prop::array::uniform3(-1.0..1.0f64)
            .prop_map(DVec3::from_array)
            .prop_filter("too short", |v| v.length() > 0.1)
            .prop_map(DVec3::normalize)
    }

    fn coefficients() -> impl Strategy<Value = Vec<[f32; 3]>> {
        let rgb = || prop::array::uniform3(-1.0..1.0f32);
        (0..=MAX_SH_DEGREE).prop_flat_map(move |degree| prop::collection::vec(rgb(), sh_coefficients(degree)))
    }

    proptest! {
        /// Rotated coefficients give in the rotated direction the colour that the originals give in the original
        /// direction.
        #[test]
        fn rotated_coefficients_in_rotated_directions(
            old in coefficients(), axis in unit(), angle in -4.0..4.0, direction in unit(), mirrored: bool,
        ) {
            let mut matrix = DMat3::from_quat(DQuat::from_axis_angle(axis, angle));
            if mirrored {
                matrix = DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)) * matrix;
            }
            let mut new = old.clone();
            ShRotation::new(matrix).apply(&mut new);
            let outcome = Tolerance::absolute(1e-6).check(value(&new, matrix * direction), value(&old, direction));
            prop_assert!(outcome.is_ok(), "{outcome:?}");
        }
    }

    #[test]
    fn identity_and_half_turns_are_exact() {
        let old: Vec<[f32; 3]> = (0..25u8).map(|n| [f32::from(n), 0.1 * f32::from(n), -1e-30]).collect();
        let mut same = old.clone();
        ShRotation::new(DMat3::IDENTITY).apply(&mut same);
        assert_eq!(same, old);
        let half_turn = ShRotation::new(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
        half_turn.apply(&mut same);
        let magnitudes = |values: &[[f32; 3]]| values.iter().flatten().map(|value| value.abs()).collect::<Vec<_>>();
        assert_eq!(magnitudes(&same), magnitudes(&old));
        half_turn.apply(&mut same);
        assert_eq!(same, old);
    }
}
