use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use super::frames::{attach_images, have_numbers};
use super::trajectory::read_partly_posed;
use crate::checks::ignored::Collections;
use crate::dataset::find_by_key;
use crate::files::list;
use crate::{FrameImage, Scene, SceneError, WarningKind, Warnings};

/// How RE10K trajectories are read.
#[derive(Clone, Debug, Default)]
pub struct Re10kOptions {
    /// Folder with `<key>/<timestamp>.jpg` or `<key>/images/…`; by default that of the trajectories.
    pub frames_root: Option<PathBuf>,
}

/// RE10K trajectory files, as one file or a folder of them.
///
/// The key is the file's stem. Trajectories are `<key>.txt` in the folder (the official layout), or `<key>/<key>.txt`.
/// Images (JPEG, PNG or WebP) are searched, in this order, in `<key>/` and `<key>/images/` next to the trajectory or
/// below `frames_root`, and in `images/` next to a trajectory that is the only one in its folder. They are named by
/// timestamp, or numbered by row (`00000.png`, `frame_1.jpg`): from any number if there are as many as rows, and from 0 or 1 with
/// gaps, which is detected from the names; a scene whose images fit its rows in two ways is an error. The first
/// of these folders with an image whose name ends in a number is used, and of several images with one number that named
/// by it alone. Of images that differ by their extension alone, that with the extension of the other frames is used. An image with
/// a timestamp or number that no row has is counted. Without such a folder the scene has no
/// images; if there is a `frames_root`, or another scene has images, they are missing.
#[derive(Clone, Debug)]
pub struct Re10kScenes {
    path: PathBuf,
    options: Re10kOptions,
    keys: Vec<String>,
    files: Vec<TrajectoryFile>,
    /// Whether any scene has images; found out for the first scene without.
    has_images: OnceLock<bool>,
}

#[derive(Clone, Debug)]
struct TrajectoryFile {
    path: PathBuf,
    alone_in_folder: bool,
}

impl Re10kScenes {
    /// Finds the trajectories of a file or folder without reading them. Of two with one key the first layout's is used,
    /// with a warning.
    ///
    /// # Errors
    /// [`SceneError::Io`], and [`SceneError::Unrecognized`] for a folder without trajectories, or a `frames_root` without a
    /// folder of any of them.
    pub fn open(path: &Path, options: Re10kOptions, warnings: &mut Warnings) -> Result<Self, SceneError> {
        let found = if path.is_dir() {
            let found = trajectory_files(path)?;
            report_second_files(path, &found, warnings);
            found
        } else {
            BTreeMap::from([(stem(path), path.to_owned())])
        };
        if found.is_empty() {
            let expected = "<key>.txt or <key>/<key>.txt with RE10K trajectories";
            return Err(SceneError::unrecognized(path, expected, "no such files"));
        }
        if let (Some(root), Some(key)) = (&options.frames_root, found.keys().next())
            && !found.keys().any(|key| root.join(key).is_dir())
        {
            let expected = format!("frames in a folder that is named like a trajectory, such as {key}/");
            return Err(SceneError::unrecognized(root, expected, "no such folder"));
        }
        let mut files_in: BTreeMap<PathBuf, usize> = BTreeMap::new();
        let folder = |file: &Path| file.parent().map(Path::to_owned).unwrap_or_default();
        for file in found.values() {
            *files_in.entry(folder(file)).or_default() += 1;
        }
        if !path.is_dir() {
            let siblings = list(&existing_folder(path))?;
            let texts = siblings.iter().filter(|(name, is_folder)| !is_folder && trajectory_key(name).is_some());
            files_in.insert(folder(path), texts.count());
        }
        let file = |path: PathBuf| TrajectoryFile { alone_in_folder: files_in.get(&folder(&path)) == Some(&1), path };
        let (keys, files) = found.into_iter().map(|(key, path)| (key, file(path))).unzip();
        Ok(Self { path: path.to_owned(), options, keys, files, has_images: OnceLock::new() })
    }

    /// The opened folder with its keys, and if it contains one clip with `images/` next to the trajectory, with all its folders.
    pub(crate) fn collections(&self) -> Collections {
        let mut members: BTreeSet<String> = self.keys.iter().cloned().collect();
        let is_one_clip = |key: &String, file: &TrajectoryFile| {
            let is_here = file.alone_in_folder && file.path.parent() == Some(self.path.as_path());
            is_here && !self.path.join(key).is_dir() && self.path.join("images").is_dir()
        };
        if self.keys.iter().zip(&self.files).any(|(key, file)| is_one_clip(key, file)) {
            // A folder that cannot be listed is an error where its other entries are looked at.
            let folders = list(&self.path).unwrap_or_default().into_iter().filter(|(_, is_folder)| *is_folder);
            members.extend(folders.map(|(name, _)| name));
        }
        Collections::from([(self.path.clone(), members)])
    }

