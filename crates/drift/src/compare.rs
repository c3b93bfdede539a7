use std::collections::{BTreeMap, BTreeSet};

use atsplat_numeric::Tolerance;
use atsplat_protocol::Aggregation;
use atsplat_results::statistics::{
    Paired, SelectedTarget, direction, paired_of, scene_differences, score_of, summary_of,
};
use atsplat_results::{Results, TargetStatus, TrialKey, TrialStatus};

use super::data::compare_images;
use super::provenance::{differences, same_machine};
use super::{
    Baseline, BaselineTarget, BaselineTrial, Basis, Comparison, DataComparison, DriftReport, DriftVerdict, Finding,
    FindingKind, Limit, SceneChange, least_limit, metric_bound, scene_limit,
};

/// Compares results with a baseline. The order of rows, times, threads and dates do not matter.
pub fn compare(results: &Results, baseline: &Baseline) -> DriftReport {
    let same_machine = same_machine(&baseline.provenance, &results.provenance);
    let then = Rows::new(baseline.trials.iter().cloned(), baseline.targets.iter().cloned());
    let now = Rows::new(results.trials.iter().map(Into::into), results.targets.iter().map(Into::into));
    let data = compare_images(results, baseline);
    let (mut comparisons, mut findings) = (Vec::new(), protocol_findings(results, baseline));
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
    let compared = comparisons.iter().any(|comparison: &Comparison| comparison.verdict != DriftVerdict::Nothing);
    let at_least = if compared { DriftVerdict::Same } else { DriftVerdict::Nothing };
    let verdicts = comparisons.iter().map(|c| c.verdict).chain(findings.iter().map(|finding| finding.verdict));
    let verdict = verdicts.fold(at_least, DriftVerdict::max);
    let differences = differences(&baseline.provenance, &results.provenance);
    DriftReport { verdict, comparisons, findings, data, differences, attribution: None, not_attributed: None }
}

