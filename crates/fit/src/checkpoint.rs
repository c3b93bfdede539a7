//! Checkpoints: safetensors files with everything that a run needs to go on as if it had not been interrupted.

mod tensors;

use std::collections::BTreeMap;
use std::io::Result as IoResult;
use std::path::Path;

use atsplat_camera::{Camera, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_files::{FileError, Malformed, Sha256Digest, changes};
use atsplat_splat::{Gaussians, View};
use atsplat_tensors::{DType, StoredTensors, TensorError, TensorView, read_metadata, write_safetensors};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use tensors::{PARTS, Tensors, arrays};

use crate::history::HistoryFacts;
use crate::{Elapsed, Fit, FitConfig, FitDevice, FitError, History, OptimisedGaussians, TrainingView, TrainingViews};

const METADATA: &str = "atsplat.fit";
/// Hash of the text of [`METADATA`]; earlier versions did not write it.
const METADATA_DIGEST: &str = "atsplat.fit-sha256";
const WRITING: &str = "writing a checkpoint";

#[derive(Debug, Serialize, Deserialize)]
struct Metadata {
    step: u64,
    /// Hash of configuration and views, with which earlier versions recognise a run.
    run: String,
    /// Hash of the views; earlier versions did not write it.
    #[serde(default)]
    views: Option<String>,
    /// The configuration; earlier versions did not write it.
    #[serde(default)]
    configuration: Option<serde_json::Value>,
    /// Hash of the initial Gaussians, on which extent and first degree depend too.
    start: String,
    /// Name of the device, as bits differ between them.
    device: String,
    sh_degree: u8,
    /// Highest degree that was rendered so far; earlier versions did not write it.
    #[serde(default)]
    reached_degree: u8,
    filtered: bool,
    memory: Vec<String>,
    history: HistoryFacts,
    /// Steps of this epoch in which no Gaussian was drawn; earlier versions did not write it.
    #[serde(default)]
    empty_steps: u64,
    /// Whether one optimiser moved the corrections of all views; in earlier versions, which did not write it, each view had its own.
    #[serde(default)]
    joint_corrections: bool,
    /// The time so far; earlier versions did not write it.
    #[serde(default)]
    elapsed: Option<Elapsed>,
    /// Hash of the bytes of all tensors, doubles last, so that damage is noticed.
    tensors: String,
}

impl Fit {
    /// Whether a file begins as checkpoints do: a safetensors header with their metadata.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn is_checkpoint(path: &Path) -> IoResult<bool> {
        Ok(read_metadata(path)?.is_some_and(|metadata| metadata.contains_key(METADATA)))
    }

    /// Writes the state between two steps with the [history](Self::history), atomically, without copying Gaussians and moments.
    ///
    /// # Errors
    /// [`FitError::Io`].
    pub fn checkpoint(&self, path: &Path) -> Result<(), FitError> {
        let (density, history) = (self.density.state(), self.history.arrays());
        let mut state: Vec<(String, &[f32])> = Vec::new();
        let OptimisedGaussians { parts, first_moments, second_moments } = &self.scene;
        for (part, parts) in PARTS.into_iter().zip([parts, first_moments, second_moments]) {
            state.extend(arrays(parts).map(|(name, values)| (format!("{part}/{name}"), values)));
        }
        let filters = self.scene.parts.filter_3d.as_deref();
        state.extend(filters.map(|filters| ("filter-3d".to_owned(), filters)));
        state.extend(self.corrections.arrays().map(|(name, values)| (name.to_owned(), values)));
        state.extend(density.iter().map(|(name, values)| (format!("memory/{name}"), values.as_slice())));
        let singles =
            state.iter().map(|(name, values)| (name.as_str(), DType::F32, bytemuck::cast_slice::<f32, u8>(values)));
        let doubles = History::ARRAYS.into_iter().zip(&history);
        let doubles = doubles.map(|(name, values)| (name, DType::F64, bytemuck::cast_slice::<f64, u8>(values)));
        let mut tensors: Vec<(&str, DType, &[u8])> = singles.chain(doubles).collect();
        let not_json = |error: serde_json::Error| {
            FitError::from(FileError { action: WRITING, path: path.to_owned(), source: error.into() })
        };
        let metadata = Metadata {
            step: self.step,
            run: run_hash(&self.config, self.views.lines()),
            views: Some(hash_of(self.views.lines())),
            configuration: Some(serde_json::to_value(&self.config).map_err(not_json)?),
            start: self.start.clone(),
            device: self.device().to_owned(),
            sh_degree: self.scene.parts.sh_degree,
            reached_degree: self.degree,
            filtered: filters.is_some(),
            empty_steps: self.empty_steps,
            memory: density.iter().map(|(name, _)| (*name).to_owned()).collect(),
            history: self.history.facts(),
            joint_corrections: true,
            elapsed: Some(self.elapsed()),
            tensors: Sha256Digest::of_parts(tensors.iter().map(|(.., bytes)| *bytes)).to_string(),
        };
        let text = serde_json::to_string(&metadata).map_err(not_json)?;
        // Doubles first, so that all numbers in the file are aligned.
        tensors.rotate_right(History::ARRAYS.len());
        let views = tensors.into_iter().map(|(name, dtype, bytes)| {
            let view = TensorView::new(dtype, vec![bytes.len() / dtype.bytes()], bytes)?;
            Ok((name, view))
        });
        let digest = Sha256Digest::of(text.as_bytes()).to_string();
        let metadata = BTreeMap::from([(METADATA.to_owned(), text), (METADATA_DIGEST.to_owned(), digest)]);
        let views: Result<Vec<_>, TensorError> = views.collect();
        let written = views.and_then(|views| write_safetensors(path, &views, &metadata));
        written.map_err(|error| of_tensors(error, WRITING, path))
    }

    /// The state of a checkpoint that a run with the same configuration, views and start wrote on the same device; views that it
    /// compared with must be the `held_out` ones.
    ///
    /// # Errors
    /// As [`Fit::new`]; [`FitError::Checkpoint`] for a file of another run, one of an earlier version, or a damaged one;
    /// [`FitError::Io`].
    pub fn resume(
        config: FitConfig,
        views: impl Into<TrainingViews>,
        held_out: &[TrainingView],
        start: &Gaussians,
        device: FitDevice,
        path: &Path,
    ) -> Result<Self, FitError> {
        let views: TrainingViews = views.into();
        let wrong = |field: &str, expected: &str, found: String| wrong(path, field, expected, found);
        let stored = StoredTensors::open(path).map_err(|error| of_tensors(error, "reading a checkpoint", path))?;
        let metadata = metadata_of(&stored, path)?;
        check_run(&metadata, &config, &views, path)?;
        if metadata.device != device.name() {
            return Err(wrong("device", device.name(), metadata.device));
        }
        let mut fit = Self::new(config, views, start)?.on(device);
        if metadata.start != fit.start {
            return Err(wrong("initial Gaussians", "those that this run starts from", "others".to_owned()));
        }
        let expected: Vec<&str> = fit.density.state().into_iter().map(|(name, _)| name).collect();
        if metadata.memory != expected {
            return Err(wrong("memory", &format!("{expected:?}"), format!("{:?}", metadata.memory)));
        }
        // In the order of their hash, which is not that of the file.
        let mut tensors = Tensors::new(&stored, path);
        let scene = tensors.scene(metadata.sh_degree, metadata.filtered)?;
        let corrections = tensors.corrections()?;
        if !metadata.joint_corrections && !corrections.values.is_empty() {
            let expected = "cameras and exposures of one optimiser for all views; start the run again";
            return Err(wrong("corrections", expected, "those of an earlier version, one for each view".to_owned()));
        }
        let density = metadata.memory.iter().map(|name| tensors.singles(&format!("memory/{name}")));
        let density: Vec<Vec<f32>> = density.collect::<Result<_, _>>()?;
        let [losses, scores, training] = History::ARRAYS.map(|name| tensors.doubles(name));
        let numbers = [losses?, scores?, training?];
        let lengths = [&scene.parts, &scene.first_moments, &scene.second_moments]
            .map(|parts| Gaussians::new(parts.clone()).map(|all| all.len()));
        let [Ok(values), Ok(first), Ok(second)] = lengths else {
            return Err(wrong("tensors", "arrays of matching lengths", "others".to_owned()));
        };
        if tensors.digest() != metadata.tensors || [first, second] != [values; 2] {
            return Err(wrong("tensors", "the tensors that were written", "others".to_owned()));
        }
        let history = History::restored(metadata.history, &numbers, metadata.step, fit.views.len());
        let history = history.ok_or_else(|| wrong("history", "one of all steps and views", "another".to_owned()))?;
        if !history.is_of(&views_hash(held_out)) {
            return Err(wrong("held-out", "the held-out views of this run", "others".to_owned()));
        }
        fit.empty_steps = metadata.empty_steps;
        fit.before = metadata.elapsed.unwrap_or(Elapsed { seconds: 0.0, since_step: metadata.step });
        if !fit.before.is_possible(metadata.step) {
            return Err(wrong("elapsed", "the time of a run", format!("{:?}", fit.before)));
        }
        if metadata.reached_degree > fit.config.sh_degree {
            let expected = format!("at most {}", fit.config.sh_degree);
            return Err(wrong("reached_degree", &expected, metadata.reached_degree.to_string()));
        }
        fit.degree = metadata.reached_degree.max(fit.degree_of(metadata.step));
        (fit.scene, fit.step, fit.corrections, fit.history) = (scene, metadata.step, corrections, history);
        fit.density.restore_state(density);
        Ok(fit)
    }
}

