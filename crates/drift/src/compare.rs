use std::collections::BTreeSet;

use atsplat_numeric::Tolerance;
use atsplat_protocol::Aggregation;
use atsplat_results::statistics::{Paired, SelectedTarget, direction, mean_of, paired_of, scene_differences, score_of};
use atsplat_results::{Results, TargetStatus};

use super::change::Change;
use super::data::compare_images;
use super::inputs::SharedPreset;
use super::moved::causes_of_drift;
use super::provenance::{differences, same_machine};
use super::rows::{Group, Rows, TargetId};
use super::{
    Baseline, BaselineTarget, Basis, Cause, ChangedImage, Comparison, DataComparison, DriftReport, DriftVerdict,
    Finding, FindingKind, Limit, SceneChange, least_limit, metric_bound, scene_limit,
};

/// Compares results with a baseline. The order of rows, times, threads and dates do not matter.
pub fn compare(results: &Results, baseline: &Baseline) -> DriftReport {
    let same_machine = same_machine(&baseline.provenance, &results.provenance);
    let then = Rows::new(baseline.trials.iter().cloned(), baseline.targets.iter().cloned());
    let now = Rows::new(results.trials.iter().map(Into::into), results.targets.iter().map(Into::into));
    let now = now.with_reasons(&results.targets);
    let differences = differences(&baseline.provenance, &results.provenance);
    let presets = SharedPreset::all(&baseline.provenance, &results.provenance, &differences);
    let with_other_images: BTreeSet<&str> =
        presets.iter().filter_map(SharedPreset::name_if_images_may_differ).collect();
    let data = compare_images(results, baseline, &with_other_images);
    let (mut comparisons, mut findings) = (Vec::new(), Vec::new());
    let of_image = |image: &ChangedImage| Change::new(Cause::Data, format!("{}, {image}", image.preset));
    let mut changes: Vec<Change> = data.changed.iter().map(of_image).collect();
    for preset in &presets {
        let (found, changed) = preset.compare(&then, &now);
        findings.extend(found);
        changes.extend(changed);
    }
    findings.extend(data_findings(&data));
    let groups: BTreeSet<&(String, String)> = then.0.keys().chain(now.0.keys()).collect();
    let empty = Group::default();
    for group in groups {
        let [then, now] = [&then, &now].map(|rows| rows.0.get(group).unwrap_or(&empty));
        let (preset, method) = group;
        let deterministic = |provenance: &atsplat_results::Provenance| {
            provenance.method(method).is_some_and(|record| record.deterministic)
        };
        let basis = match deterministic(&baseline.provenance) && deterministic(&results.provenance) {
            true if same_machine => Basis::Exact,
            true => Basis::Bound,
            false => Basis::Interval,
        };
        findings.extend(then.findings(now, preset, method, basis));
        let metrics: BTreeSet<&String> = then.targets.values().flat_map(|row| row.scores.keys()).collect();
        for metric in metrics {
            let matches =
                |limit: &&Limit| limit.preset == *preset && limit.method == *method && limit.metric == *metric;
            let limit = baseline.limits.iter().find(matches);
            comparisons.push(then.comparison(now, (preset, method, metric), basis, limit));
        }
    }
    changes.extend(causes_of_drift(&comparisons, &findings, &differences));
    let verdict = verdict(&comparisons, &findings, then.share_a_target(&now));
    let (changes, attribution, not_attributed) = (Change::merged(changes), None, None);
    DriftReport { verdict, comparisons, findings, data, differences, changes, attribution, not_attributed }
}

/// The worst verdict of all parts; if no target is in both runs, nothing was compared, whatever else differs.
fn verdict(comparisons: &[Comparison], findings: &[Finding], share_a_target: bool) -> DriftVerdict {
    if !share_a_target {
        return DriftVerdict::Nothing;
    }
    let compared = comparisons.iter().any(|comparison| comparison.verdict != DriftVerdict::Nothing);
    let at_least = if compared { DriftVerdict::Same } else { DriftVerdict::Nothing };
    let verdicts = comparisons.iter().map(|comparison| comparison.verdict);
    verdicts.chain(findings.iter().map(|finding| finding.verdict)).fold(at_least, DriftVerdict::max)
}

/// Changed images by preset.
fn data_findings(data: &DataComparison) -> Vec<Finding> {
    let presets = data.changed.chunk_by(|a, b| a.preset == b.preset);
    let finding = |changed: &[ChangedImage]| {
        let first = changed.first()?;
        Some(Finding {
            preset: first.preset.clone(),
            method: String::new(),
            kind: FindingKind::Data,
            verdict: DriftVerdict::Drifted,
            count: changed.len() as u64,
            example: first.to_string(),
        })
    };
    presets.filter_map(finding).collect()
}

