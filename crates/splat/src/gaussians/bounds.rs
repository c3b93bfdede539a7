use glam::DVec3;

use super::Gaussians;

/// An axis-aligned bounding box in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The corner of the smallest coordinates.
    pub min: DVec3,
    /// The corner of the largest coordinates.
    pub max: DVec3,
    /// Gaussians skipped because their mean is not finite.
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
}

impl Gaussians {
    /// Bounding box of the finite means; `None` if there are none.
    pub fn bounds_of_means(&self) -> Option<Bounds> {
        let mut bounds: Option<Bounds> = None;
        let mut left_out = 0;
        for mean in &self.parts().means {
            let mean = DVec3::from_array(mean.map(f64::from));
            if !mean.is_finite() {
                left_out += 1;
                continue;
            }
            let Bounds { min, max, .. } = bounds.unwrap_or(Bounds { min: mean, max: mean, left_out: 0 });
            bounds = Some(Bounds { min: min.min(mean), max: max.max(mean), left_out: 0 });
        }
        bounds.map(|bounds| Bounds { left_out, ..bounds })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GaussianParts;

    #[test]
    fn bounds_of_means_skip_nan() {
        let means = vec![[1.0, 2.0, 3.0], [f32::NAN, 0.0, 0.0], [-1.0, 5.0, 3.0]];
        let some = Gaussians::new(GaussianParts {
            means,
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 3],
            log_scales: vec![[0.0; 3]; 3],
            opacity_logits: vec![0.0; 3],
            sh: vec![[0.0; 3]; 3],
            ..GaussianParts::default()
        })
        .unwrap();
        let bounds = some.bounds_of_means().unwrap();
        assert_eq!((bounds.min, bounds.max), (DVec3::new(-1.0, 2.0, 3.0), DVec3::new(1.0, 5.0, 3.0)));
        assert_eq!(
            (bounds.left_out, bounds.size(), bounds.centre()),
            (1, DVec3::new(2.0, 3.0, 0.0), DVec3::new(0.0, 3.5, 3.0))
        );
        assert_eq!(Gaussians::default().bounds_of_means(), None);
    }
}