fn metadata_of(stored: &StoredTensors, path: &Path) -> Result<Metadata, FitError> {
    let text = stored.metadata.get(METADATA);
    let text = text.ok_or_else(|| wrong(path, METADATA, "metadata", "none".to_owned()))?;
    let digest = stored.metadata.get(METADATA_DIGEST);
    if digest.is_some_and(|digest| *digest != Sha256Digest::of(text.as_bytes()).to_string()) {
        return Err(wrong(path, METADATA, "the metadata that were written", "others".to_owned()));
    }
    serde_json::from_str(text)
        .map_err(|error| wrong(path, METADATA, "metadata as this version writes it", error.to_string()))
}

/// An error of the file's tensors as that of a checkpoint.
fn of_tensors(error: TensorError, action: &'static str, path: &Path) -> FitError {
    match error {
        TensorError::Io(error) => FileError { action, ..error }.into(),
        TensorError::InFile { source, .. } => of_tensors(*source, action, path),
        TensorError::Malformed(Malformed { location, expected, found, .. }) => wrong(path, &location, &expected, found),
        TensorError::Missing { expected, .. } => wrong(path, "file", &expected, "a folder".to_owned()),
        other => wrong(path, "file", "a checkpoint", other.to_string()),
    }
}

fn wrong(path: &Path, field: &str, expected: &str, found: String) -> FitError {
    FitError::Checkpoint { field: field.to_owned(), expected: expected.to_owned(), found, path: path.to_owned() }
}

