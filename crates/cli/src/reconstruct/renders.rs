//! Renders of the Gaussians at the context and target views, in the network's frame.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_camera::{Camera, ImageSize};
use atsplat_pixels::{Rounding, encode_png};
use atsplat_protocol::NearFar;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Gaussians, RenderOptions, Renderer, View};
use serde::Serialize;

use super::input::Input;
use crate::output::PendingFile;
use crate::parse;
use crate::render::frames::file_name;
use crate::render::picture;

#[derive(Debug, clap::Args)]
pub(super) struct RenderArgs {
    /// Folder for images: `inputs/` as given to the network, `context/` renders of the same views, and `targets/`.
    #[arg(long, value_name = "DIR")]
    renders: Option<PathBuf>,

    /// Constants and rules of a published rasterizer: exact, gsplat-1.5, gsplat-1.6, inria, pixelsplat-family, or a .toml.
    #[arg(long, value_name = "PRESET", default_value = "exact", value_parser = parse::constants_name)]
    constants: String,

    /// black, white, or R,G,B from 0 to 1.
    #[arg(long, value_name = "COLOUR", default_value = "black", value_parser = parse::background)]
    background: [f64; 3],
}

/// The renders, and what they depend on in addition to the Gaussians.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct RendersRecord {
    pub(super) folder: PathBuf,
    backend: String,
    constants: String,
    /// In the network's unit of length.
    near_far: NearFar,
    background: [f64; 3],
    pub(super) files: Vec<String>,
}

impl RenderArgs {
    pub(super) fn check(&self, has_targets: bool) -> Result<(), String> {
        match (&self.renders, has_targets) {
            (None, true) => Err("--targets are views to render: add --renders DIR or --plots DIR".to_owned()),
            _ => Ok(()),
        }
    }

    /// Creates the folder before long work starts.
    pub(super) fn open(&self) -> anyhow::Result<()> {
        let Some(folder) = &self.renders else { return Ok(()) };
        PendingFile::open(&folder.join("inputs").join(file_name(0, "png"))).map(drop)
    }

    /// Render options, with lengths in the network's unit.
    pub(super) fn options(&self, near_far: NearFar) -> anyhow::Result<RenderOptions> {
        let mut options = RenderOptions {
            constants: parse::constants(&self.constants)?,
            background: self.background,
            ..RenderOptions::default()
        };
        (options.constants.near, options.constants.far) = (near_far.near, near_far.far);
        options.constants.name = format!("{} with near {} and far {}", self.constants, near_far.near, near_far.far);
        Ok(options)
    }

    /// Renders the requested views.
    pub(super) fn render(&self, gaussians: &Gaussians, input: &Input) -> anyhow::Result<Option<RendersRecord>> {
        let Some(folder) = &self.renders else { return Ok(None) };
        let trial = &input.trial;
        let mut renderer: Box<dyn Renderer> = Box::<CpuRenderer>::default();
        let near_far = trial.near_far();
        let options = self.options(near_far)?;
        let mut files = Vec::new();
        for view in trial.context() {
            files.push(write(folder, "inputs", view.frame, &encode_png(view.picture()?.as_ref())?)?);
        }
        let context = trial.context().iter().map(|view| ("context", view.frame, view.camera, view.size));
        let targets = trial.targets().iter().map(|view| ("targets", view.frame, view.camera, view.size));
        for (subfolder, frame, camera, size) in context.chain(targets) {
            let png = png(renderer.as_mut(), gaussians, (camera, size), &options);
            files.push(write(folder, subfolder, frame, &png.with_context(|| format!("rendering frame {frame}"))?)?);
        }
        let (backend, constants) = (renderer.name(), options.constants.name);
        let (folder, background) = (folder.clone(), self.background);
        Ok(Some(RendersRecord { folder, backend, constants, near_far, background, files }))
    }
}

fn png(
    renderer: &mut dyn Renderer,
    gaussians: &Gaussians,
    (camera, size): (Camera, ImageSize),
    options: &RenderOptions,
) -> anyhow::Result<Vec<u8>> {
    let rendering = renderer.render(gaussians, &View { camera, size }, options)?;
    Ok(encode_png(&picture::image(&rendering)?.to_u8(Rounding::Nearest)?)?)
}

fn write(folder: &Path, subfolder: &str, frame: usize, bytes: &[u8]) -> anyhow::Result<String> {
    let name = format!("{subfolder}/{}", file_name(frame, "png"));
    PendingFile::open(&folder.join(&name))?.finish(bytes)?;
    Ok(name)
}
