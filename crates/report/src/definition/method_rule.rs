use atsplat_model::ModelConfig;
use atsplat_model::config::{AnchorDesign, BlockExpansion, Selection};
use atsplat_results::MethodRecord;
use serde::{Deserialize, Serialize};

use super::training::is_unified;

/// Which methods reproduce a row; all given conditions must hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct MethodRule {
    /// The method's [`MethodRecord::kind`].
    #[serde(default)]
    pub kind: Option<String>,
    /// The ablation, by the name that `variant` gives a configuration.
    #[serde(default)]
    pub variant: Option<String>,
    /// Uncertainty thresholds of the blocks that expand; implies the variant `thresholds`.
    #[serde(default)]
    pub thresholds: Option<Vec<f64>>,
    /// Gaussians per token; the paper's 16 by default.
    #[serde(default)]
    pub gaussians_per_token: Option<usize>,
    /// `true`: only one network that was trained on both datasets; `false`: only other networks; absent: both.
    #[serde(default)]
    pub unified: Option<bool>,
}

/// The paper's K.
const GAUSSIANS_PER_TOKEN: usize = 16;
/// The paper's expansion ratios, and those at its highest resolution, where the coarse branch sees images at half their size.
const RATIOS: [[f64; 3]; 2] = [[0.5, 0.5, 0.25], [0.8, 0.5, 0.25]];

impl MethodRule {
    /// Whether a method satisfies the rule.
    pub fn accepts(&self, record: &MethodRecord) -> bool {
        if self.kind.as_ref().is_some_and(|kind| *kind != record.kind) {
            return false;
        }
        if self.unified.is_some_and(|unified| unified != is_unified(record)) {
            return false;
        }
        let config = configuration(record);
        if self.variant.is_none() && self.thresholds.is_none() && self.gaussians_per_token.is_none() {
            return true;
        }
        let expected = match (&self.variant, &self.thresholds) {
            (Some(variant), _) => variant.as_str(),
            (None, Some(_)) => "thresholds",
            (None, None) => "full",
        };
        let per_token = self.gaussians_per_token.unwrap_or(GAUSSIANS_PER_TOKEN);
        let same_k = config.as_ref().is_none_or(|config| config.head.gaussians_per_token == per_token);
        // Thresholds by quantile represent the published ones that they were chosen for.
        let published = numbers(record, "published-thresholds").or_else(|| config.as_ref().map(thresholds));
        let same_thresholds = self.thresholds.as_ref().is_none_or(|thresholds| published.as_ref() == Some(thresholds));
        variant(record).as_deref() == Some(expected) && same_k && same_thresholds
    }
}

/// How a method differs from ATSplat: `full` for the full method, or the name of the ablation. It is taken from the
/// parameter `variant`, or else from the configuration; `None` if neither is known.
pub(crate) fn variant(record: &MethodRecord) -> Option<String> {
    if let Some(variant) = record.parameters.get("variant").and_then(serde_json::Value::as_str) {
        return Some(variant.to_owned());
    }
    let config = configuration(record)?;
    let design = match config.anchors.design {
        AnchorDesign::PatchDepth {} => None,
        AnchorDesign::RayDepth {} => Some("ray-depth"),
        AnchorDesign::LearnableTokens { .. } => Some("learnable-tokens"),
        AnchorDesign::DirectXyz {} => Some("direct-xyz"),
    };
    let active: Vec<BlockExpansion> =
        config.decoder.blocks.iter().filter_map(atsplat_model::config::BlockConfig::active_expansion).collect();
    let possible = config.decoder.blocks.iter().filter(|block| block.expansion.is_some()).count();
    let ratios: Vec<f64> = active
        .iter()
        .filter_map(|expansion| match expansion {
            BlockExpansion::Ratio(ratio) => Some(ratio.value()),
            BlockExpansion::Threshold(_) => None,
        })
        .collect();
    let expansion = if active.is_empty() {
        Some("no-expansion")
    } else if active.len() < possible {
        Some("partial-expansion")
    } else if ratios.is_empty() {
        Some("thresholds")
    } else if RATIOS[usize::from(config.coarse.image_downscale == 2)].as_slice() != ratios {
        Some("other-ratios")
    } else {
        match config.expansion.selection {
            Selection::Uncertainty {} => None,
            Selection::Random { .. } => Some("random"),
            Selection::FarthestPoint {} => Some("farthest-point"),
            Selection::StraightThrough {} => Some("straight-through"),
        }
    };
    match (design, expansion) {
        (None, None) => Some("full".to_owned()),
        (Some(one), None) | (None, Some(one)) => Some(one.to_owned()),
        (Some(design), Some(expansion)) => Some(format!("{design}, {expansion}")),
    }
}

