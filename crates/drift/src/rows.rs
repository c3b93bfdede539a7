//! Rows by preset and method, and their changes other than of scores.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_numeric::{counted, mean};
use atsplat_results::{TargetRow, TargetStatus, TrialKey, TrialStatus};

use super::{BaselineTarget, BaselineTrial, Basis, DriftVerdict, Finding, FindingKind};

/// By what share of the baseline's the mean number of Gaussians of a deterministic method may differ on another type of machine,
/// where rounding may select other tokens.
const MACHINE_COUNTS: f64 = 0.01;
/// The same for any other method: an optimisation that ends after a time has more or fewer Gaussians each time.
const ANY_COUNTS: f64 = 0.1;

/// Rows by preset and method.
pub(super) struct Rows(pub(super) BTreeMap<(String, String), Group>);

/// Rows of one method under one preset.
#[derive(Default)]
pub(super) struct Group {
    pub(super) trials: BTreeMap<EntryId, BaselineTrial>,
    pub(super) targets: BTreeMap<TargetId, BaselineTarget>,
    /// Why targets failed; a baseline does not record it.
    reasons: BTreeMap<TargetId, String>,
}

/// Scene and number of an entry.
pub(super) type EntryId = (String, u32);

/// Scene, number of an entry and number of a target.
pub(super) type TargetId = (String, u32, u32);

/// Whether the frames of a trial are the baseline's.
pub(super) enum Frames {
    /// They are.
    Same,
    /// Those of the targets are; the baseline is of an older version, which did not record the others.
    Unknown,
    /// They are not; how they differ.
    Changed(String),
}

/// What the file of an index may explain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rewriting {
    /// Whether it is another file than in the baseline.
    pub(super) is_rewritten: bool,
    /// Whether it is, and nothing else of the preset gives trials other hashes.
    pub(super) explains_trials: bool,
    /// Whether it is, and both runs took all entries, so that those of one run alone are new or missing in it.
    pub(super) is_whole: bool,
}

impl Rows {
    pub(super) fn new(
        trials: impl Iterator<Item = BaselineTrial>,
        targets: impl Iterator<Item = BaselineTarget>,
    ) -> Self {
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

    /// With the first line of why each target failed.
    #[must_use]
    pub(super) fn with_reasons(mut self, targets: &[TargetRow]) -> Self {
        for row in targets {
            let Some(reason) = row.detail.as_deref().and_then(|detail| detail.lines().next()) else { continue };
            let TrialKey { preset, method, scene, entry } = row.key.clone();
            let group = self.0.entry((preset, method)).or_default();
            group.reasons.insert((scene, entry, row.target), reason.to_owned());
        }
        self
    }

    /// The rows of a preset under each method that both have, with those of `now`.
    pub(super) fn shared<'a>(&'a self, now: &'a Self, preset: &'a str) -> impl Iterator<Item = (&'a Group, &'a Group)> {
        let groups = self.0.iter().filter(move |((of, _), _)| of == preset);
        groups.filter_map(move |(name, group)| Some((group, now.0.get(name)?)))
    }

    /// Whether a target is in both.
    pub(super) fn share_a_target(&self, now: &Self) -> bool {
        let is_in = |group: &Group, now: &Group| group.targets.keys().any(|id| now.targets.contains_key(id));
        self.0.iter().any(|(name, group)| now.0.get(name).is_some_and(|now| is_in(group, now)))
    }
}

impl Group {
    /// The changes other than of scores, by kind.
    pub(super) fn findings(&self, now: &Self, preset: &str, method: &str, basis: Basis) -> Vec<Finding> {
        let changes = [
            (FindingKind::Missing, self.targets_missing_in(now)),
            (FindingKind::New, now.targets_missing_in(self)),
            (FindingKind::Trial, self.changed_trials(now)),
            (FindingKind::Grouping, self.changed_groupings(now)),
            (FindingKind::Status, self.changed_statuses(now)),
            (FindingKind::Render, self.changed_renders(now)),
            (FindingKind::Count, self.changed_counts(now)),
            (FindingKind::Score, self.lost_scores(now)),
            (FindingKind::NewScore, self.new_scores(now)),
        ];
        let mean_count = self.change_of_mean_count(now, basis);
        let finding = |(kind, cases): (FindingKind, Vec<String>)| {
            let count = cases.len() as u64;
            let first = cases.into_iter().next()?;
            let verdict = verdict(kind, basis, mean_count.is_some());
            let example = match &mean_count {
                Some(change) if kind == FindingKind::Count => format!("{first}; {change}"),
                _ => first,
            };
            Some(Finding { preset: preset.to_owned(), method: method.to_owned(), kind, verdict, count, example })
        };
        changes.into_iter().filter_map(finding).collect()
    }

