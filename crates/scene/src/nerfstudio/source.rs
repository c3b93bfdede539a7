use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_camera::{Camera, CameraError, CameraFromWorld, ImageSize, WorldFromCamera};
use glam::DVec3;

use super::layout::{image_folder, is_undistorted, scene_folder, transforms_in, undistorted_in_words};
use super::lens::LensFields;
use super::sizes::{images_for_sizes, lenses, needs_image_sizes};
use super::unread_fields::{report_masks_of_names, report_unread_fields};
use super::{Transforms, parse_transforms};
use crate::checks::ignored::Collections;
use crate::dataset::find_by_key;
use crate::files::{last_name, list, read_file, split_image_name};
use crate::image_finder::{FoundImage, ImageFinder, is_of_images};
use crate::{Frame, ImageFolder, Scene, SceneError, TimestampSource, WarningKind, Warnings};

/// Prefix of the keys of scenes in subsets.
pub const SUBSET_PREFIX: &str = "dl3dv_";

/// How `transforms.json` scenes are read.
#[derive(Clone, Copy, Debug, Default)]
pub struct NerfstudioOptions {
    /// Which copy of the images to use.
    pub images: ImageFolder,
    /// Size of the images that are meant where a scene lacks the folder that it lists: the copy of this size is used, not the largest.
    pub expected_size: Option<ImageSize>,
    /// Prefers undistorted images to others of a scene, such as DL3DV's `gaussian_splat/`; without any scene that has them, opening
    /// is an error.
    pub prefer_gaussian_splat: bool,
}

/// `transforms.json` scenes: one file, one scene's folder, or a folder of scenes.
///
/// A scene's folder contains `transforms.json`, directly, in `nerfstudio/` or in `gaussian_splat/`, or, in `ScanNet++`,
/// `dslr/nerfstudio/transforms_undistorted.json`. Its name is the key, for DL3DV the scene's hash. In a folder of subsets of scenes
/// (DL3DV's training set, `1K/<hash>/…`) the key is `dl3dv_<hash>` and the subset becomes the URL, as in DepthSplat's chunks
/// (depthsplat `src/scripts/convert_dl3dv_train.py`).
#[derive(Clone, Debug)]
pub struct NerfstudioScenes {
    path: PathBuf,
    options: NerfstudioOptions,
    keys: Vec<String>,
    scenes: Vec<SceneFile>,
    collections: Collections,
}

/// The `transforms.json` of one scene.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SceneFile {
    key: String,
    subset: Option<String>,
    file: PathBuf,
}

impl NerfstudioScenes {
    /// Finds the scenes without reading them. Of two scenes with one key, in two subsets, the first is used; the other is a
    /// [`WarningKind::IgnoredScene`]. Subsets whose folders cannot be listed are left out; [`crate::open()`] counts them as unreadable
    /// scenes.
    ///
    /// # Errors
    /// [`SceneError::Io`], and [`SceneError::Unrecognized`] for a folder without a `transforms.json`, or without a preferred
    /// `gaussian_splat/`.
    pub fn open(path: &Path, options: NerfstudioOptions, warnings: &mut Warnings) -> Result<Self, SceneError> {
        let mut scenes = scene_files(path, options.prefer_gaussian_splat)?;
        let collections = collections(path, &scenes);
        scenes.dedup_by(|later, earlier| {
            let same = later.key == earlier.key;
            if same {
                // Nothing says that they are one scene.
                let (read, other) = (earlier.file.display(), later.file.display());
                let detail = format!("{other} is not read, because {read} has the same key: rename the folder of one");
                warnings.push(WarningKind::IgnoredScene, &later.key, detail);
            }
            same
        });
        if scenes.is_empty() {
            let expected = "transforms.json in the folder, its nerfstudio/ or one of its subfolders";
            return Err(SceneError::unrecognized(path, expected, "no such file"));
        }
        if options.prefer_gaussian_splat && !scenes.iter().any(|scene| is_undistorted(&scene.file)) {
            let expected = format!("undistorted captures, in a scene's {}", undistorted_in_words());
            return Err(SceneError::unrecognized(path, expected, "no such file"));
        }
        let keys = scenes.iter().map(|scene| scene.key.clone()).collect();
        Ok(Self { path: path.to_owned(), options, keys, scenes, collections })
    }

    /// The parsed `transforms.json` of one scene, and its path.
    ///
    /// # Errors
    /// [`SceneError::UnknownScene`], [`SceneError::Io`], and those of [`parse_transforms`].
    pub fn transforms(&self, key: &str) -> Result<(Transforms, &Path), SceneError> {
        let file = &self.scene_file(key)?.file;
        Ok((parse_transforms(&read_file("reading a transforms.json", file)?, file)?, file))
    }

    /// The folders of scenes; none for one file or one scene's folder.
    pub(crate) const fn collections(&self) -> &Collections {
        &self.collections
    }

