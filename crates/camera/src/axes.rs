//! Orthonormal camera axes from arbitrary vectors.

use glam::{DMat3, DVec3};

/// The rotation whose third column is `forward` and whose second is as close to `down` as possible:
/// `d = normalize(down − (down·f) f)`, `r = d × f`.
///
/// `None` if `forward` is zero or the part of `down` orthogonal to it is not longer than `threshold`. Projecting twice
/// keeps the columns orthonormal to the last bit or two however short that part is.
pub(crate) fn rotation_from_forward_and_down(forward: DVec3, down: DVec3, threshold: f64) -> Option<DMat3> {
    let f = forward.try_normalize()?;
    let orthogonal = down.reject_from_normalized(f);
    let orthogonal = (orthogonal.length() > threshold).then_some(orthogonal)?;
    let d = orthogonal.try_normalize()?.reject_from_normalized(f).try_normalize()?;
    Some(DMat3::from_cols(d.cross(f), d, f))
}

/// The rotation nearest to a matrix that is almost one (stored with nine decimals or as f32): the orthogonal factor of
/// its polar decomposition, by Newton's iteration `R ← (R + R⁻ᵀ) / 2` (Higham 1986), which converges quadratically.
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
    fn nearly_parallel_vectors_give_orthonormal_axes() {
        for tilt in [1.0, 1e-3, 1e-7] {
            let r = rotation_from_forward_and_down(DVec3::new(0.0, 0.3, 2.0), DVec3::new(tilt, 0.3, 2.0), 0.0).unwrap();
            assert_rotation(r);
        }
        assert_eq!(rotation_from_forward_and_down(DVec3::Z, DVec3::Z, 1e-12), None);
        assert_eq!(rotation_from_forward_and_down(DVec3::ZERO, DVec3::Y, 1e-12), None);
        // The part of `down` orthogonal to forward has a length of exactly ½, which the threshold excludes.
        let down = DVec3::new(0.0, 0.5, 1.0);
        assert_eq!(rotation_from_forward_and_down(DVec3::Z, down, 0.5), None);
        assert_eq!(rotation_from_forward_and_down(DVec3::Z, down, 0.49), Some(DMat3::IDENTITY));
    }

    #[test]
    fn rounded_rotations_become_orthonormal_and_exact_ones_are_unchanged() {
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
