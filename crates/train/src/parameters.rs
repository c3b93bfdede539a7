//! A network's parameters as named arrays: their initialisation, and conversion from and to the network.

use atsplat_model::ModelConfig;
use atsplat_model::network::Network;
use atsplat_model::parameters::{Parameter, parameters};
use atsplat_model::weights::{StoredTensor, StoredTensors};
use atsplat_numeric::SplitMix64;

use crate::TrainError;
use crate::config::WHAT;

/// Standard deviation of a matrix's entries at the width for which 0.02 is published, 768 inputs (iLRM).
const DEVIATION: f64 = 0.02;
const WIDTH: f64 = 768.0;

/// Trained parameters, in the order of [`parameters`], and frozen ones.
#[derive(Clone, Debug)]
pub struct Parameters {
    list: Vec<Parameter>,
    values: Vec<Vec<f32>>,
    /// Tensors of a pretrained backbone.
    frozen: StoredTensors,
}

impl Parameters {
    /// Newly initialised parameters, a function of the seed on every machine: matrices are normal with standard deviation
    /// `0.02 √(768 / inputs)`, so that activations of a narrow network start at the scale of the papers' wide ones; learned
    /// tokens are normal with 0.02, biases 0, other vectors 1. `frozen` are the tensors of a pretrained backbone, if any.
    pub fn fresh(config: &ModelConfig, seed: u64, frozen: StoredTensors) -> Self {
        let list: Vec<Parameter> = parameters(config).into_iter().filter(|parameter| parameter.trained).collect();
        let values = list.iter().map(|parameter| initial(parameter, seed)).collect();
        Self { list, values, frozen }
    }

    /// The same parameters with other tensors of a pretrained backbone.
    pub(crate) fn with_frozen(&self, frozen: StoredTensors) -> Self {
        Self { frozen, ..self.clone() }
    }

    #[cfg(test)]
    pub(crate) fn of_values(list: Vec<Parameter>, values: Vec<Vec<f32>>) -> Self {
        Self { list, values, frozen: StoredTensors::default() }
    }

    /// The parameters in a weights file, except those that `fresh` names, alone or by the part that contains them: they are
    /// initialised as by [`Self::fresh`].
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if a tensor is absent or of another shape, or if a name in `fresh` is that of no trained parameter.
    pub fn from_weights(
        config: &ModelConfig,
        weights: &StoredTensors,
        fresh: &[String],
        seed: u64,
    ) -> Result<Self, TrainError> {
        Self::check_fresh(config, fresh)?;
        let (list, frozen): (Vec<Parameter>, Vec<Parameter>) =
            parameters(config).into_iter().partition(|parameter| parameter.trained);
        let tensor = |parameter: &Parameter| match weights.tensors.get(&parameter.name) {
            Some(tensor) if tensor.shape() == parameter.shape => Ok(tensor),
            other => {
                let expected = format!("a tensor of shape {:?}", parameter.shape);
                let found = other.map_or("none".to_owned(), ToString::to_string);
                Err(TrainError::malformed("weights", &parameter.name, expected, found))
            }
        };
        let values = list.iter().map(|parameter| {
            if fresh.iter().any(|part| is_within(&parameter.name, part)) {
                return Ok(initial(parameter, seed));
            }
            Ok(tensor(parameter)?.to_f32()?)
        });
        let values = values.collect::<Result<_, TrainError>>()?;
        let mut kept = StoredTensors::default();
        for parameter in frozen {
            kept.tensors.insert(parameter.name.clone(), tensor(&parameter)?.clone());
        }
        Ok(Self { list, values, frozen: kept })
    }

    /// An error for a name of neither a trained parameter nor a part that contains one.
    pub(crate) fn check_fresh(config: &ModelConfig, fresh: &[String]) -> Result<(), TrainError> {
        let list = parameters(config);
        let is_known = |part: &str| list.iter().any(|parameter| parameter.trained && is_within(&parameter.name, part));
        match fresh.iter().find(|part| !is_known(part.as_str())) {
            Some(unknown) => Err(TrainError::malformed(WHAT, "model.fresh", "parts with trained parameters", unknown)),
            None => Ok(()),
        }
    }

    /// Name and shape of each trained parameter, in order.
    pub fn list(&self) -> &[Parameter] {
        &self.list
    }

    /// Values of each trained parameter, in the same order.
    pub fn values(&self) -> &[Vec<f32>] {
        &self.values
    }

    /// Mutable values of each trained parameter.
    pub fn values_mut(&mut self) -> &mut [Vec<f32>] {
        &mut self.values
    }

    /// Tensors of a pretrained backbone, which training does not change.
    pub const fn frozen(&self) -> &StoredTensors {
        &self.frozen
    }

    /// Number of trained values.
    pub fn count(&self) -> usize {
        self.values.iter().map(Vec::len).sum()
    }

    /// All tensors of the network, including the frozen ones.
    ///
    /// # Errors
    /// [`TrainError::Model`] if values do not fill their shape.
    pub fn stored(&self) -> Result<StoredTensors, TrainError> {
        let mut stored = self.frozen.clone();
        for (parameter, values) in self.list.iter().zip(&self.values) {
            stored.tensors.insert(parameter.name.clone(), StoredTensor::from_f32(parameter.shape.clone(), values)?);
        }
        Ok(stored)
    }

