use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use atsplat_metrics::{Scale, definition};
use atsplat_protocol::Aggregation;
use serde::Serialize;

use super::scored::{Scored, notes, pair_gaussians, scored};
use super::{Axis, Counts, Frontier, Sample, Seconds, frontier};
use crate::statistics::{Leaked, SelectedTarget, contrast, direction};
use crate::times::{Machine, machine_of, timed_trials};
use crate::{PresetRecord, Results, ResultsError, TargetRow, TrialKey};

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
    /// What ran on a graphics adapter, as [`crate::times::Times::device`], with the labels of its samples.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub devices: BTreeMap<String, Vec<String>>,
    /// Settings whose mean lacks targets for which another setting has a score: their qualities are of other targets.
    pub incomplete: Vec<Incomplete>,
    /// Labels of settings without any score, with the reason; they are in no frontier.
    pub unscored: Vec<(String, String)>,
    /// What else a reader must know.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<Note>,
}

/// What a reader must know of one setting, or of all.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Note {
    /// The setting's label; `None` for all settings.
    pub label: Option<String>,
    /// A sentence without full stop, in lower case after a label.
    pub text: String,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.label.iter().try_for_each(|label| write!(f, "{label}: "))?;
        f.write_str(&self.text)
    }
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
/// [`ResultsError::Preset`].
pub fn tradeoffs(results: &Results, metrics: &[&str], leaked: Leaked) -> Result<Vec<Tradeoff>, ResultsError> {
    let tradeoff = |(preset, metric): (&PresetRecord, &str)| {
        let aggregation = preset.protocol()?.aggregation;
        let machine = machine_of(results, &preset.name);
        let scored = scored(results, machine.as_ref(), &preset.name, metric, leaked, aggregation);
        let machines = machine.into_iter().collect();
        let tradeoff = tradeoff_of_scored(&preset.name, &preset.hash, metric, scored, aggregation, machines);
        Ok(with_targets(tradeoff, results, std::slice::from_ref(preset), leaked))
    };
    let presets = results.provenance.presets.iter();
    presets.flat_map(|preset| metrics.iter().map(move |metric| (preset, *metric))).map(tradeoff).collect()
}

/// The frontiers over the methods of all protocols together, for sweeps of views or resolution. Labels include the protocol;
/// differences are between targets of the same frame, averaged as all protocols average them, or over scene means if they disagree.
/// Only times of one machine are compared.
///
/// # Errors
/// [`ResultsError::Preset`].
pub fn across(results: &Results, metric: &str, leaked: Leaked) -> Result<Tradeoff, ResultsError> {
    let presets = &results.provenance.presets;
    let machine = common_machine(results);
    let (mut all, mut aggregations) = (Vec::new(), Vec::new());
    for preset in presets {
        let aggregation = preset.protocol()?.aggregation;
        aggregations.push(aggregation);
        for mut setting in scored(results, machine.as_ref(), &preset.name, metric, leaked, aggregation) {
            setting.sample.label = format!("{}, {}", setting.sample.label, preset.name);
            all.push(setting);
        }
    }
    let common = Aggregation::common(aggregations);
    let note = (common.is_none() && !presets.is_empty())
        .then(|| Note { label: None, text: DIFFERENT_AGGREGATIONS.to_owned() });
    let aggregation = common.unwrap_or(Aggregation::SceneMeans);
    let hashes: Vec<&str> = presets.iter().map(|preset| preset.hash.as_str()).collect();
    let machines = machine.into_iter().collect();
    let mut tradeoff = tradeoff_of_scored("different protocols", &hashes.join(" "), metric, all, aggregation, machines);
    tradeoff.notes.extend(note);
    Ok(with_targets(tradeoff, results, presets, leaked))
}

const DIFFERENT_AGGREGATIONS: &str =
    "Protocols average targets in different ways: qualities are as each averages them, differences are of scene means";

