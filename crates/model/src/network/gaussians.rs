use atsplat_nn::f32_values;
use atsplat_splat::{GaussianParts, Gaussians};
use burn::Tensor;
use burn::tensor::activation;

use super::anchors::{Tokens, depth};
use super::layers::Head;
use crate::ModelError;
use crate::config::{ModelConfig, OffsetActivation, OpacityActivation, QuaternionActivation, ScaleActivation};

/// Smallest divisor when a quaternion is normalised: PyTorch's `normalize`.
const EPSILON: f64 = 1e-12;

/// Gaussians of a batch of scenes as tensors with gradients, ordered by token.
#[derive(Clone, Debug)]
pub struct GaussianTensors {
    /// Centres in scene units, `[scenes, Gaussians, 3]`.
    pub means: Tensor<3>,
    /// Unit quaternions `w, x, y, z`, `[scenes, Gaussians, 4]`.
    pub quaternions: Tensor<3>,
    /// Natural logarithms of the standard deviations, `[scenes, Gaussians, 3]`.
    pub log_scales: Tensor<3>,
    /// Opacities before the sigmoid, `[scenes, Gaussians]`.
    pub opacity_logits: Tensor<2>,
    /// Spherical harmonics, red, green, blue of the first coefficient first, `[scenes, Gaussians, coefficients · 3]`.
    pub sh: Tensor<3>,
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
}

/// Predicts Gaussians from tokens.
pub(super) fn gaussians(config: &ModelConfig, head: &Head, tokens: &Tokens) -> GaussianTensors {
    let settings = &config.head;
    let design = config.anchors.design;
    let [scenes, count, _] = tokens.features.dims();
    let (per_token, place) = (settings.gaussians_per_token, design.centre_channels());
    let channels = settings.channels(place);
    let raw = head.forward(tokens.features.clone()).reshape([scenes, count * per_token, channels]);
    let part = |start: usize, length: usize| raw.clone().slice_dim(2, start..start + length);

    let centre = part(0, place);
    let spread = |x: Tensor<3>| x.reshape([scenes, count * per_token, 3]);
    let means = match (&tokens.rays, &tokens.anchors) {
        (Some([origins, directions]), _) => {
            spread(origins.clone()) + spread(directions.clone()) * depth(config.anchors.depth, centre)
        }
        (None, Some(anchors)) => {
            let repeated = anchors.clone().unsqueeze_dim::<4>(2).repeat_dim(2, per_token);
            let offsets = match &tokens.frames {
                Some(frames) => frames.offsets(settings.cells(), centre),
                None => offset(settings.offset, centre),
            };
            offsets + repeated.reshape([scenes, count * per_token, 3])
        }
        (None, None) => offset(settings.offset, centre),
    };
    let rotation = match settings.quaternion {
        QuaternionActivation::Normalize => part(place, 4),
        QuaternionActivation::NormalizeFromIdentity => {
            let identity = Tensor::<1>::from_floats([1.0, 0.0, 0.0, 0.0], &raw.device());
            part(place, 4) + identity.unsqueeze()
        }
    };
    // Clamped before the root, whose derivative at zero is infinite.
    let length = (rotation.clone() * rotation.clone()).sum_dim(2).clamp_min(EPSILON * EPSILON).sqrt();
    let scale = part(place + 4, 3);
    let log_scales = match (&tokens.frames, settings.scale) {
        (Some(frames), _) => frames.log_scales(settings.cells(), scale),
        (None, ScaleActivation::ExpClamped { shift, max }) => (scale + shift).clamp_max(max),
        (None, ScaleActivation::Softplus { shift, gain }) => (activation::softplus(scale + shift, 1.0) * gain).log(),
    };
    let OpacityActivation::Sigmoid { shift } = settings.opacity;
    GaussianTensors {
        means,
        quaternions: rotation / length,
        log_scales,
        opacity_logits: part(place + 7, 1).squeeze_dim(2) + shift,
        sh: part(place + 8, 3 * settings.sh_coefficients()),
        sh_degree: settings.sh_degree,
    }
}

fn offset(rule: OffsetActivation, x: Tensor<3>) -> Tensor<3> {
    match rule {
        OffsetActivation::Linear { gain } => x * gain,
        OffsetActivation::InverseLog { gain } => (x.clone().abs().exp() - 1.0) * x.sign() * gain,
    }
}

impl GaussianTensors {
    /// The Gaussians of one scene in the renderers' format.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if there is no such scene.
    pub fn scene(&self, scene: usize) -> Result<Gaussians, ModelError> {
        let [scenes, ..] = self.means.dims();
        if scene >= scenes {
            return Err(ModelError::malformed("network", "scene", format!("one of {scenes}"), scene));
        }
        let rows = |tensor: &Tensor<3>| f32_values(tensor.clone().slice_dim(0, scene..scene + 1));
        let parts = GaussianParts {
            means: rows(&self.means).as_chunks().0.to_vec(),
            quaternions: rows(&self.quaternions).as_chunks().0.to_vec(),
            log_scales: rows(&self.log_scales).as_chunks().0.to_vec(),
            opacity_logits: rows(&self.opacity_logits.clone().unsqueeze_dim(2)),
            sh_degree: self.sh_degree,
            sh: rows(&self.sh).as_chunks().0.to_vec(),
            scalars: None,
            filter_3d: None,
        };
        Gaussians::new(parts)
            .map_err(|error| ModelError::malformed("network", "Gaussians", "arrays of one length", error))
    }

    /// [`Self::scene`], checked to be finite.
    ///
    /// # Errors
    /// As [`Self::scene`]; [`ModelError::NonFinite`] if a number is NaN or infinite.
    pub fn finite_scene(&self, scene: usize) -> Result<Gaussians, ModelError> {
        let gaussians = self.scene(scene)?;
        match non_finite(&gaussians) {
            0 => Ok(gaussians),
            count => Err(ModelError::NonFinite { location: "Gaussians".to_owned(), count }),
        }
    }
}

/// Number of values that are NaN or infinite.
fn non_finite(gaussians: &Gaussians) -> usize {
    let GaussianParts { means, quaternions, log_scales, opacity_logits, sh, .. } = gaussians.parts();
    let (means, quaternions, log_scales) =
        (means.as_flattened(), quaternions.as_flattened(), log_scales.as_flattened());
    let numbers = [means, quaternions, log_scales, opacity_logits, sh.as_flattened()];
    numbers.into_iter().flatten().filter(|number| !number.is_finite()).count()
}
