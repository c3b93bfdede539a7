//! LPIPS and ST-LPIPS as a loss: the metric's network on tensors with gradients.

use std::path::Path;

use atsplat_metrics::learned::{LpipsNetwork, SCALING, Step, embedded_heads};
use atsplat_model::network::f32_values;
use atsplat_model::weights::{StoredTensors, TensorFile};
use burn::Tensor;
use burn::tensor::module::{conv2d, max_pool2d};
use burn::tensor::ops::{ConvOptions, MaxPoolOptions};
use burn::tensor::{Device, TensorData, activation};

use super::{Loss, Stack, graph};
use crate::TrainError;

/// Smallest length of a feature vector: lpips `normalize_tensor`.
const EPSILON: f64 = 1e-10;

/// LPIPS or ST-LPIPS with its weights.
#[derive(Debug)]
pub struct LpipsLoss {
    network: LpipsNetwork,
    sha256: String,
    steps: Vec<Step>,
    /// Those of the steps, in their order.
    convolutions: Vec<Convolution>,
    /// One weight per channel of each feature map, `[1, channels, 1, 1]`.
    heads: Vec<Tensor<4>>,
}

#[derive(Debug)]
struct Convolution {
    weight: Tensor<4>,
    bias: Tensor<1>,
    options: ConvOptions<2>,
}

impl LpipsLoss {
    /// Reads a network's weights to a device with gradients, as the metric does: torchvision's state dict for LPIPS, the package's
    /// separate file for ST-LPIPS.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if a tensor is absent or of another shape.
    pub fn read(network: LpipsNetwork, path: &Path, device: &Device) -> Result<Self, TrainError> {
        let file = TensorFile::open(path)?;
        let heads = match embedded_heads(network) {
            Some(heads) => heads.map_err(|error| TrainError::malformed("heads", network.name(), "tensors", error))?,
            None => file.stored.clone(),
        };
        Self::new(network, &file.stored, &heads, file.sha256.to_string(), device)
    }

