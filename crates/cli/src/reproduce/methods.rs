//! The evaluated methods: ATSplat, its expansion variants with the same weights, and two baselines.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use anyhow::Context as _;
use atsplat_eval::method::{AtSplat, Method, NearestView, Splatting, Warp, WeightsOf};
use atsplat_model::ModelConfig;
use atsplat_model::config::Selection;
use atsplat_model::network::{Device, Network};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, StoredTensors, TensorFile};

use crate::embedded::{MICRO_ROOMS, embedded, find};

/// A configuration with its weights.
pub(super) struct Trained {
    /// From the weights file.
    pub(super) config: ModelConfig,
    tensors: StoredTensors,
    weights: WeightsOf,
    /// Description of the weights' origin.
    pub(super) description: String,
}

impl Trained {
    /// A user's weights file.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let expected = || "a weights file that `atsplat train` or `atsplat weights import` wrote".to_owned();
        Self::of(&find(path, expected)?, path.display().to_string())
    }

    fn of(file: &TensorFile, description: String) -> anyhow::Result<Self> {
        let ModelWeights { config, tensors, .. } = ModelWeights::of_file(file)?;
        Ok(Self { config, tensors, weights: WeightsOf::File { sha256: file.sha256.clone() }, description })
    }

    /// The weights embedded in the binary.
    pub(super) fn embedded() -> anyhow::Result<Self> {
        let file = embedded(MICRO_ROOMS).with_context(|| format!("no weights {MICRO_ROOMS} are embedded"))??;
        Self::of(&file, format!("{MICRO_ROOMS}, embedded in the binary"))
    }

    /// ATSplat as trained, and the baselines.
    pub(super) fn methods(&self) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        let large = self.bare(&self.config.for_high_resolution()?)?.seeing_as_given();
        let atsplat = self.network("atsplat", &self.config)?.with_high_resolution(large)?;
        Ok(vec![Arc::new(atsplat), Arc::new(NearestView), Arc::new(Warp)])
    }

    /// The same weights under the expansions of the paper's ablations. Anchors, K and the straight-through estimator need
    /// their own weights and are not included.
    pub(super) fn variants(&self) -> anyhow::Result<Vec<Arc<dyn Method>>> {
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

    fn variant(&self, name: &str, config: &ModelConfig) -> anyhow::Result<Arc<dyn Method>> {
        Ok(Arc::new(self.network(&format!("atsplat {name}"), config)?.variant(name)))
    }

    fn network(&self, name: &str, config: &ModelConfig) -> anyhow::Result<AtSplat> {
        Ok(AtSplat::new(name, self.bare(config)?, &self.weights, 0, Splatting::default())?)
    }

    /// The network of a configuration with these weights.
    pub(super) fn bare(&self, config: &ModelConfig) -> anyhow::Result<Network> {
        // Selections without scores have no scorer weights.
        let expected: BTreeSet<String> = parameters(config).into_iter().map(|parameter| parameter.name).collect();
        let mut tensors = self.tensors.clone();
        tensors.tensors.retain(|name, _| expected.contains(name));
        Ok(Network::new(config, &Device::flex())?.with_weights(&tensors)?.trained_at(self.config.resolution))
    }
}
