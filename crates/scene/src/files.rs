//! Reads files and lists folders, with errors that contain the path.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use crate::SceneError;

/// Extensions of images, in order of preference if one stem has several; from [`FIRST_UNREAD`] on of formats that are not decoded,
/// so that the error names the format, and not a missing file.
const IMAGE_EXTENSIONS: [&str; 11] =
    ["jpg", "jpeg", "png", "webp", "tif", "tiff", "heic", "heif", "avif", "bmp", "gif"];
const FIRST_UNREAD: usize = 4;

/// Reads a regular file; a pipe or device could block or never end.
pub(crate) fn read_file(action: &'static str, path: &Path) -> Result<Vec<u8>, SceneError> {
    let bytes = atsplat_files::read(path).map_err(SceneError::io(action, path))?;
    require_fetched(action, path, &bytes)?;
    Ok(bytes)
}

/// An error for a Git LFS pointer, which is there instead of a file that was not fetched.
fn require_fetched(action: &'static str, path: &Path, start: &[u8]) -> Result<(), SceneError> {
    if atsplat_files::is_lfs_pointer(start) {
        return Err(SceneError::LfsPointer { action, path: path.to_owned() });
    }
    Ok(())
}

/// The first bytes of a regular file, at most `length`.
pub(crate) fn read_start(action: &'static str, path: &Path, length: u64) -> Result<Vec<u8>, SceneError> {
    let file = atsplat_files::open(path).map_err(SceneError::io(action, path))?;
    let mut start = Vec::new();
    file.take(length).read_to_end(&mut start).map_err(SceneError::io(action, path))?;
    require_fetched(action, path, &start)?;
    Ok(start)
}

/// Names in a folder, sorted, and whether each is a folder itself. Names that are not UTF-8 are skipped, because keys and
/// frames are text; [`not_utf8`] has them.
pub(crate) fn list(folder: &Path) -> Result<Vec<(String, bool)>, SceneError> {
    let text = |(name, kind): (OsString, Kind)| Some((name.into_string().ok()?, kind == Kind::Folder));
    Ok(entries(folder)?.into_iter().filter_map(text).collect())
}

/// The absolute path, which need not exist; the path as it is where there is none, as for an empty one.
pub(crate) fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

/// The first `most` folders in a folder, without hidden ones; none if it cannot be listed.
pub(crate) fn subfolders(folder: &Path, most: usize) -> Vec<PathBuf> {
    let entries = list(folder).unwrap_or_default();
    let shown = entries.into_iter().filter(|(name, is_folder)| *is_folder && !name.starts_with('.'));
    shown.take(most).map(|(name, _)| folder.join(name)).collect()
}

/// Entries of a folder whose names are not UTF-8, sorted, and whether each is a folder itself.
pub(crate) fn not_utf8(folder: &Path) -> Result<Vec<(PathBuf, bool)>, SceneError> {
    let others = entries(folder)?.into_iter().filter(|(name, _)| name.to_str().is_none());
    Ok(others.map(|(name, kind)| (folder.join(name), kind == Kind::Folder)).collect())
}

/// Entries of a folder that are not folders themselves, sorted, with links that lead nowhere.
pub(crate) fn files_in(folder: &Path) -> Result<Vec<PathBuf>, SceneError> {
    let files = entries(folder)?.into_iter().filter(|(_, kind)| *kind != Kind::Folder);
    Ok(files.map(|(name, _)| folder.join(name)).collect())
}

/// What an entry of a folder is, or the link leads to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    File,
    Folder,
    /// A link whose target does not exist or cannot be reached.
    Dangling,
}

impl Kind {
    /// Only links are looked at: a folder can have 100 000 files.
    fn of(kind: fs::FileType, path: impl FnOnce() -> PathBuf) -> Self {
        let is_folder = if kind.is_symlink() {
            let Ok(target) = fs::metadata(path()) else { return Self::Dangling };
            target.is_dir()
        } else {
            kind.is_dir()
        };
        if is_folder { Self::Folder } else { Self::File }
    }
}

fn entries(folder: &Path) -> Result<Vec<(OsString, Kind)>, SceneError> {
    let action = "listing a folder";
    let mut entries = Vec::new();
    for entry in fs::read_dir(folder).map_err(SceneError::io(action, folder))? {
        let entry = entry.map_err(SceneError::io(action, folder))?;
        let kind = entry.file_type().map_err(SceneError::io(action, folder))?;
        entries.push((entry.file_name(), Kind::of(kind, || entry.path())));
    }
    entries.sort_unstable();
    Ok(entries)
}

