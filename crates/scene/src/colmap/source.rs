use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_camera::{Camera, CameraFromWorld};
use atsplat_numeric::Tolerance;

use super::both_encodings::{other_encoding, report_other_encoding};
use super::order::report_order;
use super::{
    ColmapCamera, ColmapImage, Encoding, PARTS, encoding_of, malformed, model_file, parse_cameras, parse_images,
};
use crate::checks::cameras::count_and_first;
use crate::checks::ignored::Collections;
use crate::dataset::find_by_key;
use crate::files::{absolute, is_image_name, last_name, list, read_file, split_image_name, subfolders};
use crate::image_finder::ImageFinder;
use crate::{Frame, ImageFolder, Scene, SceneError, WarningKind, Warnings};

/// Subfolders of a capture that may contain its sparse model, in order of preference; the first is its folder itself.
pub const MODEL_FOLDERS: [&str; 4] = ["", "sparse/0", "sparse", "colmap/sparse/0"];

/// What is said of a model without any image in its folder.
const ELSEWHERE: &str = "; if the model's images are in another folder, --frames names it";

/// Folder of masks next to that of the images, as COLMAP's documentation and trainers of Gaussians name it.
const MASKS: &str = "masks";

/// Subfolders of a folder in which [`model_below`] looks.
const FOLDERS_SEARCHED: usize = 100;

/// Length of a quaternion; tools that write three decimals are within this.
pub(super) const UNIT: Tolerance = Tolerance::absolute(1e-3);

/// How COLMAP models are read.
#[derive(Clone, Debug, Default)]
pub struct ColmapOptions {
    /// Which copy of the images to use.
    pub images: ImageFolder,
    /// Folder that image names are relative to; by default the capture's `images/`.
    pub images_root: Option<PathBuf>,
}

/// COLMAP sparse models: one model's folder, one capture (`sparse/0/` and `images/`), or a folder of captures. The key
/// is the name of the capture's folder.
///
/// COLMAP's order of images changes from run to run, so frames are sorted by name (byte order), as 3DGS's and
/// Mip-NeRF 360's loaders do. Points are read by [`super::read_points`]. Of several models in `sparse/` the first is
/// used, and the others are counted when the scene is loaded.
#[derive(Clone, Debug)]
pub struct ColmapScenes {
    path: PathBuf,
    options: ColmapOptions,
    keys: Vec<String>,
    models: Vec<PathBuf>,
}

impl ColmapScenes {
    /// Finds the models without reading them.
    ///
    /// # Errors
    /// [`SceneError::Io`], and [`SceneError::Unrecognized`] for a folder without a model.
    pub fn open(path: &Path, options: ColmapOptions) -> Result<Self, SceneError> {
        let found = model_folders(path)?;
        if found.is_empty() {
            let expected =
                "cameras and images (both .bin or both .txt) in the folder, its sparse/0/ or one of its subfolders";
            return Err(SceneError::unrecognized(path, expected, "no such files"));
        }
        let (keys, models) = found.into_iter().unzip();
        Ok(Self { path: path.to_owned(), options, keys, models })
    }

    /// The folder of captures; none if one capture or model was opened.
    pub(crate) fn collections(&self) -> Collections {
        match model_in(&self.path) {
            Some(_) => Collections::new(),
            None => Collections::from([(self.path.clone(), self.keys.iter().cloned().collect())]),
        }
    }

    /// The folder of one scene's model, to be passed to [`super::read_points`].
    ///
    /// # Errors
    /// [`SceneError::UnknownScene`].
    pub fn model_folder(&self, key: &str) -> Result<&Path, SceneError> {
        find_by_key(&self.keys, &self.models, key, &self.path).map(PathBuf::as_path)
    }
}

impl crate::SceneReader for ColmapScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        let model = self.model_folder(key)?;
        let mut files = PARTS.map(|name| model_file(model, name).0).to_vec();
        if let Some(other) = other_encoding(model) {
            files.extend(["cameras", "images"].map(|name| other.file(model, name)));
        }
        Ok(files)
    }

    fn read(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let model = self.model_folder(key)?;
        let read = Model::read(model)?;
        report_quaternions(key, &read.images, warnings);
        report_other_encoding(key, model, (&read.cameras, &read.images), warnings);
        if model != self.path {
            report_other_models(key, model, &self.models, warnings)?;
        }
        let frames = self.frames(key, &capture_of(model), &read, warnings)?;
        Ok(Scene { key: key.to_owned(), url: None, frames })
    }

    fn check(&self, scene: &Scene, warnings: &mut Warnings) {
        report_order(scene, warnings);
    }
}

