use atsplat_camera::{Camera, CameraFromWorld};
use glam::{DMat3, DQuat, DVec3};

use crate::{GaussianParts, Gaussians, GradientField, Gradients, SplatError, View, sh_coefficients};

/// A scalar parameter of a rendering that has a gradient.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Parameter {
    Mean(usize, usize),
    Quaternion(usize, usize),
    LogScale(usize, usize),
    Logit(usize),
    Scalar(usize),
    /// Index among all coefficients, and channel.
    Sh(usize, usize),
    /// Rotation, then translation.
    Pose(usize),
}

impl Parameter {
    /// Every parameter of one Gaussian; of its SH coefficients only the first and the last.
    pub(crate) fn of_gaussian(gaussians: &Gaussians, position: usize) -> Vec<Self> {
        let coefficients = sh_coefficients(gaussians.sh_degree());
        let (first, last) = (position * coefficients, position * coefficients + coefficients - 1);
        let mut list: Vec<Self> =
            (0..3).flat_map(|axis| [Self::Mean(position, axis), Self::LogScale(position, axis)]).collect();
        list.extend((0..4).map(|axis| Self::Quaternion(position, axis)));
        list.extend([Self::Logit(position), Self::Scalar(position)]);
        list.extend((0..3).map(|channel| Self::Sh(first, channel)));
        list.extend((0..3).filter(|_| last > first).map(|channel| Self::Sh(last, channel)));
        list
    }

    /// The field that its gradient is in.
    pub(crate) const fn field(self) -> GradientField {
        match self {
            Self::Mean(..) => GradientField::Means,
            Self::Quaternion(..) => GradientField::Quaternions,
            Self::LogScale(..) => GradientField::LogScales,
            Self::Logit(_) => GradientField::OpacityLogits,
            Self::Sh(..) => GradientField::Sh,
            Self::Scalar(_) => GradientField::Scalars,
            Self::Pose(_) => GradientField::Pose,
        }
    }

    /// The gradient with respect to it.
    pub(crate) fn gradient_in<T: Copy + Into<f64>>(self, gradients: &Gradients<T>) -> Option<f64> {
        let value = match self {
            Self::Mean(at, axis) => gradients.means.get(at)?.get(axis)?,
            Self::Quaternion(at, axis) => gradients.quaternions.get(at)?.get(axis)?,
            Self::LogScale(at, axis) => gradients.log_scales.get(at)?.get(axis)?,
            Self::Logit(at) => gradients.opacity_logits.get(at)?,
            Self::Scalar(at) => gradients.scalars.get(at)?,
            Self::Sh(at, channel) => gradients.sh.get(at)?.get(channel)?,
            Self::Pose(axis) => gradients.pose.get(axis)?,
        };
        Some((*value).into())
    }

    /// The parameter's value in the arrays; `None` for the pose.
    pub(crate) fn slot(self, parts: &mut GaussianParts) -> Option<&mut f32> {
        match self {
            Self::Mean(at, axis) => parts.means.get_mut(at)?.get_mut(axis),
            Self::Quaternion(at, axis) => parts.quaternions.get_mut(at)?.get_mut(axis),
            Self::LogScale(at, axis) => parts.log_scales.get_mut(at)?.get_mut(axis),
            Self::Logit(at) => parts.opacity_logits.get_mut(at),
            Self::Scalar(at) => parts.scalars.as_mut()?.get_mut(at),
            Self::Sh(at, channel) => parts.sh.get_mut(at)?.get_mut(channel),
            Self::Pose(_) => None,
        }
    }
}

/// The view after a small motion of the camera.
pub(crate) fn moved(view: &View, axis: usize, step: f64) -> Result<View, SplatError> {
    let unit = [DVec3::X, DVec3::Y, DVec3::Z][axis % 3] * step;
    let (rotation, translation) = if axis < 3 { (unit, DVec3::ZERO) } else { (DVec3::ZERO, unit) };
    let rotation = DMat3::from_quat(DQuat::from_scaled_axis(rotation));
    let pose = view.camera.camera_from_world;
    let pose = CameraFromWorld::new(rotation * pose.rotation(), rotation * pose.translation() + translation)?;
    Ok(View { camera: Camera { camera_from_world: pose, ..view.camera }, ..*view })
}
