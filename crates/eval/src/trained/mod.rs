//! The methods of a reproduction: ATSplat, its expansion variants with the same weights, and two baselines.

mod listed;

use std::collections::BTreeSet;
use std::sync::Arc;

use atsplat_fit::{Budget, Strategy};
use atsplat_model::ModelConfig;
use atsplat_model::config::Selection;
use atsplat_model::network::Network;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, StoredTensors, TensorFile};
use atsplat_results::TrainingRecord;

pub use listed::{Ablations, TrainedGroup, TrainedNetworks};

use crate::expansion::thresholds;
use crate::method::{
    AtSplat, MAX_GAUSSIANS, Method, NearestView, Optimised, SharedEncoding, TrainedUnder, Warp, WeightsSource,
};
use crate::runner::Dataset;
use crate::{ComputeDevice, EvalError};

/// A configuration with its weights.
#[derive(Debug)]
pub struct TrainedNetwork {
    /// From the weights file.
    pub config: ModelConfig,
    tensors: StoredTensors,
    weights: WeightsSource,
    training: Option<TrainingRecord>,
    trained_under: TrainedUnder,
    /// Description of the weights' origin.
    pub description: String,
    device: ComputeDevice,
}

impl TrainedNetwork {
    /// Loads a weights file.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the file is broken.
    pub fn new(file: &TensorFile, description: String) -> Result<Self, EvalError> {
        let ModelWeights { config, tensors, provenance, .. } = ModelWeights::of_file(file)?;
        let (weights, training) =
            (WeightsSource::File { sha256: file.sha256.to_string() }, TrainingRecord::of(&provenance));
        let trained_under = TrainedUnder::of(&provenance);
        let device = ComputeDevice::default();
        Ok(Self { config, tensors, weights, training, trained_under, description, device })
    }

    /// The same network on another device.
    #[must_use]
    pub fn on(self, device: &ComputeDevice) -> Self {
        Self { device: device.clone(), ..self }
    }

    /// ATSplat as trained, and the baselines.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit the configuration, or its setting for large images is not valid.
    pub fn methods(&self) -> Result<Vec<Arc<dyn Method>>, EvalError> {
        let atsplat = self.method("atsplat", &self.config)?;
        Ok(vec![Arc::new(atsplat), Arc::new(NearestView), Arc::new(Warp)])
    }

    /// Optimisation of each trial within a budget: 3DGS, Mip-Splatting and MCMC from random points, and refinement of
    /// this network's Gaussians.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit the configuration, or its setting for large images is not valid.
    pub fn optimised(&self, budget: Budget) -> Result<Vec<Arc<dyn Method>>, EvalError> {
        let network = self.network_for(&self.config)?;
        let refined = Optimised::refined(None, network, &self.weights, budget, 0, self.device.splatting())?
            .with_training(self.training.clone(), self.trained_under.clone())
            .with_high_resolution(self.config.for_high_resolution()?)?;
        let mut methods: Vec<Arc<dyn Method>> = vec![Arc::new(refined)];
        for strategy in [Strategy::Gaussians3d, Strategy::MipSplatting, Strategy::Mcmc] {
            let splatting = self.device.splatting();
            methods.push(Arc::new(Optimised::from_scratch(None, strategy, budget, MAX_GAUSSIANS, 0, splatting)));
        }
        Ok(methods)
    }

    /// This network under another name in the rows, with `variant` in its title.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit the configuration, or its setting for large images is not valid.
    pub fn as_variant(&self, variant: &str) -> Result<Arc<dyn Method>, EvalError> {
        let method = self.method(&format!("atsplat {variant}"), &self.config)?.with_variant_title(variant);
        // All other variants can be read from the configuration.
        Ok(Arc::new(if variant == "unified" { method.with_recorded_variant(variant) } else { method }))
    }