/// A model's cameras and images, with the files that they are from.
struct Model {
    cameras: BTreeMap<u32, ColmapCamera>,
    cameras_file: PathBuf,
    /// Sorted by name.
    images: Vec<ColmapImage>,
    images_file: PathBuf,
}

impl Model {
    fn read(folder: &Path) -> Result<Self, SceneError> {
        let (cameras_file, encoding) = model_file(folder, "cameras");
        let cameras = parse_cameras(&read_file("reading COLMAP cameras", &cameras_file)?, encoding, &cameras_file)?;
        let (images_file, encoding) = model_file(folder, "images");
        let mut images = parse_images(&read_file("reading COLMAP images", &images_file)?, encoding, &images_file)?;
        if images.is_empty() {
            return Err(malformed(&images_file, "whole file", "at least one image", "none"));
        }
        images.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(Self { cameras, cameras_file, images, images_file })
    }

    fn camera(&self, image: &ColmapImage, location: &str) -> Result<&ColmapCamera, SceneError> {
        self.cameras.get(&image.camera_id).ok_or_else(|| {
            let expected = format!("a camera id in {}", self.cameras_file.display());
            malformed(&self.images_file, location, expected, image.camera_id.to_string())
        })
    }
}

impl ColmapScenes {
    fn frames(
        &self,
        key: &str,
        capture: &Path,
        model: &Model,
        warnings: &mut Warnings,
    ) -> Result<Vec<Frame>, SceneError> {
        let root = self.options.images_root.clone().unwrap_or_else(|| capture.join("images"));
        // Of `.` and `..`, the folder above is not what stands before the last component.
        let root = if root.file_name().is_some() { root } else { root.canonicalize().unwrap_or(root) };
        let above = root.parent().unwrap_or(&root).to_owned();
        let folder = last_name(&root);
        let mut finder = ImageFinder::new(&above, &model.images_file, self.options.images);
        let find = |image: &ColmapImage| finder.find_below(&folder, &image.name, &format!("image {}", image.id));
        let found = model.images.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let is_none = self.options.images == ImageFolder::Listed && found.iter().all(|found| found.image.is_missing());
        let advice = if is_none { ELSEWHERE } else { "" };
        let mut frames = Vec::with_capacity(model.images.len());
        for (at, (image, found)) in model.images.iter().zip(found).enumerate() {
            let location = format!("image {}", image.id);
            let camera = model.camera(image, &location)?;
            let (intrinsics, distortion) = camera.lens(&format!("camera {}", image.camera_id), &model.cameras_file)?;
            found.report(key, at, advice, warnings);
            let (camera_from_world, file) = match &image.camera_from_world {
                Ok(pose) => (*pose, found.image),
                Err(reason) => (CameraFromWorld::UNKNOWN, found.image.unposed(reason.as_str())),
            };
            frames.push(Frame {
                name: split_image_name(&image.name).map_or(image.name.as_str(), |(stem, _)| stem).to_owned(),
                timestamp_micros: None,
                camera: Camera { camera_from_world, intrinsics, distortion },
                stated_size: Some(camera.size),
                image: file,
            });
        }
        finder.report_ambiguous(key, warnings);
        if folder != MASKS {
            report_masks(key, &above.join(MASKS), &model.images, warnings);
        }
        Ok(frames)
    }
}

/// Keys and folders of the models under `path`, sorted by key.
pub(crate) fn model_folders(path: &Path) -> Result<Vec<(String, PathBuf)>, SceneError> {
    if let Some(model) = model_in(path) {
        let (opened, capture) = (absolute(path), capture_of(&model));
        // The opened folder contains the capture's, if images are in its `colmap/`.
        let named = if capture.starts_with(&opened) { opened } else { capture };
        return Ok(vec![(last_name(&named), model)]);
    }
    let folders = list(path)?.into_iter().filter(|(_, is_folder)| *is_folder);
    Ok(folders.filter_map(|(name, _)| Some((name.clone(), model_in(&path.join(name))?))).collect())
}

