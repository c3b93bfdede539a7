//! Film of a trial: every method on the frames between its context views.

use std::sync::Arc;

use anyhow::Context as _;
use atsplat_eval::method::{Method, TrialInput};
use atsplat_eval::runner::Dataset;
use atsplat_eval::trained::TrainedNetwork;
use atsplat_numeric::spread;
use atsplat_pixels::{ImageU8, Rounding};
use atsplat_protocol::trial::Trial;
use atsplat_protocol::{EvaluationIndex, IndexEntry};
use atsplat_report::page::Film;
use atsplat_results::file_name;

/// Maximum number of frames of a film.
const FRAMES: usize = 16;

/// Ground truth, then the methods and the same weights without expansion, on frames from the first context view to the last.
pub(super) fn film(dataset: &Dataset, trained: &TrainedNetwork, trial: &Trial) -> anyhow::Result<Film> {
    let context = &trial.entry().context;
    let (first, last) = context.iter().min().zip(context.iter().max()).context("the trial has no context view")?;
    let path: Vec<usize> = (*first..=*last).collect();
    let target = spread(path.len(), FRAMES).into_iter().filter_map(|at| path.get(at).copied()).collect();
    let entry = IndexEntry { target, ..trial.entry().clone() };
    let index = EvaluationIndex { scenes: [(trial.scene().to_owned(), vec![entry])].into_iter().collect() };
    let outcome = dataset.trials(&index).next().context("the scene is missing")?;
    let (along, truths) = outcome.map_err(|skipped| anyhow::anyhow!("{skipped}"))?;
    let images = along.context().iter().map(atsplat_protocol::trial::ContextView::image);
    let images = images.collect::<Result<Vec<_>, _>>()?;
    let positions: Vec<usize> = (0..along.targets().len()).collect();
    let mut columns = vec!["ground truth".to_owned()];
    let truth = |&at: &usize| Ok(vec![truths.get(at).context("a target without its image")??.as_ref().clone()]);
    let mut frames: Vec<Vec<ImageU8>> = positions.iter().map(truth).collect::<anyhow::Result<_>>()?;
    let methods: Vec<Arc<dyn Method>> = trained.methods()?.into_iter().chain([trained.without_expansion()?]).collect();
    for method in methods {
        let input = TrialInput { preset: &dataset.preset, trial: &along, images: &images };
        let rendered = method.predict(input)?.render(&positions);
        columns.push(method.record().title);
        for (frame, rendered) in frames.iter_mut().zip(rendered) {
            frame.push(rendered.map_err(anyhow::Error::msg)?.image.to_u8(Rounding::Nearest)?);
        }
    }
    let note =
        format!("{} of {}: frames {first} to {last}, from context view to context view", trial.scene(), dataset.name);
    Ok(Film { name: file_name(&format!("{}-{}", dataset.name, trial.scene())), columns, note, frames })
}
