//! Simulated scenes as datasets, in the layouts that loaders of the field read.

mod files;
mod nerfstudio;
mod re10k;

use std::path::Path;

use atsplat_camera::ImageSize;
use atsplat_pixels::exr::{self, Channel, Channels, Values};
use atsplat_pixels::{Rounding, encode_jpeg, encode_png};
use atsplat_scene::torch::{ChunkScene, ChunkWriter};
use atsplat_scene::{Frame, Picture, Scene, SharedBytes, Warnings};
use rayon::prelude::*;
use serde::Serialize;

use crate::effects::CalledEffect;
use crate::{Request, RoomsError, SceneKind, Simulation, Split};
use files::{make_folder, write_file};

/// How a dataset lies on disk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `<split>/<key>.txt` and `<split>/<key>/<timestamp>.jpg`. Its rows have no place for a lens.
    Re10k,
    /// `<split>/000000.torch` and `<split>/index.json`, as pixelSplat's loader reads. Without a lens too.
    Chunks,
    /// `<key>/nerfstudio/transforms.json` and `images/`, as DL3DV.
    Nerfstudio,
}

/// How pictures are encoded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureCoding {
    /// Of this quality, 1 to 100: what RE10K holds.
    Jpeg(u8),
    /// Lossless: what DL3DV holds.
    Png,
}

impl PictureCoding {
    const fn extension(self) -> &'static str {
        match self {
            Self::Jpeg(_) => "jpg",
            Self::Png => "png",
        }
    }
}

/// How a dataset is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteOptions {
    /// How it lies on disk.
    pub layout: Layout,
    /// How pictures are encoded.
    pub coding: PictureCoding,
    /// Whether to write `depth/<key>/<frame>.exr`, the channel `Z`.
    pub depth: bool,
}

/// A scene's entry in `manifest.json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ManifestScene {
    /// The scene's name.
    pub key: String,
    /// What kind of place.
    pub kind: SceneKind,
    /// What it is for.
    pub split: Split,
    /// Which scene of the split.
    pub number: u32,
    /// How many frames.
    pub frames: usize,
    /// Columns and rows.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Rays a pixel.
    pub samples: u32,
    /// Share of the drawn speed that fitted the scene.
    pub slowed_to: f64,
    /// The effects that ran, and why.
    pub effects: Vec<CalledEffect>,
}

#[derive(Serialize)]
struct Manifest<'a> {
    generator: &'static str,
    version: &'static str,
    scenes: &'a [ManifestScene],
}

/// Renders all frames of a simulation and encodes them, as a scene that every writer and loader takes.
///
/// # Errors
/// As [`Simulation::picture`], and [`RoomsError::Pixels`] for a JPEG quality outside 1 to 100.
pub fn encoded_scene(simulation: &Simulation, coding: PictureCoding) -> Result<Scene, RoomsError> {
    let encode = |at| -> Result<Picture, RoomsError> {
        let picture = simulation.picture(at)?.to_u8(Rounding::Nearest)?;
        let bytes = match coding {
            PictureCoding::Jpeg(quality) => encode_jpeg(&picture, quality)?,
            PictureCoding::Png => encode_png(&picture)?,
        };
        Ok(Picture::Encoded(SharedBytes::new(bytes)))
    };
    let frames = (0..simulation.shots().len()).into_par_iter().map(|at| {
        let timestamp = simulation.shot(at)?.timestamp_micros;
        Ok(Frame {
            name: timestamp.to_string(),
            timestamp_micros: Some(timestamp),
            camera: simulation.camera(at)?,
            stated_size: Some(simulation.request().size),
            picture: encode(at)?,
        })
    });
    let frames = frames.collect::<Result<Vec<_>, RoomsError>>()?;
    Ok(Scene { key: simulation.key(), url: None, frames })
}

/// Simulates scenes one after another into a dataset and its `manifest.json`, which is written last: a folder
/// without one is not whole. `told` hears of each scene once it is written.
///
/// A lens that the layout has no place for is counted in `warnings`.
///
/// # Errors
/// [`RoomsError::Io`], [`RoomsError::Scene`] if the folder already holds chunks, and as [`Simulation::new`].
pub fn write_dataset(
    folder: &Path,
    requests: impl IntoIterator<Item = Request>,
    options: &WriteOptions,
    warnings: &mut Warnings,
    mut told: impl FnMut(&Simulation, &ManifestScene),
) -> Result<Vec<ManifestScene>, RoomsError> {
    make_folder(folder)?;
    let mut chunks: Vec<(Split, ChunkWriter)> = Vec::new();
    let mut written = Vec::new();
    for request in requests {
        let split = request.seed.split;
        let simulation = Simulation::new(request)?;
        let scene = encoded_scene(&simulation, options.coding)?;
        match options.layout {
            Layout::Re10k => re10k::write(folder, split, &scene, options.coding, warnings)?,
            Layout::Nerfstudio => nerfstudio::write(folder, &scene, options.coding, simulation.request().size)?,
            Layout::Chunks => {
                if chunks.iter().all(|(held, _)| *held != split) {
                    let writer = ChunkWriter::create(folder.join(split.to_string()), ChunkWriter::TARGET_BYTES)?;
                    chunks.push((split, writer));
                }
                let stored = ChunkScene::from_scene(&scene, warnings)?;
                if let Some((_, writer)) = chunks.iter_mut().find(|(held, _)| *held == split) {
                    writer.push(stored)?;
                }
            }
        }
        if options.depth {
            write_depth(folder, &simulation, &scene, options.layout)?;
        }
        let entry = entry(&simulation);
        told(&simulation, &entry);
        written.push(entry);
    }
    for (_, writer) in chunks {
        writer.finish()?;
    }
    let manifest = Manifest { generator: env!("CARGO_PKG_NAME"), version: env!("CARGO_PKG_VERSION"), scenes: &written };
    let path = folder.join("manifest.json");
    let json = serde_json::to_vec_pretty(&manifest).map_err(|source| RoomsError::Io {
        action: "writing a manifest",
        path: path.clone(),
        source: source.into(),
    })?;
    write_file(&path, &json)?;
    Ok(written)
}

fn entry(simulation: &Simulation) -> ManifestScene {
    let Request { kind, seed, size, samples, .. } = simulation.request();
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
        effects: simulation.called_effects().to_vec(),
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
