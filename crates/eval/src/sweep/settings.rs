use std::collections::BTreeSet;

use atsplat_files::{Malformed, malformed_toml};
use serde::{Deserialize, Serialize};

use super::Overrides;
use crate::EvalError;

/// A list of settings of one method.
///
/// ```toml
/// title = "Thresholds and cut-offs"
/// [[settings]]
/// label = "as trained"
/// [[settings]]
/// label = "thresholds 0.1 / 0.1 / 0.4"
/// overrides = { thresholds = [0.1, 0.1, 0.4] }
/// [[settings]]
/// label = "alpha from 1/64"
/// overrides = { renderer = { min-alpha = 0.015625 } }
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Sweep {
    /// One-line description.
    pub title: String,
    /// In the order of the file; labels are unique.
    pub settings: Vec<Setting>,
}

/// Overrides under a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Setting {
    /// Name in tables, and of the method in the rows.
    pub label: String,
    /// What differs from the base; `knobs` in older files.
    #[serde(default, alias = "knobs")]
    pub overrides: Overrides,
}

impl Sweep {
    /// Parses a sweep from TOML.
    ///
    /// # Errors
    /// [`EvalError::Malformed`] for text that is not a sweep, with line and column, and for a label without text;
    /// [`EvalError::Settings`] for an empty list, for duplicate labels, and for overrides out of range.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let invalid = |expected: &str, found: String| EvalError::Settings {
            what: "settings",
            expected: expected.to_owned(),
            found,
        };
        let sweep: Self = toml::from_str(text).map_err(|error| malformed_toml("sweep", "a sweep", text, &error))?;
        if sweep.settings.is_empty() {
            return Err(invalid("at least one setting", "none".to_owned()));
        }
        if let Some((number, Setting { label, .. })) =
            (1..).zip(&sweep.settings).find(|(_, setting)| setting.label.trim().is_empty())
        {
            // Its row would have no name.
            let place = format!("settings, number {number}");
            return Err(Malformed::new("sweep", place, "a label with text", format!("{label:?}")).into());
        }
        let mut labels = BTreeSet::new();
        if let Some(setting) = sweep.settings.iter().find(|setting| !labels.insert(&setting.label)) {
            return Err(invalid("unique labels", format!("{:?} twice", setting.label)));
        }
        for Setting { label, overrides } in &sweep.settings {
            overrides.check().map_err(|error| error.in_setting(label))?;
        }
        Ok(sweep)
    }
}
