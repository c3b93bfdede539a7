//! Scenes next to those of an opened dataset that it leaves out: a folder has one format, and the files of another, or
//! of a misspelt name, would be dropped silently.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::colmap::{model_below, model_folders_in_words, model_in};
use crate::files::{has_extension, is_image_name, last_name, list, not_utf8, read_start, split_image_name};
use crate::format::ImagePlace;
use crate::image_finder::is_of_images;
use crate::nerfstudio::{LAYOUTS, transforms_in};
use crate::re10k::{starts_like_a_trajectory, trajectory_key};
use crate::{Format, SceneError, WarningKind, Warnings};

const TRAJECTORY: &str = "an RE10K trajectory";

/// Bytes that contain the first rows of a trajectory.
const FIRST_ROWS: u64 = 1 << 12;

/// Folders of scenes, each with the names in it that belong to the dataset. Empty for a capture that is opened by itself:
/// everything in its folder belongs to it, such as the COLMAP model that a `transforms.json` was made from.
pub(crate) type Collections = BTreeMap<PathBuf, BTreeSet<String>>;

/// Warns about scenes in the folders of a dataset with these `keys` that are not among its scenes. Hidden folders are skipped.
///
/// `names_only`: files need not be here, so that no trajectory can be recognised.
pub(crate) fn report_ignored(
    collections: &Collections,
    format: Format,
    keys: &[String],
    names_only: bool,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let dataset = OpenedAs { format, keys, names_only };
    for (folder, members) in collections {
        dataset.report_entries(folder, members, warnings)?;
        dataset.report_names_not_utf8(folder, warnings)?;
    }
    Ok(())
}

/// What an entry of a folder contains that the dataset leaves out.
enum LeftOut {
    /// A scene, by what describes it.
    Scene(&'static str),
    /// A COLMAP model in a folder where none is looked for.
    ModelIn(String),
    /// Images, or a file with a name like `transforms.json`.
    Part(String),
}

struct OpenedAs<'a> {
    format: Format,
    keys: &'a [String],
    names_only: bool,
}

