//! Which field of which module holds a parameter of `NAMES.md`.

use burn::Tensor;
use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Gradients, TensorData};
use indexmap::IndexMap;

use super::Network;
use crate::ModelError;
use crate::parameters::{Parameter, parameters};
use crate::weights::{StoredTensor, StoredTensors};

/// The modules that lie around a parameter: names of fields, and what holds them.
#[derive(Default)]
struct Path {
    names: Vec<String>,
    holders: Vec<String>,
}

impl Path {
    fn enter(&mut self, name: &str, holder: &str) {
        self.names.push(name.to_owned());
        self.holders.push(holder.to_owned());
    }

    fn exit(&mut self) {
        self.names.pop();
        self.holders.pop();
    }

    fn is_within(&self, module: &str) -> bool {
        self.holders.last().is_some_and(|holder| holder.ends_with(module))
    }

    /// The parameter's name: burn's fields, less what tells the two backbones apart, with PyTorch's words for norms.
    fn name(&self) -> String {
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

    /// Whether burn keeps the parameter as `[inputs, outputs]`.
    fn is_transposed(&self) -> bool {
        self.is_within("Linear") && self.names.last().is_some_and(|name| name == "weight")
    }

    /// The numbers of a tensor of the parameter's shape, laid out as in a file.
    fn values<const D: usize>(&self, tensor: Tensor<D>) -> Vec<f32> {
        let shape = tensor.dims();
        let data = tensor.into_data_as::<f32>();
        let values = data.as_slice::<f32>().unwrap_or_default();
        match *shape.as_slice() {
            [inputs, outputs] if self.is_transposed() => transposed(values, inputs, outputs),
            _ => values.to_vec(),
        }
    }
}

impl Network {
    /// Puts weights into the network.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where a parameter of the network is absent or of another size; the network that was
    /// there is gone then, so that nothing is loaded half-way.
    pub fn with_weights(self, weights: &StoredTensors) -> Result<Self, ModelError> {
        let mut load = Load { path: Path::default(), weights, fault: None };
        let loaded = self.map(&mut load);
        match load.fault {
            None => Ok(loaded),
            Some(fault) => Err(fault),
        }
    }

    /// The network's weights under the names and in the shapes of [`parameters`], as f32.
    ///
    /// # Errors
    /// [`ModelError::Malformed`] where a parameter cannot be read.
    pub fn weights(&self) -> Result<StoredTensors, ModelError> {
        let mut save = Save { path: Path::default(), found: IndexMap::new() };
        self.visit(&mut save);
        let mut stored = StoredTensors::default();
        for Parameter { name, shape, .. } in parameters(self.config()) {
            let values = save.found.get(&name);
            let values = values.ok_or_else(|| ModelError::malformed("network", &name, "a parameter", "none"))?;
            stored.tensors.insert(name, StoredTensor::from_f32(shape, values)?);
        }
        Ok(stored)
    }
}

impl Network {
    /// What a backward pass gave each parameter that it reached, under the names and in the shapes of [`parameters`].
    pub fn gradients(&self, gradients: &Gradients) -> IndexMap<String, Vec<f32>> {
        let mut find = Find { path: Path::default(), gradients, found: IndexMap::new() };
        self.visit(&mut find);
        find.found
    }
}

struct Find<'a> {
    path: Path,
    gradients: &'a Gradients,
    found: IndexMap<String, Vec<f32>>,
}

impl ModuleVisitor for Find<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        if let Some(gradient) = param.val().grad(self.gradients) {
            self.found.insert(self.path.name(), self.path.values(gradient));
        }
    }
}

/// Puts a backbone's weights into a module that stands alone.
#[cfg(test)]
pub(super) fn backbone_with_weights<M: Module>(module: M, weights: &StoredTensors) -> Result<M, ModelError> {
    let mut load = Load { path: Path::default(), weights, fault: None };
    load.path.enter("backbone", "");
    let loaded = module.map(&mut load);
    load.fault.map_or(Ok(loaded), Err)
}

struct Load<'a> {
    path: Path,
    weights: &'a StoredTensors,
    fault: Option<ModelError>,
}

impl Load<'_> {
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

impl ModuleMapper for Load<'_> {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.exit();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        // Neither shape nor device asks for a value: that would draw one at random first.
        let shape = param.lazy_shape().dims::<D>();
        match self.values(&shape) {
            Ok(values) => {
                let tensor = Tensor::from_data(TensorData::new(values, shape), &param.lazy_device());
                let id = param.id;
                param.transform_for_load(tensor, id)
            }
            Err(fault) => {
                self.fault.get_or_insert(fault);
                param
            }
        }
    }
}

struct Save {
    path: Path,
    found: IndexMap<String, Vec<f32>>,
}

impl ModuleVisitor for Save {
    fn enter_module(&mut self, name: &str, container_type: &str) {
        self.path.enter(name, container_type);
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.exit();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.found.insert(self.path.name(), self.path.values(param.val()));
    }
}

/// `[rows, columns]` to `[columns, rows]`.
fn transposed(values: &[f32], rows: usize, columns: usize) -> Vec<f32> {
    // So many rows are read side by side: their parts stay in the cache until the next column needs them.
    const ROWS: usize = 16;
    let mut out = vec![0.0; values.len()];
    for (at, some) in values.chunks((ROWS * columns).max(1)).enumerate() {
        for (column, out) in out.chunks_exact_mut(rows.max(1)).enumerate() {
            for (out, row) in out.iter_mut().skip(at * ROWS).zip(some.chunks_exact(columns)) {
                *out = row.get(column).copied().unwrap_or_default();
            }
        }
    }
    out
}
