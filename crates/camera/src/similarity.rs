use glam::{DMat3, DVec3};

use crate::error::finite;
use crate::{CameraError, WorldFromCamera};

/// A similarity transform of world coordinates, `new = scale · rotation · (old − origin)`.
///
/// Subtracting an origin instead of adding a translation avoids cancellation in a scene far from its world's origin. The
/// rotation is orthonormal, except for the inverse of a stored pose, which has the rounding of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Rotation from old axes to new axes.
    pub rotation: DMat3,
    /// The old point that becomes the new origin, in old scene units.
    pub origin: DVec3,
    /// New lengths over old lengths; > 0.
    pub scale: f64,
}

impl Similarity {
    /// The identity.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, origin: DVec3::ZERO, scale: 1.0 };

    /// Transforms a point to the new world.
    pub fn new_from_old(&self, old: DVec3) -> DVec3 {
        self.rotation * (old - self.origin) * self.scale
    }

    /// Transforms a point to the old world.
    pub fn old_from_new(&self, new: DVec3) -> DVec3 {
        self.rotation.inverse() * (new / self.scale) + self.origin
    }

    /// Transforms a camera to the new world: its axes are rotated, its centre is transformed.
    ///
    /// # Errors
    /// [`CameraError::NonFinite`] if the centre overflows.
    pub fn new_pose_from_old(&self, old: &WorldFromCamera) -> Result<WorldFromCamera, CameraError> {
        let centre = self.new_from_old(old.centre());
        for (field, value) in [("centre x", centre.x), ("centre y", centre.y), ("centre z", centre.z)] {
            finite(field, value)?;
        }
        Ok(WorldFromCamera::from_parts(self.rotation * old.rotation(), centre))
    }

    /// The inverse transform.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { rotation: self.rotation.inverse(), origin: self.new_from_old(DVec3::ZERO), scale: self.scale.recip() }
    }

    /// The composition of `self`, then `next`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self {
            rotation: next.rotation * self.rotation,
            origin: self.old_from_new(next.origin),
            scale: self.scale * next.scale,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    fn change() -> Similarity {
        Similarity { rotation: DMat3::from_rotation_y(0.7), origin: DVec3::new(1.0, -2.0, 3.0), scale: 0.4 }
    }

    #[test]
    fn inverse_inverts() {
        let point = DVec3::new(-0.3, 5.0, 2.0);
        let (change, back) = (change(), change().inverse());
        for (found, expected, what) in [
            (change.old_from_new(change.new_from_old(point)), point, "round trip"),
            (back.new_from_old(point), change.old_from_new(point), "inverse"),
            (back.inverse().new_from_old(point), change.new_from_old(point), "inverse of the inverse"),
        ] {
            Tolerance::F64.assert(found.to_array(), expected.to_array(), what);
        }
    }

    #[test]
    fn then_composes() {
        let next = Similarity { rotation: DMat3::from_rotation_x(-1.1), origin: DVec3::new(0.0, 4.0, 1.0), scale: 3.0 };
        let point = DVec3::new(-0.3, 5.0, 2.0);
        let (once, twice) = (change().then(&next).new_from_old(point), next.new_from_old(change().new_from_old(point)));
        Tolerance::F64.assert(once.to_array(), twice.to_array(), "composition");
    }
}