/// Whether the paper trains a separate network for this variant; thresholds and ratios it also chooses at inference.
pub(crate) fn is_trained_separately(record: &MethodRecord) -> bool {
    is_ablation(record)
        && variant(record).is_some_and(|variant| !matches!(variant.as_str(), "thresholds" | "partial-expansion"))
}

/// Whether a method is the full ATSplat with the paper's ratios.
pub(crate) fn is_full(record: &MethodRecord) -> bool {
    variant(record).as_deref() == Some("full")
}

/// Whether a method is an ablation, which benchmark tables omit.
pub(crate) fn is_ablation(record: &MethodRecord) -> bool {
    variant(record).is_some_and(|variant| variant != "full" && variant != "other-ratios")
}

/// How its thresholds were chosen, if by quantile of its own scores.
pub(crate) fn by_quantile(record: &MethodRecord) -> Option<String> {
    let text = |values: Vec<f64>| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" / ");
    let quantiles = numbers(record, "threshold-quantiles")?;
    let values = configuration(record).map(|config| format!(": {}", text(thresholds(&config)))).unwrap_or_default();
    Some(format!("by quantile {} of its own scores{values}", text(quantiles)))
}

/// Whether thresholds decide which tokens expand, not ratios.
pub(crate) fn has_thresholds(record: &MethodRecord) -> bool {
    configuration(record).is_some_and(|config| !thresholds(&config).is_empty())
}

fn numbers(record: &MethodRecord, parameter: &str) -> Option<Vec<f64>> {
    record.parameters.get(parameter)?.as_array()?.iter().map(serde_json::Value::as_f64).collect()
}

fn thresholds(config: &ModelConfig) -> Vec<f64> {
    let active = config.decoder.blocks.iter().filter_map(atsplat_model::config::BlockConfig::active_expansion);
    let threshold = |expansion| match expansion {
        BlockExpansion::Threshold(threshold) => Some(threshold),
        BlockExpansion::Ratio(_) => None,
    };
    active.filter_map(threshold).collect()
}

/// The configuration stored in the record, or the built-in one with the recorded name and hash. `None` if there is
/// neither, or if this version cannot read the stored one.
fn configuration(record: &MethodRecord) -> Option<ModelConfig> {
    if let Some(stored) = record.parameters.get("configuration") {
        return serde_json::from_value(stored.clone()).ok();
    }
    let name = record.parameters.get("model")?.as_str()?;
    let config = ModelConfig::named(name).ok()?;
    let hash = record.parameters.get("model-hash")?.as_str()?;
    (config.hash().ok()? == hash).then_some(config)
}

#[cfg(test)]
mod tests {
    use atsplat_model::config::SelectionRatio;

    use super::*;

    fn record(config: &ModelConfig) -> MethodRecord {
        let parameters = [("configuration".to_owned(), serde_json::to_value(config).unwrap())];
        MethodRecord { kind: "atsplat".to_owned(), parameters: parameters.into(), ..MethodRecord::default() }
    }

    fn full() -> MethodRule {
        MethodRule { kind: Some("atsplat".to_owned()), variant: Some("full".to_owned()), ..MethodRule::default() }
    }

