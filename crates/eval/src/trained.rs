//! The methods of a reproduction: ATSplat, its expansion variants with the same weights, and two baselines.

use std::collections::BTreeSet;
use std::sync::Arc;

use atsplat_model::ModelConfig;
use atsplat_model::config::Selection;
use atsplat_model::network::{Device, Network};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, StoredTensors, TensorFile};

use crate::EvalError;
use crate::method::{AtSplat, Method, NearestView, Splatting, Warp, WeightsSource};

/// A configuration with its weights.
#[derive(Debug)]
pub struct TrainedNetwork {
    /// From the weights file.
    pub config: ModelConfig,
    tensors: StoredTensors,
    weights: WeightsSource,
    /// Description of the weights' origin.
    pub description: String,
}

impl TrainedNetwork {
    /// Loads a weights file.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the file is broken.
    pub fn new(file: &TensorFile, description: String) -> Result<Self, EvalError> {
        let ModelWeights { config, tensors, .. } = ModelWeights::of_file(file)?;
        Ok(Self { config, tensors, weights: WeightsSource::File { sha256: file.sha256.clone() }, description })
    }

    /// ATSplat as trained, and the baselines.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit the configuration.
    pub fn methods(&self) -> Result<Vec<Arc<dyn Method>>, EvalError> {
        let large = self.bare(&self.config.for_high_resolution()?)?.without_resizing();
        let atsplat = self.network("atsplat", &self.config)?.with_high_resolution(large)?;
        Ok(vec![Arc::new(atsplat), Arc::new(NearestView), Arc::new(Warp)])
    }

    /// The same weights under the expansions of the paper's ablations. Anchors, K and the straight-through estimator need
    /// their own weights and are not included.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit a variant.
    pub fn variants(&self) -> Result<Vec<Arc<dyn Method>>, EvalError> {
        let mut variants = vec![
            self.variant("no expansion", &self.config.with_expansion_in_first(0))?,
            self.variant("random", &self.selecting(Selection::Random { seed: 0 }))?,
            self.variant("farthest point", &self.selecting(Selection::FarthestPoint {}))?,
        ];
        for thresholds in [[0.1, 0.1, 0.4], [0.05, 0.05, 0.2], [0.01, 0.01, 0.04]] {
            let name = thresholds.map(|threshold| threshold.to_string()).join(" ");
            // Configurations that expand in other blocks do not accept these thresholds.
            if let Ok(config) = self.config.with_thresholds(&thresholds) {
                variants.push(self.variant(&name, &config)?);
            }
        }
        Ok(variants)
    }

    fn selecting(&self, selection: Selection) -> ModelConfig {
        let mut config = self.config.clone();
        config.expansion.selection = selection;
        config
    }

    fn variant(&self, name: &str, config: &ModelConfig) -> Result<Arc<dyn Method>, EvalError> {
        Ok(Arc::new(self.network(&format!("atsplat {name}"), config)?.variant(name)))
    }

    fn network(&self, name: &str, config: &ModelConfig) -> Result<AtSplat, EvalError> {
        AtSplat::new(name, self.bare(config)?, &self.weights, 0, Splatting::default())
    }

    /// The network of a configuration with these weights.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit the configuration.
    pub fn bare(&self, config: &ModelConfig) -> Result<Network, EvalError> {
        // Selections without scores have no scorer weights.
        let expected: BTreeSet<String> = parameters(config).into_iter().map(|parameter| parameter.name).collect();
        let mut tensors = self.tensors.clone();
        tensors.tensors.retain(|name, _| expected.contains(name));
        Ok(Network::new(config, &Device::flex())?.with_weights(&tensors)?.trained_at(self.config.resolution))
    }
}
