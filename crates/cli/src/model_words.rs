//! Which network, in words: a configuration by name or path, what of it is changed, what a hash should be.

use anyhow::Context as _;
use atsplat_model::config::SelectionRatio;
use atsplat_model::network::{Device, Processor};
use atsplat_model::{ModelConfig, ModelError};
use clap::{Args, ValueEnum};

use crate::render::words::not_negative;

/// What of a configuration is changed for one call. Weights stay what they are.
#[derive(Clone, Debug, Default, Args)]
pub(crate) struct ChangeWords {
    /// Expand every token whose uncertainty exceeds its block's threshold, so that the scene decides how many Gaussians
    /// there are; one number for each block that expands, as `0.05,0.05,0.2`.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = not_negative, conflicts_with = "ratios")]
    thresholds: Vec<f64>,

    /// Expand these shares of the tokens, one for each block that expands, as `0.5,0.5,0.25`.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = ratio)]
    ratios: Vec<SelectionRatio>,

    /// Expand in the first N of the blocks that expand, and in no other.
    #[arg(long, value_name = "N")]
    expand_first: Option<usize>,
}

/// What a network computes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProcessorWord {
    /// Every core.
    Cpu,
    /// A graphics processor.
    Wgpu,
}

impl From<ProcessorWord> for Processor {
    fn from(word: ProcessorWord) -> Self {
        match word {
            ProcessorWord::Cpu => Self::Cpu,
            ProcessorWord::Wgpu => Self::Wgpu,
        }
    }
}

impl ProcessorWord {
    pub(crate) fn open(self) -> anyhow::Result<Device> {
        Processor::from(self).open().context("--device")
    }
}

impl ChangeWords {
    /// The configuration with the changes.
    pub(crate) fn applied(&self, config: &ModelConfig) -> anyhow::Result<ModelConfig> {
        let mut config = config.clone();
        if !self.thresholds.is_empty() {
            config = config.with_thresholds(&self.thresholds).context("--thresholds")?;
        }
        if !self.ratios.is_empty() {
            config = config.with_ratios(&self.ratios).context("--ratios")?;
        }
        if let Some(blocks) = self.expand_first {
            config = config.with_expansion_in_first(blocks);
        }
        Ok(config)
    }

    /// Whether anything is changed.
    pub(crate) const fn is_empty(&self) -> bool {
        self.thresholds.is_empty() && self.ratios.is_empty() && self.expand_first.is_none()
    }
}

/// A configuration's name, or the path of one. A path is read when the work begins: a broken file is no wrong word.
pub(crate) fn model(text: &str) -> Result<String, ModelError> {
    if !is_toml(text) {
        ModelConfig::text_of(text)?;
    }
    Ok(text.to_owned())
}

/// Whether a word is a path and not a name.
pub(crate) fn is_toml(text: &str) -> bool {
    std::path::Path::new(text).extension().is_some_and(|extension| extension == "toml")
}

fn ratio(text: &str) -> Result<SelectionRatio, String> {
    let ratio = text.parse().ok().and_then(SelectionRatio::new);
    ratio.ok_or_else(|| format!("expected a share from 0 to 1 with at most six decimals, found {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(thresholds: &[f64], ratios: &[&str], expand_first: Option<usize>) -> ChangeWords {
        let ratios = ratios.iter().map(|text| ratio(text).unwrap()).collect();
        ChangeWords { thresholds: thresholds.to_vec(), ratios, expand_first }
    }

    fn most(changes: &ChangeWords) -> usize {
        let config = changes.applied(&ModelConfig::named("nano").unwrap()).unwrap();
        atsplat_model::budget::budget(&config, 2, config.resolution).unwrap().most.gaussians
    }

    #[test]
    fn changes_change_the_budget() {
        assert_eq!(most(&ChangeWords::default()), 23_040);
        assert_eq!(most(&words(&[0.1, 0.1, 0.4], &[], None)), 65_536);
        assert_eq!(most(&words(&[], &["1", "0.5", "0"], None)), 24_576);
        assert_eq!(most(&words(&[], &[], Some(0))), 8192);
        assert_eq!(most(&words(&[], &["0.5", "0.5", "1"], Some(2))), 18_432);
    }

    #[test]
    fn lists_of_another_length_and_shares_above_one_are_refused() {
        let nano = ModelConfig::named("nano").unwrap();
        assert!(words(&[0.1], &[], None).applied(&nano).is_err());
        let error = words(&[], &["0.5"], None).applied(&nano).unwrap_err();
        assert!(format!("{error:#}").contains("expected 3 ratios"), "{error:#}");
        for broken in ["1.5", "-0.1", "NaN", "half", ""] {
            assert!(ratio(broken).is_err(), "{broken:?}");
        }
    }
}
