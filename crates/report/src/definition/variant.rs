//! The ablations of the paper, as their methods' records show them.

use atsplat_model::ModelConfig;
use atsplat_model::config::{AnchorDesign, BlockConfig, BlockExpansion, Selection};
use atsplat_results::MethodRecord;
use serde::de::{self, value::StrDeserializer};
use serde::{Deserialize, Serialize};

/// How a network differs from the full ATSplat; definitions of tables name it so.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Variant {
    /// Not at all.
    Full,
    /// Tokens have no anchors; Gaussians are at predicted depths on rays.
    RayDepth,
    /// Tokens are learned, the same for every scene; positions are given directly.
    LearnableTokens,
    /// Tokens have no anchors; positions are given directly.
    DirectXyz,
    /// No block expands.
    NoExpansion,
    /// Fewer blocks expand.
    PartialExpansion,
    /// Ratios of expansion that the paper does not have.
    OtherRatios,
    /// Tokens are selected at random.
    Random,
    /// Tokens are selected by farthest point sampling.
    FarthestPoint,
    /// Tokens are selected by scores that a straight-through estimator trains.
    StraightThrough,
    /// Blocks expand by these uncertainty thresholds in place of ratios. Definitions give them as `thresholds`.
    #[serde(skip)]
    Thresholds(Vec<f64>),
    /// In several of these ways at once, or in one that its record states and the paper does not have. No definition names it.
    #[serde(skip)]
    Other,
}

impl Variant {
    /// The variant that definitions call so.
    fn named(name: &str) -> Option<Self> {
        Self::deserialize(StrDeserializer::<de::value::Error>::new(name)).ok()
    }
}

/// The paper's expansion ratios, and those at its highest resolution, where the coarse branch sees images at half their size.
const RATIOS: [[f64; 3]; 2] = [[0.5, 0.5, 0.25], [0.8, 0.5, 0.25]];

/// How a method differs from ATSplat. It is taken from the parameter `variant`, or else from the configuration; `None` if neither is
/// known.
pub(super) fn variant(record: &MethodRecord) -> Option<Variant> {
    if let Some(stated) = record.stated_variant() {
        return Some(Variant::named(stated).unwrap_or(Variant::Other));
    }
    let config = configuration(record)?;
    let design = match config.anchors.design {
        AnchorDesign::PatchDepth {} => None,
        AnchorDesign::RayDepth {} => Some(Variant::RayDepth),
        AnchorDesign::LearnableTokens { .. } => Some(Variant::LearnableTokens),
        AnchorDesign::DirectXyz {} => Some(Variant::DirectXyz),
    };
    Some(match (design, expansion(record, &config)) {
        (None, None) => Variant::Full,
        (Some(one), None) | (None, Some(one)) => one,
        (Some(_), Some(_)) => Variant::Other,
    })
}

/// How a network expands tokens otherwise than the paper's, if it does.
fn expansion(record: &MethodRecord, config: &ModelConfig) -> Option<Variant> {
    let blocks = &config.decoder.blocks;
    let active: Vec<BlockExpansion> = blocks.iter().filter_map(BlockConfig::active_expansion).collect();
    let possible = blocks.iter().filter(|block| block.expansion.is_some()).count();
    let ratios: Vec<f64> = active
        .iter()
        .filter_map(|expansion| match expansion {
            BlockExpansion::Ratio(ratio) => Some(ratio.value()),
            BlockExpansion::Threshold(_) => None,
        })
        .collect();
    if active.is_empty() {
        Some(Variant::NoExpansion)
    } else if active.len() < possible {
        Some(Variant::PartialExpansion)
    } else if ratios.is_empty() {
        // Thresholds by quantile represent the published ones that they were chosen for.
        Some(Variant::Thresholds(record.published_thresholds().unwrap_or_else(|| thresholds(config))))
    } else if RATIOS[usize::from(config.coarse.image_downscale == 2)].as_slice() != ratios {
        Some(Variant::OtherRatios)
    } else {
        match config.expansion.selection {
            Selection::Uncertainty {} => None,
            Selection::Random { .. } => Some(Variant::Random),
            Selection::FarthestPoint {} => Some(Variant::FarthestPoint),
            Selection::StraightThrough {} => Some(Variant::StraightThrough),
        }
    }
}

/// Whether the paper trains a separate network for this variant; thresholds and ratios it also chooses at inference.
pub(crate) fn is_trained_separately(record: &MethodRecord) -> bool {
    variant(record).is_some_and(|variant| match variant {
        Variant::Full | Variant::OtherRatios | Variant::PartialExpansion | Variant::Thresholds(_) => false,
        Variant::RayDepth
        | Variant::LearnableTokens
        | Variant::DirectXyz
        | Variant::NoExpansion
        | Variant::Random
        | Variant::FarthestPoint
        | Variant::StraightThrough
        | Variant::Other => true,
    })
}

