//! Rotations as unit quaternions and as rotation vectors (axis times angle).

use glam::{DMat3, DQuat, DVec3};

use crate::axes::nearest_rotation;

/// Within this of a rotation by 180° both axes are equally short; one is chosen by a fixed rule.
const HALF_TURN: f64 = 1e-12;
/// The side on which the axis of a rotation by 180° is: ∛4, ∛2 and 1. No axis is perpendicular to it whose coordinates are made of square
/// roots, such as those of multiples of 30° and 45°.
const SIDE: DVec3 = DVec3::new(1.587_401_051_968_199_4, 1.259_921_049_894_873_2, 1.0);

/// The unit quaternion of a matrix that is almost a rotation.
pub(crate) fn quaternion_from_matrix(matrix: DMat3) -> DQuat {
    DQuat::from_mat3(&nearest_rotation(matrix)).normalize()
}

/// The rotation by |v| radians about v.
pub(crate) fn exp(v: DVec3) -> DQuat {
    let angle = v.length();
    // sin(x/2)/x, with its limit where x underflows.
    let ratio = if angle > f64::MIN_POSITIVE { (0.5 * angle).sin() / angle } else { 0.5 };
    let vector = v * ratio;
    DQuat::from_xyzw(vector.x, vector.y, vector.z, (0.5 * angle).cos())
}

/// The shortest rotation vector: `exp(log(q))` is the same rotation as `q` and `−q`, and |log(q)| ≤ π. At 180° it is on the side of
/// [`SIDE`]; rounding decides only for an axis that is perpendicular to it up to rounding.
pub(crate) fn log(q: DQuat) -> DVec3 {
    let flip = if q.w.abs() > HALF_TURN { q.w < 0.0 } else { q.xyz().dot(SIDE) < 0.0 };
    let q = if flip { -q } else { q };
    let vector = q.xyz();
    let sine = vector.length();
    if sine > f64::MIN_POSITIVE { vector * (2.0 * sine.atan2(q.w) / sine) } else { 2.0 * vector }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    proptest! {
        #[test]
        fn log_inverts_exp(axis in prop::array::uniform3(-1.0..1.0f64), angle in 0.0..3.1) {
            let axis = DVec3::from_array(axis);
            prop_assume!(axis.length() > 0.1);
            let v = axis.normalize() * angle;
            for q in [exp(v), -exp(v)] {
                prop_assert!(Tolerance::F64.check(log(q).to_array(), v.to_array()).is_ok(), "{v} → {}", log(q));
            }
        }
    }

    #[test]
    fn tiny_rotations_keep_their_precision() {
        for angle in [0.0, 1e-300, 1e-20, 1e-9] {
            let v = DVec3::new(0.0, angle, 0.0);
            Tolerance::relative(1e-14).assert(log(exp(v)).to_array(), v.to_array(), "small");
        }
    }

    /// Among them axes with coordinates of a half, at which rounding once decided.
    #[test]
    fn the_axis_of_a_rotation_by_180_degrees_does_not_depend_on_rounding() {
        let (of_30, of_45) = (0.75f64.sqrt(), 0.5f64.sqrt());
        for axis in [
            DVec3::X,
            DVec3::Y,
            DVec3::Z,
            DVec3::new(-0.6, 0.8, 0.0),
            DVec3::new(0.8, -0.6, 0.0),
            DVec3::new(-0.5, of_30, 0.0),
            DVec3::new(of_30, 0.0, -0.5),
            DVec3::new(0.0, 0.5, of_30),
            DVec3::new(0.5, 0.5, -of_45),
            DVec3::new(-of_45, 0.5, 0.5),
        ] {
            // Of the real part, and of the axis.
            for (noise, shift) in [(1e-16, -1e-16), (-1e-16, 1e-16), (0.0, 0.0)] {
                let q = DQuat::from_xyzw(axis.x + shift, axis.y - shift, axis.z + shift, noise);
                Tolerance::F64.assert(log(q).to_array(), (axis * PI).to_array(), "plus");
                Tolerance::F64.assert(log(-q).to_array(), (axis * PI).to_array(), "minus");
            }
        }
    }
}
