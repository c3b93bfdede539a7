//! The report as text.

use std::collections::BTreeMap;
use std::fmt;

use atsplat_numeric::{counted, format_bytes, noun};
use atsplat_protocol::IndexMatch;

use super::unscored::Unscored;
use super::{AlternativeIndex, MethodTimes, Row, RunReport, metric_name};
use crate::RunCounts;
use crate::WarningCount;
use crate::times::{Spread, Times};

/// Least width of a metric's column.
const METRIC_WIDTH: usize = 8;
/// Least width of the numbers of scenes.
const SCENES_WIDTH: usize = 7;

impl fmt::Display for RunReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_table(f)?;
        self.write_times(f)?;
        for Unscored { preset, text, example, .. } in &self.without {
            writeln!(f, "{preset}: {text}: {example}")?;
        }
        self.advice.iter().try_for_each(|advice| writeln!(f, "{advice}"))?;
        for AlternativeIndex { preset, index, note } in &self.alternative_indices {
            let index = IndexMatch::Alternative { name: index, note: note.as_deref() };
            writeln!(f, "warning: {preset}: not the published setting, but {index}")?;
        }
        for WarningCount { preset, kind, count, example } in &self.warnings {
            writeln!(f, "warning: {preset}: {count} {kind}: {example}")?;
        }
        for (id, why) in &self.not_computed {
            writeln!(f, "{id} was not computed: {why}")?;
        }
        if let Some(summary) = &self.summary {
            writeln!(f, "\n{}", summary_text(summary))?;
        }
        writeln!(f, "{}", self.store.display())
    }
}

impl RunReport {
    /// One line for each method under each protocol, with a column for each metric.
    fn write_table(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut metrics: Vec<&String> = Vec::new();
        for id in self.rows.iter().flat_map(|row| row.means.keys()) {
            if !metrics.contains(&id) {
                metrics.push(id);
            }
        }
        let metric_width = |id: &str| metric_name(id).chars().count().max(METRIC_WIDTH);
        let width = |of: fn(&Row) -> &str| self.rows.iter().map(|row| of(row).chars().count()).max().unwrap_or(0);
        let preset = width(|row| &row.preset).max("protocol".len());
        let method = width(|row| &row.method).max("method".len()) + 2;
        let scenes = self.rows.iter().map(|row| row.scenes_in_words().len()).max().unwrap_or(0).max(SCENES_WIDTH);
        write!(f, "{:<preset$}  {:<method$} {:>scenes$} {:>8}", "protocol", "method", "scenes", "targets")?;
        metrics.iter().try_for_each(|id| write!(f, " {:>width$}", metric_name(id), width = metric_width(id)))?;
        writeln!(f)?;
        for row in &self.rows {
            let label = if row.untrained { format!("{} *", row.method) } else { row.method.clone() };
            let of_scenes = row.scenes_in_words();
            write!(f, "{:<preset$}  {label:<method$} {of_scenes:>scenes$} {:>8}", row.preset, row.targets)?;
            for id in &metrics {
                let value = row.means.get(*id).map_or_else(|| "-".to_owned(), |mean| format!("{mean:.4}"));
                write!(f, " {value:>width$}", width = metric_width(id))?;
            }
            for (count, what) in [
                (row.failed, "failed"),
                (row.not_applicable, "not applicable"),
                (row.non_finite, "with non-finite samples"),
                (row.identical, "identical, not in the means"),
            ] {
                if count > 0 {
                    write!(f, "  {count} {what}")?;
                }
            }
            writeln!(f)?;
        }
        if self.rows.iter().any(|row| row.untrained) {
            writeln!(
                f,
                "* untrained: nothing was learned; the numbers only show that the pipeline works and what it costs"
            )?;
        }
        Ok(())
    }

