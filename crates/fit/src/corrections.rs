//! What is optimised for each view next to the Gaussians: a small motion of its camera, and its exposure.

use atsplat_camera::CameraFromWorld;
use atsplat_splat::{Exposure, View};
use glam::{DMat3, DQuat, DVec3};

use crate::optimised_gaussians::narrowed;
use crate::{FitConfig, FitError};

/// Rotation and translation of a motion, then the 3×3 matrix and the offset of an exposure.
const GRADIENTS: usize = 18;
/// As [`GRADIENTS`], with the rotation as a quaternion w, x, y, z.
const VALUES: usize = 19;
const NONE: [f32; VALUES] = [
    1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, // motion
    1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, // exposure
];
/// Rates fall to this share by the end of a run.
const LAST_SHARE: f64 = 0.01;
const BETAS: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-15;

/// Corrections of all views with Adam's moments; empty if nothing but the Gaussians is optimised.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Corrections {
    pub(crate) values: Vec<[f32; VALUES]>,
    pub(crate) first: Vec<[f32; GRADIENTS]>,
    pub(crate) second: Vec<[f32; GRADIENTS]>,
}

/// Gradients of one view in one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CorrectionGradients {
    /// As [`atsplat_splat::Gradients::pose`].
    pub(crate) pose: [f32; 6],
    /// With respect to the exposure.
    pub(crate) exposure: Option<Exposure>,
}

impl Corrections {
    pub(crate) fn new(config: &FitConfig, views: usize) -> Self {
        if config.pose_rate.is_none() && config.exposure_rate.is_none() {
            return Self::default();
        }
        let zeros = vec![[0.0; GRADIENTS]; views];
        Self { values: vec![NONE; views], first: zeros.clone(), second: zeros }
    }

