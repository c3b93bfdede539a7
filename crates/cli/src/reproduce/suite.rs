//! Runs without data: simulated scenes under every protocol.

use std::sync::Arc;

use anyhow::Context as _;
use atsplat_eval::runner::{Dataset, PlannedIndex};
use atsplat_eval::sources::simulated;
use atsplat_protocol::{EvaluationIndex, IndexFile, Preset};
use clap::ValueEnum;

/// Extent of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SuiteArg {
    /// A few scenes of every protocol; takes minutes.
    Quick,
    /// All scenes.
    Full,
}

impl SuiteArg {
    /// Number of scenes of a simulated preset.
    pub(super) const fn simulated_scenes(self, context_views: usize, targets: usize) -> usize {
        match self {
            Self::Full => usize::MAX,
            Self::Quick if context_views > 6 => 1,
            Self::Quick if targets > 8 => 2,
            Self::Quick if context_views > 2 => 4,
            Self::Quick => 8,
        }
    }

    /// Number of scenes per protocol on a user's data.
    pub(super) const fn limit(self) -> Option<u64> {
        match self {
            Self::Quick => Some(4),
            Self::Full => None,
        }
    }
}

/// Every preset of simulated scenes, with the number of scenes of the suite.
pub(super) fn simulated_datasets(suite: SuiteArg) -> anyhow::Result<Vec<Dataset>> {
    let mut datasets = Vec::new();
    for name in Preset::names() {
        let preset = Preset::named(name)?;
        let Some(accepted) = preset.index.accepted.first() else { continue };
        let Some(file) = IndexFile::carried(&accepted.name) else { continue };
        let file = file?;
        let limit = suite.simulated_scenes(preset.index.context_views, preset.index.targets.1);
        let index = first_scenes(&file.index, limit);
        let source = simulated(&preset, &index)?.with_context(|| format!("{name} is not simulated"))?;
        let planned = PlannedIndex {
            index,
            told: format!("carried: {}", accepted.name),
            sha256: file.sha256,
            name: Some(accepted.name.clone()),
        };
        let description = format!("simulated {}, test split", preset.dataset);
        datasets.push(Dataset {
            name: name.to_owned(),
            preset,
            source: Arc::new(source),
            told: description,
            index: planned,
        });
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
        let datasets = simulated_datasets(SuiteArg::Quick).unwrap();
        let stand_ins: Vec<String> = datasets.iter().filter_map(|dataset| dataset.preset.stands_for.clone()).collect();
        let published = Preset::names().map(|name| Preset::named(name).unwrap());
        let without: Vec<String> = published
            .filter(|preset| preset.stands_for.is_none() && !stand_ins.contains(&preset.name))
            .map(|preset| preset.name)
            .collect();
        assert_eq!(without, ["acid-2v-256", "photos-3v-256"], "landscapes from the air are not simulated");
        for dataset in &datasets {
            assert!(!dataset.index.index.scenes.is_empty() && dataset.index.index.scenes.len() <= 8);
        }
    }
}
