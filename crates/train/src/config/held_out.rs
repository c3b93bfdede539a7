//! Whether an evaluation during training is on scenes that the network has not seen.

use std::path::Path;

use atsplat_camera::PoseNormalisation;
use atsplat_model::weights::training_data;
use atsplat_rooms::{SceneKind, Split};
use atsplat_scene::Warnings;

use super::{SourceConfig, TrainConfig};
use crate::checkpoint::InitialWeights;
use crate::samples::{DatasetConfig, DatasetSource, RoomsConfig};

impl TrainConfig {
    /// Whether, by what the configuration names, this run never trains on the evaluation's scenes: simulated scenes of another kind,
    /// split or seed range, or scenes of another dataset folder with other names. Datasets are opened to compare the names, not the
    /// content: a copy of a dataset under other names counts as another one. Weights that the run starts from must not have seen the
    /// scenes either: those must be simulated, and their record must name nothing but other simulated scenes.
    pub fn is_evaluation_held_out(&self, initial_weights: Option<&InitialWeights>) -> bool {
        let differs = |source: &SourceConfig| {
            self.data.iter().all(|data| are_disjoint(&data.source, source, &self.pose_normalisation))
                && initial_weights.is_none_or(|weights| is_unseen(source, weights))
        };
        self.evaluation.as_ref().is_some_and(|evaluation| differs(&evaluation.source))
    }
}

/// Whether a source's scenes are none of those that given weights were trained on, by their record.
fn is_unseen(source: &SourceConfig, weights: &InitialWeights) -> bool {
    let (SourceConfig::Rooms(rooms), Some(data)) = (source, &weights.data) else { return false };
    let mut sources = training_data::sources(data).flat_map(|source| source.split(" and "));
    sources.all(|source| RecordedScenes::parse(source).is_some_and(|recorded| recorded.are_others_than(rooms)))
}

/// Simulated scenes in a record of training data.
struct RecordedScenes {
    kind: SceneKind,
    split: Split,
    /// The first and the last, if they are recorded.
    numbers: Option<(u32, u32)>,
}

impl RecordedScenes {
    /// From `2 × rooms train 0 to 9 at 64x64 (2 views)` or `6000 rooms of the train split at 64x64`; `None` for other data.
    fn parse(text: &str) -> Option<Self> {
        let scenes = text.split_once(" (").map_or(text, |(scenes, _)| scenes);
        let words: Vec<&str> = scenes.split(' ').collect();
        let (kind, split, numbers) = match words.as_slice() {
            [_, "×", kind, split, first, "to", last, "at", _] | [kind, split, first, "to", last, "at", _] => {
                (*kind, *split, Some((first.parse::<u32>().ok()?, last.parse::<u32>().ok()?)))
            }
            [_, kind, "of", "the", split, "split", "at", _] => (*kind, *split, None),
            _ => return None,
        };
        Some(Self { kind: SceneKind::named(kind)?, split: Split::named(split)?, numbers })
    }

    fn are_others_than(&self, rooms: &RoomsConfig) -> bool {
        let has_other_numbers = |(first, last): (u32, u32)| last < rooms.first || rooms.last() < first;
        self.kind != rooms.scenes_of || self.split != rooms.split || self.numbers.is_some_and(has_other_numbers)
    }
}

