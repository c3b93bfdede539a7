use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::frames::attach_pictures;
use super::read_trajectory;
use crate::camera_policy::report_cameras;
use crate::files::list;
use crate::{Scene, SceneError, SceneSource, WarningKind, Warnings};

/// Where to look for what a folder of trajectories does not hold itself.
#[derive(Clone, Debug, Default)]
pub struct Re10kOptions {
    /// Folder with `<key>/<timestamp>.jpg` or `<key>/images/…`; beside the trajectories by default.
    pub frames_root: Option<PathBuf>,
}

/// RE10K trajectory files, as one file or a folder of them.
///
/// The key is the file's stem. Trajectories lie in the folder as `<key>.txt` (the official layout), or
/// one folder deeper as `<key>/<key>.txt`. Pictures (JPEG, PNG or WebP) are looked for, in this order, in
/// `<key>/` and `<key>/images/` beside the trajectory or below `frames_root`, and in `images/` beside a
/// trajectory that is the only one of its folder. They are named by timestamp, or numbered by row from
/// 0 or from 1 (`00000.png`, `frame_1.jpg`); which of the two is told from the names. Without any such
/// folder the scene is a trajectory alone.
#[derive(Clone, Debug)]
pub struct Re10kScenes {
    path: PathBuf,
    options: Re10kOptions,
    keys: Vec<String>,
    files: Vec<TrajectoryFile>,
}

#[derive(Clone, Debug)]
struct TrajectoryFile {
    path: PathBuf,
    alone_in_folder: bool,
}

impl Re10kScenes {
    /// Finds the trajectories of a file or folder; reads none of them.
    ///
    /// # Errors
    /// [`SceneError::Io`], and [`SceneError::Unrecognized`] for a folder without trajectories.
    pub fn open(path: &Path, options: Re10kOptions) -> Result<Self, SceneError> {
        let found =
            if path.is_dir() { trajectory_files(path)? } else { BTreeMap::from([(stem(path), path.to_owned())]) };
        if found.is_empty() {
            return Err(SceneError::Unrecognized {
                expected: "<key>.txt or <key>/<key>.txt with RE10K trajectories".to_owned(),
                found: "a folder without any".to_owned(),
                path: path.to_owned(),
            });
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
        let (keys, files) = found
            .into_iter()
            .map(|(key, path)| {
                (key, TrajectoryFile { alone_in_folder: files_in.get(&folder(&path)) == Some(&1), path })
            })
            .unzip();
        Ok(Self { path: path.to_owned(), options, keys, files })
    }

    fn picture_folders(&self, key: &str, file: &TrajectoryFile) -> Vec<PathBuf> {
        if let Some(root) = &self.options.frames_root {
            return vec![root.join(key), root.join(key).join("images")];
        }
        let beside = existing_folder(&file.path);
        let mut folders = vec![beside.join(key), beside.join(key).join("images")];
        if file.alone_in_folder {
            folders.push(beside.join("images"));
        }
        folders
    }
}

impl SceneSource for Re10kScenes {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let position = self.keys.binary_search_by(|held| held.as_str().cmp(key)).ok();
        let Some(file) = position.and_then(|at| self.files.get(at)) else {
            return Err(SceneError::UnknownScene { key: key.to_owned(), path: self.path.clone() });
        };
        let trajectory = read_trajectory(&file.path)?;
        let mut scene = trajectory.to_scene(key);
        if let Some(row) = trajectory.rows.iter().position(|row| row.radial != [0.0; 2]) {
            let detail = format!("row {row}: columns 6 and 7 are not zero; no loader of the field reads them");
            warnings.push(WarningKind::LensDistortion, key, detail);
        }
        attach_pictures(&mut scene, &self.picture_folders(key, file), warnings)?;
        report_cameras(&scene, warnings);
        Ok(scene)
    }
}

/// Keys and files of a folder's trajectories: `<key>.txt` before `<key>/<key>.txt`.
pub(crate) fn trajectory_files(folder: &Path) -> Result<BTreeMap<String, PathBuf>, SceneError> {
    let mut found = BTreeMap::new();
    for (name, is_folder) in list(folder)? {
        if is_folder {
            let file = folder.join(&name).join(format!("{name}.txt"));
            if file.is_file() {
                found.entry(name).or_insert(file);
            }
        } else if let Some(key) = trajectory_key(&name) {
            found.insert(key.to_owned(), folder.join(&name));
        }
    }
    Ok(found)
}

fn trajectory_key(name: &str) -> Option<&str> {
    name.strip_suffix(".txt").filter(|key| !key.is_empty() && !key.starts_with('.'))
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The folder of a file, `.` where its path has none.
fn existing_folder(file: &Path) -> PathBuf {
    match file.parent() {
        Some(folder) if folder != Path::new("") => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}
