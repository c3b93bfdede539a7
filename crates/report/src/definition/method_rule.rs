use atsplat_results::{MethodRecord, RecordKind};
use serde::{Deserialize, Serialize};

use super::training::{is_named, is_unified, was_trained_on};
use super::variant::{Variant, configuration, variant};

/// Which methods reproduce a row; all given conditions must hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RuleToml", into = "RuleToml")]
pub struct MethodRule {
    /// The method's [`MethodRecord::kind`].
    pub kind: Option<String>,
    /// The ablation; the full network by default if `gaussians_per_token` is given.
    pub variant: Option<Variant>,
    /// Gaussians per token; the paper's 16 by default if `variant` is given.
    pub gaussians_per_token: Option<usize>,
    /// `true`: only one network that was trained on both datasets; `false`: only other networks; absent: both.
    pub unified: Option<bool>,
    /// Ids of datasets: only networks whose record names none of them among their training data.
    pub not_trained_on: Vec<String>,
}

/// The paper's K.
const GAUSSIANS_PER_TOKEN: usize = 16;

impl MethodRule {
    /// Whether a method satisfies the rule.
    pub fn accepts(&self, record: &MethodRecord) -> bool {
        if self.kind.as_ref().is_some_and(|kind| *kind != record.kind) {
            return false;
        }
        if self.unified.is_some_and(|unified| unified != is_unified(record)) {
            return false;
        }
        if was_trained_on(record, &self.not_trained_on) {
            return false;
        }
        if self.variant.is_none() && self.gaussians_per_token.is_none() {
            return true;
        }
        let expected = self.variant.as_ref().unwrap_or(&Variant::Full);
        let per_token = self.gaussians_per_token.unwrap_or(GAUSSIANS_PER_TOKEN);
        let same_k = configuration(record).is_none_or(|config| config.head.gaussians_per_token == per_token);
        same_k && variant(record).as_ref() == Some(expected)
    }
}

/// A rule in TOML.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
struct RuleToml {
    #[serde(default)]
    kind: Option<String>,
    #[serde(default)]
    variant: Option<Variant>,
    /// Those of [`Variant::Thresholds`].
    #[serde(default)]
    thresholds: Option<Vec<f64>>,
    #[serde(default)]
    gaussians_per_token: Option<usize>,
    #[serde(default)]
    unified: Option<bool>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    not_trained_on: Vec<String>,
}

impl TryFrom<RuleToml> for MethodRule {
    type Error = String;

    fn try_from(rule: RuleToml) -> Result<Self, String> {
        let RuleToml { kind, variant, thresholds, gaussians_per_token, unified, not_trained_on } = rule;
        if let Some(found) = kind.as_deref().filter(|kind| RecordKind::of(kind) == RecordKind::Other) {
            let known: Vec<&str> = RecordKind::names().collect();
            return Err(format!("kind: expected one of {}, found {found:?}", known.join(", ")));
        }
        if let Some(found) = not_trained_on.iter().find(|id| !is_named(id)) {
            return Err(format!("not-trained-on: expected ids of known datasets, such as dl3dv, found {found:?}"));
        }
        let variant = match (variant, thresholds) {
            (Some(_), Some(_)) => return Err("expected one of `variant` and `thresholds`, found both".to_owned()),
            (None, Some(thresholds)) => Some(Variant::Thresholds(thresholds)),
            (variant, None) => variant,
        };
        Ok(Self { kind, variant, gaussians_per_token, unified, not_trained_on })
    }
}

