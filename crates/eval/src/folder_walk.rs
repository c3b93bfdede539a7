//! A walk through a folder and those below it.

use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};
use std::{fmt, fs, io};

/// Visits folders at any depth, each once. Links are followed last, so that a folder has its own name, and only to
/// folders that were not visited yet, so that they cannot loop, and that do not contain the first one, which would lead through
/// the whole file system. Hidden folders are left out, except for the first.
pub(crate) struct FolderWalk {
    /// The first folder, without links in its path; `None` if it cannot be found.
    start: Option<PathBuf>,
    /// The next one is the last.
    pending: Vec<PathBuf>,
    links: VecDeque<PathBuf>,
    /// Without links in their paths.
    visited: BTreeSet<PathBuf>,
    left_out: Vec<(PathBuf, LeftOut)>,
}

/// Why a folder was not visited.
pub(crate) enum LeftOut {
    Hidden,
    /// It was visited under another name; with its path without links.
    Visited(PathBuf),
    /// It contains the folder with which the walk began; with its path without links.
    Containing(PathBuf),
    Unreadable(io::Error),
}

/// What is in a visited folder.
pub(crate) struct VisitedFolder {
    pub(crate) path: PathBuf,
    /// Folders, and links to folders, in the order of their names; without hidden ones.
    pub(crate) folders: Vec<PathBuf>,
    /// Everything else, in any order.
    pub(crate) files: Vec<PathBuf>,
}

impl FolderWalk {
    pub(crate) fn from(folder: &Path) -> Self {
        let (start, pending) = (folder.canonicalize().ok(), vec![folder.to_owned()]);
        Self { start, pending, links: VecDeque::new(), visited: BTreeSet::new(), left_out: Vec::new() }
    }

    /// Visits the next folder.
    pub(crate) fn visit_next(&mut self) -> Option<VisitedFolder> {
        loop {
            let path = self.pending.pop().or_else(|| self.links.pop_front())?;
            match self.visit(&path) {
                Ok(folder) => return Some(folder),
                Err(why) => self.left_out.push((path, why)),
            }
        }
    }

    /// Goes on with folders of the one that was visited last.
    pub(crate) fn enter(&mut self, folders: Vec<PathBuf>) {
        let (links, folders): (Vec<_>, Vec<_>) = folders.into_iter().partition(|folder| folder.is_symlink());
        self.links.extend(links);
        self.pending.extend(folders.into_iter().rev());
    }

    /// Folders that were not visited, and why.
    pub(crate) fn left_out(self) -> Vec<(PathBuf, LeftOut)> {
        self.left_out
    }

    fn visit(&mut self, path: &Path) -> Result<VisitedFolder, LeftOut> {
        let canonical = path.canonicalize().map_err(LeftOut::Unreadable)?;
        if self.visited.contains(&canonical) {
            return Err(LeftOut::Visited(canonical));
        }
        if self.start.as_ref().is_some_and(|start| *start != canonical && start.starts_with(&canonical)) {
            return Err(LeftOut::Containing(canonical));
        }
        self.visited.insert(canonical);
        let entries = fs::read_dir(path).and_then(Iterator::collect::<io::Result<Vec<_>>>);
        let (mut folders, mut files) = (Vec::new(), Vec::new());
        for entry in entries.map_err(LeftOut::Unreadable)? {
            let path = entry.path();
            // Most are images: only what a link leads to has to be looked up.
            let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir() || (kind.is_symlink() && path.is_dir()));
            if is_folder && entry.file_name().as_encoded_bytes().starts_with(b".") {
                self.left_out.push((path, LeftOut::Hidden));
            } else if is_folder {
                folders.push(path);
            } else {
                files.push(path);
            }
        }
        folders.sort();
        Ok(VisitedFolder { path: path.to_owned(), folders, files })
    }
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Hidden => write!(f, "hidden"),
            Self::Visited(path) => write!(f, "the same folder as {}, which is searched once", path.display()),
            Self::Containing(path) => write!(f, "{} contains the folder that is searched", path.display()),
            Self::Unreadable(error) => write!(f, "cannot be read: {error}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names of visited folders below a root in order, and of those left out.
    fn walked(root: &Path) -> [Vec<String>; 2] {
        let name = |path: &Path| path.strip_prefix(root).unwrap().display().to_string();
        let (mut walk, mut visited) = (FolderWalk::from(root), Vec::new());
        while let Some(VisitedFolder { path, folders, .. }) = walk.visit_next() {
            visited.push(name(&path));
            walk.enter(folders);
        }
        let mut left_out: Vec<String> =
            walk.left_out().iter().map(|(path, why)| format!("{}: {}", name(path), short(why))).collect();
        left_out.sort();
        [visited, left_out]
    }

    const fn short(why: &LeftOut) -> &'static str {
        match why {
            LeftOut::Hidden => "hidden",
            LeftOut::Visited(_) => "visited",
            LeftOut::Containing(_) => "containing",
            LeftOut::Unreadable(_) => "unreadable",
        }
    }

    #[test]
    fn folders_are_visited_at_any_depth_but_for_hidden_ones() {
        let root = tempfile::tempdir().unwrap();
        for folder in ["b/1/2/3/4/5/6", "a/.git/hooks", "a/c"] {
            fs::create_dir_all(root.path().join(folder)).unwrap();
        }
        fs::write(root.path().join("a/file"), "").unwrap();
        let deep = ["b", "b/1", "b/1/2", "b/1/2/3", "b/1/2/3/4", "b/1/2/3/4/5", "b/1/2/3/4/5/6"];
        let expected: Vec<&str> = ["", "a", "a/c"].into_iter().chain(deep).collect();
        assert_eq!(walked(root.path()), [expected, vec!["a/.git: hidden"]]);
    }

    #[cfg(unix)]
    #[test]
    fn links_do_not_lead_out_to_what_contains_the_start() {
        let outside = tempfile::tempdir().unwrap();
        let start = outside.path().join("data");
        for folder in [start.join("a"), outside.path().join("b/c")] {
            fs::create_dir_all(folder).unwrap();
        }
        for (target, link) in [(outside.path(), "above"), (&*outside.path().join("b"), "beside")] {
            std::os::unix::fs::symlink(target, start.join(link)).unwrap();
        }
        let visited = vec!["", "a", "beside", "beside/c"];
        assert_eq!(walked(&start), [visited, vec!["above: containing"]]);
    }

    /// A link leads into the other folder first, another one to all of it, and a third from there to the start.
    #[cfg(unix)]
    #[test]
    fn links_lead_to_each_folder_once_and_never_in_circles() {
        use std::os::unix::fs::symlink;
        let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
        let [root, elsewhere] = [folders[0].path(), folders[1].path()];
        for folder in [root.join("z"), elsewhere.join("x/y"), elsewhere.join("w")] {
            fs::create_dir_all(folder).unwrap();
        }
        let links = [(elsewhere.join("x"), root.join("a")), (elsewhere.to_owned(), root.join("b"))];
        for (target, link) in links.into_iter().chain([(root.to_owned(), elsewhere.join("w/back"))]) {
            symlink(target, link).unwrap();
        }
        let visited = vec!["", "z", "a", "a/y", "b", "b/w"];
        assert_eq!(walked(root), [visited, vec!["b/w/back: visited", "b/x: visited"]]);
    }
}
