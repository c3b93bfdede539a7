use std::fmt;
use std::path::PathBuf;

use atsplat_numeric::counted;
use atsplat_scene::camera_file::CameraRecord;
use atsplat_splat::GaussianCounts;
use atsplat_splat::effects::{EffectSummary, Explanation};
use atsplat_splat::round_trip::RoundTrips;
use atsplat_splat::scene_file::{GaussianCountsTable, SceneFileRecord};
use serde::Serialize;

use super::frame_timings::FrameTimings;
use super::{Frame, FrameRequest, PathRecord, RenderSettingsRecord};

/// Name of the file that records how the images of its folder were made.
pub const RENDER_RECORD: &str = "render.json";

/// Contents of `render.json`: everything that the images depend on, and the outcome of each. Independent of date and speed
/// of the machine.
#[derive(Debug, Serialize)]
pub struct RenderFile<'a> {
    /// What all images have in common.
    #[serde(flatten)]
    pub record: &'a Record,
    /// Each view and its outcome.
    pub views: Vec<ViewRecord>,
}

/// What all images have in common.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Record {
    /// Version of this toolkit.
    pub atsplat: &'static str,
    /// The Gaussians.
    pub scene: SceneFileRecord,
    /// The cameras.
    pub path: PathRecord,
    /// Name of the renderer.
    pub backend: String,
    /// Render options.
    pub settings: RenderSettingsRecord,
    /// Which effects ran.
    pub effects: EffectSummary,
    /// Rounding from f32 to 8 bits.
    pub rounding: atsplat_pixels::Rounding,
    /// Meaning of the image values.
    pub values: &'static str,
    /// Numbers of frames.
    pub frames: FrameCounts,
    /// Counts of Gaussians over all frames.
    pub gaussian_counts: GaussianCounts,
    /// Loss of exporting and importing, if measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub round_trip: Option<RoundTrips>,
    /// Warnings about scene, cameras and frames.
    pub warnings: Vec<String>,
}

/// Numbers of frames.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FrameCounts {
    /// Frames of the path.
    pub requested: usize,
    /// Rendered and written completely.
    pub done: usize,
    /// The others.
    pub failed: usize,
}

/// A view and its outcome.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ViewRecord {
    #[serde(flatten)]
    camera: CameraRecord,
    files: Vec<String>,
    gaussian_counts: Option<GaussianCounts>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
}

impl ViewRecord {
    /// The record of a request that was rendered as this frame.
    pub fn of(request: &FrameRequest, frame: &Frame) -> Self {
        let (files, fault) = (frame.files.clone(), frame.fault.clone());
        Self { camera: request.record(), files, gaussian_counts: frame.counts, fault }
    }
}

/// The printed report; timings differ between runs.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct Report {
    /// Folder of the images.
    pub out: PathBuf,
    /// The animation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preview: Option<PathBuf>,
    /// The record.
    #[serde(flatten)]
    pub record: Record,
    /// Seconds per stage.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timings: Option<FrameTimings>,
    /// Effects of the first complete frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub explanation: Option<Explanation>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let record = &self.record;
        let scene = &record.scene;
        scene.fmt(f)?;
        let FrameCounts { requested, done, failed } = record.frames;
        write!(f, "{done} of {requested} frames by {} into {}", record.backend, self.out.display())?;
        if let Some(preview) = &self.preview {
            write!(f, ", animated in {}", preview.display())?;
        }
        writeln!(f)?;
        if failed > 0 {
            writeln!(f, "{} failed", counted(failed as u64, "frame"))?;
        }
        record.effects.fmt(f)?;
        GaussianCountsTable { counts: record.gaussian_counts, gaussians: scene.gaussians }.fmt(f)?;
        if let Some(timings) = &self.timings {
            timings.fmt(f)?;
        }
        if let Some(explanation) = &self.explanation {
            write!(f, "\n{explanation}")?;
        }
        if let Some(round_trip) = &record.round_trip {
            round_trip.fmt(f)?;
        }
        Ok(())
    }
}
