//! Renders and writes frames in batches: while one batch is rendered, the previous one is encoded.

use std::path::{Path, PathBuf};
use std::time::Instant;

use atsplat_eval::frame_timings::FrameTiming;
use atsplat_eval::images::{frame_file_name, is_frame_file_name, rendered_exr, rendered_image};
use atsplat_files::Writer;
use atsplat_pixels::{ImageU8, PixelError, Preview, Rounding, encode_png, preview_frame};
use atsplat_splat::effects::{Decision, Scene};
use atsplat_splat::{Census, Gaussians, Renderer, Rendering, Stage};
use rayon::prelude::*;

use super::effects::Look;
use super::views::Shot;
use crate::output::PendingFile;
use crate::progress::Progress;

/// Memory limit of rendered frames waiting to be written.
const MAX_PENDING_BYTES: usize = 1 << 30;

/// Which files are written per frame, and where.
#[derive(Debug)]
pub(crate) struct FrameFiles {
    pub(crate) folder: PathBuf,
    pub(crate) png: bool,
    pub(crate) exr: bool,
    pub(crate) rounding: Rounding,
}

/// The outcome of a frame.
#[derive(Debug)]
pub(crate) struct Frame {
    /// Names of its files inside the folder.
    pub(crate) files: Vec<String>,
    /// `None` if it was not rendered.
    pub(crate) census: Option<Census>,
    /// Why it is incomplete.
    pub(crate) fault: Option<String>,
    /// Decisions on effects.
    pub(crate) decisions: Vec<Decision>,
    pub(crate) timing: FrameTiming,
}

/// A rendered frame that is not written yet.
struct Pending<'a> {
    shot: &'a Shot,
    rendering: Result<Rendering<f32>, String>,
    decisions: Vec<Decision>,
    timing: FrameTiming,
}

/// Renders and writes every shot, in order. A frame that cannot be rendered or encoded is reported in its [`Frame`]; a file
/// that cannot be written is an error. With `sequential`, nothing else runs while a frame is rendered.
pub(crate) fn render_all(
    renderer: &mut dyn Renderer,
    (scene, shots): (&Scene<'_>, &[Shot]),
    look: &Look,
    files: &FrameFiles,
    mut preview: Option<&mut Preview<Writer>>,
    sequential: bool,
) -> anyhow::Result<Vec<Frame>> {
    let progress = Progress::new("frames", shots.len());
    let mut render = |shots| render_batch(renderer, scene, shots, look);
    let mut write = |pending| write_batch(pending, files, preview.as_deref_mut(), &progress);
    let mut frames = Vec::with_capacity(shots.len());
    let mut pending = Vec::new();
    for batch in shots.chunks(if sequential { 1 } else { batch_length(shots) }) {
        let previous = std::mem::take(&mut pending);
        let (done, next) = if sequential {
            (write(previous), render(batch))
        } else {
            rayon::join(|| write(previous), || render(batch))
        };
        frames.extend(done?);
        pending = next;
    }
    frames.extend(write(pending)?);
    Ok(frames)
}

/// Enough frames for every thread to encode one, few enough to hold two batches in memory.
fn batch_length(shots: &[Shot]) -> usize {
    let largest = shots.iter().map(|shot| shot.view.pixels()).max().unwrap_or(1);
    // Colour, alpha and up to three more planes, as f32.
    let fit = MAX_PENDING_BYTES / 2 / (7 * 4 * largest).max(1);
    rayon::current_num_threads().min(fit).max(1)
}

fn render_batch<'a>(
    renderer: &mut dyn Renderer,
    scene: &Scene<'_>,
    shots: &'a [Shot],
    look: &Look,
) -> Vec<Pending<'a>> {
    let mut one = |shot: &'a Shot| {
        let start = Instant::now();
        let outcome = look.render(renderer, scene, shot);
        let mut timing = FrameTiming { render_secs: start.elapsed().as_secs_f64(), ..FrameTiming::default() };
        let mut decisions = Vec::new();
        let rendering = match outcome {
            Ok((rendering, plan)) => {
                timing.stages = vec![Stage { name: "plan", secs: plan.secs() }];
                timing.stages.extend(renderer.stages());
                decisions = plan.decisions().to_vec();
                Ok(rendering)
            }
            Err(error) => Err(error.to_string()),
        };
        Pending { shot, rendering, decisions, timing }
    };
    shots.iter().map(&mut one).collect()
}

