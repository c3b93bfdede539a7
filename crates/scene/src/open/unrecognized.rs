//! What a path contains that is not a dataset, for the error: what is missing of a dataset, or where one is.

use std::path::{Path, PathBuf};

use super::TRIED;
use crate::checks::ignored::files_like_transforms;
use crate::colmap::{folder_of_part, model_below, part_of_model};
use crate::files::{has_extension, list, read_file, subfolders};
use crate::json;
use crate::nerfstudio::parse_transforms;
use crate::re10k::{read_trajectory, trajectory_files};
use crate::{Format, SceneError};

/// Subfolders that are searched for datasets and models.
const FOLDERS_SEARCHED: usize = 20;

/// Datasets in subfolders that the message names.
const DATASETS_NAMED: usize = 3;

/// Describes a file with these first bytes.
pub(super) fn content_of_file(file: &Path, start: &[u8]) -> String {
    let [is_list, is_object] = [b'[', b'{'].map(|bracket| json::starts_with_bracket(start, bracket));
    if (is_list || is_object)
        && let Some(content) = json_content(file)
    {
        return content;
    }
    if let Some(part) = folder_of_part(file).as_deref().and_then(part_of_model) {
        return part_description(part);
    }
    let error = if is_object {
        transforms_error(file)
    } else if has_extension(file, "txt") {
        read_trajectory(file).err()
    } else {
        None
    };
    with_error("another kind of file", error)
}

pub(super) fn content_of_folder(folder: &Path) -> Result<String, SceneError> {
    const KIND: &str = "a folder without these";
    if let Some(part) = part_of_model(folder) {
        return Ok(part_description(part));
    }
    if folder.join("render.json").is_file() {
        return Ok(format!(
            "{KIND}, but with the render.json of `atsplat render`: `reconstruct` and `fit` read this folder, and `render --cameras` \
             that file"
        ));
    }
    let transforms = files_like_transforms(folder);
    if !transforms.is_empty() {
        return Ok(format!("{KIND}, but with {}: give that file", transforms.join(" and ")));
    }
    let subfolders = subfolders(folder, FOLDERS_SEARCHED);
    let datasets: Vec<String> = subfolders.iter().filter_map(|below| dataset_in(below)).take(DATASETS_NAMED).collect();
    if !datasets.is_empty() {
        return Ok(format!("{KIND}, but with datasets below it: {}", datasets.join(", ")));
    }
    let mut searched = std::iter::once(folder).chain(subfolders.iter().map(PathBuf::as_path));
    if let Some(model) = searched.find_map(|place| Some(place.join(model_below(place)?))) {
        return Ok(format!("{KIND}, but with a COLMAP model in {}: give that folder", model.display()));
    }
    if let Some(part) = subfolders.iter().find_map(|capture| part_of_model(capture)) {
        return Ok(part_description(part));
    }
    if let Some(error) = subfolders.iter().find_map(|below| list(below).err()) {
        return Ok(with_error(KIND, Some(error)));
    }
    let text = trajectory_files(folder)?.into_values().next();
    Ok(with_error(KIND, text.and_then(|text| read_trajectory(&text).err())))
}

fn dataset_in(folder: &Path) -> Option<String> {
    if !folder.is_dir() {
        return None;
    }
    let is_of = |format: &Format| (format.reader().is_folder_of_format)(folder).is_ok_and(|is_so| is_so);
    Some(format!("{} ({})", folder.display(), TRIED.into_iter().find(is_of)?))
}

/// A description of a JSON file; `None` if it is not valid JSON.
fn json_content(file: &Path) -> Option<String> {
    let value = json::parse(&read_file("opening a dataset", file).ok()?).ok()?;
    Some(json::describe(&value))
}

/// Why a file is not a `transforms.json`.
fn transforms_error(file: &Path) -> Option<SceneError> {
    parse_transforms(&read_file("opening a dataset", file).ok()?, file).err()
}

fn part_description((part, folder): (String, PathBuf)) -> String {
    format!("a part of a COLMAP model, {part} in {}", folder.display())
}

fn with_error(kind: &str, error: Option<SceneError>) -> String {
    error.map_or_else(|| kind.to_owned(), |error| format!("{kind}; {error}"))
}
