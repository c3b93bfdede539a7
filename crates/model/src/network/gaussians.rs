use atsplat_nn::f32_values;
use atsplat_splat::{GaussianParts, Gaussians};
use burn::Tensor;
use burn::tensor::activation;

use super::anchors::depth;
use super::layers::Head;
use super::{Place, Tokens};
use crate::ModelError;
use crate::config::{ModelConfig, OffsetActivation, OpacityActivation, QuaternionActivation, ScaleActivation};

/// Smallest divisor when a quaternion is normalised: PyTorch's `normalize`.
const EPSILON: f64 = 1e-12;
/// Below, `ln(1 + e^x)` is `e^x` in f32.
const EXPONENTIAL_BELOW: f64 = -20.0;
/// Below, `e^x − 1` is a series, because the difference has lost digits.
const SERIES_BELOW: f64 = 0.25;

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
    let [scenes, count, _] = tokens.features.dims();
    let (per_token, of_centre) = (settings.gaussians_per_token, config.anchors.design.centre_channels());
    let channels = settings.channels(of_centre);
    // In two dimensions, the derivative of a slice is copied faster than in three.
    let raw = head.forward(tokens.features.clone()).reshape([scenes * count * per_token, channels]);
    let part = |start: usize, length: usize| -> Tensor<3> {
        raw.clone().slice_dim(1, start..start + length).reshape([scenes, count * per_token, length])
    };

    let centre = part(0, of_centre);
    let spread = |x: Tensor<3>| x.reshape([scenes, count * per_token, 3]);
    let means = match &tokens.place {
        Place::Rays([origins, directions]) => {
            spread(origins.clone()) + spread(directions.clone()) * depth(config.anchors.depth, centre)
        }
        Place::Anchored { anchors, frames, .. } => {
            let repeated = anchors.clone().unsqueeze_dim::<4>(2).repeat_dim(2, per_token);
            let offsets = match frames {
                Some(frames) => frames.offsets(settings, centre),
                None => offset(settings.offset, centre),
            };
            offsets + repeated.reshape([scenes, count * per_token, 3])
        }
        Place::Free => offset(settings.offset, centre),
    };
    let rotation = match settings.quaternion {
        QuaternionActivation::Normalize => part(of_centre, 4),
        QuaternionActivation::NormalizeFromIdentity => {
            let identity = Tensor::<1>::from_floats([1.0, 0.0, 0.0, 0.0], &raw.device());
            part(of_centre, 4) + identity.unsqueeze()
        }
    };
    // Clamped before the root, whose derivative at zero is infinite.
    let length = (rotation.clone() * rotation.clone()).sum_dim(2).clamp_min(EPSILON * EPSILON).sqrt();
    let scale = part(of_centre + 4, 3);
    let log_scales = match (tokens.place.frames(), settings.scale) {
        (Some(frames), _) => frames.log_scales(settings, scale),
        (None, ScaleActivation::ExpClamped { shift, max }) => (scale + shift).clamp_max(max),
        (None, ScaleActivation::Softplus { shift, gain }) => log_softplus(scale + shift, gain),
    };
    let OpacityActivation::Sigmoid { shift } = settings.opacity;
    GaussianTensors {
        means,
        quaternions: rotation / length,
        log_scales,
        opacity_logits: part(of_centre + 7, 1).squeeze_dim(2) + shift,
        sh: part(of_centre + 8, 3 * settings.sh_coefficients()),
        sh_degree: settings.sh_degree,
    }
}

fn offset(rule: OffsetActivation, x: Tensor<3>) -> Tensor<3> {
    match rule {
        OffsetActivation::Linear { gain } => x * gain,
        OffsetActivation::InverseLog { gain } => inverse_log(x) * gain,
    }
}

