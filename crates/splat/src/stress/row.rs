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

/// What is compared to measure the error of a renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ErrorKind {
    /// Images, against the reference.
    Image,
    /// Gradients, against the reference.
    Gradient,
    /// Gradients, against finite differences.
    Differences,
}

impl ErrorKind {
    /// Its name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Image => "image",
            Self::Gradient => "gradient",
            Self::Differences => "differences",
        }
    }
}

/// A measured error and its bound.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeasuredError {
    /// What was compared.
    #[serde(rename = "name")]
    pub kind: ErrorKind,
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

    /// The error of a kind.
    pub fn error(&self, kind: ErrorKind) -> Option<&MeasuredError> {
        self.errors.iter().find(|error| error.kind == kind)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_found_by_kind_and_stored_by_name() {
        let kinds = [ErrorKind::Gradient, ErrorKind::Differences];
        let error = |kind| MeasuredError { kind, absolute: 0.5, relative: 0.25, bound: 1e-5, compared: 3 };
        let row = StressRow {
            case: "needles".to_owned(),
            renderer: "cpu".to_owned(),
            errors: kinds.map(error).to_vec(),
            non_finite: 0,
            findings: Vec::new(),
        };
        assert_eq!(row.error(ErrorKind::Differences).map(|error| error.kind), Some(ErrorKind::Differences));
        assert_eq!(row.error(ErrorKind::Image), None);
        let stored = serde_json::to_value(&row).unwrap();
        for (at, kind) in kinds.into_iter().enumerate() {
            assert_eq!(stored["errors"][at]["name"], kind.name());
        }
    }

    #[test]
    fn nan_and_findings_fail() {
        let error =
            |relative| MeasuredError { kind: ErrorKind::Image, absolute: 0.0, relative, bound: 1e-5, compared: 1 };
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
