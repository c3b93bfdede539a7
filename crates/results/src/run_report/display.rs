//! The report as text.

use std::collections::BTreeMap;
use std::fmt;

use atsplat_numeric::{counted, format_bytes, noun};
use atsplat_protocol::IndexMatch;

use super::unscored::Unscored;
use super::{AlternativeIndex, MethodTimes, Row, RunReport, metric_name};
use crate::RunCounts;
use crate::WarningCount;
use crate::statistics::{LEAKED_EXCLUDED, LEAKED_EXCLUDED_MEANS, outside_bins_in_words};
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
        let lines: Vec<Line<'_>> = self.rows.iter().flat_map(Row::lines).collect();
        let width = |of: fn(&Line<'_>) -> usize, least: usize| lines.iter().map(of).max().unwrap_or(0).max(least);
        let preset = width(|line| line.preset.chars().count(), "protocol".len());
        let method = width(|line| line.method.chars().count(), "method".len()) + 2;
        let scenes = width(|line| line.scenes.len(), SCENES_WIDTH);
        write!(f, "{:<preset$}  {:<method$} {:>scenes$} {:>8}", "protocol", "method", "scenes", "targets")?;
        metrics.iter().try_for_each(|id| write!(f, " {:>width$}", metric_name(id), width = metric_width(id)))?;
        writeln!(f)?;
        for line in &lines {
            let label = if line.untrained { format!("{} *", line.method) } else { line.method.clone() };
            write!(f, "{:<preset$}  {label:<method$} {:>scenes$} {:>8}", line.preset, line.scenes, line.targets)?;
            for id in &metrics {
                let value = line.means.get(*id).map_or_else(|| "-".to_owned(), |mean| format!("{mean:.4}"));
                write!(f, " {value:>width$}", width = metric_width(id))?;
            }
            line.remarks.iter().try_for_each(|remark| write!(f, "  {remark}"))?;
            writeln!(f)?;
        }
        if self.rows.iter().any(|row| row.untrained) {
            writeln!(
                f,
                "* untrained: nothing was learned; the numbers only show that the pipeline works and what it costs"
            )?;
        }
        if self.rows.iter().any(|row| row.without_leaked.is_some()) {
            writeln!(f, "{LEAKED_EXCLUDED}: {LEAKED_EXCLUDED_MEANS}")?;
        }
        Ok(())
    }

    /// The times of the timing pass, or a line with the reason for having none.
    fn write_times(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut machines: Vec<String> = Vec::new();
        let mut reasons: BTreeMap<&String, Vec<&str>> = BTreeMap::new();
        for MethodTimes { preset, method, times, is_process } in &self.times {
            match times {
                Ok(times) => {
                    writeln!(f, "{preset}, {method}: {}", times_text(times, *is_process))?;
                    let measured = if times.machine.is_stated() { "" } else { "timed on " };
                    machines.push(format!("{measured}{}", times.machine));
                }
                Err(reason) => {
                    let methods = reasons.entry(reason).or_default();
                    if !methods.contains(&method.as_str()) {
                        methods.push(method);
                    }
                }
            }
        }
        machines.dedup();
        machines.iter().try_for_each(|machine| writeln!(f, "{machine}"))?;
        reasons.iter().try_for_each(|(reason, methods)| writeln!(f, "no times of {}: {reason}", methods.join(", ")))
    }
}

/// One line of the table.
struct Line<'a> {
    preset: &'a str,
    method: String,
    untrained: bool,
    scenes: String,
    targets: usize,
    means: &'a BTreeMap<String, f64>,
    /// What follows the numbers.
    remarks: Vec<String>,
}

impl Row {
    /// Its line, followed by the same without targets that are context frames if there are any.
    fn lines(&self) -> Vec<Line<'_>> {
        let of_all = Line {
            preset: &self.preset,
            method: self.method.clone(),
            untrained: self.untrained,
            scenes: scenes_in_words(self.scored_scenes, self.scenes),
            targets: self.targets,
            means: &self.means,
            remarks: self.remarks(),
        };
        let of_others = self.without_leaked.as_ref().map(|others| Line {
            preset: &self.preset,
            method: format!("{}, {LEAKED_EXCLUDED}", self.method),
            untrained: self.untrained,
            scenes: scenes_in_words(others.scored_scenes, others.scenes),
            targets: others.targets,
            means: &others.means,
            remarks: Vec::new(),
        });
        [of_all].into_iter().chain(of_others).collect()
    }

    fn remarks(&self) -> Vec<String> {
        let are = if self.leaked == 1 { "is a context frame" } else { "are context frames" };
        let leaked = (self.leaked > 0).then(|| format!("{} {are}", counted(self.leaked as u64, "target")));
        let counts = [
            (self.failed, "failed"),
            (self.not_applicable, "not applicable"),
            (self.non_finite, "with non-finite samples"),
            (self.identical, "identical, not in the means"),
        ];
        let counts = counts.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let outside = (self.outside_bins > 0).then(|| outside_bins_in_words(self.outside_bins));
        leaked.into_iter().chain(counts).chain(outside).collect()
    }
}

