//! Trials: what a method may see, and the target images for scoring.

use std::sync::{Arc, Mutex, PoisonError};

use atsplat_eval::runner::{Dataset, Selection, evaluate_trial};
use atsplat_pixels::ImageU8;
use atsplat_protocol::trial::{self, Prefetch, TargetImages, TrialRecipe};
use atsplat_protocol::{EvaluationIndex, ProtocolError};
use atsplat_results::{MethodRecord, TargetRow, TrialRow};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::array::{Images, floats};
use crate::camera::{Numbers, numbers};
use crate::error::Failure;
use crate::gaussians::Gaussians;
use crate::method::{Output, Precomputed};
use crate::metrics::Suite;
use crate::threads::work;

/// What a method may see of a trial.
#[pyclass(frozen, module = "atsplat._native")]
pub(crate) struct Input {
    trial: trial::Trial,
}

impl Input {
    pub(crate) const fn new(trial: trial::Trial) -> Self {
        Self { trial }
    }
}

#[pymethods]
impl Input {
    #[getter]
    fn scene(&self) -> &str {
        self.trial.scene()
    }

    #[getter]
    fn entry(&self) -> usize {
        self.trial.entry_number()
    }

    #[getter]
    fn hash(&self) -> String {
        self.trial.hash().to_string()
    }

    #[getter]
    fn overlap(&self) -> Option<f64> {
        self.trial.entry().overlap.as_ref().map(|overlap| overlap.value)
    }

    #[getter]
    fn near_far(&self) -> (f64, f64) {
        let planes = self.trial.near_far();
        (planes.near, planes.far)
    }

    /// The context images, V × H × W × 3 in [0, 1].
    fn context_images<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let images = || self.trial.context().iter().map(|view| view.image().map_err(Failure::from));
        let images: Vec<Arc<ImageU8>> = work(py, || images().collect())?;
        if images.windows(2).any(|pair| size(&pair[0]) != size(&pair[1])) {
            return Err(Failure::invalid(
                "context",
                "expected images of one size, which an array needs, found several sizes",
            )
            .into());
        }
        array_of(py, &images)
    }

    /// The cameras of the context views and their frames.
    fn context_cameras(&self) -> (Vec<Numbers>, Vec<usize>) {
        let views = self.trial.context();
        let cameras = views.iter().map(|view| numbers(&view.camera, view.size)).collect();
        (cameras, views.iter().map(|view| view.frame).collect())
    }

    /// The cameras of the targets and their frames.
    fn target_cameras(&self) -> (Vec<Numbers>, Vec<usize>) {
        let views = self.trial.targets();
        let cameras = views.iter().map(|view| numbers(&view.camera, view.size)).collect();
        (cameras, views.iter().map(|view| view.frame).collect())
    }
}

fn size(image: &ImageU8) -> [usize; 2] {
    [image.height() as usize, image.width() as usize]
}

/// Images of one size as an array, in [0, 1].
fn array_of<'py>(py: Python<'py>, images: &[Arc<ImageU8>]) -> PyResult<Bound<'py, PyAny>> {
    let [height, width] = images.first().map_or([0, 0], |image| size(image));
    let samples = images.iter().map(|image| image.samples());
    floats(py, &[images.len(), height, width, 3], samples, |sample| f32::from(sample) / 255.0)
}

/// A trial with its target images.
#[pyclass(frozen, module = "atsplat._native")]
pub(crate) struct Trial {
    dataset: Arc<Dataset>,
    /// Whose published poses, planes and renderer it has.
    setting: String,
    input: trial::Trial,
    targets: TargetImages,
}

#[pymethods]
impl Trial {
    fn input(&self) -> Input {
        Input::new(self.input.clone())
    }

