//! Changes of what methods and stages start from: presets, index entries and cameras.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_results::{PresetRecord, Provenance};

use super::change::Change;
use super::provenance::{OF_RECORD, TEXT};
use super::rows::{EntryId, Frames, Group, Rewriting, Rows};
use super::{Cause, Difference, DriftVerdict, Finding, FindingKind, Setting};

/// Parts of a protocol that the hashes of its trials contain.
const OF_TRIALS: [&str; 5] = ["preprocessing", "lens-distortion", "pose-normalisation", "near-far", "methods"];

/// A preset that both runs have.
pub(super) struct SharedPreset<'a> {
    then: &'a PresetRecord,
    now: &'a PresetRecord,
    /// The fields of its protocol that differ; empty if nothing that can change a number does.
    fields: Vec<(&'a str, &'a Difference)>,
}

impl<'a> SharedPreset<'a> {
    pub(super) fn all(then: &'a Provenance, now: &'a Provenance, differences: &'a [Difference]) -> Vec<Self> {
        let shared = |then: &'a PresetRecord| {
            let field = |difference: &'a Difference| {
                let Difference { of: Setting::Preset(name), field: Some(field), .. } = difference else { return None };
                let is_of_protocol = *name == then.name && !OF_RECORD.contains(&field.as_str());
                is_of_protocol.then_some((field.as_str(), difference))
            };
            let fields = differences.iter().filter_map(field).collect();
            Some(Self { then, now: now.preset(&then.name)?, fields })
        };
        then.presets.iter().filter_map(shared).collect()
    }

    /// Its name if it crops or resizes images differently than in the baseline, or may do so: they cannot be compared then.
    pub(super) fn name_if_images_may_differ(&self) -> Option<&'a str> {
        let may_be_other = self.differs_in("preprocessing") || self.differs_in(TEXT);
        may_be_other.then_some(self.then.name.as_str())
    }

    /// Its findings, and what they say about the cause.
    pub(super) fn compare(&self, then: &Rows, now: &Rows) -> (Vec<Finding>, Vec<Change>) {
        let name = &self.then.name;
        let rewriting = self.rewriting();
        let mut entries: BTreeMap<EntryId, String> = BTreeMap::new();
        let mut run: [BTreeSet<&EntryId>; 2] = [BTreeSet::new(), BTreeSet::new()];
        let (mut changes, mut is_shared, mut is_unclear) = (self.changes_of_protocol(), false, false);
        for (then, now) in then.shared(now, name) {
            is_shared = true;
            is_unclear |= !rewriting.explains_trials && then.has_unknown_frames(now);
            entries.extend(then.changed_entries(now, rewriting));
            run.iter_mut().zip([then, now]).for_each(|(run, group)| run.extend(group.trials.keys()));
            changes.extend(self.changed_sources(then, now, rewriting.is_rewritten));
        }
        // Without a common row, nothing is known about the entries.
        let index = if is_shared { self.index(&entries, &run, rewriting.is_rewritten) } else { None };
        let index = index.filter(|finding| finding.kind == FindingKind::Index || !is_unclear);
        changes.extend(entries.iter().map(|(id, how)| Change::new(Cause::Index, format!("{}: {how}", self.at(id)))));
        let of_others = index.iter().filter(|finding| finding.kind == FindingKind::Index && entries.is_empty());
        changes.extend(of_others.map(|finding| Change::new(Cause::Index, format!("{name}, {}", finding.example))));
        (self.protocol().into_iter().chain(index).collect(), changes)
    }

    fn rewriting(&self) -> Rewriting {
        let is_rewritten = self.then.index_sha256 != self.now.index_sha256;
        let is_whole = [self.then, self.now].iter().all(|record| record.entries == record.entries_of_index);
        Rewriting {
            is_rewritten,
            explains_trials: is_rewritten && !self.has_other_trials(),
            is_whole: is_rewritten && is_whole,
        }
    }

    fn differs_in(&self, part: &str) -> bool {
        self.fields.iter().any(|(field, _)| is_of(field, part))
    }

    /// Whether its trials have other hashes on the same data.
    fn has_other_trials(&self) -> bool {
        // The fields of a text that is no TOML of this version are unknown.
        let is_unknown = self.then.hash != self.now.hash && (self.fields.is_empty() || self.differs_in(TEXT));
        is_unknown || OF_TRIALS.iter().any(|part| self.differs_in(part))
    }

    fn at(&self, (scene, entry): &EntryId) -> String {
        format!("{}, scene {scene}, entry {entry}", self.then.name)
    }

    fn changes_of_protocol(&self) -> Vec<Change> {
        let Self { then, now, fields } = self;
        if fields.is_empty() && then.hash != now.hash {
            return vec![Change::new(Cause::Protocol, format!("{}, {}", then.name, self.hashes()))];
        }
        let causes = [("preprocessing", Cause::Preprocessing), ("metrics", Cause::Metric)];
        let change = |(field, difference): &(&str, &Difference)| {
            let cause = causes.iter().find(|(part, _)| is_of(field, part)).map_or(Cause::Protocol, |(_, cause)| *cause);
            Change::new(cause, difference.to_string())
        };
        fields.iter().map(change).collect()
    }

    /// The trials on other cameras, or on other images or cameras where images cannot be compared.
    fn changed_sources(&self, then: &Group, now: &Group, is_rewritten: bool) -> Vec<Change> {
        let has_other_trials = self.has_other_trials();
        let change = |(id, then_trial): (&EntryId, &super::BaselineTrial)| {
            let trial = now.trials.get(id).filter(|trial| trial.trial_hash != then_trial.trial_hash)?;
            let has_same_frames = match then.frames(now, id) {
                Frames::Same => true,
                Frames::Unknown => !is_rewritten,
                Frames::Changed(_) => false,
            };
            let is_other_data = then_trial.data_hash.as_ref().zip(trial.data_hash.as_ref()).map(|(was, is)| was != is);
            // A baseline of an older version does not record the data of a trial.
            if !has_same_frames || !is_other_data.unwrap_or(!has_other_trials) {
                return None;
            }
            Some(if has_other_trials {
                Change::new(Cause::Data, format!("images or cameras of {}", self.at(id)))
            } else {
                Change::new(Cause::Cameras, self.at(id))
            })
        };
        then.trials.iter().filter_map(change).collect()
    }

    fn protocol(&self) -> Option<Finding> {
        let of_field = |(field, difference): &(&str, &Difference)| format!("{field}: {}", difference.values());
        let example = self.fields.first().map_or_else(|| self.hashes(), of_field);
        let is_other = self.then.hash != self.now.hash;
        let count = self.fields.len().max(1) as u64;
        is_other.then(|| self.finding(FindingKind::Protocol, DriftVerdict::Drifted, count, example))
    }

    fn hashes(&self) -> String {
        format!("was {}, is now {}", self.then.hash, self.now.hash)
    }

    /// Which entries differ, or that the index is another file with the same entries. `run` has the entries of both runs, then and now.
    fn index(
        &self,
        entries: &BTreeMap<EntryId, String>,
        run: &[BTreeSet<&EntryId>; 2],
        is_rewritten: bool,
    ) -> Option<Finding> {
        let [was, is] = [self.then, self.now].map(|record| record.entries_of_index);
        let drifted = |count, example| Some(self.finding(FindingKind::Index, DriftVerdict::Drifted, count, example));
        match entries.first_key_value() {
            Some(((scene, entry), how)) => drifted(entries.len() as u64, format!("{scene} {entry}: {how}")),
            None if !is_rewritten => None,
            None if was != is => {
                let [then, now] = run;
                let (mut left, how) =
                    if is < was { (then.difference(now), "missing") } else { (now.difference(then), "new") };
                let first = |(scene, entry): &&EntryId| format!("; of those that were run, {scene} {entry} is {how}");
                let first = left.next().map_or_else(String::new, first);
                drifted(was.abs_diff(is), format!("{is} entries of the index instead of {was}{first}"))
            }
            None => Some(self.finding(FindingKind::RewrittenIndex, DriftVerdict::Same, 1, String::new())),
        }
    }

    fn finding(&self, kind: FindingKind, verdict: DriftVerdict, count: u64, example: String) -> Finding {
        Finding { preset: self.then.name.clone(), method: String::new(), kind, verdict, count, example }
    }
}

/// Whether a field is a part of a protocol, or below it.
fn is_of(field: &str, part: &str) -> bool {
    field.strip_prefix(part).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}
