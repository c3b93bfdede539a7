//! How `transforms.json` scenes are detected and opened.

use std::path::Path;

use super::NerfstudioScenes;
use super::layout::is_named_transforms;
use super::source::scene_files;
use crate::files::read_file;
use crate::format::{FormatReader, ImagePlace, PROBE};
use crate::json;

/// Keys of a `transforms.json`. Only frames are required: without them, the error about one says that they are missing.
const KEYS: [&str; 3] = ["frames", "fl_x", "camera_angle_x"];

pub(crate) static READER: FormatReader = FormatReader {
    data: "a transforms.json",
    required: |_| "transforms.json".to_owned(),
    images: ImagePlace::Images,
    part_of_scene: |_| None,
    is_of_captures: true,
    image_options: &["images", "prefer-undistorted"],
    reads_file: is_named_transforms,
    path_of_file: |path, start| is_transforms(path, start).then(|| path.to_owned()),
    is_folder_of_format: |path| Ok(!scene_files(path, false)?.is_empty()),
    read_to_open: |_| Ok(Vec::new()),
    open: |path, options, warnings| {
        let source = NerfstudioScenes::open(path, options.nerfstudio, warnings)?;
        let collections = source.collections().clone();
        Ok((Box::new(source), collections))
    },
};

/// Whether a file with these first bytes is an object with one of [`KEYS`]: other programs' JSON, such as an evaluation index, is not.
fn is_transforms(path: &Path, start: &[u8]) -> bool {
    if !json::starts_with_bracket(start, b'{') {
        return false;
    }
    // Keys may be in any order, and the value of another one of any length.
    let is_cut_off = start.len() as u64 >= PROBE;
    let has_key = |text: &[u8]| json::has_key(text, &KEYS);
    has_key(start) || (is_cut_off && read_file("opening a dataset", path).is_ok_and(|text| has_key(&text)))
}
