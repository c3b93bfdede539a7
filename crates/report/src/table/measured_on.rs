//! What a row was measured on, in words for the row itself: a row pasted without its table's notes still says so.

use std::collections::BTreeSet;
use std::path::Path;

use atsplat_eval::{PresetRecord, TargetRow, TargetStatus};
use serde::Serialize;

use super::difference::is_changed;
use super::edition::Part;
use crate::counted;
use crate::definition::dataset_name;

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

/// A protocol that was run, for the columns with a heading.
pub(super) struct ProtocolRun<'a> {
    pub(super) heading: &'a str,
    pub(super) part: &'a Part<'a>,
    pub(super) method: &'a str,
}

impl MeasuredOn {
    /// Of all protocols behind a row; headings appear only where numbers of scenes differ. `method` is named first.
    #[expect(clippy::type_complexity, reason = "a list of lists, for a moment")]
    pub(super) fn of(ran: &[ProtocolRun<'_>], method: Option<String>) -> Self {
        // Data and size, with each number of scenes and the headings that have it.
        let mut places: Vec<(String, Vec<(String, Vec<&str>)>)> = Vec::new();
        for ProtocolRun { heading, part, method } in ran {
            let place = [Some(part.data()), part.size(method)].into_iter().flatten().collect::<Vec<_>>().join(", ");
            let at = places.iter().position(|(known, _)| *known == place).unwrap_or_else(|| {
                places.push((place, Vec::new()));
                places.len() - 1
            });
            let (scenes, counts) = (part.scenes(method), &mut places[at].1);
            match counts.iter_mut().find(|(known, _)| *known == scenes) {
                Some((_, headings)) => headings.push(heading),
                None => counts.push((scenes, vec![*heading])),
            }
        }
        let text = places.iter().map(|(place, counts)| match counts.as_slice() {
            [(scenes, _)] => format!("{place}, {scenes}"),
            several => {
                let several = several.iter().map(|(scenes, headings)| format!("{scenes} ({})", headings.join(", ")));
                format!("{place}: {}", several.collect::<Vec<_>>().join(", "))
            }
        });
        let place = text.collect::<Vec<_>>().join("; ");
        Self {
            text: method.map_or_else(|| place.clone(), |method| format!("{method} on {place}")),
            place,
            published_setting: ran.iter().all(|ran| ran.part.difference(&[ran.method]).is_none()),
        }
    }
}

impl Part<'_> {
    /// The data in words: `RE10K`, `simulated rooms`, `capture fox`.
    pub(super) fn data(&self) -> String {
        match self.protocol.dataset.as_str() {
            kind @ ("rooms" | "yards") => format!("simulated {kind}"),
            known @ ("re10k" | "acid" | "dl3dv") => dataset_name(known).to_owned(),
            _ => {
                let path = Path::new(&self.preset.dataset);
                let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
                format!("capture {}", name.unwrap_or_else(|| self.preset.dataset.clone()))
            }
        }
    }

    /// Height and width of the compared images; `None` without any.
    pub(super) fn size(&self, method: &str) -> Option<String> {
        let targets = self.source.results.targets.iter();
        let own = targets.filter(|row| row.key.preset == self.preset.name && row.key.method == method);
        let sizes: BTreeSet<(u32, u32)> = own.map(|row| (row.height, row.width)).filter(|size| size.0 > 0).collect();
        let (first, last) = (sizes.first()?, sizes.last()?);
        let print = |(height, width): &(u32, u32)| format!("{height}×{width}");
        Some(if first == last { print(first) } else { format!("{} to {}", print(first), print(last)) })
    }

    /// Scenes with scored targets of those of the protocol, and what else differs from it.
    fn scenes(&self, method: &str) -> String {
        let is_own = |row: &&TargetRow| row.key.preset == self.preset.name && row.key.method == method;
        let rows: Vec<&TargetRow> = self.source.results.targets.iter().filter(is_own).collect();
        let with = |status| rows.iter().filter(move |row| row.status == status);
        let scenes_with = |status| with(status).map(|row| row.key.scene.as_str()).collect::<BTreeSet<_>>();
        let (scored, copied) = (scenes_with(TargetStatus::Scored), scenes_with(TargetStatus::Identical));
        let scenes = scored.len() as u64;
        let unsupported = self.source.results.unsupported();
        let (not_applicable, failed): (Vec<&TargetRow>, Vec<&TargetRow>) =
            with(TargetStatus::Failed).copied().partition(|row| unsupported.contains(&row.key));
        let not_finite = with(TargetStatus::NonFinite).count();
        // Copies of a context view are common among targets; here only where a scene has nothing else.
        let identical = if copied.is_subset(&scored) { 0 } else { with(TargetStatus::Identical).count() };
        let all = self.scenes_there();
        let mut text = match (scenes, all) {
            (1, Some(0 | 1)) => "1 scene".to_owned(),
            (own, Some(all)) if own == all => format!("all {all} scenes"),
            (own, Some(all)) if own < all => format!("{own} of {all} scenes"),
            (own, _) => counted(own, "scene"),
        };
        if all.is_none() {
            let PresetRecord { entries, entries_of_index, .. } = self.preset;
            text.push_str(&format!(", {entries} of {entries_of_index} index entries"));
        }
        let without_score = [
            (failed.len(), "failed"),
            (not_finite, "not finite"),
            (not_applicable.len(), "not applicable"),
            (identical, "identical to the truth"),
        ];
        for (count, what) in without_score {
            if count > 0 {
                text.push_str(&format!(", {count} of {} targets {what}", rows.len()));
            }
        }
        if let Some(part) = self.source.results.provenance.part() {
            text.push_str(&format!(", {part} of the run"));
        }
        if self.has_own_index() {
            text.push_str(", own index");
        }
        if let Some(index) = self.alternative_index() {
            text.push_str(&format!(", alternative index {}", index.name));
        }
        if is_changed(self.preset) {
            text.push_str(", protocol changed");
        }
        text
    }

    /// Whether the index is another one than those that the protocol accepts.
    fn has_own_index(&self) -> bool {
        !self.protocol.index.accepted.is_empty() && self.preset.index_name.is_none()
    }

    /// Scenes of the index that was run: the number that the protocol states is that of its own index. `None` for another index in
    /// an older store, unless all of its entries were processed.
    fn scenes_there(&self) -> Option<u64> {
        let (record, stated) = (self.preset, self.protocol.index.scenes);
        if self.has_own_index() {
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
