//! The extrapolation split: targets outside the window of context frames.

mod distance;
mod frames;
mod margin;
mod report;

use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

pub use distance::{FrameLabel, TargetDistances};
pub use frames::{SceneFrames, scene_frames, scene_lengths};
pub use margin::{InvalidMargin, Margin};
pub use report::ExtrapolationReport;

use crate::{Derivation, EvaluationIndex, IndexEntry};

/// The settings of the split. "10 frames before and after the input window" (ATSplat) states how far targets
/// extend, but not what happens if the window starts at frame 0, as it does in 109 of the 140 scenes of
/// DepthSplat's 6-view index: both readings are available, the first is the default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Extrapolation {
    /// Number of frames before and after the window that become targets.
    #[serde(default)]
    pub margin: Margin,
    /// Where the window is placed.
    #[serde(default)]
    pub placement: Placement,
    /// What happens to an entry with fewer than `2 · margin` targets after placement.
    #[serde(default)]
    pub incomplete: Incomplete,
}

impl From<Derivation> for Extrapolation {
    /// The split that a preset derives from a published index.
    fn from(derivation: Derivation) -> Self {
        let Derivation::ShiftedWindow { margin } = derivation;
        Self { margin, ..Self::default() }
    }
}

/// Where the window of context frames is placed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Placement {
    /// All context frames are shifted together by the smallest number of frames that leaves `margin` frames
    /// before and after them.
    #[default]
    Shift,
    /// The index's own context frames.
    Keep,
}

/// What happens to an entry with fewer targets than requested.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Incomplete {
    /// It is dropped and reported.
    #[default]
    Drop,
    /// It keeps the targets that exist, and is reported. An entry without any is dropped.
    Clip,
}

impl Extrapolation {
    /// Derives the split from an index and the number of frames of each scene, all of which count as usable.
    ///
    /// A scene missing from `lengths` counts as long enough and is reported in
    /// [`ExtrapolationReport::length_unknown`]. Scenes that lose all entries remain in the index as `null`.
    pub fn split(&self, index: &EvaluationIndex, lengths: &IndexMap<String, usize>) -> ExtrapolationReport {
        let scenes = lengths.iter().map(|(key, length)| (key.clone(), SceneFrames::from(*length))).collect();
        self.split_among(index, &scenes)
    }

    /// As [`Self::split`], but without the frames that `scenes` lack: a window shifts to where all of its frames and targets are, and
    /// otherwise loses targets or is dropped.
    pub fn split_among(&self, index: &EvaluationIndex, scenes: &IndexMap<String, SceneFrames>) -> ExtrapolationReport {
        let mut report = ExtrapolationReport::default();
        for (key, entries) in &index.scenes {
            report.null_scenes += usize::from(entries.is_empty());
            let scene = scenes.get(key);
            report.missing_images += scene.map_or(0, |scene| scene.missing.len());
            let moved = entries.iter().filter_map(|entry| self.derive_entry(key, entry, scene, &mut report)).collect();
            report.index.scenes.insert(key.clone(), moved);
        }
        report.targets_by_distance = TargetDistances::of(report.index.scenes.values().flatten());
        report
    }

