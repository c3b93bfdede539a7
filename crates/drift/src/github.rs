//! Reports as GitHub Actions shows them: Markdown for the summary of a step, and a workflow command that annotates a file.

use super::{Comparison, DriftReport, DriftVerdict, Finding};

/// Number of moved numbers in an annotation.
const MAX_NUMBERS: usize = 10;

impl DriftReport {
    /// The verdict, what changed, and a table of the numbers that are not the same, as Markdown; ends with a line break.
    pub fn markdown(&self) -> String {
        let mut lines = vec![format!("### Drift: {}", self.verdict), String::new(), self.conclusion(), String::new()];
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
        let changed: Vec<String> = changed.map(|finding| format!("- {}: {finding}", finding.verdict)).collect();
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
        let numbers: Vec<String> = self.comparisons.iter().filter(moved).map(sentence).collect();
        let more = numbers.len().checked_sub(MAX_NUMBERS).filter(|more| *more > 0);
        let is_drift = |finding: &&Finding| finding.verdict == DriftVerdict::Drifted;
        let findings = self.findings.iter().filter(is_drift).map(ToString::to_string);
        let lines: Vec<String> = std::iter::once(self.conclusion())
            .chain(numbers.into_iter().take(MAX_NUMBERS))
            .chain(more.map(|more| format!("and {more} more numbers")))
            .chain(findings)
            .collect();
        let (file, message) = (escaped(baseline).replace(':', "%3A").replace(',', "%2C"), escaped(&lines.join("\n")));
        Some(format!("::error file={file},title={title}::{message}"))
    }
}

fn row(comparison: &Comparison) -> String {
    let Comparison { preset, method, metric, .. } = comparison;
    let [baseline, now, difference, interval] = comparison.numbers();
    let [preset, method] = [preset, method].map(|name| name.replace('|', "\\|"));
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
