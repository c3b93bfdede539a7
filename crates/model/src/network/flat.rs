//! All trained parameters as one tensor on the network's device, for optimisers that run there.

use std::collections::HashMap;

use burn::Tensor;
use burn::module::{Module as _, ModuleMapper, Param};
use burn::tensor::Gradients;

use super::Network;
use super::names::{ModulePath, ParameterVisitor};
use crate::parameters::parameters;

impl Network {
    /// The values of all trained parameters after each other, without gradients. Their order, and the layout of each, are the same in
    /// all networks of one configuration; they are not those of weights files.
    pub fn flat(&self) -> Tensor<1> {
        Flatten::of(self, Part::Values)
    }

    /// The gradients that a backward pass left, in the order of [`Self::flat`]: 0 where it reached nothing.
    pub fn flat_gradient(&self, gradients: &Gradients) -> Tensor<1> {
        Flatten::of(self, Part::Gradients(gradients))
    }

    /// 1 for each value of a matrix, 0 for each of a vector, in the order of [`Self::flat`].
    pub fn flat_matrices(&self) -> Tensor<1> {
        Flatten::of(self, Part::IsMatrix)
    }

    /// The same network on the same device with these values, in the order of [`Self::flat`].
    ///
    /// # Panics
    /// If their number is not that of the trained values.
    #[must_use]
    pub fn with_flat(self, values: Tensor<1>) -> Self {
        let trained = trained(&self);
        let mut fill = Fill { path: ModulePath::default(), trained, values: values.inner(), next: 0 };
        let filled = self.map(&mut fill).with_other_weights();
        assert_eq!([fill.next], fill.values.dims(), "trained values");
        filled
    }
}

/// Names of trained parameters, with their positions among them in [`parameters`].
pub(super) fn trained(network: &Network) -> HashMap<String, usize> {
    let trained = parameters(network.config()).into_iter().filter(|parameter| parameter.trained);
    trained.enumerate().map(|(position, parameter)| (parameter.name, position)).collect()
}

#[derive(Clone, Copy)]
enum Part<'a> {
    Values,
    Gradients(&'a Gradients),
    IsMatrix,
}

struct Flatten<'a> {
    trained: HashMap<String, usize>,
    part: Part<'a>,
    pieces: Vec<Tensor<1>>,
}

impl<'a> Flatten<'a> {
    fn of(network: &Network, part: Part<'a>) -> Tensor<1> {
        let mut flatten = Self { trained: trained(network), part, pieces: Vec::new() };
        network.visit_parameters(&mut flatten);
        Tensor::cat(flatten.pieces, 0)
    }
}

impl ParameterVisitor for Flatten<'_> {
    fn visit_parameter<const D: usize>(&mut self, path: &ModulePath, param: &Param<Tensor<D>>) {
        if !self.trained.contains_key(&path.name()) {
            return;
        }
        let value = param.val();
        let piece = match self.part {
            Part::Values => value.inner(),
            Part::Gradients(gradients) => value.grad(gradients).unwrap_or_else(|| value.inner().zeros_like()),
            Part::IsMatrix if D >= 2 => value.inner().ones_like(),
            Part::IsMatrix => value.inner().zeros_like(),
        };
        let count: usize = piece.dims().iter().product();
        self.pieces.push(piece.reshape([count]));
    }
}

struct Fill {
    path: ModulePath,
    trained: HashMap<String, usize>,
    values: Tensor<1>,
    next: usize,
}

impl ModuleMapper for Fill {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.exit();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        if !self.trained.contains_key(&self.path.name()) {
            return param;
        }
        let shape = param.lazy_shape().dims::<D>();
        let end = self.next + shape.iter().product::<usize>();
        let values = self.values.clone().slice_dim(0, self.next..end).reshape(shape);
        self.next = end;
        let tracked = param.lazy_device().is_autodiff();
        let (id, _, mapper) = param.consume();
        let values = if tracked { values.autodiff().require_grad() } else { values };
        Param::from_mapped_value(id, values, mapper)
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::super::f32_values;
    use super::*;
    use crate::ModelConfig;
    use crate::weights::generated;

    fn network(seed: u64) -> Network {
        let config = ModelConfig::named("nano").unwrap();
        let network = Network::new(&config, &Device::flex().autodiff()).unwrap();
        network.with_weights(&generated(&parameters(&config), seed)).unwrap()
    }

    #[test]
    fn values_return_to_their_parameters() {
        let [first, second] = [1, 2].map(network);
        let weights = |network: &Network| network.weights().unwrap().digest();
        assert_ne!(weights(&first), weights(&second));
        let copied = first.with_flat(second.flat());
        assert_eq!(weights(&copied), weights(&second));
    }

    /// `Σ gamma² / 2` of the head's norm has the gradient `gamma`, and no other parameter has one.
    #[test]
    fn gradients_have_the_order_of_values_and_are_0_where_nothing_was_reached() {
        let network = network(1);
        let gamma = network.head.norm.gamma.val();
        let gradients = ((gamma.clone() * gamma).sum() * 0.5).backward();
        let [found, values] = [network.flat_gradient(&gradients), network.flat()].map(f32_values);
        let named = network.gradients(&gradients);
        assert_eq!(named.keys().collect::<Vec<_>>(), ["head.norm.weight"]);
        let reached = || found.iter().zip(&values).filter(|(found, _)| **found != 0.0);
        assert!(reached().all(|(found, value)| found.to_bits() == value.to_bits()));
        assert_eq!(reached().count(), named["head.norm.weight"].len());
        let matrices = f32_values(network.flat_matrices());
        assert!(found.iter().zip(&matrices).all(|(found, matrix)| *found == 0.0 || *matrix == 0.0));
        let list = parameters(network.config());
        let elements: usize = list
            .iter()
            .filter(|parameter| parameter.shape.len() >= 2)
            .map(crate::parameters::Parameter::elements)
            .sum();
        assert_eq!(matrices.iter().filter(|matrix| **matrix > 0.5).count(), elements);
        assert!(elements < values.len());
    }
}