    fn scene_file(&self, key: &str) -> Result<&SceneFile, SceneError> {
        find_by_key(&self.keys, &self.scenes, key, &self.path)
    }
}

impl crate::SceneReader for NerfstudioScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn times(&self) -> TimestampSource {
        TimestampSource::FromNames
    }

    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        Ok(vec![self.scene_file(key)?.file.clone()])
    }

    /// Those of the listed folder, if the `transforms.json` states no sizes.
    fn images_for_sizes(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        let (transforms, file) = self.transforms(key)?;
        if !needs_image_sizes(&transforms) {
            return Ok(Vec::new());
        }
        let (root, below) = image_folder(file);
        let listed = find_images(&mut ImageFinder::new(&root, file, ImageFolder::Listed), below, &transforms)?;
        Ok(images_for_sizes(&transforms, &listed))
    }

    fn read(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let subset = self.scene_file(key)?.subset.clone();
        let (transforms, file) = self.transforms(key)?;
        let (root, below) = image_folder(file);
        let mut finder = ImageFinder::new(&root, file, self.options.images).preferring(self.options.expected_size);
        let images = find_images(&mut finder, below, &transforms)?;
        for (at, found) in images.iter().enumerate() {
            found.report(key, at, "", warnings);
        }
        finder.report_ambiguous(key, warnings);
        report_unread_fields(key, &transforms, warnings);
        report_masks_of_names(key, &images, warnings);
        let lenses = if needs_image_sizes(&transforms) && self.options.images != ImageFolder::Listed {
            // A scaled copy does not have the size that lengths in pixels refer to.
            let mut finder = ImageFinder::new(&root, file, ImageFolder::Listed);
            lenses(key, &transforms, &find_images(&mut finder, below, &transforms)?, file)?
        } else {
            lenses(key, &transforms, &images, file)?
        };
        let frames = frames(key, file, &transforms, &lenses, images, warnings)?;
        Ok(Scene { key: key.to_owned(), url: subset, frames })
    }

    fn applied_transform(&self, key: &str) -> Result<Option<AppliedTransform>, SceneError> {
        let (transforms, file) = self.transforms(key)?;
        let is_moved = transforms.applied_transform.is_some() || transforms.applied_scale.is_some();
        is_moved.then(|| AppliedTransform::of(&transforms, file)).transpose()
    }
}

/// The images of all frames, whose paths are relative to the folder `below` the finder's root.
fn find_images(
    finder: &mut ImageFinder<'_>,
    below: &str,
    transforms: &Transforms,
) -> Result<Vec<FoundImage>, SceneError> {
    let mut find = |listed: &str, location: &str| {
        if below.is_empty() { finder.find(listed, location) } else { finder.find_below(below, listed, location) }
    };
    let frames = transforms.frames.iter().enumerate();
    frames.map(|(at, frame)| find(&frame.file_path, &format!("frames[{at}].file_path"))).collect()
}

/// The frames, with a lens and an image for each. A frame whose pose is unusable keeps its position.
fn frames(
    key: &str,
    file: &Path,
    transforms: &Transforms,
    lenses: &[LensFields],
    images: Vec<FoundImage>,
    warnings: &mut Warnings,
) -> Result<Vec<Frame>, SceneError> {
    let mut frames = Vec::with_capacity(images.len());
    let mut contradictions = Vec::new();
    let mut centred = Vec::new();
    let mut paths_of: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for frame in &transforms.frames {
        paths_of.entry(stem(&frame.file_path)).or_default().insert(below_images(&frame.file_path));
    }
    for (at, ((listed, lens), found)) in transforms.frames.iter().zip(lenses).zip(images).enumerate() {
        let lens = lens.resolve(&format!("frames[{at}]: "), file)?;
        let (camera_from_world, image) = match &listed.world_from_camera {
            Ok(pose) => (pose.inverse(), found.image),
            Err(error) => {
                let located = SceneError::camera(file, format!("frames[{at}].transform_matrix"))(error.clone());
                (CameraFromWorld::UNKNOWN, found.image.unposed(located.to_string()))
            }
        };
        // Images of one name in several folders have these in their names, as in COLMAP models.
        let stem = stem(&listed.file_path);
        let is_repeated = paths_of.get(stem).is_some_and(|paths| paths.len() > 1);
        let name = if is_repeated { below_images(&listed.file_path) } else { stem.to_owned() };
        contradictions.extend(lens.contradiction.map(|detail| format!("first {at}: {detail}")));
        centred.extend(lens.assumes_centre.then_some(at));
        frames.push(Frame {
            timestamp_micros: stem.rsplit('_').next().and_then(|number| number.parse().ok()),
            name,
            camera: Camera { camera_from_world, intrinsics: lens.intrinsics, distortion: lens.distortion },
            stated_size: lens.size,
            image,
        });
    }
    if let Some(first) = contradictions.first() {
        let detail = format!("{} of {} frames, {first}", contradictions.len(), frames.len());
        warnings.push(WarningKind::ContradictoryFieldOfView, key, detail);
    }
    if let Some(first) = centred.first() {
        let (count, frames, file) = (centred.len(), frames.len(), file.display());
        let detail =
            format!("{count} of {frames} frames, first {first}: cx and cy are not stated; the centre is used ({file})");
        warnings.push(WarningKind::AssumedPrincipalPoint, key, detail);
    }
    Ok(frames)
}

