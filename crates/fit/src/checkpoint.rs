//! Checkpoints: safetensors files with everything that a run needs to go on as if it had not been interrupted.

use std::collections::HashMap;
use std::path::Path;

use atsplat_files::{FileError, Sha256Digest};
use atsplat_splat::{GaussianParts, Gaussians, sh_coefficients};
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use serde::{Deserialize, Serialize};

use crate::corrections::Corrections;
use crate::{Fit, FitConfig, FitDevice, FitError, Scene, TrainingView};

const METADATA: &str = "atsplat.fit";
const PARTS: [&str; 3] = ["value", "first-moment", "second-moment"];

#[derive(Debug, Serialize, Deserialize)]
struct Metadata {
    step: u64,
    /// Hash of configuration and views.
    run: String,
    /// Name of the device, as bits differ between them; files without one are of the CPU.
    #[serde(default = "cpu")]
    device: String,
    sh_degree: u8,
    filtered: bool,
    memory: Vec<String>,
    /// Hash of all tensors in order, so that damage is noticed.
    tensors: String,
}

impl Fit {
    /// Writes the state between two steps, atomically.
    ///
    /// # Errors
    /// [`FitError::Io`].
    pub fn checkpoint(&self, path: &Path) -> Result<(), FitError> {
        let mut tensors: Vec<(String, &[f32])> = Vec::new();
        let memory = self.density.memory();
        for (part, parts) in PARTS.into_iter().zip([&self.scene.parts, &self.scene.first, &self.scene.second]) {
            tensors.extend(arrays(parts).map(|(name, values)| (format!("{part}/{name}"), values)));
        }
        let filters = self.scene.parts.filter_3d.as_deref();
        tensors.extend(filters.map(|filters| ("filter-3d".to_owned(), filters)));
        tensors.extend(self.corrections.arrays().map(|(name, values)| (name.to_owned(), values)));
        tensors.extend(memory.iter().map(|(name, values)| (format!("memory/{name}"), values.as_slice())));
        let metadata = Metadata {
            step: self.step,
            run: run_hash(&self.config, &self.views),
            device: self.device().to_owned(),
            sh_degree: self.scene.parts.sh_degree,
            filtered: filters.is_some(),
            memory: memory.iter().map(|(name, _)| (*name).to_owned()).collect(),
            tensors: digest(tensors.iter().map(|(_, values)| *values)),
        };
        let failed =
            |source| FitError::from(FileError { action: "writing a checkpoint", path: path.to_owned(), source });
        let other = |error: &dyn std::fmt::Display| failed(std::io::Error::other(error.to_string()));
        let text = serde_json::to_string(&metadata).map_err(|error| other(&error))?;
        let mut views = Vec::new();
        for (name, values) in &tensors {
            let view = TensorView::new(Dtype::F32, vec![values.len()], bytemuck::cast_slice(values));
            views.push((name.as_str(), view.map_err(|error| other(&error))?));
        }
        let metadata = HashMap::from([(METADATA.to_owned(), text)]);
        let bytes = safetensors::serialize(views, Some(metadata)).map_err(|error| other(&error))?;
        atsplat_files::write(path, &bytes).map_err(failed)
    }

