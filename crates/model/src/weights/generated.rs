use super::{StoredTensor, StoredTensors};
use crate::hash::Stream;
use crate::parameters::Parameter;

/// Weights that a seed and the parameters' names define, the same in every language: what the fixtures of
/// `oracle/` were made with, so that no fixture has to store a weight. Not for training.
///
/// A number in −1…1 for every element comes from `SplitMix64` at a place that seed, name and position decide.
/// Vectors named `bias` are a tenth of it; other vectors, which scale, are that plus one; matrices and kernels
/// are it times √(3 / inputs), of variance 1 / inputs; embeddings of three dimensions are half of it.
pub fn generated(parameters: &[Parameter], seed: u64) -> StoredTensors {
    let mut weights = StoredTensors::default();
    for parameter in parameters {
        let stream = Stream::named(seed, &parameter.name);
        let inputs: usize = parameter.shape.iter().skip(1).product();
        let (offset, scale) = match parameter.shape.len() {
            1 if parameter.name.ends_with("bias") => (0.0, 0.1),
            1 => (1.0, 0.1),
            3 => (0.0, 0.5),
            _ => (0.0, (3.0 / inputs as f64).sqrt()),
        };
        #[expect(clippy::cast_possible_truncation, reason = "weights are f32")]
        let values: Vec<f32> =
            (0..parameter.elements() as u64).map(|at| (offset + scale * stream.signed_unit(at)) as f32).collect();
        if let Ok(tensor) = StoredTensor::from_f32(parameter.shape.clone(), &values) {
            weights.tensors.insert(parameter.name.clone(), tensor);
        }
    }
    weights
}
