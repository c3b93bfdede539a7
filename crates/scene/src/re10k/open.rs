//! How RE10K trajectories are detected and opened.

use std::path::Path;

use super::Re10kScenes;
use super::source::trajectory_files;
use super::trajectory::starts_like_a_trajectory;
use crate::SceneError;
use crate::files::{has_extension, read_start};
use crate::format::{FormatReader, ImagePlace, PROBE};

/// Text files of a folder that are read to find a trajectory.
const TEXTS_READ: usize = 20;

pub(crate) static READER: FormatReader = FormatReader {
    data: "RE10K trajectories",
    required: |name| format!("trajectory {name}.txt"),
    images: ImagePlace::FolderOrImages,
    part_of_scene: |_| None,
    is_of_captures: false,
    image_options: &["frames"],
    reads_file: |path| has_extension(path, "txt"),
    path_of_file: |path, start| starts_like_a_trajectory(start).then(|| path.to_owned()),
    is_folder_of_format: has_trajectories,
    read_to_open: |path| Ok(trajectory_files(path)?.into_values().take(TEXTS_READ).collect()),
    open: |path, options, warnings| {
        let source = Re10kScenes::open(path, options.re10k.clone(), warnings)?;
        let collections = source.collections();
        Ok((Box::new(source), collections))
    },
};

/// Whether one of the first text files in a folder is a trajectory; others may be a licence, for example.
fn has_trajectories(folder: &Path) -> Result<bool, SceneError> {
    for file in trajectory_files(folder)?.values().take(TEXTS_READ) {
        if starts_like_a_trajectory(&read_start("opening a dataset", file, PROBE)?) {
            return Ok(true);
        }
    }
    Ok(false)
}