    /// The state of a checkpoint that a run with the same configuration and views wrote on the same device; `start` is the
    /// run's start.
    ///
    /// # Errors
    /// As [`Fit::new`]; [`FitError::Checkpoint`] for a file of another run or a damaged one; [`FitError::Io`].
    pub fn resume(
        config: FitConfig,
        views: Vec<TrainingView>,
        start: &Gaussians,
        device: FitDevice,
        path: &Path,
    ) -> Result<Self, FitError> {
        let wrong = |field: &str, expected: &str, found: String| FitError::Checkpoint {
            field: field.to_owned(),
            expected: expected.to_owned(),
            found,
            path: path.to_owned(),
        };
        let bytes = std::fs::read(path).map_err(FileError::during::<FitError>("reading a checkpoint", path))?;
        let malformed = |error: &dyn std::fmt::Display| wrong("file", "a checkpoint", error.to_string());
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|error| malformed(&error))?;
        let stored = SafeTensors::deserialize(&bytes).map_err(|error| malformed(&error))?;
        let text = header.metadata().as_ref().and_then(|entries| entries.get(METADATA));
        let text = text.ok_or_else(|| wrong(METADATA, "metadata", "none".to_owned()))?;
        let metadata: Metadata =
            serde_json::from_str(text).map_err(|error| wrong(METADATA, "metadata", error.to_string()))?;
        if metadata.run != run_hash(&config, &views) {
            return Err(wrong("run", "the configuration and views of this run", "others".to_owned()));
        }
        if metadata.device != device.name() {
            return Err(wrong("device", device.name(), metadata.device));
        }
        let mut fit = Self::new(config, views, start)?.on(device);
        let own: Vec<&str> = fit.density.memory().into_iter().map(|(name, _)| name).collect();
        if metadata.memory != own {
            return Err(wrong("memory", &format!("{own:?}"), format!("{:?}", metadata.memory)));
        }
        let mut read = Vec::new();
        let mut tensor = |name: String| {
            let found = stored.tensor(&name).ok().filter(|tensor| tensor.dtype() == Dtype::F32);
            let found = found.ok_or_else(|| wrong(&name, "a tensor of f32", "none".to_owned()))?;
            let values =
                found.data().as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect::<Vec<f32>>();
            read.push(values.clone());
            Ok::<_, FitError>(values)
        };
        let mut scene = Scene::default();
        for (part, parts) in PARTS.into_iter().zip([&mut scene.parts, &mut scene.first, &mut scene.second]) {
            parts.sh_degree = metadata.sh_degree;
            let mut named = |name: &str| tensor(format!("{part}/{name}"));
            parts.means = rows(&named("means")?);
            parts.quaternions = rows(&named("quaternions")?);
            parts.log_scales = rows(&named("log-scales")?);
            parts.opacity_logits = named("opacity-logits")?;
            parts.sh = rows(&named("sh")?);
        }
        scene.parts.filter_3d = metadata.filtered.then(|| tensor("filter-3d".to_owned())).transpose()?;
        let mut corrections = Corrections::default();
        let [values, first, second] = fit.corrections.arrays().map(|(name, _)| tensor(name.to_owned()));
        (corrections.values, corrections.first, corrections.second) = (rows(&values?), rows(&first?), rows(&second?));
        let memory: Vec<Vec<f32>> =
            metadata.memory.iter().map(|name| tensor(format!("memory/{name}"))).collect::<Result<_, _>>()?;
        let lengths =
            [&scene.parts, &scene.first, &scene.second].map(|parts| Gaussians::new(parts.clone()).map(|all| all.len()));
        let [Ok(values), Ok(first), Ok(second)] = lengths else {
            return Err(wrong("tensors", "arrays of matching lengths", "others".to_owned()));
        };
        if digest(read.iter().map(Vec::as_slice)) != metadata.tensors || [first, second] != [values; 2] {
            return Err(wrong("tensors", "the tensors that were written", "others".to_owned()));
        }
        (fit.scene, fit.step, fit.corrections) = (scene, metadata.step, corrections);
        fit.density.restore(memory);
        Ok(fit)
    }
}

fn cpu() -> String {
    FitDevice::CPU.to_owned()
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

fn digest<'a>(tensors: impl Iterator<Item = &'a [f32]>) -> String {
    let bytes: Vec<u8> = tensors.flat_map(bytemuck::cast_slice::<f32, u8>).copied().collect();
    Sha256Digest::of(&bytes).to_string()
}

/// Hash of everything that a step depends on, apart from the state.
fn run_hash(config: &FitConfig, views: &[TrainingView]) -> String {
    let of_view = |view: &TrainingView| {
        let pixels = Sha256Digest::of(bytemuck::cast_slice(view.rgb.as_flattened()));
        format!("{:?} {pixels}", view.view)
    };
    let lines: Vec<String> = [format!("{config:?}")].into_iter().chain(views.iter().map(of_view)).collect();
    Sha256Digest::of(lines.join("\n").as_bytes()).to_string()
}
