//! Simulated scenes as datasets, in published layouts.

mod nerfstudio;
mod options;
mod re10k;

use std::collections::BTreeSet;
use std::path::Path;

use atsplat_camera::ImageSize;
use atsplat_files::{FileError, Sha256Digest, create_folder};
use atsplat_pixels::exr::{self, Channel, Channels, Values};
use atsplat_pixels::{Rounding, encode_jpeg, encode_png};
use atsplat_scene::torch::{ChunkScene, ChunkWriter};
use atsplat_scene::{Frame, FrameImage, Scene, SharedBytes, Warnings};
use rayon::prelude::*;
use serde::Serialize;

pub use options::{ImageEncoding, Layout, WriteOptions};

use crate::effects::{AbsentEffect, ActiveEffect, EffectKind};
use crate::{EffectChoice, GENERATOR, Request, RoomsError, SceneKind, Simulation, Split};

/// A scene's entry in `manifest.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ManifestScene {
    /// The scene's name.
    pub key: String,
    /// Kind of scene.
    pub kind: SceneKind,
    /// Split of the scene.
    pub split: Split,
    /// Number of the scene within the split.
    pub number: u32,
    /// Number of frames.
    pub frames: usize,
    /// Columns of each image.
    pub width: u32,
    /// Rows of each image.
    pub height: u32,
    /// Rays per pixel.
    pub samples: u32,
    /// Camera speed as a share of the drawn speed ([`Simulation::slowed_to`]).
    pub slowed_to: f64,
    /// The requested effects.
    pub requested_effects: EffectChoice,
    /// The effects that ran, with reasons.
    pub effects: Vec<ActiveEffect>,
    /// The effects that were requested or that the scene needs, but that its images do not show, with reasons.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub absent_effects: Vec<AbsentEffect>,
    /// Hash of the given route's cameras and times; none for a natural route.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub route: Option<Sha256Digest>,
}

#[derive(Serialize)]
struct Manifest<'a> {
    /// [`GENERATOR`].
    generator: &'static str,
    /// Version of this program.
    version: &'static str,
    layout: Layout,
    images: ImageEncoding,
    depth: bool,
    scenes: &'a [ManifestScene],
}

/// Renders and encodes all frames of a simulation, as a scene for any writer.
///
/// # Errors
/// As [`Simulation::image`], and [`RoomsError::Pixels`] for a JPEG quality outside 1 to 100.
pub fn encoded_scene(simulation: &Simulation, encoding: ImageEncoding) -> Result<Scene, RoomsError> {
    let encode = |at| -> Result<FrameImage, RoomsError> {
        let image = simulation.image(at)?.to_u8(Rounding::Nearest)?;
        let bytes = match encoding {
            ImageEncoding::Jpeg(quality) => encode_jpeg(&image, quality)?,
            ImageEncoding::Png => encode_png(&image)?,
        };
        Ok(FrameImage::Encoded(SharedBytes::new(bytes)))
    };
    let frames = (0..simulation.shots().len()).into_par_iter().map(|at| simulation.frame_with(at, encode(at)?));
    let frames = frames.collect::<Result<Vec<_>, RoomsError>>()?;
    Ok(Scene { key: simulation.key(), url: None, frames })
}

/// Simulates scenes one after another into a dataset and its `manifest.json`, which is removed first and written last: a folder
/// without it is incomplete. Other files of an earlier dataset stay, so the folder should be empty. `on_scene` is called after
/// each scene.
///
/// In a layout without lenses ([`Layout::stores_lenses`]), a lens that the scene needs is left out of its images; it is one of
/// [`ManifestScene::absent_effects`].
///
/// # Errors
/// [`RoomsError::Io`], [`RoomsError::Scene`] if the folder already contains chunks, and [`RoomsError::Simulating`] with a reason
/// as of [`Simulation::new`], for a lens that is requested in a layout without, or for a route with a time twice where files are
/// named after it.
pub fn write_dataset(
    folder: &Path,
    requests: impl IntoIterator<Item = Request>,
    options: &WriteOptions,
    warnings: &mut Warnings,
    mut on_scene: impl FnMut(&Simulation, &ManifestScene),
) -> Result<Vec<ManifestScene>, RoomsError> {
    make_folder(folder)?;
    let manifest = folder.join("manifest.json");
    remove_file(&manifest)?;
    let mut chunks: Vec<(Split, ChunkWriter)> = Vec::new();
    let mut written = Vec::new();
    for request in requests {
        let (key, split) = (request.seed.key(request.kind), request.seed.split);
        let named = |source| RoomsError::Simulating { key, source: Box::new(source) };
        let (simulation, scene) = simulated(request, *options).map_err(named)?;
        match options.layout {
            Layout::Re10k => re10k::write(folder, split, &scene, options.encoding)?,
            Layout::Nerfstudio => nerfstudio::write(folder, &scene, options.encoding, simulation.request().size)?,
            Layout::Chunks => {
                let writer = chunk_writer(&mut chunks, folder, split)?;
                writer.push(ChunkScene::from_scene(&scene, warnings)?)?;
            }
        }
        if options.depth {
            write_depth(folder, &simulation, &scene, options.layout)?;
        }
        let entry = entry(&simulation);
        on_scene(&simulation, &entry);
        written.push(entry);
    }
    for (_, writer) in chunks {
        writer.finish()?;
    }
    write_manifest(&manifest, *options, &written)?;
    Ok(written)
}

