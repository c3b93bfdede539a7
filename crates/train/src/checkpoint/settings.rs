//! Whether a run goes on with the settings with which it was started.

use atsplat_files::changes;
use atsplat_model::weights::StoredTensors;

use super::state::{CONFIGURATION, WHAT, entry};
use crate::error::Purpose;
use crate::samples::DatasetConfig;
use crate::{SourceConfig, TrainConfig, TrainError};

/// Settings that have changed since a checkpoint was written, and change nothing that the run computes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ChangedSettings {
    /// Which.
    pub(crate) notice: String,
    /// Which data are read from another path: that they are the same is to be checked by their samples.
    pub(crate) moved: MovedData,
}

/// Data that are read from another path than in the run so far.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct MovedData {
    /// Which sources of training data, counted from 0.
    pub(crate) training: Vec<usize>,
    /// Whether the evaluation's are.
    pub(crate) evaluation: bool,
}

impl MovedData {
    /// Whether any of the data with this purpose are.
    pub(crate) const fn contains(&self, purpose: Purpose) -> bool {
        match purpose {
            Purpose::Training => !self.training.is_empty(),
            Purpose::Evaluation => self.evaluation,
        }
    }
}

/// What has changed since a checkpoint was written, if that changes no result.
///
/// # Errors
/// [`TrainError::Malformed`] for a run with other settings, by their names.
pub(super) fn check_settings(
    stored: &StoredTensors,
    config: &TrainConfig,
) -> Result<Option<ChangedSettings>, TrainError> {
    let recorded = TrainConfig::from_toml(entry(stored, CONFIGURATION)?)?;
    let changed = |config: &TrainConfig| changes(&recorded, config).unwrap_or_else(|error| error.to_string());
    let required = with_free_settings_of(&recorded, config);
    if required != recorded {
        let expected = "that of the run, or a new run from its weights in another folder (`--init`)";
        let found = format!("other settings: {}", changed(&required));
        return Err(TrainError::malformed(WHAT, "configuration", expected, found));
    }
    if recorded == *config {
        return Ok(None);
    }
    let notice = format!("settings that change no result differ from those of the run so far: {}", changed(config));
    Ok(Some(ChangedSettings { notice, moved: moved(&recorded, config) }))
}

/// A configuration with those settings of a recorded one that change no result.
fn with_free_settings_of(recorded: &TrainConfig, config: &TrainConfig) -> TrainConfig {
    let mut same = config.clone();
    same.title.clone_from(&recorded.title);
    same.notes.clone_from(&recorded.notes);
    same.checkpoints = recorded.checkpoints;
    same.model.feature_cache.clone_from(&recorded.model.feature_cache);
    for (data, recorded) in same.data.iter_mut().zip(&recorded.data) {
        take_free_settings(&mut data.source, &recorded.source);
    }
    if let (Some(evaluation), Some(recorded)) = (&mut same.evaluation, &recorded.evaluation) {
        take_free_settings(&mut evaluation.source, &recorded.source);
    }
    same
}

/// The scenes of a dataset and their samples are compared, wherever they are.
fn take_free_settings(source: &mut SourceConfig, recorded: &SourceConfig) {
    match (source, recorded) {
        (SourceConfig::Rooms(rooms), SourceConfig::Rooms(recorded)) => rooms.cache_mib = recorded.cache_mib,
        (SourceConfig::Dataset(dataset), SourceConfig::Dataset(recorded)) => {
            dataset.path.clone_from(&recorded.path);
            if dataset.frames.is_some() == recorded.frames.is_some() {
                dataset.frames.clone_from(&recorded.frames);
            }
            for (excluded, recorded) in dataset.exclude.iter_mut().zip(&recorded.exclude) {
                // Known by its hash.
                excluded.index.clone_from(&recorded.index);
            }
        }
        (SourceConfig::Rooms(_), SourceConfig::Dataset(_)) | (SourceConfig::Dataset(_), SourceConfig::Rooms(_)) => {}
    }
}

/// Which data are at another path.
fn moved(recorded: &TrainConfig, config: &TrainConfig) -> MovedData {
    let paths = |source: &SourceConfig| match source {
        SourceConfig::Rooms(_) => None,
        SourceConfig::Dataset(DatasetConfig { path, frames, .. }) => Some((path.clone(), frames.clone())),
    };
    let evaluation = |config: &TrainConfig| config.evaluation.as_ref().map(|evaluation| paths(&evaluation.source));
    let sources = recorded.data.iter().zip(&config.data).enumerate();
    let training = sources.filter(|(_, (recorded, data))| paths(&recorded.source) != paths(&data.source));
    MovedData { training: training.map(|(at, _)| at).collect(), evaluation: evaluation(recorded) != evaluation(config) }
}

#[cfg(test)]
mod tests {
    use atsplat_files::Sha256Digest;

    use super::super::state::with_one_number;
    use super::*;
    use crate::{CheckpointConfig, Resolved};

