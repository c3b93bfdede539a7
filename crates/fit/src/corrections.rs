//! What is optimised for each view next to the Gaussians: a small motion of its camera, and its exposure.

use atsplat_camera::CameraFromWorld;
use atsplat_numeric::narrowed;
use atsplat_splat::{Exposure, View};
use glam::{DMat3, DQuat, DVec3};

use crate::adam::{BETAS, bias_corrections};
use crate::{FitConfig, FitError, StopReason};

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
/// PyTorch's default, which the published code keeps for cameras and exposures.
const EPSILON: f64 = 1e-8;

/// Corrections of all views with Adam's moments; empty if nothing but the Gaussians is optimised.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Corrections {
    pub(crate) values: Vec<[f32; VALUES]>,
    pub(crate) first_moments: Vec<[f32; GRADIENTS]>,
    pub(crate) second_moments: Vec<[f32; GRADIENTS]>,
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
        Self { values: vec![NONE; views], first_moments: zeros.clone(), second_moments: zeros }
    }

    /// Arrays of a checkpoint.
    pub(crate) fn arrays(&self) -> [(&'static str, &[f32]); 3] {
        [
            ("views/value", self.values.as_flattened()),
            ("views/first-moment", self.first_moments.as_flattened()),
            ("views/second-moment", self.second_moments.as_flattened()),
        ]
    }

    /// A view moved by its motion.
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

    /// The first correction with gradients that are not finite. Without corrections, none is used; with one of both, Adam keeps the
    /// moments of the other too.
    pub(crate) fn non_finite(&self, of_view: &CorrectionGradients) -> Option<StopReason> {
        if self.values.is_empty() {
            return None;
        }
        let all = of_view.array();
        let (pose, exposure) = all.split_at(of_view.pose.len());
        [("pose", pose), ("exposure", exposure)].into_iter().find_map(|(parameter, gradients)| {
            let count = gradients.iter().filter(|gradient| !gradient.is_finite()).count();
            (count > 0).then_some(StopReason::NonFiniteGradients { parameter, count })
        })
    }

    /// A step of one Adam for the corrections of all views, as in the published code: the other views have gradients of zero in this
    /// step, so their moments decay, and they move on.
    pub(crate) fn update(
        &mut self,
        number: usize,
        of_view: &CorrectionGradients,
        config: &FitConfig,
        step: u64,
        extent: f64,
    ) {
        let [bias, root] = bias_corrections(step);
        let share = LAST_SHARE.powf(step as f64 / config.steps as f64);
        let [pose, exposure] = [config.pose_rate, config.exposure_rate].map(|rate| rate.unwrap_or(0.0) * share);
        let rates: [f64; GRADIENTS] = std::array::from_fn(|at| match at {
            0..3 => pose,
            3..6 => pose * extent,
            _ => exposure,
        });
        let of_view = of_view.array();
        let moments = self.first_moments.iter_mut().zip(&mut self.second_moments);
        for (view, (values, (first, second))) in self.values.iter_mut().zip(moments).enumerate() {
            let gradients = if view == number { of_view } else { [0.0; GRADIENTS] };
            let mut moves = [0.0; GRADIENTS];
            let each = gradients.into_iter().zip(first.iter_mut().zip(second)).zip(rates);
            for (change, ((gradient, (mean, square)), rate)) in moves.iter_mut().zip(each) {
                *mean = narrowed(BETAS[0] * f64::from(*mean) + (1.0 - BETAS[0]) * gradient);
                *square = narrowed(BETAS[1] * f64::from(*square) + (1.0 - BETAS[1]) * gradient * gradient);
                *change = -rate * (f64::from(*mean) / bias) / ((f64::from(*square) / root).sqrt() + EPSILON);
            }
            apply(values, &moves);
        }
    }
}

impl CorrectionGradients {
    /// In the order of the moments; zeros for an exposure that is not optimised.
    fn array(&self) -> [f64; GRADIENTS] {
        let exposure =
            self.exposure.iter().flat_map(|exposure| exposure.matrix.into_iter().flatten().chain(exposure.offset));
        let mut all = [0.0; GRADIENTS];
        all.iter_mut()
            .zip(self.pose.into_iter().map(f64::from).chain(exposure))
            .for_each(|(slot, gradient)| *slot = gradient);
        all
    }
}

