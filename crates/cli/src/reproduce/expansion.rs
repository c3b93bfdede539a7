//! The report's section on token expansion: two scenes, block by block.

use std::sync::Arc;

use atsplat_eval::method::constants_of;
use atsplat_eval::runner::Dataset;
use atsplat_eval::trained::TrainedNetwork;
use atsplat_protocol::EvaluationIndex;
use atsplat_protocol::trial::{DecodeAhead, Prefetch, TrialRecipe, Trials};
use atsplat_report::figures::{ExpansionScene, of_expansion};
use atsplat_report::page::PlotSection;
use atsplat_splat::RenderOptions;

use crate::expansion::study_trial;

/// The protocol of the paper's figures on expansion.
const PROTOCOL: &str = "re10k-2v-256";
/// Number of scenes shown.
const SCENES: usize = 2;
/// Number of scenes tried if images of the first are missing.
const CANDIDATES: usize = 8;

/// Shows the first scenes of the protocol or its stand-in, else of a similar dataset, else of any dataset.
pub(super) fn section(datasets: &[Dataset], trained: &TrainedNetwork) -> anyhow::Result<PlotSection> {
    let published =
        |dataset: &&Dataset| dataset.preset.stands_for.as_deref().unwrap_or(&dataset.preset.name) == PROTOCOL;
    let similar = |dataset: &&Dataset| dataset.preset.dataset == "re10k";
    let found = datasets.iter().find(published).or_else(|| datasets.iter().find(similar)).or_else(|| datasets.first());
    let Some(dataset) = found else { anyhow::bail!("there is no dataset") };
    let network = trained.bare(&trained.config)?;
    let mut first_skipped = None;
    let mut scenes: Vec<ExpansionScene> = Vec::new();
    for outcome in trials(dataset) {
        match outcome {
            Ok((trial, truths)) => {
                let options = RenderOptions {
                    constants: constants_of(&dataset.preset.renderer, trial.near_far()),
                    background: dataset.preset.renderer.background,
                    ..RenderOptions::default()
                };
                scenes.push(study_trial(&network, (&trial, &truths), options, 0, 1)?);
            }
            Err(skipped) => first_skipped = first_skipped.or(Some(skipped)),
        }
        if scenes.len() == SCENES {
            break;
        }
    }
    if let (true, Some(skipped)) = (scenes.is_empty(), first_skipped) {
        anyhow::bail!("{skipped}");
    }
    let subject = format!("{} on {}", trained.config.name, dataset.name);
    Ok(PlotSection {
        title: "Expansion".to_owned(),
        hint: format!(
            "Where tokens expand, what each expansion adds, and whether the predicted uncertainty matches the error; \
             on {}, {}.",
            dataset.name, dataset.description
        ),
        plots: of_expansion(&subject, &scenes)?,
    })
}

/// The first trial of each of the first scenes.
fn trials(dataset: &Dataset) -> Trials {
    let present = dataset.index.index.scenes.iter().filter(|(key, _)| dataset.source.keys().contains(key));
    let first = present.filter_map(|(key, entries)| Some((key.clone(), vec![entries.first()?.clone()])));
    let index = EvaluationIndex { scenes: first.take(CANDIDATES).collect() };
    let no_prefetch = Prefetch { trials: 0, decode: DecodeAhead::Nothing, max_bytes: 0 };
    Trials::new(Arc::clone(&dataset.source), &index, TrialRecipe::of(&dataset.preset, "ATSplat"), no_prefetch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_eval::discovery::simulated_datasets;

    #[test]
    fn shows_the_stand_in_of_the_papers_protocol() {
        let datasets = simulated_datasets(|_, _| 8).unwrap();
        let trained = crate::embedded::trained(None).unwrap();
        let section = section(&datasets, &trained).unwrap();
        let names: Vec<&str> = section.plots.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["token-expansion-1", "token-expansion-2", "expansion-strips", "uncertainty"]);
        let stand_in = datasets.iter().find(|own| own.preset.stands_for.as_deref() == Some(PROTOCOL)).unwrap();
        for (name, drawing) in &section.plots {
            let subtitle = drawing.texts().nth(1).unwrap();
            assert!(subtitle.contains(&stand_in.name), "{name}: {subtitle}");
        }
        assert!(super::section(&[], &trained).is_err());
    }
}
