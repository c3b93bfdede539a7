//! Arguments that select and change a network configuration.

use anyhow::{Context as _, ensure};
use atsplat_eval::sweep::Overrides;
use atsplat_model::config::SelectionRatio;
use atsplat_model::{ModelConfig, ModelError};

use crate::parse::{name_or_path, not_negative};
use crate::requirements::GivenOption;

/// Overrides of a configuration for this run; weights stay as they are.
#[derive(Clone, Debug, Default, clap::Args)]
pub(crate) struct ConfigOverrideArgs {
    /// Expand every token whose uncertainty exceeds its block's threshold, so that the scene determines the number of
    /// Gaussians; one number for each expanding block, such as `0.05,0.05,0.2`.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = not_negative, conflicts_with = "ratios")]
    thresholds: Vec<f64>,

    /// Expand these shares of the tokens, one for each expanding block, such as `0.5,0.5,0.25`.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = ratio)]
    ratios: Vec<SelectionRatio>,

    /// Expand only in the first N expanding blocks.
    #[arg(long, value_name = "N")]
    expand_first: Option<usize>,
}

impl ConfigOverrideArgs {
    /// The configuration with these overrides.
    pub(crate) fn applied(&self, config: &ModelConfig) -> anyhow::Result<ModelConfig> {
        let mut config = config.clone();
        if !self.thresholds.is_empty() {
            config = config.with_thresholds(&self.thresholds).context("--thresholds")?;
        }
        if !self.ratios.is_empty() {
            config = config.with_ratios(&self.ratios).context("--ratios")?;
        }
        if let Some(blocks) = self.expand_first {
            let all = config.expanding_blocks();
            ensure!(
                blocks <= all,
                "--expand-first: expected at most {all}, the model's expanding blocks, found {blocks}"
            );
            config = config.with_expansion_in_first(blocks);
        }
        Ok(config)
    }

    /// The same as overrides of a sweep, for networks that are read later.
    pub(crate) fn overrides(&self) -> Overrides {
        let list = |values: Vec<f64>| (!values.is_empty()).then_some(values);
        Overrides {
            ratios: list(self.ratios.iter().map(|ratio| ratio.value()).collect()),
            thresholds: list(self.thresholds.clone()),
            expand_first: self.expand_first,
            ..Overrides::default()
        }
    }

    pub(crate) fn options(&self) -> [GivenOption; 3] {
        [
            ("--thresholds", !self.thresholds.is_empty()),
            ("--ratios", !self.ratios.is_empty()),
            ("--expand-first", self.expand_first.is_some()),
        ]
    }

    /// Whether nothing is overridden.
    pub(crate) fn is_empty(&self) -> bool {
        self.options().iter().all(|(_, given)| !given)
    }
}

/// Parses the name or path of a configuration.
pub(crate) fn model(text: &str) -> Result<String, ModelError> {
    name_or_path(text, ModelConfig::text_of)
}

fn ratio(text: &str) -> Result<SelectionRatio, String> {
    let ratio = text.parse().ok().and_then(SelectionRatio::new);
    ratio.ok_or_else(|| format!("expected a share from 0 to 1 with at most six decimals, found {text:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(thresholds: &[f64], ratios: &[&str], expand_first: Option<usize>) -> ConfigOverrideArgs {
        let ratios = ratios.iter().map(|text| ratio(text).unwrap()).collect();
        ConfigOverrideArgs { thresholds: thresholds.to_vec(), ratios, expand_first }
    }

    fn max_gaussians(changes: &ConfigOverrideArgs) -> usize {
        let config = changes.applied(&ModelConfig::named("nano").unwrap()).unwrap();
        atsplat_model::budget::budget(&config, 2, config.resolution).unwrap().max.gaussians
    }

    #[test]
    fn changes_change_the_budget() {
        assert_eq!(max_gaussians(&ConfigOverrideArgs::default()), 23_040);
        assert_eq!(max_gaussians(&changes(&[0.1, 0.1, 0.4], &[], None)), 65_536);
        assert_eq!(max_gaussians(&changes(&[], &["1", "0.5", "0"], None)), 24_576);
        assert_eq!(max_gaussians(&changes(&[], &[], Some(0))), 8192);
        assert_eq!(max_gaussians(&changes(&[], &["0.5", "0.5", "1"], Some(2))), 18_432);
        let nano = ModelConfig::named("nano").unwrap();
        for changes in [
            changes(&[0.1, 0.1, 0.4], &[], Some(1)),
            changes(&[], &["0.3", "0.5", "0"], None),
            ConfigOverrideArgs::default(),
        ] {
            assert_eq!(changes.overrides().model(&nano).unwrap(), changes.applied(&nano).unwrap());
        }
    }

    #[test]
    fn rejects_lists_of_the_wrong_length_and_shares_above_one() {
        let nano = ModelConfig::named("nano").unwrap();
        assert!(changes(&[0.1], &[], None).applied(&nano).is_err());
        let error = changes(&[], &[], Some(4)).applied(&nano).unwrap_err().to_string();
        assert!(error.contains("expected at most 3") && error.ends_with("found 4"), "{error}");
        let error = changes(&[], &["0.5"], None).applied(&nano).unwrap_err();
        assert!(format!("{error:#}").contains("expected 3 ratios"), "{error:#}");
        for broken in ["1.5", "-0.1", "NaN", "half", ""] {
            assert!(ratio(broken).is_err(), "{broken:?}");
        }
    }
}
