//! Weights that travel in the binary: `eval/checkpoints/` says how each was trained.

use std::path::{Path, PathBuf};

use atsplat_model::ModelError;
use atsplat_model::weights::TensorFile;
use atsplat_scene::SharedBytes;

/// Trained on simulated rooms; what `reproduce` runs where nobody names weights.
pub(crate) const MICRO_ROOMS: &str = "micro-rooms";

const FILES: [(&str, &[u8]); 1] = [(MICRO_ROOMS, include_bytes!("../../../eval/checkpoints/micro-rooms.safetensors"))];

/// The weights of a name; `None` where it is no name of any.
pub(crate) fn carried(name: &str) -> Option<Result<TensorFile, ModelError>> {
    let (name, bytes) = FILES.into_iter().find(|(known, _)| *known == name)?;
    Some(TensorFile::parse(PathBuf::from(name), SharedBytes::new(bytes.to_vec())))
}

/// As [`TensorFile::find`]; a name of carried weights stands for these, unless a file has that name.
pub(crate) fn find(path: &Path, expected: impl FnOnce() -> String) -> Result<TensorFile, ModelError> {
    let named = if path.exists() { None } else { path.to_str().and_then(carried) };
    named.unwrap_or_else(|| TensorFile::find(path, expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_model::weights::ModelWeights;

    #[test]
    fn every_carried_file_is_whole_and_of_the_network_that_it_names() {
        for (name, _) in FILES {
            let weights = ModelWeights::of_file(&carried(name).unwrap().unwrap()).unwrap();
            assert_eq!(weights.config.name, name);
            for key in ["title", "data", "steps", "seed"] {
                assert!(weights.provenance.contains_key(key), "{key}: {:?}", weights.provenance);
            }
        }
        assert!(carried("micro-gardens").is_none());
    }

    #[test]
    fn a_name_stands_for_what_is_carried_and_a_path_does_not() {
        let found = find(Path::new(MICRO_ROOMS), String::new).unwrap();
        assert_eq!(found.sha256, carried(MICRO_ROOMS).unwrap().unwrap().sha256);
        assert!(matches!(find(Path::new("./micro-rooms"), String::new), Err(ModelError::MissingWeights { .. })));
    }
}