    #[test]
    fn recognises_the_variant_of_a_configuration() {
        let nano = ModelConfig::named("nano").unwrap();
        let mut random = nano.clone();
        random.expansion.selection = Selection::Random { seed: 1 };
        let mut rays = nano.clone();
        rays.anchors.design = AnchorDesign::RayDepth {};
        let thresholds = nano.clone().with_thresholds(&[0.1, 0.1, 0.4]).unwrap();
        let large = nano.for_high_resolution().unwrap();
        let with_ratios = |config: &ModelConfig, ratios: [f64; 3]| {
            config.with_ratios(&ratios.map(|ratio| SelectionRatio::new(ratio).unwrap())).unwrap()
        };
        for (config, expected) in [
            (&nano, "full"),
            (&random, "random"),
            (&rays, "ray-depth"),
            (&thresholds, "thresholds"),
            (&with_ratios(&nano, [0.8, 0.5, 0.25]), "other-ratios"),
            (&large, "full"),
            (&with_ratios(&large, [0.5, 0.5, 0.25]), "other-ratios"),
            (&nano.clone().with_expansion_in_first(0), "no-expansion"),
            (&nano.clone().with_expansion_in_first(1), "partial-expansion"),
        ] {
            assert_eq!(variant(&record(config)).as_deref(), Some(expected));
        }
        let rule = MethodRule { variant: None, thresholds: Some(vec![0.1, 0.1, 0.4]), ..full() };
        assert!(rule.accepts(&record(&thresholds)) && !rule.accepts(&record(&nano)));
        assert!(full().accepts(&record(&nano)) && !full().accepts(&record(&random)));
    }

    #[test]
    fn thresholds_by_quantile_stand_for_the_published_ones() {
        let config = ModelConfig::named("nano").unwrap().with_thresholds(&[0.3, 0.2, 0.7]).unwrap();
        let mut record = record(&config);
        let rule = |thresholds: [f64; 3]| MethodRule {
            kind: Some("atsplat".to_owned()),
            thresholds: Some(thresholds.to_vec()),
            ..MethodRule::default()
        };
        assert!(rule([0.3, 0.2, 0.7]).accepts(&record) && by_quantile(&record).is_none());
        record.parameters.insert("published-thresholds".to_owned(), serde_json::json!([0.1, 0.1, 0.4]));
        record.parameters.insert("threshold-quantiles".to_owned(), serde_json::json!([0.8, 0.8, 0.9]));
        assert!(rule([0.1, 0.1, 0.4]).accepts(&record) && !rule([0.05, 0.05, 0.2]).accepts(&record));
        assert!(!rule([0.3, 0.2, 0.7]).accepts(&record), "it is in one row only");
        let text = by_quantile(&record).unwrap();
        assert_eq!(text, "by quantile 0.8 / 0.8 / 0.9 of its own scores: 0.3 / 0.2 / 0.7");
    }

    #[test]
    fn unified_weights_fill_no_separate_row() {
        let rule = |unified| MethodRule { unified: Some(unified), ..full() };
        let mut record = record(&ModelConfig::named("nano").unwrap());
        assert!(rule(false).accepts(&record) && !rule(true).accepts(&record), "separate weights");
        let data = "1 × data/re10k/train under re10k-2v-256 + 1 × data/dl3dv/train under dl3dv-6v-256x448".to_owned();
        record.training = Some(atsplat_results::TrainingRecord { data, seed: None });
        assert!(!rule(false).accepts(&record) && rule(true).accepts(&record), "unified weights");
        assert!(full().accepts(&record), "tables that do not ask take either");
    }

    #[test]
    fn a_different_k_is_a_different_row() {
        let mut config = ModelConfig::named("nano").unwrap();
        config.head.gaussians_per_token = 32;
        let k =
            |k| MethodRule { kind: Some("atsplat".to_owned()), gaussians_per_token: Some(k), ..MethodRule::default() };
        assert!(!full().accepts(&record(&config)));
        assert!(k(32).accepts(&record(&config)) && !k(16).accepts(&record(&config)));
    }

    #[test]
    fn a_built_in_configuration_counts_only_with_its_hash() {
        let nano = ModelConfig::named("nano").unwrap();
        let record = |hash: String| MethodRecord {
            kind: "atsplat".to_owned(),
            parameters: [("model".to_owned(), "nano".into()), ("model-hash".to_owned(), hash.into())].into(),
            ..MethodRecord::default()
        };
        assert!(full().accepts(&record(nano.hash().unwrap())));
        assert!(!full().accepts(&record("another".to_owned())), "a changed configuration is not the full method");
    }

    #[test]
    fn a_method_may_state_its_variant() {
        let record = MethodRecord {
            kind: "atsplat".to_owned(),
            parameters: [("variant".to_owned(), "unified".into())].into(),
            ..MethodRecord::default()
        };
        assert_eq!(variant(&record).as_deref(), Some("unified"));
        assert!(!full().accepts(&record));
        assert!(!full().accepts(&MethodRecord { kind: "renders".to_owned(), ..record }));
    }
}
