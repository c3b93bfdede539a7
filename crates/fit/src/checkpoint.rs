//! Checkpoints: safetensors files with everything that a run needs to go on as if it had not been interrupted.

use std::collections::HashMap;
use std::fs::File;
use std::io::{ErrorKind, Read as _, Result as IoResult};
use std::path::Path;

use atsplat_files::{FileError, Sha256Digest, changes};
use atsplat_splat::{GaussianParts, Gaussians, sh_coefficients};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::{Deserialize, Serialize};

use crate::corrections::Corrections;
use crate::history::HistoryFacts;
use crate::{Elapsed, Fit, FitConfig, FitDevice, FitError, History, OptimisedGaussians, TrainingView, TrainingViews};

const METADATA: &str = "atsplat.fit";
/// The limit on the header of a safetensors file, in bytes.
const MAX_HEADER: u64 = 100_000_000;
const PARTS: [&str; 3] = ["value", "first-moment", "second-moment"];

#[derive(Debug, Serialize, Deserialize)]
struct Metadata {
    step: u64,
    /// Hash of configuration and views.
    run: String,
    /// The configuration, to say what has changed; earlier versions did not write it.
    #[serde(default)]
    configuration: Option<serde_json::Value>,
    /// Hash of the initial Gaussians, on which extent and first degree depend too.
    start: String,
    /// Name of the device, as bits differ between them.
    device: String,
    sh_degree: u8,
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
    /// Hash of all tensors in order, so that damage is noticed.
    tensors: String,
}

