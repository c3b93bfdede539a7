use std::fs;
use std::path::{Path, PathBuf};

use atsplat_pixels::{Image, ImageU8, Rounding, encode_png};

use super::worst::WorstSoFar;
use crate::file_name::file_name;
use crate::store::disk;
use crate::{EvalError, TargetRow, TrialKey};

/// The method under whose name true pictures are kept.
pub const TRUTH: &str = "truth";
/// The method under whose name context pictures are kept.
pub(super) const CONTEXT: &str = "context";

/// Which pictures a store keeps beside its rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum KeepPictures {
    /// None.
    #[default]
    Nothing,
    /// Those of the ten trials of each method with the lowest mean PSNR.
    Worst,
    /// All.
    All,
}

/// Where a store keeps a picture: `pictures/<preset>/<method>/<scene>-<entry>/<frame>.png`. Truths are under the method
/// `truth`, context views under `context`. Names that no file may have, or that only capitals tell apart, are changed, so
/// that no two keys share a path.
pub fn picture_path(store: &Path, key: &TrialKey, frame: u64) -> PathBuf {
    folder(store, key).join(format!("{frame:06}.png"))
}

/// Where the pictures of a trial are.
pub(super) fn folder(store: &Path, key: &TrialKey) -> PathBuf {
    folder_of_method(store, &key.preset, &key.method).join(format!("{}-{}", file_name(&key.scene), key.entry))
}

/// Where the pictures of a method's trials are.
pub(super) fn folder_of_method(store: &Path, preset: &str, method: &str) -> PathBuf {
    store.join("pictures").join(file_name(preset)).join(file_name(method))
}

/// [`KeepPictures`], with what deciding takes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Keeping<'a> {
    Nothing,
    Worst(&'a Path, &'a WorstSoFar),
    All(&'a Path),
}

impl<'a> Keeping<'a> {
    /// The store, if all pictures are kept in it.
    pub(super) const fn all(self) -> Option<&'a Path> {
        match self {
            Self::All(store) => Some(store),
            Self::Nothing | Self::Worst(..) => None,
        }
    }

    /// The store, if a trial's pictures are to be kept in it now that its rows are known.
    pub(super) fn worst(self, key: &TrialKey, rows: &[TargetRow]) -> Option<&'a Path> {
        match self {
            Self::Worst(store, worst) if worst.admits(key, rows) => Some(store),
            Self::Nothing | Self::Worst(..) | Self::All(_) => None,
        }
    }
}

/// Keeps a render, rounded to 8 bits; nothing where it has samples that no byte stands for.
pub(super) fn keep(store: &Path, key: &TrialKey, frame: u64, render: &Image) -> Result<(), EvalError> {
    match render.to_u8(Rounding::Nearest) {
        Ok(picture) => keep_bytes(store, key, frame, &picture),
        Err(_non_finite) => Ok(()),
    }
}

/// Keeps a true or a context picture.
pub(super) fn keep_bytes(store: &Path, key: &TrialKey, frame: u64, picture: &ImageU8) -> Result<(), EvalError> {
    let path = picture_path(store, key, frame);
    let folder = path.parent().unwrap_or(store);
    fs::create_dir_all(folder).map_err(EvalError::io("making a folder for pictures", folder))?;
    let png = encode_png(picture);
    let png = png.map_err(|error| EvalError::malformed(&path, "picture", "one that PNG holds", error))?;
    disk::write_unsynced(&path, &png)
}

/// The key of what several methods have in common.
pub(super) fn common(key: &TrialKey, method: &str) -> TrialKey {
    TrialKey { method: method.to_owned(), ..key.clone() }
}