pub(crate) fn model_in(folder: &Path) -> Option<PathBuf> {
    places(folder).find(|folder| has_model(folder))
}

/// The first model in the subfolders of a folder that has none where [`model_in`] looks, and in theirs, as a path below it:
/// `sparse/1`, `model`. Hidden folders are skipped.
pub(crate) fn model_below(folder: &Path) -> Option<String> {
    let subfolders = |folder: &Path| subfolders(folder, FOLDERS_SEARCHED);
    let first = subfolders(folder);
    let model = first.iter().find_map(|below| model_in(below));
    let model =
        model.or_else(|| first.iter().flat_map(|below| subfolders(below)).find_map(|below| model_in(&below)))?;
    Some(model.strip_prefix(folder).ok()?.to_str()?.replace('\\', "/"))
}

/// The folder of the points of a capture, which are where models are, with or without cameras and images.
pub fn points_folder(capture: &Path) -> Option<PathBuf> {
    places(capture).find(|folder| model_file(folder, "points3D").0.is_file())
}

/// What is there and what is missing of a capture's model, and its folder; `None` if there is nothing of one. A capture with
/// a whole model is not to be asked for.
pub(crate) fn part_of_model(capture: &Path) -> Option<(String, PathBuf)> {
    let part_in = |folder: PathBuf| {
        let of_encoding = |encoding: Encoding| {
            let name = |file: &str| last_name(&encoding.file(&folder, file));
            let (there, missing): (Vec<&str>, Vec<&str>) =
                PARTS.iter().partition(|file| encoding.file(&folder, file).is_file());
            let [there, missing] = [there, missing].map(|files| files.into_iter().map(name).collect::<Vec<_>>());
            // Points are not needed.
            let missing: Vec<String> = missing.into_iter().filter(|name| !name.starts_with("points")).collect();
            (!there.is_empty()).then(|| format!("{} without {}", there.join(" and "), missing.join(" and ")))
        };
        let parts: Vec<String> = [Encoding::Text, Encoding::Binary].into_iter().filter_map(of_encoding).collect();
        (!parts.is_empty()).then(|| (parts.join(", and "), folder))
    };
    places(capture).find_map(part_in)
}

/// [`MODEL_FOLDERS`] in words.
pub(crate) fn model_folders_in_words() -> String {
    let [_, others @ .., last] = MODEL_FOLDERS;
    format!("the folder itself, {} and {last}", others.join(", "))
}

fn places(capture: &Path) -> impl Iterator<Item = PathBuf> {
    MODEL_FOLDERS.iter().map(move |below| if below.is_empty() { capture.to_owned() } else { capture.join(below) })
}

fn has_model(folder: &Path) -> bool {
    encoding_of(folder).is_some()
}

fn report_quaternions(key: &str, images: &[ColmapImage], warnings: &mut Warnings) {
    let is_scaled =
        |image: &&ColmapImage| image.camera_from_world.is_ok() && !UNIT.accepts(image.quaternion_length, 1.0);
    let mut scaled = images.iter().filter(is_scaled);
    if let Some(first) = scaled.next() {
        let (count, length) = (scaled.count() + 1, first.quaternion_length);
        let detail = format!(
            "{count} of {} images, first {}: expected a quaternion of length 1, found {length}; it is normalised",
            images.len(),
            first.name
        );
        warnings.push(WarningKind::ImperfectRotation, key, detail);
    }
}

/// Warns about the masks of images in a folder: of `a.jpg`, COLMAP reads `a.jpg.png`, and trainers of Gaussians `a.png` too.
fn report_masks(key: &str, masks: &Path, images: &[ColmapImage], warnings: &mut Warnings) {
    if !masks.is_dir() {
        return;
    }
    let is_masked = |image: &ColmapImage| {
        let stem = split_image_name(&image.name).map_or(image.name.as_str(), |(stem, _)| stem);
        let has_mask = [image.name.as_str(), stem].iter().any(|name| masks.join(format!("{name}.png")).is_file());
        has_mask.then(|| format!("its mask in {} is not read; whole images are compared", masks.display()))
    };
    if let Some(detail) = count_and_first(images, "frames", is_masked) {
        warnings.push(WarningKind::UnreadField, key, detail);
    }
}