    fn has_images(&self) -> bool {
        let has_images = |(key, file): (&String, &TrajectoryFile)| have_numbers(&self.image_folders(key, file));
        *self.has_images.get_or_init(|| self.keys.iter().zip(&self.files).any(has_images))
    }

    fn image_folders(&self, key: &str, file: &TrajectoryFile) -> Vec<PathBuf> {
        if let Some(root) = &self.options.frames_root {
            return vec![root.join(key), root.join(key).join("images")];
        }
        let root = existing_folder(&file.path);
        let mut folders = vec![root.join(key), root.join(key).join("images")];
        if file.alone_in_folder {
            folders.push(root.join("images"));
        }
        folders
    }
}

impl crate::SceneReader for Re10kScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn files(&self, key: &str) -> Result<Vec<PathBuf>, SceneError> {
        Ok(vec![find_by_key(&self.keys, &self.files, key, &self.path)?.path.clone()])
    }

    fn read(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let file = find_by_key(&self.keys, &self.files, key, &self.path)?;
        let (trajectory, unposed) = read_partly_posed(&file.path)?;
        let mut scene = trajectory.to_scene(key);
        if let Some(row) = trajectory.rows.iter().position(|row| row.radial.iter().any(|slot| *slot != 0.0)) {
            let detail = format!("row {row}: columns 6 and 7 are not zero; no loader of the field reads them");
            warnings.push(WarningKind::LensDistortion, key, detail);
        }
        let expected = || self.options.frames_root.is_some() || self.has_images();
        attach_images(&mut scene, &self.image_folders(key, file), expected, warnings)?;
        for (row, error) in unposed {
            if let Some(frame) = scene.frames.get_mut(row) {
                frame.image = std::mem::replace(&mut frame.image, FrameImage::Absent).unposed(error.to_string());
            }
        }
        Ok(scene)
    }
}

/// Keys and files of a folder's trajectories; `<key>.txt` is preferred to `<key>/<key>.txt`.
pub(crate) fn trajectory_files(folder: &Path) -> Result<BTreeMap<String, PathBuf>, SceneError> {
    let mut found = BTreeMap::new();
    for (name, is_folder) in list(folder)? {
        if is_folder {
            let file = nested(folder, &name);
            if file.is_file() {
                found.entry(name).or_insert(file);
            }
        } else if let Some(key) = trajectory_key(&name) {
            found.insert(key.to_owned(), folder.join(&name));
        }
    }
    Ok(found)
}

/// Warns about each `<key>/<key>.txt` that is not used because of a `<key>.txt`.
fn report_second_files(folder: &Path, found: &BTreeMap<String, PathBuf>, warnings: &mut Warnings) {
    for (key, used) in found {
        let second = nested(folder, key);
        if second != *used && second.is_file() {
            let detail = format!("{} is used, not {}", used.display(), second.display());
            warnings.push(WarningKind::DuplicateScene, key, detail);
        }
    }
}

fn nested(folder: &Path, key: &str) -> PathBuf {
    folder.join(key).join(format!("{key}.txt"))
}