/// The last component of a path; paths such as `.` are resolved first.
pub(crate) fn last_name(path: &Path) -> String {
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    name(path).or_else(|| name(&path.canonicalize().ok()?)).unwrap_or_else(|| "scene".to_owned())
}

/// How the names of instant-ngp's masks start, which are next to images.
pub(crate) const DYNAMIC_MASK: &str = "dynamic_mask_";

/// The image files of one folder, by stem.
#[derive(Debug)]
pub(crate) struct ImageListing {
    folder: PathBuf,
    names_by_stem: BTreeMap<String, Vec<String>>,
    /// Whether any image is of a format that is decoded.
    has_decoded: bool,
}

impl ImageListing {
    /// Lists `folder`; `None` if it is not a folder. Links without a target, which git-annex, DVC and caches leave for images
    /// that were not fetched, are not images.
    pub(crate) fn read(folder: &Path) -> Result<Option<Self>, SceneError> {
        if !folder.is_dir() {
            return Ok(None);
        }
        let mut names_by_stem: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (name, kind) in entries(folder)? {
            let Ok(name) = name.into_string() else { continue };
            if let (Kind::File, Some((stem, _))) = (kind, split_image_name(&name)) {
                names_by_stem.entry(stem.to_owned()).or_default().push(name);
            }
        }
        for names in names_by_stem.values_mut() {
            names.sort_by_key(|name| split_image_name(name).map(|(_, preference)| preference));
        }
        let has_decoded = names_by_stem.values().flatten().any(|name| is_image_name(name));
        Ok(Some(Self { folder: folder.to_owned(), names_by_stem, has_decoded }))
    }

    /// The listing of a folder without images, which need not exist.
    pub(crate) const fn empty(folder: PathBuf) -> Self {
        Self { folder, names_by_stem: BTreeMap::new(), has_decoded: false }
    }

    /// The folder that was listed.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Stems of all images, sorted. Next to images that are decoded, others may be depth maps, and do not count.
    pub(crate) fn stems(&self) -> impl Iterator<Item = &str> {
        let counts = |names: &[String]| !self.has_decoded || names.iter().any(|name| is_image_name(name));
        self.names_by_stem.iter().filter(move |(_, names)| counts(names)).map(|(stem, _)| stem.as_str())
    }

    /// The image with the file name `name`.
    pub(crate) fn by_name(&self, name: &str) -> Option<PathBuf> {
        let (stem, _) = split_image_name(name)?;
        self.names_by_stem.get(stem)?.iter().find(|found| *found == name).map(|found| self.folder.join(found))
    }

    /// The image whose file name without extension is `stem`.
    pub(crate) fn by_stem(&self, stem: &str) -> Option<PathBuf> {
        self.names_by_stem.get(stem)?.first().map(|name| self.folder.join(name))
    }

    /// The file names of the images whose name without extension is `stem`: those of the formats that are decoded, or all if there
    /// is none.
    pub(crate) fn names(&self, stem: &str) -> Vec<&str> {
        let names = self.names_by_stem.get(stem).map(Vec::as_slice).unwrap_or_default();
        let has_decoded = names.iter().any(|name| is_image_name(name));
        names.iter().map(String::as_str).filter(|name| !has_decoded || is_image_name(name)).collect()
    }

    /// [`Self::by_stem`] of the formats that are decoded.
    pub(crate) fn read_by_stem(&self, stem: &str) -> Option<PathBuf> {
        let first = self.names_by_stem.get(stem)?.first().filter(|name| is_image_name(name))?;
        Some(self.folder.join(first))
    }

    /// Which of several images [`Self::by_stem`] takes; `None` if there is one, or none, or one that is decoded.
    pub(crate) fn ambiguity_of_stem(&self, stem: &str) -> Option<String> {
        let (first, others) = self.names_by_stem.get(stem)?.split_first()?;
        let others: Vec<&str> =
            others.iter().map(String::as_str).filter(|other| !is_image_name(first) || is_image_name(other)).collect();
        (!others.is_empty()).then(|| format!("{first} is used, not {}", others.join(", ")))
    }

