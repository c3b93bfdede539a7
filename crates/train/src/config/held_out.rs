//! Whether an evaluation during training is on scenes that training does not see.

use std::path::Path;

use atsplat_camera::PoseNormalisation;
use atsplat_scene::Warnings;

use super::{SourceConfig, TrainConfig};
use crate::samples::{DatasetConfig, DatasetSource};

impl TrainConfig {
    /// Whether, by what the configuration names, this run never trains on the evaluation's scenes: simulated scenes of another kind,
    /// split or seed range, or scenes of another dataset folder with other names. Datasets are opened to compare the names, not the
    /// content: a copy of a dataset under other names counts as another one. Weights that the run starts from may have seen the scenes.
    pub fn is_evaluation_held_out(&self) -> bool {
        let differs = |source: &SourceConfig| {
            self.data.iter().all(|data| are_disjoint(&data.source, source, &self.pose_normalisation))
        };
        self.evaluation.as_ref().is_some_and(|evaluation| differs(&evaluation.source))
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
        TrainConfig::from_toml(&text).unwrap().is_evaluation_held_out()
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
        assert!(!TrainConfig::shortest().is_evaluation_held_out(), "no evaluation");
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