/// Warns about models next to one that was found in `sparse/`: COLMAP numbers the parts of a capture that it cannot
/// join.
fn report_other_models(key: &str, model: &Path, scenes: &[PathBuf], warnings: &mut Warnings) -> Result<(), SceneError> {
    let is_number = |name: &str| !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit());
    let name = last_name(model);
    let Some(parent) = model.parent().filter(|_| is_number(&name)) else { return Ok(()) };
    let is_other = |(other, is_folder): &(String, bool)| {
        let folder = parent.join(other);
        *is_folder && is_number(other) && !scenes.contains(&folder) && has_model(&folder)
    };
    let others: Vec<String> = list(parent)?.into_iter().filter(is_other).map(|(other, _)| other).collect();
    if !others.is_empty() {
        let (others, parent) = (others.join(", "), parent.display());
        let detail =
            format!("model {name} is used, others that COLMAP could not join with it are not: {others} ({parent})");
        warnings.push(WarningKind::IgnoredScene, key, detail);
    }
    Ok(())
}

/// The folder that contains `images/`: the model's folder, or the parent of `sparse/` or, if `colmap/` has no images itself, of
/// `colmap/sparse/`.
fn capture_of(model: &Path) -> PathBuf {
    let model = absolute(model);
    let up = |folder: &Path, name: &str| {
        folder.file_name().is_some_and(|last| last == name).then(|| folder.parent().map(Path::to_owned))?
    };
    let sparse = up(&model, "sparse").or_else(|| up(model.parent()?, "sparse"));
    match sparse {
        Some(capture) if has_images(&capture) => capture,
        Some(capture) => up(&capture, "colmap").unwrap_or(capture),
        None => model,
    }
}

