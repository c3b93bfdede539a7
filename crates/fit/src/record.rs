use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

use atsplat_camera::{ImageSize, Similarity};
use atsplat_numeric::counted;
use serde::Serialize;

use crate::checkpoint::{hash_of, views_hash};
use crate::{Elapsed, Evaluation, Fit, FitConfig, FitError, LastSteps, ScaleEvaluation, TrainingView};

/// Everything that the Gaussians of a run depend on, and how good they are. Independent of date and speed of the machine, unless the
/// budget was a time.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
#[expect(missing_docs, reason = "the names of the record's file")]
pub struct FitRecord {
    /// Version of this toolkit.
    pub atsplat: &'static str,
    /// Its commit, or a hash of its sources, as in the provenance of results.
    pub commit: Option<&'static str>,
    pub data: PathBuf,
    pub scene: String,
    pub views: Vec<String>,
    pub held_out: Vec<String>,
    /// What became of the photos' alpha channels: `drop` or `composite`.
    pub alpha: &'static str,
    #[serde(flatten)]
    pub inputs: FitInputs,
    pub start: String,
    pub start_gaussians: usize,
    /// Initial Gaussians that were removed because they are broken, when their file was read or later.
    pub dropped: usize,
    /// Extent of the scene, in units of the data.
    pub extent: f64,
    /// Its extent is in units of the data; its renderer's constants are those of the optimisation, Mip-Splatting's blur included, near
    /// and far in the unit of length of the views, which is the network's after `--refine`.
    pub configuration: FitConfig,
    /// Graphics adapter and driver, or `cpu`.
    pub device: String,
    pub steps: u64,
    pub file: PathBuf,
    pub gaussians: usize,
    /// Corrected cameras and exposures of the training views, if these were optimised.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub corrections: Vec<Correction>,
    /// Mean PSNR of the last step on each training view, in dB, with the number of views that it is over and that it leaves out.
    #[serde(flatten)]
    pub last_steps: LastSteps,
    pub evaluations: Vec<Evaluation>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub at_scales: Vec<ScaleEvaluation>,
    pub warnings: Vec<String>,
}

/// Photos and start of a run. Each hash is a SHA-256 in hexadecimal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FitInputs {
    /// Sizes of the training views in pixels, such as `128x96`, each once.
    pub sizes: Vec<String>,
    /// Hash of cameras, lenses and pixels of the training views, in order.
    pub views_sha256: String,
    /// As `views_sha256`, of the held-out views; `None` without any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out_sha256: Option<String>,
    /// Hash of the initial Gaussians as they are given, before broken ones are repaired or removed.
    pub start_sha256: String,
}

/// What was optimised for one view.
#[derive(Clone, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Correction {
    /// Name of the view.
    pub view: String,
    /// The optimised pose in the data's world, rows of the 3×4 matrix `[R | t]`.
    pub camera_from_world: Vec<f64>,
    /// The 3×4 array of 3DGS' exposure ([`atsplat_splat::Exposure::from_3dgs`]); `None` unless it was optimised.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<[[f64; 4]; 3]>,
}

impl Fit {
    /// The inputs of this run, with the views that it is compared with.
    pub fn inputs(&self, held_out: &[TrainingView]) -> FitInputs {
        let sizes: BTreeSet<ImageSize> = self.views.iter().map(|view| view.view.size).collect();
        FitInputs {
            sizes: sizes.into_iter().map(|ImageSize { width, height }| format!("{width}x{height}")).collect(),
            views_sha256: hash_of(self.views.lines()),
            held_out_sha256: (!held_out.is_empty()).then(|| views_hash(held_out)),
            start_sha256: self.start.clone(),
        }
    }

    /// The optimised cameras and exposures of all training views; none if neither is optimised. Cameras are given in the old world
    /// of a similarity whose new world is that of the views.
    ///
    /// # Errors
    /// As [`Self::optimised_view`].
    pub fn corrections(&self, new_from_old: &Similarity) -> Result<Vec<Correction>, FitError> {
        if self.config.pose_rate.is_none() && self.config.exposure_rate.is_none() {
            return Ok(Vec::new());
        }
        let old_from_new = new_from_old.inverse();
        let correction = |(number, view): (usize, &TrainingView)| {
            let found = self.optimised_view(number)?.unwrap_or(view.view);
            let exposure = self.exposure(number).map(|exposure| exposure.to_3dgs());
            let pose = old_from_new.new_pose_from_old(&found.camera.camera_from_world.inverse())?;
            let camera_from_world = pose.inverse().to_rows().to_vec();
            Ok(Correction { view: view.name.clone(), camera_from_world, exposure })
        };
        self.views.iter().enumerate().map(correction).collect()
    }
}

/// A run for its reader.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FitReport {
    /// The record.
    #[serde(flatten)]
    pub record: FitRecord,
    /// How long the run took, with the time before it was resumed.
    pub seconds: f64,
    /// The step after which that time counts, if it is not all of the run's: earlier versions wrote checkpoints without a time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds_since_step: Option<u64>,
}

impl FitReport {
    /// The report of a run that took this long.
    pub fn new(record: FitRecord, Elapsed { seconds, since_step }: Elapsed) -> Self {
        Self { record, seconds, seconds_since_step: (since_step > 0).then_some(since_step) }
    }
}

impl fmt::Display for FitReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let FitRecord { scene, views, configuration, device, steps, file, gaussians, last_steps, evaluations, .. } =
            &self.record;
        let strategy = configuration.strategy.name();
        let (views, seconds) = (views.len(), self.seconds);
        let (seen, steps) = (counted(views as u64, "view"), counted(*steps, "step"));
        write!(f, "scene {scene}, {seen}, {strategy}, {steps} in {seconds:.1} s")?;
        if let Some(step) = self.seconds_since_step {
            write!(f, " (since step {step}: its checkpoint has no time)")?;
        }
        writeln!(f, " on {device}")?;
        writeln!(f, "{gaussians} Gaussians into {}", file.display())?;
        if let Some(text) = last_steps.text(views) {
            writeln!(f, "training: {text}")?;
        }
        if let Some(Evaluation { score, .. }) = evaluations.last() {
            writeln!(f, "{}", score.on(&counted(self.record.held_out.len() as u64, "held-out view")))?;
        }
        for ScaleEvaluation { scale, width, height, score } in &self.record.at_scales {
            let views = format!("the held-out views at {scale} times their size, {width}x{height}");
            writeln!(f, "{}", score.on(&views))?;
        }
        Ok(())
    }
}
