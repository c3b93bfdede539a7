use std::collections::BTreeSet;
use std::path::PathBuf;

use atsplat_files::Sha256Digest;
use atsplat_protocol::IndexFile;
use atsplat_scene::nerfstudio::SUBSET_PREFIX;
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
    /// Names of the scenes of the index as by [`scene_name`], those without an entry included.
    pub(super) fn names(&self) -> Result<BTreeSet<String>, TrainError> {
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
        Ok(file.index.scenes.keys().map(|key| scene_name(key).to_owned()).collect())
    }
}

/// A scene's key without the prefix that DepthSplat's training set of DL3DV has and its evaluation indices do not
/// (depthsplat `src/scripts/convert_dl3dv_train.py`).
pub(super) fn scene_name(key: &str) -> &str {
    key.strip_prefix(SUBSET_PREFIX).unwrap_or(key)
}
