use std::path::{Path, PathBuf};
use std::{fs, io};

use atsplat_files::PARTIAL;
use atsplat_pixels::{Image, ImageU8, Rounding, encode_png};

use super::worst::WorstSoFar;
use crate::file_name::file_name;
use crate::store::disk;
use crate::{EvalError, TargetRow, TrialKey};

/// The method name under which ground-truth pictures are stored.
pub const TRUTH: &str = "truth";
/// The method name under which context pictures are stored.
pub const CONTEXT: &str = "context";

/// Which pictures a store keeps in addition to its rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KeepPictures {
    /// None.
    #[default]
    Nothing,
    /// Those of each method's six trials with the lowest and two with the highest mean PSNR, and of the two nearest to the median
    /// among eight random ones; also the other methods' pictures of these trials, where they were rendered.
    Worst,
    /// All.
    All,
}

/// Path of a picture in a store: `pictures/<preset>/<method>/<scene>-<entry>/<frame>.png`, with `truth` or `context` in the
/// place of the method for ground-truth and context pictures. Names that are invalid as file names or differ only in case
/// are changed, so that no two keys share a path.
pub fn picture_path(store: &Path, key: &TrialKey, frame: u64) -> PathBuf {
    folder(store, key).join(format!("{frame:06}.png"))
}

/// Folder of a trial's pictures.
pub(super) fn folder(store: &Path, key: &TrialKey) -> PathBuf {
    folder_of_method(store, &key.preset, &key.method).join(format!("{}-{}", file_name(&key.scene), key.entry))
}

/// Folder of a method's pictures.
pub(super) fn folder_of_method(store: &Path, preset: &str, method: &str) -> PathBuf {
    store.join("pictures").join(file_name(preset)).join(file_name(method))
}

/// Decides which pictures are stored, and where.
#[derive(Clone, Copy, Debug)]
pub(super) struct PictureSink<'a> {
    pub(super) keep: KeepPictures,
    pub(super) store: &'a Path,
    pub(super) worst: &'a WorstSoFar,
}

impl<'a> PictureSink<'a> {
    /// The store, if it keeps all pictures.
    pub(super) fn all(self) -> Option<&'a Path> {
        (self.keep == KeepPictures::All).then_some(self.store)
    }

    /// The store, if it keeps the worst trials' pictures and a trial with these rows is among them so far.
    pub(super) fn worst(self, key: &TrialKey, rows: &[TargetRow], psnr: &str) -> Option<&'a Path> {
        (self.keep == KeepPictures::Worst && self.worst.admits(key, rows, psnr)).then_some(self.store)
    }
}

/// Stores a render, rounded to 8 bits, under a temporary name until [`publish`]; a render with non-finite samples is not stored.
pub(super) fn write_render(store: &Path, key: &TrialKey, frame: u64, render: &Image) -> Result<(), EvalError> {
    match render.to_u8(Rounding::Nearest) {
        Ok(picture) => write(&picture_path(store, key, frame).with_extension(format!("png.{PARTIAL}")), &picture),
        Err(_non_finite) => Ok(()),
    }
}

/// Gives the renders of a trial their names, after its rows were stored: a run that is killed before leaves no picture beside the
/// rows of an earlier one.
pub(super) fn publish(store: &Path, key: &TrialKey) -> Result<(), EvalError> {
    for path in disk::files(&folder(store, key))? {
        if path.extension().is_some_and(|extension| extension == PARTIAL) {
            fs::rename(&path, path.with_extension("")).map_err(EvalError::io("storing a picture", &path))?;
        }
    }
    Ok(())
}

/// Removes a trial's pictures, if there are any.
pub(super) fn remove(store: &Path, key: &TrialKey) -> Result<(), EvalError> {
    let folder = folder(store, key);
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(EvalError::io("removing pictures", &folder)(error))
        }
        _ => Ok(()),
    }
}

/// Stores an 8-bit picture.
pub(super) fn write_picture(store: &Path, key: &TrialKey, frame: u64, picture: &ImageU8) -> Result<(), EvalError> {
    write(&picture_path(store, key, frame), picture)
}

fn write(path: &Path, picture: &ImageU8) -> Result<(), EvalError> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(EvalError::io("creating a folder for pictures", folder))?;
    let png = encode_png(picture);
    let png = png.map_err(|error| EvalError::malformed(path, "picture", "one that PNG can store", error))?;
    disk::write_unsynced(path, &png)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample_rows;

    #[test]
    fn a_render_has_its_name_once_the_rows_are_stored() {
        let root = tempfile::tempdir().unwrap();
        let [key, other] = ["x", "y"].map(|scene| sample_rows::key("m", scene, 0));
        let render = |samples: [f32; 3]| Image::new(1, 1, samples.to_vec()).unwrap();
        let path = picture_path(root.path(), &key, 7);
        write_render(root.path(), &key, 7, &render([0.0, 0.5, 1.0])).unwrap();
        write_render(root.path(), &key, 8, &render([f32::NAN; 3])).unwrap();
        assert!(!path.exists());
        publish(root.path(), &other).unwrap();
        assert!(!path.exists(), "another trial's");
        publish(root.path(), &key).unwrap();
        assert_eq!(disk::files(&folder(root.path(), &key)).unwrap(), std::slice::from_ref(&path));
        remove(root.path(), &other).unwrap();
        assert!(path.is_file(), "nothing of the other trial was stored");
        remove(root.path(), &key).unwrap();
        assert!(!folder(root.path(), &key).exists());
    }
}