impl Fit {
    /// Whether a file begins as checkpoints do: the length of a header, then JSON with their metadata.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn is_checkpoint(path: &Path) -> IoResult<bool> {
        let mut file = File::open(path)?;
        let (mut length, mut header) = ([0; 8], Vec::new());
        match file.read_exact(&mut length) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(false),
            outcome => outcome?,
        }
        let length = u64::from_le_bytes(length);
        if length > MAX_HEADER {
            return Ok(false);
        }
        file.take(length).read_to_end(&mut header)?;
        let header = serde_json::from_slice::<serde_json::Value>(&header);
        Ok(header.is_ok_and(|header| header["__metadata__"][METADATA].is_string()))
    }

    /// Writes the state between two steps with the [history](Self::history), atomically.
    ///
    /// # Errors
    /// [`FitError::Io`].
    pub fn checkpoint(&self, path: &Path) -> Result<(), FitError> {
        let (density, history) = (self.density.state(), self.history.arrays());
        let mut state: Vec<(String, &[f32])> = Vec::new();
        for (part, parts) in PARTS.into_iter().zip([&self.scene.parts, &self.scene.first, &self.scene.second]) {
            state.extend(arrays(parts).map(|(name, values)| (format!("{part}/{name}"), values)));
        }
        let filters = self.scene.parts.filter_3d.as_deref();
        state.extend(filters.map(|filters| ("filter-3d".to_owned(), filters)));
        state.extend(self.corrections.arrays().map(|(name, values)| (name.to_owned(), values)));
        state.extend(density.iter().map(|(name, values)| (format!("memory/{name}"), values.as_slice())));
        let singles =
            state.iter().map(|(name, values)| (name.as_str(), Dtype::F32, bytemuck::cast_slice::<f32, u8>(values)));
        let doubles = History::ARRAYS.into_iter().zip(&history);
        let doubles = doubles.map(|(name, values)| (name, Dtype::F64, bytemuck::cast_slice::<f64, u8>(values)));
        let tensors: Vec<(&str, Dtype, &[u8])> = singles.chain(doubles).collect();
        let failed =
            |source| FitError::from(FileError { action: "writing a checkpoint", path: path.to_owned(), source });
        let other = |error: &dyn std::fmt::Display| failed(std::io::Error::other(error.to_string()));
        let metadata = Metadata {
            step: self.step,
            run: run_hash(&self.config, &self.views),
            configuration: Some(serde_json::to_value(&self.config).map_err(|error| other(&error))?),
            start: self.start.clone(),
            device: self.device().to_owned(),
            sh_degree: self.scene.parts.sh_degree,
            filtered: filters.is_some(),
            empty_steps: self.empty_steps,
            memory: density.iter().map(|(name, _)| (*name).to_owned()).collect(),
            history: self.history.facts(),
            joint_corrections: true,
            elapsed: Some(self.elapsed()),
            tensors: digest(tensors.iter().map(|(.., bytes)| *bytes)),
        };
        let text = serde_json::to_string(&metadata).map_err(|error| other(&error))?;
        let mut views = Vec::new();
        for (name, dtype, bytes) in tensors {
            let view = TensorView::new(dtype, vec![8 * bytes.len() / dtype.bitsize()], bytes);
            views.push((name, view.map_err(|error| other(&error))?));
        }
        let metadata = HashMap::from([(METADATA.to_owned(), text)]);
        let bytes = safetensors::serialize(views, Some(metadata)).map_err(|error| other(&error))?;
        atsplat_files::write(path, &bytes).map_err(failed)
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
        let bytes = std::fs::read(path).map_err(FileError::during::<FitError>("reading a checkpoint", path))?;
        let (metadata, stored) = parsed(&bytes, path)?;
        if metadata.run != run_hash(&config, &views) {
            return Err(other_run(metadata.configuration.as_ref(), &config, path));
        }
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
        // In the order in which they were written, which their hash depends on.
        let mut tensors = Tensors { stored, path, read: Vec::new() };
        let scene = tensors.scene(metadata.sh_degree, metadata.filtered)?;
        let corrections = tensors.corrections()?;
        if !metadata.joint_corrections && !corrections.values.is_empty() {
            let expected = "cameras and exposures of one optimiser for all views; start the run anew";
            return Err(wrong("corrections", expected, "those of an earlier version, one for each view".to_owned()));
        }
        let density = metadata.memory.iter().map(|name| tensors.singles(&format!("memory/{name}")));
        let density: Vec<Vec<f32>> = density.collect::<Result<_, _>>()?;
        let [losses, scores, training] = History::ARRAYS.map(|name| tensors.doubles(name));
        let numbers = [losses?, scores?, training?];
        let lengths =
            [&scene.parts, &scene.first, &scene.second].map(|parts| Gaussians::new(parts.clone()).map(|all| all.len()));
        let [Ok(values), Ok(first), Ok(second)] = lengths else {
            return Err(wrong("tensors", "arrays of matching lengths", "others".to_owned()));
        };
        if digest(tensors.read.into_iter()) != metadata.tensors || [first, second] != [values; 2] {
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
        (fit.scene, fit.step, fit.corrections, fit.history) = (scene, metadata.step, corrections, history);
        fit.density.restore_state(density);
        Ok(fit)
    }
}

/// The metadata and the tensors of a checkpoint.
fn parsed<'a>(bytes: &'a [u8], path: &Path) -> Result<(Metadata, SafeTensors<'a>), FitError> {
    let malformed = |error: &dyn std::fmt::Display| wrong(path, "file", "a checkpoint", error.to_string());
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|error| malformed(&error))?;
    let stored = SafeTensors::deserialize(bytes).map_err(|error| malformed(&error))?;
    let text = header.metadata().as_ref().and_then(|entries| entries.get(METADATA));
    let text = text.ok_or_else(|| wrong(path, METADATA, "metadata", "none".to_owned()))?;
    let metadata = serde_json::from_str(text)
        .map_err(|error| wrong(path, METADATA, "metadata as this version writes it", error.to_string()))?;
    Ok((metadata, stored))
}

fn wrong(path: &Path, field: &str, expected: &str, found: String) -> FitError {
    FitError::Checkpoint { field: field.to_owned(), expected: expected.to_owned(), found, path: path.to_owned() }
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

/// The tensors of a file, and the bytes of those that were read, in order.
struct Tensors<'a> {
    stored: SafeTensors<'a>,
    path: &'a Path,
    read: Vec<&'a [u8]>,
}