impl Group {
    /// The targets with a score in both.
    fn pairs<'a>(&'a self, now: &'a Self, metric: &str) -> Vec<TargetPair<'a>> {
        let score = |row: &BaselineTarget| score_of(row.status, row.scores.get(metric).copied(), metric);
        let pair = |(id, then): (&'a TargetId, &BaselineTarget)| {
            let now = now.targets.get(id)?;
            let identical = [then, now].map(|row| row.status == TargetStatus::Identical);
            Some(TargetPair { id, frame: then.frame, then: score(then)?, now: score(now)?, identical })
        };
        self.targets.iter().filter_map(pair).collect()
    }

    /// The comparison of one metric of a method under a preset, given by their names.
    fn comparison(&self, now: &Self, of: (&str, &str, &str), basis: Basis, known: Option<&Limit>) -> Comparison {
        let (preset, method, metric) = of;
        // As in tables: a PSNR that becomes infinite would move means by the cap that stands for it.
        let (identical, pairs): (Vec<TargetPair>, Vec<TargetPair>) =
            self.pairs(now, metric).into_iter().partition(|pair| pair.identical.contains(&true));
        let then: Vec<SelectedTarget> = pairs.iter().map(|pair| pair.selected(pair.then)).collect();
        let today: Vec<SelectedTarget> = pairs.iter().map(|pair| pair.selected(pair.now)).collect();
        let paired = paired_of(&today, &then, direction(metric), Aggregation::SceneMeans);
        let outside = |bound: Tolerance| pairs.iter().filter(|pair| !bound.accepts(pair.now, pair.then)).count() as u64;
        let (changed, beyond) = (outside(Tolerance::EXACT), outside(metric_bound(metric)));
        let largest = pairs.iter().fold((0.0, None), |(largest, at), pair| {
            let change = (pair.now - pair.then).abs();
            if change > largest { (change, Some(pair)) } else { (largest, at) }
        });
        let limit = known.map_or_else(|| least_limit(metric), |known| known.limit);
        let scene_limit = scene_limit(metric, known, paired.as_ref().map_or(0, |paired| paired.scenes));
        let largest_scene = largest_scene(&today, &then);
        let by_limit = || match (&paired, &largest_scene) {
            (Some(paired), _) if beyond_limit(paired, limit) => DriftVerdict::Drifted,
            (_, Some(largest)) if largest.change.abs() > scene_limit => DriftVerdict::Drifted,
            _ => DriftVerdict::Within,
        };
        let verdict = match basis {
            _ if paired.is_none() && identical.iter().any(|pair| pair.identical == [true; 2]) => DriftVerdict::Same,
            _ if paired.is_none() => DriftVerdict::Nothing,
            _ if changed == 0 => DriftVerdict::Same,
            Basis::Exact => DriftVerdict::Drifted,
            Basis::Bound if beyond == 0 => DriftVerdict::Within,
            Basis::Bound | Basis::Interval => by_limit(),
        };
        let [baseline, now] = [&then, &today].map(|selected| mean_of(selected, Aggregation::SceneMeans));
        Comparison {
            preset: preset.to_owned(),
            method: method.to_owned(),
            metric: metric.to_owned(),
            verdict,
            basis,
            baseline,
            now,
            paired,
            identical: identical.len() as u64,
            changed,
            largest: largest.0,
            largest_at: largest.1.map(|pair| format!("{} {} frame {}", pair.id.0, pair.id.1, pair.frame)),
            largest_scene,
            limit: (basis != Basis::Exact).then_some(limit),
            scene_limit: (basis != Basis::Exact).then_some(scene_limit),
        }
    }
}

/// A target with a score in both runs.
struct TargetPair<'a> {
    id: &'a TargetId,
    frame: u64,
    then: f64,
    now: f64,
    /// Whether the render is identical to the truth, in the baseline and now.
    identical: [bool; 2],
}

impl TargetPair<'_> {
    fn selected(&self, value: f64) -> SelectedTarget<'_> {
        let (scene, entry, target) = self.id;
        SelectedTarget::of_score((scene.as_str(), *entry, *target), value)
    }
}

/// The scene whose mean changed most, the first of equals; `None` if none changed.
fn largest_scene(now: &[SelectedTarget<'_>], then: &[SelectedTarget<'_>]) -> Option<SceneChange> {
    let changes = scene_differences(now, then, Aggregation::SceneMeans).into_iter().rev();
    let (scene, change) = changes.max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))?;
    (change.abs() > 0.0).then(|| SceneChange { scene: scene.to_owned(), change })
}

/// Whether the whole interval of a difference, or with one scene the difference, is beyond its limit.
fn beyond_limit(paired: &Paired, limit: f64) -> bool {
    let [low, high] = paired.interval.unwrap_or([paired.difference; 2]);
    low > limit || high < -limit
}
