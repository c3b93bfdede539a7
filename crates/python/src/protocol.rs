//! Protocols, and data opened for one of them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_eval::runner::{Dataset, IndexChoice, Selection};
use atsplat_files::is_at;
use atsplat_protocol::{Preset, SamplingRule};
use atsplat_results::RunWarning;
use atsplat_scene::{ImageOptions, SceneSource, Warnings};
use pyo3::prelude::*;

use crate::error::Failure;
use crate::threads::work;
use crate::trial::Trials;

/// Names of the built-in protocols.
#[pyfunction]
pub(crate) fn protocol_names() -> Vec<&'static str> {
    Preset::names().collect()
}

/// An evaluation protocol.
#[pyclass(frozen, module = "atsplat._native")]
pub(crate) struct Protocol {
    preset: Preset,
}

/// The scenes of a dataset with a protocol and its index.
#[pyclass(frozen, module = "atsplat._native")]
pub(crate) struct Data {
    pub(crate) dataset: Arc<Dataset>,
    path: PathBuf,
    /// Kinds of problems, each with its count and first occurrence.
    #[pyo3(get)]
    warnings: Vec<(String, u64, String)>,
}

#[pymethods]
impl Protocol {
    #[new]
    fn new(name_or_path: &str) -> Result<Self, Failure> {
        Ok(Self { preset: Preset::resolve(name_or_path)? })
    }

    #[getter]
    fn name(&self) -> &str {
        &self.preset.name
    }

    #[getter]
    fn title(&self) -> &str {
        &self.preset.title
    }

    #[getter]
    fn hash(&self) -> Result<String, Failure> {
        Ok(self.preset.hash()?.to_string())
    }

    #[getter]
    fn toml(&self) -> Result<String, Failure> {
        Ok(self.preset.to_toml()?)
    }

    #[getter]
    fn metrics(&self) -> Vec<&str> {
        self.preset.metrics.ids().to_vec()
    }

    #[getter]
    fn settings(&self) -> Vec<&str> {
        self.preset.methods.iter().map(|setting| setting.method.as_str()).collect()
    }

    /// Opens data; its format is detected.
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    #[pyo3(signature = (data, index, sampler, any_size, frames, images, prefer_undistorted))]
    fn open(
        &self,
        py: Python<'_>,
        data: PathBuf,
        index: Option<PathBuf>,
        sampler: Option<String>,
        any_size: bool,
        frames: Option<PathBuf>,
        images: Option<u32>,
        prefer_undistorted: bool,
    ) -> Result<Data, Failure> {
        work(py, || {
            let mut warnings = Warnings::new();
            let images = ImageOptions { images, frames, prefer_undistorted };
            let mut options = images.open_options();
            options.nerfstudio.expected_size = self.preset.preprocessing.expected_size.filter(|_| !any_size);
            let opened = atsplat_scene::open_with(&data, &options, &mut warnings)?;
            images.check(Some(opened.format))?;
            let source: Arc<dyn SceneSource> = Arc::new(opened);
            let opening = warnings.clone();
            let rule = sampler.as_deref().map(SamplingRule::resolve).transpose()?;
            let index = match (sampler.as_deref().zip(rule.as_ref()), &index) {
                (Some(_), Some(_)) => {
                    return Err(Failure::invalid("sampler", "expected an index or a sampling rule, found both"));
                }
                (Some((name, rule)), None) => IndexChoice::Sampled(name, rule),
                (None, Some(path)) => IndexChoice::At(path),
                (None, None) => IndexChoice::NextToData,
            };
            let mut dataset = Dataset::new(self.preset.clone(), source, &data, index, any_size, &mut warnings)?;
            if rule.is_some() {
                dataset.index.note_unread(&opening);
            }
            Ok(Data { warnings: problems(&dataset, &warnings), dataset: Arc::new(dataset), path: data })
        })
    }
}

/// What was found when data were opened, irregularities of the index, and scenes that the data lack.
fn problems(dataset: &Dataset, opening: &Warnings) -> Vec<(String, u64, String)> {
    let found = opening.summary().map(|(kind, count, first)| (kind.to_string(), count, first.to_string()));
    let index = &dataset.index;
    let notices = index.notices.iter().map(|(kind, notice)| (kind.clone(), notice.count, notice.example.clone()));
    let foreign = dataset.preset.foreign_index(&index.index, &index.sha256);
    let mismatches = foreign.into_iter().chain(dataset.unfit_entries(&index.index));
    let mismatches = mismatches.map(|mismatch| (mismatch.kind, mismatch.count, mismatch.example));
    let missing = Selection::default().missing_in(dataset);
    let kind = RunWarning::MissingScenes.to_string();
    let first = missing.first().map(|first| (kind, missing.len() as u64, first.clone()));
    found.chain(notices).chain(mismatches).chain(first).collect()
}

#[pymethods]
impl Data {
    #[getter]
    fn name(&self) -> &str {
        &self.dataset.name
    }

    /// Rejects the dataset's own folder as that of results.
    fn check_out(&self, out: &str) -> Result<(), Failure> {
        if self.path.is_dir() && is_at(Path::new(out), &self.path) {
            let problem = format!("{out} is the folder of the dataset; choose another one for the results");
            return Err(Failure::invalid("out", problem));
        }
        Ok(())
    }

    /// Scenes of the index that are in the data, with their numbers of entries.
    fn entries(&self) -> Vec<(String, usize)> {
        let index = Selection::default().index_of(&self.dataset);
        index.scenes.into_iter().map(|(key, entries)| (key, entries.len())).collect()
    }

    /// Scenes of the index that are not in the data, with their numbers of entries.
    fn missing(&self) -> Vec<(String, usize)> {
        let entries = |scene: &str| self.dataset.index.index.scenes.get(scene).map_or(0, Vec::len);
        let missing = Selection::default().missing_in(&self.dataset);
        missing.iter().map(|scene| (scene.clone(), entries(scene))).collect()
    }

    /// The trials of at most `limit` scenes, spread over the index, or of one entry of a scene.
    #[pyo3(signature = (setting, limit, only, ahead))]
    fn trials(
        &self,
        setting: &str,
        limit: Option<u64>,
        only: Option<(String, usize)>,
        ahead: bool,
    ) -> Result<Trials, Failure> {
        Trials::new(&self.dataset, setting, limit, only, ahead)
    }
}