    /// A copy of the template network with these parameters.
    ///
    /// # Errors
    /// [`TrainError::Model`] if the template has another configuration.
    pub fn network(&self, template: &Network) -> Result<Network, TrainError> {
        Ok(template.clone().with_weights(&self.stored()?)?)
    }

    /// Names of parameters with NaN or infinite values, and how many values.
    pub fn non_finite(&self) -> Vec<(String, usize)> {
        let counts = self.list.iter().zip(&self.values).map(|(parameter, values)| {
            (parameter.name.clone(), values.iter().filter(|value| !value.is_finite()).count())
        });
        counts.filter(|(_, count)| *count > 0).collect()
    }
}

/// Whether weight decay applies to a parameter: only to matrices.
pub(crate) const fn decays(parameter: &Parameter) -> bool {
    parameter.shape.len() >= 2
}

/// Whether a parameter is the part itself or belongs to it; parts of names are separated by dots.
pub(crate) fn is_within(name: &str, part: &str) -> bool {
    name.strip_prefix(part).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

fn initial(parameter: &Parameter, seed: u64) -> Vec<f32> {
    let count = parameter.elements();
    match parameter.shape.as_slice() {
        [_] if parameter.name.ends_with("bias") => vec![0.0; count],
        [_] => vec![1.0; count],
        shape => {
            let learned_tokens = parameter.name == "anchors.tokens";
            let inputs: usize = shape.iter().skip(1).product();
            let deviation = if learned_tokens { DEVIATION } else { DEVIATION * (WIDTH / inputs as f64).sqrt() };
            let mut random = SplitMix64::for_scene(seed, &parameter.name);
            (0..count).map(|_| normal(&mut random, deviation)).collect()
        }
    }
}

/// One of the two values of the Box-Muller transform.
fn normal(random: &mut SplitMix64, deviation: f64) -> f32 {
    let unit = |bits: u64| ((bits >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    let (radius, angle) = (unit(random.next_u64()), unit(random.next_u64()));
    #[expect(clippy::cast_possible_truncation, reason = "parameters are f32")]
    let value = (deviation * (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()) as f32;
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn initial_deviation_follows_the_width() {
        let config = ModelConfig::named("nano").unwrap();
        let fresh = Parameters::fresh(&config, 7, StoredTensors::default());
        assert_eq!(fresh.values, Parameters::fresh(&config, 7, StoredTensors::default()).values);
        assert_ne!(fresh.values, Parameters::fresh(&config, 8, StoredTensors::default()).values);
        for (parameter, values) in fresh.list.iter().zip(&fresh.values) {
            if values.len() < 2000 {
                continue;
            }
            let mean_square: f64 = values.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / values.len() as f64;
            let expected = DEVIATION * (WIDTH / parameter.shape[1] as f64).sqrt();
            Tolerance::relative(0.1).assert([mean_square.sqrt()], [expected], &parameter.name);
        }
    }

    #[test]
    fn weights_round_trip_through_the_network() {
        let config = ModelConfig::named("nano").unwrap();
        let fresh = Parameters::fresh(&config, 7, StoredTensors::default());
        let network = Network::new(&config, &atsplat_model::network::Device::flex()).unwrap();
        let network = fresh.network(&network).unwrap();
        let read = Parameters::from_weights(&config, &network.weights().unwrap(), &[], 0).unwrap();
        assert_eq!(read.values, fresh.values);
    }

    #[test]
    fn named_parts_are_initialised_and_all_others_read() {
        let config = ModelConfig::named("nano").unwrap();
        let [given, other] = [7, 8].map(|seed| Parameters::fresh(&config, seed, StoredTensors::default()));
        let mut weights = given.stored().unwrap();
        weights.tensors.retain(|name, _| !name.starts_with("head."));
        let parts = ["head", "decoder.blocks.1.expansion.children.weight"].map(str::to_owned);
        let read = Parameters::from_weights(&config, &weights, &parts, 8).unwrap();
        for (at, parameter) in read.list.iter().enumerate().filter(|(_, parameter)| parameter.shape.len() == 2) {
            let fresh = parameter.name.starts_with("head.") || parameter.name == parts[1];
            let expected = if fresh { &other } else { &given };
            assert_eq!(read.values[at], expected.values[at], "{}", parameter.name);
        }
        let missing = Parameters::from_weights(&config, &weights, &parts[1..], 8).unwrap_err().to_string();
        assert!(missing.contains("head.") && missing.ends_with("found none"), "{missing}");
        let mut larger = config.clone();
        larger.head.gaussians_per_token *= 2;
        let error = Parameters::from_weights(&larger, &given.stored().unwrap(), &[], 8).unwrap_err().to_string();
        let shapes = "head.mlp.fc2.weight: expected a tensor of shape [448, 96], found float32 [224, 96]";
        assert!(error.ends_with(shapes), "{error}");
        let unknown = Parameters::from_weights(&config, &weights, &["hea".to_owned()], 8).unwrap_err().to_string();
        assert!(unknown.contains("model.fresh") && unknown.contains("hea"), "{unknown}");
    }
}
