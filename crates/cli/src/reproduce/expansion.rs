//! The report's section on token expansion and its live view: two scenes, block by block.

use std::collections::BTreeSet;

use atsplat_eval::discovery::NotRun;
use atsplat_eval::expansion::{ExpansionScene, study_trial};
use atsplat_eval::runner::Dataset;
use atsplat_eval::trained::TrainedNetwork;
use atsplat_model::network::Network;
use atsplat_protocol::EvaluationIndex;
use atsplat_protocol::trial::{TargetImages, Trial};
use atsplat_report::page::{LiveTrial, PlotSection};
use atsplat_report::plot_data::{expansion_plots, trial_images};

use super::film::film;

/// The protocol of the paper's figures on expansion.
const PROTOCOL: &str = "re10k-2v-256";
/// Number of scenes shown.
const SCENES: usize = 2;
/// Number of scenes tried if images of the first are missing or damaged.
const CANDIDATES: usize = 8;

/// The section with plots, and the trials of the live view.
#[derive(Debug)]
pub(super) struct ReportParts {
    pub(super) section: PlotSection,
    pub(super) live: Vec<LiveTrial>,
    /// Scenes that could not be studied, and films that could not be made.
    pub(super) not_run: Vec<NotRun>,
}

/// The parts for the first scenes of the protocol or its stand-in, otherwise of a similar dataset, otherwise of any dataset.
pub(super) fn report_parts(datasets: &[Dataset], trained: &TrainedNetwork) -> anyhow::Result<ReportParts> {
    let Some(dataset) = best_match(datasets) else { anyhow::bail!("there is no dataset") };
    let network = trained.network_for(&trained.config)?;
    let mut first_problem = None;
    let mut scenes: Vec<ExpansionScene> = Vec::new();
    let (mut live, mut not_run) = (Vec::new(), Vec::new());
    for outcome in dataset.trials(&first_trials(dataset)) {
        let (trial, truths) = match outcome {
            Ok(trial) => trial,
            Err(skipped) => {
                first_problem = first_problem.or(Some(skipped.to_string()));
                continue;
            }
        };
        let mut failed = |what: &str, error: &anyhow::Error| {
            not_run.push(NotRun { what: format!("{what} of {}", trial.scene()), why: format!("{error:#}") });
        };
        match study(dataset, trained, &network, &trial, &truths) {
            Ok((scene, without_film)) => {
                let film = film(dataset, trained, &trial).inspect_err(|error| failed("film", error));
                live.push(LiveTrial { film: film.ok(), ..without_film });
                scenes.push(scene);
            }
            Err(error) => {
                failed("expansion", &error);
                first_problem = first_problem.or(Some(format!("{error:#}")));
            }
        }
        if scenes.len() == SCENES {
            break;
        }
    }
    if let (true, Some(problem)) = (scenes.is_empty(), first_problem) {
        anyhow::bail!("{problem}");
    }
    Ok(ReportParts { section: section(dataset, trained, &scenes)?, live, not_run })
}

fn best_match(datasets: &[Dataset]) -> Option<&Dataset> {
    let published = |dataset: &&Dataset| dataset.preset.published() == PROTOCOL;
    let similar = |dataset: &&Dataset| dataset.preset.dataset == "re10k";
    datasets.iter().find(published).or_else(|| datasets.iter().find(similar)).or_else(|| datasets.first())
}

/// Studies one trial; its live view has no film yet.
fn study(
    dataset: &Dataset,
    trained: &TrainedNetwork,
    network: &Network,
    trial: &Trial,
    truths: &TargetImages,
) -> anyhow::Result<(ExpansionScene, LiveTrial)> {
    let (studied, scene) = study_trial(network, (trial, truths), dataset.render_options(trial), 0, 1)?;
    let context = trial.context().iter().map(|view| Ok((view.frame, view.image()?)));
    let context = context.collect::<anyhow::Result<Vec<_>>>()?;
    let images = studied.targets.first().map(|target| trial_images(&context, target)).transpose()?;
    let title = format!("{} of {}, {}", trial.scene(), dataset.name, trained.config.name);
    Ok((studied, LiveTrial { title, scene, images: images.unwrap_or_default(), film: None }))
}

fn section(dataset: &Dataset, trained: &TrainedNetwork, scenes: &[ExpansionScene]) -> anyhow::Result<PlotSection> {
    let subject = format!("{} on {}", trained.config.name, dataset.name);
    Ok(PlotSection {
        title: "Expansion".to_owned(),
        hint: format!(
            "Where tokens expand, what each expansion adds, and whether the predicted uncertainty matches the error; \
             on {}, {}.",
            dataset.name, dataset.description
        ),
        plots: expansion_plots(&subject, scenes)?,
        before_tables: false,
        stores: Vec::new(),
    })
}

