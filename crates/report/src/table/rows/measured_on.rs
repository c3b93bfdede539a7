//! What a row was measured on, in words for the row itself: a row pasted without its table's notes still says so.

use std::collections::BTreeSet;

use atsplat_numeric::noun;
use atsplat_protocol::Preset;
use atsplat_results::{PresetRecord, TargetRow, TargetStatus};
use serde::Serialize;

use crate::counted;
use crate::table::selection::{MethodRun, OtherPreset, Part};

/// Data, size of images and number of scenes of a measured row.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeasuredOn {
    /// `simulated rooms, 128×128, 8 of 24 scenes`, after the method in a row with the labels of a published one:
    /// `ATSplat (nano) on simulated rooms …`.
    pub text: String,
    /// The same without a method.
    #[serde(skip)]
    pub place: String,
    /// Whether this is the whole of a published protocol: its data, index and preset.
    pub published_setting: bool,
}

/// What was run for the columns with a heading.
pub(super) struct ProtocolRun<'a> {
    pub(super) heading: &'a str,
    pub(super) run: MethodRun<'a>,
}

/// Data and size of images, with each number of scenes and the headings that have it.
struct Place<'a> {
    text: String,
    scenes: Vec<(String, Vec<&'a str>)>,
}

impl Place<'_> {
    /// `simulated rooms, 128×128, 8 of 24 scenes`; headings appear only where numbers of scenes differ.
    fn in_words(&self) -> String {
        match self.scenes.as_slice() {
            [(scenes, _)] => format!("{}, {scenes}", self.text),
            several => {
                let several = several.iter().map(|(scenes, headings)| format!("{scenes} ({})", headings.join(", ")));
                format!("{}: {}", self.text, several.collect::<Vec<_>>().join(", "))
            }
        }
    }
}

impl MeasuredOn {
    /// Of all protocols behind a row; `method` is named first.
    pub(super) fn of(protocol_runs: &[ProtocolRun<'_>], method: Option<String>) -> Self {
        let mut places: Vec<Place<'_>> = Vec::new();
        for ProtocolRun { heading, run } in protocol_runs {
            let MethodRun { part, .. } = run;
            let text = [Some(part.data()), run.size()].into_iter().flatten().collect::<Vec<_>>().join(", ");
            let at = places.iter().position(|place| place.text == text).unwrap_or_else(|| {
                places.push(Place { text, scenes: Vec::new() });
                places.len() - 1
            });
            let (scenes, known) = (run.scenes(), &mut places[at].scenes);
            match known.iter_mut().find(|(other, _)| *other == scenes) {
                Some((_, headings)) => headings.push(heading),
                None => known.push((scenes, vec![*heading])),
            }
        }
        let place = places.iter().map(Place::in_words).collect::<Vec<_>>().join("; ");
        let is_published = |run: &MethodRun<'_>| run.part.difference_from_published(&[run.method_name()]).is_none();
        Self {
            text: method.map_or_else(|| place.clone(), |method| format!("{method} on {place}")),
            place,
            published_setting: protocol_runs.iter().all(|protocol_run| is_published(&protocol_run.run)),
        }
    }
}

impl<'a> MethodRun<'a> {
    /// Height and width of the compared images; `None` without any.
    pub(super) fn size(self) -> Option<String> {
        let sizes: BTreeSet<(u32, u32)> =
            self.targets().map(|row| (row.height, row.width)).filter(|size| size.0 > 0).collect();
        let (first, last) = (sizes.first()?, sizes.last()?);
        let print = |(height, width): &(u32, u32)| format!("{height}×{width}");
        Some(if first == last { print(first) } else { format!("{} to {}", print(first), print(last)) })
    }

    /// Scenes with scored targets of those of the protocol, and what else differs from it.
    fn scenes(self) -> String {
        let part = self.part;
        let mut text = self.scored_scenes();
        text.push_str(&self.other_context_views());
        text.push_str(&self.targets_without_score());
        if let Some(shard) = part.source.results.provenance.part() {
            text.push_str(&format!(", {shard} of the run"));
        }
        if part.has_unpublished_index() {
            text.push_str(", unpublished index");
        }
        if let Some(index) = part.alternative_index() {
            text.push_str(&format!(", alternative index {}", index.name));
        }
        if let Some(other) = OtherPreset::of(part.preset) {
            text.push_str(&format!(", {}", other.in_words()));
        }
        text
    }

