//! Arguments of a network with its weights.

use atsplat_files::Sha256Digest;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::bail;
use atsplat_eval::method::WeightsOf;
use atsplat_model::config::BackboneConfig;
use atsplat_model::network::{Device, Network};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, TensorFile, generated, read_backbone};
use atsplat_model::{ImageSize, ModelConfig};
use clap::ValueEnum;
use serde::Serialize;

use crate::embedded;
use crate::model_args::{ChangeArgs, ProcessorArg, model};
use crate::parse::usage_error;

/// Default model of `random:SEED`.
const DEFAULT_UNTRAINED: &str = "nano";

#[derive(Debug, clap::Args)]
pub(crate) struct NetworkArgs {
    /// A weights file of this toolkit (`atsplat weights import` makes one); `micro-rooms`, a small network embedded in the
    /// binary; or `random:SEED`: an untrained network, to try the pipeline and its cost without weights.
    #[arg(long, value_name = "FILE|micro-rooms|random:SEED")]
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
    changes: ChangeArgs,

    /// Size at which the network sees the photos: the one that its weights were trained at (the shorter side; the longer one
    /// in proportion, in whole patches), or the photos' own after cropping and scaling. Renders have the photos' size in
    /// either case. Random weights were not trained at any size: they see photos as given.
    #[arg(long, value_name = "SIZE", default_value = "trained")]
    context_size: ContextSize,

    /// Device of the network; wgpu needs a build with `--features gpu-network` and works with `reconstruct` only.
    #[arg(long = "device", value_name = "DEVICE", default_value = "cpu")]
    pub(super) processor: ProcessorArg,

    /// Seed of random token selection.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,
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
        match text.strip_prefix("random") {
            Some("") => Err("expected random:SEED, as random:1".to_owned()),
            Some(rest) if rest.starts_with(':') => {
                let seed = rest.trim_start_matches(':').parse();
                seed.map(Self::Untrained).map_err(|_not_whole: std::num::ParseIntError| {
                    format!("expected a whole number after random:, found {rest:?}")
                })
            }
            _ => Ok(Self::File(PathBuf::from(text))),
        }
    }
}

/// A configuration and the location of its weights, resolved before large files are read.
pub(crate) struct Source<'a> {
    args: &'a NetworkArgs,
    weights: &'a WeightsArg,
    pub(crate) config: ModelConfig,
    /// The weights file and the configuration it was written for.
    file: Option<(TensorFile, ModelConfig)>,
}

/// The configuration that ran.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct ModelRecord {
    name: String,
    /// Hash of everything that can change a Gaussian.
    hash: String,
    /// The configuration of the weights file, if another one ran.
    written_for: Option<WrittenFor>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct WrittenFor {
    name: String,
    hash: String,
}

/// Origin of the network's weights.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub(crate) enum WeightsRecord {
    File {
        file: PathBuf,
        sha256: String,
        provenance: BTreeMap<String, String>,
    },
    Untrained {
        seed: u64,
        #[serde(rename = "told")]
        message: &'static str,
        backbone: Option<BackboneRecord>,
    },
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct BackboneRecord {
    file: PathBuf,
    sha256: String,
    /// Description of the published file with this hash, if any.
    known: Option<&'static str>,
}

impl WeightsRecord {
    /// As recorded in a results store.
    pub(crate) fn weights(&self) -> WeightsOf {
        match self {
            Self::File { sha256, .. } => WeightsOf::File { sha256: sha256.clone() },
            Self::Untrained { seed, backbone, .. } => {
                let backbone_sha256 = backbone.as_ref().map(|backbone| backbone.sha256.clone());
                WeightsOf::Random { seed: *seed, backbone_sha256 }
            }
        }
    }

    const UNTRAINED: &str = "random weights, nothing was learned; the Gaussians show that the pipeline works and what it costs, not a scene";

    /// The warning that must accompany all output of an untrained network.
    pub(crate) const fn untrained(&self) -> Option<&'static str> {
        match self {
            Self::File { .. } => None,
            Self::Untrained { message, .. } => Some(message),
        }
    }
}

impl NetworkArgs {
    pub(crate) fn check(&self) -> Result<(), String> {
        let is_file = matches!(self.weights, Some(WeightsArg::File(_)));
        if is_file && self.backbone.is_some() {
            return Err("--backbone is for random weights: a weights file includes its backbone".to_owned());
        }
        if !is_file && self.sha256.is_some() {
            return Err("--sha256 is for weights files: random weights have none".to_owned());
        }
        Ok(())
    }

    /// [`Self::check`] for commands that evaluate networks: results are computed on the CPU only.
    pub(crate) fn check_for_evaluation(&self) -> Result<(), clap::Error> {
        let on_cpu = match self.processor {
            ProcessorArg::Cpu => Ok(()),
            ProcessorArg::Wgpu => Err("--device wgpu: evaluations run on the CPU only, whose results are bit for bit \
                                       reproducible; omit --device, or reconstruct single scenes with `atsplat \
                                       reconstruct --device wgpu`"
                .to_owned()),
        };
        on_cpu.and_then(|()| self.check()).map_err(usage_error)
    }