    /// The target images, T × H × W × 3 in [0, 1].
    fn target_images<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let all = || (0..self.targets.len()).filter_map(|at| self.targets.get(at));
        let images: Vec<Arc<ImageU8>> =
            work(py, || all().collect::<Result<_, ProtocolError>>().map_err(Failure::from))?;
        array_of(py, &images)
    }

    /// Scores images; the rows as JSON.
    fn score_images(
        &self,
        py: Python<'_>,
        shape: Vec<usize>,
        kind: &str,
        bytes: &Bound<'_, PyBytes>,
        suite: &Suite,
    ) -> Result<String, Failure> {
        let images = Images::of(&shape, kind, bytes.as_bytes())?;
        work(py, || self.score(Output::Images(images), suite))
    }

    /// Renders and scores Gaussians in the trial's world; the rows as JSON.
    fn score_gaussians(&self, py: Python<'_>, gaussians: &Gaussians, suite: &Suite) -> Result<String, Failure> {
        work(py, || self.score(Output::Gaussians(Arc::clone(&gaussians.0)), suite))
    }
}

impl Trial {
    fn score(&self, output: Output, suite: &Suite) -> Result<String, Failure> {
        let record = MethodRecord { name: "scored".to_owned(), ..MethodRecord::default() };
        let method = Precomputed::new(record, self.setting.clone(), output);
        let rows: (TrialRow, Vec<TargetRow>) =
            evaluate_trial(&self.dataset, suite.get(), self.input.clone(), &self.targets, &method)?;
        serde_json::to_string(&rows).map_err(|error| Failure::invalid("rows", error))
    }
}

/// Goes through the trials of an index.
#[pyclass(frozen, module = "atsplat._native")]
pub(crate) struct Trials {
    dataset: Arc<Dataset>,
    setting: String,
    remaining: Mutex<trial::Trials>,
}

impl Trials {
    pub(crate) fn new(
        dataset: &Arc<Dataset>,
        setting: &str,
        limit: Option<u64>,
        only: Option<(String, usize)>,
        ahead: bool,
    ) -> Result<Self, Failure> {
        // The whole selection only where it is gone through: a data loader asks for one trial after the other.
        let index = if let Some((scene, entry)) = only {
            let missing = || Failure::invalid("scene", format!("no entry {entry} of scene {scene:?} in the index"));
            let entries = dataset.index.index.scenes.get(&scene).filter(|entries| entry < entries.len());
            // Entries are numbered by their position: the others before it stay, and are not read.
            let entries = entries.ok_or_else(missing)?.iter().take(entry + 1).cloned().collect();
            EvaluationIndex { scenes: [(scene, entries)].into_iter().collect() }
        } else {
            Selection { limit, shard: None }.index_of(dataset)
        };
        let prefetch = if ahead { Prefetch::default() } else { Prefetch::NONE };
        let recipe = TrialRecipe::of(&dataset.preset, setting);
        let trials = trial::Trials::new(Arc::clone(&dataset.source), &index, recipe, prefetch);
        Ok(Self { dataset: Arc::clone(dataset), setting: setting.to_owned(), remaining: Mutex::new(trials) })
    }
}

#[pymethods]
impl Trials {
    /// The next trial; `(scene, entry, reason, detail)` of an entry without one; `None` at the end.
    #[expect(clippy::type_complexity, reason = "a tuple for Python")]
    fn next(
        &self,
        py: Python<'_>,
    ) -> Result<Option<(Option<Trial>, Option<(String, usize, String, String)>)>, Failure> {
        let next = || Ok(self.remaining.lock().unwrap_or_else(PoisonError::into_inner).next());
        Ok(work(py, next)?.map(|outcome| match outcome {
            Ok((input, targets)) => {
                let (dataset, setting) = (Arc::clone(&self.dataset), self.setting.clone());
                (Some(Trial { dataset, setting, input, targets }), None)
            }
            Err(skipped) => {
                (None, Some((skipped.scene, skipped.entry_number, skipped.reason.name().to_owned(), skipped.detail)))
            }
        }))
    }

    /// Trials and skipped entries that are left.
    fn left(&self) -> usize {
        self.remaining.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}
