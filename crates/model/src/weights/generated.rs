use super::{StoredTensor, StoredTensors};
use crate::hash::Stream;
use crate::parameters::Parameter;

/// Weights defined by a seed and the parameters' names, the same in every language. The fixtures of `oracle/` were made
/// with them, so that no fixture has to store weights. Not for training.
///
/// Each element is a number `u` in [−1, 1) from `SplitMix64`, keyed by seed, name and position: `u / 10` for vectors named
/// `bias`; `1 + u / 10` for other vectors, which scale; `u √(3 / inputs)`, of variance 1 / inputs, for matrices and kernels;
/// `u / 2` for embeddings of three dimensions.
#[expect(clippy::expect_used, reason = "the number of values is the product of the shape")]
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
        let tensor = StoredTensor::from_f32(parameter.shape.clone(), &values).expect("values that fill the shape");
        weights.tensors.insert(parameter.name.clone(), tensor);
    }
    weights
}
