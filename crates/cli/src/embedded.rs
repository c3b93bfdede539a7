//! Weights embedded in the binary; `eval/checkpoints/` says how each was trained.

use std::path::{Path, PathBuf};

use atsplat_eval::EvalError;
use atsplat_eval::trained::TrainedNetwork;
use atsplat_model::weights::{TensorError, TensorFile};
use atsplat_scene::SharedBytes;

/// Trained on simulated rooms; the default weights of `reproduce`.
pub(crate) const MICRO_ROOMS: &str = "micro-rooms";

const FILES: [(&str, &[u8]); 1] = [(MICRO_ROOMS, include_bytes!("../../../eval/checkpoints/micro-rooms.safetensors"))];

/// The embedded weights of this name; `None` if there are none.
pub(crate) fn embedded(name: &str) -> Option<Result<TensorFile, TensorError>> {
    let (name, bytes) = FILES.into_iter().find(|(own, _)| *own == name)?;
    Some(TensorFile::parse(PathBuf::from(name), SharedBytes::new(bytes.to_vec())))
}

/// The network of a reproduction, with the weights in a file or, by default, the embedded ones.
pub(crate) fn trained(path: Option<&Path>) -> Result<TrainedNetwork, EvalError> {
    let Some(path) = path else {
        #[expect(clippy::expect_used, reason = "the weights are among FILES")]
        let file = embedded(MICRO_ROOMS).expect("embedded weights")?;
        return TrainedNetwork::new(&file, format!("{MICRO_ROOMS}, embedded in the binary"));
    };
    let expected = || "a weights file that `atsplat train` or `atsplat weights import` wrote".to_owned();
    TrainedNetwork::new(&find(path, expected)?, path.display().to_string())
}

/// Like [`trained`]; `path` may also be the name of the embedded weights.
pub(crate) fn named_or_read(path: &Path) -> Result<TrainedNetwork, EvalError> {
    trained(Some(path).filter(|path| *path != Path::new(MICRO_ROOMS) || path.exists()))
}

/// Like [`TensorFile::find`]; `path` may also be the name of embedded weights, unless a file has that name.
pub(crate) fn find(path: &Path, expected: impl FnOnce() -> String) -> Result<TensorFile, TensorError> {
    let named = if path.exists() { None } else { path.to_str().and_then(embedded) };
    named.unwrap_or_else(|| TensorFile::find(path, expected))
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_model::weights::ModelWeights;

    #[test]
    fn every_embedded_file_is_complete_and_names_its_network() {
        for (name, _) in FILES {
            let weights = ModelWeights::of_file(&embedded(name).unwrap().unwrap()).unwrap();
            assert_eq!(weights.config.name, name);
            for key in ["title", "data", "steps", "seed"] {
                assert!(weights.provenance.contains_key(key), "{key}: {:?}", weights.provenance);
            }
        }
        assert!(embedded("micro-gardens").is_none());
    }

    #[test]
    fn a_name_stands_for_embedded_weights_and_a_path_does_not() {
        let found = find(Path::new(MICRO_ROOMS), String::new).unwrap();
        assert_eq!(found.sha256, embedded(MICRO_ROOMS).unwrap().unwrap().sha256);
        assert!(matches!(find(Path::new("./micro-rooms"), String::new), Err(TensorError::Missing { .. })));
    }
}