    const DATASETS: &str = "
        title = 'two datasets'
        seed = 1
        steps = 8
        batch = 3
        model = { base = 'nano' }
        [[data]]
        source.rooms = { scenes-of = 'rooms', scenes = 1, size = [256, 256], views = VIEWS }
        [[data]]
        source.dataset = { path = 'here', preset = 're10k-2v-256', frames = 'frames', views = VIEWS, exclude = [EXCLUDED] }
        [evaluation]
        every = 1
        samples = 1
        source.dataset = { path = 'here', preset = 're10k-2v-256', views = VIEWS }
    ";
    const VIEWS: &str = "{ context = [2, 2], targets = 1, gaps = { min = 1, max = 2 } }";

    fn checked(change: impl FnOnce(&mut TrainConfig)) -> Result<Option<ChangedSettings>, String> {
        let excluded = format!("{{ index = 'index.json', sha256 = '{}' }}", "a1".repeat(32));
        let text = DATASETS.replace("VIEWS", VIEWS).replace("EXCLUDED", &excluded);
        let recorded = TrainConfig::from_toml(&text).unwrap();
        let stored = with_one_number(3, 1.0).stored(&recorded, &Resolved::default()).unwrap();
        let mut config = recorded;
        change(&mut config);
        check_settings(&stored, &config).map_err(|error| error.to_string())
    }

    fn dataset(config: &mut TrainConfig) -> &mut DatasetConfig {
        let Some(SourceConfig::Dataset(dataset)) = config.data.last_mut().map(|data| &mut data.source) else {
            panic!("a dataset")
        };
        dataset
    }

    #[test]
    fn settings_that_change_no_result_are_named() {
        assert_eq!(checked(|_| ()), Ok(None));
        let differs = |change: fn(&mut TrainConfig), expected: &str, training: &[usize], evaluation: bool| {
            let notice = format!("settings that change no result differ from those of the run so far: {expected}");
            let moved = MovedData { training: training.to_vec(), evaluation };
            assert_eq!(checked(change), Ok(Some(ChangedSettings { notice, moved })));
        };
        let named = |change: fn(&mut TrainConfig), expected: &str| differs(change, expected, &[], false);
        named(|config| config.title = "renamed".to_owned(), "title: two datasets, now renamed");
        named(|config| config.notes.push("a note".to_owned()), "notes: [], now [\"a note\"]");
        let checkpoints = |config: &mut TrainConfig| {
            config.checkpoints = CheckpointConfig { every: 7.try_into().unwrap(), keep: 5.try_into().unwrap() };
        };
        named(checkpoints, "checkpoints.every: 500, now 7; checkpoints.keep: 2, now 5");
        let cached = |config: &mut TrainConfig| config.model.feature_cache = Some("cache".into());
        named(cached, "model.feature-cache: none, now cache");
        let cached = |config: &mut TrainConfig| {
            if let Some(SourceConfig::Rooms(rooms)) = config.data.first_mut().map(|data| &mut data.source) {
                rooms.cache_mib = 64;
            }
        };
        named(cached, "data[0].source.rooms.cache-mib: 1024, now 64");
        let moved = |config: &mut TrainConfig| dataset(config).path = "there".into();
        differs(moved, "data[1].source.dataset.path: here, now there", &[1], false);
        let moved = |config: &mut TrainConfig| dataset(config).frames = Some("there".into());
        differs(moved, "data[1].source.dataset.frames: frames, now there", &[1], false);
        let moved = |config: &mut TrainConfig| dataset(config).exclude[0].index = "there.json".into();
        named(moved, "data[1].source.dataset.exclude[0].index: index.json, now there.json");
        let moved = |config: &mut TrainConfig| {
            let source = config.evaluation.as_mut().map(|evaluation| &mut evaluation.source);
            if let Some(SourceConfig::Dataset(dataset)) = source {
                dataset.path = "there".into();
            }
        };
        differs(moved, "evaluation.source.dataset.path: here, now there", &[], true);
    }

    /// What changes no result is not among them.
    #[test]
    fn other_settings_are_an_error_that_names_them() {
        let error = checked(|config| {
            config.title = "renamed".to_owned();
            config.clip = 2.0;
        });
        let error = error.unwrap_err();
        let expected = "expected that of the run, or a new run from its weights in another folder (`--init`), found other \
                        settings: clip: 1.0, now 2.0";
        assert!(error.ends_with(expected), "{error}");
        let error = checked(|config| dataset(config).frames = None).unwrap_err();
        assert!(error.ends_with("other settings: data[1].source.dataset.frames: frames, now none"), "{error}");
        let other = |config: &mut TrainConfig| dataset(config).exclude[0].sha256 = Sha256Digest([7; 32]);
        let error = checked(other).unwrap_err();
        assert!(error.contains("other settings: data[1].source.dataset.exclude[0].sha256: a1a1"), "{error}");
    }
}
