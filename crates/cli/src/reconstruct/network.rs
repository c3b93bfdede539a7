//! Arguments of a network with its weights.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context as _, bail};
use atsplat_eval::reconstruct::{NetworkSource, UntrainedBackbone};
use atsplat_files::Sha256Digest;
use atsplat_model::ModelConfig;
use atsplat_model::config::BackboneConfig;
use atsplat_model::weights::{ModelWeights, TensorFile};
use clap::ValueEnum;

use crate::device::DeviceArgs;
use crate::embedded;
use crate::model_args::{ConfigOverrideArgs, model};
use crate::requirements::{GivenOption, Requirement, check_all};

/// Default model of `random:SEED`.
const DEFAULT_UNTRAINED: &str = "nano";

#[derive(Debug, clap::Args)]
pub(crate) struct NetworkArgs {
    /// A weights file of this toolkit (`atsplat weights import` makes one); `micro-rooms` or `micro-yards`, small networks
    /// embedded in the binary; or `random:SEED`: an untrained network, to try the pipeline and its cost without weights.
    #[arg(long, value_name = "FILE|NAME|random:SEED")]
    weights: Option<WeightsArg>,

    /// Expected sha256 of the weights file.
    #[arg(long, value_name = "HEX")]
    sha256: Option<Sha256Digest>,

    /// Configuration: paper-re10k, paper-dl3dv, paper-dl3dv-224, paper-dl3dv-hr, mini, micro, nano, or a path that ends in .toml;
    /// by default the one in the weights file, or nano for random weights.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: Option<String>,

    /// DINOv2 weights for the frozen backbone of an untrained network.
    #[arg(long, value_name = "FILE")]
    backbone: Option<PathBuf>,

    /// Expected sha256 of the backbone file.
    #[arg(long, value_name = "HEX", requires = "backbone")]
    backbone_sha256: Option<Sha256Digest>,

    #[command(flatten)]
    changes: ConfigOverrideArgs,

    /// Size of the photos that the network sees. `trained`, the default, resizes the shorter side to the one that the
    /// weights were trained at, and the longer side in proportion, to whole patches; `given` keeps the size after
    /// cropping and scaling. Renders have the photos' size in either case. Random weights were not trained at any size
    /// and see the photos as given.
    #[arg(long, value_name = "SIZE")]
    context_size: Option<ContextSize>,

    #[command(flatten)]
    pub(crate) device: DeviceArgs,

    /// Seed of random token selection. By default 0.
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
}

/// Size at which a network sees its context.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ContextSize {
    Trained,
    Given,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum WeightsArg {
    File(PathBuf),
    Untrained(u64),
}

impl FromStr for WeightsArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "random" {
            return Err("expected random:SEED, such as random:1".to_owned());
        }
        match text.strip_prefix("random:") {
            Some(seed) => seed.parse().map(Self::Untrained).map_err(|_not_whole: std::num::ParseIntError| {
                format!("expected a whole number after random:, found {seed:?}")
            }),
            None => Ok(Self::File(PathBuf::from(text))),
        }
    }
}

impl NetworkArgs {
    /// Rejects options that do not fit the weights.
    pub(crate) fn check(&self) -> Result<(), String> {
        let is_file = matches!(self.weights, Some(WeightsArg::File(_)));
        check_all(&[
            Requirement {
                options: &[("--backbone", self.backbone.is_some())],
                requires: "--weights random:SEED (a weights file includes its backbone)",
                satisfied: !is_file,
            },
            Requirement {
                options: &[("--sha256", self.sha256.is_some())],
                requires: "--weights with a file (random weights have no hash)",
                satisfied: is_file,
            },
            Requirement {
                options: &[("--context-size", self.context_size.is_some())],
                requires: "--weights with a file (random weights were not trained at any size)",
                satisfied: is_file,
            },
        ])
    }

    pub(crate) const NO_WEIGHTS: &'static str =
        "--weights is required: micro-rooms, micro-yards, a weights file, or random:SEED for an untrained network";

    pub(crate) const fn has_weights(&self) -> bool {
        self.weights.is_some()
    }

    /// The seed of calls of the network: the one given, or 0.
    pub(crate) fn call_seed(&self) -> u64 {
        self.seed.unwrap_or_default()
    }

    /// Changes of the configuration.
    pub(crate) const fn changes(&self) -> &ConfigOverrideArgs {
        &self.changes
    }

    /// Whether networks are to see photos as given, and not at the size of their training.
    pub(crate) fn sees_as_given(&self) -> bool {
        self.context_size == Some(ContextSize::Given)
    }

    /// The files that are read, or names of embedded weights.
    pub(crate) fn files(&self) -> impl Iterator<Item = &Path> {
        let weights = match &self.weights {
            Some(WeightsArg::File(file)) => Some(file.as_path()),
            _ => None,
        };
        weights.into_iter().chain(self.backbone.as_deref())
    }