impl From<MethodRule> for RuleToml {
    fn from(rule: MethodRule) -> Self {
        let MethodRule { kind, variant, gaussians_per_token, unified, not_trained_on } = rule;
        let (variant, thresholds) = match variant {
            Some(Variant::Thresholds(thresholds)) => (None, Some(thresholds)),
            variant => (variant, None),
        };
        Self { kind, variant, thresholds, gaussians_per_token, unified, not_trained_on }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_model::ModelConfig;
    use atsplat_model::config::Selection;

    use super::*;
    use crate::definition::by_quantile;

    fn record(config: &ModelConfig) -> MethodRecord {
        let mut record = unknown();
        record.record_configuration(serde_json::to_value(config).unwrap());
        record
    }

    /// A network of which only the kind is known.
    fn unknown() -> MethodRecord {
        MethodRecord { kind: "atsplat".to_owned(), ..MethodRecord::default() }
    }

    fn full() -> MethodRule {
        MethodRule { kind: Some("atsplat".to_owned()), variant: Some(Variant::Full), ..MethodRule::default() }
    }

    #[test]
    fn a_rule_accepts_the_network_that_it_names() {
        let nano = ModelConfig::named("nano").unwrap();
        let mut random = nano.clone();
        random.expansion.selection = Selection::Random { seed: 1 };
        let thresholds = nano.clone().with_thresholds(&[0.1, 0.1, 0.4]).unwrap();
        let rule = MethodRule { variant: Some(Variant::Thresholds(vec![0.1, 0.1, 0.4])), ..full() };
        assert!(rule.accepts(&record(&thresholds)) && !rule.accepts(&record(&nano)));
        assert!(full().accepts(&record(&nano)) && !full().accepts(&record(&random)));
    }

    #[test]
    fn rules_in_toml_name_known_kinds_and_variants_once() {
        let read = |text: &str| toml::from_str::<MethodRule>(text).map_err(|error| error.to_string());
        let rule = read("kind = 'atsplat'\nthresholds = [0.1, 0.4]").unwrap();
        assert_eq!(rule.variant, Some(Variant::Thresholds(vec![0.1, 0.4])));
        assert_eq!(read(&toml::to_string(&rule).unwrap()), Ok(rule));
        let random = read("variant = 'random'").unwrap();
        assert_eq!(read(&toml::to_string(&random).unwrap()), Ok(random));
        for (text, expected) in [
            ("variant = 'ray-dept'", "unknown variant `ray-dept`, expected one of `full`, `ray-depth`, "),
            ("variant = 'other'", "unknown variant `other`"),
            ("kind = 'atsplatt'", "kind: expected one of atsplat, atsplat+refine, 3dgs, "),
            ("variant = 'full'\nthresholds = [0.1, 0.1, 0.4]", "one of `variant` and `thresholds`, found both"),
            (
                "not-trained-on = ['re10k', 'DL3DV']",
                "not-trained-on: expected ids of known datasets, such as dl3dv, found \"DL3DV\"",
            ),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(expected), "{text}: {error}");
        }
    }

    #[test]
    fn thresholds_by_quantile_stand_for_the_published_ones() {
        let config = ModelConfig::named("nano").unwrap().with_thresholds(&[0.3, 0.2, 0.7]).unwrap();
        let mut record = record(&config);
        let rule = |thresholds: [f64; 3]| MethodRule {
            kind: Some("atsplat".to_owned()),
            variant: Some(Variant::Thresholds(thresholds.to_vec())),
            ..MethodRule::default()
        };
        assert!(rule([0.3, 0.2, 0.7]).accepts(&record) && by_quantile(&record).is_none());
        record.record_threshold_quantiles(&[0.8, 0.8, 0.9], &[0.1, 0.1, 0.4]);
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

    /// Whatever else they were trained on, and in whichever of their trainings. What a record does not name is not assumed.
    #[test]
    fn networks_that_have_seen_the_dataset_fill_no_zero_shot_row() {
        let rule: MethodRule = toml::from_str("variant = 'full'\nnot-trained-on = ['dl3dv', 'yards']").unwrap();
        assert_eq!(toml::from_str::<MethodRule>(&toml::to_string(&rule).unwrap()).unwrap(), rule);
        let accepts = |data: &str| {
            let mut record = record(&ModelConfig::named("nano").unwrap());
            record.training = Some(atsplat_results::TrainingRecord { data: data.to_owned(), seed: None });
            rule.accepts(&record)
        };
        let (re10k, dl3dv) = ("1 × data/re10k/train under re10k-2v-256", "1 × data/dl3dv/train under dl3dv-6v-256x448");
        assert!(accepts(re10k) && !accepts(dl3dv));
        assert!(!accepts(&format!("{re10k} + {dl3dv}")), "one network for both");
        assert!(!accepts(&format!("{dl3dv}; before: {re10k}")) && !accepts(&format!("{re10k}; before: {dl3dv}")));
        assert!(!accepts(&format!("my own videos + {dl3dv}")) && !accepts("simulated yards"));
        assert!(accepts("1 × data/re10k/train under dl3dv-6v-256x448"), "the preset's name is no dataset");
        assert!(accepts("my own videos") && rule.accepts(&record(&ModelConfig::named("nano").unwrap())));
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
        let record = |hash: &str| {
            let mut record = unknown();
            record.record_model("nano", hash);
            record
        };
        assert!(full().accepts(&record(&nano.hash().unwrap())));
        assert!(!full().accepts(&record("another")), "a changed configuration is not the full method");
    }

    #[test]
    fn a_stated_variant_and_another_kind_are_no_full_network() {
        let mut record = unknown();
        record.record_variant("unified");
        assert!(!full().accepts(&record));
        assert!(!full().accepts(&MethodRecord { kind: "renders".to_owned(), ..record }));
    }
}
