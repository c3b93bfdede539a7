//! Scenes next to those of an opened dataset that it leaves out: a folder has one format, and the files of another, or
//! of a misspelt name, would be dropped silently.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::colmap::{model_below, model_in, part_of_model};
use crate::files::{is_read, last_name, list, not_utf8, read_start, split_image_name};
use crate::nerfstudio::{VARIANTS, is_of_images, transforms_in};
use crate::re10k::{starts_like_a_trajectory, trajectory_key};
use crate::{Format, SceneError, WarningKind, Warnings};

const TRAJECTORY: &str = "an RE10K trajectory";

/// Bytes that contain the first rows of a trajectory.
const FIRST_ROWS: u64 = 1 << 12;

/// Folders of scenes, each with the names in it that belong to the dataset. Empty for a capture that is opened by itself:
/// everything in its folder is its own, such as the COLMAP model that a `transforms.json` was made from.
pub(crate) type Collections = BTreeMap<PathBuf, BTreeSet<String>>;

/// What an entry of a folder holds that the dataset leaves out.
enum LeftOut {
    /// A scene, by what describes it.
    Scene(&'static str),
    /// A COLMAP model in a folder where none is looked for.
    ModelIn(String),
    /// Images, or a file with a name like `transforms.json`.
    Part(String),
}

/// Warns about scenes in the folders of a dataset with these `keys` that are not its own. Hidden folders are skipped.
///
/// `names_only`: files need not be here, so that no trajectory can be recognised.
pub(crate) fn report_ignored(
    collections: &Collections,
    format: Format,
    keys: &[String],
    names_only: bool,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    for (folder, own) in collections {
        let entries = list(folder)?;
        for (name, is_folder) in entries.iter().filter(|(name, _)| !name.starts_with('.')) {
            let key = if *is_folder { Some(name.as_str()) } else { trajectory_key(name) };
            let Some(key) = key.filter(|key| !own.contains(*key)) else { continue };
            let path = folder.join(name);
            let left = if *is_folder {
                // Images next to a trajectory are reported with it, and chunks hold their own images.
                let is_of_trajectory = entries.binary_search(&(format!("{name}.txt"), false)).is_ok();
                let may_be_part = format != Format::TorchChunks && !is_of_trajectory;
                let part = || if may_be_part { part_in(&path, format).map(LeftOut::Part) } else { None };
                let model = || model_below(&path).map(LeftOut::ModelIn);
                scene_in(&path, name, names_only).map(LeftOut::Scene).or_else(model).or_else(part)
            } else {
                (!names_only && is_trajectory(&path)).then_some(LeftOut::Scene(TRAJECTORY))
            };
            let (kind, detail) = match left {
                None => continue,
                Some(LeftOut::Scene(what)) if keys.iter().any(|held| held == key) => {
                    (WarningKind::DuplicateScene, format!("the scene of the format {format} is used, not {what}"))
                }
                Some(LeftOut::Scene(what)) => {
                    (WarningKind::IgnoredScene, format!("{what} is not read, because the dataset is read as {format}"))
                }
                Some(LeftOut::ModelIn(below)) => {
                    let places =
                        "a capture's model is looked for in the folder itself, sparse/0, sparse and colmap/sparse/0";
                    let detail = format!("a COLMAP model in {below}, which is not read: {places}; give that folder");
                    (WarningKind::IgnoredScene, detail)
                }
                Some(LeftOut::Part(what)) => {
                    (WarningKind::IgnoredScene, format!("holds {what}, but no {}", required(format, key)))
                }
            };
            warnings.push(kind, key, format!("{detail} ({})", path.display()));
        }
        for (path, is_folder) in not_utf8(folder)? {
            let name = last_name(&path);
            if !name.starts_with('.') && (is_folder || (!names_only && is_trajectory(&path))) {
                let detail = format!("is not read, because its name is not UTF-8 ({})", path.display());
                warnings.push(WarningKind::IgnoredScene, name, detail);
            }
        }
    }
    Ok(())
}

/// What makes a folder with this name a scene of the format.
fn required(format: Format, name: &str) -> String {
    match format {
        Format::Re10k => format!("trajectory {name}.txt"),
        Format::Nerfstudio => "transforms.json".to_owned(),
        Format::Colmap => "COLMAP model".to_owned(),
        Format::TorchChunks => "chunk".to_owned(),
    }
}

fn scene_in(folder: &Path, name: &str, names_only: bool) -> Option<&'static str> {
    if transforms_in(folder, false).is_some() {
        return Some("a transforms.json");
    }
    if model_in(folder).is_some() {
        return Some("a COLMAP model");
    }
    let has_trajectory = !names_only && is_trajectory(&folder.join(format!("{name}.txt")));
    has_trajectory.then_some(TRAJECTORY)
}

fn is_trajectory(file: &Path) -> bool {
    read_start("opening a dataset", file, FIRST_ROWS).is_ok_and(|start| starts_like_a_trajectory(&start))
}

/// What a folder without cameras holds that a capture does. Captures have their images in `images/` or a scaled copy
/// of it, clips of trajectories also directly in their folder.
fn part_in(folder: &Path, format: Format) -> Option<String> {
    let of_model = (format == Format::Colmap).then(|| part_of_model(folder)).flatten().map(|(part, _)| part);
    let in_variant = || {
        VARIANTS.iter().find_map(|variant| {
            let folder = folder.join(variant);
            let entries = list(&folder).ok()?;
            let files = entries.iter().filter(|(_, is_folder)| !is_folder).map(|(name, _)| name.as_str());
            let misspelt = files.clone().find(|name| is_like_transforms(name)).map(str::to_owned);
            misspelt.or_else(|| {
                let of_images = |(name, is_folder): &&(String, bool)| *is_folder && is_of_images(name);
                let mut folders = entries.iter().filter(of_images).map(|(name, _)| folder.join(name));
                let is_clip = format == Format::Re10k && files.clone().any(is_read);
                let images = is_clip || folders.any(|folder| holds_images(&folder));
                images.then(|| "images".to_owned())
            })
        })
    };
    let below = || {
        let holds_scene =
            |(name, is_folder): &(String, bool)| *is_folder && transforms_in(&folder.join(name), false).is_some();
        let scenes = list(folder).ok()?.iter().filter(|entry| holds_scene(entry)).count();
        (scenes > 0).then(|| format!("{scenes} folders with a transforms.json"))
    };
    of_model.or_else(in_variant).or_else(below)
}

/// Files in a folder that are named like a `transforms.json`, such as `transforms_train.json`.
pub(crate) fn files_like_transforms(folder: &Path) -> Vec<String> {
    let files = list(folder).unwrap_or_default().into_iter().filter(|(_, is_folder)| !is_folder);
    files.map(|(name, _)| name).filter(|name| is_like_transforms(name)).collect()
}

fn is_like_transforms(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    name.starts_with("transform") && Path::new(&name).extension().is_some_and(|extension| extension == "json")
}

fn is_image(name: &str) -> bool {
    split_image_name(name).is_some()
}

fn holds_images(folder: &Path) -> bool {
    list(folder).is_ok_and(|found| found.iter().any(|(name, is_folder)| !is_folder && is_image(name)))
}
