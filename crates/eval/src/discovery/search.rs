//! Finds the datasets in a folder.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_scene::nerfstudio::SUBSET_PREFIX;
use atsplat_scene::{Format, OpenOptions, SceneError, SceneSource, Warnings, open_with};

use super::folder::{NotRun, first_readable};
use crate::folder_walk::{FolderWalk, LeftOut, VisitedFolder};

/// A dataset on disk.
pub(super) struct DatasetOnDisk {
    pub(super) path: PathBuf,
    pub(super) format: Format,
    pub(super) source: Arc<dyn SceneSource>,
    /// What was found when it was opened.
    pub(super) opening: Warnings,
}

/// What was found in a folder and below it.
#[derive(Default)]
pub(super) struct Search {
    pub(super) datasets: Vec<DatasetOnDisk>,
    pub(super) not_run: Vec<NotRun>,
}

impl Search {
    /// Searches a folder and those below it. The scene folders of a dataset are not searched, since its scenes would be
    /// found twice; other folders next to them are, except for hidden ones.
    pub(super) fn of(folder: &Path) -> Self {
        let mut search = Self::default();
        let mut walk = FolderWalk::from(folder);
        while let Some(VisitedFolder { path, mut folders, .. }) = walk.visit_next() {
            search.open(&path, &mut folders);
            walk.enter(folders);
        }
        let left_out = walk.left_out().into_iter().filter(|(_, why)| !matches!(why, LeftOut::Hidden));
        search.not_run.extend(left_out.map(|(folder, why)| not_run(&folder, why.to_string())));
        search
    }

    /// Collects the dataset in a folder, if there is one, and keeps those of the folders in it that are not its scenes.
    fn open(&mut self, folder: &Path, folders: &mut Vec<PathBuf>) {
        let mut opening = Warnings::new();
        match open_with(folder, &OpenOptions::default(), &mut opening) {
            Ok(dataset) => {
                let (path, format) = (folder.to_owned(), dataset.format);
                let source: Arc<dyn SceneSource> = Arc::new(dataset);
                match has_images(source.as_ref()) {
                    Ok(true) => {
                        retain_unread(folders, source.as_ref());
                        self.datasets.push(DatasetOnDisk { path, format, source, opening });
                    }
                    Ok(false) => {}
                    Err(error) => self.not_run.push(not_run(folder, format!("its scenes cannot be read: {error}"))),
                }
            }
            Err(SceneError::Unrecognized { .. }) => {}
            Err(error) => self.not_run.push(not_run(folder, error.to_string())),
        }
    }
}

fn not_run(folder: &Path, why: String) -> NotRun {
    NotRun { what: folder.display().to_string(), why }
}

/// Keeps the folders next to a dataset's scenes that are none of them; none if its scenes are not folders.
fn retain_unread(folders: &mut Vec<PathBuf>, source: &dyn SceneSource) {
    let scenes: BTreeSet<&str> = source.keys().iter().filter_map(|key| key.split('/').next()).collect();
    // DL3DV's scenes are one level deeper, in the folders of its subsets.
    let contains_scene = |path: &PathBuf| {
        let mut below = scenes.iter().filter_map(|key| key.strip_prefix(SUBSET_PREFIX));
        below.any(|name| path.join(name).is_dir())
    };
    let is_part = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str());
        name.is_some_and(|name| scenes.contains(name)) || contains_scene(path)
    };
    let is_collection = folders.iter().any(is_part);
    folders.retain(|path| is_collection && !is_part(path));
}

/// Whether any scene has an image file.
fn has_images(source: &dyn SceneSource) -> Result<bool, SceneError> {
    Ok(first_readable(source, |_, _, _| Ok(()))?.is_some())
}

#[cfg(test)]
mod tests {
    use atsplat_files::name_of;

    use super::super::folder::tests::capture;
    use super::*;

    #[test]
    fn finds_every_scene_once_at_any_depth() {
        let root = tempfile::tempdir().unwrap();
        for scene in ["a", "captures/b", "captures/c", "captures/more/d", "captures/far/1/2/3/4/e"] {
            capture(&root.path().join(scene));
        }
        let Search { datasets, not_run } = Search::of(root.path());
        let mut keys: Vec<String> = datasets.iter().flat_map(|dataset| dataset.source.keys().to_vec()).collect();
        keys.sort();
        assert_eq!(keys, ["a", "b", "c", "d", "dl3dv_e"], "the last one is in a subset's folder, as DL3DV has them");
        assert!(not_run.is_empty(), "{not_run:?}");
    }

    /// The links sort before what they lead to, or after it.
    #[cfg(unix)]
    #[test]
    fn a_dataset_that_a_link_leads_to_is_found_once() {
        use std::os::unix::fs::symlink;
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let [root, elsewhere] = [folders[0].path(), folders[1].path()];
        for folder in [root.join("real/sets/garden"), root.join(".trash/sets/garden"), elsewhere.join("sets/park")] {
            capture(&folder);
        }
        for (target, link) in [(&*root.join("real"), "current"), (root, "all"), (elsewhere, "at")] {
            symlink(target, root.join(link)).unwrap();
        }
        let Search { datasets, not_run } = Search::of(root);
        let paths: Vec<&Path> = datasets.iter().map(|dataset| dataset.path.strip_prefix(root).unwrap()).collect();
        assert_eq!(paths, ["real", "at"].map(Path::new));
        let links: Vec<String> = not_run.iter().map(|not_run| name_of(Path::new(&not_run.what))).collect();
        assert_eq!(links, ["all", "current"], "{not_run:?}");
    }
}