    /// A loss with the given tensors on a device with gradients.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn new(
        network: LpipsNetwork,
        weights: &StoredTensors,
        heads: &StoredTensors,
        sha256: String,
        device: &Device,
    ) -> Result<Self, TrainError> {
        // Weights are constants; only the image has a gradient.
        let numbers = |stored: &StoredTensors, name: &str, shape: &[usize]| {
            let tensor = stored.tensors.get(name).filter(|tensor| tensor.shape() == shape);
            let absent = || TrainError::malformed(network.name(), name, format!("a tensor of shape {shape:?}"), "none");
            Ok::<_, TrainError>(TensorData::new(tensor.ok_or_else(absent)?.to_f32()?, shape))
        };
        let steps = network.steps();
        let mut convolutions = Vec::new();
        for step in &steps {
            let Step::Convolution { name, channels_in, channels_out, kernel, stride, padding, .. } = step else {
                continue;
            };
            let shape = [*channels_out, *channels_in, *kernel, *kernel];
            let weight = Tensor::from_data(numbers(weights, &format!("{name}.weight"), &shape)?, device);
            let bias = Tensor::from_data(numbers(weights, &format!("{name}.bias"), &[*channels_out])?, device);
            let options = ConvOptions::new([*stride; 2], [*padding; 2], [1; 2], 1);
            convolutions.push(Convolution { weight, bias, options });
        }
        let heads = LpipsNetwork::heads()
            .into_iter()
            .zip(network.channels())
            .map(|(name, channels)| Ok(Tensor::from_data(numbers(heads, &name, &[1, channels, 1, 1])?, device)));
        let heads = heads.collect::<Result<_, TrainError>>()?;
        Ok(Self { network, sha256, steps, convolutions, heads })
    }

    /// The network's name and the hash of its weights.
    pub fn name(&self) -> String {
        format!("{}, weights {}", self.network.name(), self.sha256)
    }

    /// The distance of images `[images, height, width, 3]`, mean over the views of each sample, the same number in all; no
    /// gradient reaches the second. Images are not clamped, as in the training of LPIPS itself.
    pub fn distance(&self, render: Tensor<4>, truth: Tensor<4>, samples: usize) -> Tensor<1> {
        let mut distance = Tensor::<1>::zeros([samples], &render.device());
        for ((ours, theirs), head) in self.features(render).into_iter().zip(self.features(truth)).zip(&self.heads) {
            let [_, channels, ..] = ours.dims();
            let difference = ours - theirs.detach();
            let weighted = difference.clone() * difference * head.clone();
            // A sum over channels, a mean over everything else.
            distance = distance + graph::means(weighted, samples) * channels as f64;
        }
        distance
    }

    /// The distance and its gradient.
    pub fn evaluate(&self, render: &[f32], truth: &[f32], stack: Stack) -> Loss {
        let Stack { views, height, width } = stack;
        #[expect(clippy::expect_used, reason = "every network has five heads")]
        let device = self.heads.first().expect("a head").device();
        let images = |values: &[f32]| {
            Tensor::<4>::from_data(TensorData::new(values.to_vec(), [views, height, width, 3]), &device)
        };
        let render = images(render).require_grad();
        let distance = self.distance(render.clone(), images(truth), 1);
        let value = f64::from(distance.clone().into_scalar::<f32>());
        #[expect(clippy::expect_used, reason = "the distance depends on the render")]
        let gradient = render.grad(&distance.backward()).expect("a gradient of the render");
        Loss { value, gradient: f32_values(gradient) }
    }

    /// Five feature maps of images `[views, height, width, 3]`, normalised over the channels of each pixel.
    #[expect(clippy::expect_used, reason = "convolutions come from the same steps")]
    fn features(&self, images: Tensor<4>) -> Vec<Tensor<4>> {
        let device = images.device();
        let [shift, scale] = SCALING.map(|numbers| Tensor::<1>::from_floats(numbers, &device).reshape([1, 1, 1, 3]));
        let scaled = (images * 2.0 - 1.0 - shift) / scale;
        let mut map = scaled.permute([0, 3, 1, 2]);
        let mut maps = Vec::new();
        let mut convolutions = self.convolutions.iter();
        for step in &self.steps {
            map = match step {
                Step::Convolution { relu, .. } => {
                    let Convolution { weight, bias, options } = convolutions.next().expect("each such step has one");
                    let map = conv2d(map, weight.clone(), Some(bias.clone()), options.clone());
                    if *relu { activation::relu(map) } else { map }
                }
                Step::Relu => activation::relu(map),
                Step::MaxPool { kernel, stride } => {
                    max_pool2d(map, MaxPoolOptions::new([*kernel; 2]).with_stride([*stride; 2]))
                }
                Step::BlurPool => blurred(&map),
                Step::Tap => {
                    maps.push(normalised(map.clone()));
                    map
                }
            };
        }
        maps
    }
}

/// Clamped before the root, whose derivative at zero is infinite: all-zero features are common.
fn normalised(map: Tensor<4>) -> Tensor<4> {
    let length = (map.clone() * map.clone()).sum_dim(1).clamp_min(EPSILON * EPSILON).sqrt() + EPSILON;
    map / length
}

/// Blurs with (1 2 1)⊗(1 2 1) / 16 at every second pixel, after padding by two reflected pixels.
fn blurred(map: &Tensor<4>) -> Tensor<4> {
    let [_, channels, ..] = map.dims();
    let row = [1.0, 2.0, 1.0];
    let kernel = row.map(|y| row.map(|x| y * x / 16.0));
    let kernel = Tensor::<2>::from_floats(kernel, &map.device()).reshape([1, 1, 3, 3]).repeat_dim(0, channels);
    conv2d(reflected(&reflected(map, 2), 3), kernel, None, ConvOptions::new([2; 2], [0; 2], [1; 2], channels))
}

/// Pads a dimension by two reflected lines at each end; the outermost line is not repeated.
fn reflected(map: &Tensor<4>, dimension: usize) -> Tensor<4> {
    let side = map.dims()[dimension];
    let line = |at: usize| map.clone().slice_dim(dimension, at..at + 1);
    let after = side.saturating_sub(2);
    Tensor::cat(vec![line(2), line(1), map.clone(), line(after), line(after.saturating_sub(1))], dimension)
}
