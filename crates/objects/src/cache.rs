//! The folder of copies. It may be removed whenever nothing reads it.
//!
//! | path | content |
//! |---|---|
//! | `blobs/<xx>/<hash>` | the content of an object, by its URL, size and tag: one that changes gets another file |
//! | `trees/<hash>/<name>/…` | what one list showed below a URL: links to blobs, and empty files for what was not fetched |
//! | `stores/` | results that a process is writing |

use std::borrow::Cow;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use atsplat_files::{FileError, Sha256Digest, is_plain_name};
use percent_encoding::percent_decode_str;

use crate::ObjectError;
use crate::storage::Object;

#[derive(Clone, Debug)]
pub(crate) struct Cache {
    root: PathBuf,
}

impl Cache {
    /// The cache in a folder; by default `atsplat/objects` in the user's folder for caches.
    pub(crate) fn new(folder: Option<&Path>) -> Result<Self, ObjectError> {
        let folder =
            folder.map(Path::to_owned).or_else(|| atsplat_files::cache_folder().map(|caches| caches.join("objects")));
        let none =
            || io::Error::new(io::ErrorKind::NotFound, "expected --cache DIR or the variable HOME, found neither");
        let folder =
            folder.ok_or_else(none).map_err(FileError::during::<ObjectError>("choosing a folder for copies", ""))?;
        let root = std::path::absolute(&folder);
        Ok(Self { root: root.map_err(FileError::during::<ObjectError>("choosing a folder for copies", folder))? })
    }

    pub(crate) fn blob(&self, url: &str, object: &Object) -> PathBuf {
        let hash = Sha256Digest::of(identity(url, object).as_bytes()).to_string();
        let (start, _) = hash.split_at(2);
        self.root.join("blobs").join(start).join(&hash)
    }

    /// The file or folder that stands for a URL, of which these objects were listed.
    pub(crate) fn tree<'a>(&self, url: &str, objects: impl Iterator<Item = &'a Object>) -> PathBuf {
        let text: String = std::iter::once(url.to_owned()).chain(objects.map(|object| identity(url, object))).collect();
        let hash = Sha256Digest::of(text.as_bytes()).to_string();
        let (start, _) = hash.split_at(32);
        // Datasets are named after their folder.
        let name = url.rsplit('/').next().and_then(decoded).filter(|name| is_plain_name(name));
        self.root.join("trees").join(start).join(name.as_deref().unwrap_or("root"))
    }

    pub(crate) fn stores(&self) -> PathBuf {
        self.root.join("stores")
    }
}

/// The name that a part of a URL stands for: `desk#1` for `desk%231`. `None` if it is not text.
fn decoded(part: &str) -> Option<Cow<'_, str>> {
    percent_decode_str(part).decode_utf8().ok()
}

fn identity(url: &str, Object { name, bytes, tag }: &Object) -> String {
    format!("{url}/{name}\n{bytes} {tag}\n")
}

/// Puts a blob into a tree, in place of the empty file.
pub(crate) fn link(blob: &Path, file: &Path) -> Result<(), ObjectError> {
    let linked = || -> io::Result<()> {
        // A name that nobody else uses: a copy over another link to the blob would empty the blob first.
        let folder = tempfile::tempdir_in(file.parent().unwrap_or(file))?;
        let temporary = folder.path().join("content");
        if fs::hard_link(blob, &temporary).is_err() {
            // Not every file system has links, and none has any number of them.
            fs::copy(blob, &temporary)?;
        }
        // Renaming between links to one file does nothing; what is left is removed with its folder.
        fs::rename(&temporary, file)
    };
    linked().map_err(FileError::during("placing a copy of an object", file))
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn other_urls_sizes_and_tags_are_other_blobs() {
        let cache = Cache::new(Some(Path::new("cache"))).unwrap();
        let object = Object { name: "a".to_owned(), bytes: 7, tag: "t".to_owned() };
        let first = cache.blob("s3://b", &object);
        assert!(first.is_absolute());
        assert_ne!(cache.blob("s3://c", &object), first);
        assert_ne!(cache.blob("s3://b", &Object { bytes: 8, ..object.clone() }), first);
        assert_ne!(cache.blob("s3://b", &Object { tag: "u".to_owned(), ..object.clone() }), first);
        assert_eq!(cache.blob("s3://b", &object), first);
        let tree = |objects: &[Object]| cache.tree("s3://b/data", objects.iter());
        assert!(tree(&[]).ends_with("data"));
        assert_ne!(tree(&[object]), tree(&[]));
    }

    /// Scenes are named after their folder.
    #[test]
    fn a_folder_has_the_name_that_its_url_stands_for() {
        let cache = Cache::new(Some(Path::new("cache"))).unwrap();
        let name = |url: &str| atsplat_files::name_of(&cache.tree(url, std::iter::empty()));
        for (part, expected) in [
            ("desk%231", "desk#1"),
            ("caf%C3%A9%3f", "café?"),
            ("50%", "50%"),
            ("%+1%zz", "%+1%zz"),
            ("a%2F..", "root"),
            ("%2e%2E", "root"),
            ("%ff", "root"),
        ] {
            assert_eq!(name(&format!("s3://lab/{part}")), expected, "{part}");
        }
    }

    #[test]
    fn a_link_replaces_the_empty_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let [blob, file] = ["blob", "file"].map(|name| folder.path().join(name));
        fs::write(&blob, "content").unwrap();
        fs::write(&file, "").unwrap();
        for _ in 0..2 {
            link(&blob, &file).unwrap();
            assert_eq!(fs::read(&file).unwrap(), b"content");
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        }
    }

    /// Two mirrors of one URL in a process, for example.
    #[test]
    fn links_that_are_made_at_once_leave_the_content() {
        let folder = tempfile::tempdir().unwrap();
        let [blob, file] = ["blob", "file"].map(|name| folder.path().join(name));
        fs::write(&blob, "content").unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        link(&blob, &file).unwrap();
                    }
                });
            }
        });
        assert_eq!([&blob, &file].map(|path| fs::read_to_string(path).unwrap()), ["content"; 2]);
    }
}
