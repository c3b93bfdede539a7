//! What is recorded beside the file, and what is printed of it.

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

use super::FrameWord;
use super::network::{ModelRecord, WeightsRecord};
use super::output::OutputRecord;
use super::plots::PlotsRecord;
use super::renders::RendersRecord;
use crate::memory::for_people;

/// Everything that the Gaussians depend on, and what came out. Nothing in it depends on the day or on the machine's speed.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Record {
    pub(super) atsplat: &'static str,
    pub(super) input: InputRecord,
    pub(super) model: ModelRecord,
    pub(super) weights: WeightsRecord,
    /// What random selection drew with.
    pub(super) seed: u64,
    /// What the network computed on: others round otherwise.
    pub(super) device: Processor,
    /// Height and width at which the network saw the photos.
    pub(super) seen_at: ImageSize,
    pub(super) tokens: TokenRecord,
    pub(super) output: OutputRecord,
    pub(super) renders: Option<RendersRecord>,
    pub(super) plots: Option<PlotsRecord>,
    pub(super) warnings: Vec<String>,
}

/// Photos and what happened to them.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct InputRecord {
    pub(super) data: PathBuf,
    pub(super) scene: String,
    pub(super) views: Vec<ViewRecord>,
    pub(super) targets: Vec<ViewRecord>,
    /// Identity of the question: frames, source cameras, preprocessing, normalisation, planes.
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
    /// Row by row.
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

/// Tokens through the decoder.
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
    /// What the head would make of the tokens that left.
    gaussians: usize,
    /// Least and greatest predicted uncertainty of the tokens that entered, where the block scores them.
    scores: Option<[f32; 2]>,
}

impl TokenRecord {
    pub(super) fn of(made: &Reconstruction) -> Self {
        let budget = &made.budget;
        let per_token = budget.gaussians.checked_div(budget.final_tokens).unwrap_or_default();
        let mut entered = budget.initial_tokens;
        let rows = budget.expanded.iter().zip(&budget.tokens).zip(&made.blocks);
        let blocks = rows.map(|((&expanded, &left), outcome)| {
            let scores = outcome.scores.as_ref().and_then(|scores| {
                let least = scores.iter().copied().min_by(f32::total_cmp)?;
                Some([least, scores.iter().copied().max_by(f32::total_cmp)?])
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

/// Wall-clock seconds, stage by stage.
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
    /// Runs a stage.
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

/// Bytes.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct MemoryRecord {
    #[serde(flatten)]
    estimate: MemoryEstimate,
    estimated_peak_bytes: u64,
    /// What the process held at most, weights as read and pictures included.
    measured_peak_bytes: Option<u64>,
}

impl MemoryRecord {
    pub(super) fn of(estimate: MemoryEstimate, measured_peak_bytes: Option<u64>) -> Self {
        Self { estimate, estimated_peak_bytes: estimate.peak_bytes(), measured_peak_bytes }
    }
}

/// What is printed; part of it is not the same on every run.
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
        if let Some(told) = weights.untrained() {
            writeln!(f, "UNTRAINED: {told}")?;
        }
        let frames: Vec<String> = input.views.iter().map(|view| view.frame.to_string()).collect();
        let (scene, frames, model) = (&input.scene, frames.join(", "), model.name());
        let seen_at = self.record.seen_at;
        let seen = if seen_at == self.size { String::new() } else { format!(" seen at {seen_at}") };
        writeln!(f, "scene {scene}, frames {frames}, {}{seen} (height x width), model {model}", self.size)?;
        let whose = match output.frame {
            FrameWord::Scene => "the dataset's frame",
            FrameWord::Network => "the network's frame",
        };
        let (count, degree, file) = (output.gaussians, output.sh_degree, output.file.display());
        writeln!(f, "{count} Gaussians of degree {degree} in {whose} into {file}")?;
        if let Some(renders) = renders {
            writeln!(f, "{} pictures into {}", renders.files.len(), renders.folder.display())?;
        }
        if let Some(plots) = plots {
            writeln!(f, "{} plots into {}", plots.files.len(), plots.folder.display())?;
        }
        if self.explain { self.explained(f) } else { Ok(()) }
    }
}

impl Report {
    fn explained(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\nblock  tokens in  expanded  tokens out  Gaussians  uncertainty")?;
        for (at, row) in self.record.tokens.blocks.iter().enumerate() {
            let BlockRecord { entered, expanded, left, gaussians, scores } = row;
            write!(f, "{:>5}  {entered:>9}  {expanded:>8}  {left:>10}  {gaussians:>9}", at + 1)?;
            match scores {
                Some([least, most]) => writeln!(f, "  {least:.4} to {most:.4}")?,
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
        let [all, weights, values] = [estimated_peak_bytes, weight_bytes, activation_bytes].map(for_people);
        write!(f, "\nmemory of the network, by formula: {all} ({weights} of weights, {values} of values)")?;
        match measured_peak_bytes {
            Some(bytes) => writeln!(f, "; the process held {} at most", for_people(bytes)),
            None => writeln!(f),
        }
    }
}
