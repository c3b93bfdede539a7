//! Reports as GitHub Actions shows them: Markdown for the summary of a step, and a workflow command that annotates a file.

use atsplat_files::escaped_markdown;
use atsplat_numeric::counted;

use super::{Comparison, DriftReport, DriftVerdict, Finding};

/// Number of moved numbers, and of other changes, in an annotation.
const MAX_LISTED: usize = 10;

impl DriftReport {
    /// The verdict, what changed, and a table of the numbers that are not the same, as Markdown; ends with a line break.
    pub fn markdown(&self) -> String {
        let conclusion = escaped_markdown(&self.conclusion());
        let mut lines = vec![format!("### Drift: {}", self.verdict), String::new(), conclusion, String::new()];
        let (same, others): (Vec<&Comparison>, Vec<&Comparison>) =
            self.comparisons.iter().partition(|comparison| comparison.verdict == DriftVerdict::Same);
        if !others.is_empty() {
            lines.push(
                "| preset | method | metric | baseline | now | difference | 95 % interval | verdict |".to_owned(),
            );
            lines.push("|---|---|---|---:|---:|---:|---:|---|".to_owned());
            lines.extend(others.into_iter().map(row));
            lines.push(String::new());
        }
        if !same.is_empty() {
            lines.extend([format!("Numbers that are the same: {}.", same.len()), String::new()]);
        }
        let changed = self.findings.iter().filter(|finding| finding.verdict != DriftVerdict::Same);
        let item = |finding: &Finding| format!("- {}: {}", finding.verdict, escaped_markdown(&finding.to_string()));
        let changed: Vec<String> = changed.map(item).collect();
        if !changed.is_empty() {
            lines.extend(changed);
            lines.push(String::new());
        }
        lines.join("\n")
    }

    /// The command `::error file=…::…` with the numbers that moved and what changed, shown next to the baseline's file; `None` if
    /// nothing drifted and something was compared.
    pub fn annotation(&self, baseline: &str) -> Option<String> {
        let title = match self.verdict {
            DriftVerdict::Same | DriftVerdict::Within => return None,
            DriftVerdict::Nothing => "Nothing was compared",
            DriftVerdict::Drifted => "Numbers or their data drifted",
        };
        let moved = |comparison: &&Comparison| comparison.verdict == DriftVerdict::Drifted;
        let is_drift = |finding: &&Finding| finding.verdict == DriftVerdict::Drifted;
        let mut lines = vec![self.conclusion()];
        lines.extend(limited(self.comparisons.iter().filter(moved).map(sentence), "number"));
        lines.extend(limited(self.findings.iter().filter(is_drift).map(ToString::to_string), "change"));
        let (file, message) = (escaped(baseline).replace(':', "%3A").replace(',', "%2C"), escaped(&lines.join("\n")));
        Some(format!("::error file={file},title={title}::{message}"))
    }
}

/// The first of these lines, each about a `what`, and how many more there are.
fn limited(lines: impl Iterator<Item = String>, what: &str) -> Vec<String> {
    let mut lines: Vec<String> = lines.collect();
    let more = lines.len().saturating_sub(MAX_LISTED) as u64;
    lines.truncate(MAX_LISTED);
    lines.extend((more > 0).then(|| format!("and {}", counted(more, &format!("more {what}")))));
    lines
}

fn row(comparison: &Comparison) -> String {
    let Comparison { preset, method, metric, .. } = comparison;
    let [baseline, now, difference, interval] = comparison.numbers();
    let [preset, method] = [preset, method].map(|name| escaped_markdown(name));
    let verdict = comparison.judgement();
    format!("| {preset} | {method} | {metric} | {baseline} | {now} | {difference} | {interval} | {verdict} |")
}

fn sentence(comparison: &Comparison) -> String {
    let Comparison { preset, method, metric, .. } = comparison;
    let [baseline, now, difference, _] = comparison.numbers();
    format!("{metric} of {method} under {preset}: was {baseline}, is now {now} ({difference})")
}

/// With what a workflow command reserves written as GitHub reads it back.
fn escaped(text: &str) -> String {
    text.replace('%', "%25").replace('\r', "%0D").replace('\n', "%0A")
}
