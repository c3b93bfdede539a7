use std::fmt;
use std::path::PathBuf;

use atsplat_eval::frame_timings::FrameTimings;
use atsplat_scene::camera_file::CameraRecord;
use atsplat_splat::Census;
use atsplat_splat::effects::{EffectSummary, Explanation};
use atsplat_splat::round_trip::RoundTrips;
use atsplat_splat::scene_file::{CensusTable, SceneFileRecord};
use serde::Serialize;

use super::frames::Frame;
use super::look::LookRecord;
use super::views::{PathRecord, Shot};

/// Contents of `render.json`: everything that the images depend on, and the outcome of each. Independent of date and speed
/// of the machine.
#[derive(Debug, Serialize)]
pub(crate) struct RenderFile<'a> {
    #[serde(flatten)]
    pub(crate) record: &'a Record,
    pub(crate) views: Vec<ViewRecord>,
}

/// What all images have in common.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Record {
    pub(crate) atsplat: &'static str,
    pub(crate) scene: SceneFileRecord,
    pub(crate) path: PathRecord,
    pub(crate) backend: String,
    pub(crate) look: LookRecord,
    pub(crate) effects: EffectSummary,
    /// Rounding from f32 to 8 bits.
    pub(crate) rounding: atsplat_pixels::Rounding,
    /// Meaning of the image values.
    pub(crate) values: &'static str,
    pub(crate) frames: FrameCounts,
    /// Counts of Gaussians over all frames.
    pub(crate) census: Census,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) round_trip: Option<RoundTrips>,
    pub(crate) warnings: Vec<String>,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct FrameCounts {
    pub(crate) asked: usize,
    /// Rendered and written completely.
    pub(crate) done: usize,
    pub(crate) failed: usize,
}

/// A view and its outcome.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct ViewRecord {
    #[serde(flatten)]
    camera: CameraRecord,
    files: Vec<String>,
    census: Option<Census>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
}

impl ViewRecord {
    pub(crate) fn of(shot: &Shot, frame: &Frame) -> Self {
        Self { camera: shot.record(), files: frame.files.clone(), census: frame.census, fault: frame.fault.clone() }
    }
}

/// The printed report; timings differ between runs.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct Report {
    pub(crate) out: PathBuf,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) preview: Option<PathBuf>,
    #[serde(flatten)]
    pub(crate) record: Record,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) timings: Option<FrameTimings>,
    /// Effects of the first complete frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) explanation: Option<Explanation>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let record = &self.record;
        let scene = &record.scene;
        scene.fmt(f)?;
        let FrameCounts { asked, done, failed } = record.frames;
        write!(f, "{done} of {asked} frames by {} into {}", record.backend, self.out.display())?;
        if let Some(preview) = &self.preview {
            write!(f, ", animated in {}", preview.display())?;
        }
        writeln!(f)?;
        if failed > 0 {
            writeln!(f, "{failed} frames failed")?;
        }
        record.effects.fmt(f)?;
        CensusTable { census: record.census, gaussians: scene.gaussians }.fmt(f)?;
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