    /// The expected path of a missing image: its extension is that of the folder's first image.
    pub(crate) fn expected(&self, stem: &str) -> PathBuf {
        let first = self.names_by_stem.values().flatten().next();
        let extension = first.and_then(|name| name.rsplit_once('.')).map_or("jpg", |(_, extension)| extension);
        self.folder.join(format!("{stem}.{extension}"))
    }
}

pub(crate) fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found == extension)
}

/// Whether a file name is that of an image in a format that is decoded, by its extension.
pub fn is_image_name(name: &str) -> bool {
    split_image_name(name).is_some_and(|(_, rank)| rank < FIRST_UNREAD)
}

/// Stem and rank of the extension; `None` if the name is not an image's.
pub(crate) fn split_image_name(name: &str) -> Option<(&str, usize)> {
    let (stem, extension) = name.rsplit_once('.')?;
    let rank = IMAGE_EXTENSIONS.iter().position(|known| known.eq_ignore_ascii_case(extension))?;
    (!stem.is_empty()).then_some((stem, rank))
}

/// The components of a path inside a dataset, relative to the scene's folder: `.` and inner `..` are resolved,
/// backslashes are separators, as Windows tools write them. `None` if the path leaves the folder, or is absolute and not
/// below it: a dataset must not refer to the rest of the disk.
pub(crate) fn inside<'a>(root: &Path, listed: &'a str) -> Option<Vec<&'a str>> {
    let is_drive = |part: &str| part.len() == 2 && part.ends_with(':');
    let mut parts = Vec::new();
    for part in listed.split(['/', '\\']) {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            _ => parts.push(part),
        }
    }
    let is_absolute = listed.starts_with(['/', '\\']);
    if is_absolute {
        // The root may be written with `..` or lead through links, which the listed path does not.
        let roots = [std::path::absolute(root).ok(), root.canonicalize().ok()];
        parts = roots.iter().flatten().find_map(|root| {
            let mut root = root.to_str()?.split(['/', '\\']).filter(|part| !matches!(*part, "" | "."));
            let mut below = parts.iter().copied();
            root.all(|part| below.next() == Some(part)).then(|| below.collect())
        })?;
    }
    let leaves = parts.first().is_none_or(|first| is_drive(first));
    (!leaves).then_some(parts)
}

#[cfg(test)]
mod tests {
    use atsplat_files::is_plain_name;

    use super::*;

    #[test]
    fn paths_stay_inside_the_scene() {
        let root = Path::new("/data/scene");
        for (listed, expected) in [
            ("images/a.png", Some(vec!["images", "a.png"])),
            ("./train/r_0", Some(vec!["train", "r_0"])),
            ("images//./b/../a.png", Some(vec!["images", "a.png"])),
            (r"images\a.png", Some(vec!["images", "a.png"])),
            ("/data/scene/images/a.png", Some(vec!["images", "a.png"])),
            ("../../etc/passwd", None),
            ("images/../../other/a.png", None),
            ("images/../../scene/a.png", None),
            ("/etc/passwd", None),
            ("/data/scene2/a.png", None),
            ("/data/scene/../other/a.png", None),
            (r"..\..\a.png", None),
            (r"C:\windows\a.png", None),
            ("", None),
            (".", None),
            ("/", None),
        ] {
            assert_eq!(inside(root, listed), expected, "{listed:?}");
        }
    }

