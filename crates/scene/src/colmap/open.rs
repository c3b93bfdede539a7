//! How COLMAP models are detected and opened.

use std::path::{Path, PathBuf};

use super::source::{model_folders, part_of_model};
use super::{ColmapScenes, PARTS};
use crate::files::has_extension;
use crate::format::{FormatReader, ImagePlace};

pub(crate) static READER: FormatReader = FormatReader {
    data: "a COLMAP model",
    required: |_| "COLMAP model".to_owned(),
    images: ImagePlace::Images,
    part_of_scene: |folder| part_of_model(folder).map(|(part, _)| part),
    is_of_captures: true,
    image_options: &["images", "frames"],
    reads_file: |path| is_part_of_model(path) && (has_extension(path, "bin") || has_extension(path, "txt")),
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
    let folder = file.parent().filter(|folder| *folder != Path::new("")).unwrap_or_else(|| Path::new("."));
    is_part_of_model(file).then(|| folder.to_owned())
}

fn is_part_of_model(file: &Path) -> bool {
    let stem = file.file_stem().and_then(|stem| stem.to_str());
    stem.is_some_and(|stem| PARTS.contains(&stem))
}
