use std::fmt;

use serde::Serialize;

use super::{ErrorKind, MeasuredError, StressRow};

/// Errors of all cases and renderers. [`Display`](fmt::Display) prints them as a table and lists the failures.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct StressReport {
    /// Number of failed rows.
    pub failed: usize,
    /// A row per case and renderer.
    pub rows: Vec<StressRow>,
}

impl StressReport {
    /// Counts the failures.
    pub fn of(rows: Vec<StressRow>) -> Self {
        Self { failed: rows.iter().filter(|row| !row.passes()).count(), rows }
    }
}

impl fmt::Display for StressReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<24} {:<16} {:>8} {:>8} {:>9} {:>11} {:>10}  verdict",
            "case", "renderer", "absolute", "relative", "gradient", "differences", "not finite"
        )?;
        let mut before = "";
        for row in &self.rows {
            let case = if row.case == before { "" } else { &row.case };
            before = &row.case;
            let cell = |kind: ErrorKind, share: fn(&MeasuredError) -> f64| {
                let Some(error) = row.error(kind).filter(|error| error.compared > 0) else { return "-".to_owned() };
                scientific(share(error)) + if error.bound.is_finite() { "" } else { "*" }
            };
            writeln!(
                f,
                "{case:<24} {:<16} {:>8} {:>8} {:>9} {:>11} {:>10}  {}",
                row.renderer,
                cell(ErrorKind::Image, |error| error.absolute),
                cell(ErrorKind::Image, |error| error.relative),
                cell(ErrorKind::Gradient, |error| error.relative),
                cell(ErrorKind::Differences, |error| error.relative),
                row.non_finite,
                if row.passes() { "ok" } else { "FAILED" },
            )?;
        }
        writeln!(f)?;
        for row in self.rows.iter().filter(|row| !row.passes()) {
            for error in row.errors.iter().filter(|error| !error.passes()) {
                let MeasuredError { kind, relative, bound, .. } = error;
                writeln!(
                    f,
                    "{}, {}: {} {}, at most {}",
                    row.case,
                    row.renderer,
                    kind.name(),
                    scientific(*relative),
                    scientific(*bound)
                )?;
            }
            for finding in &row.findings {
                writeln!(f, "{}, {}: {finding}", row.case, row.renderer)?;
            }
        }
        writeln!(
            f,
            "{} of {} rows failed. Errors are against the reference in f64: of samples relative to the largest magnitude \
             in their image, or to 1 if that is larger; of gradients relative to the largest in their field or, for \
             log-scales, logits, SH coefficients and scalars, to a thousandth of the largest in these fields if that is \
             larger.",
            self.failed,
            self.rows.len()
        )?;
        if self.rows.iter().flat_map(|row| &row.errors).any(|error| !error.bound.is_finite()) {
            writeln!(f, "* has no bound: this needs geometry in f64; of this renderer it must only be finite.")?;
        }
        Ok(())
    }
}

fn scientific(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.1e}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_are_listed_at_the_end() {
        let error =
            |kind, relative| MeasuredError { kind, absolute: 2.0 * relative, relative, bound: 1e-5, compared: 9 };
        let row = |renderer: &str, relative, findings: &[&str]| StressRow {
            case: "needles".to_owned(),
            renderer: renderer.to_owned(),
            errors: vec![error(ErrorKind::Image, relative), error(ErrorKind::Gradient, 0.0)],
            non_finite: 0,
            findings: findings.iter().map(ToString::to_string).collect(),
        };
        let rows =
            vec![row("reference", 1e-8, &[]), row("cpu, avx2", f64::NAN, &[]), row("gpu", 1e-4, &["counts: off"])];
        let report = StressReport::of(rows);
        assert_eq!(report.failed, 2);
        let text = report.to_string();
        let lines: Vec<&str> = text.lines().collect();
        assert!(
            lines[1].starts_with("needles                  reference          2.0e-8   1.0e-8         0"),
            "{text}"
        );
        assert!(lines[1].ends_with("ok") && lines[2].ends_with("FAILED") && lines[3].ends_with("FAILED"), "{text}");
        assert!(!text.contains('*'), "{text}");
        assert_eq!(lines[5], "needles, cpu, avx2: image NaN, at most 1.0e-5");
        assert_eq!(lines[7], "needles, gpu: counts: off");
    }

    #[test]
    fn an_error_without_a_bound_is_marked() {
        let error = MeasuredError {
            kind: ErrorKind::Gradient,
            absolute: 3.0,
            relative: 3.0,
            bound: f64::INFINITY,
            compared: 9,
        };
        let row = StressRow {
            case: "needles".to_owned(),
            renderer: "gpu".to_owned(),
            errors: vec![error],
            non_finite: 0,
            findings: vec![],
        };
        let text = StressReport::of(vec![row]).to_string();
        assert!(text.contains("3.0e0*") && text.contains("* has no bound"), "{text}");
    }
}
