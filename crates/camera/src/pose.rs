use atsplat_numeric::Extremes;
use glam::{DMat3, DVec3};

use crate::CameraError;
use crate::error::{finite, positive};

/// Largest entry of `R Rᵀ − I` that poses accept as the rounding of a rotation.
pub const ROTATION_RESIDUAL_LIMIT: f64 = 1e-2;

/// Largest absolute entry of `R Rᵀ − I`: how far a 3×3 matrix is from a rotation. NaN if an entry is.
pub fn orthonormality_residual(rotation: DMat3) -> f64 {
    let deviation = rotation * rotation.transpose() - DMat3::IDENTITY;
    deviation.to_cols_array().iter().fold(0.0, |worst: f64, entry| worst.maximum_of(entry.abs()))
}

/// The 3×4 matrix `[R | t]` of both pose types.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rigid {
    rotation: DMat3,
    translation: DVec3,
}

impl Rigid {
    fn from_rows(rows: &[f64; 12]) -> Result<Self, CameraError> {
        for value in rows {
            finite("pose", *value)?;
        }
        let [m00, m01, m02, t0, m10, m11, m12, t1, m20, m21, m22, t2] = *rows;
        let rotation = DMat3::from_cols_array(&[m00, m10, m20, m01, m11, m21, m02, m12, m22]);
        Self::new(rotation, DVec3::new(t0, t1, t2))
    }

    fn new(rotation: DMat3, translation: DVec3) -> Result<Self, CameraError> {
        let (determinant, residual) = (rotation.determinant(), orthonormality_residual(rotation));
        let is_rotation = residual <= ROTATION_RESIDUAL_LIMIT && determinant > 0.0;
        if !is_rotation {
            return Err(CameraError::NotARotation { determinant, residual });
        }
        for (field, value) in
            [("translation x", translation.x), ("translation y", translation.y), ("translation z", translation.z)]
        {
            finite(field, value)?;
        }
        Ok(Self { rotation, translation })
    }

    fn rows(&self) -> [f64; 12] {
        let (r, t) = (self.rotation, self.translation);
        [
            r.x_axis.x, r.y_axis.x, r.z_axis.x, t.x, //
            r.x_axis.y, r.y_axis.y, r.z_axis.y, t.y, //
            r.x_axis.z, r.y_axis.z, r.z_axis.z, t.z,
        ]
    }

    /// The general inverse instead of the transpose: a stored rotation is rounded to f32 or nine decimals, and only this
    /// makes `pose · inverse` the identity, as in the papers' loaders.
    fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    fn then(&self, first: &Self) -> Self {
        Self {
            rotation: self.rotation * first.rotation,
            translation: self.rotation * first.translation + self.translation,
        }
    }

    fn apply(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }
}

macro_rules! pose_methods {
    ($pose:ident, $inverse:ident) => {
        impl $pose {
            /// The identity.
            pub const IDENTITY: Self = Self(Rigid { rotation: DMat3::IDENTITY, translation: DVec3::ZERO });

            /// A pose from a rotation and a translation in scene units.
            ///
            /// # Errors
            /// [`CameraError::NotARotation`] if the matrix is far from a rotation, [`CameraError::NonFinite`] for NaN
            /// or infinite numbers.
            pub fn new(rotation: DMat3, translation: DVec3) -> Result<Self, CameraError> {
                Rigid::new(rotation, translation).map(Self)
            }

            /// A pose from the row-major 3×4 matrix `[R | t]`.
            ///
            /// The rotation is not re-orthonormalised: files store it with nine decimals or as f32, and every loader of
            /// the field uses those numbers.
            ///
            /// # Errors
            /// Those of [`Self::new`].
            pub fn from_rows(rows: &[f64; 12]) -> Result<Self, CameraError> {
                Rigid::from_rows(rows).map(Self)
            }

            /// The row-major 3×4 matrix `[R | t]`.
            pub fn to_rows(&self) -> [f64; 12] {
                self.0.rows()
            }

            /// The 3×3 part.
            pub const fn rotation(&self) -> DMat3 {
                self.0.rotation
            }

            /// The fourth column, in scene units.
            pub const fn translation(&self) -> DVec3 {
                self.0.translation
            }

            /// The inverse transform.
            pub fn inverse(&self) -> $inverse {
                $inverse(self.0.inverse())
            }

            /// Transforms a point.
            pub fn transform_point(&self, point: DVec3) -> DVec3 {
                self.0.apply(point)
            }

            /// Transforms a direction: rotates without translating.
            pub fn transform_vector(&self, vector: DVec3) -> DVec3 {
                self.0.rotation * vector
            }

            /// Determinant of the 3×3 part; 1 for a perfect rotation.
            pub fn determinant(&self) -> f64 {
                self.0.rotation.determinant()
            }

            /// Largest absolute entry of `R Rᵀ − I`: how far the 3×3 part is from a rotation.
            pub fn orthonormality_residual(&self) -> f64 {
                orthonormality_residual(self.0.rotation)
            }
        }
    };
}

