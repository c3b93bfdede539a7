use super::validate::WHAT;
use crate::ModelError;

/// A TOML error with the line and column, counted from 1, that its byte span begins at.
pub(super) fn malformed(text: &str, error: &toml::de::Error) -> ModelError {
    crate::toml_error(WHAT, "a model configuration", text, error)
}
