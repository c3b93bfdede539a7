//! The camera-independent part of projection, in chunks.

use pulp::Simd;

use super::math::exp;
use super::wide::{CHUNK, Row, Wide, store3};
use crate::{GaussianParts, LOG_SCALE_LIMIT};

/// A chunk of Gaussians, processed as far as possible without a camera.
#[derive(Debug)]
pub(super) struct Shapes {
    /// Index of the first Gaussian.
    pub(super) first: usize,
    pub(super) count: usize,
    /// Whether every parameter is valid.
    pub(super) valid: [bool; CHUNK],
    pub(super) mean: [Row; 3],
    /// Axes of the ellipsoid, one standard deviation long; `axes[k]` is the `k`-th in world coordinates.
    pub(super) axes: [[Row; 3]; 3],
    /// After the sigmoid and the 3D filter.
    pub(super) opacity: Row,
    pub(super) quaternion: [Row; 4],
    /// Standard deviations, after the 3D filter.
    pub(super) scales: [Row; 3],
    /// The sigmoid, and `e^(−logit)`; `1 − sigmoid` is computed as `odds · sigmoid`, which is accurate where f64 rounds
    /// the sigmoid to 1.
    pub(super) sigmoid: Row,
    pub(super) odds: Row,
    /// Ratio of the Gaussian's own variances to the filtered ones.
    pub(super) unfiltered_share: [Row; 3],
}

const ZERO: Row = [0.0; CHUNK];

impl Default for Shapes {
    fn default() -> Self {
        Self {
            first: 0,
            count: 0,
            valid: [false; CHUNK],
            mean: [ZERO; 3],
            axes: [[ZERO; 3]; 3],
            opacity: ZERO,
            quaternion: [ZERO; 4],
            scales: [ZERO; 3],
            sigmoid: ZERO,
            odds: ZERO,
            unfiltered_share: [[1.0; CHUNK]; 3],
        }
    }
}

impl Shapes {
    /// Loads the Gaussians from index `first` on: at most [`CHUNK`], and none from `end` on.
    #[inline(always)]
    pub(super) fn load<S: Simd>(&mut self, simd: S, parts: &GaussianParts, first: usize, end: usize) {
        let remaining = end.saturating_sub(first);
        self.first = first;
        self.count = if remaining < CHUNK { remaining } else { CHUNK };
        self.read(simd, parts);
        if let Some(filters) = parts.filter_3d.as_ref().and_then(|filters| filters.get(first..first + self.count)) {
            self.apply_filter(filters);
        }
        for vector in 0..CHUNK / S::F64_LANES {
            self.compute_axes(simd, vector);
        }
    }

    #[inline(always)]
    fn read<S: Simd>(&mut self, simd: S, parts: &GaussianParts) {
        let range = self.first..self.first + self.count;
        let means = &parts.means[range.clone()];
        let quaternions = &parts.quaternions[range.clone()];
        let log_scales = &parts.log_scales[range.clone()];
        let logits = &parts.opacity_logits[range];
        let mut logs = [[0.0f32; CHUNK]; 4];
        for (lane, (((mean, quaternion), scales), logit)) in
            means.iter().zip(quaternions).zip(log_scales).zip(logits).enumerate().take(CHUNK)
        {
            let [x, y, z] = *mean;
            let [qw, qx, qy, qz] = *quaternion;
            let [log_x, log_y, log_z] = *scales;
            for (row, value) in self.mean.iter_mut().zip([x, y, z]) {
                row[lane] = f64::from(value);
            }
            for (row, value) in self.quaternion.iter_mut().zip([qw, qx, qy, qz]) {
                row[lane] = f64::from(value);
            }
            for (row, value) in logs.iter_mut().zip([log_x, log_y, log_z, -logit]) {
                row[lane] = value;
            }
            let finite = mean.iter().chain(quaternion).all(|value| value.is_finite());
            let nonzero = quaternion.iter().any(|value| *value != 0.0);
            let small = scales.iter().all(|log| *log <= LOG_SCALE_LIMIT);
            self.valid[lane] = finite && nonzero && small && !logit.is_nan();
        }
        for row in &mut logs {
            for lanes in S::as_mut_simd_f32s(row).0 {
                *lanes = exp(simd, *lanes);
            }
        }
        let [scales @ .., odds] = &logs;
        for (row, scales) in self.scales.iter_mut().zip(scales) {
            for (slot, scale) in row.iter_mut().zip(scales) {
                *slot = f64::from(*scale);
            }
        }
        let opacities = self.sigmoid.iter_mut().zip(&mut self.opacity);
        for ((sigmoid, opacity), (kept, odds)) in opacities.zip(self.odds.iter_mut().zip(odds)) {
            *kept = f64::from(*odds);
            *sigmoid = 1.0 / (1.0 + *kept);
            *opacity = *sigmoid;
        }
    }

    /// Applies the 3D filter: a scale `s` becomes `√(s² + f²)`, and opacity decreases as the volume grows.
    #[inline(always)]
    fn apply_filter(&mut self, filters: &[f32]) {
        for (lane, filter) in filters.iter().enumerate().take(CHUNK) {
            let mut volume = 1.0;
            for (scale, share) in self.scales.iter_mut().zip(&mut self.unfiltered_share) {
                let variance = scale[lane] * scale[lane];
                let total = variance + f64::from(*filter) * f64::from(*filter);
                let has_filter = *filter != 0.0;
                share[lane] = if has_filter { variance / total } else { 1.0 };
                scale[lane] = if has_filter { total.sqrt() } else { scale[lane] };
                volume *= share[lane];
            }
            self.valid[lane] &= filter.is_finite();
            self.opacity[lane] *= volume.sqrt();
        }
    }

    /// Computes the axes from quaternions and scales.
    #[inline(always)]
    fn compute_axes<S: Simd>(&mut self, simd: S, vector: usize) {
        let [w, x, y, z] = &self.quaternion;
        let rotation = rotation([
            Wide::load(simd, w, vector),
            Wide::load(simd, x, vector),
            Wide::load(simd, y, vector),
            Wide::load(simd, z, vector),
        ]);
        for ((axis, [x, y, z]), scales) in self.axes.iter_mut().zip(rotation).zip(&self.scales) {
            let scale = Wide::load(simd, scales, vector);
            store3([x * scale, y * scale, z * scale], axis, vector);
        }
    }
}

/// Columns of the rotation matrix of a quaternion `w, x, y, z` of any norm but zero.
#[inline(always)]
pub(super) fn rotation<S: Simd>([w, x, y, z]: [Wide<S>; 4]) -> [[Wide<S>; 3]; 3] {
    let (one, two) = (w.of(1.0), w.of(2.0));
    let twice = two / w.mul_add(w, x.mul_add(x, y.mul_add(y, z * z)));
    let (wx, wy, wz) = (w * x * twice, w * y * twice, w * z * twice);
    let (xx, xy, xz) = (x * x * twice, x * y * twice, x * z * twice);
    let (yy, yz, zz) = (y * y * twice, y * z * twice, z * z * twice);
    [[one - (yy + zz), xy + wz, xz - wy], [xy - wz, one - (xx + zz), yz + wx], [xz + wy, yz - wx, one - (xx + yy)]]
}