/// `8`, or `6 of 8` if some are not in the means.
fn scenes_in_words(scored: usize, scenes: usize) -> String {
    if scored < scenes { format!("{scored} of {scenes}") } else { scenes.to_string() }
}

/// The times of a method; those that were stated are single numbers. The answers of a process include reading and writing of files, and
/// its encoding is as it states it, if it does.
fn times_text(times: &Times, is_process: bool) -> String {
    let Times { trials, repetitions, .. } = times;
    let stated = times.stated_encode().filter(|_| is_process);
    let parts = [
        ("encoding", stated, " (as the method states)"),
        (if is_process { "whole answer" } else { "encoding" }, times.encode, ""),
        ("rendering", times.render, ""),
    ];
    let are_stated = times.machine.is_stated();
    let text = |(what, spread, note): (&str, Option<Spread>, &str)| {
        let Spread { median, mad, .. } = spread?;
        Some(format!("{what} {}{note}", seconds_text(median, (!are_stated).then_some(mad))))
    };
    let parts: Vec<String> = parts.into_iter().filter_map(text).collect();
    if are_stated {
        return format!("{}, as stated", parts.join(", "));
    }
    let memory = times.peak_bytes.map_or_else(String::new, |bytes| format!(", at most {}", format_bytes(bytes)));
    let device = times.device.as_ref().map_or_else(String::new, |device| format!(", {device}"));
    let busy = if times.busy { ", on a busy machine: not reliable" } else { "" };
    let trials = counted(*trials, "trial");
    format!("{}, {repetitions} × {trials}{memory}{device}{busy}", parts.join(", "))
}

/// A median and its median absolute deviation, if there is one, in the median's unit.
fn seconds_text(median: f64, mad: Option<f64>) -> String {
    let (unit, in_second) = match median {
        secs if secs >= 1.0 => ("s", 1.0),
        secs if secs >= 1e-3 => ("ms", 1e3),
        _ => ("µs", 1e6),
    };
    let deviation = mad.map_or_else(String::new, |mad| format!(" ± {:.2}", in_second * mad));
    format!("{:.2} {unit}{deviation}", in_second * median)
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
    use crate::sample_rows::{PRESET, results, timing};
    use crate::times::{TimingRow, times};
    use crate::{MethodRecord, Results, StatedCost, StatedSeconds};

    /// As tables have it, where marks stand for the words.
    #[test]
    fn times_of_a_process_say_what_they_cover() {
        let text = |store: &Results, is_process| times_text(&times(store, PRESET, "a").unwrap(), is_process);
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0])]);
        let stages = [("encode".to_owned(), vec![0.125; 3])].into();
        store.timings = vec![TimingRow { stages, ..timing("a", "x", &[0.25; 3], &[0.5; 3]) }];
        let stated = "encoding 125.00 ms ± 0.00 (as the method states), whole answer 250.00 ms ± 0.00, rendering 500.00 ms ± 0.00, ";
        assert!(text(&store, true).starts_with(stated), "{}", text(&store, true));
        let own = "encoding 250.00 ms ± 0.00, rendering 500.00 ms ± 0.00, ";
        assert!(text(&store, false).starts_with(own), "{}", text(&store, false));
        store.timings[0].stages.clear();
        assert!(text(&store, true).starts_with("whole answer 250.00 ms ± 0.00, rendering "), "{}", text(&store, true));
    }

    #[test]
    fn stated_times_have_neither_a_spread_nor_repetitions() {
        let mut store = results("a", "psnr", &[("x", 0, vec![20.0]), ("y", 0, vec![20.0])]);
        let seconds = Some(StatedSeconds { encode: 0.25, render: Some(0.5), machine: "a card".to_owned() });
        let stated = [(PRESET.to_owned(), StatedCost { gaussians: None, seconds })].into();
        store.provenance.methods = vec![MethodRecord { name: "a".to_owned(), stated, ..MethodRecord::default() }];
        let found = times(&store, PRESET, "a").unwrap();
        assert_eq!(times_text(&found, false), "encoding 250.00 ms, rendering 500.00 ms, as stated");
        store.provenance.methods[0].stated.clear();
        store.timings = vec![timing("a", "x", &[0.25; 3], &[0.5; 3])];
        let found = times(&store, PRESET, "a").unwrap();
        let measured = "encoding 250.00 ms ± 0.00, rendering 500.00 ms ± 0.00, 3 × 1 trial, ";
        assert!(times_text(&found, false).starts_with(measured), "{}", times_text(&found, false));
    }

    #[test]
    fn short_and_long_times_have_their_unit() {
        let text = |median, mad| seconds_text(median, Some(mad));
        assert_eq!(text(17.7e-6, 0.5e-6), "17.70 µs ± 0.50");
        assert_eq!(text(0.001, 0.0), "1.00 ms ± 0.00");
        assert_eq!(text(2.5, 0.25), "2.50 s ± 0.25");
        assert_eq!(seconds_text(2.5, None), "2.50 s");
    }

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