    fn derive_entry(
        &self,
        key: &str,
        entry: &IndexEntry,
        scene: Option<&SceneFrames>,
        report: &mut ExtrapolationReport,
    ) -> Option<IndexEntry> {
        let margin = self.margin.get();
        let frames = frames_of(scene.map(|scene| scene.length));
        let Some((start, end)) = entry.window().filter(|(_, end)| *end < frames) else {
            report.invalid.push(key.to_owned());
            return None;
        };
        report.length_unknown += usize::from(scene.is_none());
        report.started_at_zero += usize::from(start == 0);
        let span = end - start;
        let is_there = |frame: &usize| scene.is_none_or(|scene| !scene.missing.contains(frame));
        let placed = |new_start: usize| -> (Vec<usize>, Vec<usize>) {
            let after = new_start + span + 1;
            let before = new_start.saturating_sub(margin)..new_start;
            let context = entry.context.iter().map(|frame| frame - start + new_start).collect();
            (context, before.chain(after..frames.min(after + margin)).collect())
        };
        let is_whole = |new_start: &usize| {
            let (context, target) = placed(*new_start);
            target.len() == 2 * margin && context.iter().chain(&target).all(is_there)
        };
        let new_start = match self.placement {
            Placement::Keep => start,
            Placement::Shift => {
                let has_gaps = scene.is_some_and(|scene| !scene.missing.is_empty());
                let candidates = has_gaps.then(|| margin..=frames.saturating_sub(span + margin + 1));
                let whole = candidates.into_iter().flatten().filter(is_whole);
                let nearest = whole.min_by_key(|candidate| candidate.abs_diff(start));
                nearest.unwrap_or_else(|| shifted_start(start, span, margin, frames))
            }
        };
        let (context, mut target) = placed(new_start);
        let has_room = target.len() == 2 * margin;
        target.retain(is_there);
        let has_context = context.iter().all(is_there);
        if has_context && target.len() == 2 * margin {
            report.complete += 1;
        } else if has_context && self.incomplete == Incomplete::Clip && !target.is_empty() {
            report.clipped.push(key.to_owned());
        } else {
            let cause = if has_room || !has_context {
                &mut report.without_image
            } else if scene.is_some() && span + 1 + 2 * margin > frames {
                &mut report.too_short
            } else if new_start < margin {
                &mut report.no_room_before
            } else {
                &mut report.no_room_after
            };
            cause.push(key.to_owned());
            return None;
        }
        report.shifted_later += usize::from(new_start > start);
        report.shifted_earlier += usize::from(new_start < start);
        Some(IndexEntry { context, target, overlap: entry.overlap.clone().filter(|_| new_start == start) })
    }
}

/// The number of frames of a scene that an index can refer to.
fn frames_of(length: Option<usize>) -> usize {
    let nameable = IndexEntry::MAX_FRAME + 1;
    length.map_or(nameable, |length| length.min(nameable))
}