    /// Resolves the configuration, and opens the weights file if there is one.
    pub(crate) fn source(&self) -> anyhow::Result<Source<'_>> {
        let requested = self.model.as_deref().map(ModelConfig::resolve).transpose()?;
        let Some(weights) = &self.weights else {
            bail!("--weights is needed: a weights file, or random:SEED for an untrained network");
        };
        let (base, file) = match weights {
            WeightsArg::Untrained(_) => (requested.map_or_else(|| ModelConfig::named(DEFAULT_UNTRAINED), Ok)?, None),
            WeightsArg::File(path) => {
                let advised = requested.clone().map_or_else(|| ModelConfig::named("paper-re10k"), Ok)?;
                let expected_hash = self.sha256.map(|hash| hash.to_string());
                let file = embedded::find(path, || {
                    let advice = ModelWeights::advice(&advised, expected_hash.as_deref());
                    format!("{advice}; `random:SEED` in place of a file runs the network untrained")
                })?;
                file.check_sha256(expected_hash.as_deref())?;
                if !ModelWeights::is_one(&file.stored) {
                    bail!(
                        "weights: expected a file of this toolkit, found {} tensors without its metadata: convert it with \
                         `atsplat weights import {} --model NAME --out FILE` ({})",
                        file.stored.tensors.len(),
                        path.display(),
                        path.display()
                    );
                }
                let own = ModelWeights::config_of(&file.stored).map_err(|error| error.in_file(path))?;
                (requested.unwrap_or_else(|| own.clone()), Some((file, own)))
            }
        };
        if self.backbone.is_some() && !matches!(base.backbone, BackboneConfig::DinoV2 { .. }) {
            bail!("--backbone: the model {} has no DINOv2 backbone", base.name);
        }
        Ok(Source { args: self, weights, config: self.changes.applied(&base)?, file })
    }
}

impl Source<'_> {
    /// The training resolution of the weights, unless the network shall see images as given.
    fn trained_at(&self) -> Option<ImageSize> {
        let own = self.file.as_ref().map(|(_, own)| own.resolution);
        own.filter(|_| self.args.context_size == ContextSize::Trained)
    }

    /// The size at which the network sees images of a given size.
    pub(crate) fn sees(&self, given: ImageSize) -> ImageSize {
        self.trained_at().map_or(given, |trained| self.config.context_size(given, trained))
    }

    /// Loads the network with all its weights.
    pub(crate) fn load(&self, device: &Device) -> anyhow::Result<(Network, WeightsRecord)> {
        let network = Network::new(&self.config, device)?;
        let network = match self.trained_at() {
            Some(size) => network.trained_at(size),
            None => network,
        };
        match (self.weights, &self.file) {
            (WeightsArg::File(path), Some((file, _))) => {
                // Several configurations can share the same parameters.
                let weights = ModelWeights::of_file(file)?
                    .for_network(self.config.clone())
                    .map_err(|error| error.in_file(path))?;
                let record = WeightsRecord::File {
                    file: path.clone(),
                    sha256: file.sha256.clone(),
                    provenance: weights.provenance,
                };
                Ok((network.with_weights(&weights.tensors)?, record))
            }
            (WeightsArg::File(path), None) => bail!("{} was not read", path.display()),
            (WeightsArg::Untrained(seed), _) => {
                let mut tensors = generated(&parameters(&self.config), *seed);
                let mut record = None;
                if let Some(path) = &self.args.backbone {
                    let expected = self.args.backbone_sha256.map(|hash| hash.to_string());
                    let backbone = read_backbone(path, &self.config, expected.as_deref())?;
                    tensors.tensors.extend(backbone.tensors.tensors);
                    let known = backbone.known.map(|known| known.what);
                    record = Some(BackboneRecord { file: path.clone(), sha256: backbone.sha256, known });
                }
                let message = WeightsRecord::UNTRAINED;
                let record = WeightsRecord::Untrained { seed: *seed, message, backbone: record };
                Ok((network.with_weights(&tensors)?, record))
            }
        }
    }

    pub(crate) fn record(&self) -> anyhow::Result<ModelRecord> {
        let hash = self.config.hash()?;
        let written_for = match &self.file {
            Some((_, own)) => Some(WrittenFor { name: own.name.clone(), hash: own.hash()? }),
            None => None,
        };
        let written_for = written_for.filter(|own| own.hash != hash);
        Ok(ModelRecord { name: self.config.name.clone(), hash, written_for })
    }
}

impl ModelRecord {
    pub(crate) fn name(&self) -> &str {
        &self.name
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
