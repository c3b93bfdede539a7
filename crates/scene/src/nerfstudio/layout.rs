//! Where the scenes of each dataset have their `transforms.json` and its images.

use std::path::{Path, PathBuf};

use crate::files::{absolute, last_name};

const TRANSFORMS: &str = "transforms.json";

/// `ScanNet++`'s folder of a scene's photos, which may be opened itself.
const DSLR: &str = "dslr";

/// A place of a scene's cameras.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    /// Folder of the file, below the scene's; empty for that itself.
    pub(crate) folder: &'static str,
    file: &'static str,
    /// Folder of the images, below the scene's, if paths in the file are not relative to its own folder.
    images: Option<&'static str>,
    is_undistorted: bool,
}

/// In order of preference.
pub(crate) const LAYOUTS: [Layout; 5] = [
    Layout::of(""),
    // ScanNet++ (scannetpp `dslr/undistort.py`, `common/scene_release.py`): since April 2025, downloads contain pinhole images too.
    Layout {
        folder: "dslr/nerfstudio",
        file: "transforms_undistorted.json",
        images: Some("dslr/resized_undistorted_images"),
        is_undistorted: true,
    },
    Layout { images: Some("dslr/resized_images"), ..Layout::of("dslr/nerfstudio") },
    // DL3DV: the distorted captures, and the undistorted ones in 3DGS's layout (DL3DV `README.md:101`).
    Layout::of("nerfstudio"),
    Layout { is_undistorted: true, ..Layout::of("gaussian_splat") },
];

impl Layout {
    /// A `transforms.json` of distorted images, which are in its folder.
    const fn of(folder: &'static str) -> Self {
        Self { folder, file: TRANSFORMS, images: None, is_undistorted: false }
    }

    fn file_in(&self, scene: &Path) -> PathBuf {
        let below_dslr = self.folder.strip_prefix(DSLR).and_then(|below| below.strip_prefix('/'));
        let folder = below_dslr.filter(|_| last_name(scene) == DSLR).unwrap_or(self.folder);
        scene.join(folder).join(self.file)
    }

    /// Whether a scene's cameras are in this file, by its path.
    fn has(&self, file: &Path) -> bool {
        absolute(file).ends_with(Path::new(self.folder).join(self.file))
    }
}

/// The file of the first layout that a scene's folder has.
pub(crate) fn transforms_in(scene: &Path, prefer_undistorted: bool) -> Option<PathBuf> {
    let mut layouts = LAYOUTS;
    // Stable: the others stay in their order.
    layouts.sort_by_key(|layout| prefer_undistorted && !layout.is_undistorted);
    let opened = absolute(scene);
    // ScanNet++'s folder of both files may be opened itself: the one of fisheyes is named like that of any scene.
    let own = layouts.iter().filter(|layout| layout.images.is_some() && opened.ends_with(layout.folder));
    let own = own.map(|layout| scene.join(layout.file));
    own.chain(layouts.iter().map(|layout| layout.file_in(scene))).find(|file| file.is_file())
}

/// Whether a file may be that of a scene, by its name.
pub(super) fn is_named_transforms(file: &Path) -> bool {
    file.file_name().is_some_and(|name| LAYOUTS.iter().any(|layout| name == layout.file))
}

/// Whether a file has the cameras of undistorted images, by its path.
pub(super) fn is_undistorted(file: &Path) -> bool {
    LAYOUTS.iter().any(|layout| layout.is_undistorted && layout.has(file))
}

/// The files of undistorted images, for messages.
pub(super) fn undistorted_in_words() -> String {
    let undistorted = LAYOUTS.iter().filter(|layout| layout.is_undistorted);
    undistorted.map(|layout| format!("{}/{}", layout.folder, layout.file)).collect::<Vec<_>>().join(" or ")
}

/// The folder of the scene whose cameras are in a file of any name.
pub(super) fn scene_folder(file: &Path) -> PathBuf {
    let file = absolute(file);
    let folder = file.parent().unwrap_or(&file);
    let layouts = LAYOUTS.iter().filter(|layout| folder.ends_with(layout.folder));
    let depth = layouts.map(|layout| Path::new(layout.folder).components().count()).max();
    folder.ancestors().nth(depth.unwrap_or_default()).unwrap_or(folder).to_owned()
}

