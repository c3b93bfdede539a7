//! Weights, moments and averages that stay on a graphics adapter between steps.

use atsplat_model::network::{Network, f32_values};
use burn::Tensor;

use crate::checkpoint::State;
use crate::optimiser::{FlatMoments, Moments, Update, clip, warmed_up};
use crate::skipped_step::FailureReason;
use crate::{TrainConfig, TrainError};

/// The part of a [`State`] that steps change, in the order of [`Network::flat`].
#[derive(Clone, Debug)]
pub(crate) struct DeviceState {
    /// With the current weights.
    network: Network,
    moments: FlatMoments,
    average: Option<Tensor<1>>,
    /// 1 where weight decay applies.
    decays: Tensor<1>,
}

impl DeviceState {
    /// Copies a state to the device of a network, whose weights are replaced.
    pub(crate) fn new(state: &State, template: &Network) -> Result<Self, TrainError> {
        let network = state.parameters.network(template)?;
        let (layout, device) = (network.flat_layout(), network.device());
        let flat = |values: &Vec<Vec<f32>>| layout.flattened(values, &device);
        let flat_moments = |part: fn(&Moments) -> &Vec<f32>| {
            let values: Vec<Vec<f32>> = state.moments.iter().map(|moments| part(moments).clone()).collect();
            flat(&values)
        };
        let moments = FlatMoments {
            first: flat_moments(|moments| &moments.first),
            second: flat_moments(|moments| &moments.second),
        };
        let average = state.average.as_ref().map(flat);
        Ok(Self { decays: network.flat_matrices(), network, moments, average })
    }

    /// The network with the current weights.
    pub(crate) const fn network(&self) -> &Network {
        &self.network
    }

    /// [`crate::update::update`] on the device, from which only the norm is read; `gradient` is the sum over this many samples.
    ///
    /// # Errors
    /// [`FailureReason::NonFiniteGradients`] if the norm is not finite; nothing is changed.
    pub(crate) fn update(
        &mut self,
        updates: u64,
        gradient: Tensor<1>,
        samples: usize,
        rate: f64,
        config: &TrainConfig,
    ) -> Result<f64, FailureReason> {
        let share = 1.0 / samples.max(1) as f64;
        let squares = f64::from(gradient.clone().square().sum().into_scalar::<f32>());
        let norm = share * squares.sqrt();
        if !norm.is_finite() {
            return Err(FailureReason::NonFiniteGradients(vec!["their norm".to_owned()]));
        }
        let update = Update { number: updates + 1, learning_rate: rate, scale: share * clip(norm, config.clip) };
        let values =
            config.optimiser.step_flat(update, self.network.flat(), gradient, &mut self.moments, self.decays.clone());
        if let (Some(average), Some(decay)) = (&mut self.average, config.average) {
            let moved = (values.clone() - average.clone()) * (1.0 - warmed_up(decay, updates));
            *average = average.clone() + moved;
        }
        self.network = self.network.clone().with_flat(values);
        Ok(norm)
    }

    /// Copies weights, moments and averages into a state.
    pub(crate) fn copy_to(&self, state: &mut State) {
        let layout = self.network.flat_layout();
        let read = |values: &Tensor<1>| layout.unflattened(&f32_values(values.clone()));
        let [first, second] = [&self.moments.first, &self.moments.second].map(read);
        state.moments = first.into_iter().zip(second).map(|(first, second)| Moments { first, second }).collect();
        state.average = self.average.as_ref().map(read);
        state.parameters.values_mut().clone_from_slice(&read(&self.network.flat()));
    }
}

#[cfg(test)]
mod tests {
    use atsplat_model::ModelConfig;
    use atsplat_model::network::Device;
    use atsplat_model::weights::StoredTensors;
    use atsplat_numeric::Tolerance;

    use super::*;
    use crate::parameters::Parameters;
    use crate::update::update;

    /// Some steps of both, with clipping in one of them, weight decay and an average; gradients that a function of the weights' names
    /// and places makes, the sum of three samples.
    #[test]
    fn updates_are_those_of_the_cpu() {
        let model = ModelConfig::named("nano").unwrap();
        let template = Network::new(&model, &Device::flex().autodiff()).unwrap();
        let parameters = Parameters::fresh(&model, 3, StoredTensors::default());
        let config = TrainConfig { average: Some(0.9), ..TrainConfig::shortest() };
        let mut on_cpu = State::new(parameters).with_average();
        let mut device_state = DeviceState::new(&on_cpu, &template).unwrap();
        for step in 0..4u64 {
            let size = if step == 2 { 1.0f32 } else { 1e-4 };
            let wave = |place: usize, phase: f32| size * (place as f32 * 0.37 + phase).sin();
            let of_parameter = |parameter: &atsplat_model::parameters::Parameter| {
                let phase = step as f32 + parameter.name.len() as f32;
                (0..parameter.elements()).map(|place| wave(place, phase)).collect::<Vec<f32>>()
            };
            let gradients: Vec<Vec<f32>> = on_cpu.parameters.list().iter().map(of_parameter).collect();
            let as_parameters = Parameters::of_values(on_cpu.parameters.list().to_vec(), gradients.clone());
            let flat = as_parameters.network(&template).unwrap().flat();
            let rate = 1e-3 * (step + 1) as f64;
            let updates = on_cpu.updates;
            let expected = update(&mut on_cpu, &gradients, 3, rate, &config).unwrap();
            let found = device_state.update(updates, flat, 3, rate, &config).unwrap();
            assert_eq!(found > config.clip, step == 2, "one step is clipped");
            Tolerance::relative(1e-5).assert([found], [expected], "norm");
        }
        let mut copied = on_cpu.clone();
        copied.parameters.values_mut().iter_mut().flatten().for_each(|value| *value = 0.0);
        device_state.copy_to(&mut copied);
        let numbers = |values: &[Vec<f32>]| values.concat().into_iter().map(f64::from).collect::<Vec<f64>>();
        let close = Tolerance::absolute(1e-6);
        close.assert(numbers(copied.parameters.values()), numbers(on_cpu.parameters.values()), "weights");
        close.assert(numbers(&copied.average.unwrap()), numbers(on_cpu.average.as_ref().unwrap()), "averages");
        for (found, expected) in copied.moments.iter().zip(&on_cpu.moments) {
            let [found, expected] =
                [found, expected].map(|moments| numbers(&[moments.first.clone(), moments.second.clone()]));
            close.assert(found, expected, "moments");
        }
    }

    #[test]
    fn a_norm_that_is_not_finite_changes_nothing() {
        let model = ModelConfig::named("nano").unwrap();
        let template = Network::new(&model, &Device::flex().autodiff()).unwrap();
        let state = State::new(Parameters::fresh(&model, 3, StoredTensors::default()));
        let mut device_state = DeviceState::new(&state, &template).unwrap();
        let gradient = device_state.network().flat() * f32::NAN;
        let outcome = device_state.update(0, gradient, 1, 1e-2, &TrainConfig::shortest());
        assert!(matches!(outcome, Err(FailureReason::NonFiniteGradients(_))));
        let mut after = state.clone();
        device_state.copy_to(&mut after);
        assert_eq!(after.parameters.values(), state.parameters.values());
    }
}
