use glam::{DMat3, DQuat, DVec3};

use super::{Gaussians, LOG_SCALE_LIMIT};

/// An axis-aligned bounding box in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The corner of the smallest coordinates.
    pub min: DVec3,
    /// The corner of the largest coordinates.
    pub max: DVec3,
    /// Gaussians skipped because their extent is not finite.
    pub left_out: usize,
}

impl Bounds {
    /// The middle of the box.
    pub fn centre(&self) -> DVec3 {
        self.min.midpoint(self.max)
    }

    /// Lengths of the edges.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    fn enclosing(boxes: impl Iterator<Item = (DVec3, DVec3)>) -> Option<Self> {
        let mut enclosing: Option<Self> = None;
        let mut left_out = 0;
        for (middle, half) in boxes {
            let (min, max) = (middle - half, middle + half);
            if !(min.is_finite() && max.is_finite()) {
                left_out += 1;
                continue;
            }
            let so_far = enclosing.unwrap_or(Self { min, max, left_out: 0 });
            enclosing = Some(Self { min: so_far.min.min(min), max: so_far.max.max(max), left_out: 0 });
        }
        enclosing.map(|bounds| Self { left_out, ..bounds })
    }
}

impl Gaussians {
    /// Bounding box of the finite means; `None` if there are none.
    pub fn bounds_of_means(&self) -> Option<Bounds> {
        Bounds::enclosing(self.parts().means.iter().map(|mean| (wide(mean), DVec3::ZERO)))
    }

    /// Bounding box of the ellipsoids at `sigmas` standard deviations, including Mip-Splatting's filter if present;
    /// `None` if there are none. Skips the Gaussians that renderers count as invalid: non-finite values, log-scales
    /// above [`LOG_SCALE_LIMIT`] and NaN opacity logits.
    ///
    /// An ellipsoid of covariance Σ reaches `sigmas · √Σᵢᵢ` along axis i.
    pub fn bounds_of_ellipsoids(&self, sigmas: f64) -> Option<Bounds> {
        let parts = self.parts();
        let filters = parts.filter_3d.iter().flatten().copied().chain(std::iter::repeat(0.0));
        let shapes = parts.quaternions.iter().zip(&parts.log_scales).zip(&parts.opacity_logits).zip(filters);
        Bounds::enclosing(parts.means.iter().zip(shapes).map(|(mean, (((quaternion, log_scales), logit), filter))| {
            if logit.is_nan() || !log_scales.iter().all(|log| *log <= LOG_SCALE_LIMIT) {
                return (wide(mean), DVec3::NAN);
            }
            let axes = rotation(quaternion)
                * DMat3::from_diagonal(DVec3::from_array(wide(log_scales).to_array().map(f64::exp)));
            let filter = f64::from(filter);
            let variance = |row: DVec3| row.length_squared() + filter * filter;
            let variances = DVec3::new(variance(axes.row(0)), variance(axes.row(1)), variance(axes.row(2)));
            (wide(mean), sigmas * DVec3::from_array(variances.to_array().map(f64::sqrt)))
        }))
    }
}

/// The rotation of a Gaussian, by its quaternion of any length but 0.
pub(crate) fn rotation(wxyz: &[f32; 4]) -> DMat3 {
    let [w, x, y, z] = wxyz.map(f64::from);
    DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize())
}

fn wide(values: &[f32; 3]) -> DVec3 {
    DVec3::from_array(values.map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GaussianParts;
    use atsplat_numeric::Tolerance;

    fn gaussians(means: Vec<[f32; 3]>, quaternion: [f32; 4], log_scales: [f32; 3]) -> Gaussians {
        let count = means.len();
        Gaussians::new(GaussianParts {
            means,
            quaternions: vec![quaternion; count],
            log_scales: vec![log_scales; count],
            opacity_logits: vec![0.0; count],
            sh: vec![[0.0; 3]; count],
            ..GaussianParts::default()
        })
        .unwrap()
    }

    #[test]
    fn bounds_of_means_skip_nan() {
        let some =
            gaussians(vec![[1.0, 2.0, 3.0], [f32::NAN, 0.0, 0.0], [-1.0, 5.0, 3.0]], [1.0, 0.0, 0.0, 0.0], [0.0; 3]);
        let bounds = some.bounds_of_means().unwrap();
        assert_eq!((bounds.min, bounds.max), (DVec3::new(-1.0, 2.0, 3.0), DVec3::new(1.0, 5.0, 3.0)));
        assert_eq!(
            (bounds.left_out, bounds.size(), bounds.centre()),
            (1, DVec3::new(2.0, 3.0, 0.0), DVec3::new(0.0, 3.5, 3.0))
        );
        assert_eq!(Gaussians::default().bounds_of_means(), None);
    }

    /// Standard deviations 1, 2, 3 rotated by 90° about z extend to 2, 1, 3.
    #[test]
    fn bounds_of_ellipsoids_follow_their_covariance() {
        let scales = [0.0, 2.0f32.ln(), 3.0f32.ln()];
        let one = gaussians(vec![[0.0; 3]], [2.0, 0.0, 0.0, 2.0], scales);
        let bounds = one.bounds_of_ellipsoids(3.0).unwrap();
        Tolerance::absolute(1e-6).assert(bounds.max.to_array(), [6.0, 3.0, 9.0], "turned");
        let mut parts = one.into_parts();
        parts.filter_3d = Some(vec![1.0]);
        let filtered = Gaussians::new(parts).unwrap().bounds_of_ellipsoids(1.0).unwrap();
        let expected = [5.0f64.sqrt(), 2.0f64.sqrt(), 10.0f64.sqrt()];
        Tolerance::absolute(1e-6).assert(filtered.max.to_array(), expected, "filtered");
    }

    #[test]
    fn bounds_skip_gaussians_that_are_never_drawn() {
        let mut parts = gaussians(vec![[0.0; 3]; 4], [1.0, 0.0, 0.0, 0.0], [0.0; 3]).into_parts();
        parts.log_scales[1] = [100.0, 0.0, 0.0];
        parts.opacity_logits[2] = f32::NAN;
        parts.quaternions[3] = [0.0; 4];
        let bounds = Gaussians::new(parts).unwrap().bounds_of_ellipsoids(2.0).unwrap();
        assert_eq!((bounds.left_out, bounds.max), (3, DVec3::splat(2.0)));
    }
}