pub(crate) fn trajectory_key(name: &str) -> Option<&str> {
    name.strip_suffix(".txt").filter(|key| !key.is_empty() && !key.starts_with('.'))
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// The folder of a file, `.` if its path has none.
fn existing_folder(file: &Path) -> PathBuf {
    match file.parent() {
        Some(folder) if folder != Path::new("") => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::SceneSource as _;

    const ROWS: &str = "0 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n7 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n";

    /// Two clips, of which one has a folder of frames below another root.
    #[test]
    fn images_are_missing_in_a_root_of_frames_without_the_clip() {
        let folder = tempfile::tempdir().unwrap();
        let (clips, root) = (folder.path().join("clips"), folder.path().join("frames"));
        fs::create_dir_all(&clips).unwrap();
        fs::create_dir_all(root.join("a")).unwrap();
        for key in ["a", "b"] {
            fs::write(clips.join(format!("{key}.txt")), ROWS).unwrap();
        }
        for time in [0, 7] {
            fs::write(root.join(format!("a/{time}.png")), b"").unwrap();
        }
        let first_images = |frames_root: Option<PathBuf>| {
            let mut warnings = Warnings::new();
            let scenes = Re10kScenes::open(&clips, Re10kOptions { frames_root }, &mut warnings).unwrap();
            let images = ["a", "b"].map(|key| scenes.load(key, &mut warnings).unwrap().frames[0].image.clone());
            (images, warnings.count(WarningKind::MissingImage))
        };
        let ([a, b], missing) = first_images(Some(root));
        assert!(matches!(&a, FrameImage::File(path) if path.ends_with("frames/a/0.png")), "{a:?}");
        assert!(matches!(&b, FrameImage::Missing(path) if path.ends_with("frames/b/0.jpg")), "{b:?}");
        assert_eq!(missing, 2, "one of each frame of b");
        let ([a, b], missing) = first_images(None);
        assert!(matches!((&a, &b), (FrameImage::Absent, FrameImage::Absent)), "{a:?} {b:?}");
        assert_eq!(missing, 0, "nobody stated where frames should be");
    }

    #[test]
    fn a_cover_does_not_hide_the_frames_below() {
        let folder = tempfile::tempdir().unwrap();
        let clips = folder.path();
        fs::create_dir_all(clips.join("a/images")).unwrap();
        for key in ["a", "b"] {
            fs::write(clips.join(format!("{key}.txt")), ROWS).unwrap();
        }
        fs::write(clips.join("a/cover.jpg"), b"").unwrap();
        let first_images = || {
            let scenes = Re10kScenes::open(clips, Re10kOptions::default(), &mut Warnings::new()).unwrap();
            ["a", "b"].map(|key| scenes.load(key, &mut Warnings::new()).unwrap().frames[0].image.clone())
        };
        let [a, b] = first_images();
        assert!(matches!((&a, &b), (FrameImage::Missing(_), FrameImage::Absent)), "a cover is no frame: {a:?} {b:?}");
        for time in [0, 7] {
            fs::write(clips.join(format!("a/images/{time}.png")), b"").unwrap();
        }
        let [a, b] = first_images();
        assert!(matches!(&a, FrameImage::File(path) if path.ends_with("a/images/0.png")), "{a:?}");
        assert!(matches!(&b, FrameImage::Missing(_)), "{b:?}");
    }

    /// One clip has lost its folder; in the other layout, `images/` next to the only trajectory of a folder.
    #[test]
    fn images_are_missing_where_another_clip_has_some() {
        for (trajectory, images) in [("KEY.txt", "a"), ("KEY/KEY.txt", "a/images")] {
            let folder = tempfile::tempdir().unwrap();
            let clips = folder.path();
            for key in ["a", "b"] {
                atsplat_tests::write_file(&clips.join(trajectory.replace("KEY", key)), ROWS);
            }
            let load = |key: &str| {
                let mut warnings = Warnings::new();
                let scenes = Re10kScenes::open(clips, Re10kOptions::default(), &mut warnings).unwrap();
                let scene = scenes.load(key, &mut warnings).unwrap();
                (scene.frames[0].image.clone(), warnings.count(WarningKind::MissingImage))
            };
            assert!(matches!(load("b"), (FrameImage::Absent, 0)), "bare trajectories");
            fs::create_dir_all(clips.join(images)).unwrap();
            fs::write(clips.join(images).join("notes"), "no image").unwrap();
            assert!(matches!(load("b"), (FrameImage::Absent, 0)), "a folder without an image");
            fs::write(clips.join(images).join("0.png"), b"").unwrap();
            assert!(matches!(load("b"), (FrameImage::Missing(_), 2)), "{trajectory}: {:?}", load("b"));
            assert!(matches!(load("a"), (FrameImage::File(_), 1)), "{trajectory}: {:?}", load("a"));
        }
    }

    /// Next to the only clip whose name is text, whose images are in `images/` or nowhere.
    #[cfg(target_os = "linux")]
    #[test]
    fn a_clip_whose_name_is_not_utf_8_is_counted_next_to_another() {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt as _;

        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("a.txt"), ROWS).unwrap();
        fs::write(folder.path().join(OsStr::from_bytes(b"b\xe8.txt")), ROWS).unwrap();
        let ignored = || {
            let mut warnings = Warnings::new();
            crate::open(folder.path(), &mut warnings).unwrap();
            warnings.kept().iter().map(|warning| warning.scene.clone()).collect::<Vec<_>>()
        };
        assert_eq!(ignored(), ["b\u{fffd}.txt"]);
        for images in ["images", "thumbnails"] {
            fs::create_dir(folder.path().join(images)).unwrap();
            fs::write(folder.path().join(images).join("0.png"), b"").unwrap();
            assert_eq!(ignored(), ["b\u{fffd}.txt"], "{images}");
        }
    }
}
