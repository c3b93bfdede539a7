use serde::Serialize;

/// Result of one renderer on one hard case: a row of the table of `atsplat stress`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct StressRow {
    /// Name of the hard case.
    pub case: String,
    /// Name of the renderer.
    pub renderer: String,
    /// Errors, in the same order in every row of a case.
    pub errors: Vec<MeasuredError>,
    /// Number of unexpected NaN or infinite values.
    pub non_finite: u64,
    /// Descriptions of other problems.
    pub findings: Vec<String>,
}

/// A measured error and its bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeasuredError {
    /// Such as `image` or `gradient`.
    pub name: &'static str,
    /// Largest difference; NaN if one of the values is NaN.
    pub absolute: f64,
    /// The same, relative to the size of the compared values.
    pub relative: f64,
    /// Largest passing `relative`.
    pub bound: f64,
    /// Number of compared values.
    pub compared: u64,
}

impl MeasuredError {
    /// Whether it is within its bound; false for NaN.
    pub fn passes(&self) -> bool {
        self.relative <= self.bound
    }
}

impl StressRow {
    /// Whether every error is within its bound and there are no other problems.
    pub fn passes(&self) -> bool {
        self.non_finite == 0 && self.findings.is_empty() && self.errors.iter().all(MeasuredError::passes)
    }

    /// The error of a given name.
    pub fn error(&self, name: &str) -> Option<&MeasuredError> {
        self.errors.iter().find(|error| error.name == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nan_and_findings_fail() {
        let error = |relative| MeasuredError { name: "image", absolute: 0.0, relative, bound: 1e-5, compared: 1 };
        let row = |relative, non_finite, findings: &[&str]| StressRow {
            case: "needles".to_owned(),
            renderer: "cpu".to_owned(),
            errors: vec![error(relative)],
            non_finite,
            findings: findings.iter().map(ToString::to_string).collect(),
        };
        assert!(row(1e-6, 0, &[]).passes());
        for failing in [row(f64::NAN, 0, &[]), row(1e-4, 0, &[]), row(0.0, 1, &[]), row(0.0, 0, &["counts"])] {
            assert!(!failing.passes(), "{failing:?}");
        }
    }
}