/// Simulates a scene, checks that the layout can store its lens and its times, and encodes its images.
fn simulated(request: Request, options: WriteOptions) -> Result<(Simulation, Scene), RoomsError> {
    let keeps_lens = options.layout.stores_lenses();
    if !keeps_lens && request.effects.requests(EffectKind::LensDistortion) {
        return Err(RoomsError::Request {
            field: "effects",
            expected: "no lens-distortion, which only the nerfstudio layout can store",
            found: request.effects.to_string(),
        });
    }
    let simulation = Simulation::new(request)?;
    let simulation = if keeps_lens { simulation } else { simulation.without_lens() };
    if options.layout == Layout::Re10k || (options.layout == Layout::Chunks && options.depth) {
        distinct_times(&simulation)?;
    }
    let scene = encoded_scene(&simulation, options.encoding)?;
    Ok((simulation, scene))
}

/// The writer of a split's chunks, opened at the first scene of the split.
fn chunk_writer<'a>(
    writers: &'a mut Vec<(Split, ChunkWriter)>,
    folder: &Path,
    split: Split,
) -> Result<&'a mut ChunkWriter, RoomsError> {
    let at = if let Some(open) = writers.iter().position(|(of, _)| *of == split) {
        open
    } else {
        let writer = ChunkWriter::create(folder.join(split.to_string()), ChunkWriter::TARGET_BYTES)?;
        writers.push((split, writer));
        writers.len() - 1
    };
    Ok(&mut writers[at].1)
}

fn write_manifest(path: &Path, options: WriteOptions, scenes: &[ManifestScene]) -> Result<(), RoomsError> {
    let WriteOptions { layout, encoding: images, depth } = options;
    let version = env!("CARGO_PKG_VERSION");
    let manifest = Manifest { generator: GENERATOR, version, layout, images, depth, scenes };
    let json = serde_json::to_vec_pretty(&manifest).map_err(std::io::Error::from);
    let json = json.map_err(FileError::during::<RoomsError>("writing a manifest", path))?;
    write_file(path, &json)
}

/// Checks that files named after the times of frames do not replace each other: a given route may have a time twice.
fn distinct_times(simulation: &Simulation) -> Result<(), RoomsError> {
    let mut seen = BTreeSet::new();
    let mut times = simulation.shots().iter().map(|shot| shot.timestamp_micros);
    match times.find(|time| !seen.insert(*time)) {
        None => Ok(()),
        Some(time) => Err(RoomsError::Request {
            field: "trajectory",
            expected: "distinct times, because files are named after them (except in the nerfstudio layout)",
            found: format!("{time} µs again"),
        }),
    }
}

fn make_folder(folder: &Path) -> Result<(), RoomsError> {
    create_folder(folder).map_err(FileError::during("creating a folder", folder))
}

/// Removes a file if there is one.
fn remove_file(path: &Path) -> Result<(), RoomsError> {
    atsplat_files::remove_if_exists(path).map_err(FileError::during("removing", path))
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), RoomsError> {
    atsplat_files::write_unsynced(path, bytes).map_err(FileError::during("writing", path))
}

/// The encoded image of a frame of [`encoded_scene`].
fn encoded(frame: &Frame) -> &[u8] {
    match &frame.image {
        FrameImage::Encoded(bytes) => bytes,
        other => unreachable!("the frames of `encoded_scene` are encoded, not {other:?}"),
    }
}

fn entry(simulation: &Simulation) -> ManifestScene {
    let Request { kind, seed, size, samples, effects, route, .. } = simulation.request();
    ManifestScene {
        key: simulation.key(),
        kind: *kind,
        split: seed.split,
        number: seed.number,
        frames: simulation.shots().len(),
        width: size.width,
        height: size.height,
        samples: *samples,
        slowed_to: simulation.slowed_to(),
        requested_effects: effects.clone(),
        effects: simulation.active_effects().to_vec(),
        absent_effects: simulation.absent_effects().to_vec(),
        route: route.digest(),
    }
}

fn write_depth(folder: &Path, simulation: &Simulation, scene: &Scene, layout: Layout) -> Result<(), RoomsError> {
    let folder = folder.join("depth").join(&scene.key);
    make_folder(&folder)?;
    scene.frames.par_iter().enumerate().try_for_each(|(at, frame)| {
        let geometry = simulation.geometry(at)?;
        let ImageSize { width, height } = geometry.size;
        let plane = Channel { name: "Z".to_owned(), values: Values::Depth, samples: geometry.depth };
        let name = match layout {
            Layout::Re10k | Layout::Chunks => frame.name.clone(),
            Layout::Nerfstudio => nerfstudio::stem(at),
        };
        write_file(&folder.join(format!("{name}.exr")), &exr::write(&Channels::new(width, height, vec![plane])?)?)
    })
}