/// The folder of the images that a file lists, as a root and the folder below it that their paths are relative to; empty for the
/// root itself.
pub(super) fn image_folder(file: &Path) -> (PathBuf, &'static str) {
    match LAYOUTS.iter().find_map(|layout| layout.images.filter(|_| layout.has(file))) {
        Some(images) => (scene_folder(file), images),
        None => (file.parent().unwrap_or_else(|| Path::new(".")).to_owned(), ""),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use atsplat_numeric::Tolerance;
    use serde_json::json;

    use super::*;
    use crate::{
        NerfstudioOptions, OpenOptions, Scene, SceneError, SceneSource as _, WarningKind, Warnings, open_with,
    };

    /// Scenes as `ScanNet++` has them: of `old`, images are fisheyes alone.
    fn scannetpp() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: String, text: &str| {
            atsplat_tests::write_file(&folder.path().join(name), text);
        };
        let frame = |name: &str, is_bad: bool| {
            let pose = [[1, 0, 0, 2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
            let mask = name.replace("JPG", "png");
            json!({ "file_path": name, "mask_path": mask, "transform_matrix": pose, "is_bad": is_bad })
        };
        for (scene, file, images, model, focal) in [
            ("new", "transforms", "resized_images", "OPENCV_FISHEYE", 3),
            ("new", "transforms_undistorted", "resized_undistorted_images", "PINHOLE", 4),
            ("old", "transforms", "resized_images", "OPENCV_FISHEYE", 3),
        ] {
            let root = json!({
                "w": 8, "h": 6, "fl_x": focal, "fl_y": focal, "camera_model": model, "has_mask": true,
                "frames": [frame("DSC01.JPG", false), frame("DSC02.JPG", true)], "test_frames": [frame("DSC03.JPG", false)],
            });
            write(format!("{scene}/dslr/nerfstudio/{file}.json"), &root.to_string());
            for image in ["DSC01", "DSC02", "DSC03"] {
                write(format!("{scene}/dslr/{images}/{image}.JPG"), "");
            }
        }
        folder
    }

    fn load(path: &Path, key: &str, prefer_gaussian_splat: bool) -> Result<(Scene, Warnings), SceneError> {
        let nerfstudio = NerfstudioOptions { prefer_gaussian_splat, ..NerfstudioOptions::default() };
        let mut warnings = Warnings::new();
        let dataset = open_with(path, &OpenOptions { nerfstudio, ..OpenOptions::default() }, &mut warnings)?;
        let scene = dataset.load(key, &mut warnings)?;
        Ok((scene, warnings))
    }

    #[test]
    fn images_of_scannetpp_are_undistorted_where_there_are_such() {
        let folder = scannetpp();
        let [undistorted, fisheyes] = ["new/dslr/resized_undistorted_images", "old/dslr/resized_images"];
        for (opened, key, images, fx) in [
            ("", "new", undistorted, 0.5),
            ("", "old", fisheyes, 0.375),
            ("new", "new", undistorted, 0.5),
            ("new/dslr", "new", undistorted, 0.5),
            ("new/dslr/nerfstudio", "new", undistorted, 0.5),
            ("new/dslr/nerfstudio/transforms_undistorted.json", "new", undistorted, 0.5),
            ("new/dslr/nerfstudio/transforms.json", "new", "new/dslr/resized_images", 0.375),
            ("old/dslr", "old", fisheyes, 0.375),
            ("old/dslr/nerfstudio", "old", fisheyes, 0.375),
        ] {
            let (scene, warnings) = load(&folder.path().join(opened), key, false).unwrap();
            let image = scene.frames[1].image.file().unwrap();
            assert!(image.ends_with(format!("{images}/DSC02.JPG")), "{opened}: {}", image.display());
            Tolerance::EXACT.assert([scene.frames[1].camera.intrinsics.fx], [fx], opened);
            let unread = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::UnreadField);
            let unread: Vec<&str> = unread.map(|warning| warning.detail.as_str()).collect();
            let starts =
                ["2 of 2 frames, first 0: mask_path", "1 of 2 frames, first 1: is_bad", "test_frames is not read: 1"];
            assert_eq!(unread.len(), starts.len(), "{unread:?}");
            assert!(unread.iter().zip(starts).all(|(found, start)| found.starts_with(start)), "{unread:?}");
            assert_eq!((scene.frames.len(), warnings.count(WarningKind::MissingImage)), (2, 0));
        }
    }

    #[test]
    fn without_undistorted_images_preferring_them_is_an_error() {
        let folder = scannetpp();
        for (opened, key) in [("", "new"), ("new/dslr", "new"), ("new/dslr/nerfstudio", "new"), ("", "old")] {
            assert!(load(&folder.path().join(opened), key, true).is_ok(), "{opened}");
        }
        let error = load(&folder.path().join("old"), "old", true).unwrap_err().to_string();
        let expected =
            "in a scene's dslr/nerfstudio/transforms_undistorted.json or gaussian_splat/transforms.json, found";
        assert!(error.contains(expected), "{error}");
    }

    /// The folder of images is not that of the file.
    #[test]
    fn images_of_scannetpp_are_in_their_folder() {
        let folder = scannetpp();
        let file = folder.path().join("old/dslr/nerfstudio/transforms.json");
        let leaving = fs::read_to_string(&file).unwrap().replace("DSC02.JPG", "../nerfstudio/DSC02.JPG");
        fs::write(&file, leaving).unwrap();
        let error = load(&file, "old", false).unwrap_err();
        assert!(matches!(error, SceneError::OutsideScene { .. }), "{error}");
    }
}
