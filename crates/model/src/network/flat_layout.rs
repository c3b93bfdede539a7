//! Between [`Network::flat`] and the parameters of weights files.

use std::collections::HashMap;
use std::ops::Range;

use burn::Tensor;
use burn::module::Param;
use burn::tensor::{Device, TensorData};
use rayon::prelude::*;

use super::Network;
use super::flat::trained;
use super::names::{ModulePath, ParameterVisitor, transpose};

/// Where each trained parameter is in [`Network::flat`], and how weights files store it.
#[derive(Clone, Debug)]
pub struct FlatLayout {
    /// In the order of [`Network::flat`].
    places: Vec<Place>,
}

#[derive(Clone, Debug)]
struct Place {
    name: String,
    /// Among the trained ones of [`parameters`](crate::parameters::parameters).
    position: usize,
    range: Range<usize>,
    /// Inputs and outputs, if weights files store it as `[outputs, inputs]`.
    transposed: Option<[usize; 2]>,
}

impl Network {
    /// Where each trained parameter is in [`Self::flat`].
    pub fn flat_layout(&self) -> FlatLayout {
        let mut visitor = Visitor { trained: trained(self), places: Vec::new() };
        self.visit_parameters(&mut visitor);
        FlatLayout { places: visitor.places }
    }
}

impl FlatLayout {
    /// Number of values.
    pub fn count(&self) -> usize {
        self.places.last().map_or(0, |place| place.range.end)
    }

    /// All trained parameters, in the order of [`parameters`](crate::parameters::parameters) and each in the layout of weights
    /// files, on a device as the values of [`Network::flat`].
    ///
    /// # Panics
    /// If they are not those of the layout's network.
    pub fn flattened(&self, parameters: &[Vec<f32>], device: &Device) -> Tensor<1> {
        let mut flat = vec![0.0; self.count()];
        let mut rest = flat.as_mut_slice();
        let mut pieces = Vec::with_capacity(self.places.len());
        for place in &self.places {
            let (piece, others) = std::mem::take(&mut rest).split_at_mut(place.range.len());
            pieces.push((place, piece));
            rest = others;
        }
        pieces.into_par_iter().for_each(|(place, piece)| {
            let values = &parameters[place.position];
            match place.transposed {
                Some([inputs, outputs]) => transpose(values, [outputs, inputs], piece),
                None => piece.copy_from_slice(values),
            }
        });
        let flat: Tensor<1> = Tensor::from_data(TensorData::new(flat, [self.count()]), device);
        flat.inner()
    }

    /// The reverse of [`Self::flattened`], of values that have been read.
    ///
    /// # Panics
    /// If the values are fewer than [`Self::count`].
    pub fn unflattened(&self, flat: &[f32]) -> Vec<Vec<f32>> {
        let parameter = |place: &Place| {
            let piece = &flat[place.range.clone()];
            let mut values = vec![0.0; piece.len()];
            match place.transposed {
                Some(shape) => transpose(piece, shape, &mut values),
                None => values.copy_from_slice(piece),
            }
            (place.position, values)
        };
        let mut parameters: Vec<(usize, Vec<f32>)> = self.places.par_iter().map(parameter).collect();
        parameters.sort_unstable_by_key(|(position, _)| *position);
        parameters.into_iter().map(|(_, values)| values).collect()
    }

    /// Names of the parameters that have NaN or infinite values among those of [`Network::flat`].
    ///
    /// # Panics
    /// If the values are fewer than [`Self::count`].
    pub fn non_finite(&self, flat: &[f32]) -> impl Iterator<Item = &str> {
        let is_finite = |values: &[f32]| {
            // The bits of magnitudes have the magnitudes' order; unlike a search, their maximum is vectorised.
            values.iter().map(|value| value.abs().to_bits()).fold(0, u32::max) < f32::INFINITY.to_bits()
        };
        let broken = self.places.iter().filter(move |place| !is_finite(&flat[place.range.clone()]));
        broken.map(|place| place.name.as_str())
    }
}

struct Visitor {
    trained: HashMap<String, usize>,
    places: Vec<Place>,
}

impl ParameterVisitor for Visitor {
    fn visit_parameter<const D: usize>(&mut self, path: &ModulePath, param: &Param<Tensor<D>>) {
        let name = path.name();
        let Some(&position) = self.trained.get(&name) else { return };
        let shape = param.lazy_shape().dims::<D>();
        let first = self.places.last().map_or(0, |place| place.range.end);
        let range = first..first + shape.iter().product::<usize>();
        let transposed = match *shape.as_slice() {
            [inputs, outputs] if path.is_transposed() => Some([inputs, outputs]),
            _ => None,
        };
        self.places.push(Place { name, position, range, transposed });
    }
}

#[cfg(test)]
mod tests {
    use super::super::f32_values;
    use super::*;
    use crate::ModelConfig;
    use crate::parameters::parameters;
    use crate::weights::generated;

    #[test]
    fn parameters_of_weights_files_are_found_in_the_flat_values() {
        let config = ModelConfig::named("nano").unwrap();
        let weights = generated(&parameters(&config), 1);
        let network = Network::new(&config, &Device::flex().autodiff()).unwrap().with_weights(&weights).unwrap();
        let (layout, flat) = (network.flat_layout(), f32_values(network.flat()));
        assert_eq!(layout.count(), flat.len());
        let trained: Vec<_> = parameters(&config).into_iter().filter(|parameter| parameter.trained).collect();
        let found = layout.unflattened(&flat);
        assert_eq!(found.len(), trained.len());
        for (parameter, found) in trained.iter().zip(&found) {
            assert_eq!(*found, weights.tensors[&parameter.name].to_f32().unwrap(), "{}", parameter.name);
        }
        assert_eq!(f32_values(layout.flattened(&found, &network.device())), flat);
    }

    #[test]
    fn parameters_that_are_not_finite_are_named() {
        let network = Network::new(&ModelConfig::named("nano").unwrap(), &Device::flex()).unwrap();
        let layout = network.flat_layout();
        let mut flat = vec![-f32::MAX; layout.count()];
        assert_eq!(layout.non_finite(&flat).next(), None);
        let names: Vec<&str> = layout.places.iter().map(|place| place.name.as_str()).collect();
        let [second, last] = [1, names.len() - 1];
        flat[layout.places[second].range.end - 1] = f32::NAN;
        flat[layout.places[last].range.start] = f32::NEG_INFINITY;
        assert!(layout.non_finite(&flat).eq([names[second], names[last]]));
    }
}
