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
    /// By scene and entry.
    pub(super) trials: BTreeMap<EntryId, BaselineTrial>,
    /// By scene, entry and number of the target.
    pub(super) targets: BTreeMap<(String, u32, u32), BaselineTarget>,
    /// Why targets failed, by the same; a baseline does not record it.
    reasons: BTreeMap<(String, u32, u32), String>,
}

/// Scene and number of an entry.
pub(super) type EntryId = (String, u32);

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

/// Number and first example of each kind of change.
type Changes = BTreeMap<FindingKind, (u64, String)>;

impl Group {
    /// The kinds of changes other than of scores, each with its count.
    pub(super) fn findings(&self, now: &Self, preset: &str, method: &str, basis: Basis) -> Vec<Finding> {
        let mut changes = Changes::new();
        let mut add = |kind, example: &dyn Fn() -> String| {
            changes.entry(kind).or_insert_with(|| (0, example())).0 += 1;
        };
        for (id, then) in &self.trials {
            let Some(now) = now.trials.get(id) else { continue };
            if then.trial_hash != now.trial_hash {
                add(FindingKind::Trial, &|| format!("{} {}", id.0, id.1));
            }
            if let Some(change) = change_of_counts(then, now) {
                add(FindingKind::Count, &|| format!("{} {}: {change}", id.0, id.1));
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
                let reason = now.reasons.get(id).map_or_else(String::new, |reason| format!(": {reason}"));
                add(FindingKind::Status, &|| format!("{}: was {was}, is now {is}{reason}", location()));
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
        let finding = |(kind, (count, mut example)): (FindingKind, (u64, String))| {
            let verdict = match kind {
                FindingKind::New | FindingKind::NewScore => DriftVerdict::Within,
                // Bits and counts are only guaranteed for deterministic methods on the same machine type.
                FindingKind::Render if basis != Basis::Exact => DriftVerdict::Within,
                FindingKind::Count if basis != Basis::Exact => match self.change_of_mean_count(now, basis) {
                    Some(change) => {
                        example.push_str("; ");
                        example.push_str(&change);
                        DriftVerdict::Drifted
                    }
                    None => DriftVerdict::Within,
                },
                _ => DriftVerdict::Drifted,
            };
            Finding { preset: preset.to_owned(), method: method.to_owned(), kind, verdict, count, example }
        };
        changes.into_iter().map(finding).collect()
    }

    /// How the mean number of Gaussians over the trials with one in both differs, if by more than it may on an inexact basis.
    fn change_of_mean_count(&self, now: &Self, basis: Basis) -> Option<String> {
        let both = |(id, then): (&EntryId, &BaselineTrial)| Some([then.gaussians?, now.trials.get(id)?.gaussians?]);
        let counts: Vec<[u64; 2]> = self.trials.iter().filter_map(both).collect();
        let [was, is] =
            [mean(counts.iter().map(|[was, _]| *was as f64))?, mean(counts.iter().map(|[_, is]| *is as f64))?];
        let most = if basis == Basis::Bound { MACHINE_COUNTS } else { ANY_COUNTS };
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
