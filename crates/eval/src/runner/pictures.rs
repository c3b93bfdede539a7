use std::fs;
use std::path::{Path, PathBuf};

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

/// Stores a render, rounded to 8 bits; a render with non-finite samples is not stored.
pub(super) fn write_render(store: &Path, key: &TrialKey, frame: u64, render: &Image) -> Result<(), EvalError> {
    match render.to_u8(Rounding::Nearest) {
        Ok(picture) => write_picture(store, key, frame, &picture),
        Err(_non_finite) => Ok(()),
    }
}

/// Stores an 8-bit picture.
pub(super) fn write_picture(store: &Path, key: &TrialKey, frame: u64, picture: &ImageU8) -> Result<(), EvalError> {
    let path = picture_path(store, key, frame);
    let folder = path.parent().unwrap_or(store);
    fs::create_dir_all(folder).map_err(EvalError::io("creating a folder for pictures", folder))?;
    let png = encode_png(picture);
    let png = png.map_err(|error| EvalError::malformed(&path, "picture", "one that PNG can store", error))?;
    disk::write_unsynced(&path, &png)
}
