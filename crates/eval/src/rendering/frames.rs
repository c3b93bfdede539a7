//! Renders and writes frames in batches: while one batch is rendered, the previous one is encoded.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Instant;

use atsplat_files::{FileError, Writer};
use atsplat_pixels::{ImageU8, PixelError, Preview, Rounding, encode_png, preview_frame};
use atsplat_splat::effects::{Decision, Scene};
use atsplat_splat::{GaussianCounts, Gaussians, Renderer, Rendering, Stage};
use rayon::prelude::*;

use super::frame_timings::FrameTiming;
use super::images::{frame_file_name, is_frame_file_name, rendered_exr, rendered_image};
use super::{FrameRequest, RENDER_RECORD, RenderSettings, RenderingError};

/// Memory limit of rendered frames waiting to be written.
const MAX_PENDING_BYTES: usize = 1 << 30;

/// Which files are written per frame, and where.
#[derive(Debug)]
pub struct FrameFiles {
    /// An existing folder.
    pub folder: PathBuf,
    /// 8 bits.
    pub png: bool,
    /// Every rendered plane as f32.
    pub exr: bool,
    /// From f32 to 8 bits.
    pub rounding: Rounding,
}

/// The outcome of a frame.
#[derive(Debug)]
pub struct Frame {
    /// Names of its files inside the folder.
    pub files: Vec<String>,
    /// `None` if it was not rendered.
    pub counts: Option<GaussianCounts>,
    /// Why it is incomplete.
    pub fault: Option<String>,
    /// Decisions on effects.
    pub decisions: Vec<Decision>,
    /// Seconds per stage.
    pub timing: FrameTiming,
}

/// A rendered frame that is not written yet.
struct Pending<'a> {
    request: &'a FrameRequest,
    rendering: Result<Rendering<f32>, String>,
    decisions: Vec<Decision>,
    timing: FrameTiming,
}

/// Renders and writes every request, in order. Before the first image is written, the folder's record of earlier images is removed:
/// what is interrupted leaves images without a record, never next to one of others. A frame that cannot be rendered or encoded is
/// reported in its [`Frame`]; a file that cannot be written is an error. With `sequential`, nothing else runs while a frame is
/// rendered. `on_frame` is called after each frame, from any thread.
///
/// # Errors
/// [`RenderingError`] for files that cannot be written or removed, and images that cannot be encoded.
pub fn render_all(
    renderer: &mut dyn Renderer,
    (scene, requests): (&Scene<'_>, &[FrameRequest]),
    settings: &RenderSettings,
    files: &FrameFiles,
    mut preview: Option<&mut Preview<Writer>>,
    sequential: bool,
    on_frame: &(impl Fn() + Sync),
) -> Result<Vec<Frame>, RenderingError> {
    let mut render = |requests| render_batch(renderer, scene, requests, settings);
    let mut write = |pending| write_batch(pending, files, preview.as_deref_mut(), on_frame);
    let mut frames = Vec::with_capacity(requests.len());
    let mut pending = Vec::new();
    for batch in requests.chunks(if sequential { 1 } else { batch_length(requests) }) {
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

/// Enough frames for every thread to encode one, few enough to keep two batches in memory.
fn batch_length(requests: &[FrameRequest]) -> usize {
    let largest = requests.iter().map(|request| request.view.pixels()).max().unwrap_or(1);
    // Colour, alpha and up to three more planes, as f32.
    let fit = MAX_PENDING_BYTES / 2 / (7 * 4 * largest).max(1);
    rayon::current_num_threads().min(fit).max(1)
}

fn render_batch<'a>(
    renderer: &mut dyn Renderer,
    scene: &Scene<'_>,
    requests: &'a [FrameRequest],
    settings: &RenderSettings,
) -> Vec<Pending<'a>> {
    let mut one = |request: &'a FrameRequest| {
        let start = Instant::now();
        let before = renderer.device_counts();
        let outcome = settings.render(renderer, scene, request);
        let mut timing = FrameTiming { render_secs: start.elapsed().as_secs_f64(), ..FrameTiming::default() };
        let mut decisions = Vec::new();
        let rendering = match outcome {
            Ok((rendering, plan)) => {
                timing.stages = vec![Stage { name: "plan", secs: plan.secs() }];
                timing.stages.extend(renderer.stages());
                timing.device = renderer.device_counts().zip(before).map(|(after, before)| after - before);
                decisions = plan.decisions().to_vec();
                Ok(rendering)
            }
            Err(error) => Err(error.to_string()),
        };
        Pending { request, rendering, decisions, timing }
    };
    requests.iter().map(&mut one).collect()
}

fn write_batch(
    pending: Vec<Pending<'_>>,
    files: &FrameFiles,
    preview: Option<&mut Preview<Writer>>,
    on_frame: &(impl Fn() + Sync),
) -> Result<Vec<Frame>, RenderingError> {
    if pending.iter().any(|pending| pending.rendering.is_ok()) {
        remove_record(&files.folder)?;
    }
    let size = preview.as_ref().map(|preview| preview.size());
    let write = |pending| {
        let outcome = write_frame(pending, files, size.is_some());
        on_frame();
        let (frame, image) = outcome?;
        let image = match (image, size) {
            (Some(image), Some(size)) => Some(preview_frame(&image, size)?),
            _ => None,
        };
        Ok((frame, image))
    };
    let done: Vec<(Frame, Option<ImageU8>)> =
        pending.into_par_iter().map(write).collect::<Result<_, RenderingError>>()?;
    if let Some(preview) = preview {
        for (_, image) in &done {
            preview.push(image.as_ref())?;
        }
    }
    Ok(done.into_iter().map(|(frame, _)| frame).collect())
}

