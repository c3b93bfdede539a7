use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use super::Knobs;
use crate::EvalError;

/// Settings to run one method at.
///
/// ```toml
/// title = "Thresholds and cut-offs"
/// [[settings]]
/// label = "as trained"
/// [[settings]]
/// label = "thresholds 0.1 / 0.1 / 0.4"
/// knobs = { thresholds = [0.1, 0.1, 0.4] }
/// [[settings]]
/// label = "alpha from 1/64"
/// knobs = { renderer = { min-alpha = 0.015625 } }
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Sweep {
    /// One line for people.
    pub title: String,
    /// In the order of the file; labels differ.
    pub settings: Vec<Setting>,
}

/// Knobs under a name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Setting {
    /// Name in tables, and of the method in the rows.
    pub label: String,
    /// What is changed.
    #[serde(default)]
    pub knobs: Knobs,
}

impl Sweep {
    /// A sweep from TOML text.
    ///
    /// # Errors
    /// [`EvalError::Settings`] for text that is no sweep, with the place; for no setting, and for a label that stands twice.
    pub fn from_toml(text: &str) -> Result<Self, EvalError> {
        let unfit = |expected: &str, found: String| EvalError::Settings {
            what: "settings",
            expected: expected.to_owned(),
            found,
        };
        let sweep: Self = toml::from_str(text).map_err(|error| unfit("a sweep in TOML", error.to_string()))?;
        if sweep.settings.is_empty() {
            return Err(unfit("at least one setting", "none".to_owned()));
        }
        let mut labels = BTreeSet::new();
        match sweep.settings.iter().find(|setting| !labels.insert(&setting.label)) {
            Some(setting) => Err(unfit("labels that differ", format!("{:?} twice", setting.label))),
            None => Ok(sweep),
        }
    }
}
