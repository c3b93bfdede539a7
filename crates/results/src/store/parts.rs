//! One file per finished trial, until they are compacted into tables.

use std::path::{Path, PathBuf};

use atsplat_files::hexadecimal;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::disk;
use crate::{ResultsError, TargetRow, TrialKey, TrialRow};

/// Folder of a store.
const FOLDER: &str = "parts";

/// What a part is expected to be. A file that was cut short by something else than atsplat, which writes it whole, is no loss.
const EXPECTED: &str = "the rows of a trial (remove this file, and run again: only this trial is computed again)";

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Part {
    pub(super) trial: TrialRow,
    pub(super) targets: Vec<TargetRow>,
}

#[derive(Serialize)]
struct PartView<'a> {
    trial: &'a TrialRow,
    targets: &'a [TargetRow],
}

pub(super) fn folder(store: &Path) -> PathBuf {
    store.join(FOLDER)
}

/// The file of a trial.
pub(super) fn path(store: &Path, key: &TrialKey) -> PathBuf {
    folder(store).join(name(key))
}

/// Writes a trial, replacing an earlier one of the same key.
pub(super) fn write(store: &Path, trial: &TrialRow, targets: &[TargetRow]) -> Result<(), ResultsError> {
    let path = path(store, &trial.key);
    let bytes = serde_json::to_vec(&PartView { trial, targets });
    let bytes =
        bytes.map_err(|error| ResultsError::malformed(&path, "trial", "rows that JSON can represent", error))?;
    disk::write(&path, &bytes)
}

/// Parts with their files, and the files that a crash left unfinished.
type Parts = (Vec<(PathBuf, Part)>, Vec<PathBuf>);

/// Reads every part.
pub(super) fn read(store: &Path) -> Result<Parts, ResultsError> {
    let (mut parts, mut unfinished) = (Vec::new(), Vec::new());
    for path in disk::files(&folder(store))? {
        match path.extension().and_then(|extension| extension.to_str()) {
            Some("json") => {
                // A part that was removed after the folder was listed is in the tables by now.
                let Some(bytes) = disk::read(&path)? else { continue };
                let part: Part = serde_json::from_slice(&bytes)
                    .map_err(|error| ResultsError::malformed(&path, "file", EXPECTED, error))?;
                let expected = name(&part.trial.key);
                if path.file_name().is_none_or(|found| *found != *expected) {
                    let expected = format!("{expected}, which the trial's key gives");
                    return Err(ResultsError::malformed(
                        &path,
                        "file name",
                        expected,
                        "another: a copy, or an edited key",
                    ));
                }
                parts.push((path, part));
            }
            Some(atsplat_files::PARTIAL) => unfinished.push(path),
            _ => {}
        }
    }
    Ok((parts, unfinished))
}

#[expect(clippy::expect_used, reason = "SHA-256 has 64 hexadecimal digits")]
fn name(key: &TrialKey) -> String {
    let mut hash = Sha256::new();
    for text in [&key.preset, &key.method, &key.scene] {
        hash.update((text.len() as u64).to_le_bytes());
        hash.update(text);
    }
    hash.update(key.entry.to_le_bytes());
    let digest = hexadecimal(&hash.finalize());
    format!("{}.json", digest.get(..32).expect("64 digits"))
}
