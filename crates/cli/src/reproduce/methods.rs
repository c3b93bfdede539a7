//! What answers: ATSplat, what the same weights give under other expansions, and two floors.

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

use crate::carried::{MICRO_ROOMS, carried, find};

/// A configuration with weights that fit it.
pub(super) struct Trained {
    /// As the weights file has it.
    pub(super) config: ModelConfig,
    tensors: StoredTensors,
    weights: WeightsOf,
    /// Where the weights came from, for people.
    pub(super) told: String,
}

impl Trained {
    /// A user's weights file.
    pub(super) fn read(path: &Path) -> anyhow::Result<Self> {
        let wanted = || "a weights file that `atsplat train` or `atsplat weights import` wrote".to_owned();
        Self::of(&find(path, wanted)?, path.display().to_string())
    }

    fn of(file: &TensorFile, told: String) -> anyhow::Result<Self> {
        let ModelWeights { config, tensors, .. } = ModelWeights::of_file(file)?;
        Ok(Self { config, tensors, weights: WeightsOf::File { sha256: file.sha256.clone() }, told })
    }

    /// The weights that travel in the binary.
    pub(super) fn carried() -> anyhow::Result<Self> {
        let file = carried(MICRO_ROOMS).with_context(|| format!("this build carries no weights {MICRO_ROOMS}"))??;
        Self::of(&file, format!("{MICRO_ROOMS}, which the binary carries"))
    }

    /// ATSplat as it was trained, and the floors.
    pub(super) fn methods(&self) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        let large = self.bare(&self.config.for_high_resolution()?)?.seeing_as_given();
        let atsplat = self.network("atsplat", &self.config)?.with_high_resolution(large)?;
        Ok(vec![Arc::new(atsplat), Arc::new(NearestView), Arc::new(Warp)])
    }

    /// What the same weights give under the expansions of the paper's ablations. Anchors, K and the straight-through
    /// estimator need weights of their own and are not here.
    pub(super) fn variants(&self) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        let mut variants = vec![
            self.variant("no expansion", &self.config.with_expansion_in_first(0))?,
            self.variant("random", &self.selecting(Selection::Random { seed: 0 }))?,
            self.variant("farthest point", &self.selecting(Selection::FarthestPoint {}))?,
        ];
        for thresholds in [[0.1, 0.1, 0.4], [0.05, 0.05, 0.2], [0.01, 0.01, 0.04]] {
            let name = thresholds.map(|threshold| threshold.to_string()).join(" ");
            // A configuration that expands in other blocks has no such thresholds.
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

    /// The weights under a configuration.
    pub(super) fn bare(&self, config: &ModelConfig) -> anyhow::Result<Network> {
        // A selection that scores nothing has no scorers.
        let wanted: BTreeSet<String> = parameters(config).into_iter().map(|parameter| parameter.name).collect();
        let mut tensors = self.tensors.clone();
        tensors.tensors.retain(|name, _| wanted.contains(name));
        Ok(Network::new(config, &Device::flex())?.with_weights(&tensors)?.trained_at(self.config.resolution))
    }
}