/// Whether there are images in `images/`, or folders, in which there may be some.
fn has_images(capture: &Path) -> bool {
    list(&capture.join("images"))
        .is_ok_and(|found| found.iter().any(|(name, is_folder)| *is_folder || is_image_name(name)))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::SceneSource as _;

    fn write_model(folder: &Path) {
        fs::create_dir_all(folder).unwrap();
        fs::write(folder.join("cameras.txt"), "1 PINHOLE 4 3 4 4 2 1.5\n").unwrap();
        fs::write(folder.join("images.txt"), "1 1 0 0 0 0 0 0 1 a.png\n\n").unwrap();
    }

    /// As `image_undistorter` writes them into a folder `colmap` next to the photos; nerfstudio has images above `colmap/` only.
    #[test]
    fn images_are_those_next_to_sparse_also_in_a_folder_named_colmap() {
        let folder = tempfile::tempdir().unwrap();
        let desk = folder.path().join("desk");
        write_model(&desk.join("colmap/sparse/0"));
        let found = |opened: &str| {
            let source = ColmapScenes::open(&folder.path().join(opened), ColmapOptions::default()).unwrap();
            let key = source.keys()[0].clone();
            let scene = source.load(&key, &mut Warnings::new()).unwrap();
            let file = scene.frames[0].image.file().unwrap();
            (key, file.strip_prefix(folder.path()).unwrap().to_owned())
        };
        // An empty folder is left over.
        fs::create_dir_all(desk.join("colmap/images")).unwrap();
        let opened = ["desk", "desk/colmap", "desk/colmap/sparse/0"];
        for (images, keys) in [("desk/images", ["desk"; 3]), ("desk/colmap/images", ["desk", "colmap", "colmap"])] {
            fs::create_dir_all(folder.path().join(images)).unwrap();
            fs::write(folder.path().join(images).join("a.png"), "").unwrap();
            for (opened, key) in opened.into_iter().zip(keys) {
                assert_eq!(found(opened), (key.to_owned(), Path::new(images).join("a.png")), "{opened}");
            }
        }
    }

    /// Where none is found, unless a copy was chosen, which is another option's.
    #[test]
    fn missing_images_are_told_of_the_option_that_names_their_folder() {
        let folder = tempfile::tempdir().unwrap();
        let (desk, photos) = (folder.path().join("desk"), folder.path().join("photos"));
        write_model(&desk.join("sparse"));
        fs::write(desk.join("sparse/images.txt"), "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 1 0 0 1 b.png\n\n").unwrap();
        let missing = |options: ColmapOptions| {
            let source = ColmapScenes::open(&desk, options).unwrap();
            let mut warnings = Warnings::new();
            source.load("desk", &mut warnings).unwrap();
            let missing = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::MissingImage);
            missing.map(|warning| warning.detail.clone()).collect::<Vec<_>>()
        };
        let [a, b] = ["a.png", "b.png"].map(|name| desk.join("images").join(name).display().to_string());
        let [a, b] = [format!("frame 0: no {a}"), format!("frame 1: no {b}")];
        assert_eq!(missing(ColmapOptions::default()), [format!("{a}{ELSEWHERE}"), format!("{b}{ELSEWHERE}")]);
        let chosen = missing(ColmapOptions { images: ImageFolder::Downscaled(4), ..ColmapOptions::default() });
        assert!(chosen.len() == 2 && chosen.iter().all(|detail| !detail.contains(ELSEWHERE)), "{chosen:?}");
        for place in [desk.join("images"), photos.clone()] {
            fs::create_dir_all(&place).unwrap();
            fs::write(place.join("b.png"), "").unwrap();
        }
        assert_eq!(missing(ColmapOptions::default()), [a]);
        fs::write(photos.join("a.png"), "").unwrap();
        assert_eq!(missing(ColmapOptions { images_root: Some(photos), ..ColmapOptions::default() }), [""; 0]);
    }

    /// One mask has the name of its image with another extension, another COLMAP's, and the last belongs to no image.
    #[test]
    fn masks_next_to_the_folder_of_images_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        write_model(&folder.path().join("sparse"));
        let image = |(id, name): (usize, &str)| format!("{id} 1 0 0 0 {id} 0 0 1 {name}\n\n");
        let images: String = (1..).zip(["a.png", "left/b.jpg", "c.png"]).map(image).collect();
        fs::write(folder.path().join("sparse/images.txt"), images).unwrap();
        let found = || {
            let source = ColmapScenes::open(folder.path(), ColmapOptions::default()).unwrap();
            let mut warnings = Warnings::new();
            source.load(&source.keys()[0], &mut warnings).unwrap();
            let unread = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::UnreadField);
            unread.map(|warning| warning.detail.clone()).collect::<Vec<_>>()
        };
        let masks = folder.path().join("masks");
        fs::create_dir_all(masks.join("left")).unwrap();
        fs::write(masks.join("d.png"), "").unwrap();
        assert_eq!(found(), [""; 0]);
        let text = |count: usize, first: usize| {
            let folder = masks.display();
            format!("{count} of 3 frames, first {first}: its mask in {folder} is not read; whole images are compared")
        };
        fs::write(masks.join("left/b.jpg.png"), "").unwrap();
        assert_eq!(found(), [text(1, 2)], "sorted by name");
        fs::write(masks.join("c.png"), "").unwrap();
        assert_eq!(found(), [text(2, 1)]);
    }

    /// The folder of images may be given as `..` of a folder inside of it.
    #[test]
    fn a_folder_of_images_has_one_name_however_it_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let (model, photos) = (folder.path().join("sparse"), folder.path().join("photos"));
        fs::create_dir_all(photos.join("raw")).unwrap();
        fs::write(photos.join("a.png"), "").unwrap();
        write_model(&model);
        for root in [photos.clone(), photos.join("raw/..")] {
            let options = ColmapOptions { images_root: Some(root.clone()), ..ColmapOptions::default() };
            let source = ColmapScenes::open(&model, options).unwrap();
            let scene = source.load(&source.keys()[0], &mut Warnings::new()).unwrap();
            assert!(
                scene.frames[0].image.file().is_some_and(Path::is_file),
                "{}: {:?}",
                root.display(),
                scene.frames[0].image
            );
        }
    }
}
