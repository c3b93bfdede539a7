use std::path::{Path, PathBuf};

use atsplat_pixels::Image;
use atsplat_tensors::{StoredTensors, TensorFile};
use serde::Serialize;

use super::architecture::Step;
use super::convolution::{Convolution, rectify};
use super::features::{Features, distances, normalised};
use super::matrix::Activations;
use super::{LoadError, LpipsNetwork, WeightsAbsent, WeightsFolders, embedded_heads, pooling};
use crate::{MetricError, NonFinite};

/// LPIPS or ST-LPIPS on one of its networks, with the weights.
#[derive(Clone, Debug)]
pub struct Lpips {
    network: LpipsNetwork,
    steps: Vec<Step>,
    /// Those of the steps, in their order.
    convolutions: Vec<Convolution>,
    /// Channel weights of each layer.
    heads: [Vec<f32>; 5],
    hashes: WeightsHashes,
    /// The network's file.
    file: Option<PathBuf>,
}

/// Hashes of the weights of a learned metric.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct WeightsHashes {
    /// SHA-256 of the network's file, in hexadecimal.
    pub network: String,
    /// SHA-256 of the file with the heads, or of their tensors for embedded heads.
    pub heads: String,
}

impl Lpips {
    /// Loads the network's file, found by its published name, and the embedded heads.
    ///
    /// # Errors
    /// [`LoadError::Absent`], and as [`Lpips::from_file`].
    pub fn find(network: LpipsNetwork, folders: &WeightsFolders) -> Result<Self, LoadError> {
        let path = folders.find(network).map_err(LoadError::Absent)?;
        Self::from_file(network, &path)
    }

    /// Reads a network's weights from a `torch.save` or safetensors file: torchvision's state dict for LPIPS, to which the
    /// embedded heads belong, or the package's file for ST-LPIPS, which contains its heads.
    ///
    /// # Errors
    /// [`LoadError::Absent`] if the file does not exist; [`LoadError::File`], [`LoadError::Mismatch`].
    pub fn from_file(network: LpipsNetwork, weights: &Path) -> Result<Self, LoadError> {
        if !weights.is_file() {
            return Err(LoadError::Absent(WeightsAbsent::new(network, vec![weights.to_owned()])));
        }
        let file = TensorFile::open(weights)?;
        let (heads, heads_hash) = match embedded_heads(network).transpose()? {
            Some(embedded) => {
                let digest = embedded.digest();
                (embedded, digest)
            }
            None => (file.stored.clone(), file.sha256.to_string()),
        };
        tracing::info!(metric = network.name(), file = %weights.display(), %file.sha256, "read weights of a metric");
        let hashes = WeightsHashes { network: file.sha256.to_string(), heads: heads_hash };
        let lpips = Self::from_tensors(network, &file.stored, &heads, hashes)?;
        Ok(Self { file: Some(weights.to_owned()), ..lpips })
    }

    /// Builds the metric from tensors.
    ///
    /// # Errors
    /// [`LoadError::Mismatch`] for a tensor that is missing, of another shape, or not finite.
    pub fn from_tensors(
        network: LpipsNetwork,
        weights: &StoredTensors,
        heads: &StoredTensors,
        hashes: WeightsHashes,
    ) -> Result<Self, LoadError> {
        let steps = network.steps();
        let mut convolutions = Vec::new();
        for step in &steps {
            let Step::Convolution { name, channels_in, channels_out, kernel, stride, padding, .. } = step else {
                continue;
            };
            let tensor = |part: &str, shape: &[usize]| numbers(network, weights, &format!("{name}.{part}"), shape);
            let weight = tensor("weight", &[*channels_out, *channels_in, *kernel, *kernel])?;
            let bias = tensor("bias", &[*channels_out])?;
            let shape = [*channels_out, *channels_in, *kernel];
            convolutions.push(Convolution::new(shape, *stride, *padding, &weight, bias));
        }
        let mut head_weights: [Vec<f32>; 5] = Default::default();
        for ((slot, name), channels) in head_weights.iter_mut().zip(LpipsNetwork::heads()).zip(network.channels()) {
            *slot = numbers(network, heads, &name, &[1, channels, 1, 1])?;
        }
        Ok(Self { network, steps, convolutions, heads: head_weights, hashes, file: None })
    }

    /// The network.
    pub const fn network(&self) -> LpipsNetwork {
        self.network
    }

    /// Hashes of the weights.
    pub const fn hashes(&self) -> &WeightsHashes {
        &self.hashes
    }

