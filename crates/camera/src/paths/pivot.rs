use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3, EulerRot};

use crate::WorldFromCamera;
use crate::axes::{nearest_rotation, rotation_from_forward_and_down};

/// Optical axes whose |cosine| is closer to 1 than this count as parallel.
const PARALLEL: f64 = 1e-4;

/// Interpolates between two views by rotating about the point that both look at: pixelSplat's `interpolate_extrinsics`
/// (`src/visualization/camera_trajectory/interpolation.py`).
///
/// The *pivot* is the point closest to both optical axes, the *pivot axis* their common normal. A pose is parametrised
/// by its offset from the pivot (orthogonal to the look direction, along the pivot axis, along the look direction) and
/// three angles about the pivot axis, the view's right axis and the look direction. Offsets are interpolated linearly,
/// angles the shorter way around. Times 0 and 1 are the two views; others extrapolate.
///
/// For parallel axes the pivot is the midpoint of the centres. pixelSplat then uses a world axis as the pivot axis and
/// drops the angle about the right axis; here it is the first view's down axis and the angle is kept, so that the last
/// view is reached and the path moves with the world.
pub fn pivot_interpolation(from: &WorldFromCamera, to: &WorldFromCamera, times: &[f64]) -> Vec<WorldFromCamera> {
    let rotations = [from, to].map(|view| nearest_rotation(view.rotation()));
    let centres = [from, to].map(WorldFromCamera::centre);
    let looks = rotations.map(|rotation| rotation.z_axis);

    let parallel = (looks[0].dot(looks[1]).abs() - 1.0).abs() < PARALLEL;
    let pivot = if parallel { centres[0].midpoint(centres[1]) } else { closest_to_both(centres, looks) };
    let axis = if parallel { rotations[0].y_axis } else { looks[0].cross(looks[1]) };
    let frame = rotation_from_forward_and_down(looks[0], axis, 0.0);
    let frame = frame.unwrap_or_else(|| unreachable!("the pivot axis is orthogonal to the look direction"));

    let start = Parameters::from_pose(rotations[0], centres[0], frame, pivot);
    let end = Parameters::from_pose(rotations[1], centres[1], frame, pivot);
    times.iter().map(|t| start.towards(&end, *t).pose(frame, pivot)).collect()
}

/// A pose relative to the pivot.
struct Parameters {
    /// Pivot relative to the centre: sideways, along the pivot axis, ahead.
    offset: DVec3,
    /// Intrinsic rotations about the pivot axis, the right axis and the look direction, in this order.
    angles: [f64; 3],
}

impl Parameters {
    fn from_pose(rotation: DMat3, centre: DVec3, frame: DMat3, pivot: DVec3) -> Self {
        let (y, x, z) = (frame.transpose() * rotation).to_euler(EulerRot::YXZ);
        Self { offset: offset_frame(frame, rotation).transpose() * (pivot - centre), angles: [y, x, z] }
    }

    fn towards(&self, other: &Self, t: f64) -> Self {
        let angle = |index: usize| {
            let (from, to) = (self.angles[index], other.angles[index]);
            let difference = (to - from + PI).rem_euclid(TAU) - PI;
            from + difference * t
        };
        Self { offset: self.offset.lerp(other.offset, t), angles: [angle(0), angle(1), angle(2)] }
    }

    fn pose(&self, frame: DMat3, pivot: DVec3) -> WorldFromCamera {
        let [y, x, z] = self.angles;
        let rotation = frame * DMat3::from_euler(EulerRot::YXZ, y, x, z);
        WorldFromCamera::from_parts(rotation, pivot - offset_frame(frame, rotation) * self.offset)
    }
}

/// Sideways, along the pivot axis, ahead. As in pixelSplat the last two are orthogonal only if the view looks along the
/// pivot plane, so this is orthonormalised.
fn offset_frame(frame: DMat3, rotation: DMat3) -> DMat3 {
    rotation_from_forward_and_down(rotation.z_axis, frame.y_axis, 0.0).unwrap_or(rotation)
}

/// The midpoint of the shortest connection between two lines that are not parallel.
fn closest_to_both(points: [DVec3; 2], directions: [DVec3; 2]) -> DVec3 {
    let [a, b] = directions;
    let between = points[1] - points[0];
    let normal = a.cross(b);
    let scale = normal.length_squared().recip();
    let (along_a, along_b) = (between.cross(b).dot(normal) * scale, between.cross(a).dot(normal) * scale);
    (points[0] + a * along_a).midpoint(points[1] + b * along_b)
}
