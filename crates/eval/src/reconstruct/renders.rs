use std::path::{Path, PathBuf};

use atsplat_pixels::{Rounding, encode_png};
use atsplat_protocol::NearFar;
use atsplat_splat::{Gaussians, RenderOptions, View};
use serde::Serialize;

use super::{Photos, ReconstructError};
use crate::method::Backend;
use crate::rendering::{RenderingError, frame_file_name, rendered_image, unknown_images_warning};

/// The renders of a reconstruction, and what they depend on in addition to the Gaussians.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RendersRecord {
    /// Folder of the files.
    pub folder: PathBuf,
    /// Name of the renderer.
    pub backend: String,
    /// Name of the renderer constants.
    pub constants: String,
    /// In the network's unit of length.
    pub near_far: NearFar,
    /// Background colour.
    pub background: [f64; 3],
    /// Names of the files inside the folder.
    pub files: Vec<String>,
}

/// Subfolders of renders.
const FOLDERS: [&str; 3] = ["inputs", "context", "targets"];

impl RendersRecord {
    /// A warning about images of another run in the same folders, if there are any.
    ///
    /// # Errors
    /// [`RenderingError::Io`] if a folder cannot be listed.
    pub fn unknown_images_warning(&self) -> Result<Option<String>, RenderingError> {
        unknown_images_warning(&self.folder, &FOLDERS, &self.files)
    }
}

/// Writes PNG files of the context images to `inputs/`, and of the renders at context and target views to `context/` and
/// `targets/`. Gaussians are in the network's frame.
///
/// # Errors
/// [`ReconstructError::Render`], [`ReconstructError::Write`], or the error of an image that cannot be read.
pub fn write_renders(
    folder: &Path,
    gaussians: &Gaussians,
    photos: &Photos,
    options: &RenderOptions,
    backend: &Backend,
) -> Result<RendersRecord, ReconstructError> {
    let trial = photos.trial();
    let mut files = Vec::new();
    for view in trial.context() {
        files.push(write(folder, "inputs", view.frame, &encode_png(view.image()?.as_ref())?)?);
    }
    let context = trial.context().iter().map(|view| ("context", view.frame, view.camera, view.size));
    let targets = trial.targets().iter().map(|view| ("targets", view.frame, view.camera, view.size));
    for (subfolder, frame, camera, size) in context.chain(targets) {
        let rendering = backend.with(|renderer| renderer.render(gaussians, &View { camera, size }, options));
        let rendering = rendering.map_err(|source| ReconstructError::Render { frame, source })?;
        let png = encode_png(&rendered_image(&rendering)?.to_u8(Rounding::Nearest)?)?;
        files.push(write(folder, subfolder, frame, &png)?);
    }
    Ok(RendersRecord {
        folder: folder.to_owned(),
        backend: backend.name(),
        constants: options.constants.name.clone(),
        near_far: trial.near_far(),
        background: options.background,
        files,
    })
}

fn write(folder: &Path, subfolder: &str, frame: usize, bytes: &[u8]) -> Result<String, ReconstructError> {
    let name = frame_file_name(frame, "png");
    let path = folder.join(subfolder).join(&name);
    let written =
        std::fs::create_dir_all(folder.join(subfolder)).and_then(|()| atsplat_files::write(&path, bytes).map(drop));
    written.map_err(|source| ReconstructError::Write { path, source })?;
    Ok(format!("{subfolder}/{name}"))
}
