use std::fmt;

use super::probe::Attribution;
use super::{Basis, Comparison, DriftReport, Finding, Verdict};

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Same => "same",
            Self::Within => "within",
            Self::Drifted => "DRIFTED",
        })
    }
}

impl fmt::Display for Basis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Exact => "exact",
            Self::Bound => "bound",
            Self::Interval => "interval",
        })
    }
}

impl fmt::Display for DriftReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { verdict, comparisons, findings, differences, attribution, not_attributed } = self;
        writeln!(
            f,
            "{:<24} {:<16} {:<12} {:>10} {:>10} {:>11} {:>25} {:>8} {:<8} verdict",
            "preset", "method", "metric", "baseline", "now", "difference", "95 % interval", "targets", "basis"
        )?;
        for comparison in comparisons {
            line(f, comparison)?;
        }
        if !findings.is_empty() {
            writeln!(f)?;
        }
        for Finding { preset, method, kind, verdict, count, example } in findings {
            let of = if method.is_empty() { preset.clone() } else { format!("{preset}, {method}") };
            writeln!(f, "{verdict:<8} {of}: {}: {count}, as {example}", kind.words())?;
        }
        if !differences.is_empty() {
            writeln!(f, "\nOtherwise than in the baseline:")?;
        }
        for difference in differences {
            let told = |value: &Option<String>| value.as_deref().map_or("nothing".to_owned(), shortened);
            writeln!(f, "  {}: {} was, {} is", difference.what, told(&difference.baseline), told(&difference.now))?;
        }
        if let Some(attribution) = attribution {
            writeln!(f, "\n{attribution}")?;
        }
        if let Some(reason) = not_attributed {
            writeln!(f, "\nNo attribution: {reason}")?;
        }
        writeln!(f, "\nVerdict: {verdict}")
    }
}

fn line(f: &mut fmt::Formatter<'_>, comparison: &Comparison) -> fmt::Result {
    let Comparison { preset, method, metric, verdict, basis, baseline, now, paired, changed, .. } = comparison;
    let number = |value: &Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.4}"));
    let difference = paired.as_ref().map_or("-".to_owned(), |paired| format!("{:+.2e}", paired.difference));
    let interval = paired.as_ref().and_then(|paired| paired.interval);
    let interval = interval.map_or("-".to_owned(), |[low, high]| format!("{low:+.2e} to {high:+.2e}"));
    let targets = paired.as_ref().map_or("-".to_owned(), |paired| format!("{changed}/{}", paired.targets));
    writeln!(
        f,
        "{preset:<24} {method:<16} {metric:<12} {:>10} {:>10} {difference:>11} {interval:>25} {targets:>8} {basis:<8} {verdict}",
        number(baseline),
        number(now),
    )?;
    match (&comparison.largest_at, comparison.limit) {
        (Some(at), limit) if *verdict == Verdict::Drifted => {
            let limit = limit.map_or(String::new(), |limit| format!("; the mean may move by {limit:.2e}"));
            writeln!(f, "    largest change {:.2e} at {at}{limit}", comparison.largest)
        }
        _ => Ok(()),
    }
}

impl fmt::Display for Attribution {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<10} {:<10} {:>15} {:>10}", "stage", "alone", "values differ", "largest")?;
        for metric in &self.metrics {
            write!(f, " {:>12}", metric.metric)?;
        }
        writeln!(f)?;
        for (at, stage) in self.stages.iter().enumerate() {
            let verdict = if stage.changed { "CHANGED" } else { "same" };
            let differ = format!("{}/{}", stage.differing, stage.values);
            write!(f, "{:<10} {verdict:<10} {differ:>15} {:>10.2e}", stage.stage.name(), stage.largest)?;
            for metric in &self.metrics {
                write!(f, " {:>+12.2e}", metric.effects.get(at).copied().unwrap_or(f64::NAN))?;
            }
            writeln!(f)?;
        }
        write!(f, "{:<48}", "probe, then to now")?;
        for metric in &self.metrics {
            write!(f, " {:>+12.2e}", metric.now - metric.baseline)?;
        }
        match self.first() {
            Some(stage) => write!(f, "\nThe first stage that changed is the {}.", stage.name()),
            None => write!(f, "\nNo stage changed on the probe."),
        }
    }
}

/// Long values, as configurations are, by their beginning.
fn shortened(value: &str) -> String {
    const MOST: usize = 48;
    if value.chars().count() <= MOST {
        return value.to_owned();
    }
    value.chars().take(MOST).chain("…".chars()).collect()
}