    /// How the network's weights differ from the published ones: the file, its SHA-256 and the start of the published
    /// one's; `None` if they are the published ones.
    pub fn unpublished(&self) -> Option<String> {
        let (name, published, found) = (self.network.name(), self.network.sha256_prefix(), &self.hashes.network);
        if self.network.is_published(found) {
            return None;
        }
        let file = self.file.as_deref().map_or_else(|| "tensors".to_owned(), |file| file.display().to_string());
        Some(format!("{name}: expected the SHA-256 {published}… of the published weights, found {found} ({file})"))
    }

    /// Features of an image with values in [0, 1]; values outside are not clipped. Features of a ground truth can be reused
    /// for all renders of it.
    ///
    /// # Errors
    /// [`MetricError::TooSmall`], [`MetricError::NonFinite`].
    #[expect(clippy::expect_used, reason = "convolutions come from the same steps")]
    pub fn features(&self, image: &Image) -> Result<Features, MetricError> {
        let size = [image.width(), image.height()];
        let smallest = self.network.smallest_side();
        if size.iter().any(|side| *side < smallest) {
            return Err(MetricError::TooSmall { measure: self.network.name(), smallest, size });
        }
        let non_finite = NonFinite::count(image.samples(), &[], size[0] as usize);
        if non_finite.total() > 0 {
            return Err(MetricError::NonFinite(non_finite));
        }
        let mut maps = Vec::new();
        let mut activations = scaled(image);
        let mut convolutions = self.convolutions.iter();
        for step in &self.steps {
            match step {
                Step::Convolution { relu, .. } => {
                    activations = convolutions.next().expect("each such step has one").apply(&activations, *relu);
                }
                Step::Relu => rectify(&mut activations.values),
                Step::MaxPool { kernel, stride } => activations = pooling::max_pool(&activations, *kernel, *stride),
                Step::BlurPool => activations = pooling::blur_pool(&activations),
                Step::Tap => maps.push(normalised(activations.clone())),
            }
        }
        Ok(Features { network: self.network, weights: self.hashes.network.clone(), image: size, maps })
    }

    /// Distance of two images by their features: 0 for identical images, larger for less similar ones.
    ///
    /// # Errors
    /// [`MetricError::OtherFeatures`] for features by another network or by other weights; [`MetricError::SizeMismatch`];
    /// [`MetricError::Overflow`] if an image's features are not finite.
    pub fn distance(&self, render: &Features, truth: &Features) -> Result<f64, MetricError> {
        self.require_own(render)?;
        self.require_own(truth)?;
        if truth.image != render.image {
            let (expected, found) = (render.image, truth.image);
            return Err(MetricError::SizeMismatch { expected, found });
        }
        let maps = render.maps.iter().zip(&truth.maps).zip(&self.heads);
        let distances = maps.map(|((render, truth), head)| distances(render, truth, head));
        let distance: f64 = distances.map(|map| map.iter().sum::<f64>() / map.len() as f64).sum();
        if distance.is_finite() { Ok(distance) } else { Err(MetricError::Overflow { measure: self.network.name() }) }
    }

    fn require_own(&self, features: &Features) -> Result<(), MetricError> {
        if (self.network, &self.hashes.network) == (features.network, &features.weights) {
            return Ok(());
        }
        let named = |network: LpipsNetwork, weights: &str| format!("{} with the weights {weights}", network.name());
        let expected = named(self.network, &self.hashes.network);
        Err(MetricError::OtherFeatures { expected, found: named(features.network, &features.weights) })
    }
}

/// Shift and scale per channel, applied to `2 v − 1` (lpips `ScalingLayer`, `normalize=True`).
pub const SCALING: [[f32; 3]; 2] = [[-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]];

fn scaled(image: &Image) -> Activations {
    let [shift, scale] = SCALING;
    let pixels = image.samples().as_chunks::<3>().0.iter();
    let values = pixels.flat_map(|pixel| {
        std::array::from_fn::<f32, 3, _>(|channel| (2.0 * pixel[channel] - 1.0 - shift[channel]) / scale[channel])
    });
    let [width, height] = [image.width(), image.height()].map(|side| side as usize);
    Activations { height, width, channels: 3, values: values.collect() }
}

fn numbers(network: LpipsNetwork, weights: &StoredTensors, name: &str, shape: &[usize]) -> Result<Vec<f32>, LoadError> {
    let mismatch =
        |expected: String, found: String| LoadError::Mismatch { network, tensor: name.to_owned(), expected, found };
    let expected = || format!("shape {shape:?}");
    let tensor = weights.tensors.get(name).ok_or_else(|| mismatch(expected(), "no such tensor".to_owned()))?;
    if tensor.shape() != shape {
        return Err(mismatch(expected(), format!("shape {:?}", tensor.shape())));
    }
    let values = tensor.to_f32()?;
    match values.iter().filter(|value| !value.is_finite()).count() {
        0 => Ok(values),
        count => Err(mismatch("finite numbers".to_owned(), format!("{count} that are NaN or infinite"))),
    }
}