/// World-to-camera transform ("extrinsics", "w2c"), as stored by RE10K (pixelSplat `dataset_re10k.py:179-197`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraFromWorld(Rigid);

/// Camera-to-world transform ("c2w"): its columns are the camera's right, down and forward axes and its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldFromCamera(Rigid);

pose_methods!(CameraFromWorld, WorldFromCamera);
pose_methods!(WorldFromCamera, CameraFromWorld);

impl CameraFromWorld {
    /// Stands for a pose that is not known: the centre is NaN, so that everything computed from it is NaN too. No
    /// constructor returns it.
    pub const UNKNOWN: Self = Self(Rigid { rotation: DMat3::IDENTITY, translation: DVec3::NAN });
}

impl WorldFromCamera {
    /// A pose from parts that are rigid and finite by construction.
    pub(crate) const fn from_parts(rotation: DMat3, translation: DVec3) -> Self {
        Self(Rigid { rotation, translation })
    }

    /// The camera's centre in the world.
    pub const fn centre(&self) -> DVec3 {
        self.0.translation
    }

    /// The camera's +x axis in the world.
    pub const fn right(&self) -> DVec3 {
        self.0.rotation.x_axis
    }

    /// The camera's +y axis in the world.
    pub const fn down(&self) -> DVec3 {
        self.0.rotation.y_axis
    }

    /// The camera's +z axis in the world.
    pub const fn forward(&self) -> DVec3 {
        self.0.rotation.z_axis
    }

    /// Converts OpenGL or Blender camera axes (+x right, +y up, +z back) to OpenCV axes: `c2w · diag(1, −1, −1, 1)`. The
    /// world is unchanged (nerfstudio `docs/quickstart/data_conventions.md`; depthsplat
    /// `src/scripts/convert_dl3dv_test.py:90-129`). The conversion is its own inverse.
    #[must_use]
    pub fn opencv_from_opengl(&self) -> Self {
        let r = self.0.rotation;
        let rotation = DMat3::from_cols(r.x_axis, -r.y_axis, -r.z_axis);
        Self(Rigid { rotation, translation: self.0.translation })
    }

    /// Converts OpenCV camera axes to OpenGL or Blender axes; the inverse of [`Self::opencv_from_opengl`].
    #[must_use]
    pub fn opengl_from_opencv(&self) -> Self {
        self.opencv_from_opengl()
    }

    /// The pose of `other` relative to this camera: `self⁻¹ · other`.
    #[must_use]
    pub fn camera_from_other(&self, other: &Self) -> Self {
        Self(self.0.inverse().then(&other.0))
    }

    /// The camera after a rigid motion of the world, `new_from_old · self`.
    #[must_use]
    pub fn moved_by(&self, new_from_old: &Self) -> Self {
        Self(new_from_old.0.then(&self.0))
    }

