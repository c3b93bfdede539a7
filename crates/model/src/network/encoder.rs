//! Which encoder a scene was encoded with: the parts before the decoder, with their weights.

use std::sync::Arc;

use atsplat_files::Sha256Digest;
use atsplat_nn::f32_values;
use burn::Tensor;
use burn::module::Param;

use super::Network;
use super::names::{ModulePath, ParameterVisitor};
use crate::ModelError;
use crate::config::ModelConfig;

/// The parts whose weights do not take part in encoding.
const NOT_ENCODING: [&str; 2] = ["decoder.", "head."];

/// An encoder.
#[derive(Clone, Debug)]
pub(super) struct Encoder {
    config: ModelConfig,
    weights: Sha256Digest,
}

impl Network {
    /// Its encoder.
    pub(super) fn encoder(&self) -> Encoder {
        Encoder { config: self.config.clone(), weights: self.encoder_sha256() }
    }

    /// An error unless this network encodes to the same bits as an encoder.
    pub(super) fn check_encoder(&self, encoder: &Encoder) -> Result<(), ModelError> {
        let other = |found: String| {
            let expected = "one by the encoder of this network, with its weights";
            Err(ModelError::malformed("network", "encoded scene", expected, found))
        };
        if !self.config.encodes_like(&encoder.config) {
            return other(format!("one by {}, which encodes in another way", encoder.config.name));
        }
        if self.encoder_sha256() != encoder.weights {
            return other(format!("one by other weights, sha256 {}", encoder.weights));
        }
        Ok(())
    }

    /// The same network, of which weights have been replaced.
    pub(super) fn with_other_weights(self) -> Self {
        Self { encoder_sha256: Arc::default(), ..self }
    }

    /// The hash of the weights before the decoder.
    fn encoder_sha256(&self) -> Sha256Digest {
        if let Some(known) = self.encoder_sha256.get() {
            return *known;
        }
        let mut hash = EncoderHash { tensors: Vec::new() };
        self.visit_parameters(&mut hash);
        // Not computed in here: a thread that waits for tensors may begin other work, which would wait for this.
        *self.encoder_sha256.get_or_init(|| Sha256Digest::of(&hash.tensors))
    }
}

/// Hashes the tensors of an encoder.
struct EncoderHash {
    /// The hash of each tensor with its name, one after the other.
    tensors: Vec<u8>,
}

impl ParameterVisitor for EncoderHash {
    fn visit_parameter<const D: usize>(&mut self, path: &ModulePath, param: &Param<Tensor<D>>) {
        let name = path.name();
        if NOT_ENCODING.iter().any(|part| name.starts_with(part)) {
            return;
        }
        let values: Vec<u8> = f32_values(param.val()).into_iter().flat_map(f32::to_le_bytes).collect();
        self.tensors.extend(Sha256Digest::of_parts([name.as_bytes(), values.as_slice()]).0);
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::super::tests::base;
    use super::*;
    use crate::config::Upsampling;
    use crate::parameters::parameters;
    use crate::weights::{StoredTensors, generated};

    #[test]
    fn a_scene_is_decoded_by_networks_with_its_encoder_alone() {
        let (fixture, device) = (base(), Device::flex());
        let views = fixture.views();
        let network = |config: &ModelConfig, weights: &StoredTensors| {
            Network::new(config, &device).unwrap().with_weights(weights).unwrap()
        };
        let [weights, others] =
            [fixture.seed, fixture.seed + 1].map(|seed| generated(&parameters(&fixture.config), seed));
        let first = network(&fixture.config, &weights);
        let scene = first.encode_scene(&views).unwrap();
        let decoded = |network: &Network| {
            let made = network.reconstruct_encoded(scene.clone(), 0);
            made.map(|made| made.gaussians).map_err(|error| error.to_string())
        };
        assert_eq!(decoded(&first).unwrap(), first.reconstruct(&views, 0).unwrap().gaussians);

        let mut other_head = weights.clone();
        for (name, tensor) in others.tensors.iter().filter(|(name, _)| name.starts_with("head.")) {
            other_head.tensors.insert(name.clone(), tensor.clone());
        }
        assert_ne!(decoded(&network(&fixture.config, &other_head)).unwrap(), decoded(&first).unwrap());
        decoded(&first.with_expansion_in_first(0)).unwrap();

        let expected =
            "network: encoded scene: expected one by the encoder of this network, with its weights, found one by ";
        // Also where the hash was known before the weights changed.
        let reloaded = first.clone().with_weights(&others).unwrap();
        let moved = first.clone().with_flat(reloaded.flat());
        for other in [network(&fixture.config, &others), reloaded, moved] {
            let error = decoded(&other).unwrap_err();
            assert!(error.starts_with(&format!("{expected}other weights, sha256 ")), "{error}");
            assert_eq!(other.trace_encoded(scene.clone(), 0).unwrap_err().to_string(), error);
        }
        let mut config = fixture.config.clone();
        config.fine.upsampling = match config.fine.upsampling {
            Upsampling::Nearest => Upsampling::Bilinear,
            Upsampling::Bilinear => Upsampling::Nearest,
        };
        let error = decoded(&network(&config, &weights)).unwrap_err();
        let found = format!("{expected}{}, which encodes in another way", fixture.config.name);
        assert_eq!(error, found);
    }
}
