use std::f64::consts::TAU;

use glam::{DMat3, DVec3};

use crate::error::{finite, positive};
use crate::trajectory::{at_least, shares};
use crate::{CameraError, WorldFromCamera};

/// A camera path on a circle around a point at constant elevation, always looking at the point.
///
/// At azimuth 0 and elevation 0 the camera looks along the world's +z axis, or +y if `up` is along z: from the front in
/// scenes with OpenCV's or Blender's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turntable {
    /// The point that the camera looks at.
    pub target: DVec3,
    /// The up direction of the world, of any length above zero.
    pub up: DVec3,
    /// Distance of the camera's centre from the point, in scene units.
    pub distance: f64,
    /// Elevation of the camera above the point, in radians; ±π/2 looks straight down or up.
    pub elevation: f64,
    /// Start of the circle, in radians; positive is to the camera's right.
    pub azimuth: f64,
    /// Angle of the arc, in radians. A full circle or more ends one step before its start, so that it can be repeated.
    pub sweep: f64,
}

impl Turntable {
    /// `frames` poses, evenly spaced.
    ///
    /// # Errors
    /// [`CameraError::TooFewPoses`] for no frames; [`CameraError::NonFinite`] or [`CameraError::NotPositive`] for a
    /// number out of range.
    pub fn poses(&self, frames: usize) -> Result<Vec<WorldFromCamera>, CameraError> {
        at_least(1, frames, "frames of a turntable")?;
        for coordinate in self.target.to_array() {
            finite("target", coordinate)?;
        }
        let distance = positive("distance", self.distance)?;
        let (sin, cos) = finite("elevation", self.elevation)?.sin_cos();
        let (azimuth, sweep) = (finite("azimuth", self.azimuth)?, finite("sweep", self.sweep)?);
        let axes = self.horizon()?;
        let closes = sweep.abs() >= TAU;
        let steps = if closes { frames + 1 } else { frames };
        let pose = |share: f64| {
            let angle = azimuth + share * sweep;
            let ahead = axes.z_axis * angle.cos() - axes.x_axis * angle.sin();
            let right = axes.x_axis * angle.cos() + axes.z_axis * angle.sin();
            let forward = ahead * cos + axes.y_axis * sin;
            let rotation = DMat3::from_cols(right, forward.cross(right), forward);
            WorldFromCamera::from_parts(rotation, self.target - forward * distance)
        };
        Ok(shares(steps).take(frames).map(pose).collect())
    }

    /// Right, down and forward axes of a level camera at azimuth 0.
    fn horizon(&self) -> Result<DMat3, CameraError> {
        for coordinate in self.up.to_array() {
            finite("up", coordinate)?;
        }
        let up = self.up.try_normalize();
        let up = up.ok_or(CameraError::NotPositive { field: "length of up", found: self.up.length() })?;
        let reference = if up.z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
        let ahead = reference.reject_from_normalized(up).normalize();
        Ok(DMat3::from_cols((-up).cross(ahead), -up, ahead))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    const SLACK: Tolerance = Tolerance::absolute(1e-12);

    fn turntable(up: DVec3) -> Turntable {
        Turntable { target: DVec3::ZERO, up, distance: 2.0, elevation: 0.0, azimuth: 0.0, sweep: TAU }
    }

    #[test]
    fn opencv_scenes_are_seen_from_the_front_and_the_camera_moves_right() {
        let poses = turntable(-DVec3::Y).poses(4).unwrap();
        SLACK.assert(poses[0].rotation().to_cols_array(), DMat3::IDENTITY.to_cols_array(), "level, ahead");
        let centres = [[0.0, 0.0, -2.0], [2.0, 0.0, 0.0], [0.0, 0.0, 2.0], [-2.0, 0.0, 0.0]];
        for (pose, centre) in poses.iter().zip(centres) {
            SLACK.assert(pose.centre().to_array(), centre, "steps of 90°");
        }
    }

    #[test]
    fn blender_scenes_are_seen_from_minus_y() {
        let poses = turntable(DVec3::Z * 7.0).poses(1).unwrap();
        SLACK.assert(poses[0].centre().to_array(), [0.0, -2.0, 0.0], "in front");
        SLACK.assert(poses[0].down().to_array(), [0.0, 0.0, -1.0], "upright");
        SLACK.assert(poses[0].right().to_array(), [1.0, 0.0, 0.0], "not mirrored");
    }

    #[test]
    fn looks_straight_down_from_above() {
        let above = Turntable { elevation: FRAC_PI_2, ..turntable(-DVec3::Y) };
        let pose = above.poses(1).unwrap()[0];
        SLACK.assert(pose.centre().to_array(), [0.0, -2.0, 0.0], "above");
        SLACK.assert(pose.down().to_array(), [0.0, 0.0, -1.0], "the forward direction is at the top");
    }

    #[test]
    fn an_arc_ends_at_its_sweep() {
        let half = Turntable { sweep: -PI, ..turntable(-DVec3::Y) };
        let poses = half.poses(3).unwrap();
        SLACK.assert(poses[1].centre().to_array(), [-2.0, 0.0, 0.0], "to its left");
        SLACK.assert(poses[2].centre().to_array(), [0.0, 0.0, 2.0], "opposite");
    }

    proptest! {
        #[test]
        fn the_target_is_centred_and_the_camera_upright(
            target in prop::array::uniform3(-5.0..5.0f64),
            up in prop::array::uniform3(-1.0..1.0f64),
            elevation in -1.5..1.5f64,
            azimuth in -7.0..7.0f64,
            sweep in -7.0..7.0f64,
        ) {
            let (target, up) = (DVec3::from_array(target), DVec3::from_array(up));
            prop_assume!(up.length() > 0.05);
            let turntable = Turntable { target, up, distance: 3.0, elevation, azimuth, sweep };
            for pose in turntable.poses(5).unwrap() {
                let seen = pose.inverse().transform_point(target);
                prop_assert!(SLACK.check(seen.to_array(), [0.0, 0.0, 3.0]).is_ok(), "{seen}");
                prop_assert!(pose.orthonormality_residual() < 1e-14 && pose.determinant() > 0.0);
                let above = (pose.centre() - target).dot(up.normalize());
                prop_assert!(SLACK.accepts(above, 3.0 * elevation.sin()), "{above}");
                prop_assert!(pose.down().dot(up) < 0.0);
            }
        }
    }

    #[test]
    fn numbers_are_checked() {
        let good = turntable(-DVec3::Y);
        for invalid in [
            Turntable { up: DVec3::ZERO, ..good },
            Turntable { up: DVec3::NAN, ..good },
            Turntable { distance: 0.0, ..good },
            Turntable { elevation: f64::NAN, ..good },
            Turntable { azimuth: f64::INFINITY, ..good },
            Turntable { target: DVec3::INFINITY, ..good },
        ] {
            assert!(invalid.poses(3).is_err(), "{invalid:?}");
        }
        assert!(good.poses(0).is_err());
    }
}
