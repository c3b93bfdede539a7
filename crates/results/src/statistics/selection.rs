use std::collections::BTreeMap;

use atsplat_metrics::{DECIBEL_CAP, Measure, definition};

use super::{Identical, Leaked, MetricQuery};
use crate::rows::ADDED_LATER;
use crate::{IDENTICAL, Results, TargetRow, TargetStatus};

/// One target of a query.
#[derive(Clone, Copy, Debug)]
pub struct SelectedTarget<'a> {
    pub(crate) scene: &'a str,
    pub(crate) entry: u32,
    pub(crate) target: u32,
    /// Position of its frame in the scene; that of the target for a score that is not of a row.
    pub(crate) frame: u64,
    /// `None` for a score that is not of a row.
    pub(crate) distance: Option<i64>,
    pub(crate) overlap: Option<f64>,
    pub(crate) outcome: Outcome<'a>,
}

/// A target's image in any protocol: scene, entry and frame, and how many of the entry's targets up to this one have that
/// frame, because an index may repeat it.
pub(crate) type ImageKey<'a> = (&'a str, u32, u64, u32);

/// The score of a target, or why there is none.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Outcome<'a> {
    /// A finite number.
    Score { value: f64, identical: bool },
    /// The render is identical to the truth, and the query leaves it out.
    Identical,
    /// The render, or the score, is not finite.
    NonFinite,
    /// The render or the ground truth is missing.
    Failed,
    /// The method does not support the trial.
    NotApplicable,
    /// It was not computed, for this reason.
    NotComputed(&'a str),
}

impl<'a> SelectedTarget<'a> {
    /// A score of the target with this identity: scene, entry, and position among its targets.
    pub fn of_score((scene, entry, target): (&'a str, u32, u32), value: f64) -> Self {
        let outcome = Outcome::Score { value, identical: false };
        Self { scene, entry, target, frame: target.into(), distance: None, overlap: None, outcome }
    }

    /// Identity within a preset and method; also the order of every sum.
    pub(crate) fn id(&self) -> (&str, u32, u32) {
        (self.scene, self.entry, self.target)
    }

    pub(super) const fn score(&self) -> Option<f64> {
        match self.outcome {
            Outcome::Score { value, .. } => Some(value),
            _ => None,
        }
    }

    /// Those of `selected` that have a score, with their images, in the same order.
    pub(crate) fn scored<'s>(selected: &'s [Self]) -> impl Iterator<Item = (ImageKey<'a>, &'s Self, f64)> {
        let mut found: BTreeMap<(&str, u32, u64), u32> = BTreeMap::new();
        selected.iter().filter_map(move |target| {
            let Self { scene, entry, frame, .. } = *target;
            let times = found.entry((scene, entry, frame)).or_default();
            *times += 1;
            Some(((scene, entry, frame, *times), target, target.score()?))
        })
    }
}

/// The targets of a query, ordered by scene, entry and target.
pub(crate) fn select<'a>(results: &'a Results, query: &MetricQuery<'a>) -> Vec<SelectedTarget<'a>> {
    let MetricQuery { preset, method, metric, leaked, identical } = *query;
    let rows = || results.targets_of(preset, method);
    let record = results.provenance.metrics.iter().find(|record| record.id == metric);
    let is_requested = record.is_some() || rows().any(|row| row.scores.contains_key(metric));
    let absent = record.and_then(|record| record.absent.as_deref()).unwrap_or("not among the metrics of this run");
    let unsupported = results.unsupported_keys();
    let counts = |row: &&TargetRow| leaked == Leaked::Included || !row.leaked;
    let of_row = |row: &'a TargetRow| SelectedTarget {
        scene: &row.key.scene,
        entry: row.key.entry,
        target: row.target,
        frame: row.frame,
        distance: Some(row.signed_distance),
        overlap: row.overlap,
        outcome: match outcome(row, metric, is_requested, absent) {
            Outcome::Failed if unsupported.contains(&row.key) => Outcome::NotApplicable,
            Outcome::Score { identical: true, .. } if identical == Identical::Excluded => Outcome::Identical,
            Outcome::NotComputed(_) if record.is_some_and(|record| row.lacks(record)) => {
                Outcome::NotComputed(ADDED_LATER)
            }
            other => other,
        },
    };
    let mut selected: Vec<SelectedTarget<'a>> = rows().filter(counts).map(of_row).collect();
    selected.sort_by(|a, b| a.id().cmp(&b.id()));
    selected
}

fn outcome<'a>(row: &'a TargetRow, metric: &str, is_requested: bool, absent: &'a str) -> Outcome<'a> {
    let identical = row.status == TargetStatus::Identical;
    match (row.status, row.scores.get(metric), row.not_computed.get(metric)) {
        (TargetStatus::Failed, _, _) => Outcome::Failed,
        (TargetStatus::NonFinite, _, _) => Outcome::NonFinite,
        (_, Some(value), _) if value.is_finite() => Outcome::Score { value: *value, identical },
        (_, Some(_), _) => Outcome::NonFinite,
        (_, None, Some(reason)) if reason == IDENTICAL && is_psnr(metric) => {
            Outcome::Score { value: DECIBEL_CAP, identical: true }
        }
        (_, None, Some(reason)) => Outcome::NotComputed(reason),
        (TargetStatus::Identical, None, None) if is_requested && is_psnr(metric) => {
            Outcome::Score { value: DECIBEL_CAP, identical }
        }
        (_, None, None) => Outcome::NotComputed(absent),
    }
}

/// A target's finite score, with the PSNR of identical images capped; for rows without [`TargetRow::not_computed`].
pub fn score_of(status: TargetStatus, score: Option<f64>, metric: &str) -> Option<f64> {
    match (status, score) {
        (TargetStatus::Failed | TargetStatus::NonFinite, _) => None,
        (TargetStatus::Identical, None) if is_psnr(metric) => Some(DECIBEL_CAP),
        (_, score) => score.filter(|score| score.is_finite()),
    }
}

/// Whether a metric is a variant of PSNR, by its [`atsplat_metrics::Definition`].
pub fn is_psnr(metric: &str) -> bool {
    definition(metric).is_some_and(|definition| matches!(definition.measure, Measure::Psnr { .. }))
}
