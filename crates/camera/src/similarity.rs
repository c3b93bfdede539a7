use glam::{DMat3, DVec3};

use crate::error::finite;
use crate::{CameraError, WorldFromCamera};

/// A change of world coordinates, `new = scale · rotation · (old − origin)`.
///
/// Kept as an origin to subtract rather than as a translation to add: a scene far from its world's
/// origin keeps all its digits. The 3×3 part is orthonormal, but for the inverse of a stored pose,
/// which inherits the rounding of the file.
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
    /// The change that changes nothing.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, origin: DVec3::ZERO, scale: 1.0 };

    /// A point in the new world.
    pub fn new_from_old(&self, old: DVec3) -> DVec3 {
        self.rotation * (old - self.origin) * self.scale
    }

    /// A point back in the old world.
    pub fn old_from_new(&self, new: DVec3) -> DVec3 {
        self.rotation.inverse() * (new / self.scale) + self.origin
    }

    /// A camera in the new world: its axes are rotated, its centre is moved and scaled.
    ///
    /// # Errors
    /// [`CameraError::NonFinite`] where a centre overflows.
    pub fn new_pose_from_old(&self, old: &WorldFromCamera) -> Result<WorldFromCamera, CameraError> {
        let centre = self.new_from_old(old.centre());
        for (field, value) in [("centre x", centre.x), ("centre y", centre.y), ("centre z", centre.z)] {
            finite(field, value)?;
        }
        Ok(WorldFromCamera::from_parts(self.rotation * old.rotation(), centre))
    }

    /// The change back: what [`Self::old_from_new`] does, as a change of its own.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { rotation: self.rotation.inverse(), origin: self.new_from_old(DVec3::ZERO), scale: self.scale.recip() }
    }

    /// First `self`, then `next`.
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
    fn there_and_back() {
        let point = DVec3::new(-0.3, 5.0, 2.0);
        Tolerance::F64.assert(
            change().old_from_new(change().new_from_old(point)).to_array(),
            point.to_array(),
            "round trip",
        );
        let back = change().inverse();
        Tolerance::F64.assert(
            back.new_from_old(point).to_array(),
            change().old_from_new(point).to_array(),
            "the change back",
        );
        Tolerance::F64.assert(
            back.inverse().new_from_old(point).to_array(),
            change().new_from_old(point).to_array(),
            "and forth again",
        );
    }

    #[test]
    fn one_after_the_other() {
        let next = Similarity { rotation: DMat3::from_rotation_x(-1.1), origin: DVec3::new(0.0, 4.0, 1.0), scale: 3.0 };
        let point = DVec3::new(-0.3, 5.0, 2.0);
        Tolerance::F64.assert(
            change().then(&next).new_from_old(point).to_array(),
            next.new_from_old(change().new_from_old(point)).to_array(),
            "composition",
        );
    }
}