    /// However the folder is written, an absolute path below it stays inside.
    #[test]
    fn absolute_paths_are_inside_of_a_root_with_dots_or_links() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        fs::create_dir_all(root.join("scene/other")).unwrap();
        let listed = root.join("scene/images/a.png").to_str().unwrap().to_owned();
        let mut roots = vec![root.join("scene"), root.join("scene/other/.."), root.join("./scene/../scene")];
        if cfg!(unix) {
            #[cfg(unix)]
            std::os::unix::fs::symlink(root.join("scene"), root.join("link")).unwrap();
            roots.push(root.join("link"));
        }
        for written in roots {
            assert_eq!(inside(&written, &listed), Some(vec!["images", "a.png"]), "{}", written.display());
        }
        assert_eq!(inside(&root.join("scene/other"), &listed), None);
    }

    #[test]
    fn names_that_leave_the_folder_are_not_plain() {
        assert!(["000c3ab189999a83", "clip.1", "..a", "scène 1"].into_iter().all(is_plain_name));
        for name in ["", ".", "..", "../a", "a/b", "/a", r"..\a", "C:", "a\0"] {
            assert!(!is_plain_name(name), "{name:?}");
        }
    }

    #[test]
    fn jpeg_is_preferred_among_files_with_one_stem() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["1.png", "1.JPG", "2.png", "notes.txt", ".png"] {
            fs::write(folder.path().join(name), b"").unwrap();
        }
        fs::create_dir(folder.path().join("3.png")).unwrap();
        let listing = ImageListing::read(folder.path()).unwrap().unwrap();
        assert_eq!(listing.by_stem("1"), Some(folder.path().join("1.JPG")));
        assert_eq!(listing.by_name("1.png"), Some(folder.path().join("1.png")));
        assert_eq!(listing.by_stem("3"), None, "a folder is not an image");
        assert_eq!(listing.stems().collect::<Vec<_>>(), ["1", "2"]);
        assert_eq!(listing.ambiguity_of_stem("1").as_deref(), Some("1.JPG is used, not 1.png"));
        assert_eq!(["2", "3"].map(|stem| listing.ambiguity_of_stem(stem)), [None, None]);
    }

    /// Depth maps in TIFF or a preview are not frames; a clip of TIFFs is one.
    #[test]
    fn formats_that_are_not_decoded_come_last() {
        let listing = |names: &[&str]| {
            let folder = tempfile::tempdir().unwrap();
            for name in names {
                fs::write(folder.path().join(name), b"").unwrap();
            }
            let listing = ImageListing::read(folder.path()).unwrap().unwrap();
            (folder, listing)
        };
        let (folder, mixed) = listing(&["1.TIF", "1.webp", "2.bmp", "depth_1.tif", "notes.txt"]);
        assert_eq!(mixed.stems().collect::<Vec<_>>(), ["1"]);
        assert_eq!((mixed.names("1"), mixed.names("2"), mixed.names("3")), (vec!["1.webp"], vec!["2.bmp"], vec![]));
        assert_eq!(mixed.by_stem("1"), Some(folder.path().join("1.webp")));
        assert_eq!(mixed.by_name("1.TIF"), Some(folder.path().join("1.TIF")));
        assert_eq!((mixed.read_by_stem("2"), mixed.ambiguity_of_stem("1")), (None, None));
        let (_, unread) = listing(&["1.gif", "1.tif", "2.heic"]);
        assert_eq!(unread.stems().collect::<Vec<_>>(), ["1", "2"]);
        assert_eq!(unread.ambiguity_of_stem("1").as_deref(), Some("1.tif is used, not 1.gif"));
    }

    #[cfg(unix)]
    #[test]
    fn a_link_without_a_target_is_not_an_image() {
        use std::os::unix::fs::symlink;

        let folder = tempfile::tempdir().unwrap();
        let below = |name: &str| folder.path().join(name);
        fs::write(below("1.png"), b"").unwrap();
        fs::create_dir(below("folder")).unwrap();
        symlink("1.png", below("2.png")).unwrap();
        symlink("annex/objects/3.png", below("3.png")).unwrap();
        symlink("folder", below("4.png")).unwrap();
        symlink("5.png", below("5.png")).unwrap();
        let listing = ImageListing::read(folder.path()).unwrap().unwrap();
        assert_eq!(listing.stems().collect::<Vec<_>>(), ["1", "2"]);
        let folders: Vec<String> = list(folder.path())
            .unwrap()
            .into_iter()
            .filter_map(|(name, is_folder)| is_folder.then_some(name))
            .collect();
        assert_eq!(folders, ["4.png", "folder"], "links to folders are followed");
    }

    #[test]
    fn a_git_lfs_pointer_error_names_the_remedy() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("transforms.json");
        fs::write(&path, "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n").unwrap();
        for error in [read_file("reading", &path).unwrap_err(), read_start("reading", &path, 1 << 16).unwrap_err()] {
            assert!(matches!(error, SceneError::LfsPointer { .. }), "{error}");
            let message = error.to_string();
            assert!(message.contains("git lfs pull") && message.contains("transforms.json"), "{message}");
        }
    }

    #[test]
    fn folders_and_devices_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(read_file("reading", folder.path()), Err(SceneError::Io(_))));
        assert!(matches!(read_file("reading", Path::new("/dev/zero")), Err(SceneError::Io(_))));
    }
}
