use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_rooms::{Request, SceneKind, SceneSeed, SimulatedScenes, Split};

use crate::EvalError;

/// The simulated scenes of an index at the size that the preset expects. `None` if the
/// preset's dataset is not simulated.
///
/// # Errors
/// [`EvalError::Settings`] for a scene key without a seed, and for a preset without an image size.
pub fn simulated(preset: &Preset, index: &EvaluationIndex) -> Result<Option<SimulatedScenes>, EvalError> {
    let Some(kind) = SceneKind::named(&preset.dataset) else { return Ok(None) };
    let size = preset.preprocessing.expected_size.ok_or_else(|| EvalError::Settings {
        what: "preset of simulated scenes",
        expected: "preprocessing.expected-size, the size to simulate".to_owned(),
        found: format!("none in {}", preset.name),
    })?;
    let mut scenes = SimulatedScenes::new();
    for key in index.scenes.keys() {
        let seed = seed(kind, key).ok_or_else(|| EvalError::Settings {
            what: "scene of a simulated dataset",
            expected: format!("a key such as {}", SceneSeed { split: Split::Test, number: 0 }.key(kind)),
            found: format!("{key:?}"),
        })?;
        scenes.add(Request { size, ..Request::new(kind, seed) });
    }
    Ok(Some(scenes))
}

/// Whether a dataset's id is that of simulated scenes.
pub fn is_simulated(dataset: &str) -> bool {
    SceneKind::named(dataset).is_some()
}

/// The dataset of simulated scenes that all of these keys name, `rooms` or `yards`; `None` without keys, and if any is not one of the
/// simulator's.
pub fn simulated_dataset<'a>(keys: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let keys: Vec<&str> = keys.into_iter().collect();
    let names_all = |kind: &SceneKind| !keys.is_empty() && keys.iter().all(|key| seed(*kind, key).is_some());
    SceneKind::ALL.into_iter().find(names_all).map(|kind| kind.to_string())
}

/// The seed of a scene key.
fn seed(kind: SceneKind, key: &str) -> Option<SceneSeed> {
    let number = key.rsplit('-').next()?.parse().ok()?;
    Split::ALL.map(|split| SceneSeed { split, number }).into_iter().find(|seed| seed.key(kind) == key)
}

#[cfg(test)]
mod tests {
    use atsplat_protocol::{IndexFile, NAMED_DATASETS};
    use atsplat_scene::SceneSource;

    use super::*;

    #[test]
    fn every_simulated_preset_finds_its_scenes() {
        for preset in Preset::names().map(|name| Preset::named(name).unwrap()) {
            let Some(file) = preset.index.accepted.first().and_then(|accepted| IndexFile::embedded(&accepted.name))
            else {
                assert!(simulated(&preset, &EvaluationIndex::default()).unwrap().is_none(), "{}", preset.name);
                continue;
            };
            let index = file.unwrap().index;
            let source = simulated(&preset, &index).unwrap().unwrap();
            assert_eq!(source.keys().len(), index.scenes.len());
            assert!(index.scenes.keys().all(|key| source.keys().contains(key)), "{}", preset.name);
        }
    }

    #[test]
    fn named_datasets_without_files_are_simulated() {
        let without_files = NAMED_DATASETS.iter().filter(|dataset| dataset.formats.is_empty());
        let kinds = SceneKind::ALL.map(SceneKind::name);
        assert!(without_files.map(|dataset| dataset.id).eq(kinds) && kinds.into_iter().all(is_simulated));
        assert!(!is_simulated("re10k") && !is_simulated("photos"));
    }

    #[test]
    fn simulated_scenes_are_known_by_all_of_their_keys() {
        let dataset = |keys: &[&str]| simulated_dataset(keys.iter().copied());
        assert_eq!(dataset(&["rooms-test-00000003", "rooms-train-00000012"]).as_deref(), Some("rooms"));
        assert_eq!(dataset(&["yards-test-00000003"]).as_deref(), Some("yards"));
        let others: [&[&str]; 3] =
            [&["rooms-test-00000003", "yards-test-00000003"], &["rooms-test-00000003", "rooms-mine"], &[]];
        for keys in others {
            assert_eq!(dataset(keys), None, "{keys:?}");
        }
    }

    #[test]
    fn rejects_keys_without_a_seed() {
        let preset = Preset::named("rooms-2v-128").unwrap();
        for key in ["yards-test-00000001", "rooms-test-1", "rooms-test-", "rooms", ""] {
            let mut index = EvaluationIndex::default();
            let entry = atsplat_protocol::IndexEntry { context: vec![0], target: vec![1], overlap: None };
            index.scenes.insert(key.to_owned(), vec![entry]);
            assert!(simulated(&preset, &index).is_err(), "{key:?}");
        }
    }
}
