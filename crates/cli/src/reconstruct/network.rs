//! Which network, with which weights.

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
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::carried;
use crate::model_words::{ChangeWords, ProcessorWord, model};

/// What `random:SEED` runs where no model is named.
const SMALLEST: &str = "nano";

#[derive(Debug, Args)]
pub(crate) struct NetworkWords {
    /// A weights file of this toolkit (`atsplat weights import` makes one); `micro-rooms`, a small network that the binary
    /// carries; or `random:SEED`: an untrained network, to try the way and its cost without weights.
    #[arg(long, value_name = "FILE|micro-rooms|random:SEED")]
    weights: Option<WeightsWord>,

    /// sha256 that the weights file must have.
    #[arg(long, value_name = "HEX")]
    sha256: Option<Sha256Digest>,

    /// Configuration: paper-re10k, paper-dl3dv, paper-dl3dv-224, paper-dl3dv-hr, mini, micro, nano, or a path that ends in .toml;
    /// by default the one in the weights file, or nano for random weights.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: Option<String>,

    /// DINOv2 weights for the frozen backbone of an untrained network.
    #[arg(long, value_name = "FILE")]
    backbone: Option<PathBuf>,

    /// sha256 that the backbone's file must have.
    #[arg(long, value_name = "HEX", requires = "backbone")]
    backbone_sha256: Option<Sha256Digest>,

    #[command(flatten)]
    changes: ChangeWords,

    /// Size at which the network sees the photos: the one that its weights were trained at (the shorter side; the longer one
    /// in proportion, in whole patches), or the photos' own after cropping and scaling. Pictures are rendered at the photos'
    /// size in either case. Nothing was learned at any size by random weights: they see photos as given.
    #[arg(long, value_name = "SIZE", default_value = "trained")]
    context_size: ContextSize,

    /// What the network computes on; wgpu needs a build with `--features gpu-network`, and is for `reconstruct` alone.
    #[arg(long = "device", value_name = "DEVICE", default_value = "cpu")]
    pub(super) processor: ProcessorWord,

    /// What random selection of tokens draws with.
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
enum WeightsWord {
    File(PathBuf),
    Untrained(u64),
}

impl FromStr for WeightsWord {
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

/// A configuration, and where its weights are: known before anything heavy is read.
pub(crate) struct Source<'a> {
    words: &'a NetworkWords,
    weights: &'a WeightsWord,
    pub(crate) config: ModelConfig,
    /// What the file says that it was written for.
    file: Option<(TensorFile, ModelConfig)>,
}

/// The configuration that ran.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct ModelRecord {
    name: String,
    /// Of all that can change a Gaussian.
    hash: String,
    /// What the weights file was written for, where something else ran.
    written_for: Option<WrittenFor>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct WrittenFor {
    name: String,
    hash: String,
}

/// Where every number of the network came from.
#[derive(Debug, Serialize)]
#[serde(tag = "kind", rename_all = "kebab-case", rename_all_fields = "kebab-case")]
pub(crate) enum WeightsRecord {
    File { file: PathBuf, sha256: String, provenance: BTreeMap<String, String> },
    Untrained { seed: u64, told: &'static str, backbone: Option<BackboneRecord> },
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct BackboneRecord {
    file: PathBuf,
    sha256: String,
    /// What the file is, if its hash is known.
    known: Option<&'static str>,
}

impl WeightsRecord {
    /// As a results store has it.
    pub(crate) fn weights(&self) -> WeightsOf {
        match self {
            Self::File { sha256, .. } => WeightsOf::File { sha256: sha256.clone() },
            Self::Untrained { seed, backbone, .. } => {
                let backbone_sha256 = backbone.as_ref().map(|backbone| backbone.sha256.clone());
                WeightsOf::Random { seed: *seed, backbone_sha256 }
            }
        }
    }

    const TOLD: &str = "random weights, nothing was learned; the Gaussians show the way and its cost, not a scene";

    /// What must be said of an untrained network wherever its output is named.
    pub(crate) const fn untrained(&self) -> Option<&'static str> {
        match self {
            Self::File { .. } => None,
            Self::Untrained { told, .. } => Some(told),
        }
    }
}

impl NetworkWords {
    pub(crate) fn check(&self) -> Result<(), String> {
        let is_file = matches!(self.weights, Some(WeightsWord::File(_)));
        if is_file && self.backbone.is_some() {
            return Err("--backbone is for random weights: a weights file holds its backbone".to_owned());
        }
        if !is_file && self.sha256.is_some() {
            return Err("--sha256 is that of a weights file, and random weights have none".to_owned());
        }
        Ok(())
    }

