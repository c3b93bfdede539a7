//! A network's parameters as named arrays: how they begin, and how they come in and out of the network.

use atsplat_model::ModelConfig;
use atsplat_model::network::Network;
use atsplat_model::parameters::{Parameter, parameters};
use atsplat_model::weights::{StoredTensor, StoredTensors};
use atsplat_numeric::SplitMix64;

use crate::TrainError;

/// Standard deviation of a matrix's numbers at the width that 0.02 is published for, 768 inputs (iLRM).
const DEVIATION: f64 = 0.02;
const WIDTH: f64 = 768.0;

/// Parameters that training moves, in the order of [`parameters`], and those that it does not.
#[derive(Clone, Debug)]
pub struct Parameters {
    list: Vec<Parameter>,
    values: Vec<Vec<f32>>,
    /// A pretrained backbone's.
    frozen: StoredTensors,
}

impl Parameters {
    /// Fresh ones of a seed, the same on every machine: matrices are normal with a deviation of `0.02 √(768 / inputs)`,
    /// so that a narrow network starts as loud as the papers' wide ones; learnt tokens are normal with 0.02, biases 0,
    /// other vectors 1. `frozen` holds a pretrained backbone's tensors, where there is one.
    pub fn fresh(config: &ModelConfig, seed: u64, frozen: StoredTensors) -> Self {
        let list: Vec<Parameter> = parameters(config).into_iter().filter(|parameter| parameter.trained).collect();
        let values = list.iter().map(|parameter| initial(parameter, seed)).collect();
        Self { list, values, frozen }
    }

    /// Any, for tests.
    #[cfg(test)]
    pub(crate) fn of_values(list: Vec<Parameter>, values: Vec<Vec<f32>>) -> Self {
        Self { list, values, frozen: StoredTensors::default() }
    }

    /// Those of a weights file.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] for one that is absent or of another shape.
    pub fn of_weights(config: &ModelConfig, weights: &StoredTensors) -> Result<Self, TrainError> {
        let (list, frozen): (Vec<Parameter>, Vec<Parameter>) =
            parameters(config).into_iter().partition(|parameter| parameter.trained);
        let tensor = |parameter: &Parameter| {
            let tensor = weights.tensors.get(&parameter.name).filter(|tensor| tensor.shape() == parameter.shape);
            tensor.ok_or_else(|| {
                let expected = format!("a tensor of shape {:?}", parameter.shape);
                TrainError::malformed("weights", &parameter.name, expected, "none")
            })
        };
        let values = list.iter().map(|parameter| Ok(tensor(parameter)?.to_f32()?));
        let values = values.collect::<Result<_, TrainError>>()?;
        let mut kept = StoredTensors::default();
        for parameter in frozen {
            kept.tensors.insert(parameter.name.clone(), tensor(&parameter)?.clone());
        }
        Ok(Self { list, values, frozen: kept })
    }

    /// Name and shape of each, in order.
    pub fn list(&self) -> &[Parameter] {
        &self.list
    }

    /// Numbers of each, in the same order.
    pub fn values(&self) -> &[Vec<f32>] {
        &self.values
    }

    /// Numbers of each, to be changed.
    pub fn values_mut(&mut self) -> &mut [Vec<f32>] {
        &mut self.values
    }

    /// A pretrained backbone's, which training does not move.
    pub const fn frozen(&self) -> &StoredTensors {
        &self.frozen
    }

    /// How many numbers.
    pub fn count(&self) -> usize {
        self.values.iter().map(Vec::len).sum()
    }

    /// All of the network's tensors, the frozen ones too.
    ///
    /// # Errors
    /// [`TrainError::Model`] where numbers do not fill their shape.
    pub fn stored(&self) -> Result<StoredTensors, TrainError> {
        let mut stored = self.frozen.clone();
        for (parameter, values) in self.list.iter().zip(&self.values) {
            stored.tensors.insert(parameter.name.clone(), StoredTensor::from_f32(parameter.shape.clone(), values)?);
        }
        Ok(stored)
    }

    /// A network with these parameters.
    ///
    /// # Errors
    /// [`TrainError::Model`] where the network is of another configuration.
    pub fn network(&self, like: &Network) -> Result<Network, TrainError> {
        Ok(like.clone().with_weights(&self.stored()?)?)
    }

    /// Names of those that hold NaN or an infinity, and how many.
    pub fn non_finite(&self) -> Vec<(String, usize)> {
        let counts = self.list.iter().zip(&self.values).map(|(parameter, values)| {
            (parameter.name.clone(), values.iter().filter(|value| !value.is_finite()).count())
        });
        counts.filter(|(_, count)| *count > 0).collect()
    }
}

/// Whether weight decay acts on a parameter: on matrices alone.
pub(crate) const fn decays(parameter: &Parameter) -> bool {
    parameter.shape.len() >= 2
}

fn initial(parameter: &Parameter, seed: u64) -> Vec<f32> {
    let count = parameter.elements();
    match parameter.shape.as_slice() {
        [_] if parameter.name.ends_with("bias") => vec![0.0; count],
        [_] => vec![1.0; count],
        shape => {
            let learnt_tokens = parameter.name == "anchors.tokens";
            let inputs: usize = shape.iter().skip(1).product();
            let deviation = if learnt_tokens { DEVIATION } else { DEVIATION * (WIDTH / inputs as f64).sqrt() };
            let mut random = SplitMix64::for_scene(seed, &parameter.name);
            (0..count).map(|_| normal(&mut random, deviation)).collect()
        }
    }
}

/// Box and Muller's, one of the two.
fn normal(random: &mut SplitMix64, deviation: f64) -> f32 {
    let unit = |bits: u64| ((bits >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    let (radius, turn) = (unit(random.next_u64()), unit(random.next_u64()));
    #[expect(clippy::cast_possible_truncation, reason = "parameters are f32")]
    let value = (deviation * (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * turn).cos()) as f32;
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn a_fresh_network_is_as_loud_as_its_width_asks() {
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
    fn weights_come_back_from_the_network() {
        let config = ModelConfig::named("nano").unwrap();
        let fresh = Parameters::fresh(&config, 7, StoredTensors::default());
        let network = Network::new(&config, &atsplat_model::network::Device::flex()).unwrap();
        let network = fresh.network(&network).unwrap();
        let again = Parameters::of_weights(&config, &network.weights().unwrap()).unwrap();
        assert_eq!(again.values, fresh.values);
    }
}
