use std::fmt;
use std::path::PathBuf;
use std::time::Instant;

use atsplat_model::ImageSize;
use atsplat_model::budget::MemoryEstimate;
use atsplat_model::network::Processor;
use atsplat_numeric::{counted, format_bytes};
use atsplat_results::AdapterRecord;
use serde::Serialize;

use super::{BlockRecord, InputRecord, ModelRecord, OutputRecord, RendersRecord, TokenRecord, WeightsRecord};

/// Everything that the Gaussians depend on, and the result. Independent of date and speed of the machine.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Record {
    /// Version of this toolkit.
    pub atsplat: &'static str,
    /// Context and target photos, with their preprocessing.
    pub input: InputRecord,
    /// Name and hash of the configuration.
    pub model: ModelRecord,
    /// Their file and hash, or the seed of random ones.
    pub weights: WeightsRecord,
    /// Seed of random token selection.
    pub seed: u64,
    /// Device of the network: devices round differently.
    pub device: Processor,
    /// Its graphics adapter; `None` for the CPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub adapter: Option<AdapterRecord>,
    /// Height and width at which the network saw the photos, in pixels.
    pub input_size: ImageSize,
    /// Tokens and Gaussians of each block.
    pub tokens: TokenRecord,
    /// The scene file.
    pub output: OutputRecord,
    /// Renders, if requested.
    pub renders: Option<RendersRecord>,
    /// Plots, if requested.
    pub plots: Option<PlotsRecord>,
    /// Warnings about input and result.
    pub warnings: Vec<String>,
}

/// The plots.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct PlotsRecord {
    /// Folder of the files.
    pub folder: PathBuf,
    /// Their names inside the folder.
    pub files: Vec<String>,
}

/// Wall-clock seconds per stage.
#[derive(Clone, Debug, Default)]
pub struct Clock {
    stages: Vec<(&'static str, f64)>,
}

impl Serialize for Clock {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.stages.iter().copied())
    }
}

impl Clock {
    /// Runs and times a stage.
    pub fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.stages.push((stage, start.elapsed().as_secs_f64()));
        result
    }

    /// Adds stages that were timed elsewhere.
    pub fn extend(&mut self, stages: impl IntoIterator<Item = (&'static str, f64)>) {
        self.stages.extend(stages);
    }
}

/// Memory in bytes.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MemoryRecord {
    #[serde(flatten)]
    estimate: MemoryEstimate,
    estimated_peak_bytes: u64,
    /// Peak of the whole process, including weights as read and images.
    measured_peak_bytes: Option<u64>,
}

impl MemoryRecord {
    /// The estimate, and the peak of the process if it is known.
    pub fn of(estimate: MemoryEstimate, measured_peak_bytes: Option<u64>) -> Self {
        Self { estimate, estimated_peak_bytes: estimate.peak_bytes(), measured_peak_bytes }
    }
}

/// The printed report; timings and memory differ between runs.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Report {
    /// The record.
    #[serde(flatten)]
    pub record: Record,
    /// Seconds per stage.
    pub seconds: Clock,
    /// Memory of the network and of the process.
    pub memory: MemoryRecord,
    /// Height and width of the photos after preprocessing, in pixels.
    #[serde(skip)]
    pub size: ImageSize,
    /// Whether the printed report lists blocks, stages and memory.
    #[serde(skip)]
    pub explain: bool,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Record { input, model, weights, output, renders, plots, .. } = &self.record;
        if let Some(message) = weights.untrained() {
            writeln!(f, "UNTRAINED: {message}")?;
        }
        let frames: Vec<String> = input.views.iter().map(|view| view.frame.to_string()).collect();
        let (scene, frames, model) = (&input.scene, frames.join(", "), &model.name);
        let input_size = self.record.input_size;
        let seen = if input_size == self.size { String::new() } else { format!(" seen at {input_size}") };
        writeln!(f, "scene {scene}, frames {frames}, {}{seen} (height x width), model {model}", self.size)?;
        let frame = output.frame.name();
        let (count, degree, file) = (output.gaussians, output.sh_degree, output.file.display());
        writeln!(f, "{count} Gaussians of degree {degree} in the {frame}'s frame into {file}")?;
        if let Some(renders) = renders {
            let images = counted(renders.files.len() as u64, "image");
            writeln!(f, "{images} into {}", renders.folder.display())?;
        }
        if let Some(plots) = plots {
            writeln!(f, "{} into {}", counted(plots.files.len() as u64, "plot"), plots.folder.display())?;
        }
        if self.explain { self.write_explanation(f) } else { Ok(()) }
    }
}

impl Report {
    fn write_explanation(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nblock  tokens in  expanded  tokens out  Gaussians  uncertainty")?;
        for (at, row) in self.record.tokens.blocks.iter().enumerate() {
            let BlockRecord { entered, expanded, left, gaussians, scores } = row;
            write!(f, "{:>5}  {entered:>9}  {expanded:>8}  {left:>10}  {gaussians:>9}", at + 1)?;
            match scores {
                Some([low, high]) => writeln!(f, "  {low:.4} to {high:.4}")?,
                None => writeln!(f)?,
            }
        }
        writeln!(f, "\nstage        seconds")?;
        for (stage, seconds) in &self.seconds.stages {
            writeln!(f, "{stage:<10}  {seconds:>8.3}")?;
        }
        writeln!(f, "{:<10}  {:>8.3}", "all", self.seconds.stages.iter().map(|(_, seconds)| seconds).sum::<f64>())?;
        let MemoryRecord { estimate, estimated_peak_bytes, measured_peak_bytes } = self.memory;
        let MemoryEstimate { weight_bytes, activation_bytes } = estimate;
        let [total, weights, values] = [estimated_peak_bytes, weight_bytes, activation_bytes].map(format_bytes);
        write!(f, "\nmemory of the network, by formula: {total} ({weights} of weights, {values} of values)")?;
        match measured_peak_bytes {
            Some(bytes) => writeln!(f, "; peak memory of the process: {}", format_bytes(bytes)),
            None => writeln!(f),
        }
    }
}
