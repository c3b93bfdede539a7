//! Maps the fields of burn's modules to the parameter names of `NAMES.md`; loads and stores weights and gradients by name.

use atsplat_nn::f32_values;
use burn::Tensor;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, TensorData};
use indexmap::IndexMap;

use super::Network;
use crate::ModelError;
use crate::parameters::{Parameter, parameters};
use crate::weights::{StoredTensor, StoredTensors};

/// The path of a parameter through the modules: names of fields, and the types that contain them.
#[derive(Default)]
pub(super) struct ModulePath {
    names: Vec<String>,
    containers: Vec<String>,
}

impl ModulePath {
    pub(super) fn enter(&mut self, name: &str, container: &str) {
        self.names.push(name.to_owned());
        self.containers.push(container.to_owned());
    }

    pub(super) fn exit(&mut self) {
        self.names.pop();
        self.containers.pop();
    }

    fn is_within(&self, module: &str) -> bool {
        self.containers.last().is_some_and(|container| container.ends_with(module))
    }

    /// The parameter's name: burn's fields, without the one that distinguishes the two backbones, with PyTorch's names for
    /// the parameters of norms.
    pub(super) fn name(&self) -> String {
        let mut names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        if let ["backbone", "dino" | "patch", ..] = names.as_slice() {
            names.remove(1);
        }
        if let Some(last) = names.last_mut().filter(|_| self.is_within("Norm")) {
            *last = match *last {
                "gamma" => "weight",
                "beta" => "bias",
                other => other,
            };
        }
        names.join(".")
    }

    /// Whether burn stores the parameter as `[inputs, outputs]`.
    pub(super) fn is_transposed(&self) -> bool {
        self.is_within("Linear") && self.names.last().is_some_and(|name| name == "weight")
    }

    /// The values of a tensor of the parameter's shape, in the layout of weights files.
    fn values<const D: usize>(&self, tensor: Tensor<D>) -> Vec<f32> {
        let shape = tensor.dims();
        let values = f32_values(tensor);
        match *shape.as_slice() {
            [inputs, outputs] if self.is_transposed() => transposed(&values, inputs, outputs),
            _ => values,
        }
    }
}

/// Visits the parameters of a network.
pub(super) trait ParameterVisitor {
    /// Visits one, which is at this path.
    fn visit_parameter<const D: usize>(&mut self, path: &ModulePath, param: &Param<Tensor<D>>);
}

/// A visitor on its way through the modules.
struct Walk<'a, V> {
    path: ModulePath,
    visitor: &'a mut V,
}

impl<V: ParameterVisitor> ModuleVisitor for Walk<'_, V> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.visitor.visit_parameter(&self.path, param);
    }
}

impl Network {
    /// Shows all parameters to a visitor.
    pub(super) fn visit_parameters(&self, visitor: &mut impl ParameterVisitor) {
        self.visit(&mut Walk { path: ModulePath::default(), visitor });
    }

    /// The network with the given weights.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if a parameter of the network is absent or of another size; no partially loaded network is
    /// returned.
    pub fn with_weights(self, weights: &StoredTensors) -> Result<Self, ModelError> {
        let mut load = WeightLoader { path: ModulePath::default(), weights, error: None };
        let loaded = self.map(&mut load).with_other_weights();
        load.error.map_or(Ok(loaded), Err)
    }

    /// The network's weights with the names and shapes of [`parameters`], in f32.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] if a parameter cannot be read.
    pub fn weights(&self) -> Result<StoredTensors, ModelError> {
        let found = Collector::of(self, None);
        let mut stored = StoredTensors::default();
        for Parameter { name, shape, .. } in parameters(self.config()) {
            let values = found.get(&name);
            let values = values.ok_or_else(|| ModelError::malformed("network", &name, "a parameter", "none"))?;
            stored.tensors.insert(name, StoredTensor::from_f32(shape, values)?);
        }
        Ok(stored)
    }

    /// The gradients of each parameter that a backward pass reached, with the names and shapes of [`parameters`].
    pub fn gradients(&self, gradients: &Gradients) -> IndexMap<String, Vec<f32>> {
        Collector::of(self, Some(gradients))
    }
}

/// Collects the values of parameters, or their gradients if those are given.
struct Collector<'a> {
    gradients: Option<&'a Gradients>,
    found: IndexMap<String, Vec<f32>>,
}

impl<'a> Collector<'a> {
    fn of(network: &Network, gradients: Option<&'a Gradients>) -> IndexMap<String, Vec<f32>> {
        let mut collector = Self { gradients, found: IndexMap::new() };
        network.visit_parameters(&mut collector);
        collector.found
    }
}

impl ParameterVisitor for Collector<'_> {
    fn visit_parameter<const D: usize>(&mut self, path: &ModulePath, param: &Param<Tensor<D>>) {
        let tensor = match self.gradients {
            Some(gradients) => param.val().grad(gradients),
            None => Some(param.val()),
        };
        if let Some(tensor) = tensor {
            self.found.insert(path.name(), path.values(tensor));
        }
    }
}

/// Loads a backbone's weights into a stand-alone module.
#[cfg(test)]
pub(super) fn backbone_with_weights<M: Module>(module: M, weights: &StoredTensors) -> Result<M, ModelError> {
    let mut load = WeightLoader { path: ModulePath::default(), weights, error: None };
    load.path.enter("backbone", "");
    let loaded = module.map(&mut load);
    load.error.map_or(Ok(loaded), Err)
}

struct WeightLoader<'a> {
    path: ModulePath,
    weights: &'a StoredTensors,
    /// The first error.
    error: Option<ModelError>,
}

impl WeightLoader<'_> {
    fn values(&self, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let name = self.path.name();
        let tensor = self.weights.tensors.get(&name);
        let tensor = tensor.ok_or_else(|| ModelError::malformed("weights", &name, "a tensor", "none"))?;
        let values = tensor.to_f32()?;
        if values.len() != shape.iter().product::<usize>() {
            return Err(ModelError::malformed("weights", &name, format!("elements of {shape:?}"), tensor));
        }
        Ok(match *shape {
            [inputs, outputs] if self.path.is_transposed() => transposed(&values, outputs, inputs),
            _ => values,
        })
    }
}

impl ModuleMapper for WeightLoader<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.exit();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        // Lazy access to shape and device does not initialise the parameter with random values first.
        let shape = param.lazy_shape().dims::<D>();
        match self.values(&shape) {
            Ok(values) => {
                let tensor = Tensor::from_data(TensorData::new(values, shape), &param.lazy_device());
                let id = param.id;
                param.transform_for_load(tensor, id)
            }
            Err(error) => {
                self.error.get_or_insert(error);
                param
            }
        }
    }
}

/// `[rows, columns]` to `[columns, rows]`.
fn transposed(values: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    let mut out = vec![0.0; values.len()];
    transpose(values, [rows, columns], &mut out);
    out
}

/// Writes `[rows, columns]` as `[columns, rows]`.
pub(super) fn transpose(values: &[f32], [rows, columns]: [usize; 2], out: &mut [f32]) {
    // This many rows are read together: their cache lines stay cached until the next column needs them.
    const ROWS: usize = 16;
    for (block, values) in values.chunks((ROWS * columns).max(1)).enumerate() {
        for (column, out) in out.chunks_exact_mut(rows.max(1)).enumerate() {
            for (out, row) in out.iter_mut().skip(block * ROWS).zip(values.chunks_exact(columns)) {
                *out = row[column];
            }
        }
    }
}
