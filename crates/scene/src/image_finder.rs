use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_camera::ImageSize;

use crate::files::{DYNAMIC_MASK, ImageListing, inside, split_image_name};
use crate::scene::{in_frame, size_of_file};
use crate::{FrameImage, ImageFolder, SceneError, WarningKind, Warnings};

/// Finds the images that a `transforms.json` or COLMAP model lists; each folder is read once.
#[derive(Debug)]
pub(crate) struct ImageFinder<'a> {
    root: &'a Path,
    file: &'a Path,
    copy: ImageFolder,
    /// Size of the images of a copy that is preferred where the listed folder does not exist.
    expected_size: Option<ImageSize>,
    /// By the listed folder.
    folders: BTreeMap<String, Folder>,
    /// How many listed paths fit several images.
    ambiguous: usize,
    /// The first of them, with the image that is used.
    first_ambiguous: Option<String>,
}

/// Where a listed image is.
#[derive(Debug)]
pub(crate) struct FoundImage {
    pub(crate) image: FrameImage,
    /// How the image's path differs from the listed one, if it does.
    pub(crate) elsewhere: Option<String>,
    /// Whether the folder is the listed one, not a downscaled copy.
    pub(crate) as_listed: bool,
    /// Whether instant-ngp's mask of the image (`dynamic_mask_<name>.png`) is next to it.
    pub(crate) has_dynamic_mask: bool,
}

impl FoundImage {
    /// Warns if the image of the frame at `position` is missing or not where it is listed. `advice` follows the path of a missing one.
    pub(crate) fn report(&self, scene: &str, position: usize, advice: &str, warnings: &mut Warnings) {
        if let FrameImage::Missing(path) = &self.image {
            let detail = format!("frame {position}: no {}{advice}", path.display());
            warnings.push(WarningKind::MissingImage, scene, detail);
        }
        if let Some(detail) = &self.elsewhere {
            warnings.push(WarningKind::ImageAtOtherPath, scene, format!("frame {position}: {detail}"));
        }
    }
}

/// The folder that is used for a listed one.
#[derive(Debug)]
struct Folder {
    path: PathBuf,
    listing: Option<ImageListing>,
    as_listed: bool,
}

/// The file of a listed name.
struct FoundFile {
    path: PathBuf,
    /// Which of several images it is that fit the name.
    ambiguity: Option<String>,
}

impl<'a> ImageFinder<'a> {
    /// Paths are relative to `root`; `file` lists them and is for messages.
    pub(crate) const fn new(root: &'a Path, file: &'a Path, copy: ImageFolder) -> Self {
        Self { root, file, copy, expected_size: None, folders: BTreeMap::new(), ambiguous: 0, first_ambiguous: None }
    }

    /// Where the listed folder does not exist, prefers the copy whose first image has this size.
    #[must_use]
    pub(crate) fn preferring(self, expected_size: Option<ImageSize>) -> Self {
        Self { expected_size, ..self }
    }

    /// Warns if images were found by their name without extension where several have it.
    pub(crate) fn report_ambiguous(&self, scene: &str, warnings: &mut Warnings) {
        if let Some(first) = &self.first_ambiguous {
            let detail = format!("{} listed paths fit several images, first: {first}", self.ambiguous);
            warnings.push(WarningKind::AmbiguousNumbering, scene, detail);
        }
    }

    /// The image listed as `listed`, relative to `folder`, which it must not leave.
    pub(crate) fn find_below(&mut self, folder: &str, listed: &str, location: &str) -> Result<FoundImage, SceneError> {
        let below = inside(&self.root.join(folder), listed).map(|parts| parts.join("/"));
        let below = below.ok_or_else(|| outside(listed, location, self.file))?;
        self.find(&format!("{folder}/{below}"), location)
    }

    /// The image listed as `listed` at `location` of the file.
    pub(crate) fn find(&mut self, listed: &str, location: &str) -> Result<FoundImage, SceneError> {
        let outside = || outside(listed, location, self.file);
        let parts = inside(self.root, listed).ok_or_else(outside)?;
        let (name, folders) = parts.split_last().ok_or_else(outside)?;
        let is_chosen_copy = matches!(self.copy, ImageFolder::Downscaled(_));
        let folder = self.folder(&folders.join("/"))?;
        let (as_listed, has_dynamic_mask) = (folder.as_listed, folder.has_dynamic_mask(name));
        let Some(FoundFile { path, ambiguity }) = folder.find(name) else {
            let image = FrameImage::Missing(folder.path.join(name));
            return Ok(FoundImage { image, elsewhere: None, as_listed, has_dynamic_mask });
        };
        // Blender and instant-ngp list names without an extension.
        let is_named_so = split_image_name(name).is_none() || path.file_name().is_some_and(|found| found == *name);
        let is_expected = is_named_so && (as_listed || is_chosen_copy);
        let elsewhere = (!is_expected).then(|| format!("{listed} found as {}", path.display()));
        if let Some(detail) = ambiguity {
            self.ambiguous += 1;
            self.first_ambiguous.get_or_insert_with(|| format!("{listed}: {detail}"));
        }
        Ok(FoundImage { image: FrameImage::File(path), elsewhere, as_listed, has_dynamic_mask })
    }

