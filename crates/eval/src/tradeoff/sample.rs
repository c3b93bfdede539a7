use std::collections::{BTreeMap, BTreeSet};

use atsplat_metrics::definition;
use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::unscored::why_unscored;
use super::{Axis, Counts, Frontier, Sample, frontier};
use crate::statistics::{
    Identical, Leaked, MetricQuery, SelectedTarget, contrast, cost, direction, select, summary_of,
};
use crate::timing::{Machine, machine_of, times_on};
use crate::{EvalError, MethodRecord, PresetRecord, Results, TargetRow, TrialKey};

/// Both frontiers of one metric under one protocol.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Tradeoff {
    /// Name of the preset in the rows.
    pub preset: String,
    /// Hash of the protocol, in hexadecimal.
    pub protocol: String,
    /// Id of the metric.
    pub metric: String,
    /// The metric's unit; empty for plain numbers.
    pub unit: String,
    /// Targets, whatever the number of methods.
    pub targets: u64,
    /// Those among them that methods were given as context; 0 if they are left out.
    pub leaked: u64,
    /// Against seconds, and against Gaussians.
    pub frontiers: Vec<Frontier>,
    /// The machine types that were timed.
    pub machines: Vec<Machine>,
    /// What ran on a graphics adapter, as [`crate::timing::Times::device`], with the labels of its samples.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub devices: BTreeMap<String, Vec<String>>,
    /// Settings whose mean lacks targets for which another setting has a score: their qualities are of other targets.
    pub incomplete: Vec<Incomplete>,
    /// Labels of settings without any score, with the reason; they are in no frontier.
    pub unscored: Vec<(String, String)>,
}

impl Tradeoff {
    /// Whether any setting has a score.
    pub(super) fn has_score(&self) -> bool {
        let settings = |frontier: &Frontier| frontier.points.len() + frontier.left_out.len();
        self.frontiers.iter().any(|frontier| settings(frontier) > self.unscored.len())
    }
}

/// A setting whose mean lacks targets for which another setting has a score.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Incomplete {
    /// Same as [`Sample::label`].
    pub label: String,
    /// Same as [`Sample::counts`].
    #[serde(flatten)]
    pub counts: Counts,
    /// Scenes for which some setting has a score.
    pub of_scenes: u64,
    /// Targets for which some setting has a score.
    pub of_targets: u64,
}

/// The frontiers of a store's methods, for each protocol and metric.
///
/// # Errors
/// [`EvalError::Preset`].
pub fn tradeoffs(results: &Results, metrics: &[&str], leaked: Leaked) -> Result<Vec<Tradeoff>, EvalError> {
    let tradeoff = |(preset, metric): (&PresetRecord, &str)| {
        let aggregation = preset.protocol()?.aggregation;
        let machine = machine_of(results, &preset.name);
        let scored = scored(results, machine, &preset.name, metric, leaked, aggregation);
        let machines = machine.into_iter().cloned().collect();
        let tradeoff = of_scored((&preset.name, &preset.hash), metric, &scored, aggregation, machines);
        Ok(with_targets(tradeoff, results, std::slice::from_ref(preset), leaked))
    };
    let presets = results.provenance.presets.iter();
    presets.flat_map(|preset| metrics.iter().map(move |metric| (preset, *metric))).map(tradeoff).collect()
}

/// The frontiers over the methods of all protocols together, for sweeps of views or resolution. Labels include the protocol;
/// differences are between targets of the same frame. Only times of one machine are compared.
///
/// # Errors
/// [`EvalError::Preset`].
pub fn across(results: &Results, metric: &str, leaked: Leaked) -> Result<Tradeoff, EvalError> {
    let presets = &results.provenance.presets;
    let machine = common_machine(results);
    let mut all = Vec::new();
    for preset in presets {
        let aggregation = preset.protocol()?.aggregation;
        for (sample, selected) in scored(results, machine, &preset.name, metric, leaked, aggregation) {
            let label = format!("{}, {}", sample.label, preset.name);
            all.push((Sample { label, ..sample }, selected));
        }
    }
    let hashes: Vec<&str> = presets.iter().map(|preset| preset.hash.as_str()).collect();
    let machines = machine.into_iter().cloned().collect();
    let tradeoff =
        of_scored(("different protocols", &hashes.join(" ")), metric, &all, Aggregation::SceneMeans, machines);
    Ok(with_targets(tradeoff, results, presets, leaked))
}

/// The machine on which methods of different protocols are compared: the one on which most protocols were timed, of those the
/// one with the most timed trials, the first in order if tied.
fn common_machine(results: &Results) -> Option<&Machine> {
    let mut counts: BTreeMap<&Machine, (BTreeSet<&str>, usize)> = BTreeMap::new();
    for row in results.timings.iter().filter(|row| row.is_timed()) {
        let (presets, rows) = counts.entry(&row.machine).or_default();
        presets.insert(&row.key.preset);
        *rows += 1;
    }
    let counts = counts.into_iter().map(|(machine, (presets, rows))| (machine, (presets.len(), rows)));
    counts.reduce(|most, other| if other.1 > most.1 { other } else { most }).map(|(machine, _)| machine)
}