    /// Arrays of a checkpoint.
    pub(crate) fn arrays(&self) -> [(&'static str, &[f32]); 3] {
        [
            ("views/value", self.values.as_flattened()),
            ("views/first-moment", self.first.as_flattened()),
            ("views/second-moment", self.second.as_flattened()),
        ]
    }

    /// A view with its own motion.
    ///
    /// # Errors
    /// [`FitError::Camera`] for a motion that is not finite.
    pub(crate) fn view(&self, number: usize, view: &View) -> Result<View, FitError> {
        let Some([w, x, y, z, tx, ty, tz, ..]) = self.values.get(number).map(|values| values.map(f64::from)) else {
            return Ok(*view);
        };
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let pose = view.camera.camera_from_world;
        let translation = rotation * pose.translation() + DVec3::new(tx, ty, tz);
        let mut moved = *view;
        moved.camera.camera_from_world = CameraFromWorld::new(rotation * pose.rotation(), translation)?;
        Ok(moved)
    }

    /// A view's exposure.
    pub(crate) fn exposure(&self, number: usize) -> Option<Exposure> {
        let values = self.values.get(number)?.map(f64::from);
        let row = |first: usize| std::array::from_fn(|column| values[first + column]);
        Some(Exposure { matrix: [row(7), row(10), row(13)], offset: row(16) })
    }

    /// A step of Adam for the view of this step; each view has one in every epoch.
    pub(crate) fn update(
        &mut self,
        number: usize,
        slopes: &CorrectionGradients,
        config: &FitConfig,
        (step, extent): (u64, f64),
    ) {
        let epochs = i32::try_from((step - 1) / self.values.len().max(1) as u64 + 1).unwrap_or(i32::MAX);
        let (Some(values), Some(first), Some(second)) =
            (self.values.get_mut(number), self.first.get_mut(number), self.second.get_mut(number))
        else {
            return;
        };
        let share = LAST_SHARE.powf(step as f64 / config.steps as f64);
        let [pose, exposure] = [config.pose_rate, config.exposure_rate].map(|rate| rate.unwrap_or(0.0) * share);
        let d_exposure = slopes.exposure.iter().flat_map(|own| own.matrix.into_iter().flatten().chain(own.offset));
        let gradients = slopes.pose.into_iter().map(f64::from).chain(d_exposure);
        let mut moves = [0.0; GRADIENTS];
        for (at, (gradient, (mean, square))) in gradients.zip(first.iter_mut().zip(second)).enumerate() {
            *mean = narrowed(BETAS[0] * f64::from(*mean) + (1.0 - BETAS[0]) * gradient);
            *square = narrowed(BETAS[1] * f64::from(*square) + (1.0 - BETAS[1]) * gradient * gradient);
            let [bias, root] = BETAS.map(|beta| 1.0 - beta.powi(epochs));
            let rate = if at < 3 {
                pose
            } else if at < 6 {
                pose * extent
            } else {
                exposure
            };
            moves[at] = -rate * (f64::from(*mean) / bias) / ((f64::from(*square) / root).sqrt() + EPSILON);
        }
        let [rx, ry, rz, dx, dy, dz, ..] = moves;
        let [w, x, y, z, tx, ty, tz, ..] = values.map(f64::from);
        let turn = DQuat::from_scaled_axis(DVec3::new(rx, ry, rz));
        let rotation = (turn * DQuat::from_xyzw(x, y, z, w)).normalize();
        let translation = turn * DVec3::new(tx, ty, tz) + DVec3::new(dx, dy, dz);
        let motion = [rotation.w, rotation.x, rotation.y, rotation.z].into_iter().chain(translation.to_array());
        values.iter_mut().zip(motion).for_each(|(slot, value)| *slot = narrowed(value));
        for (slot, change) in values.iter_mut().skip(7).zip(&moves[6..]) {
            *slot = narrowed(f64::from(*slot) + change);
        }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::Strategy;

    /// Values are f32.
    const F32: Tolerance = Tolerance { absolute: 1e-6, relative: 1e-6 };

    /// A slope of 2 and then of −1 moves by the learning rate, and then by this share of it: the mean of the slopes is
    /// (0.09 · 2 − 0.1) / 0.19 = 0.421, that of their squares (0.000999 · 4 + 0.001) / 0.001999 = 2.499.
    const SECOND: f64 = 0.266_337_04;

    #[test]
    fn each_view_takes_its_own_steps_of_adam() {
        let config =
            FitConfig { pose_rate: Some(0.1), exposure_rate: Some(0.2), ..FitConfig::new(Strategy::Fixed, 100) };
        let mut corrections = Corrections::new(&config, 2);
        // Slopes of the rotation about z, of x, of the red that green adds, and of the offset of blue.
        for (step, slope) in [(2, 2.0), (3, -1.0)] {
            let mut exposure = Exposure { matrix: [[0.0; 3]; 3], offset: [0.0, 0.0, slope] };
            exposure.matrix[0][1] = slope;
            #[expect(clippy::cast_possible_truncation, reason = "1 or 2")]
            let slopes =
                CorrectionGradients { pose: [0.0, 0.0, 3.0, slope as f32, 0.0, 0.0], exposure: Some(exposure) };
            corrections.update(1, &slopes, &config, (step, 5.0));
        }
        // Rates fall to a hundredth in a hundred steps.
        let [first, second] = [0.01_f64.powf(0.02), 0.01_f64.powf(0.03)];
        let moved = first + SECOND * second;

        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
        let view = View { camera, size: ImageSize { width: 2, height: 1 } };
        let pose = corrections.view(1, &view).unwrap().camera.camera_from_world;
        let rotation = DMat3::from_rotation_z(-0.1 * (first + second));
        F32.assert(pose.rotation().to_cols_array(), rotation.to_cols_array(), "rotation");
        // The second rotation turns the first translation. An extent is 5.
        let turn = -0.1 * second;
        let x = -0.5 * (first * turn.cos() + SECOND * second);
        F32.assert(pose.translation().to_array(), [x, -0.5 * first * turn.sin(), 0.0], "translation");

        let exposure = corrections.exposure(1).unwrap();
        let rows = [1.0, -0.2 * moved, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        F32.assert(exposure.matrix.into_iter().flatten(), rows, "matrix of the exposure");
        F32.assert(exposure.offset, [0.0, 0.0, -0.2 * moved], "offset of the exposure");
        Tolerance::EXACT.assert(corrections.values[0].map(f64::from), NONE.map(f64::from), "the other view");
    }
}