impl OpenedAs<'_> {
    /// `members` are the names in the folder that belong to the dataset.
    fn report_entries(
        &self,
        folder: &Path,
        members: &BTreeSet<String>,
        warnings: &mut Warnings,
    ) -> Result<(), SceneError> {
        let entries = list(folder)?;
        for (name, is_folder) in entries.iter().filter(|(name, _)| !name.starts_with('.')) {
            let key = if *is_folder { Some(name.as_str()) } else { trajectory_key(name) };
            let Some(key) = key.filter(|key| !members.contains(*key)) else { continue };
            let path = folder.join(name);
            let left_out = if *is_folder {
                let is_of_trajectory = entries.binary_search(&(format!("{name}.txt"), false)).is_ok();
                if let (false, Err(error)) = (is_of_trajectory, list(&path)) {
                    warnings.push(
                        WarningKind::UnreadableScene,
                        key,
                        format!("none of its scenes can be found: {error}"),
                    );
                    continue;
                }
                self.left_out_in(&path, name, is_of_trajectory)
            } else {
                self.is_trajectory(&path).then_some(LeftOut::Scene(TRAJECTORY))
            };
            if let Some(left_out) = left_out {
                let (kind, detail) = self.warning(key, &left_out);
                warnings.push(kind, key, format!("{detail} ({})", path.display()));
            }
        }
        self.report_hidden_trajectories(folder, &entries, warnings);
        Ok(())
    }

    /// Names that begin with a dot are no keys.
    fn report_hidden_trajectories(&self, folder: &Path, entries: &[(String, bool)], warnings: &mut Warnings) {
        let hidden = entries.iter().filter(|(name, is_folder)| !is_folder && name.starts_with('.'));
        for (name, path) in hidden.map(|(name, _)| (name, folder.join(name))) {
            if has_extension(&path, "txt") && self.is_trajectory(&path) {
                let detail =
                    format!("{TRAJECTORY} is not read, because its name begins with a dot ({})", path.display());
                warnings.push(WarningKind::IgnoredScene, name, detail);
            }
        }
    }

    fn report_names_not_utf8(&self, folder: &Path, warnings: &mut Warnings) -> Result<(), SceneError> {
        for (path, is_folder) in not_utf8(folder)? {
            let name = last_name(&path);
            if !name.starts_with('.') && (is_folder || self.is_trajectory(&path)) {
                let detail = format!("is not read, because its name is not UTF-8 ({})", path.display());
                warnings.push(WarningKind::IgnoredScene, name, detail);
            }
        }
        Ok(())
    }

    /// What a folder contains. Images next to a trajectory are reported with it, and chunks contain theirs.
    fn left_out_in(&self, folder: &Path, name: &str, is_of_trajectory: bool) -> Option<LeftOut> {
        let may_be_part = self.format.reader().images != ImagePlace::WithCameras && !is_of_trajectory;
        let model = || model_below(folder).map(LeftOut::ModelIn);
        let part = || if may_be_part { part_in(folder, self.format).map(LeftOut::Part) } else { None };
        self.scene_in(folder, name).map(LeftOut::Scene).or_else(model).or_else(part)
    }

    fn scene_in(&self, folder: &Path, name: &str) -> Option<&'static str> {
        if transforms_in(folder, false).is_some() {
            return Some("a transforms.json");
        }
        if model_in(folder).is_some() {
            return Some("a COLMAP model");
        }
        self.is_trajectory(&folder.join(format!("{name}.txt"))).then_some(TRAJECTORY)
    }

    fn is_trajectory(&self, file: &Path) -> bool {
        let start = || read_start("opening a dataset", file, FIRST_ROWS);
        !self.names_only && start().is_ok_and(|start| starts_like_a_trajectory(&start))
    }

    fn warning(&self, key: &str, left_out: &LeftOut) -> (WarningKind, String) {
        let format = self.format;
        match left_out {
            LeftOut::Scene(what) if self.keys.iter().any(|known| known == key) => {
                (WarningKind::DuplicateScene, format!("the scene of the format {format} is used, not {what}"))
            }
            LeftOut::Scene(what) => {
                let detail = format!("{what} is not read, because the dataset is read as {format}");
                (WarningKind::IgnoredScene, detail)
            }
            LeftOut::ModelIn(below) => {
                let places = format!("a capture's model is looked for in {}", model_folders_in_words());
                let detail = format!("a COLMAP model in {below}, which is not read: {places}; give that folder");
                (WarningKind::IgnoredScene, detail)
            }
            LeftOut::Part(what) => {
                let required = (format.reader().required)(key);
                (WarningKind::IgnoredScene, format!("contains {what}, but no {required}"))
            }
        }
    }
}

/// What a folder without cameras has in common with a scene of the format.
fn part_in(folder: &Path, format: Format) -> Option<String> {
    let reader = format.reader();
    if let Some(part) = (reader.part_of_scene)(folder) {
        return Some(part);
    }
    let in_layout = || LAYOUTS.iter().find_map(|layout| images_or_misspelt(&folder.join(layout.folder), reader.images));
    let below = || {
        let has_scene =
            |(name, is_folder): &(String, bool)| *is_folder && transforms_in(&folder.join(name), false).is_some();
        let scenes = list(folder).ok()?.iter().filter(|entry| has_scene(entry)).count();
        (scenes > 0).then(|| format!("{scenes} folders with a transforms.json"))
    };
    in_layout().or_else(below)
}

/// A file that is named like a `transforms.json`, or "images".
fn images_or_misspelt(folder: &Path, place: ImagePlace) -> Option<String> {
    let entries = list(folder).ok()?;
    let mut files = entries.iter().filter(|(_, is_folder)| !is_folder).map(|(name, _)| name.as_str());
    if let Some(misspelt) = files.clone().find(|name| is_like_transforms(name)) {
        return Some(misspelt.to_owned());
    }
    let is_clip = place == ImagePlace::FolderOrImages && files.any(is_image_name);
    let mut image_folders = entries.iter().filter(|(name, is_folder)| *is_folder && is_of_images(name));
    let has_images = is_clip || image_folders.any(|(name, _)| contains_images(&folder.join(name)));
    has_images.then(|| "images".to_owned())
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

fn contains_images(folder: &Path) -> bool {
    list(folder).is_ok_and(|found| found.iter().any(|(name, is_folder)| !is_folder && is_image(name)))
}