    /// `8 of 24 scenes`, and of how many index entries where the number of all scenes is not known.
    fn scored_scenes(self) -> String {
        let scenes = self.scenes_with(TargetStatus::Scored).len() as u64;
        match (scenes, self.part.scenes_there()) {
            (1, Some(0 | 1)) => "1 scene".to_owned(),
            (scenes, Some(all)) if scenes == all => format!("all {all} scenes"),
            (scenes, Some(all)) if scenes < all => format!("{scenes} of {all} scenes"),
            (scenes, Some(_)) => counted(scenes, "scene"),
            (scenes, None) => {
                let PresetRecord { entries, entries_of_index, .. } = self.part.preset;
                format!("{}, {entries} of {entries_of_index} index entries", counted(scenes, "scene"))
            }
        }
    }

    /// The numbers of context views of its trials, such as `2` or `2 and 3`, and the noun after them; `None` without trials.
    pub(super) fn context_views(self) -> Option<(String, String)> {
        let views = self.trials().map(|trial| trial.context.len() as u64);
        let found: BTreeSet<u64> = views.filter(|views| *views > 0).collect();
        let most = found.last().copied()?;
        let numbers: Vec<String> = found.iter().map(u64::to_string).collect();
        Some((numbers.join(" and "), noun(most, "context view")))
    }

    /// `, 3 context views`, if the protocol, or the published one whose columns the row fills, has another number; else empty.
    fn other_context_views(self) -> String {
        let Part { preset, protocol, .. } = self.part;
        let published = Preset::named(preset.published()).ok().map(|published| published.index.context_views);
        let stated = [Some(protocol.index.context_views), published];
        match self.context_views() {
            Some((numbers, views)) if stated.into_iter().flatten().any(|stated| stated.to_string() != numbers) => {
                format!(", {numbers} {views}")
            }
            _ => String::new(),
        }
    }

    /// `, 3 of 21 targets failed` and the like; empty if all have a score.
    fn targets_without_score(self) -> String {
        let targets: Vec<&TargetRow> = self.targets().collect();
        let with = |status| targets.iter().filter(move |row| row.status == status);
        let unsupported = self.results().unsupported_keys();
        let (not_applicable, failed): (Vec<&TargetRow>, Vec<&TargetRow>) =
            with(TargetStatus::Failed).copied().partition(|row| unsupported.contains(&row.key));
        // Copies of a context view are common among targets; here only where a scene has nothing else.
        let (scored, copied) = (self.scenes_with(TargetStatus::Scored), self.scenes_with(TargetStatus::Identical));
        let identical = if copied.is_subset(&scored) { 0 } else { with(TargetStatus::Identical).count() };
        let counts = [
            (failed.len(), "failed"),
            (with(TargetStatus::NonFinite).count(), "not finite"),
            (not_applicable.len(), "not applicable"),
            (identical, "identical to the truth"),
        ];
        let counts = counts.into_iter().filter(|(count, _)| *count > 0);
        counts.map(|(count, what)| format!(", {count} of {} targets {what}", targets.len())).collect()
    }

    /// The scenes with a target of this status.
    fn scenes_with(self, status: TargetStatus) -> BTreeSet<&'a str> {
        self.targets().filter(|row| row.status == status).map(|row| row.key.scene.as_str()).collect()
    }
}

impl Part<'_> {
    /// Whether the index is none of those that the protocol accepts.
    fn has_unpublished_index(&self) -> bool {
        !self.protocol.index.accepted.is_empty() && self.preset.index_name.is_none()
    }

    /// Scenes of the index that was run: the number that the protocol states is that of its published index. `None` for another
    /// index in an older store, unless all of its entries were processed.
    fn scenes_there(&self) -> Option<u64> {
        let (record, stated) = (self.preset, self.protocol.index.scenes);
        if self.has_unpublished_index() {
            let all_known = || (record.entries == record.entries_of_index).then(|| self.scenes_with_entries());
            return record.scenes_of_index.or_else(all_known);
        }
        // A protocol without accepted indices, such as one for captures, states the least number.
        let states_least = self.protocol.index.accepted.is_empty();
        let found =
            record.scenes_of_index.filter(|all| self.alternative_index().is_some() || (states_least && *all > stated));
        Some(found.unwrap_or(stated))
    }

    /// Scenes of which an entry was processed, with a trial or without.
    fn scenes_with_entries(&self) -> u64 {
        let results = self.source.results;
        let trials = results.trials.iter().filter(|trial| trial.key.preset == self.preset.name);
        let skipped = results.provenance.skipped.iter().filter(|entry| entry.preset == self.preset.name);
        let scenes = trials.map(|trial| trial.key.scene.as_str()).chain(skipped.map(|entry| entry.scene.as_str()));
        scenes.collect::<BTreeSet<_>>().len() as u64
    }
}
