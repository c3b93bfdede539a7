use std::fmt;
use std::path::PathBuf;

use atsplat_eval::frame_timings::FrameTimings;
use atsplat_scene::camera_file::CameraRecord;
use atsplat_splat::effects::{EffectSummary, Explanation};
use atsplat_splat::files::{Encoding, Format};
use atsplat_splat::round_trip::RoundTrips;
use atsplat_splat::{Census, Validation};
use serde::Serialize;

use super::frames::Frame;
use super::look::LookRecord;
use super::scene_file::SceneRecord;
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
    pub(crate) scene: SceneRecord,
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
        writeln!(
            f,
            "{} Gaussians of degree {}, {}, {} bytes",
            scene.gaussians,
            scene.sh_degree,
            name(scene.format),
            scene.bytes
        )?;
        problems(f, "on import", &scene.import)?;
        problems(f, "after import", &scene.cleaning.found)?;
        if !scene.unused.is_empty() {
            writeln!(f, "unused fields of the file: {}", scene.unused.join(", "))?;
        }
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
        census(f, &record.census, scene.gaussians)?;
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

/// A readable name.
fn name(format: Format) -> String {
    match format {
        Format::Ply(Encoding::Ascii) => "PLY in ASCII".to_owned(),
        Format::Ply(Encoding::BinaryLittleEndian) => "PLY".to_owned(),
        Format::Ply(Encoding::BinaryBigEndian) => "PLY, big-endian".to_owned(),
        Format::CompressedPly => "compressed PLY".to_owned(),
        Format::Spz(version) => format!("SPZ {version}"),
        Format::Splat => ".splat".to_owned(),
    }
}

fn problems(f: &mut fmt::Formatter<'_>, when: &str, found: &Validation) -> fmt::Result {
    if found.is_clean() {
        return Ok(());
    }
    let Validation { invalid, rejected, repaired, .. } = found;
    writeln!(f, "{invalid} Gaussians with problems {when}: {rejected} removed, {repaired} repaired")?;
    for finding in &found.findings {
        write!(f, "{:>12}  ", finding.count)?;
        finding.field.serialize(&mut *f)?;
        f.write_str(": ")?;
        finding.problem.serialize(&mut *f)?;
        writeln!(f, ", first at {}", finding.first)?;
    }
    Ok(())
}

/// Mean counts over the rendered frames, each of which counts every Gaussian once.
fn census(f: &mut fmt::Formatter<'_>, census: &Census, gaussians: usize) -> fmt::Result {
    let Census { drawn, invalid, outside_depth, faint, outside_picture } = *census;
    let all = drawn + invalid + outside_depth + faint + outside_picture;
    if all == 0 {
        return Ok(());
    }
    writeln!(f, "\n{:>12}  Gaussians per frame", "")?;
    let rows = [
        (drawn, "drawn"),
        (outside_picture, "outside the image"),
        (outside_depth, "before the near plane or behind the far plane"),
        (faint, "too faint everywhere"),
        (invalid, "with a value that cannot be rendered"),
    ];
    for (count, what) in rows {
        let share = count as f64 / all as f64;
        let (mean, share) = (share * gaussians as f64, 100.0 * share);
        writeln!(f, "{mean:>12.1}  {share:>5.1} %  {what}")?;
    }
    Ok(())
}