impl<'a> Tensors<'a> {
    fn bytes(&mut self, name: &str, dtype: Dtype) -> Result<&'a [u8], FitError> {
        let found = self.stored.tensor(name).ok().filter(|tensor| tensor.dtype() == dtype);
        let found = found.ok_or_else(|| wrong(self.path, name, &format!("a tensor of {dtype}"), "none".to_owned()))?;
        self.read.push(found.data());
        Ok(found.data())
    }

    fn scene(&mut self, sh_degree: u8, is_filtered: bool) -> Result<OptimisedGaussians, FitError> {
        let mut scene = OptimisedGaussians::default();
        for (part, parts) in PARTS.into_iter().zip([&mut scene.parts, &mut scene.first, &mut scene.second]) {
            parts.sh_degree = sh_degree;
            let mut named = |name: &str| self.singles(&format!("{part}/{name}"));
            parts.means = rows(&named("means")?);
            parts.quaternions = rows(&named("quaternions")?);
            parts.log_scales = rows(&named("log-scales")?);
            parts.opacity_logits = named("opacity-logits")?;
            parts.sh = rows(&named("sh")?);
        }
        scene.parts.filter_3d = is_filtered.then(|| self.singles("filter-3d")).transpose()?;
        Ok(scene)
    }

    fn corrections(&mut self) -> Result<Corrections, FitError> {
        let names = Corrections::default().arrays().map(|(name, _)| name);
        let [values, first, second] = names.map(|name| self.singles(name));
        Ok(Corrections { values: rows(&values?), first: rows(&first?), second: rows(&second?) })
    }

    fn singles(&mut self, name: &str) -> Result<Vec<f32>, FitError> {
        Ok(self.bytes(name, Dtype::F32)?.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }

    fn doubles(&mut self, name: &str) -> Result<Vec<f64>, FitError> {
        Ok(self.bytes(name, Dtype::F64)?.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect())
    }
}

fn arrays(parts: &GaussianParts) -> [(&'static str, &[f32]); 5] {
    debug_assert_eq!(
        parts.sh.len(),
        parts.means.len() * sh_coefficients(parts.sh_degree),
        "coefficients of every Gaussian"
    );
    [
        ("means", parts.means.as_flattened()),
        ("quaternions", parts.quaternions.as_flattened()),
        ("log-scales", parts.log_scales.as_flattened()),
        ("opacity-logits", &parts.opacity_logits),
        ("sh", parts.sh.as_flattened()),
    ]
}

fn rows<const N: usize>(values: &[f32]) -> Vec<[f32; N]> {
    values.as_chunks::<N>().0.to_vec()
}

fn digest<'a>(tensors: impl Iterator<Item = &'a [u8]>) -> String {
    Sha256Digest::of(&tensors.collect::<Vec<_>>().concat()).to_string()
}

/// Hash of everything that a step depends on, apart from the initial Gaussians and the state.
fn run_hash(config: &FitConfig, views: &[TrainingView]) -> String {
    let lines: Vec<String> = [format!("{config:?}")].into_iter().chain(views.iter().map(of_view)).collect();
    Sha256Digest::of(lines.join("\n").as_bytes()).to_string()
}

/// Hash of cameras and images, in order.
pub(crate) fn views_hash(views: &[TrainingView]) -> String {
    let lines: Vec<String> = views.iter().map(of_view).collect();
    Sha256Digest::of(lines.join("\n").as_bytes()).to_string()
}

fn of_view(view: &TrainingView) -> String {
    let pixels = Sha256Digest::of(bytemuck::cast_slice(view.rgb.as_flattened()));
    format!("{:?} {pixels}", view.view)
}

/// Hash of the Gaussians that a run starts from, as they are given.
pub(crate) fn start_hash(start: &Gaussians) -> String {
    let parts = start.parts();
    let filters = parts.filter_3d.as_deref().map(|filters| ("filter-3d", filters));
    let line = |(name, values): (&str, &[f32])| format!("{name} {}", Sha256Digest::of(bytemuck::cast_slice(values)));
    let lines: Vec<String> = arrays(parts).into_iter().chain(filters).map(line).collect();
    Sha256Digest::of(lines.join("\n").as_bytes()).to_string()
}