    /// [`Self::check`] for commands that evaluate networks: results are computed on the central processor alone.
    pub(crate) fn check_for_evaluation(&self) -> Result<(), clap::Error> {
        let on_cpu = match self.processor {
            ProcessorWord::Cpu => Ok(()),
            ProcessorWord::Wgpu => Err("--device wgpu: evaluations run on the central processor alone so far, whose bits \
                                        a baseline can be compared with; leave --device out, or reconstruct single scenes \
                                        with `atsplat reconstruct --device wgpu`"
                .to_owned()),
        };
        let checked = on_cpu.and_then(|()| self.check());
        checked.map_err(|text| clap::Command::new("atsplat").error(clap::error::ErrorKind::ValueValidation, text))
    }

    /// Reads the configuration and, of a file, what it says of itself.
    pub(crate) fn source(&self) -> anyhow::Result<Source<'_>> {
        let asked = self.model.as_deref().map(ModelConfig::resolve).transpose()?;
        let Some(weights) = &self.weights else {
            bail!("--weights is needed: a weights file, or random:SEED for an untrained network");
        };
        let (base, file) = match weights {
            WeightsWord::Untrained(_) => (asked.map_or_else(|| ModelConfig::named(SMALLEST), Ok)?, None),
            WeightsWord::File(path) => {
                let advised = asked.clone().map_or_else(|| ModelConfig::named("paper-re10k"), Ok)?;
                let asked_hash = self.sha256.map(|hash| hash.to_string());
                let file = carried::find(path, || {
                    let advice = ModelWeights::advice(&advised, asked_hash.as_deref());
                    format!("{advice}; `random:SEED` in place of a file runs the network untrained")
                })?;
                file.check_sha256(asked_hash.as_deref())?;
                if !ModelWeights::is_one(&file.stored) {
                    bail!(
                        "weights: expected a file of this toolkit, found {} tensors without its metadata: `atsplat \
                         weights import {} --model NAME --out FILE` makes one ({})",
                        file.stored.tensors.len(),
                        path.display(),
                        path.display()
                    );
                }
                let own = ModelWeights::config_of(&file.stored).map_err(|error| error.in_file(path))?;
                (asked.unwrap_or_else(|| own.clone()), Some((file, own)))
            }
        };
        if self.backbone.is_some() && !matches!(base.backbone, BackboneConfig::DinoV2 { .. }) {
            bail!("--backbone: the model {} has no DINOv2 backbone", base.name);
        }
        Ok(Source { words: self, weights, config: self.changes.applied(&base)?, file })
    }
}

impl Source<'_> {
    /// What size of pictures the weights were trained at, unless the network is to see pictures as given.
    fn trained_at(&self) -> Option<ImageSize> {
        let own = self.file.as_ref().map(|(_, own)| own.resolution);
        own.filter(|_| self.words.context_size == ContextSize::Trained)
    }

    /// The size at which the network will see pictures of a size.
    pub(crate) fn sees(&self, given: ImageSize) -> ImageSize {
        self.trained_at().map_or(given, |trained| self.config.context_size(given, trained))
    }

    /// The network with its weights, whole or not at all.
    pub(crate) fn load(&self, device: &Device) -> anyhow::Result<(Network, WeightsRecord)> {
        let network = Network::new(&self.config, device)?;
        let network = match self.trained_at() {
            Some(size) => network.trained_at(size),
            None => network,
        };
        match (self.weights, &self.file) {
            (WeightsWord::File(path), Some((file, _))) => {
                // Other configurations may run on the same parameters.
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
            (WeightsWord::File(path), None) => bail!("{} was not read", path.display()),
            (WeightsWord::Untrained(seed), _) => {
                let mut tensors = generated(&parameters(&self.config), *seed);
                let mut record = None;
                if let Some(path) = &self.words.backbone {
                    let asked = self.words.backbone_sha256.map(|hash| hash.to_string());
                    let backbone = read_backbone(path, &self.config, asked.as_deref())?;
                    tensors.tensors.extend(backbone.tensors.tensors);
                    let known = backbone.known.map(|known| known.what);
                    record = Some(BackboneRecord { file: path.clone(), sha256: backbone.sha256, known });
                }
                let told = WeightsRecord::TOLD;
                let record = WeightsRecord::Untrained { seed: *seed, told, backbone: record };
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
    fn weights_are_a_file_or_a_seed() {
        assert_eq!("random:7".parse(), Ok(WeightsWord::Untrained(7)));
        assert_eq!("a.safetensors".parse(), Ok(WeightsWord::File("a.safetensors".into())));
        assert_eq!("randomly/a".parse(), Ok(WeightsWord::File("randomly/a".into())));
        for broken in ["random", "random:", "random:x", "random:-1", "random:1.5"] {
            assert!(broken.parse::<WeightsWord>().is_err(), "{broken:?}");
        }
    }
}