    /// The same weights under the expansions of the paper's ablations. Anchors, K and the straight-through estimator need
    /// other weights and are not included. Thresholds are the paper's for the paper's configurations, and otherwise at
    /// quantiles of the network's scores in the first scenes of `dataset`. A scene is encoded once for all of them, so that their
    /// encoding is not timed.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit a variant; [`EvalError::Settings`] if `dataset` has no trial.
    pub fn variants(&self, dataset: &Dataset) -> Result<Vec<Arc<dyn Method>>, EvalError> {
        let shared = Arc::new(SharedEncoding::of(&self.config));
        let variant = |name: &str, config: &ModelConfig| -> Result<Arc<dyn Method>, EvalError> {
            Ok(Arc::new(self.variant(name, config)?.sharing(&shared)))
        };
        let mut variants = vec![
            variant("no expansion", &self.config.with_expansion_in_first(0))?,
            variant("random", &self.selecting(Selection::Random { seed: 0 }))?,
            variant("farthest point", &self.selecting(Selection::FarthestPoint {}))?,
        ];
        if self.config.name.starts_with("paper-") {
            for (thresholds, _) in thresholds::PUBLISHED {
                // Configurations that expand in other blocks do not accept these thresholds.
                if let Ok(config) = self.config.with_thresholds(&thresholds) {
                    variants.push(variant(&spaced(&thresholds), &config)?);
                }
            }
            return Ok(variants);
        }
        let scores = thresholds::scores(&self.network_for(&self.config)?, dataset)?;
        for (published, quantiles) in thresholds::PUBLISHED {
            let Some(found) = thresholds::at_quantiles(&scores, &quantiles) else { continue };
            let name = format!("quantiles {}", spaced(&quantiles));
            let method = self.variant(&name, &self.config.with_thresholds(&found)?)?.sharing(&shared);
            variants.push(Arc::new(method.with_thresholds_at(&quantiles, &published)));
        }
        Ok(variants)
    }

    /// The same weights without token expansion.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit the configuration, or its setting for large images is not valid.
    pub fn without_expansion(&self) -> Result<Arc<dyn Method>, EvalError> {
        Ok(Arc::new(self.variant("no expansion", &self.config.with_expansion_in_first(0))?))
    }

    fn selecting(&self, selection: Selection) -> ModelConfig {
        let mut config = self.config.clone();
        config.expansion.selection = selection;
        config
    }

    fn variant(&self, name: &str, config: &ModelConfig) -> Result<AtSplat, EvalError> {
        Ok(self.method(&format!("atsplat {name}"), config)?.with_variant_title(name))
    }

    /// With the configuration's own one for large images.
    fn method(&self, name: &str, config: &ModelConfig) -> Result<AtSplat, EvalError> {
        let method = AtSplat::new(name, self.network_for(config)?, &self.weights, 0, self.device.splatting())?
            .with_high_resolution(config.for_high_resolution()?)?;
        Ok(method.with_training(self.training.clone(), self.trained_under.clone()))
    }

    /// The network of a configuration with these weights.
    ///
    /// # Errors
    /// [`EvalError::Model`] if the weights do not fit the configuration.
    pub fn network_for(&self, config: &ModelConfig) -> Result<Network, EvalError> {
        // Selections without scores have no scorer weights.
        let expected: BTreeSet<String> = parameters(config).into_iter().map(|parameter| parameter.name).collect();
        let mut tensors = self.tensors.clone();
        tensors.tensors.retain(|name, _| expected.contains(name));
        Ok(Network::new(config, &self.device.network()?)?.with_weights(&tensors)?.trained_at(self.config.resolution))
    }
}

fn spaced(values: &[f64]) -> String {
    values.iter().map(f64::to_string).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use atsplat_model::weights::{Precision, generated};

    use super::*;

    #[test]
    fn a_network_runs_with_the_two_baselines() {
        let config = ModelConfig::named("nano").unwrap();
        let weights = generated(&parameters(&config), 1);
        let provenance = [("data".to_owned(), "yards".to_owned())].into();
        let weights = ModelWeights::new(config, provenance, &weights).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("w.safetensors");
        weights.write(&path, Precision::Single).unwrap();
        let trained = TrainedNetwork::new(&TensorFile::open(&path).unwrap(), "test".to_owned()).unwrap();
        let names: Vec<String> = trained.methods().unwrap().iter().map(|method| method.record().name).collect();
        assert_eq!(names, ["atsplat", "nearest-view", "warp"]);
        let optimised = trained.optimised(Budget::Steps(2)).unwrap();
        let data = |method: &Arc<dyn Method>| method.record().training.map(|training| training.data);
        let found: Vec<_> = optimised.iter().map(data).collect();
        assert_eq!(found, [Some("yards".to_owned()), None, None, None], "only the refinement has weights");
        let large = |method: &Arc<dyn Method>| method.record().parameters.get("high-resolution").cloned();
        let large_of = |config: &ModelConfig| serde_json::to_value(config.for_high_resolution().unwrap()).ok();
        let [full, none] = [3, 0].map(|blocks| large_of(&trained.config.with_expansion_in_first(blocks)));
        assert!(full.is_some() && full != none, "{full:?}");
        assert_eq!(optimised.iter().map(large).collect::<Vec<_>>(), [full.clone(), None, None, None]);
        assert_eq!(large(&trained.as_variant("unified").unwrap()), full);
        assert_eq!(large(&trained.without_expansion().unwrap()), none);
    }
}
