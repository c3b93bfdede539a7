//! The parameters of a method's record that others read than write: their names are here alone.

use serde_json::Value;

use super::MethodRecord;

/// The whole configuration of a network.
const CONFIGURATION: &str = "configuration";
/// A variant that the configuration does not show.
const VARIANT: &str = "variant";
const THRESHOLD_QUANTILES: &str = "threshold-quantiles";
const PUBLISHED_THRESHOLDS: &str = "published-thresholds";
const SETTING: &str = "setting";
const BACKGROUND: &str = "background";

impl MethodRecord {
    /// The parameter with the name of a network's configuration.
    pub const MODEL: &'static str = "model";
    /// The parameter with the hash of a network's configuration.
    pub const MODEL_HASH: &'static str = "model-hash";
    /// The parameter with the seed of random weights.
    pub const WEIGHTS_SEED: &'static str = "weights-seed";
    /// The parameter with the SHA-256 of the backbone's file that random weights began from.
    pub const BACKBONE_SHA256: &'static str = "backbone-sha256";
    /// What records call constants, or a background, that are the protocol's.
    pub const OF_PRESET: &'static str = "of the preset";

    /// Records the name and hash of its network's configuration.
    pub fn record_model(&mut self, name: &str, hash: &str) {
        self.record(Self::MODEL, name);
        self.record(Self::MODEL_HASH, hash);
    }

    /// The name of its network's configuration.
    pub fn model(&self) -> Option<&str> {
        self.text(Self::MODEL)
    }

    /// The hash of its network's configuration.
    pub fn model_hash(&self) -> Option<&str> {
        self.text(Self::MODEL_HASH)
    }

    /// Records its network's whole configuration.
    pub fn record_configuration(&mut self, configuration: Value) {
        self.record(CONFIGURATION, configuration);
    }

    /// Its network's whole configuration.
    pub fn configuration(&self) -> Option<&Value> {
        self.parameters.get(CONFIGURATION)
    }

    /// Records that its weights are random.
    pub fn record_random_weights(&mut self, seed: u64, backbone_sha256: Option<&str>) {
        self.untrained = true;
        self.record(Self::WEIGHTS_SEED, seed);
        if let Some(hash) = backbone_sha256 {
            self.record(Self::BACKBONE_SHA256, hash);
        }
    }

    /// Records a variant of its network that the configuration does not show.
    pub fn record_variant(&mut self, variant: &str) {
        self.record(VARIANT, variant);
    }

    /// The recorded variant.
    pub fn stated_variant(&self) -> Option<&str> {
        self.text(VARIANT)
    }

    /// Records that its thresholds are these quantiles of its own scores, chosen for published thresholds.
    pub fn record_threshold_quantiles(&mut self, quantiles: &[f64], published: &[f64]) {
        self.record(THRESHOLD_QUANTILES, quantiles);
        self.record(PUBLISHED_THRESHOLDS, published);
    }

    /// The quantiles of its own scores that its thresholds are.
    pub fn threshold_quantiles(&self) -> Option<Vec<f64>> {
        self.numbers(THRESHOLD_QUANTILES)
    }

    /// The published thresholds that its own were chosen for.
    pub fn published_thresholds(&self) -> Option<Vec<f64>> {
        self.numbers(PUBLISHED_THRESHOLDS)
    }

    /// Records the published method under whose setting it runs, or that it names none.
    pub fn record_setting(&mut self, setting: Option<&str>) {
        self.record(SETTING, setting);
    }

    /// The published method under whose setting it runs.
    pub fn setting(&self) -> Option<&str> {
        self.text(SETTING)
    }

    /// Records the background of its renders; without one, it is the protocol's.
    pub fn record_background(&mut self, background: Option<[f64; 3]>) {
        self.record(BACKGROUND, background.map_or_else(|| Self::OF_PRESET.into(), Value::from));
    }

    /// Whether the background of its renders is the protocol's.
    pub fn has_background_of_preset(&self) -> bool {
        self.text(BACKGROUND) == Some(Self::OF_PRESET)
    }

    /// Whether its Gaussians are rendered with the protocol's constants.
    pub fn has_constants_of_preset(&self) -> bool {
        self.constants.as_deref() == Some(Self::OF_PRESET)
    }

    fn record(&mut self, name: &str, value: impl Into<Value>) {
        self.parameters.insert(name.to_owned(), value.into());
    }

    fn text(&self, name: &str) -> Option<&str> {
        self.parameters.get(name)?.as_str()
    }

    fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        self.parameters.get(name)?.as_array()?.iter().map(Value::as_f64).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stores of all versions have these names.
    #[test]
    fn parameters_are_stored_under_their_names_and_read_back() {
        let mut record = MethodRecord::default();
        record.record_model("nano", "1f");
        record.record_configuration(serde_json::json!({ "layers": 2 }));
        record.record_variant("unified");
        record.record_threshold_quantiles(&[0.8, 0.9], &[0.1, 0.4]);
        record.record_setting(Some("iLRM"));
        record.record_background(None);
        record.record_random_weights(7, Some("ab"));
        let expected = serde_json::json!({
            "model": "nano", "model-hash": "1f", "configuration": { "layers": 2 }, "variant": "unified",
            "threshold-quantiles": [0.8, 0.9], "published-thresholds": [0.1, 0.4], "setting": "iLRM",
            "background": "of the preset", "weights-seed": 7, "backbone-sha256": "ab",
        });
        assert_eq!(serde_json::to_value(&record.parameters).unwrap(), expected);
        assert_eq!((record.model(), record.model_hash()), (Some("nano"), Some("1f")));
        assert_eq!(record.configuration(), Some(&expected["configuration"]));
        assert_eq!((record.stated_variant(), record.setting()), (Some("unified"), Some("iLRM")));
        assert_eq!(record.threshold_quantiles(), Some(vec![0.8, 0.9]));
        assert_eq!(record.published_thresholds(), Some(vec![0.1, 0.4]));
        assert!(record.untrained && record.has_background_of_preset() && !record.has_constants_of_preset());
        record.constants = Some("of the preset".to_owned());
        record.record_background(Some([0.0, 0.5, 1.0]));
        record.record_setting(None);
        assert!(record.has_constants_of_preset() && !record.has_background_of_preset());
        assert_eq!(record.parameters["background"], serde_json::json!([0.0, 0.5, 1.0]));
        assert_eq!((record.setting(), &record.parameters["setting"]), (None, &Value::Null));
    }
}