    fn targets_missing_in(&self, other: &Self) -> Vec<String> {
        let missing = self.targets.iter().filter(|(id, _)| !other.targets.contains_key(*id));
        missing.map(|(id, row)| location(id, row)).collect()
    }

    fn changed_trials(&self, now: &Self) -> Vec<String> {
        let changed = self.trials_in_both(now).filter(|(_, [then, now])| then.trial_hash != now.trial_hash);
        changed.map(|((scene, entry), _)| format!("{scene} {entry}")).collect()
    }

    fn changed_counts(&self, now: &Self) -> Vec<String> {
        let changed = self.trials_in_both(now).filter_map(|((scene, entry), [then, now])| {
            let change = change_of_counts(then, now)?;
            Some(format!("{scene} {entry}: {change}"))
        });
        changed.collect()
    }

    fn changed_groupings(&self, now: &Self) -> Vec<String> {
        self.changes_of_targets(now, |_, then, now| then.grouping.as_ref()?.change(now.grouping.as_ref()?))
    }

    fn changed_statuses(&self, now: &Self) -> Vec<String> {
        self.changes_of_targets(now, |id, then, row| {
            let (was, is) = (self.status_of(then), now.status_of(row));
            let reason = || now.reasons.get(id).map_or_else(String::new, |reason| format!(": {reason}"));
            (was != is).then(|| format!("was {was}, is now {is}{}", reason()))
        })
    }

    fn changed_renders(&self, now: &Self) -> Vec<String> {
        let is_changed = |(_, [then, now]): &(&TargetId, [&BaselineTarget; 2])| {
            then.render_hash.is_some() && then.render_hash != now.render_hash
        };
        self.targets_in_both(now).filter(is_changed).map(|(id, [then, _])| location(id, then)).collect()
    }

    fn lost_scores(&self, now: &Self) -> Vec<String> {
        self.changes_of_targets(now, |_, then, now| score_missing_in(then, now))
    }

    fn new_scores(&self, now: &Self) -> Vec<String> {
        self.changes_of_targets(now, |_, then, now| score_missing_in(now, then))
    }

    fn trials_in_both<'a>(&'a self, now: &'a Self) -> impl Iterator<Item = (&'a EntryId, [&'a BaselineTrial; 2])> {
        self.trials.iter().filter_map(move |(id, then)| Some((id, [then, now.trials.get(id)?])))
    }

    fn targets_in_both<'a>(&'a self, now: &'a Self) -> impl Iterator<Item = (&'a TargetId, [&'a BaselineTarget; 2])> {
        self.targets.iter().filter_map(move |(id, then)| Some((id, [then, now.targets.get(id)?])))
    }

    /// What `change` says of targets in both, after their places.
    fn changes_of_targets(
        &self,
        now: &Self,
        change: impl Fn(&TargetId, &BaselineTarget, &BaselineTarget) -> Option<String>,
    ) -> Vec<String> {
        let changed = self.targets_in_both(now).filter_map(|(id, [then, now])| {
            let change = change(id, then, now)?;
            Some(format!("{}: {change}", location(id, then)))
        });
        changed.collect()
    }