/// Rejects a checkpoint of a run with another configuration or other views.
fn check_run(metadata: &Metadata, config: &FitConfig, views: &TrainingViews, path: &Path) -> Result<(), FitError> {
    let is_same = match (&metadata.views, &metadata.configuration) {
        (Some(written), Some(recorded)) => {
            *written == hash_of(views.lines()) && changes(recorded, config).is_ok_and(|changed| changed.is_empty())
        }
        // Of an earlier version.
        _ => metadata.run == run_hash(config, views.lines()),
    };
    if is_same { Ok(()) } else { Err(other_run(metadata.configuration.as_ref(), config, path)) }
}

/// The error for a checkpoint of a run with another configuration or other views.
fn other_run(recorded: Option<&serde_json::Value>, config: &FitConfig, path: &Path) -> FitError {
    let Some(recorded) = recorded else {
        return wrong(path, "run", "the configuration and views of this run", "others".to_owned());
    };
    match changes(recorded, config) {
        Ok(changed) if changed.is_empty() => wrong(path, "views", "those that this run trains on", "others".to_owned()),
        changed => {
            let changed = changed.unwrap_or_else(|error| error.to_string());
            wrong(path, "configuration", "the settings of this run", format!("others: {changed}"))
        }
    }
}

/// Hash of everything that a step depends on, apart from the initial Gaussians and the state; `views` are those of [`lines_of`].
fn run_hash(config: &FitConfig, views: &[String]) -> String {
    Sha256Digest::of(run_text(config, views).as_bytes()).to_string()
}

