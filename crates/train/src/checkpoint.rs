//! Checkpoints: safetensors files with everything that a run needs to resume as if uninterrupted.

mod file;
mod settings;
mod state;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_files::entries_if_exists;
use atsplat_model::weights::{StoredTensors, TensorError, TensorFile};

pub use file::CheckpointFile;
use settings::check_settings;
pub(crate) use settings::{ChangedSettings, MovedData};
pub use state::{InitialWeights, State};
use state::{ReadBackbone, WHAT, check_digests};

use crate::parameters::Parameters;
use crate::{Resolved, TrainConfig, TrainError};

/// Folder of the checkpoints in a run's folder.
const FOLDER: &str = "checkpoints";

/// The checkpoint folder of a run.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    folder: PathBuf,
    keep: usize,
    resolved: Resolved,
}

/// A checkpoint from which a run can go on.
#[derive(Debug)]
pub(crate) struct Found {
    /// Its state.
    pub(crate) state: State,
    /// A message for each newer checkpoint, all of which are damaged.
    pub(crate) skipped: Vec<String>,
    /// Settings that have changed since, without changing the run.
    pub(crate) changed: Option<ChangedSettings>,
}

impl Checkpoints {
    /// The checkpoint folder in a run's folder, which the first checkpoint creates; the run's configuration resolves to
    /// `resolved`.
    pub fn new(folder: &Path, keep: usize, resolved: Resolved) -> Self {
        Self { folder: Self::folder_in(folder), keep, resolved }
    }

    /// The checkpoint folder in a run's folder.
    pub(crate) fn folder_in(folder: &Path) -> PathBuf {
        folder.join(FOLDER)
    }

    /// What the run's configuration resolves to.
    pub(crate) const fn resolved(&self) -> &Resolved {
        &self.resolved
    }

    /// Whether a run's folder contains a checkpoint, readable or not.
    ///
    /// # Errors
    /// [`TrainError::Io`] if the checkpoints cannot be listed.
    pub(crate) fn exist_in(folder: &Path) -> Result<bool, TrainError> {
        Ok(!all_in(&folder.join(FOLDER))?.is_empty())
    }

    /// Writes a checkpoint atomically, and removes the oldest ones beyond the number to keep, and those of later steps: they could
    /// not be read when the run went on from an earlier one.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if a weight is NaN or infinite: such a state is not written; [`TrainError::Model`] if the
    /// file cannot be written; [`TrainError::Io`].
    pub fn write(&self, state: &State, config: &TrainConfig) -> Result<PathBuf, TrainError> {
        if let Some((name, count)) = state.parameters.non_finite().into_iter().next() {
            let found = format!("{count} values that are NaN or infinite");
            return Err(TrainError::malformed(WHAT, name, "finite weights", found));
        }
        std::fs::create_dir_all(&self.folder).map_err(TrainError::io("creating a folder", &self.folder))?;
        let path = self.folder.join(format!("step-{:08}.safetensors", state.step));
        state.stored(config, &self.resolved)?.write(&path)?;
        let mut all = self.all()?;
        let later = all.split_off(&(state.step + 1));
        let beyond = all.len().saturating_sub(self.keep.max(1));
        for old in all.into_values().take(beyond).chain(later.into_values()) {
            std::fs::remove_file(&old).map_err(TrainError::io("removing an old checkpoint", old))?;
        }
        Ok(path)
    }

    /// The newest state whose file is not damaged; `None` if there is no checkpoint. Trained parameters are those that `fresh` has, and
    /// frozen weights that a checkpoint does not contain are those of `backbone`.
    ///
    /// # Errors
    /// [`TrainError`] of the newest checkpoint if all are damaged; of the newest intact one if the run cannot go on from it, because
    /// the next checkpoint after an older one would remove it; [`TrainError::Tensors`] if a file cannot be read.
    pub(crate) fn read(
        &self,
        config: &TrainConfig,
        fresh: &Parameters,
        backbone: ReadBackbone<'_>,
    ) -> Result<Option<Found>, TrainError> {
        let (mut skipped, mut first) = (Vec::new(), None);
        for path in self.all()?.into_values().rev() {
            let stored = match intact(&path)? {
                Ok(stored) => stored,
                Err(damage) => {
                    skipped.push(damage.to_string());
                    first.get_or_insert(damage);
                    continue;
                }
            };
            self.resolved.check(&stored).map_err(|error| {
                // A changed setting says more than the hash that it changes.
                let settings = check_settings(&stored, config).err();
                settings.map_or(error, |settings| settings.in_file(&path))
            })?;
            let state = State::from_stored(&stored, config, fresh, backbone);
            let (state, changed) = state.map_err(|error| error.in_file(&path))?;
            return Ok(Some(Found { state, skipped, changed }));
        }
        first.map_or(Ok(None), Err)
    }

    /// Number of steps before the last checkpoint, readable or not.
    pub(crate) fn last(&self) -> Result<Option<u64>, TrainError> {
        Ok(self.all()?.into_keys().next_back())
    }

    /// All checkpoints by their steps.
    fn all(&self) -> Result<BTreeMap<u64, PathBuf>, TrainError> {
        all_in(&self.folder)
    }
}