    /// The options that only networks read.
    pub(crate) fn options(&self) -> Vec<GivenOption> {
        let of_weights = [
            ("--weights", self.weights.is_some()),
            ("--sha256", self.sha256.is_some()),
            ("--model", self.model.is_some()),
            ("--backbone", self.backbone.is_some()),
            ("--context-size", self.context_size.is_some()),
        ];
        self.changes.options().into_iter().chain(of_weights).collect()
    }

    /// Resolves the configuration, and opens the weights file if there is one.
    pub(crate) fn source(&self) -> anyhow::Result<NetworkSource> {
        let requested = self.model.as_deref().map(ModelConfig::resolve).transpose()?;
        let source = match &self.weights {
            None => bail!(Self::NO_WEIGHTS),
            Some(WeightsArg::Untrained(seed)) => {
                let base = requested.map_or_else(|| ModelConfig::named(DEFAULT_UNTRAINED), Ok)?;
                let config = self.changed(&base)?;
                match &self.backbone {
                    None => NetworkSource::untrained(config, *seed),
                    Some(path) => {
                        let backbone = UntrainedBackbone { path: path.clone(), sha256: self.backbone_sha256 };
                        NetworkSource::untrained_with_backbone(config, *seed, backbone)
                    }
                }
            }
            Some(WeightsArg::File(path)) => {
                let (file, written_for) = self.weights_file(path, requested.as_ref())?;
                if let Some(requested) = &requested {
                    same_network(requested, &written_for).context("--model")?;
                }
                let base = requested.as_ref().unwrap_or(&written_for);
                let config = self.changed(base)?;
                let large = base.for_high_resolution()?.map(|base| self.changed(&base)).transpose()?;
                NetworkSource::from_file(config, path.clone(), file, written_for).with_high_resolution(large)
            }
        };
        Ok(if self.sees_as_given() { source.without_resizing() } else { source })
    }

    fn changed(&self, base: &ModelConfig) -> anyhow::Result<ModelConfig> {
        if self.backbone.is_some() && !matches!(base.backbone, BackboneConfig::DinoV2 { .. }) {
            bail!("--backbone: the model {} has no DINOv2 backbone", base.name);
        }
        self.changes.applied(base)
    }

    /// Opens a weights file, and reads the configuration that it was written for.
    fn weights_file(&self, path: &Path, requested: Option<&ModelConfig>) -> anyhow::Result<(TensorFile, ModelConfig)> {
        let file = embedded::find(path, || {
            let file = match requested {
                Some(config) => ModelWeights::advice(config, self.sha256),
                None => "a weights file of this toolkit, which `atsplat weights import` makes".to_owned(),
            };
            format!("{}; `random:SEED` in place of a file runs the network untrained", embedded::or_a_file(&file))
        })?;
        file.check_sha256(self.sha256)?;
        if !ModelWeights::is_one(&file.stored) && !ModelWeights::is_checkpoint(&file.stored) {
            bail!(
                "weights: expected a file of this toolkit, found {} tensors without its metadata; convert it with \
                 `atsplat weights import {} --model NAME --out FILE` ({})",
                file.stored.tensors.len(),
                path.display(),
                path.display()
            );
        }
        let written_for = ModelWeights::config_of(&file.stored).map_err(|error| error.in_file(path))?;
        Ok((file, written_for))
    }
}

/// Rejects another configuration than the one that the weights were written for: the network would compute something
/// else.
pub(crate) fn same_network(requested: &ModelConfig, written_for: &ModelConfig) -> anyhow::Result<()> {
    let ModelConfig { name, title, notes, inferred, .. } = written_for.clone();
    let computed = ModelConfig { name, title, notes, inferred, ..requested.clone() };
    let differences = atsplat_results::differences(&computed, written_for);
    if differences.is_empty() {
        return Ok(());
    }
    bail!(
        "expected the configuration that the weights were written for, {}, found {}, which differs in {differences}; weights files \
         contain their configuration, so --model is not needed",
        written_for.name,
        requested.name
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_network_than_that_of_the_weights_is_rejected_by_field() {
        let [micro, nano] = ["micro", "nano"].map(|name| ModelConfig::named(name).unwrap());
        let renamed = ModelConfig { name: "mine".to_owned(), title: "Mine".to_owned(), ..micro.clone() };
        same_network(&renamed, &micro).unwrap();
        let mut nearer = micro.clone();
        nearer.anchors.depth = nano.anchors.depth;
        nearer.head.gaussians_per_token = 8;
        let error = same_network(&nearer, &micro).unwrap_err().to_string();
        assert!(error.contains("head.gaussians-per-token: 8 and 16"), "{error}");
    }

    #[test]
    fn parses_a_weights_file_or_a_seed() {
        assert_eq!("random:7".parse(), Ok(WeightsArg::Untrained(7)));
        assert_eq!("a.safetensors".parse(), Ok(WeightsArg::File("a.safetensors".into())));
        assert_eq!("randomly/a".parse(), Ok(WeightsArg::File("randomly/a".into())));
        for broken in ["random", "random:", "random:x", "random:-1", "random:1.5"] {
            assert!(broken.parse::<WeightsArg>().is_err(), "{broken:?}");
        }
    }
}
