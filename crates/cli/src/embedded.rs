//! Weights embedded in the binary; `eval/checkpoints/` says how each was trained.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_eval::EvalError;
use atsplat_eval::trained::TrainedNetwork;
use atsplat_eval::weights_list::WeightsList;
use atsplat_model::weights::{TensorError, TensorFile};
use atsplat_protocol::Preset;
use atsplat_report::definition::TableDefinition;
use atsplat_scene::SharedBytes;

/// Trained on simulated rooms with two views.
const MICRO_ROOMS: &str = "micro-rooms";
/// Trained further on simulated yards with two to twelve views.
const MICRO_YARDS: &str = "micro-yards";

const FILES: [(&str, &[u8]); 2] = [
    (MICRO_ROOMS, include_bytes!("../../../eval/checkpoints/micro-rooms.safetensors")),
    (MICRO_YARDS, include_bytes!("../../../eval/checkpoints/micro-yards.safetensors")),
];

/// Names of the embedded weights.
pub(crate) const NAMES: [&str; 2] = [MICRO_ROOMS, MICRO_YARDS];

/// The list of embedded weights by protocol; `tables` are the protocols of each table.
pub(crate) fn by_protocol(tables: &BTreeMap<String, Vec<String>>) -> Result<WeightsList, EvalError> {
    let text = include_str!("../../../eval/checkpoints/embedded.toml");
    WeightsList::from_toml(text, Path::new("embedded.toml"), tables, &NAMES)
}

/// The embedded weights of this name; `None` if there are none.
pub(crate) fn embedded(name: &str) -> Option<Result<TensorFile, TensorError>> {
    let (name, bytes) = FILES.into_iter().find(|(file, _)| *file == name)?;
    Some(TensorFile::parse(PathBuf::from(name), SharedBytes::new(bytes.to_vec())))
}

/// The network with the weights in a file, or with embedded ones by their name; by default with those trained on rooms.
pub(crate) fn trained(path: Option<&Path>) -> Result<TrainedNetwork, EvalError> {
    let path = path.unwrap_or(Path::new(MICRO_ROOMS));
    let expected = || or_a_file("a weights file that `atsplat train` or `atsplat weights import` wrote");
    let file = find(path, expected)?;
    let origin = if is_embedded(path) { ", embedded in the binary" } else { "" };
    TrainedNetwork::new(&file, format!("{}{origin}", path.display()))
}

/// The embedded network for a protocol: that of its list entry, otherwise the one trained on rooms.
pub(crate) fn for_protocol(preset: &Preset) -> anyhow::Result<TrainedNetwork> {
    let list = by_protocol(&TableDefinition::presets_by_name()?)?;
    Ok(trained(list.network(preset))?)
}

/// What was expected where neither a file nor embedded weights have the given name.
pub(crate) fn or_a_file(file: &str) -> String {
    format!("{}, embedded in the binary, or {file}", NAMES.join(" or "))
}

/// Whether a path is a name of embedded weights, and not a file.
fn is_embedded(path: &Path) -> bool {
    NAMES.iter().any(|name| path == Path::new(name)) && !path.exists()
}

/// Like [`TensorFile::find`]; `path` may also be the name of embedded weights, unless a file has that name.
pub(crate) fn find(path: &Path, expected: impl FnOnce() -> String) -> Result<TensorFile, TensorError> {
    let named = path.to_str().filter(|_| is_embedded(path)).and_then(embedded);
    named.unwrap_or_else(|| TensorFile::find(path, expected))
}

#[cfg(test)]
mod tests {
    use atsplat_model::weights::ModelWeights;

    use super::*;

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
    fn yards_have_their_own_network_and_transfer_to_them_does_not() {
        let list = by_protocol(&TableDefinition::presets_by_name().unwrap()).unwrap();
        for (preset, expected) in [
            ("rooms-2v-128", MICRO_ROOMS),
            ("re10k-2v-256", MICRO_ROOMS),
            ("rooms-extrapolation-128", MICRO_ROOMS),
            ("rooms-to-yards-128", MICRO_ROOMS),
            ("photos-3v-256", MICRO_ROOMS),
            ("yards-2v-128x224", MICRO_YARDS),
            ("yards-12v-256x480", MICRO_YARDS),
            ("yards-6v-112", MICRO_YARDS),
            ("yards-6v-extrapolation", MICRO_YARDS),
            ("dl3dv-6v-256x448", MICRO_YARDS),
        ] {
            let network = list.network(&Preset::named(preset).unwrap());
            assert_eq!(network, Some(Path::new(expected)), "{preset}");
            assert_eq!(for_protocol(&Preset::named(preset).unwrap()).unwrap().config.name, expected, "{preset}");
        }
    }

    #[test]
    fn a_name_stands_for_embedded_weights_and_a_path_does_not() {
        let found = find(Path::new(MICRO_ROOMS), String::new).unwrap();
        assert_eq!(found.sha256, embedded(MICRO_ROOMS).unwrap().unwrap().sha256);
        assert!(matches!(find(Path::new("./micro-rooms"), String::new), Err(TensorError::Missing { .. })));
    }
}