    /// The camera after scaling the world by `factor`.
    ///
    /// # Errors
    /// [`CameraError::NonFinite`] and [`CameraError::NotPositive`] for the factor.
    pub fn scaled_by(&self, factor: f64) -> Result<Self, CameraError> {
        let translation = self.0.translation * positive("scale", factor)?;
        Ok(Self(Rigid { rotation: self.0.rotation, translation }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    fn quarter_turn_about_y() -> WorldFromCamera {
        WorldFromCamera::new(DMat3::from_rotation_y(std::f64::consts::FRAC_PI_2), DVec3::new(1.0, 2.0, 3.0)).unwrap()
    }

    #[test]
    fn rows_round_trip_bit_for_bit() {
        let rows = [1.0, 0.0, 0.0, 0.25, 0.0, 0.0, -1.0, 0.5, 0.0, 1.0, 0.0, -4.0];
        Tolerance::EXACT.assert(CameraFromWorld::from_rows(&rows).unwrap().to_rows(), rows, "rows");
    }

    #[test]
    fn axes_are_the_columns() {
        let pose = quarter_turn_about_y();
        Tolerance::F64.assert(pose.forward().to_array(), [1.0, 0.0, 0.0], "forward");
        Tolerance::F64.assert(pose.transform_point(DVec3::Z).to_array(), [2.0, 2.0, 3.0], "one unit ahead");
    }

    #[test]
    fn inverse_inverts() {
        let pose = quarter_turn_about_y();
        Tolerance::F64.assert(pose.inverse().transform_point(pose.centre()).to_array(), [0.0; 3], "own centre");
        Tolerance::F64.assert(pose.inverse().inverse().to_rows(), pose.to_rows(), "twice");
    }

    #[test]
    fn opengl_and_opencv_are_inverse_and_flip_y_and_z() {
        let pose = quarter_turn_about_y();
        let flipped = pose.opencv_from_opengl();
        assert_eq!(flipped.opengl_from_opencv(), pose);
        assert_eq!((flipped.right(), flipped.down(), flipped.forward()), (pose.right(), -pose.down(), -pose.forward()));
    }

    #[test]
    fn reflections_scales_and_nan_are_errors() {
        let mut rows = WorldFromCamera::IDENTITY.to_rows();
        rows[0] = -1.0;
        assert!(matches!(WorldFromCamera::from_rows(&rows), Err(CameraError::NotARotation { .. })), "reflection");
        rows[0] = 2.0;
        assert!(matches!(WorldFromCamera::from_rows(&rows), Err(CameraError::NotARotation { .. })), "scale");
        rows[0] = f64::NAN;
        assert!(matches!(WorldFromCamera::from_rows(&rows), Err(CameraError::NonFinite { .. })), "NaN");
        rows = WorldFromCamera::IDENTITY.to_rows();
        rows[3] = f64::INFINITY;
        assert!(matches!(WorldFromCamera::from_rows(&rows), Err(CameraError::NonFinite { .. })), "far away");
    }

    #[test]
    fn scales_are_positive_and_finite() {
        let pose = quarter_turn_about_y();
        let scaled = pose.scaled_by(0.25).unwrap();
        Tolerance::EXACT.assert(scaled.centre().to_array(), [0.25, 0.5, 0.75], "centre");
        assert_eq!(scaled.rotation(), pose.rotation());
        for factor in [f64::NAN, f64::INFINITY] {
            assert!(matches!(pose.scaled_by(factor), Err(CameraError::NonFinite { field: "scale", .. })), "{factor}");
        }
        for factor in [0.0, -2.0] {
            assert!(matches!(pose.scaled_by(factor), Err(CameraError::NotPositive { field: "scale", .. })), "{factor}");
        }
    }

    #[test]
    fn everything_computed_from_the_centre_of_an_unknown_pose_is_nan() {
        let unknown = CameraFromWorld::UNKNOWN.inverse();
        assert!(unknown.centre().is_nan() && quarter_turn_about_y().camera_from_other(&unknown).centre().is_nan());
        assert!(CameraFromWorld::from_rows(&CameraFromWorld::UNKNOWN.to_rows()).is_err());
    }

    #[test]
    fn a_zero_matrix_is_not_a_rotation() {
        assert!(CameraFromWorld::from_rows(&[0.0; 12]).is_err());
    }
}