/// The start nearest to `start` with `margin` frames before the window and after its end; `start` itself if the scene
/// has no room for both.
fn shifted_start(start: usize, span: usize, margin: usize, frames: usize) -> usize {
    match frames.checked_sub(span + margin + 1) {
        Some(latest) if latest >= margin => start.clamp(margin, latest),
        _ => start,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn index_of(contexts: &[(&str, &[usize])]) -> EvaluationIndex {
        let entry =
            |context: &[usize]| IndexEntry { context: context.to_vec(), target: vec![1], overlap: Some(0.5.into()) };
        let scenes = contexts.iter().map(|(key, context)| ((*key).to_owned(), vec![entry(context)])).collect();
        EvaluationIndex { scenes }
    }

    fn lengths(of: &[(&str, usize)]) -> IndexMap<String, usize> {
        of.iter().map(|(key, length)| ((*key).to_owned(), *length)).collect()
    }

    #[test]
    fn windows_shift_no_farther_than_necessary() {
        let index = index_of(&[("start", &[0, 20, 49]), ("near", &[3, 49]), ("room", &[12, 30]), ("end", &[40, 55])]);
        let report = Extrapolation::default()
            .split(&index, &lengths(&[("start", 300), ("near", 300), ("room", 41), ("end", 60)]));
        let moved = |key: &str| report.index.scenes[key][0].clone();
        assert_eq!(moved("start").context, [10, 30, 59]);
        assert_eq!(moved("start").target, (0..10).chain(60..70).collect::<Vec<_>>());
        assert_eq!(moved("near").context, [10, 56]);
        assert_eq!(
            (moved("room").context, moved("room").overlap),
            (vec![12, 30], Some(0.5.into())),
            "frame 40 is the last"
        );
        assert_eq!((moved("end").context, moved("end").overlap), (vec![34, 49], None), "another pair of frames");
        assert_eq!(
            (report.started_at_zero, report.shifted_later, report.shifted_earlier, report.complete),
            (1, 2, 1, 4)
        );
        assert_eq!(report.targets_by_distance.to_string(), "-10 to -1: 4 each, 1 to 10: 4 each");
    }

    #[test]
    fn a_scene_one_frame_too_short_is_dropped_or_clipped() {
        let index = index_of(&[("exact", &[0, 9]), ("short", &[0, 9])]);
        let frames = lengths(&[("exact", 30), ("short", 29)]);
        let dropped = Extrapolation::default().split(&index, &frames);
        assert_eq!((dropped.too_short, dropped.complete), (vec!["short".to_owned()], 1));
        assert!(dropped.index.scenes["short"].is_empty(), "still a key of the index");
        let clip = Extrapolation { incomplete: Incomplete::Clip, ..Extrapolation::default() };
        let clipped = clip.split(&index, &frames);
        assert_eq!(clipped.index.scenes["short"][0].target, (10..20).collect::<Vec<_>>());
        assert_eq!(clipped.clipped, ["short"]);
    }

    /// The last 40 frames of one scene have no image, and one frame of each of the others.
    #[test]
    fn frames_without_an_image_are_neither_targets_nor_context() {
        let index = index_of(&[("end", &[60, 79]), ("hole", &[31, 41]), ("tight", &[10, 19]), ("whole", &[10, 19])]);
        let scene = |length: usize, missing: std::ops::Range<usize>| SceneFrames { length, missing: missing.collect() };
        let scenes = [("end", scene(120, 80..120)), ("hole", scene(100, 45..46)), ("tight", scene(30, 5..6))];
        let scenes: IndexMap<_, _> = scenes.into_iter().map(|(key, frames)| (key.to_owned(), frames)).collect();
        let report = Extrapolation::default().split_among(&index, &scenes);
        let moved = |report: &ExtrapolationReport, key: &str| report.index.scenes[key][0].clone();
        let both =
            |before: std::ops::Range<usize>, after: std::ops::Range<usize>| before.chain(after).collect::<Vec<_>>();
        assert_eq!((moved(&report, "end").context, moved(&report, "end").target), (vec![50, 69], both(40..50, 70..80)));
        // Frame 45 is in the window, but no context frame.
        assert_eq!(
            (moved(&report, "hole").context, moved(&report, "hole").target),
            (vec![36, 46], both(26..36, 47..57))
        );
        assert_eq!((report.without_image.clone(), report.dropped(), report.complete), (vec!["tight".to_owned()], 1, 3));
        assert_eq!((report.missing_images, report.shifted_earlier, report.shifted_later), (42, 1, 1));
        assert!(report.to_string().contains("     42  frames without an image or a usable pose"), "{report}");

        let clip = Extrapolation { incomplete: Incomplete::Clip, ..Extrapolation::default() };
        let clipped = clip.split_among(&index, &scenes);
        let left: Vec<usize> = (0..10).filter(|frame| *frame != 5).chain(20..30).collect();
        assert_eq!((moved(&clipped, "tight").target, clipped.clipped), (left, vec!["tight".to_owned()]));

        let keep = Extrapolation { placement: Placement::Keep, ..clip };
        let kept = keep.split_among(&index_of(&[("hole", &[30, 45])]), &scenes);
        assert_eq!(
            (kept.without_image, kept.clipped.len()),
            (vec!["hole".to_owned()], 0),
            "a context frame is missing"
        );
    }

    #[test]
    fn unshifted_windows_are_clipped_at_the_start() {
        let keep =
            Extrapolation { placement: Placement::Keep, incomplete: Incomplete::Clip, ..Extrapolation::default() };
        let report = keep.split(&index_of(&[("a", &[4, 9])]), &lengths(&[("a", 100)]));
        assert_eq!(report.index.scenes["a"][0].target, (0..4).chain(10..20).collect::<Vec<_>>());
        assert_eq!((report.shifted_later, report.clipped.len()), (0, 1));
    }

    #[test]
    fn reports_unknown_lengths_and_invalid_entries() {
        let mut index =
            index_of(&[("unknown", &[0, 9]), ("outside", &[0, 90]), ("none", &[]), ("huge", &[usize::MAX])]);
        index.scenes.insert("null".to_owned(), Vec::new());
        let report = Extrapolation::default().split(&index, &lengths(&[("outside", 90), ("none", 50)]));
        assert_eq!(report.invalid, ["outside", "none", "huge"], "no file can name frame 2^64 - 1");
        assert_eq!((report.length_unknown, report.null_scenes), (1, 1));
        assert_eq!(report.index.scenes["unknown"][0].target.len(), 20);
    }

    /// The split can be written and read back: no frame exceeds [`IndexEntry::MAX_FRAME`].
    #[test]
    fn no_target_exceeds_the_largest_frame_number_of_a_file() {
        let last = IndexEntry::MAX_FRAME;
        let index = index_of(&[("fits", &[last - 20, last - 10]), ("moves", &[last - 9, last - 5])]);
        for placement in [Placement::Shift, Placement::Keep] {
            let report = Extrapolation { placement, ..Extrapolation::default() }.split(&index, &IndexMap::new());
            let written = report.index.to_json(&crate::IndexLayout::PIXELSPLAT);
            assert_eq!(EvaluationIndex::from_json(written.as_bytes()).unwrap(), report.index);
            assert_eq!(report.index.scenes["fits"][0].target.last(), Some(&last));
            let kept = placement == Placement::Keep;
            assert_eq!((report.shifted_earlier, report.no_room_after.len()), if kept { (0, 1) } else { (1, 0) });
        }
    }

    #[test]
    fn dropped_entries_are_reported_by_reason() {
        let keep = Extrapolation { placement: Placement::Keep, ..Extrapolation::default() };
        let index = index_of(&[
            ("start", &[9, 30]),
            ("end", &[12, 30]),
            ("short", &[5, 30]),
            ("unknown", &[9, 30]),
            ("tight", &[12, 30]),
        ]);
        let report = keep.split(&index, &lengths(&[("start", 300), ("end", 40), ("short", 45), ("tight", 39)]));
        assert_eq!(report.no_room_before, ["start", "unknown"], "an unknown length is not a reason");
        assert_eq!(report.no_room_after, ["end", "tight"], "39 frames are enough for 19 and two margins");
        assert_eq!(report.too_short, ["short"]);
    }

    proptest! {
        #[test]
        fn every_complete_entry_has_both_margins(
            start in 0usize..50, span in 0usize..60, length in 1usize..160, margin in 1usize..15,
        ) {
            let index = index_of(&[("a", &[start, start + span])]);
            let split = Extrapolation { margin: Margin::try_from(margin).unwrap(), ..Extrapolation::default() };
            let report = split.split(&index, &lengths(&[("a", length)]));
            let possible = start + span < length && span + 1 + 2 * margin <= length;
            prop_assert_eq!(report.complete == 1, possible, "complete iff the scene has room");
            for entry in &report.index.scenes["a"] {
                let (a, b) = (entry.context[0], entry.context[1]);
                prop_assert_eq!(b - a, span);
                prop_assert_eq!(&entry.target, &(a - margin..a).chain(b + 1..=b + margin).collect::<Vec<_>>());
                prop_assert!(b + margin < length);
                let had_room = start >= margin && start + span + margin < length;
                prop_assert!(!had_room || a == start, "shifted unnecessarily");
                let again = split.split(&report.index, &lengths(&[("a", length)]));
                prop_assert_eq!(again.index, report.index.clone(), "splitting again changes nothing");
            }
        }
    }
}
