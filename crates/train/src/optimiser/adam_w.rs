use burn::Tensor;
use serde::{Deserialize, Serialize};

/// Adam with decoupled weight decay (Loshchilov and Hutter 2017), in PyTorch's order of operations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
pub struct AdamW {
    /// Decay of the first and the second moment; by default iLRM's.
    pub betas: [f64; 2],
    /// Added to the root of the second moment.
    pub epsilon: f64,
    /// Weight decay of matrices, multiplied by the learning rate at every step; vectors do not decay.
    pub weight_decay: f64,
}

impl Default for AdamW {
    fn default() -> Self {
        Self { betas: [0.9, 0.95], epsilon: 1e-8, weight_decay: 0.05 }
    }
}

/// Settings of one step, shared by all parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Update {
    /// Index of the update, counted from 1.
    pub number: u64,
    /// Learning rate of this step.
    pub learning_rate: f64,
    /// Factor of the gradients: the mean over samples, and clipping.
    pub scale: f64,
}

/// Running means of one parameter's gradient and of its square.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Moments {
    /// Mean of the gradient.
    pub first: Vec<f32>,
    /// Mean of its square.
    pub second: Vec<f32>,
}

impl Moments {
    /// Moments before the first step.
    pub fn zeros(count: usize) -> Self {
        Self { first: vec![0.0; count], second: vec![0.0; count] }
    }
}

/// [`Moments`] of all parameters on a device.
#[derive(Clone, Debug)]
pub struct FlatMoments {
    /// Mean of the gradient.
    pub first: Tensor<1>,
    /// Mean of its square.
    pub second: Tensor<1>,
}

/// What a step's rate and number make of the configuration.
struct Factors {
    /// Of a parameter that decays.
    kept: f64,
    /// Step size with the first moment's correction.
    size: f64,
    /// Root of the second moment's correction.
    root: f64,
}

impl AdamW {
    /// The parameters after an update on their device, in f32; those decay where `decays` is 1, and not where it is 0.
    #[must_use]
    pub fn step_flat(
        &self,
        update: Update,
        parameters: Tensor<1>,
        gradient: Tensor<1>,
        moments: &mut FlatMoments,
        decays: Tensor<1>,
    ) -> Tensor<1> {
        let Factors { kept, size, root } = self.factors(update);
        let [beta1, beta2] = self.betas;
        let gradient = gradient * update.scale;
        moments.first = moments.first.clone() * beta1 + gradient.clone() * (1.0 - beta1);
        moments.second = moments.second.clone() * beta2 + gradient.square() * (1.0 - beta2);
        let moved = moments.first.clone() * size / (moments.second.clone().sqrt() / root + self.epsilon);
        parameters * (decays * (kept - 1.0) + 1.0) - moved
    }

    fn factors(&self, update: Update) -> Factors {
        let corrections = self.betas.map(|beta| 1.0 - beta.powf(update.number as f64));
        let kept = 1.0 - update.learning_rate * self.weight_decay;
        Factors { kept, size: update.learning_rate / corrections[0], root: corrections[1].sqrt() }
    }

    /// Updates one parameter.
    pub fn step(&self, update: Update, parameter: &mut [f32], gradient: &[f32], moments: &mut Moments, decays: bool) {
        let Factors { kept, size, root } = self.factors(update);
        let kept = if decays { kept } else { 1.0 };
        let [beta1, beta2] = self.betas;
        let state = moments.first.iter_mut().zip(&mut moments.second);
        for ((parameter, gradient), (first, second)) in parameter.iter_mut().zip(gradient).zip(state) {
            let gradient = f64::from(*gradient) * update.scale;
            let mean = beta1 * f64::from(*first) + (1.0 - beta1) * gradient;
            let square = beta2 * f64::from(*second) + (1.0 - beta2) * gradient * gradient;
            let moved = f64::from(*parameter) * kept - size * mean / (square.sqrt() / root + self.epsilon);
            #[expect(clippy::cast_possible_truncation, reason = "the state is f32")]
            {
                (*parameter, *first, *second) = (moved as f32, mean as f32, square as f32);
            }
        }
    }
}