/// Whether a method is the full ATSplat with the paper's ratios.
pub(crate) fn is_full(record: &MethodRecord) -> bool {
    variant(record) == Some(Variant::Full)
}

/// Whether a method is an ablation, which benchmark tables omit.
pub(crate) fn is_ablation(record: &MethodRecord) -> bool {
    variant(record).is_some_and(|variant| !matches!(variant, Variant::Full | Variant::OtherRatios))
}

/// How its thresholds were chosen, if by quantile of its own scores.
pub(crate) fn by_quantile(record: &MethodRecord) -> Option<String> {
    let text = |values: Vec<f64>| values.iter().map(f64::to_string).collect::<Vec<_>>().join(" / ");
    let quantiles = record.threshold_quantiles()?;
    let values = configuration(record).map(|config| format!(": {}", text(thresholds(&config)))).unwrap_or_default();
    Some(format!("by quantile {} of its own scores{values}", text(quantiles)))
}

/// Whether thresholds decide which tokens expand, not ratios.
pub(crate) fn has_thresholds(record: &MethodRecord) -> bool {
    configuration(record).is_some_and(|config| !thresholds(&config).is_empty())
}

fn thresholds(config: &ModelConfig) -> Vec<f64> {
    let active = config.decoder.blocks.iter().filter_map(BlockConfig::active_expansion);
    let threshold = |expansion| match expansion {
        BlockExpansion::Threshold(threshold) => Some(threshold),
        BlockExpansion::Ratio(_) => None,
    };
    active.filter_map(threshold).collect()
}

/// The configuration stored in the record, or the built-in one with the recorded name and hash. `None` if there is
/// neither, or if this version cannot read the stored one.
pub(super) fn configuration(record: &MethodRecord) -> Option<ModelConfig> {
    if let Some(stored) = record.configuration() {
        return serde_json::from_value(stored.clone()).ok();
    }
    let config = ModelConfig::named(record.model()?).ok()?;
    let hash = record.model_hash()?;
    (config.hash().ok()? == hash).then_some(config)
}

#[cfg(test)]
mod tests {
    use atsplat_model::config::SelectionRatio;

    use super::*;

    fn record(config: &ModelConfig) -> MethodRecord {
        let mut record = MethodRecord::default();
        record.record_configuration(serde_json::to_value(config).unwrap());
        record
    }

    #[test]
    fn recognises_the_variant_of_a_configuration() {
        let nano = ModelConfig::named("nano").unwrap();
        let mut random = nano.clone();
        random.expansion.selection = Selection::Random { seed: 1 };
        let mut rays = nano.clone();
        rays.anchors.design = AnchorDesign::RayDepth {};
        let mut random_rays = random.clone();
        random_rays.anchors.design = AnchorDesign::RayDepth {};
        let thresholds = nano.clone().with_thresholds(&[0.1, 0.1, 0.4]).unwrap();
        let large = nano.for_high_resolution().unwrap().unwrap();
        let with_ratios = |config: &ModelConfig, ratios: [f64; 3]| {
            config.with_ratios(&ratios.map(|ratio| SelectionRatio::new(ratio).unwrap())).unwrap()
        };
        for (config, expected, is_trained) in [
            (&nano, Variant::Full, false),
            (&random, Variant::Random, true),
            (&rays, Variant::RayDepth, true),
            (&random_rays, Variant::Other, true),
            (&thresholds, Variant::Thresholds(vec![0.1, 0.1, 0.4]), false),
            (&with_ratios(&nano, [0.8, 0.5, 0.25]), Variant::OtherRatios, false),
            (&large, Variant::Full, false),
            (&with_ratios(&large, [0.5, 0.5, 0.25]), Variant::OtherRatios, false),
            (&nano.clone().with_expansion_in_first(0), Variant::NoExpansion, true),
            (&nano.clone().with_expansion_in_first(1), Variant::PartialExpansion, false),
        ] {
            let record = record(config);
            let is_ablation_here = !matches!(expected, Variant::Full | Variant::OtherRatios);
            assert_eq!((is_ablation(&record), is_trained_separately(&record)), (is_ablation_here, is_trained));
            assert_eq!(variant(&record), Some(expected));
        }
    }

    #[test]
    fn a_method_may_state_its_variant() {
        let stated = |name: &str| {
            let mut record = MethodRecord::default();
            record.record_variant(name);
            variant(&record)
        };
        assert_eq!(stated("farthest-point"), Some(Variant::FarthestPoint));
        assert_eq!(stated("unified"), Some(Variant::Other));
    }
}
