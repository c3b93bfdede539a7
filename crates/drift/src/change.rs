//! What changed: from the data and the protocol, over the stages, to the methods.

use std::collections::BTreeSet;

use serde::Serialize;

use super::DriftReport;
use super::probe::{Attribution, Stage, StageChange, StageVerdict};

/// Where something changed, in the order in which a number is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Cause {
    /// Images of the dataset.
    Data,
    /// Cameras of the dataset: poses, intrinsics or lenses.
    Cameras,
    /// Entries of the evaluation index.
    Index,
    /// How the preset crops and resizes images.
    Preprocessing,
    /// Other fields of the preset.
    Protocol,
    /// [`Stage::Decode`].
    Decode,
    /// [`Stage::Resize`].
    Resize,
    /// [`Stage::Model`].
    Model,
    /// [`Stage::Renderer`]; files have its older name, `splatter`.
    #[serde(rename = "splatter")]
    Renderer,
    /// [`Stage::Metric`], or the convention or the weights of a metric, or that it is not computed any more.
    Metric,
    /// The recorded settings or weights of a method, or that it was not run.
    Method,
    /// Nothing that is recorded: a method's files or its code, or which part of the targets was run.
    Outside,
}

impl Cause {
    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Cameras => "cameras",
            Self::Index => "index",
            Self::Preprocessing => "preprocessing",
            Self::Protocol => "protocol",
            Self::Decode => "decode",
            Self::Resize => "resize",
            Self::Model => "model",
            Self::Renderer => "renderer",
            Self::Metric => "metric",
            Self::Method => "method",
            Self::Outside => "outside",
        }
    }
}

impl From<Stage> for Cause {
    fn from(stage: Stage) -> Self {
        match stage {
            Stage::Data => Self::Data,
            Stage::Decode => Self::Decode,
            Stage::Resize => Self::Resize,
            Stage::Model => Self::Model,
            Stage::Renderer => Self::Renderer,
            Stage::Metric => Self::Metric,
        }
    }
}

/// Something that changed and moves numbers, or may move them.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Change {
    /// Where.
    pub stage: Cause,
    /// What, with the first case and the number of the others: an image, a trial, a field with both values.
    pub detail: String,
}

impl Change {
    pub(super) const fn new(stage: Cause, detail: String) -> Self {
        Self { stage, detail }
    }

    /// One for each cause, in order, with the first case as they are given.
    pub(super) fn merged(all: Vec<Self>) -> Vec<Self> {
        // Every method has rows of a changed trial.
        let mut known = BTreeSet::new();
        let mut all: Vec<Self> = all.into_iter().filter(|change| known.insert(change.clone())).collect();
        all.sort_by_key(|change| change.stage);
        let of_cause = |same: &[Self]| {
            let (first, more) = same.split_first()?;
            let more = if more.is_empty() { String::new() } else { format!(", and {} more", more.len()) };
            Some(Self::new(first.stage, format!("{}{more}", first.detail)))
        };
        all.chunk_by(|a, b| a.stage == b.stage).filter_map(of_cause).collect()
    }

    fn of_stage(change: &StageChange) -> Self {
        let StageChange { stage, differing, values, .. } = change;
        Self::new((*stage).into(), format!("{differing} of {values} values of the probe differ"))
    }
}

impl DriftReport {
    /// Where something changed first; `None` if nothing is known to have changed.
    pub fn first_change(&self) -> Option<Cause> {
        self.changes.first().map(|change| change.stage)
    }

    /// What changed, with what a probe found. Changed images are not changed data if decoding or resizing changed on the probe, since
    /// these stages can produce other images from the same files.
    pub(super) fn changes_with(&self, attribution: &Attribution) -> Vec<Change> {
        let first = attribution.first();
        let are_decoded_differently = matches!(first, Some(Stage::Decode | Stage::Resize));
        let is_known = |change: &&Change| change.stage != Cause::Data || !are_decoded_differently;
        let mut changes: Vec<Change> = self.changes.iter().filter(is_known).cloned().collect();
        for stage in attribution.stages.iter().filter(|stage| stage.verdict == StageVerdict::Changed) {
            let change = Change::of_stage(stage);
            if changes.iter().all(|known| known.stage != change.stage) {
                changes.push(change);
            }
        }
        let is_whole = attribution.stages.iter().all(|stage| stage.verdict != StageVerdict::Empty);
        // Another convention or other weights move the numbers of their metric or method alone.
        let is_of_one = |change: &Change| matches!(change.stage, Cause::Metric | Cause::Method);
        let is_explained = first.is_some() || !changes.iter().all(is_of_one);
        if is_whole
            && !is_explained
            && let Some(detail) = self.moved_outside()
        {
            changes.push(Change::new(Cause::Outside, detail));
        }
        changes.sort();
        changes
    }

    /// What changed first, what else did, or what was compared without a change.
    pub(super) fn conclusion(&self) -> String {
        if self.compared_nothing() {
            let text = "Nothing could be compared: no target has a score both in the results and in the baseline, which \
                        may be that of another run.";
            return if self.changes.is_empty() { text.to_owned() } else { format!("{text} {}", self.what_changed()) };
        }
        self.what_changed()
    }

    /// The first change and the others, or what was compared without one.
    fn what_changed(&self) -> String {
        let (outside, known): (Vec<&Change>, Vec<&Change>) =
            self.changes.iter().partition(|change| change.stage == Cause::Outside);
        let named = |change: &&Change| format!("{}: {}", change.stage.name(), change.detail);
        let outside = outside.first().map(|change| &change.detail);
        let Some((first, rest)) = known.split_first() else {
            let cause = outside.map_or_else(String::new, |detail| format!(" The cause is {detail}."));
            return format!("{}{cause}", self.without_change());
        };
        let mut text = format!("The first change is in the {}.", named(first));
        if !rest.is_empty() {
            let rest: Vec<String> = rest.iter().map(named).collect();
            text = format!("{text} Also changed: {}.", rest.join("; "));
        }
        match outside {
            Some(detail) => format!("{text} What else moved is {detail}."),
            None => text,
        }
    }

    /// What was compared, if nothing changed.
    fn without_change(&self) -> String {
        let data = match self.data.verdict() {
            StageVerdict::Empty => "No image of the dataset could be compared",
            _ => "The dataset's images are the baseline's",
        };
        let stages = self.attribution.iter().flat_map(|attribution| &attribution.stages);
        let empty: Vec<&str> =
            stages.filter(|stage| stage.verdict == StageVerdict::Empty).map(|stage| stage.stage.name()).collect();
        match &self.attribution {
            None if self.not_attributed.is_some() => format!("{data}; a stage of the probe failed."),
            None => format!("{data}; no probe was run."),
            Some(_) if empty.is_empty() => format!("{data}; no stage of the probe changed."),
            Some(_) => format!("{data}; the probe had nothing to compare for: {}.", empty.join(", ")),
        }
    }
}