    /// How the mean number of Gaussians over the trials with one in both differs, if by more than it may on an inexact basis.
    fn change_of_mean_count(&self, now: &Self, basis: Basis) -> Option<String> {
        let most = match basis {
            Basis::Exact => return None,
            Basis::Bound => MACHINE_COUNTS,
            Basis::Interval => ANY_COUNTS,
        };
        let both = |(_, [then, now]): (&EntryId, [&BaselineTrial; 2])| Some([then.gaussians?, now.gaussians?]);
        let counts: Vec<[u64; 2]> = self.trials_in_both(now).filter_map(both).collect();
        let [was, is] =
            [mean(counts.iter().map(|[was, _]| *was as f64))?, mean(counts.iter().map(|[_, is]| *is as f64))?];
        let is_beyond = (is - was).abs() > most * was;
        is_beyond.then(|| {
            let percent = most * 100.0;
            format!("their mean number of Gaussians was {was:.0}, is now {is:.0}, and may vary by {percent:.0} %")
        })
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

    /// Whether the frames of a trial that both have are the same.
    pub(super) fn frames(&self, now: &Self, id: &EntryId) -> Frames {
        let targets = |group: &Self| -> Vec<u64> {
            let of_entry = |target| (id.0.clone(), id.1, target);
            group.targets.range(of_entry(0)..=of_entry(u32::MAX)).map(|(_, row)| row.frame).collect()
        };
        if let Some(how) = change_of_frames("target", &targets(self), &targets(now)) {
            return Frames::Changed(how);
        }
        let context = |group: &Self| group.trials.get(id).and_then(|trial| trial.context.clone());
        match context(self).zip(context(now)) {
            None => Frames::Unknown,
            Some((was, is)) => change_of_frames("context", &was, &is).map_or(Frames::Same, Frames::Changed),
        }
    }

    /// Whether nothing tells if the frames of a changed trial are the baseline's.
    pub(super) fn has_unknown_frames(&self, now: &Self) -> bool {
        let is_changed = |id: &EntryId, hash: &str| now.trials.get(id).is_some_and(|trial| trial.trial_hash != hash);
        let mut changed = self.trials.iter().filter(|(id, then)| is_changed(id, &then.trial_hash));
        changed.any(|(id, _)| matches!(self.frames(now, id), Frames::Unknown))
    }

    /// Entries of the index that differ, with how.
    pub(super) fn changed_entries(&self, now: &Self, rewriting: Rewriting) -> BTreeMap<EntryId, String> {
        let mut changed = BTreeMap::new();
        let ids: BTreeSet<&EntryId> = self.trials.keys().chain(now.trials.keys()).collect();
        for id in ids {
            let how = match (self.trials.get(id), now.trials.get(id)) {
                (Some(then), Some(now)) if then.trial_hash == now.trial_hash => continue,
                (Some(_), Some(_)) => match self.frames(now, id) {
                    Frames::Changed(how) => how,
                    Frames::Unknown if rewriting.explains_trials => "other context frames, or other cameras".to_owned(),
                    Frames::Unknown | Frames::Same => continue,
                },
                _ if !rewriting.is_whole => continue,
                (None, _) => "new".to_owned(),
                (_, None) => "missing".to_owned(),
            };
            changed.insert(id.clone(), how);
        }
        for (id, then) in self.targets.iter().filter(|_| rewriting.is_rewritten) {
            let groupings = then.grouping.as_ref().zip(now.targets.get(id).and_then(|now| now.grouping.as_ref()));
            if let Some(how) = groupings.and_then(|(then, now)| then.change(now)) {
                changed.entry((id.0.clone(), id.1)).or_insert(how);
            }
        }
        changed
    }
}

/// Whether a change of this kind is drift. Bits and counts are only guaranteed for deterministic methods on the same machine type;
/// elsewhere, counts of trials may differ as long as their mean does not.
fn verdict(kind: FindingKind, basis: Basis, has_other_mean_count: bool) -> DriftVerdict {
    match kind {
        FindingKind::New | FindingKind::NewScore => DriftVerdict::Within,
        FindingKind::Render if basis != Basis::Exact => DriftVerdict::Within,
        FindingKind::Count if basis != Basis::Exact && !has_other_mean_count => DriftVerdict::Within,
        _ => DriftVerdict::Drifted,
    }
}

fn location((scene, entry, _): &TargetId, row: &BaselineTarget) -> String {
    format!("{scene} {entry} frame {}", row.frame)
}

/// The first score of a target that another row of it lacks.
fn score_missing_in(row: &BaselineTarget, other: &BaselineTarget) -> Option<String> {
    row.scores.keys().find(|id| !other.scores.contains_key(*id)).cloned()
}

/// Which counts of a trial differ, each with both values: `final tokens were 1440, are now 1441`.
fn change_of_counts(then: &BaselineTrial, now: &BaselineTrial) -> Option<String> {
    let counts = |trial: &BaselineTrial| [("Gaussians", trial.gaussians), ("final tokens", trial.final_tokens)];
    let text = |count: Option<u64>| count.map_or_else(|| "none".to_owned(), |count| count.to_string());
    let pairs = counts(then).into_iter().zip(counts(now)).filter(|(was, is)| was != is);
    let changes = pairs.map(|((what, was), (_, is))| format!("{what} were {}, are now {}", text(was), text(is)));
    let changes: Vec<String> = changes.collect();
    (!changes.is_empty()).then(|| changes.join("; "))
}

/// The first frame that differs, or their numbers.
fn change_of_frames(role: &str, was: &[u64], now: &[u64]) -> Option<String> {
    if was.len() != now.len() {
        return Some(format!("{} instead of {}", counted(now.len() as u64, &format!("{role} frame")), was.len()));
    }
    let (was, is) = was.iter().zip(now).find(|(was, is)| was != is)?;
    Some(format!("{role} frame {was} is now {is}"))
}