/// Removes the record of images that are about to be replaced, if there is one.
fn remove_record(folder: &Path) -> Result<(), RenderingError> {
    let record = folder.join(RENDER_RECORD);
    atsplat_files::remove_if_exists(&record).map_err(FileError::during("removing an earlier record", &record))
}

fn write_frame(
    Pending { request, rendering, decisions, timing }: Pending<'_>,
    files: &FrameFiles,
    needs_bytes: bool,
) -> Result<(Frame, Option<ImageU8>), RenderingError> {
    let mut frame = Frame { files: Vec::new(), counts: None, fault: None, decisions, timing };
    let rendering = match rendering {
        Ok(rendering) => rendering,
        Err(fault) => return Ok((Frame { fault: Some(fault), ..frame }, None)),
    };
    frame.counts = Some(rendering.counts);
    let start = Instant::now();
    if files.exr {
        write(files, request, "exr", &rendered_exr(&rendering)?, &mut frame)?;
    }
    let image = if files.png || needs_bytes {
        match rendered_image(&rendering)?.to_u8(files.rounding) {
            Ok(image) => Some(image),
            Err(fault @ PixelError::NonFinite { .. }) => {
                frame.fault = Some(format!("no 8-bit image: {fault}"));
                None
            }
            Err(error) => return Err(error.into()),
        }
    } else {
        None
    };
    if let Some(image) = image.as_ref().filter(|_| files.png) {
        write(files, request, "png", &encode_png(image)?, &mut frame)?;
    }
    frame.timing.write_secs = start.elapsed().as_secs_f64();
    Ok((frame, image))
}

fn write(
    files: &FrameFiles,
    request: &FrameRequest,
    extension: &str,
    bytes: &[u8],
    frame: &mut Frame,
) -> Result<(), RenderingError> {
    let name = frame_file_name(request.number, extension);
    let path = files.folder.join(&name);
    atsplat_files::write(&path, bytes).map_err(FileError::during::<RenderingError>("writing an image", &path))?;
    frame.files.push(name);
    Ok(())
}

/// Number of rendered frames in which no Gaussian is drawn.
pub fn empty_frames(frames: &[Frame]) -> usize {
    frames.iter().filter_map(|frame| frame.counts).filter(|counts| counts.drawn == 0).count()
}

/// The warning about frames in which no Gaussian is drawn, though the scene has some, with the likely reason.
pub fn empty_frames_warning(frames: &[Frame], gaussians: &Gaussians) -> Option<String> {
    let counts = || frames.iter().filter_map(|frame| frame.counts);
    let empty = empty_frames(frames);
    (empty > 0 && !gaussians.is_empty()).then(|| {
        let mostly_outside_depth = |GaussianCounts { invalid, outside_depth, faint, outside_image, .. }: GaussianCounts| {
            outside_depth > 9 * (invalid + faint + outside_image)
        };
        let by_depth = counts().filter(|counts| counts.drawn == 0).all(mostly_outside_depth);
        let cause = if by_depth {
            "they are behind the camera, in front of the near plane or beyond the far plane: do --near and --far suit the scene's \
             unit of length, and do the cameras look at it?"
        } else {
            "do the cameras belong to this scene and use its axes?"
        };
        format!("no Gaussian is drawn in {empty} of {} frames: {cause}", counts().count())
    })
}

/// Warns of image files in the subfolders of a folder, or in the folder itself as the subfolder `""`, that are named like frames but
/// are not among the files of this run, with their paths from the folder.
///
/// # Errors
/// [`RenderingError::Io`].
pub fn unknown_images_warning<'a>(
    folder: &Path,
    subfolders: &[&str],
    files: impl IntoIterator<Item = &'a String>,
) -> Result<Option<String>, RenderingError> {
    let ours: BTreeSet<PathBuf> = files.into_iter().map(|file| folder.join(file)).collect();
    let mut unknown = 0;
    for path in subfolders.iter().map(|subfolder| folder.join(subfolder)).filter(|path| path.is_dir()) {
        unknown += unknown_images(&path, &ours)?;
    }
    Ok((unknown > 0).then(|| format!("{} contains {unknown} images from another run", folder.display())))
}

fn unknown_images(folder: &Path, ours: &BTreeSet<PathBuf>) -> Result<usize, RenderingError> {
    let is_ours = |name: &str| ours.contains(&folder.join(name));
    let entries = std::fs::read_dir(folder).and_then(Iterator::collect::<std::io::Result<Vec<_>>>);
    let entries = entries.map_err(FileError::during::<RenderingError>("listing images", folder))?;
    let names = entries.iter().map(std::fs::DirEntry::file_name);
    Ok(names.filter(|name| name.to_str().is_some_and(|name| is_frame_file_name(name) && !is_ours(name))).count())
}