/// Counts the targets of protocols.
fn with_targets(tradeoff: Tradeoff, results: &Results, presets: &[PresetRecord], leaked: Leaked) -> Tradeoff {
    let is_of_presets = |target: &&TargetRow| presets.iter().any(|preset| preset.name == target.key.preset);
    let is_kept = |target: &&TargetRow| leaked == Leaked::Included || !target.leaked;
    let mut found = BTreeMap::new();
    for target in results.targets.iter().filter(is_of_presets).filter(is_kept) {
        let TrialKey { preset, scene, entry, .. } = &target.key;
        found.insert((preset, scene, entry, target.target), target.leaked);
    }
    let leaked = found.values().filter(|leaked| **leaked).count() as u64;
    Tradeoff { targets: found.len() as u64, leaked, ..tradeoff }
}

fn of_scored(
    (preset, protocol): (&str, &str),
    metric: &str,
    scored: &[(Sample, Vec<SelectedTarget<'_>>)],
    aggregation: Aggregation,
    machines: Vec<Machine>,
) -> Tradeoff {
    let step = quality_step(metric);
    let samples: Vec<Sample> = scored.iter().map(|(sample, _)| sample.clone()).collect();
    let contrasts = |terms: &[(usize, f64)]| {
        let term = |(at, weight): &(usize, f64)| Some((scored.get(*at)?.1.as_slice(), *weight));
        contrast(&terms.iter().map(term).collect::<Option<Vec<_>>>()?, aggregation)
    };
    let mut devices: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for sample in &samples {
        if let Some(device) = &sample.device {
            devices.entry(device.clone()).or_default().push(sample.label.clone());
        }
    }
    let unscored = samples.iter().filter_map(|sample| Some((sample.label.clone(), sample.unscored.clone()?))).collect();
    let along = |axis| frontier(&samples, &contrasts, direction(metric), axis, step);
    Tradeoff {
        preset: preset.to_owned(),
        protocol: protocol.to_owned(),
        metric: metric.to_owned(),
        targets: 0,
        leaked: 0,
        unit: definition(metric).map_or_else(String::new, |definition| definition.unit.to_owned()),
        frontiers: [Axis::Seconds, Axis::Gaussians].map(along).into(),
        machines,
        devices,
        incomplete: incomplete(scored),
        unscored,
    }
}

fn incomplete(scored: &[(Sample, Vec<SelectedTarget<'_>>)]) -> Vec<Incomplete> {
    let images = scored.iter().flat_map(|(_, selected)| SelectedTarget::scored(selected));
    let images: BTreeSet<_> = images.map(|(image, ..)| image).collect();
    let scenes: BTreeSet<&str> = images.iter().map(|(scene, ..)| *scene).collect();
    let (of_scenes, of_targets) = (scenes.len() as u64, images.len() as u64);
    // A setting without a mean is left out of the frontiers, which say why.
    let lacks_some = |sample: &&Sample| sample.quality.is_some() && sample.counts.targets < of_targets;
    let of_sample = |Sample { label, counts, .. }: &Sample| Incomplete {
        label: label.clone(),
        counts: *counts,
        of_scenes,
        of_targets,
    };
    scored.iter().map(|(sample, _)| sample).filter(lacks_some).map(of_sample).collect()
}

/// The methods that were run under a preset as samples with their targets, in the order of the provenance record.
///
/// Seconds come from the timing pass: the median of encoding plus the median of rendering one view, which is the time to the
/// first image. If a method has only one of the two, that one counts. Times on other machines than `machine` are left out.
pub(super) fn scored<'a>(
    results: &'a Results,
    machine: Option<&Machine>,
    preset: &'a str,
    metric: &'a str,
    leaked: Leaked,
    aggregation: Aggregation,
) -> Vec<(Sample, Vec<SelectedTarget<'a>>)> {
    let sample = |record: &'a MethodRecord| {
        let method = record.name.as_str();
        let cost = cost(results, preset, method);
        let query = MetricQuery { preset, method, metric, leaked, identical: Identical::Excluded };
        let selected = select(results, &query);
        let summary = summary_of(&selected, aggregation);
        let mut sample = Sample {
            label: method.to_owned(),
            quality: summary.mean,
            unscored: summary.mean.is_none().then(|| why_unscored(results, &query, &summary)),
            gaussians: cost.gaussians,
            counts: Counts {
                scenes: summary.scenes,
                targets: summary.targets,
                failed: summary.failed,
                not_applicable: summary.not_applicable,
                non_finite: summary.non_finite,
                uncomputed: summary.uncomputed,
                identical: summary.identical,
            },
            ..Sample::default()
        };
        match times_on(machine, results, preset, method) {
            Ok(times) => {
                sample.secs = times.first_image.map(|spread| spread.median);
                sample.secs_error = times.first_image.map_or(0.0, |spread| spread.error);
                sample.busy = times.busy;
                sample.whole_answer = record.is_process() && times.encode.is_some();
                sample.device = times.device;
            }
            Err(reason) => sample.untimed = Some(reason),
        }
        (cost.trials + cost.failed + cost.not_applicable > 0).then_some((sample, selected))
    };
    results.provenance.methods.iter().filter_map(sample).collect()
}

/// The step of quality that is priced: 0.1 for decibels, 0.01 for everything else, in the metric's unit.
pub fn quality_step(metric: &str) -> f64 {
    if definition(metric).is_some_and(|definition| definition.unit == "dB") { 0.1 } else { 0.01 }
}
