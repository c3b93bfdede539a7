//! The summary of a run: means over scenes. `atsplat report` makes tables, intervals and plots.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};

use atsplat_metrics::definition;
use atsplat_numeric::format_bytes;
use atsplat_protocol::{DropReason, IndexMatch, Preset};
use serde::Serialize;

use crate::runner::Summary;
use crate::statistics::{Identical, Leaked, MetricQuery, summary};
use crate::timing::{Spread, Times, times};
use crate::{IDENTICAL, MethodRecord, MetricRecord, PresetRecord, Results, TargetRow, TargetStatus, WarningCount};

/// The summary of a results store: means over scenes, times, failures and warnings. [`Display`](fmt::Display) prints it as a
/// table.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RunReport {
    store: PathBuf,
    #[serde(skip_serializing_if = "Option::is_none")]
    summary: Option<Summary>,
    rows: Vec<Row>,
    /// Times of each method under each protocol, from the timing pass.
    times: Vec<MethodTimes>,
    /// Metrics that were not computed, and why.
    not_computed: BTreeMap<String, String>,
    /// Index entries and targets without scores, or without one of them, by reason.
    without: Vec<Unscored>,
    /// Protocols on an index that some papers use under them, with what the preset says about it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    alternative_indices: Vec<AlternativeIndex>,
    /// Warnings about indices and data.
    warnings: Vec<WarningCount>,
    /// A suggestion.
    #[serde(skip_serializing_if = "Option::is_none")]
    advice: Option<String>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct MethodTimes {
    preset: String,
    method: String,
    /// `None` with the reason in `absent`.
    #[serde(flatten)]
    times: Option<Times>,
    #[serde(skip_serializing_if = "Option::is_none")]
    absent: Option<String>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct AlternativeIndex {
    preset: String,
    index: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<String>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Unscored {
    preset: String,
    what: String,
    count: usize,
    example: String,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    preset: String,
    method: String,
    untrained: bool,
    scenes: usize,
    targets: usize,
    failed: usize,
    /// Targets of trials that the method does not support.
    not_applicable: usize,
    non_finite: usize,
    identical: usize,
    /// The protocol's means; renders that are identical to the truth are left out.
    means: BTreeMap<String, f64>,
}

impl RunReport {
    /// Summarises the results in the folder `store`, after a run with this summary if there was one.
    pub fn of(results: &Results, summary: Option<Summary>, store: &Path) -> Self {
        let provenance = &results.provenance;
        let (mut rows, mut of_methods) = (Vec::new(), Vec::new());
        for preset in &provenance.presets {
            for method in &provenance.methods {
                let own: Vec<&TargetRow> = results
                    .targets
                    .iter()
                    .filter(|row| row.key.preset == preset.name && row.key.method == method.name)
                    .collect();
                if !own.is_empty() {
                    rows.push(Row::of(results, preset, method, &own));
                    let found = times(results, &preset.name, &method.name);
                    let (preset, method) = (preset.name.clone(), method.name.clone());
                    let (times, absent) = match found {
                        Ok(times) => (Some(times), None),
                        Err(reason) => (None, Some(reason)),
                    };
                    of_methods.push(MethodTimes { preset, method, times, absent });
                }
            }
        }
        let absent = |metric: &MetricRecord| Some((metric.id.clone(), metric.absent.clone()?));
        let not_computed = provenance.metrics.iter().filter_map(absent).collect();
        let (without, warnings) = (unscored(results), provenance.warnings.clone());
        Self {
            store: store.to_owned(),
            summary,
            rows,
            times: of_methods,
            not_computed,
            without,
            alternative_indices: provenance.presets.iter().filter_map(AlternativeIndex::of).collect(),
            warnings,
            advice: None,
        }
    }

    /// Suggests `--any-size` if images were rejected for their size and the run did not use it, and before that `--images`, if a
    /// copy of the images with this factor has the expected size.
    #[must_use]
    pub fn with_advice(self, takes_any_size: bool, images: Option<u32>) -> Self {
        const ADVICE: &str = "--any-size takes images of any size; the results then belong to another protocol";
        let refused = self.without.iter().any(|unscored| unscored.what.ends_with(DropReason::ImageSize.name()));
        let copy =
            images.map(|factor| format!("--images {factor} takes copies of the images of the expected size, and "));
        let advice = (refused && !takes_any_size).then(|| format!("{}{ADVICE}", copy.unwrap_or_default()));
        Self { advice, ..self }
    }
}

/// Entries and targets without scores, and compared targets that lack a metric, with the first of each kind. Metrics without
/// weights are not among them.
fn unscored(results: &Results) -> Vec<Unscored> {
    let skipped = results.provenance.skipped.iter();
    let skipped = skipped.map(|entry| {
        let example = format!("scene {}: {}", entry.scene, entry.detail);
        let of: Vec<&str> = entry.methods.iter().map(String::as_str).collect();
        let of = if of.is_empty() { String::new() } else { format!(" for {}", of.join(", ")) };
        (&entry.preset, format!("entries skipped{of}, {}", entry.reason), String::new(), example)
    });
    let refused = results.not_applicable().map(|trial| {
        let detail = trial.detail.as_deref().unwrap_or("unknown reason");
        let example = format!("scene {}: {detail}", trial.key.scene);
        let what = format!("trials of {} not applicable", trial.key.method);
        (&trial.key.preset, what, kind_of(detail, &trial.key.scene), example)
    });
    let unsupported = results.unsupported();
    let failed = results.targets.iter().filter(|row| row.status == TargetStatus::Failed);
    let failed = failed.filter(|row| !unsupported.contains(&row.key)).map(|row| {
        let detail = row.detail.as_deref().unwrap_or("unknown reason");
        let example = format!("scene {}, frame {}: {detail}", row.key.scene, row.frame);
        let what = format!("targets of {} failed", row.key.method);
        (&row.key.preset, what, kind_of(detail, &row.key.scene), example)
    });
    let has_weights = |id: &str| results.provenance.metrics.iter().all(|own| own.id != id || own.absent.is_none());
    let compared = results.targets.iter().filter(|row| row.status == TargetStatus::Scored);
    let incomplete = compared.flat_map(|row| row.not_computed.iter().map(move |(id, why)| (row, id, why)));
    let incomplete = incomplete.filter(|(_, id, _)| has_weights(id)).map(|(row, id, why)| {
        let is_infinite = why == IDENTICAL;
        let why = if is_infinite { "infinite: no sample differs after clipping or rounding" } else { why.as_str() };
        let example = format!("scene {}, frame {}: {why}", row.key.scene, row.frame);
        let what = format!("targets of {} not in the mean of {}", row.key.method, name(id));
        (&row.key.preset, what, kind_of(why, &row.key.scene), example)
    });
    let mut kinds: BTreeMap<(&String, String, String), (usize, String)> = BTreeMap::new();
    for (preset, what, kind, example) in skipped.chain(refused).chain(failed).chain(incomplete) {
        kinds.entry((preset, what, kind)).or_insert((0, example)).0 += 1;
    }
    let row = |((preset, what, _), (count, example)): ((&String, String, _), (usize, String))| Unscored {
        preset: preset.clone(),
        what,
        count,
        example,
    };
    kinds.into_iter().map(row).collect()
}

/// The kind of a failure, by which failures are grouped; not shown. It is the text without paths, numbers and the
/// scene's name.
fn kind_of(detail: &str, scene: &str) -> String {
    const LONGEST: usize = 60;
    let words = detail.split_whitespace().take_while(|word| !word.starts_with('('));
    let words = words.map(|word| {
        let bare = word.trim_end_matches([':', ',', ';']);
        if bare == scene {
            return format!("SCENE{}", word.get(bare.len()..).unwrap_or_default());
        }
        let word = if word.contains('/') { "PATH" } else { word };
        let mut kind = String::new();
        for c in word.chars() {
            if !c.is_ascii_digit() {
                kind.push(c);
            } else if !kind.ends_with('N') {
                kind.push('N');
            }
        }
        kind
    });
    let text = words.collect::<Vec<_>>().join(" ");
    let short = text.split_once(": ").map_or(text.as_str(), |(short, _)| short);
    short.chars().take(LONGEST).collect::<String>().trim_end_matches([':', ',', ';']).to_owned()
}

impl AlternativeIndex {
    /// `None` if the protocol was run on its default index, or on an unpublished one.
    fn of(record: &PresetRecord) -> Option<Self> {
        let index = protocol(record).index;
        let own = index.alternative(record.index_name.as_ref()?)?;
        Some(Self { preset: record.name.clone(), index: own.name.clone(), note: own.note.clone() })
    }
}

impl Row {
    fn of(results: &Results, preset: &PresetRecord, method: &MethodRecord, targets: &[&TargetRow]) -> Self {
        let means = results.provenance.metrics.iter().map(|metric| &metric.id);
        let means = means.filter_map(|id| Some((id.clone(), mean(results, preset, &method.name, id)?)));
        let unsupported = results.unsupported();
        let (unsupported, supported): (Vec<&TargetRow>, Vec<&TargetRow>) =
            targets.iter().copied().partition(|row| unsupported.contains(&row.key));
        let count = |status| supported.iter().filter(|row| row.status == status).count();
        let scenes: BTreeSet<&str> = targets.iter().map(|row| row.key.scene.as_str()).collect();
        Self {
            preset: preset.name.clone(),
            method: method.name.clone(),
            untrained: method.untrained,
            scenes: scenes.len(),
            targets: targets.len(),
            failed: count(TargetStatus::Failed),
            not_applicable: unsupported.len(),
            non_finite: count(TargetStatus::NonFinite),
            identical: count(TargetStatus::Identical),
            means: means.collect(),
        }
    }
}

/// The protocol's mean, without renders that are identical to the truth, as in tables and frontiers.
fn mean(results: &Results, preset: &PresetRecord, method: &str, metric: &str) -> Option<f64> {
    let aggregation = protocol(preset).aggregation;
    let (leaked, identical) = (Leaked::Included, Identical::Excluded);
    summary(results, &MetricQuery { preset: &preset.name, method, metric, leaked, identical }, aggregation).mean
}

#[expect(clippy::expect_used, reason = "a store with another preset cannot be read")]
fn protocol(preset: &PresetRecord) -> Preset {
    preset.protocol().expect("a preset that was parsed before")
}

impl fmt::Display for RunReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown: Vec<&String> = Vec::new();
        for id in self.rows.iter().flat_map(|row| row.means.keys()) {
            if !shown.contains(&id) {
                shown.push(id);
            }
        }
        let width = |of: fn(&Row) -> &str| self.rows.iter().map(|row| of(row).chars().count()).max().unwrap_or(0);
        let preset = width(|row| &row.preset).max("protocol".len());
        let method = width(|row| &row.method).max("method".len()) + 2;
        write!(f, "{:<preset$}  {:<method$} {:>7} {:>8}", "protocol", "method", "scenes", "targets")?;
        shown.iter().try_for_each(|id| write!(f, " {:>width$}", name(id), width = name(id).chars().count().max(8)))?;
        writeln!(f)?;
        for row in &self.rows {
            let label = if row.untrained { format!("{} *", row.method) } else { row.method.clone() };
            write!(f, "{:<preset$}  {label:<method$} {:>7} {:>8}", row.preset, row.scenes, row.targets)?;
            for id in &shown {
                let value = row.means.get(*id).map_or_else(|| "-".to_owned(), |mean| format!("{mean:.4}"));
                write!(f, " {value:>width$}", width = name(id).chars().count().max(8))?;
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
        self.write_times(f)?;
        for Unscored { preset, what, count, example } in &self.without {
            writeln!(f, "{preset}: {}: {example}", counted(*count as u64, what))?;
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
    /// The times of the timing pass, or a line with the reason for having none.
    fn write_times(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (timed, absent): (Vec<_>, Vec<_>) = self.times.iter().partition(|row| row.times.is_some());
        for MethodTimes { preset, method, times, .. } in &timed {
            let Some(times) = times else { continue };
            let parts = [("encoding", times.encode), ("rendering", times.render)];
            let parts: Vec<String> = parts
                .iter()
                .filter_map(|(what, spread)| Some(format!("{what} {}", milliseconds(&(*spread)?))))
                .collect();
            let memory =
                times.peak_bytes.map_or_else(String::new, |bytes| format!(", at most {}", format_bytes(bytes)));
            let busy = if times.busy { ", on a busy machine: not reliable" } else { "" };
            let Times { trials, repetitions, .. } = times;
            let device = times.device.as_ref().map_or_else(String::new, |device| format!(", {device}"));
            let parts = parts.join(", ");
            writeln!(f, "{preset}, {method}: {parts}, {repetitions} × {trials} trials{memory}{device}{busy}")?;
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

/// A median and its median absolute deviation.
fn milliseconds(spread: &Spread) -> String {
    format!("{:.2} ms ± {:.2}", 1e3 * spread.median, 1e3 * spread.mad)
}

fn name(id: &str) -> &str {
    definition(id).map_or(id, |metric| metric.name)
}

/// The number of `what`, which begins with a plural: `2 targets of warp failed`, `1 target of warp failed`.
fn counted(count: u64, what: &str) -> String {
    const ONE: [(&str, &str); 8] = [
        ("entries", "entry"),
        ("index entries", "index entry"),
        ("results", "result"),
        ("scenes or frames", "scene or frame"),
        ("scenes", "scene"),
        ("targets", "target"),
        ("trials", "trial"),
        ("were", "was"),
    ];
    let one = ONE.into_iter().filter(|_| count == 1);
    let mut one = one.filter_map(|(many, one)| Some(format!("{one}{}", what.strip_prefix(many)?)));
    format!("{count} {}", one.next().unwrap_or_else(|| what.to_owned()))
}

fn summary_text(summary: &Summary) -> String {
    let Summary {
        evaluated,
        resumed,
        incomplete,
        not_applicable,
        non_finite,
        undrawn,
        skipped,
        not_sampled,
        missing_scenes,
    } = *summary;
    let parts = [
        (resumed, "were there before"),
        (incomplete, "incomplete, each with its reason"),
        (not_applicable, "not applicable, each with its reason"),
        (non_finite, "targets with non-finite samples"),
        (undrawn, "without a Gaussian in any target"),
        (skipped, "index entries skipped, each with its reason"),
        (not_sampled, "scenes or frames of the data not sampled, with a warning for each kind"),
        (missing_scenes, "scenes of the index missing from the data"),
    ];
    let parts = parts.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| counted(count, what));
    let all: Vec<String> = [counted(evaluated, "results computed")].into_iter().chain(parts).collect();
    all.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_counted_agrees_with_its_number() {
        let summary = Summary { evaluated: 1, resumed: 1, non_finite: 2, skipped: 1, ..Summary::default() };
        let expected = "1 result computed; 1 was there before; 2 targets with non-finite samples; 1 index entry skipped, each \
                        with its reason";
        assert_eq!(summary_text(&summary), expected);
        let not_sampled = Summary { not_sampled: 1, ..Summary::default() };
        let expected = "0 results computed; 1 scene or frame of the data not sampled, with a warning for each kind";
        assert_eq!(summary_text(&not_sampled), expected);
        assert_eq!(counted(1, "targets of targets failed"), "1 target of targets failed");
        assert_eq!(counted(1, "without a Gaussian in any target"), "1 without a Gaussian in any target");
    }

    /// Two of three targets are too small for one metric, and one of them is infinite in another.
    #[test]
    fn metrics_that_some_targets_lack_are_listed() {
        let mut results = crate::sample_rows::results("m", "psnr", &[("a", 0, vec![20.0, 30.0]), ("b", 0, vec![40.0])]);
        let absent = Some("no file".to_owned());
        results.provenance.metrics.push(MetricRecord { id: "lpips".to_owned(), absent, ..MetricRecord::default() });
        let small = "not computed: LPIPS (Alex): expected at least 31 pixels a side, found 8×8";
        for row in &mut results.targets[1..] {
            let reasons = [("lpips-alex", small), ("lpips", "weights absent")];
            row.not_computed = reasons.map(|(id, why)| (id.to_owned(), why.to_owned())).into();
        }
        results.targets[2].not_computed.insert("psnr-8bit-rounded".to_owned(), IDENTICAL.to_owned());
        let found = unscored(&results).into_iter().map(|own| (own.count, format!("{}: {}", own.what, own.example)));
        let infinite = "infinite: no sample differs after clipping or rounding";
        let expected = [
            (2, format!("targets of m not in the mean of LPIPS (Alex): scene a, frame 1: {small}")),
            (1, format!("targets of m not in the mean of PSNR (8 bit, rounded): scene b, frame 0: {infinite}")),
        ];
        assert_eq!(found.collect::<Vec<_>>(), expected);
    }

    /// Both protocols accept a second file; only one was run on it.
    #[test]
    fn an_alternative_index_is_named_with_its_note() {
        let record = |name: &str, index: &str| {
            let toml = Preset::named(name).unwrap().to_toml().unwrap();
            PresetRecord { name: name.to_owned(), toml, index_name: Some(index.to_owned()), ..PresetRecord::default() }
        };
        let mut results = Results::default();
        let twelve = record("dl3dv-12v-512x960", "yonosplat-dl3dv-12v");
        results.provenance.presets = vec![record("re10k-to-dl3dv-256", "depthsplat-dl3dv-2v"), twelve];
        let report = RunReport::of(&results, None, Path::new("store"));
        let text = report.to_string();
        let lines: Vec<&str> = text.lines().filter(|line| line.contains("index")).collect();
        let note = "8 random targets a scene, 137 of 1120 leaked; report which file was used";
        let expected =
            "warning: dl3dv-12v-512x960: not the published setting, but an alternative index, yonosplat-dl3dv-12v";
        assert_eq!(lines, [format!("{expected}: {note}")]);
        let json = serde_json::to_value(&report).unwrap();
        let expected =
            serde_json::json!([{"preset": "dl3dv-12v-512x960", "index": "yonosplat-dl3dv-12v", "note": note}]);
        assert_eq!(json["alternative-indices"], expected);
        results.provenance.presets.pop();
        let json = serde_json::to_value(RunReport::of(&results, None, Path::new("store"))).unwrap();
        assert_eq!(json.get("alternative-indices"), None);
    }

    #[test]
    fn failures_of_one_kind_have_the_same_text() {
        let of = |detail: &str| kind_of(detail, "aa11");
        assert_eq!(kind_of("no palace of scene a: gone", "a"), "no palace of scene SCENE");
        let missing = "no file for frame N of scene SCENE";
        assert_eq!(of("no file for frame 12 of scene aa11: expected aa11/000012.png or .exr below out"), missing);
        assert_eq!(of("no file for frame 7 of scene aa11: expected aa11/000007.png or .exr below out"), missing);
        assert_eq!(of("expected an image of 40×40, found 20×20"), "expected an image of N×N, found N×N");
        assert_eq!(of("unexpected end of file (out/aa11/000002.png)"), "unexpected end of file");
    }
}