/// The machine on which methods of different protocols are compared: the one on which most protocols were timed, or without any the
/// one for which most protocols state times; of those the one with the most timed trials or methods, the first in order if tied.
fn common_machine(results: &Results) -> Option<Machine> {
    let timed = timed_trials(results).into_iter();
    let measured = most_common(timed.map(|(key, machine)| (machine.clone(), key.preset.as_str())));
    let stated = results.provenance.methods.iter().flat_map(|method| {
        let of_method = method.stated.iter().map(|(preset, cost)| (preset.as_str(), &cost.seconds));
        let has_trials = move |preset: &str| results.trials_of(preset, &method.name).next().is_some();
        let with_trials = of_method.filter(move |(preset, _)| has_trials(preset));
        with_trials.filter_map(|(preset, seconds)| Some((seconds.as_ref()?.machine(), preset)))
    });
    measured.or_else(|| most_common(stated))
}

/// The machine of most protocols, given once for each of its uses.
fn most_common<'a>(uses: impl Iterator<Item = (Machine, &'a str)>) -> Option<Machine> {
    let mut counts: BTreeMap<Machine, (BTreeSet<&str>, usize)> = BTreeMap::new();
    for (machine, preset) in uses {
        let (presets, times) = counts.entry(machine).or_default();
        presets.insert(preset);
        *times += 1;
    }
    let counts = counts.into_iter().map(|(machine, (presets, times))| (machine, (presets.len(), times)));
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

fn tradeoff_of_scored(
    preset: &str,
    protocol: &str,
    metric: &str,
    mut scored: Vec<Scored<'_>>,
    aggregation: Aggregation,
    machines: Vec<Machine>,
) -> Tradeoff {
    let step = quality_step(metric);
    let paired = pair_gaussians(&mut scored);
    let samples: Vec<Sample> = scored.iter().map(|setting| setting.sample.clone()).collect();
    let contrasts = |terms: &[(usize, f64)]| {
        let term = |(index, weight): &(usize, f64)| Some((scored.get(*index)?.selected.as_slice(), *weight));
        contrast(&terms.iter().map(term).collect::<Option<Vec<_>>>()?, aggregation)
    };
    let mut devices: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for sample in &samples {
        if let Ok(Seconds { device: Some(device), .. }) = &sample.secs {
            devices.entry(device.clone()).or_default().push(sample.label.clone());
        }
    }
    let reason = |sample: &Sample| Some((sample.label.clone(), sample.quality.as_ref().err()?.clone()));
    let unscored = samples.iter().filter_map(reason).collect();
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
        incomplete: incomplete(&scored),
        notes: notes(&scored).into_iter().chain(paired).collect(),
        unscored,
    }
}

fn incomplete(scored: &[Scored<'_>]) -> Vec<Incomplete> {
    let images = scored.iter().flat_map(|setting| SelectedTarget::scored(&setting.selected));
    let images: BTreeSet<_> = images.map(|(image, ..)| image).collect();
    let scenes: BTreeSet<&str> = images.iter().map(|(scene, ..)| *scene).collect();
    let (of_scenes, of_targets) = (scenes.len() as u64, images.len() as u64);
    // A setting without a mean is left out of the frontiers, which say why.
    let lacks_some = |sample: &&Sample| sample.quality.is_ok() && sample.counts.targets < of_targets;
    let of_sample = |Sample { label, counts, .. }: &Sample| Incomplete {
        label: label.clone(),
        counts: *counts,
        of_scenes,
        of_targets,
    };
    scored.iter().map(|setting| &setting.sample).filter(lacks_some).map(of_sample).collect()
}

/// The step of quality that is priced: 0.1 for decibels, 0.01 for everything else, in the metric's unit.
pub fn quality_step(metric: &str) -> f64 {
    match Scale::of(metric) {
        Scale::Decibels => 0.1,
        Scale::Unit => 0.01,
    }
}