fn write_batch(
    pending: Vec<Pending<'_>>,
    files: &FrameFiles,
    preview: Option<&mut Preview<Writer>>,
    progress: &Progress,
) -> anyhow::Result<Vec<Frame>> {
    let size = preview.as_ref().map(|preview| preview.size());
    let write = |pending| {
        let outcome = write_frame(pending, files, size.is_some());
        progress.step();
        let (frame, picture) = outcome?;
        let picture = match (picture, size) {
            (Some(picture), Some(size)) => Some(preview_frame(&picture, size)?),
            _ => None,
        };
        Ok((frame, picture))
    };
    let done: Vec<(Frame, Option<ImageU8>)> = pending.into_par_iter().map(write).collect::<anyhow::Result<_>>()?;
    if let Some(preview) = preview {
        for (_, picture) in &done {
            preview.push(picture.as_ref())?;
        }
    }
    Ok(done.into_iter().map(|(frame, _)| frame).collect())
}

fn write_frame(
    Pending { shot, rendering, decisions, timing }: Pending<'_>,
    files: &FrameFiles,
    needs_bytes: bool,
) -> anyhow::Result<(Frame, Option<ImageU8>)> {
    let mut frame = Frame { files: Vec::new(), census: None, fault: None, decisions, timing };
    let rendering = match rendering {
        Ok(rendering) => rendering,
        Err(fault) => return Ok((Frame { fault: Some(fault), ..frame }, None)),
    };
    frame.census = Some(rendering.census);
    let start = Instant::now();
    if files.exr {
        write(files, shot, "exr", &rendered_exr(&rendering)?, &mut frame)?;
    }
    let picture = if files.png || needs_bytes {
        match rendered_image(&rendering)?.to_u8(files.rounding) {
            Ok(picture) => Some(picture),
            Err(fault @ PixelError::NonFinite { .. }) => {
                frame.fault = Some(format!("no 8-bit image: {fault}"));
                None
            }
            Err(error) => return Err(error.into()),
        }
    } else {
        None
    };
    if let Some(picture) = picture.as_ref().filter(|_| files.png) {
        write(files, shot, "png", &encode_png(picture)?, &mut frame)?;
    }
    frame.timing.write_secs = start.elapsed().as_secs_f64();
    Ok((frame, picture))
}

fn write(files: &FrameFiles, shot: &Shot, extension: &str, bytes: &[u8], frame: &mut Frame) -> anyhow::Result<()> {
    let name = frame_file_name(shot.number, extension);
    PendingFile::open(&files.folder.join(&name))?.finish(bytes)?;
    frame.files.push(name);
    Ok(())
}

/// The warning about frames in which no Gaussian is drawn, though the scene has some.
pub(crate) fn empty_frames_warning(frames: &[Frame], gaussians: &Gaussians) -> Option<String> {
    let rendered = frames.iter().filter_map(|frame| frame.census).collect::<Vec<_>>();
    let empty = rendered.iter().filter(|census| census.drawn == 0).count();
    (empty > 0 && !gaussians.is_empty()).then(|| {
        let all = rendered.len();
        format!(
            "no Gaussian is drawn in {empty} of {all} frames: do the cameras belong to this scene and use its axes?"
        )
    })
}

/// Number of image files in a folder that are named like frames but were written by another call.
pub(crate) fn unknown_images(folder: &Path, frames: &[Frame]) -> anyhow::Result<usize> {
    let is_ours = |name: &str| frames.iter().any(|frame| frame.files.iter().any(|file| file == name));
    let entries = std::fs::read_dir(folder)?.collect::<std::io::Result<Vec<_>>>()?;
    let names = entries.iter().map(std::fs::DirEntry::file_name);
    Ok(names.filter(|name| name.to_str().is_some_and(|name| is_frame_file_name(name) && !is_ours(name))).count())
}

/// Creates the folder and opens `render.json` before long work starts.
pub(crate) fn open_folder(folder: &Path) -> anyhow::Result<PendingFile> {
    PendingFile::open(&folder.join("render.json"))
}
