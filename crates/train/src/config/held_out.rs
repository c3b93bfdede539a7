//! Whether an evaluation during training is on scenes that training does not see.

use std::path::Path;

use super::{SourceConfig, TrainConfig};

impl TrainConfig {
    /// Whether the evaluation's scenes are known to be none of those that this run trains on: simulated ones of another kind,
    /// of the other split or with other numbers, or those of another folder. Weights that the run starts from may have seen them.
    pub fn is_evaluation_held_out(&self) -> bool {
        let differs = |source: &SourceConfig| self.data.iter().all(|data| are_disjoint(&data.source, source));
        self.evaluation.as_ref().is_some_and(|evaluation| differs(&evaluation.source))
    }
}

fn are_disjoint(a: &SourceConfig, b: &SourceConfig) -> bool {
    match (a, b) {
        (SourceConfig::Rooms(a), SourceConfig::Rooms(b)) => {
            let other_numbers = a.last() < b.first || b.last() < a.first;
            a.scenes_of != b.scenes_of || a.split != b.split || other_numbers
        }
        (SourceConfig::Dataset(a), SourceConfig::Dataset(b)) => {
            let resolved = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
            let (a, b) = (resolved(&a.path), resolved(&b.path));
            !a.starts_with(&b) && !b.starts_with(&a)
        }
        // A folder may hold simulated scenes.
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
    fn datasets_differ_if_neither_folder_holds_the_other() {
        let dataset = |path: &str| format!("source.dataset = {{ path = '{path}', preset = 're10k-2v-256', {VIEWS} }}");
        for (evaluation, expected) in
            [("re10k/train", false), ("re10k", false), ("re10k/train/one", false), ("re10k/test", true)]
        {
            assert_eq!(held_out(&dataset("re10k/train"), &dataset(evaluation)), expected, "{evaluation}");
        }
        assert!(!held_out(&dataset("re10k/train"), &rooms("scenes-of = 'rooms', scenes = 1, split = 'test'")));
    }
}