/// Changed images by preset.
fn data_findings(data: &DataComparison) -> Vec<Finding> {
    let presets = data.changed.chunk_by(|a, b| a.preset == b.preset);
    let finding = |changed: &[super::ChangedImage]| {
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

/// Presets whose hash or index hash differs.
fn protocol_findings(results: &Results, baseline: &Baseline) -> Vec<Finding> {
    let finding = |then: &atsplat_results::PresetRecord| {
        let now = results.provenance.preset(&then.name)?;
        let hashes = [(&then.hash, &now.hash), (&then.index_sha256, &now.index_sha256)];
        let (before, after) = hashes.into_iter().find(|(then, now)| then != now)?;
        Some(Finding {
            preset: then.name.clone(),
            method: String::new(),
            kind: FindingKind::Protocol,
            verdict: DriftVerdict::Drifted,
            count: 1,
            example: format!("was {before}, is now {after}"),
        })
    };
    baseline.provenance.presets.iter().filter_map(finding).collect()
}

/// Rows by preset and method.
struct Rows(BTreeMap<(String, String), Group>);

/// Rows of one method under one preset.
#[derive(Default)]
struct Group {
    trials: BTreeMap<(String, u32), BaselineTrial>,
    targets: BTreeMap<(String, u32, u32), BaselineTarget>,
}

impl Rows {
    fn new(trials: impl Iterator<Item = BaselineTrial>, targets: impl Iterator<Item = BaselineTarget>) -> Self {
        let mut rows: BTreeMap<(String, String), Group> = BTreeMap::new();
        let group = |key: &TrialKey| (key.preset.clone(), key.method.clone());
        for trial in trials {
            let id = (trial.key.scene.clone(), trial.key.entry);
            rows.entry(group(&trial.key)).or_default().trials.insert(id, trial);
        }
        for target in targets {
            let id = (target.key.scene.clone(), target.key.entry, target.target);
            rows.entry(group(&target.key)).or_default().targets.insert(id, target);
        }
        Self(rows)
    }
}

/// Number and first example of each kind of change.
type Changes = BTreeMap<FindingKind, (u64, String)>;

impl Group {
    fn findings(&self, now: &Self, preset: &str, method: &str, basis: Basis) -> Vec<Finding> {
        let mut changes = Changes::new();
        let mut add = |kind, example: &dyn Fn() -> String| {
            changes.entry(kind).or_insert_with(|| (0, example())).0 += 1;
        };
        for (id, then) in &self.trials {
            let Some(now) = now.trials.get(id) else { continue };
            if then.trial_hash != now.trial_hash {
                add(FindingKind::Trial, &|| format!("{} {}", id.0, id.1));
            }
            if (then.final_tokens, then.gaussians) != (now.final_tokens, now.gaussians) {
                let counts = |trial: &BaselineTrial| trial.gaussians.map_or("none".to_owned(), |n| n.to_string());
                add(FindingKind::Count, &|| format!("{} {}: was {}, is now {}", id.0, id.1, counts(then), counts(now)));
            }
        }
        for (id, then) in &self.targets {
            let location = || format!("{} {} frame {}", id.0, id.1, then.frame);
            let Some(row) = now.targets.get(id) else {
                add(FindingKind::Missing, &location);
                continue;
            };
            let (was, is) = (self.status_of(then), now.status_of(row));
            if was != is {
                add(FindingKind::Status, &|| format!("{}: was {was}, is now {is}", location()));
            }
            let groupings = then.grouping.as_ref().zip(row.grouping.as_ref());
            if let Some(change) = groupings.and_then(|(then, now)| then.change(now)) {
                add(FindingKind::Grouping, &|| format!("{}: {change}", location()));
            }
            if then.render_hash.is_some() && then.render_hash != row.render_hash {
                add(FindingKind::Render, &location);
            }
            if let Some(id) = then.scores.keys().find(|id| !row.scores.contains_key(*id)) {
                add(FindingKind::Score, &|| format!("{}: {id}", location()));
            }
            if let Some(id) = row.scores.keys().find(|id| !then.scores.contains_key(*id)) {
                add(FindingKind::NewScore, &|| format!("{}: {id}", location()));
            }
        }
        for (id, row) in now.targets.iter().filter(|(id, _)| !self.targets.contains_key(*id)) {
            add(FindingKind::New, &|| format!("{} {} frame {}", id.0, id.1, row.frame));
        }
        let finding = |(kind, (count, example))| {
            let verdict = match kind {
                FindingKind::New | FindingKind::NewScore => DriftVerdict::Within,
                // Bits and counts are only guaranteed for deterministic methods on the same machine type.
                FindingKind::Render | FindingKind::Count if basis != Basis::Exact => DriftVerdict::Within,
                _ => DriftVerdict::Drifted,
            };
            Finding { preset: preset.to_owned(), method: method.to_owned(), kind, verdict, count, example }
        };
        changes.into_iter().map(finding).collect()
    }

    /// The name of a target's status, which says whether the method supports the trial at all.
    fn status_of(&self, row: &BaselineTarget) -> &'static str {
        let trial = self.trials.get(&(row.key.scene.clone(), row.key.entry));
        let is_unsupported = trial.is_some_and(|trial| trial.status == TrialStatus::NotApplicable);
        if is_unsupported && row.status == TargetStatus::Failed {
            TrialStatus::NotApplicable.name()
        } else {
            row.status.name()
        }
    }

    /// The targets with a score in both.
    fn pairs<'a>(&'a self, now: &'a Self, metric: &str) -> Vec<TargetPair<'a>> {
        let score = |row: &BaselineTarget| score_of(row.status, row.scores.get(metric).copied(), metric);
        let pair = |(id, then): (&'a (String, u32, u32), &BaselineTarget)| {
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
        let paired = paired_of(&today, &then, direction(metric));
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
        let [baseline, now] = [&then, &today].map(|selected| summary_of(selected, Aggregation::SceneMeans).mean);
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
    id: &'a (String, u32, u32),
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
    let changes = scene_differences(now, then).into_iter().rev();
    let (scene, change) = changes.max_by(|(_, a), (_, b)| a.abs().total_cmp(&b.abs()))?;
    (change.abs() > 0.0).then(|| SceneChange { scene: scene.to_owned(), change })
}

/// Whether the whole interval of a difference, or with one scene the difference, is beyond its limit.
fn beyond_limit(paired: &Paired, limit: f64) -> bool {
    let [low, high] = paired.interval.unwrap_or([paired.difference; 2]);
    low > limit || high < -limit
}
