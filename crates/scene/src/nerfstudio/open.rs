//! How `transforms.json` scenes are detected and opened.

use super::NerfstudioScenes;
use super::source::scene_files;
use crate::format::{FormatReader, ImagePlace};
use crate::json;

pub(crate) static READER: FormatReader = FormatReader {
    data: "a transforms.json",
    required: |_| "transforms.json".to_owned(),
    images: ImagePlace::Images,
    part_of_scene: |_| None,
    is_of_captures: true,
    image_options: &["images", "prefer-undistorted"],
    reads_file: |path| path.file_name().is_some_and(|name| name == "transforms.json"),
    path_of_file: |path, start| json::starts_with_bracket(start, b'{').then(|| path.to_owned()),
    is_folder_of_format: |path| Ok(!scene_files(path, false)?.is_empty()),
    read_to_open: |_| Ok(Vec::new()),
    open: |path, options, warnings| {
        let source = NerfstudioScenes::open(path, options.nerfstudio, warnings)?;
        let collections = source.collections().clone();
        Ok((Box::new(source), collections))
    },
};
