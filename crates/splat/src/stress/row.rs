use serde::Serialize;

/// What one implementation made of one hard case: a row of the table that `atsplat stress` prints, whichever crate it
/// comes from.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct StressRow {
    /// Name of the hard case.
    pub case: String,
    /// Name of the implementation.
    pub path: String,
    /// Errors, in an order that a case's rows share.
    pub errors: Vec<MeasuredError>,
    /// Values that are NaN or infinite and should not be.
    pub non_finite: u64,
    /// What else is wrong, in words; nothing where all is well.
    pub findings: Vec<String>,
}

/// An error and what it may be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeasuredError {
    /// As `image` or `gradient`.
    pub name: &'static str,
    /// Largest difference; NaN where one of the values was.
    pub absolute: f64,
    /// As a share of the size of what is compared.
    pub relative: f64,
    /// Largest `relative` that passes.
    pub bound: f64,
    /// Values that were compared.
    pub compared: u64,
}

impl MeasuredError {
    /// Whether it is within its bound; never where it is NaN.
    pub fn passes(&self) -> bool {
        self.relative <= self.bound
    }
}

impl StressRow {
    /// Whether every error is within its bound and nothing else is wrong.
    pub fn passes(&self) -> bool {
        self.non_finite == 0 && self.findings.is_empty() && self.errors.iter().all(MeasuredError::passes)
    }

    /// An error by its name.
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
            path: "cpu".to_owned(),
            errors: vec![error(relative)],
            non_finite,
            findings: findings.iter().map(ToString::to_string).collect(),
        };
        assert!(row(1e-6, 0, &[]).passes());
        for broken in [row(f64::NAN, 0, &[]), row(1e-4, 0, &[]), row(0.0, 1, &[]), row(0.0, 0, &["census"])] {
            assert!(!broken.passes(), "{broken:?}");
        }
    }
}
