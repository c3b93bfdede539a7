use std::collections::BTreeSet;
use std::path::PathBuf;

use atsplat_files::Sha256Digest;
use atsplat_protocol::IndexFile;
use serde::{Deserialize, Serialize};

use crate::TrainError;

/// An evaluation index whose scenes training must not see. The file is known by its hash, so that another one of the same
/// name cannot let test scenes in.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct ExcludedScenes {
    /// The index file (JSON).
    pub index: PathBuf,
    /// SHA-256 of its bytes.
    pub sha256: Sha256Digest,
}

impl ExcludedScenes {
    /// Adds the keys of the index, scenes without an entry included.
    pub(super) fn add_to(&self, keys: &mut BTreeSet<String>) -> Result<(), TrainError> {
        let file = IndexFile::read(&self.index)?;
        if file.sha256 != self.sha256 {
            let place = self.index.display().to_string();
            return Err(TrainError::malformed(
                "index of excluded scenes",
                place,
                format!("sha256 {}", self.sha256),
                file.sha256,
            ));
        }
        keys.extend(file.index.scenes.into_keys());
        Ok(())
    }
}