    fn folder(&mut self, listed: &str) -> Result<&Folder, SceneError> {
        if !self.folders.contains_key(listed) {
            let folder = self.folder_to_use(listed)?;
            self.folders.insert(listed.to_owned(), folder);
        }
        self.folders.get(listed).ok_or_else(|| SceneError::unrecognized(self.root, "a folder of images", listed))
    }

    /// The copy of a folder that was asked for; if that is the listed one and does not exist, its downscaled copy of the expected
    /// size, or else the largest.
    fn folder_to_use(&self, listed: &str) -> Result<Folder, SceneError> {
        let downscaled = |factor: u32| self.root.join(downscaled(listed, factor));
        let candidates = match self.copy {
            ImageFolder::Listed => {
                let mut candidates = vec![(self.root.join(listed), true)];
                candidates.extend(ImageFolder::FACTORS.map(|factor| (downscaled(factor), false)));
                candidates
            }
            ImageFolder::Downscaled(factor) => vec![(downscaled(factor), false)],
        };
        let (mut largest, mut first) = (None, None);
        for (path, as_listed) in candidates {
            let listing = ImageListing::read(&path)?;
            let folder = Folder { path, listing, as_listed };
            if folder.listing.is_none() {
                first = first.or(Some(folder));
            } else if as_listed || self.expected_size.is_none_or(|size| folder.has_images_of(size)) {
                return Ok(folder);
            } else {
                largest = largest.or(Some(folder));
            }
        }
        let missing = || Folder { path: self.root.join(listed), listing: None, as_listed: true };
        Ok(largest.or(first).unwrap_or_else(missing))
    }
}

impl Folder {
    /// The image with this name, or else one with its stem.
    fn find(&self, name: &str) -> Option<FoundFile> {
        let listing = self.listing.as_ref()?;
        if let Some(path) = listing.by_name(name) {
            return Some(FoundFile { path, ambiguity: None });
        }
        // A TIFF instead of a missing JPEG may be its depth map.
        let (stem, path) = match split_image_name(name) {
            Some((stem, _)) => (stem, listing.read_by_stem(stem)),
            None => (name, listing.by_stem(name)),
        };
        Some(FoundFile { path: path?, ambiguity: listing.ambiguity_of_stem(stem) })
    }

    fn has_dynamic_mask(&self, name: &str) -> bool {
        let stem = split_image_name(name).map_or(name, |(stem, _)| stem);
        let mask = format!("{DYNAMIC_MASK}{stem}.png");
        self.listing.as_ref().is_some_and(|listing| listing.by_name(&mask).is_some())
    }

    /// Whether the first image has this size. One that cannot be read is reported where it is decoded.
    fn has_images_of(&self, size: ImageSize) -> bool {
        let first = self.listing.as_ref().and_then(|listing| listing.by_stem(listing.stems().next()?));
        first.is_some_and(|path| {
            let image = FrameImage::File(path.clone());
            size_of_file(&path, in_frame("", 0, &image)).is_ok_and(|found| found == size)
        })
    }
}

fn outside(listed: &str, location: &str, file: &Path) -> SceneError {
    SceneError::OutsideScene {
        location: location.to_owned(),
        found: listed.chars().take(200).collect(),
        path: file.to_owned(),
    }
}

/// The downscaled copy of a folder: `images_8` for `images` and `images_4`, `images_8/left` for `images/left`. Without a
/// component `images` the factor is appended to the last one: the number of `cam_1` is the camera's, and `cam_2` another
/// camera. For images next to the file the folder is nerfstudio's `images_8`.
fn downscaled(listed: &str, factor: u32) -> String {
    let mut components: Vec<&str> = listed.split('/').collect();
    let images = components.iter().position(|name| is_of_images(name));
    let at = images.unwrap_or(components.len() - 1);
    let name = match components.get(at) {
        Some(name) if images.is_none() && !name.is_empty() => format!("{name}_{factor}"),
        _ => format!("images_{factor}"),
    };
    if let Some(component) = components.get_mut(at) {
        *component = &name;
    }
    components.join("/")
}

/// Whether a folder with this name is nerfstudio's and 3DGS's `images`, or a scaled copy of it.
pub(crate) fn is_of_images(name: &str) -> bool {
    without_factor(name) == "images"
}

/// A folder's name without a number at its end, which for other folders than `images` need not be a factor.
fn without_factor(component: &str) -> &str {
    let is_factor = |tail: &str| !tail.is_empty() && tail.bytes().all(|byte| byte.is_ascii_digit());
    component.rsplit_once('_').filter(|(_, tail)| is_factor(tail)).map_or(component, |(base, _)| base)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factor_is_appended_to_the_folder_of_images() {
        for (listed, expected) in [
            ("images", "images_8"),
            ("images_4", "images_8"),
            ("images/left", "images_8/left"),
            ("capture/images", "capture/images_8"),
            ("train", "train_8"),
            ("cam_1", "cam_1_8"),
            ("rig/cam_1", "rig/cam_1_8"),
            ("images_2/cam_1", "images_8/cam_1"),
            ("scan_1/images_2", "scan_1/images_8"),
            ("", "images_8"),
        ] {
            assert_eq!(downscaled(listed, 8), expected, "{listed:?}");
        }
    }
}
