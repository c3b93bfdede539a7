//! Orthonormal camera axes from vectors that are not.

use glam::{DMat3, DVec3};

/// The rotation whose third column is `forward` and whose second is as close to `down` as that allows:
/// `d = normalize(down − (down·f) f)`, `r = d × f`.
///
/// `None` where `forward` is zero or the part of `down` across it is at most `threshold`. Projecting
/// twice keeps the columns orthonormal to the last bit or two however small that part is.
pub(crate) fn rotation_from_forward_and_down(forward: DVec3, down: DVec3, threshold: f64) -> Option<DMat3> {
    let f = forward.try_normalize()?;
    let across = down.reject_from_normalized(f);
    let usable = (across.length() > threshold).then_some(across)?;
    let d = usable.try_normalize()?.reject_from_normalized(f).try_normalize()?;
    Some(DMat3::from_cols(d.cross(f), d, f))
}

/// The nearest rotation to a matrix that is nearly one (a file's nine decimals, f32): the orthogonal
/// factor of its polar decomposition, by Newton's iteration `R ← (R + R⁻ᵀ) / 2` (Higham 1986), which
/// doubles the correct digits each time.
pub(crate) fn nearest_rotation(matrix: DMat3) -> DMat3 {
    (0..6).fold(matrix, |r, _| (r + r.inverse().transpose()) * 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    fn assert_rotation(r: DMat3) {
        Tolerance::ORTHONORMAL.assert(
            (r * r.transpose()).to_cols_array(),
            DMat3::IDENTITY.to_cols_array(),
            "orthonormal",
        );
        Tolerance::ORTHONORMAL.assert([r.determinant()], [1.0], "not a reflection");
    }

    #[test]
    fn axes_are_orthonormal_even_from_nearly_parallel_vectors() {
        for tilt in [1.0, 1e-3, 1e-7] {
            let r = rotation_from_forward_and_down(DVec3::new(0.0, 0.3, 2.0), DVec3::new(tilt, 0.3, 2.0), 0.0).unwrap();
            assert_rotation(r);
        }
        assert_eq!(rotation_from_forward_and_down(DVec3::Z, DVec3::Z, 1e-12), None);
        assert_eq!(rotation_from_forward_and_down(DVec3::ZERO, DVec3::Y, 1e-12), None);
    }

    #[test]
    fn a_rounded_rotation_is_repaired_and_a_true_one_kept() {
        let exact = DMat3::from_euler(glam::EulerRot::YXZ, 0.4, -1.2, 2.9);
        let rounded = DMat3::from_cols_array(&exact.to_cols_array().map(|entry| (entry * 1e3).round() / 1e3));
        assert_rotation(nearest_rotation(rounded));
        Tolerance::absolute(1e-3).assert(
            nearest_rotation(rounded).to_cols_array(),
            exact.to_cols_array(),
            "close to the rounded one",
        );
        Tolerance::ORTHONORMAL.assert(nearest_rotation(exact).to_cols_array(), exact.to_cols_array(), "kept");
    }
}