/// Turns and shifts the motion of a view, and adds to its exposure.
fn apply(values: &mut [f32; VALUES], moves: &[f64; GRADIENTS]) {
    let [rx, ry, rz, dx, dy, dz, ..] = *moves;
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

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics};
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::Strategy;

    /// Values are f32.
    const F32: Tolerance = Tolerance { absolute: 1e-6, relative: 1e-6 };

    /// What one Adam moves in steps 1 to 3, in shares of the learning rate, computed apart from this code: gradients of 3 in the first
    /// and the third step, of 2 and then −1 in the same steps, and of 4 in the second step alone.
    const TURNS: [f64; 3] = [1.0, 0.670_058_25, 0.818_002_96];
    const SHIFTS: [f64; 3] = [1.0, 0.670_058_25, 0.177_267_20];
    const OTHERS: [f64; 3] = [0.0, 0.744_136_82, 0.575_219_92];

    /// An exposure whose red adds this much green, and whose blue has an offset of as much.
    fn exposure_of(value: f64) -> Exposure {
        let mut exposure = Exposure { matrix: [[0.0; 3]; 3], offset: [0.0, 0.0, value] };
        exposure.matrix[0][1] = value;
        exposure
    }

    #[test]
    fn all_views_move_in_every_step_of_one_adam() {
        let config =
            FitConfig { pose_rate: Some(0.1), exposure_rate: Some(0.2), ..FitConfig::new(Strategy::Fixed, 100) };
        let mut corrections = Corrections::new(&config, 2);
        // Gradients of the rotation about z, of x, and of the exposure.
        for (step, view, turn, shift) in [(1, 1, 3.0, 2.0), (2, 0, 0.0, 4.0), (3, 1, 3.0, -1.0)] {
            #[expect(clippy::cast_possible_truncation, reason = "1, 2 or 4")]
            let pose = [0.0, 0.0, turn, if view == 1 { shift as f32 } else { 0.0 }, 0.0, 0.0];
            let gradients = CorrectionGradients { pose, exposure: Some(exposure_of(shift)) };
            corrections.update(view, &gradients, &config, step, 5.0);
        }
        // Rates fall to a hundredth in a hundred steps.
        let shares = [0.01_f64, 0.02, 0.03].map(|done| 0.01_f64.powf(done));
        let moved = |each: [f64; 3]| each.into_iter().zip(shares).map(|(moved, share)| moved * share).sum::<f64>();

        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::ZERO).unwrap();
        let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap());
        let view = View { camera, size: ImageSize { width: 2, height: 1 } };
        let pose = corrections.view(1, &view).unwrap().camera.camera_from_world;
        let rotation = DMat3::from_rotation_z(-0.1 * moved(TURNS));
        F32.assert(pose.rotation().to_cols_array(), rotation.to_cols_array(), "rotation");
        // Every rotation turns the translation so far. An extent is 5.
        let mut translation = DVec3::ZERO;
        for ((turn, shift), share) in TURNS.into_iter().zip(SHIFTS).zip(shares) {
            translation = DMat3::from_rotation_z(-0.1 * share * turn) * translation - DVec3::X * (0.5 * share * shift);
        }
        F32.assert(pose.translation().to_array(), translation.to_array(), "translation");

        for (view, moves) in [(0, OTHERS), (1, SHIFTS)] {
            let (exposure, change) = (corrections.exposure(view).unwrap(), -0.2 * moved(moves));
            let rows = [1.0, change, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
            F32.assert(exposure.matrix.into_iter().flatten(), rows, "matrix of the exposure");
            F32.assert(exposure.offset, [0.0, 0.0, change], "offset of the exposure");
        }
        let motion = |values: &[f32; VALUES]| values.map(f64::from).into_iter().take(7);
        Tolerance::EXACT.assert(motion(&corrections.values[0]), motion(&NONE), "motion of the other view");
    }

    #[test]
    fn gradients_of_corrections_stop_a_run_that_uses_them() {
        let [nan, infinity] = [f32::NAN, f32::INFINITY];
        let moved = CorrectionGradients { pose: [0.0, nan, 1.0, 0.0, infinity, 0.0], exposure: Some(exposure_of(0.5)) };
        let exposed = CorrectionGradients { pose: [0.5; 6], exposure: Some(exposure_of(f64::NAN)) };
        let found = |pose_rate: Option<f64>, exposure_rate: Option<f64>| {
            let config = FitConfig { pose_rate, exposure_rate, ..FitConfig::new(Strategy::Fixed, 100) };
            [&moved, &exposed].map(|gradients| match Corrections::new(&config, 2).non_finite(gradients) {
                Some(StopReason::NonFiniteGradients { parameter, count }) => Some((parameter, count)),
                _ => None,
            })
        };
        assert_eq!(found(None, None), [None, None]);
        let both = [Some(("pose", 2)), Some(("exposure", 2))];
        assert_eq!(found(Some(0.1), None), both);
        assert_eq!(found(None, Some(0.2)), both);
        let finite = CorrectionGradients { pose: [0.5; 6], exposure: None };
        let config = FitConfig { pose_rate: Some(0.1), ..FitConfig::new(Strategy::Fixed, 100) };
        assert!(Corrections::new(&config, 2).non_finite(&finite).is_none());
    }

    /// Each view has ten steps of its own; with moments that rest between them, exposures would end at 0.02.
    #[test]
    fn exposures_of_many_views_are_found() {
        const VIEWS: usize = 300;
        let config = FitConfig { exposure_rate: Some(0.01), ..FitConfig::new(Strategy::Fixed, 3000) };
        let mut corrections = Corrections::new(&config, VIEWS);
        for (step, view) in (1..=config.steps).zip((0..VIEWS).cycle()) {
            let mut gradient = exposure_of(0.0);
            gradient.offset[2] = (corrections.exposure(view).unwrap().offset[2] - 0.2).signum();
            let gradients = CorrectionGradients { pose: [0.0; 6], exposure: Some(gradient) };
            corrections.update(view, &gradients, &config, step, 1.0);
        }
        let offsets = (0..VIEWS).map(|view| corrections.exposure(view).unwrap().offset[2]);
        let mean = offsets.sum::<f64>() / VIEWS as f64;
        Tolerance::absolute(0.01).assert([mean], [0.2], "the offset of all views");
    }
}
