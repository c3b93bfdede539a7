//! What of Gaussians does not depend on the camera, many side by side.

use pulp::Simd;

use super::elementary::exp;
use super::wide::{Row, SIDE_BY_SIDE, Wide, store3};
use crate::{GaussianParts, LOG_SCALE_LIMIT};

/// Gaussians' numbers, worked out as far as no camera is needed.
#[derive(Debug)]
pub(super) struct Shapes {
    /// Position of the first in the list of Gaussians.
    pub(super) first: usize,
    pub(super) count: usize,
    /// Whether every number can be used.
    pub(super) usable: [bool; SIDE_BY_SIDE],
    pub(super) mean: [Row; 3],
    /// Axes of the ellipsoid, one standard deviation long; `axes[k]` is the `k`-th in the world.
    pub(super) axes: [[Row; 3]; 3],
    /// After the sigmoid and the 3D filter.
    pub(super) opacity: Row,
    pub(super) quaternion: [Row; 4],
    /// Standard deviations, after the 3D filter.
    pub(super) scales: [Row; 3],
    /// After the sigmoid, and `e^(−logit)`: of opacities that f64 rounds to 1, what is left is `odds · sigmoid`.
    pub(super) sigmoid: Row,
    pub(super) odds: Row,
    /// Share of the variances that the 3D filter left to the Gaussian.
    pub(super) own_share: [Row; 3],
}

const ZERO: Row = [0.0; SIDE_BY_SIDE];

impl Default for Shapes {
    fn default() -> Self {
        Self {
            first: 0,
            count: 0,
            usable: [false; SIDE_BY_SIDE],
            mean: [ZERO; 3],
            axes: [[ZERO; 3]; 3],
            opacity: ZERO,
            quaternion: [ZERO; 4],
            scales: [ZERO; 3],
            sigmoid: ZERO,
            odds: ZERO,
            own_share: [[1.0; SIDE_BY_SIDE]; 3],
        }
    }
}

impl Shapes {
    /// Takes the Gaussians from position `first` on, at most [`SIDE_BY_SIDE`] and none from `past` on.
    #[inline(always)]
    pub(super) fn take<S: Simd>(&mut self, simd: S, parts: &GaussianParts, first: usize, past: usize) {
        let room = past.saturating_sub(first);
        self.first = first;
        self.count = if room < SIDE_BY_SIDE { room } else { SIDE_BY_SIDE };
        self.read(simd, parts);
        if let Some(filters) = parts.filter_3d.as_ref().and_then(|filters| filters.get(first..first + self.count)) {
            self.widen(filters);
        }
        for at in 0..SIDE_BY_SIDE / S::F64_LANES {
            self.turn(simd, at);
        }
    }

    #[inline(always)]
    fn read<S: Simd>(&mut self, simd: S, parts: &GaussianParts) {
        let range = self.first..self.first + self.count;
        let means = parts.means.get(range.clone()).unwrap_or_default();
        let quaternions = parts.quaternions.get(range.clone()).unwrap_or_default();
        let log_scales = parts.log_scales.get(range.clone()).unwrap_or_default();
        let logits = parts.opacity_logits.get(range).unwrap_or_default();
        let mut logs = [[0.0f32; SIDE_BY_SIDE]; 4];
        for (lane, (((mean, quaternion), scales), logit)) in
            means.iter().zip(quaternions).zip(log_scales).zip(logits).enumerate().take(SIDE_BY_SIDE)
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
            let turned = quaternion.iter().any(|value| *value != 0.0);
            let small = scales.iter().all(|log| *log <= LOG_SCALE_LIMIT);
            self.usable[lane] = finite && turned && small && !logit.is_nan();
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

    /// The 3D filter: a scale `s` becomes `√(s² + f²)`, and opacity falls by what the volume grows.
    #[inline(always)]
    fn widen(&mut self, filters: &[f32]) {
        for (lane, filter) in filters.iter().enumerate().take(SIDE_BY_SIDE) {
            let mut volume = 1.0;
            for (scale, share) in self.scales.iter_mut().zip(&mut self.own_share) {
                let own = scale[lane] * scale[lane];
                let total = own + f64::from(*filter) * f64::from(*filter);
                let there = *filter != 0.0;
                share[lane] = if there { own / total } else { 1.0 };
                scale[lane] = if there { total.sqrt() } else { scale[lane] };
                volume *= share[lane];
            }
            self.usable[lane] &= filter.is_finite();
            self.opacity[lane] *= volume.sqrt();
        }
    }

    /// Axes from quaternions and scales.
    #[inline(always)]
    fn turn<S: Simd>(&mut self, simd: S, at: usize) {
        let [w, x, y, z] = &self.quaternion;
        let rotation = rotation([
            Wide::load(simd, w, at),
            Wide::load(simd, x, at),
            Wide::load(simd, y, at),
            Wide::load(simd, z, at),
        ]);
        for ((axis, [x, y, z]), scales) in self.axes.iter_mut().zip(rotation).zip(&self.scales) {
            let scale = Wide::load(simd, scales, at);
            store3([x * scale, y * scale, z * scale], axis, at);
        }
    }
}

/// Columns of the rotation of a quaternion `w, x, y, z` of any length but zero.
#[inline(always)]
pub(super) fn rotation<S: Simd>([w, x, y, z]: [Wide<S>; 4]) -> [[Wide<S>; 3]; 3] {
    let (one, two) = (w.of(1.0), w.of(2.0));
    let twice = two / w.mul_add(w, x.mul_add(x, y.mul_add(y, z * z)));
    let (wx, wy, wz) = (w * x * twice, w * y * twice, w * z * twice);
    let (xx, xy, xz) = (x * x * twice, x * y * twice, x * z * twice);
    let (yy, yz, zz) = (y * y * twice, y * z * twice, z * z * twice);
    [[one - (yy + zz), xy + wz, xz - wy], [xy - wz, one - (xx + zz), yz + wx], [xz + wy, yz - wx, one - (xx + yy)]]
}