/// What is hashed. The names of the configuration's types and fields are part of it: whoever changes one of them gives up the checkpoints
/// of versions that wrote no hash of the views alone.
fn run_text(config: &FitConfig, views: &[String]) -> String {
    let config = format!("{config:?}");
    let lines: Vec<&str> = [&config].into_iter().chain(views).map(String::as_str).collect();
    lines.join("\n")
}

/// Hash of cameras and images, in order; [`hash_of`] of their lines.
pub(crate) fn views_hash(views: &[TrainingView]) -> String {
    hash_of(&lines_of(views))
}

/// Hash of the lines of views.
pub(crate) fn hash_of(lines: &[String]) -> String {
    Sha256Digest::of(lines.join("\n").as_bytes()).to_string()
}

/// A line for each view, with the hash of its pixels.
pub(crate) fn lines_of(views: &[TrainingView]) -> Vec<String> {
    views.par_iter().map(of_view).collect()
}

/// Records and checkpoints have the hash of this text, so that it does not follow the names of types and fields.
fn of_view(view: &TrainingView) -> String {
    let pixels = Sha256Digest::of(bytemuck::cast_slice(view.rgb.as_flattened()));
    let View { camera: Camera { camera_from_world, intrinsics, distortion }, size } = view.view;
    let vector = |[x, y, z]: [f64; 3]| format!("DVec3({x:?}, {y:?}, {z:?})");
    let [x, y, z] = camera_from_world.rotation().to_cols_array_2d().map(vector);
    let translation = vector(camera_from_world.translation().to_array());
    let rotation = format!("DMat3 {{ x_axis: {x}, y_axis: {y}, z_axis: {z} }}");
    let pose = format!("CameraFromWorld(Rigid {{ rotation: {rotation}, translation: {translation} }})");
    let NormalizedIntrinsics { fx, fy, cx, cy } = intrinsics;
    let intrinsics = format!("NormalizedIntrinsics {{ fx: {fx:?}, fy: {fy:?}, cx: {cx:?}, cy: {cy:?} }}");
    let lens = of_lens(distortion);
    let camera = format!("Camera {{ camera_from_world: {pose}, intrinsics: {intrinsics}, distortion: {lens} }}");
    let ImageSize { width, height } = size;
    format!("View {{ camera: {camera}, size: ImageSize {{ width: {width}, height: {height} }} }} {pixels}")
}

fn of_lens(distortion: Distortion) -> String {
    match distortion {
        Distortion::None => "None".to_owned(),
        Distortion::OpenCv { k1, k2, k3, p1, p2 } => {
            format!("OpenCv {{ k1: {k1:?}, k2: {k2:?}, k3: {k3:?}, p1: {p1:?}, p2: {p2:?} }}")
        }
        Distortion::Fisheye { k } => format!("Fisheye {{ k: {k:?} }}"),
    }
}

/// Hash of the Gaussians that a run starts from, as they are given.
pub(crate) fn start_hash(start: &Gaussians) -> String {
    let parts = start.parts();
    let filters = parts.filter_3d.as_deref().map(|filters| ("filter-3d", filters));
    let line = |(name, values): (&str, &[f32])| format!("{name} {}", Sha256Digest::of(bytemuck::cast_slice(values)));
    let lines: Vec<String> = arrays(parts).into_iter().chain(filters).map(line).collect();
    Sha256Digest::of(lines.join("\n").as_bytes()).to_string()
}

#[cfg(test)]
mod tests;