/// What a checkpoint contains, or how it is damaged.
///
/// # Errors
/// [`TrainError::Tensors`] if it cannot be read: it may be intact.
fn intact(path: &Path) -> Result<Result<StoredTensors, TrainError>, TrainError> {
    match TensorFile::open(path) {
        Ok(TensorFile { stored, .. }) => {
            let checked = check_digests(&stored).map_err(|error| error.in_file(path));
            Ok(checked.map(|()| stored))
        }
        Err(damage @ TensorError::InFile { .. }) => Ok(Err(damage.into())),
        Err(error) => Err(error.into()),
    }
}

/// All checkpoints in a folder by their steps; none if it does not exist.
fn all_in(folder: &Path) -> Result<BTreeMap<u64, PathBuf>, TrainError> {
    let paths = entries_if_exists(folder).map_err(TrainError::io("listing checkpoints", folder))?;
    Ok(paths.into_iter().filter_map(|path| Some((step_of(&path)?, path))).collect())
}

/// Number of steps before a checkpoint; `None` for other files.
fn step_of(path: &Path) -> Option<u64> {
    path.file_name()?.to_str()?.strip_prefix("step-")?.strip_suffix(".safetensors")?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::state::with_one_number;
    use super::*;

    #[test]
    fn other_files_in_the_folder_are_not_checkpoints() {
        let folder = tempfile::tempdir().unwrap();
        let checkpoints = Checkpoints::new(folder.path(), 2, Resolved::default());
        assert!(checkpoints.all().unwrap().is_empty() && !checkpoints.folder.exists());
        std::fs::create_dir(&checkpoints.folder).unwrap();
        let files = ["step-00000012.safetensors", "step-00000004.safetensors", "step-notes.txt", "step-a.safetensors"];
        for name in files {
            std::fs::write(checkpoints.folder.join(name), "").unwrap();
        }
        let expected = ["step-00000004.safetensors", "step-00000012.safetensors"];
        let found = checkpoints.all().unwrap().into_values();
        assert_eq!(found.collect::<Vec<_>>(), expected.map(|name| checkpoints.folder.join(name)));
    }

    #[test]
    fn what_was_just_written_is_kept_and_later_steps_are_removed() {
        for (keep, expected) in [(1, vec![600]), (2, vec![500, 600]), (3, vec![400, 500, 600])] {
            let (folder, config) = (tempfile::tempdir().unwrap(), TrainConfig::shortest());
            let checkpoints = Checkpoints::new(folder.path(), keep, Resolved::default());
            for step in [400, 500] {
                checkpoints.write(&with_one_number(step, 1.0), &config).unwrap();
            }
            std::fs::write(checkpoints.folder.join("step-00001000.safetensors"), "damaged").unwrap();
            let written = checkpoints.write(&with_one_number(600, 1.0), &config).unwrap();
            let all = checkpoints.all().unwrap();
            assert_eq!(all.keys().copied().collect::<Vec<_>>(), expected, "{keep} are kept");
            assert_eq!(all.get(&600), Some(&written));
            let backbone = || Ok(with_one_number(0, 1.0).parameters.frozen().clone());
            let found = checkpoints.read(&config, &with_one_number(0, 1.0).parameters, &backbone).unwrap();
            let Found { state, skipped, changed } = found.unwrap();
            assert_eq!((state.step, skipped.len(), changed), (600, 0, None));
        }
    }

    /// A run that went on from the older one would remove the newer one.
    #[test]
    fn only_a_damaged_checkpoint_is_skipped() {
        let (folder, config) = (tempfile::tempdir().unwrap(), TrainConfig::shortest());
        let checkpoints = Checkpoints::new(folder.path(), 2, Resolved::default());
        checkpoints.write(&with_one_number(400, 1.0), &config).unwrap();
        let newer = checkpoints.write(&with_one_number(500, 1.0), &config).unwrap();
        let whole = std::fs::read(&newer).unwrap();
        let read = || {
            let backbone = || Ok(with_one_number(0, 1.0).parameters.frozen().clone());
            let found = checkpoints.read(&config, &with_one_number(0, 1.0).parameters, &backbone);
            found.map(|found| found.map(|found| (found.state.step, found.skipped.len())))
        };
        assert_eq!(read().unwrap(), Some((500, 0)));
        std::fs::write(&newer, &whole[..whole.len() - 1]).unwrap();
        assert_eq!(read().unwrap(), Some((400, 1)), "cut short");
        let mut flipped = whole.clone();
        *flipped.last_mut().unwrap() ^= 1;
        std::fs::write(&newer, flipped).unwrap();
        assert_eq!(read().unwrap(), Some((400, 1)), "another bit");

        let other = TrainConfig { clip: 2.0, ..config.clone() };
        checkpoints.write(&with_one_number(500, 1.0), &other).unwrap();
        let error = read().unwrap_err().to_string();
        assert!(error.contains("step-00000500.safetensors") && error.contains("other settings: clip"), "{error}");
        // For which a folder stands here: what cannot be read may be intact.
        std::fs::remove_file(&newer).unwrap();
        std::fs::create_dir(&newer).unwrap();
        let error = read().unwrap_err();
        assert!(matches!(error, TrainError::Tensors(TensorError::Missing { .. })), "{error}");
        #[cfg(unix)]
        {
            std::fs::remove_dir(&newer).unwrap();
            std::os::unix::fs::symlink(folder.path().join("absent"), &newer).unwrap();
            let error = read().unwrap_err();
            assert!(matches!(error, TrainError::Tensors(TensorError::Io(_))), "{error}");
        }
    }
}
