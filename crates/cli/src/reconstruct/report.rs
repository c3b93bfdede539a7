//! The record written next to the scene file, and the printed report.

use atsplat_files::Sha256Digest;
use std::fmt;
use std::path::PathBuf;
use std::time::Instant;

use atsplat_camera::{Fallback, PoseNormalisation};
use atsplat_model::ImageSize;
use atsplat_model::budget::MemoryEstimate;
use atsplat_model::network::{Processor, Reconstruction};
use atsplat_protocol::NearFar;
use atsplat_protocol::trial::AppliedNormalisation;
use serde::Serialize;

use super::FrameArg;
use super::network::{ModelRecord, WeightsRecord};
use super::output::OutputRecord;
use super::plots::PlotsRecord;
use super::renders::RendersRecord;
use crate::process::format_bytes;

/// Everything that the Gaussians depend on, and the result. Independent of date and speed of the machine.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Record {
    pub(super) atsplat: &'static str,
    pub(super) input: InputRecord,
    pub(super) model: ModelRecord,
    pub(super) weights: WeightsRecord,
    /// Seed of random token selection.
    pub(super) seed: u64,
    /// Device of the network: devices round differently.
    pub(super) device: Processor,
    /// Height and width at which the network saw the photos, in pixels.
    pub(super) seen_at: ImageSize,
    pub(super) tokens: TokenRecord,
    pub(super) output: OutputRecord,
    pub(super) renders: Option<RendersRecord>,
    pub(super) plots: Option<PlotsRecord>,
    pub(super) warnings: Vec<String>,
}

/// The input photos and their preprocessing.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct InputRecord {
    pub(super) data: PathBuf,
    pub(super) scene: String,
    pub(super) views: Vec<ViewRecord>,
    pub(super) targets: Vec<ViewRecord>,
    /// Identity of the trial: frames, source cameras, preprocessing, normalisation, near and far planes.
    pub(super) trial: Sha256Digest,
    pub(super) protocol: Option<String>,
    pub(super) preprocessing: String,
    pub(super) normalisation: NormalisationRecord,
    pub(super) near_far: NearFar,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct ViewRecord {
    pub(super) frame: usize,
    pub(super) name: String,
}

/// `network = scale · rotation · (scene − origin)`.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct NormalisationRecord {
    rule: PoseNormalisation,
    /// Row-major.
    rotation: [[f64; 3]; 3],
    origin: [f64; 3],
    scale: f64,
    fallbacks: Vec<Fallback>,
}

impl From<&AppliedNormalisation> for NormalisationRecord {
    fn from(applied: &AppliedNormalisation) -> Self {
        let change = &applied.new_from_old;
        Self {
            rule: applied.rule.clone(),
            rotation: change.rotation.transpose().to_cols_array_2d(),
            origin: change.origin.to_array(),
            scale: change.scale,
            fallbacks: applied.fallbacks.clone(),
        }
    }
}

/// Tokens before and after each decoder block.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct TokenRecord {
    initial: usize,
    blocks: Vec<BlockRecord>,
    r#final: usize,
    gaussians: usize,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct BlockRecord {
    entered: usize,
    expanded: usize,
    left: usize,
    /// Gaussians that the head would make of the tokens that left.
    gaussians: usize,
    /// Minimum and maximum predicted uncertainty of the tokens that entered, if the block scores them.
    scores: Option<[f32; 2]>,
}

impl TokenRecord {
    pub(super) fn of(reconstruction: &Reconstruction) -> Self {
        let budget = &reconstruction.budget;
        let per_token = budget.gaussians.checked_div(budget.final_tokens).unwrap_or(0);
        let mut entered = budget.initial_tokens;
        let rows = budget.expanded.iter().zip(&budget.tokens).zip(&reconstruction.blocks);
        let blocks = rows.map(|((&expanded, &left), outcome)| {
            let scores = outcome.scores.as_ref().and_then(|scores| {
                let minimum = scores.iter().copied().min_by(f32::total_cmp)?;
                Some([minimum, scores.iter().copied().max_by(f32::total_cmp)?])
            });
            let row = BlockRecord { entered, expanded, left, gaussians: per_token * left, scores };
            entered = left;
            row
        });
        let blocks = blocks.collect();
        let (initial, r#final, gaussians) = (budget.initial_tokens, budget.final_tokens, budget.gaussians);
        Self { initial, blocks, r#final, gaussians }
    }
}

/// Wall-clock seconds per stage.
#[derive(Clone, Debug, Default)]
pub(super) struct Clock {
    stages: Vec<(&'static str, f64)>,
}

impl Serialize for Clock {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.stages.iter().copied())
    }
}

impl Clock {
    /// Runs and times a stage.
    pub(super) fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.stages.push((stage, start.elapsed().as_secs_f64()));
        result
    }

    /// Adds stages that were timed elsewhere.
    pub(super) fn extend(&mut self, stages: impl IntoIterator<Item = (&'static str, f64)>) {
        self.stages.extend(stages);
    }
}

/// Memory in bytes.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct MemoryRecord {
    #[serde(flatten)]
    estimate: MemoryEstimate,
    estimated_peak_bytes: u64,
    /// Peak of the whole process, including weights as read and images.
    measured_peak_bytes: Option<u64>,
}

impl MemoryRecord {
    pub(super) fn of(estimate: MemoryEstimate, measured_peak_bytes: Option<u64>) -> Self {
        Self { estimate, estimated_peak_bytes: estimate.peak_bytes(), measured_peak_bytes }
    }
}

/// The printed report; timings and memory differ between runs.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Report {
    #[serde(flatten)]
    pub(super) record: Record,
    pub(super) seconds: Clock,
    pub(super) memory: MemoryRecord,
    #[serde(skip)]
    pub(super) size: ImageSize,
    #[serde(skip)]
    pub(super) explain: bool,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Record { input, model, weights, output, renders, plots, .. } = &self.record;
        if let Some(message) = weights.untrained() {
            writeln!(f, "UNTRAINED: {message}")?;
        }
        let frames: Vec<String> = input.views.iter().map(|view| view.frame.to_string()).collect();
        let (scene, frames, model) = (&input.scene, frames.join(", "), model.name());
        let seen_at = self.record.seen_at;
        let seen = if seen_at == self.size { String::new() } else { format!(" seen at {seen_at}") };
        writeln!(f, "scene {scene}, frames {frames}, {}{seen} (height x width), model {model}", self.size)?;
        let frame = match output.frame {
            FrameArg::Scene => "the dataset's frame",
            FrameArg::Network => "the network's frame",
        };
        let (count, degree, file) = (output.gaussians, output.sh_degree, output.file.display());
        writeln!(f, "{count} Gaussians of degree {degree} in {frame} into {file}")?;
        if let Some(renders) = renders {
            writeln!(f, "{} pictures into {}", renders.files.len(), renders.folder.display())?;
        }
        if let Some(plots) = plots {
            writeln!(f, "{} plots into {}", plots.files.len(), plots.folder.display())?;
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
            Some(bytes) => writeln!(f, "; the process held {} at most", format_bytes(bytes)),
            None => writeln!(f),
        }
    }
}
