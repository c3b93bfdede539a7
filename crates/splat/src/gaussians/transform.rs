use std::ops::RangeInclusive;

use atsplat_camera::{ROTATION_RESIDUAL_LIMIT, Similarity, orthonormality_residual};
use glam::{DMat3, DQuat, DVec3};

use super::sh_rotation::ShRotation;
use super::{Gaussians, sh_coefficients};
use crate::{ShAxes, SplatError};

/// Largest entry of `R Rᵀ − I`: similarities contain the rotations of poses and their inverses, which deviate up to three times as much.
const ROTATION_LIMIT: f64 = 4.0 * ROTATION_RESIDUAL_LIMIT;

impl Gaussians {
    /// [`Self::transformed_in`] 3DGS's axes.
    ///
    /// # Errors
    /// As there.
    pub fn transformed(&self, similarity: &Similarity) -> Result<Self, SplatError> {
        self.transformed_in(similarity, ShAxes::Standard)
    }

    /// Applies a similarity to means, covariances, filters and spherical harmonics. Computed in f64, stored as f32.
    ///
    /// `axes` are those in which the harmonics are evaluated, [`crate::RendererConstants::sh_axes`]: the same coefficients are
    /// other functions in other axes, and are rotated otherwise.
    ///
    /// # Errors
    /// [`SplatError::Similarity`] for a scale that is not positive and finite, or a matrix that is farther from a rotation than the
    /// rounding of a pose.
    pub fn transformed_in(&self, similarity: &Similarity, axes: ShAxes) -> Result<Self, SplatError> {
        let invalid = |what, expected, found| Err(SplatError::Similarity { what, expected, found });
        if !(similarity.scale > 0.0 && similarity.scale.is_finite()) {
            return invalid("scale", "a positive number", similarity.scale);
        }
        let off = orthonormality_residual(similarity.rotation);
        if !(off <= ROTATION_LIMIT) {
            return invalid("largest deviation of the rotation from orthonormality", "almost 0", off);
        }
        let determinant = similarity.rotation.determinant();
        if !(determinant > 0.0) {
            return invalid("rotation's determinant", "1", determinant);
        }
        let mut parts = self.parts().clone();
        for mean in &mut parts.means {
            *mean = narrow(similarity.new_from_old(DVec3::from_array(mean.map(f64::from))).to_array());
        }
        let rotation = DQuat::from_mat3(&similarity.rotation).normalize();
        for quaternion in &mut parts.quaternions {
            let [w, x, y, z] = quaternion.map(f64::from);
            let rotated = rotation * storable(DQuat::from_xyzw(x, y, z, w));
            *quaternion = narrow([rotated.w, rotated.x, rotated.y, rotated.z]);
        }
        for log_scales in &mut parts.log_scales {
            *log_scales = narrow(log_scales.map(|log_scale| f64::from(log_scale) + similarity.scale.ln()));
        }
        for filter in parts.filter_3d.iter_mut().flatten() {
            [*filter] = narrow([f64::from(*filter) * similarity.scale]);
        }
        if parts.sh_degree > 0 {
            // From the unit quaternion: the quadrature needs an exact rotation, and a matrix from a file is only nearly
            // one.
            let sh_rotation = ShRotation::new(axes.rotation(DMat3::from_quat(rotation)));
            parts.sh.chunks_exact_mut(sh_coefficients(parts.sh_degree)).for_each(|of_one| sh_rotation.apply(of_one));
        }
        Ok(Self(parts))
    }
}

/// The unit quaternion in place of one so short that f32 keeps only some digits of its parts, or so long that they may overflow.
fn storable(quaternion: DQuat) -> DQuat {
    const LENGTHS: RangeInclusive<f64> = f32::MIN_POSITIVE as f64..=f32::MAX as f64;
    let length = quaternion.length();
    let is_rotation = length > 0.0 && length.is_finite();
    if is_rotation && !LENGTHS.contains(&length) { quaternion / length } else { quaternion }
}