/// What nerfstudio did to the world of structure from motion before it saved poses: `applied_transform` moved it, then
/// `applied_scale` scaled it (nerfstudio `data/dataparsers/nerfstudio_dataparser.py`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AppliedTransform {
    moved_from_original: WorldFromCamera,
    scale: f64,
}

impl AppliedTransform {
    fn of(transforms: &Transforms, file: &Path) -> Result<Self, SceneError> {
        let scale = transforms.applied_scale.unwrap_or(1.0);
        if !(scale.is_finite() && scale > 0.0) {
            let source = CameraError::NotPositive { field: "scale", found: scale };
            return Err(SceneError::camera(file, "applied_scale")(source));
        }
        let identity = WorldFromCamera::IDENTITY.to_rows();
        let rows = transforms.applied_transform.unwrap_or(identity);
        let moved_from_original =
            WorldFromCamera::from_rows(&rows).map_err(SceneError::camera(file, "applied_transform"))?;
        Ok(Self { moved_from_original, scale })
    }

    /// Where a point of structure from motion, such as COLMAP's, is in the saved world.
    pub fn saved_point(&self, point: DVec3) -> DVec3 {
        self.moved_from_original.transform_point(point) * self.scale
    }
}

/// The path without its extension, below the folder of images if it is in one.
fn below_images(file_path: &str) -> String {
    let path = split_image_name(file_path).map_or(file_path, |(stem, _)| stem).replace('\\', "/");
    let parts: Vec<&str> = path.split('/').filter(|part| !matches!(*part, "" | ".")).collect();
    let images = parts.iter().position(|part| is_of_images(part)).filter(|at| at + 1 < parts.len());
    parts[images.map_or(0, |at| at + 1)..].join("/")
}

fn stem(file_path: &str) -> &str {
    let name = file_path.rsplit(['/', '\\']).next().unwrap_or(file_path);
    split_image_name(name).map_or(name, |(stem, _)| stem)
}

/// The scenes under `path`, sorted by key, without those of subsets that cannot be listed.
pub(crate) fn scene_files(path: &Path, prefer_gaussian_splat: bool) -> Result<Vec<SceneFile>, SceneError> {
    if !path.is_dir() {
        return Ok(vec![SceneFile { key: key_of(path), subset: None, file: path.to_owned() }]);
    }
    if let Some(file) = transforms_in(path, prefer_gaussian_splat) {
        return Ok(vec![SceneFile { key: key_of(&file), subset: None, file }]);
    }
    let mut scenes = Vec::new();
    let folders = folders_in(path)?;
    for name in &folders {
        if let Some(file) = transforms_in(&path.join(name), prefer_gaussian_splat) {
            scenes.push(SceneFile { key: name.clone(), subset: None, file });
        }
    }
    if scenes.is_empty() {
        for subset in &folders {
            for name in folders_in(&path.join(subset)).unwrap_or_default() {
                if let Some(file) = transforms_in(&path.join(subset).join(&name), prefer_gaussian_splat) {
                    scenes.push(SceneFile {
                        key: format!("{SUBSET_PREFIX}{name}"),
                        subset: Some(subset.clone()),
                        file,
                    });
                }
            }
        }
    }
    scenes.sort_unstable();
    Ok(scenes)
}

/// The folders under `path` that contain `scenes`, each with the names in it that belong to them.
fn collections(path: &Path, scenes: &[SceneFile]) -> Collections {
    let mut collections = Collections::new();
    if !path.is_dir() || transforms_in(path, false).is_some() {
        return collections;
    }
    for scene in scenes {
        let mut add = |folder: PathBuf, name: &str| {
            collections.entry(folder).or_default().insert(name.to_owned());
        };
        match &scene.subset {
            Some(subset) => {
                add(path.to_owned(), subset);
                add(path.join(subset), scene.key.strip_prefix(SUBSET_PREFIX).unwrap_or(&scene.key));
            }
            None => add(path.to_owned(), &scene.key),
        }
    }
    collections
}

fn folders_in(path: &Path) -> Result<Vec<String>, SceneError> {
    Ok(list(path)?.into_iter().filter_map(|(name, is_folder)| is_folder.then_some(name)).collect())
}

/// The name of the scene's folder.
fn key_of(file: &Path) -> String {
    last_name(&scene_folder(file))
}

#[cfg(test)]
mod tests;
