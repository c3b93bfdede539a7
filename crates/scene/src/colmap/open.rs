//! How COLMAP models are detected and opened.

use std::path::{Path, PathBuf};

use super::ColmapScenes;
use super::source::model_folders;
use crate::format::{Format, FormatReader};

pub(crate) const READER: FormatReader = FormatReader {
    format: Format::Colmap,
    path_of_file: |path, _| model_around(path),
    is_folder_of_format: |path| Ok(!model_folders(path)?.is_empty()),
    read_to_open: |_| Ok(Vec::new()),
    open: |path, options, _| {
        let source = ColmapScenes::open(path, options.colmap.clone())?;
        let collections = source.collections();
        Ok((Box::new(source), collections))
    },
};

/// The folder of the model that `file` belongs to.
fn model_around(file: &Path) -> Option<PathBuf> {
    folder_of_part(file).filter(|folder| model_folders(folder).is_ok_and(|models| !models.is_empty()))
}

/// The folder of a file that is named like one of a model.
pub(crate) fn folder_of_part(file: &Path) -> Option<PathBuf> {
    let is_part = matches!(file.file_stem()?.to_str()?, "cameras" | "images" | "points3D");
    let folder = file.parent().filter(|folder| *folder != Path::new("")).unwrap_or_else(|| Path::new("."));
    is_part.then(|| folder.to_owned())
}
