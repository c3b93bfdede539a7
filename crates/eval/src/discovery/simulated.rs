use std::collections::BTreeSet;
use std::sync::Arc;

use atsplat_protocol::{EvaluationIndex, IndexFile, Preset};

use crate::EvalError;
use crate::runner::{Dataset, PlannedIndex};
use crate::sources::simulated;

/// The first simulated stand-in of each published protocol. `max_scenes` limits the scenes of a preset, given its
/// numbers of context views and of targets.
///
/// # Errors
/// [`EvalError::Protocol`] for a broken preset or index, [`EvalError::Settings`] if a preset with an embedded index is not
/// simulated.
pub fn simulated_datasets(max_scenes: impl Fn(usize, usize) -> usize) -> Result<Vec<Dataset>, EvalError> {
    let (mut datasets, mut imitated) = (Vec::new(), BTreeSet::new());
    for name in Preset::names() {
        let preset = Preset::named(name)?;
        if preset.stands_for.as_ref().is_some_and(|published| !imitated.insert(published.clone())) {
            continue;
        }
        let Some(accepted) = preset.index.accepted.first() else { continue };
        let Some(file) = IndexFile::embedded(&accepted.name) else { continue };
        let file = file?;
        let limit = max_scenes(preset.index.context_views, preset.index.targets.1);
        let index = first_scenes(&file.index, limit);
        let left_out = (file.index.entries().count() - index.entries().count()) as u64;
        let source = simulated(&preset, &index)?.ok_or_else(|| EvalError::Settings {
            what: "protocol",
            expected: "simulated scenes".to_owned(),
            found: name.to_owned(),
        })?;
        let planned = PlannedIndex {
            index,
            description: format!("embedded: {}", accepted.name),
            sha256: file.sha256,
            name: Some(accepted.name.clone()),
            reduced_from: None,
            left_out,
            notices: std::collections::BTreeMap::new(),
        };
        let description = format!("simulated {}, test split", preset.dataset);
        datasets.push(Dataset { name: name.to_owned(), preset, source: Arc::new(source), description, index: planned });
    }
    Ok(datasets)
}

/// The first scenes: the order of simulated scenes is random anyway.
fn first_scenes(index: &EvaluationIndex, limit: usize) -> EvaluationIndex {
    let scenes = index.scenes.iter().take(limit).map(|(key, entries)| (key.clone(), entries.clone()));
    EvaluationIndex { scenes: scenes.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_protocols_have_simulated_stand_ins() {
        let datasets = simulated_datasets(|_, _| 2).unwrap();
        let stand_ins: Vec<String> = datasets.iter().filter_map(|dataset| dataset.preset.stands_for.clone()).collect();
        let published = Preset::names().map(|name| Preset::named(name).unwrap());
        let without: Vec<String> = published
            .filter(|preset| preset.stands_for.is_none() && !stand_ins.contains(&preset.name))
            .map(|preset| preset.name)
            .collect();
        assert_eq!(
            without,
            ["acid-2v-256", "acid-overlap", "photos-3v-256"],
            "landscapes from the air are not simulated"
        );
        for dataset in &datasets {
            let index = &dataset.index;
            assert!(!index.index.scenes.is_empty() && index.index.scenes.len() <= 2);
            let whole = IndexFile::embedded(index.name.as_deref().unwrap()).unwrap().unwrap();
            assert_eq!((index.sha256, index.entries_of_file()), (whole.sha256, whole.index.entries().count() as u64));
        }
        let rooms: Vec<_> =
            datasets.iter().filter(|dataset| dataset.preset.stands_for.as_deref() == Some("re10k-2v-256")).collect();
        assert!(matches!(rooms[..], [dataset] if dataset.name == "rooms-2v-128"), "one stand-in of each, the first");
    }
}
