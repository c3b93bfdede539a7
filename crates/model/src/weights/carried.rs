//! Weights that travel in the library.

use std::path::{Path, PathBuf};

use atsplat_pickle::SharedBytes;

use super::TensorFile;
use crate::ModelError;

macro_rules! files {
    ($($name:literal),* $(,)?) => {
        &[$(($name, include_bytes!(concat!("../../../../eval/checkpoints/", $name, ".safetensors")))),*]
    };
}

const FILES: &[(&str, &[u8])] = files!["nano-rooms"];

impl TensorFile {
    /// Names of the weights that travel in the library: `eval/checkpoints/` says how each was trained.
    pub fn carried_names() -> impl Iterator<Item = &'static str> {
        FILES.iter().map(|(name, _)| *name)
    }

    /// Weights that travel in the library, by name; `None` for a name that none has.
    ///
    /// # Errors
    /// [`ModelError::InFile`]: never, unless the library was built from a broken file.
    pub fn carried(name: &str) -> Option<Result<Self, ModelError>> {
        let (name, bytes) = FILES.iter().find(|(known, _)| *known == name)?;
        Some(Self::parse(PathBuf::from(name), SharedBytes::new(bytes.to_vec())))
    }

    /// The weights of this name, where no file has it.
    pub(super) fn carried_at(path: &Path) -> Option<Result<Self, ModelError>> {
        if path.exists() { None } else { Self::carried(path.to_str()?) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::ModelWeights;

    #[test]
    fn every_carried_file_is_whole_and_of_the_network_that_it_names() {
        for name in TensorFile::carried_names() {
            let file = TensorFile::carried(name).unwrap().unwrap();
            let weights = ModelWeights::of_file(&file).unwrap();
            assert_eq!(weights.config.name, name);
            assert!(!weights.provenance.is_empty(), "{name} says how it was trained");
        }
        assert!(TensorFile::carried("nano-gardens").is_none());
    }

    #[test]
    fn a_name_stands_for_what_is_carried_unless_a_file_has_it() {
        let missing = || "a file".to_owned();
        let carried = TensorFile::find(Path::new("nano-rooms"), missing).unwrap();
        assert_eq!(carried.sha256, TensorFile::carried("nano-rooms").unwrap().unwrap().sha256);
        assert!(matches!(TensorFile::find(Path::new("./nano-rooms"), missing), Err(ModelError::MissingWeights { .. })));
    }
}