    /// The times of the timing pass, or a line with the reason for having none.
    fn write_times(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (timed, absent): (Vec<_>, Vec<_>) = self.times.iter().partition(|row| row.times.is_some());
        for MethodTimes { preset, method, times, .. } in &timed {
            let Some(times) = times else { continue };
            writeln!(f, "{preset}, {method}: {}", times_text(times))?;
        }
        let mut machines: Vec<String> =
            timed.iter().filter_map(|row| Some(format!("timed on {}", row.times.as_ref()?.machine))).collect();
        machines.dedup();
        machines.iter().try_for_each(|machine| writeln!(f, "{machine}"))?;
        let mut reasons: BTreeMap<&String, Vec<&str>> = BTreeMap::new();
        for row in absent {
            let methods = reasons.entry(row.absent.as_ref().unwrap_or(&row.method)).or_default();
            if !methods.contains(&row.method.as_str()) {
                methods.push(&row.method);
            }
        }
        reasons.iter().try_for_each(|(reason, methods)| writeln!(f, "no times of {}: {reason}", methods.join(", ")))
    }
}

impl Row {
    /// `8`, or `6 of 8` if some are not in the means.
    fn scenes_in_words(&self) -> String {
        let Self { scenes, scored_scenes, .. } = self;
        if scored_scenes < scenes { format!("{scored_scenes} of {scenes}") } else { scenes.to_string() }
    }
}

fn times_text(times: &Times) -> String {
    let Times { trials, repetitions, .. } = times;
    let parts = [("encoding", times.encode), ("rendering", times.render)];
    let parts: Vec<String> =
        parts.iter().filter_map(|(what, spread)| Some(format!("{what} {}", milliseconds(&(*spread)?)))).collect();
    let memory = times.peak_bytes.map_or_else(String::new, |bytes| format!(", at most {}", format_bytes(bytes)));
    let device = times.device.as_ref().map_or_else(String::new, |device| format!(", {device}"));
    let busy = if times.busy { ", on a busy machine: not reliable" } else { "" };
    format!("{}, {repetitions} × {trials} trials{memory}{device}{busy}", parts.join(", "))
}

/// A median and its median absolute deviation.
fn milliseconds(spread: &Spread) -> String {
    format!("{:.2} ms ± {:.2}", 1e3 * spread.median, 1e3 * spread.mad)
}

fn summary_text(summary: &RunCounts) -> String {
    let RunCounts {
        evaluated,
        resumed,
        incomplete,
        not_applicable,
        non_finite,
        empty_renders,
        skipped,
        not_sampled,
        missing_scenes,
    } = *summary;
    let were = if resumed == 1 { "was" } else { "were" };
    let scenes_or_frames = ["scene", "frame"].map(|what| noun(not_sampled, what)).join(" or ");
    let parts = [
        (resumed, format!("{resumed} {were} there before")),
        (incomplete, format!("{incomplete} incomplete, each with its reason")),
        (not_applicable, format!("{not_applicable} not applicable, each with its reason")),
        (non_finite, format!("{} with non-finite samples", counted(non_finite, "target"))),
        (empty_renders, format!("{empty_renders} without a Gaussian in any target")),
        (skipped, format!("{} skipped, each with its reason", counted(skipped, "index entry"))),
        (
            not_sampled,
            format!("{not_sampled} {scenes_or_frames} of the data not sampled, with a warning for each kind"),
        ),
        (missing_scenes, format!("{} of the index missing from the data", counted(missing_scenes, "scene"))),
    ];
    let computed = format!("{} computed", counted(evaluated, "result"));
    let others = parts.into_iter().filter(|(count, _)| *count > 0).map(|(_, text)| text);
    [computed].into_iter().chain(others).collect::<Vec<_>>().join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_counted_agrees_with_its_number() {
        let summary =
            RunCounts { evaluated: 1, resumed: 1, non_finite: 2, empty_renders: 1, skipped: 1, ..RunCounts::default() };
        let expected = "1 result computed; 1 was there before; 2 targets with non-finite samples; 1 without a Gaussian in any \
                        target; 1 index entry skipped, each with its reason";
        assert_eq!(summary_text(&summary), expected);
        let not_sampled = RunCounts { not_sampled: 1, ..RunCounts::default() };
        let expected = "0 results computed; 1 scene or frame of the data not sampled, with a warning for each kind";
        assert_eq!(summary_text(&not_sampled), expected);
    }
}