/// The first trial of each of the first scenes.
fn first_trials(dataset: &Dataset) -> EvaluationIndex {
    let keys: BTreeSet<&String> = dataset.source.keys().iter().collect();
    let present = dataset.index.index.scenes.iter().filter(|(key, _)| keys.contains(key));
    let first = present.filter_map(|(key, entries)| Some((key.clone(), vec![entries.first()?.clone()])));
    EvaluationIndex { scenes: first.take(CANDIDATES).collect() }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use atsplat_eval::discovery::simulated_datasets;
    use atsplat_pixels::{ImageU8, encode_png};
    use atsplat_scene::{FrameImage, Scene, SceneError, SceneSource, SharedBytes, Warnings};

    use super::*;

    /// The scenes of another source, the images of some of which are cut to half: their headers are whole.
    struct CutShort {
        source: Arc<dyn SceneSource>,
        damaged: Vec<String>,
    }

    impl SceneSource for CutShort {
        fn keys(&self) -> &[String] {
            self.source.keys()
        }

        fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
            let mut scene = self.source.load(key, warnings)?;
            if self.damaged.iter().any(|damaged| damaged == key) {
                let size = scene.frames[0].size(key, 0)?;
                let grey = vec![128; size.width as usize * size.height as usize * 3];
                let png = encode_png(&ImageU8::new(size.width, size.height, grey).unwrap()).unwrap();
                let half = SharedBytes::new(png[..png.len() / 2].to_vec());
                for frame in &mut scene.frames {
                    frame.image = FrameImage::Encoded(half.clone());
                }
            }
            Ok(scene)
        }
    }

    fn is_stand_in(dataset: &Dataset) -> bool {
        dataset.preset.stands_for.as_deref() == Some(PROTOCOL)
    }

    #[test]
    fn goes_on_after_a_scene_with_damaged_images() {
        let trained = crate::embedded::trained(None).unwrap();
        let with_damaged = |count: usize| {
            let datasets = simulated_datasets(|_, _| 2).unwrap();
            let dataset = datasets.into_iter().find(is_stand_in).unwrap();
            let scenes: Vec<String> = dataset.index.index.scenes.keys().cloned().collect();
            let source = CutShort { source: Arc::clone(&dataset.source), damaged: scenes[..count].to_vec() };
            (scenes, report_parts(&[Dataset { source: Arc::new(source), ..dataset }], &trained))
        };
        let (scenes, parts) = with_damaged(1);
        let ReportParts { live, not_run, .. } = parts.unwrap();
        assert_eq!(live.len(), 1);
        assert!(live[0].title.starts_with(&format!("{} of ", scenes[1])), "{}", live[0].title);
        let failed: Vec<&str> = not_run.iter().map(|missing| missing.what.as_str()).collect();
        assert_eq!(failed, [format!("expansion of {}", scenes[0])]);
        assert!(not_run[0].why.contains(&format!("of scene {:?}: ", scenes[0])), "{}", not_run[0].why);
        let (scenes, parts) = with_damaged(2);
        let error = parts.unwrap_err().to_string();
        assert!(error.contains(&format!("of scene {:?}: ", scenes[0])), "{error}");
    }

    #[test]
    fn shows_the_stand_in_of_the_papers_protocol() {
        let datasets = simulated_datasets(|_, _| 8).unwrap();
        let trained = crate::embedded::trained(None).unwrap();
        let ReportParts { section, live, not_run } = report_parts(&datasets, &trained).unwrap();
        assert!(not_run.is_empty(), "{}", crate::reproduce::reasons(&not_run));
        let names: Vec<&str> = section.plots.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["token-expansion-1", "token-expansion-2", "expansion-strips", "uncertainty"]);
        let stand_in = datasets.iter().find(|dataset| is_stand_in(dataset)).unwrap();
        for (name, drawing) in &section.plots {
            let subtitle = drawing.texts().nth(1).unwrap();
            assert!(subtitle.contains(&stand_in.name), "{name}: {subtitle}");
        }
        assert!(report_parts(&[], &trained).is_err());
        assert_eq!(live.len(), 2);
        for trial in &live {
            let titles: Vec<&str> = trial.images.iter().map(|image| image.title.as_str()).collect();
            assert_eq!(titles, ["context", "context", "target", "render", "error", "uncertainty", "depth"]);
            let film = trial.film.as_ref().unwrap();
            assert_eq!((film.columns.len(), film.frames.len()), (5, 16));
            assert!(film.frames.iter().all(|frame| frame.len() == 5));
            // The first frame is a context view, which the nearest view repeats.
            assert_eq!(film.columns[2], "nearest view");
            assert_eq!(film.frames[0][0], film.frames[0][2]);
            assert_ne!(film.frames[7][0], film.frames[7][2]);
            let sizes = trial.scene.stages.iter().map(|stage| stage.all).collect::<Vec<_>>();
            assert!(sizes.len() == 5 && sizes.is_sorted() && sizes[0] < sizes[4], "{sizes:?}");
        }
    }
}