#[expect(clippy::cast_possible_truncation, reason = "Gaussians are stored as f32")]
fn narrow<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|value| value as f32)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::WorldFromCamera;
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::GaussianParts;
    use crate::sh::basis;

    fn one() -> Gaussians {
        Gaussians::new(GaussianParts {
            means: vec![[1.0, -2.0, 0.5]],
            quaternions: vec![[0.5, -0.2, 0.7, 0.3]],
            log_scales: vec![[-1.0, 0.0, 0.7]],
            opacity_logits: vec![1.0],
            sh_degree: 4,
            sh: (0..25u8).map(|n| [f32::from(n) * 0.1, 1.0 - f32::from(n) * 0.07, 0.3]).collect(),
            scalars: Some(vec![0.4]),
            filter_3d: Some(vec![0.25]),
        })
        .unwrap()
    }

    fn similarity() -> Similarity {
        let rotation = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.5).normalize(), 1.1));
        Similarity { rotation, origin: DVec3::new(0.3, 1.0, -2.0), scale: 2.5 }
    }

    fn covariance(gaussians: &Gaussians) -> DMat3 {
        let [w, x, y, z] = gaussians.parts().quaternions[0].map(f64::from);
        let scales = DVec3::from_array(gaussians.parts().log_scales[0].map(|log| f64::from(log).exp()));
        let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()) * DMat3::from_diagonal(scales);
        axes * axes.transpose()
    }

    fn colour(gaussians: &Gaussians, direction: DVec3) -> [f64; 3] {
        let basis = basis(4, direction.to_array());
        [0, 1, 2].map(|channel| {
            gaussians.parts().sh.iter().zip(basis).map(|(sh, basis)| f64::from(sh[channel]) * basis).sum()
        })
    }

    #[test]
    fn transforms_every_field() {
        let (old, similarity) = (one(), similarity());
        let new = old.transformed(&similarity).unwrap();
        let expected = similarity.new_from_old(DVec3::new(1.0, -2.0, 0.5));
        Tolerance::F32_ROUND_TRIP.assert(new.parts().means[0].map(f64::from), expected.to_array(), "mean");
        let r = similarity.rotation;
        let turned = r * covariance(&old) * r.transpose() * (similarity.scale * similarity.scale);
        Tolerance { absolute: 1e-5, relative: 1e-5 }.assert(
            covariance(&new).to_cols_array(),
            turned.to_cols_array(),
            "covariance",
        );
        let direction = DVec3::new(0.2, -0.9, 0.4).normalize();
        Tolerance::absolute(2e-6).assert(colour(&new, r * direction), colour(&old, direction), "colour");
        assert_eq!(new.parts().filter_3d, Some(vec![0.625]));
        assert_eq!(new.parts().scalars, old.parts().scalars);
    }

    #[test]
    fn a_similarity_and_its_inverse_are_the_identity() {
        let back = one().transformed(&similarity()).unwrap().transformed(&similarity().inverse()).unwrap();
        let flat = |g: &Gaussians| g.parts().sh.iter().flatten().map(|value| f64::from(*value)).collect::<Vec<_>>();
        Tolerance::F32_ROUND_TRIP.assert(flat(&back), flat(&one()), "colours");
    }

    #[test]
    fn the_identity_is_exact() {
        assert_eq!(one().transformed(&Similarity::IDENTITY).unwrap(), one());
    }

    /// Relative to the first camera of a file with three decimals, and back.
    #[test]
    fn accepts_the_rotations_of_poses_and_their_inverses() {
        let rounded = similarity().rotation.to_cols_array().map(|entry| (entry * 1e3).round() / 1e3);
        let pose = WorldFromCamera::new(DMat3::from_cols_array(&rounded), DVec3::new(0.3, 1.0, -2.0)).unwrap();
        assert!(pose.orthonormality_residual() > 2e-4, "{}", pose.orthonormality_residual());
        let relative = Similarity { rotation: pose.rotation().inverse(), origin: pose.centre(), scale: 2.5 };
        let squared_norm =
            |gaussians: &Gaussians| gaussians.parts().quaternions[0].map(|part| part * part).iter().sum::<f32>();
        for similarity in [relative, relative.inverse()] {
            let new = one().transformed(&similarity).unwrap();
            let expected = similarity.new_from_old(DVec3::new(1.0, -2.0, 0.5));
            Tolerance::F32_ROUND_TRIP.assert(new.parts().means[0].map(f64::from), expected.to_array(), "mean");
            let norms = [&new, &one()].map(|gaussians| f64::from(squared_norm(gaussians)));
            Tolerance::F32_ROUND_TRIP.assert([norms[0]], [norms[1]], "the quaternion is rotated, not scaled");
        }
        let sheared = similarity().rotation * DMat3::from_cols(DVec3::X, DVec3::new(0.1, 1.0, 0.0), DVec3::Z);
        assert!(one().transformed(&Similarity { rotation: sheared, ..similarity() }).is_err());
    }

    /// Products with parts of the first are rounded to multiples of f32's smallest number, those with parts of the second may overflow.
    #[test]
    fn quaternions_at_the_ends_of_f32_are_rotated_as_others() {
        let similarity = similarity();
        for quaternion in [[3e-45, -1e-45, 4e-45, 0.0], [3e38, -2e38, 3.4e38, 1e38]] {
            let with = |quaternion| {
                let parts = GaussianParts { quaternions: vec![quaternion], ..one().into_parts() };
                Gaussians::new(parts).unwrap()
            };
            let old = with(quaternion);
            let new = old.transformed(&similarity).unwrap();
            assert!(new.validate().is_clean(), "{quaternion:?}: {:?}", new.parts().quaternions);
            let r = similarity.rotation;
            let turned = r * covariance(&old) * r.transpose() * (similarity.scale * similarity.scale);
            let near = Tolerance { absolute: 1e-5, relative: 1e-5 };
            near.assert(covariance(&new).to_cols_array(), turned.to_cols_array(), &format!("{quaternion:?}"));
        }
        let zero = GaussianParts { quaternions: vec![[0.0; 4]], ..one().into_parts() };
        let zero = Gaussians::new(zero).unwrap().transformed(&similarity).unwrap();
        assert_eq!(zero.parts().quaternions, [[0.0; 4]]);
    }

    #[test]
    fn rejects_what_is_not_a_similarity() {
        for scale in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let outcome = one().transformed(&Similarity { scale, ..similarity() });
            assert!(matches!(outcome, Err(SplatError::Similarity { what: "scale", .. })), "{scale}");
        }
        let mirror = DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
        for rotation in [mirror, 2.0 * DMat3::IDENTITY, DMat3::NAN] {
            assert!(one().transformed(&Similarity { rotation, ..similarity() }).is_err(), "{rotation}");
        }
    }
}