/// `ln(gain · ln(1 + e^x))`, finite wherever `x` is: the inner logarithm is 0 in f32 from −104 on.
fn log_softplus(x: Tensor<3>, gain: f64) -> Tensor<3> {
    let small = x.clone().lower_elem(EXPONENTIAL_BELOW);
    // What the mask discards must be finite all the same, or its gradient would be 0 · ∞.
    let large = x.clone().mask_fill(small.clone(), EXPONENTIAL_BELOW);
    (activation::softplus(large, 1.0) * gain).log().mask_where(small, x + gain.ln())
}

/// `sign(x) · (e^|x| − 1)`. Without the series, the derivative at 0 would be that of the sign, which burn takes to be 0.
fn inverse_log(x: Tensor<3>) -> Tensor<3> {
    let far = x.clone().abs().greater_equal_elem(SERIES_BELOW);
    let near = x.clone().mask_fill(far.clone(), 0.0);
    let size = near.clone().abs();
    // 1 + s/2 (1 + s/3 (1 + s/4 (1 + s/5 (1 + s/6)))), which leaves out less than 1e-7 of it.
    let start = size.clone() / 6.0 + 1.0;
    let series = [5.0f64, 4.0, 3.0, 2.0].into_iter().fold(start, |sum, n| sum * size.clone() / n + 1.0);
    (near * series).mask_where(far, (x.clone().abs().exp() - 1.0) * x.sign())
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

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;
    use burn::tensor::Device;

    use super::*;

    const F32: Tolerance = Tolerance { absolute: 0.0, relative: 2e-6 };

    fn tensor(raw: [f32; 6], device: &Device) -> Tensor<3> {
        Tensor::<1>::from_floats(raw, device).reshape([1, 2, 3])
    }

    /// Compares values and derivatives with those of a function in f64.
    fn check(raw: [f32; 6], of: impl Fn(Tensor<3>) -> Tensor<3>, exact: impl Fn(f64) -> [f64; 2]) {
        let x = tensor(raw, &Device::flex().autodiff()).require_grad();
        let values = of(x.clone());
        let slopes = x.grad(&values.clone().sum().backward()).unwrap();
        for (at, found) in [values, slopes].into_iter().enumerate() {
            let expected = raw.iter().map(|x| exact(f64::from(*x))[at]);
            F32.assert(f32_values(found).into_iter().map(f64::from), expected, ["values", "derivatives"][at]);
        }
    }

    #[test]
    fn scales_of_far_negative_outputs_are_finite_and_keep_their_derivative() {
        let gain = 0.01;
        let exact = |x: f64| {
            let softplus = x.exp().ln_1p();
            [(gain * softplus).ln(), 1.0 / (1.0 + (-x).exp()) / softplus]
        };
        check([-110.0, -600.0, -20.5, -3.0, 0.75, 25.0], |x| log_softplus(x, gain), exact);
        let x = tensor([-20.0, -19.5, -1.0, 0.0, 3.0, 25.0], &Device::flex());
        let plain = (activation::softplus(x.clone(), 1.0) * gain).log();
        assert_eq!(f32_values(log_softplus(x, gain)), f32_values(plain), "the same bits");
    }

    #[test]
    fn offsets_keep_their_derivative_and_digits_at_0() {
        let rule = OffsetActivation::InverseLog { gain: 0.5 };
        let exact = |x: f64| [0.5 * x.signum() * x.abs().exp_m1(), 0.5 * x.abs().exp()];
        check([0.0, 1e-4, -1e-4, 0.2, -0.3, 1.5], |x| offset(rule, x), exact);
        let x = tensor([0.25, -0.25, 0.3, -1.0, 3.0, -7.0], &Device::flex());
        let plain = (x.clone().abs().exp() - 1.0) * x.clone().sign() * 0.5;
        assert_eq!(f32_values(offset(rule, x)), f32_values(plain), "the same bits");
    }

    #[test]
    fn activations_do_not_hide_nan() {
        let x = tensor([f32::NAN; 6], &Device::flex());
        for found in [log_softplus(x.clone(), 0.01), inverse_log(x)] {
            assert!(f32_values(found).iter().all(|value| value.is_nan()));
        }
    }
}