fn are_disjoint(a: &SourceConfig, b: &SourceConfig, normalisation: &PoseNormalisation) -> bool {
    match (a, b) {
        (SourceConfig::Rooms(a), SourceConfig::Rooms(b)) => {
            let other_numbers = a.last() < b.first || b.last() < a.first;
            a.scenes_of != b.scenes_of || a.split != b.split || other_numbers
        }
        (SourceConfig::Dataset(a), SourceConfig::Dataset(b)) => {
            let resolved = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
            let (path_a, path_b) = (resolved(&a.path), resolved(&b.path));
            if path_a.starts_with(&path_b) || path_b.starts_with(&path_a) {
                return false;
            }
            let open = |config: &DatasetConfig| {
                DatasetSource::open(config.clone(), normalisation.clone(), &mut Warnings::new()).ok()
            };
            // Two folders may contain copies of one dataset: those with the same keys are recognised. Nothing is known of one that cannot be
            // opened.
            open(a).zip(open(b)).is_some_and(|(a, b)| !a.shares_a_scene_with(&b))
        }
        // A folder may contain simulated scenes.
        (SourceConfig::Rooms(_), SourceConfig::Dataset(_)) | (SourceConfig::Dataset(_), SourceConfig::Rooms(_)) => {
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 10 training scenes from number 5 on, and an evaluation on another source.
    fn held_out(data: &str, evaluation: &str) -> bool {
        held_out_after(data, evaluation, None)
    }

    /// The same from weights that were trained before.
    fn held_out_after(data: &str, evaluation: &str, before: Option<&InitialWeights>) -> bool {
        let text = format!(
            r#"
            title = "two sources"
            seed = 1
            steps = 8
            batch = 1
            model = {{ base = "nano" }}
            [[data]]
            {data}
            [evaluation]
            every = 1
            samples = 1
            {evaluation}
            "#
        );
        TrainConfig::from_toml(&text).unwrap().is_evaluation_held_out(before)
    }

    const VIEWS: &str = "views = { context = [2, 2], targets = 1, gaps = { min = 1, max = 2 } }";

    fn rooms(more: &str) -> String {
        format!("source.rooms = {{ size = [256, 256], {VIEWS}, {more} }}")
    }

    #[test]
    fn simulated_scenes_differ_by_kind_split_or_number() {
        let data = rooms("scenes-of = 'rooms', scenes = 10, first = 5");
        for (evaluation, expected) in [
            ("scenes-of = 'rooms', scenes = 10, first = 5", false),
            ("scenes-of = 'rooms', scenes = 1, first = 14", false),
            ("scenes-of = 'rooms', scenes = 6", false),
            ("scenes-of = 'rooms', scenes = 5", true),
            ("scenes-of = 'rooms', scenes = 1, first = 15", true),
            ("scenes-of = 'rooms', scenes = 10, first = 5, split = 'test'", true),
            ("scenes-of = 'yards', scenes = 10, first = 5", true),
        ] {
            assert_eq!(held_out(&data, &rooms(evaluation)), expected, "{evaluation}");
        }
        assert!(!TrainConfig::shortest().is_evaluation_held_out(None), "no evaluation");
    }

    #[test]
    fn scenes_that_the_initial_weights_may_have_seen_are_not_held_out() {
        const EMBEDDED: &str =
            "rooms train 200000 to 207039 at 128x128; before: 6000 rooms of the train split at 128x128";
        const YARDS: &str = "1600 yards of the train split at 128x128 and 6000 rooms of the train split at 128x128";
        let data = rooms("scenes-of = 'rooms', scenes = 10, first = 500");
        let after = |before: Option<&str>, evaluation: &str| {
            let data_before = before.map(str::to_owned);
            let weights = InitialWeights { sha256: "00ff".to_owned(), data: data_before, differences: None };
            held_out_after(&data, &rooms(evaluation), Some(&weights))
        };
        let (test, train) =
            ("scenes-of = 'rooms', scenes = 4, split = 'test'", "scenes-of = 'rooms', scenes = 4, first = 7");
        let yards = "scenes-of = 'yards', scenes = 4";
        let views = "at 64x64 (2 views, gaps 4 to 9, targets 2, stride 10, generation 2)";
        for (before, evaluation, expected) in [
            (EMBEDDED, test, true),
            (EMBEDDED, train, false),
            (EMBEDDED, yards, true),
            (YARDS, test, true),
            (YARDS, yards, false),
            (&format!("1 × rooms test 0 to 3 {views}"), test, false),
            (&format!("1 × rooms test 4 to 9 {views}"), test, true),
            (&format!("1 × rooms train 0 to 6 {views} + 0.5 × yards train 0 to 3 {views}"), train, true),
            (&format!("1 × rooms train 0 to 7 {views}"), train, false),
            (&format!("1 × rooms train 0 to 3 {views}; before: 1 × rooms test 3 to 3 {views}"), test, false),
            (&format!("1 × rooms train 0 to 3 {views} + 1 × ch under mine-128.toml (2 views)"), test, false),
            ("1 × rooms/train under rooms-2v-128 (2 views)", test, false),
            ("gardens train 0 to 3 at 64x64", test, false),
        ] {
            assert_eq!(after(Some(before), evaluation), expected, "{before}: {evaluation}");
        }
        assert!(!after(None, test), "not stated");
    }

    #[test]
    fn datasets_differ_if_neither_folder_contains_the_other_and_no_scene_is_in_both() {
        let folder = tempfile::tempdir().unwrap();
        for scene in ["train/aaa", "train/bbb", "test/ccc", "copy/bbb", "copy/ccc", "subset/1K/aaa"] {
            let scene = folder.path().join(scene);
            std::fs::create_dir_all(&scene).unwrap();
            std::fs::write(scene.join("transforms.json"), "{}").unwrap();
        }
        let index = r#"{"bbb": null}"#;
        std::fs::write(folder.path().join("index.json"), index).unwrap();
        let dataset = |path: &str, more: &str| {
            let path = folder.path().join(path);
            format!("source.dataset = {{ path = '{}', preset = 'dl3dv-2v-256x448', {VIEWS}{more} }}", path.display())
        };
        let train = dataset("train", "");
        for (evaluation, expected) in [
            ("train", false),
            ("", false),
            ("train/aaa", false),
            ("test", true),
            ("copy", false),
            ("subset", false),
            ("absent", false),
        ] {
            assert_eq!(held_out(&train, &dataset(evaluation, "")), expected, "{evaluation}");
        }
        assert!(!held_out(&train, &rooms("scenes-of = 'rooms', scenes = 1, split = 'test'")));
        let sha256 = atsplat_files::Sha256Digest::of(index.as_bytes());
        let index = folder.path().join("index.json");
        let exclude = format!(", exclude = [{{ index = '{}', sha256 = '{sha256}' }}]", index.display());
        assert!(
            held_out(&dataset("train", &exclude), &dataset("copy", "")),
            "the training never draws the scene in both"
        );
    }
}
