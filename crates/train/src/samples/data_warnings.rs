use std::collections::{BTreeMap, BTreeSet};

use atsplat_scene::{Warning, WarningKind, Warnings};

/// Warnings by the data that they are about. Sources of the same data, such as those of a training with two and with four views, have
/// the same warnings: together, each counts once.
#[derive(Clone, Debug, Default)]
pub struct DataWarnings {
    /// By what the data are opened with.
    datasets: BTreeMap<String, DatasetWarnings>,
}

/// Warnings about one dataset, each counted once although scenes are loaded again and again.
#[derive(Clone, Debug, Default)]
pub(super) struct DatasetWarnings {
    /// Of opening it.
    opening: Warnings,
    /// Of loading each scene that was loaded, by its key.
    scenes: BTreeMap<String, Warnings>,
    /// Of trials: kind, scene, detail.
    trials: BTreeSet<(WarningKind, String, String)>,
}

impl DataWarnings {
    /// Those about the data that `identity` stands for.
    pub(super) fn of(identity: String, warnings: DatasetWarnings) -> Self {
        Self { datasets: BTreeMap::from([(identity, warnings)]) }
    }

    /// Adds those of another source.
    pub fn merge(&mut self, other: Self) {
        for (identity, warnings) in other.datasets {
            self.datasets.entry(identity).or_default().merge(warnings);
        }
    }

    /// All of them.
    pub fn total(&self) -> Warnings {
        let mut total = Warnings::new();
        for DatasetWarnings { opening, scenes, trials } in self.datasets.values() {
            total.merge(opening.clone());
            for warnings in scenes.values() {
                total.merge(warnings.clone());
            }
            for (kind, scene, detail) in trials {
                total.push(*kind, scene, detail);
            }
        }
        total
    }
}

impl DatasetWarnings {
    pub(super) fn new(opening: Warnings) -> Self {
        Self { opening, ..Self::default() }
    }

    /// Adds those of loading a scene, unless it was loaded before.
    pub(super) fn add_scene(&mut self, key: &str, warnings: Warnings) {
        self.scenes.entry(key.to_owned()).or_insert(warnings);
    }

    /// Adds those of a trial that no earlier trial had.
    pub(super) fn add_trial(&mut self, warnings: &Warnings) {
        let trial = warnings.kept().iter();
        self.trials.extend(trial.map(|Warning { kind, scene, detail }| (*kind, scene.clone(), detail.clone())));
    }

    fn merge(&mut self, other: Self) {
        if self.opening.total() == 0 {
            self.opening = other.opening;
        }
        for (key, warnings) in other.scenes {
            self.scenes.entry(key).or_insert(warnings);
        }
        self.trials.extend(other.trials);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One warning of opening, two of a scene's loading and one of a trial's frame.
    fn read(scene: &str, frame: u32) -> DatasetWarnings {
        let warnings = |kind, count: u32| {
            let mut warnings = Warnings::new();
            (0..count).for_each(|number| warnings.push(kind, scene, (frame + number).to_string()));
            warnings
        };
        let mut opening = Warnings::new();
        opening.push(WarningKind::IgnoredScene, "other", "of another format");
        let mut read = DatasetWarnings::new(opening);
        for _ in 0..2 {
            read.add_scene(scene, warnings(WarningKind::MissingImage, 2));
            read.add_trial(&warnings(WarningKind::UnreadableImage, 1));
        }
        read
    }

    #[test]
    fn sources_of_the_same_data_count_each_warning_once() {
        let mut all = DataWarnings::of("a".to_owned(), read("scene", 5));
        let counts = |all: &DataWarnings| {
            let kinds = [WarningKind::IgnoredScene, WarningKind::MissingImage, WarningKind::UnreadableImage];
            kinds.map(|kind| all.total().count(kind))
        };
        assert_eq!(counts(&all), [1, 2, 1]);
        all.merge(DataWarnings::of("a".to_owned(), read("scene", 5)));
        assert_eq!(counts(&all), [1, 2, 1], "another source that reads the same");
        all.merge(DataWarnings::of("a".to_owned(), read("scene", 9)));
        assert_eq!(counts(&all), [1, 2, 2], "another frame of the scene");
        all.merge(DataWarnings::of("a".to_owned(), read("another", 5)));
        assert_eq!(counts(&all), [1, 4, 3], "another scene");
        all.merge(DataWarnings::of("b".to_owned(), read("scene", 5)));
        assert_eq!(counts(&all), [2, 6, 4], "other data whose scene has the same name");
    }
}
