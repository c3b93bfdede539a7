//! Weights files: round trips, damaged and hostile files.

use std::collections::BTreeMap;

use atsplat_files::Sha256Digest;
use atsplat_pickle::SharedBytes;

use super::*;
use crate::ModelError;
use crate::config::{BackboneConfig, DinoSize, ModelConfig};
use crate::parameters::parameters;

fn shared(bytes: impl Into<Vec<u8>>) -> SharedBytes {
    SharedBytes::new(bytes.into())
}

fn nano() -> ModelWeights {
    let config = ModelConfig::named("nano").unwrap();
    let stored = generated(&parameters(&config), 3);
    let provenance = BTreeMap::from([("data".to_owned(), "none: a hash".to_owned())]);
    ModelWeights::new(config, provenance, &stored).unwrap()
}

#[test]
fn weights_round_trip_through_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let (path, copy) = (folder.path().join("nano.safetensors"), folder.path().join("copy.safetensors"));
    let weights = nano();
    weights.write(&path, Precision::Single).unwrap();
    let read = ModelWeights::read(&path).unwrap();
    assert_eq!((&read.config, &read.provenance), (&weights.config, &weights.provenance));
    assert_eq!(read.tensors.digest(), weights.tensors.digest());
    assert_eq!(
        (read.sha256.as_ref(), weights.sha256.as_ref()),
        (Some(&TensorFile::open(&path).unwrap().sha256.to_string()), None)
    );
    read.write(&copy, Precision::Single).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&copy).unwrap(), "the same bytes");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no temporary file is left");
}

#[test]
fn the_reference_implementation_reads_our_files_and_we_read_its() {
    let stored = nano().to_stored(Precision::Half).unwrap();
    let bytes = stored.to_safetensors().unwrap();
    let theirs = ::safetensors::SafeTensors::deserialize(&bytes).unwrap();
    assert_eq!(theirs.len(), stored.tensors.len());
    for (name, view) in theirs.iter() {
        let ours = &stored.tensors[name];
        assert_eq!((view.shape(), view.data()), (ours.shape(), ours.bytes()), "{name}");
    }
    let (_, metadata) = ::safetensors::SafeTensors::read_metadata(&bytes).unwrap();
    assert_eq!(metadata.metadata().as_ref().unwrap()["atsplat.format"], "2");
    let rewritten = ::safetensors::serialize(theirs.iter(), None).unwrap();
    assert_eq!(StoredTensors::parse(shared(rewritten)).unwrap().digest(), stored.digest(), "we read its file");
}

#[test]
fn a_number_beyond_a_precision_names_its_tensor() {
    let mut weights = nano();
    let name = "head.mlp.fc2.weight";
    let shape = weights.tensors.tensors[name].shape().to_vec();
    let values = vec![7e4; shape.iter().product()];
    weights.tensors.tensors.insert(name.to_owned(), StoredTensor::from_f32(shape, &values).unwrap());
    let error = weights.to_stored(Precision::Half).unwrap_err().to_string();
    let expected = format!("tensor {name}: expected numbers that f16 can represent, up to 65504, found 70000");
    assert!(error.contains(&expected), "{error}");
    weights.to_stored(Precision::Brain).unwrap();
}

/// Files with edited metadata and unchanged tensors.
#[test]
fn rejects_edited_metadata() {
    const CONFIGURATION: &str = "atsplat.configuration";
    let written = nano().to_stored(Precision::Half).unwrap();
    assert!(ModelWeights::from_stored(&written).unwrap().metadata_covered);
    let edited = |change: &dyn Fn(&mut BTreeMap<String, String>)| {
        let mut stored = written.clone();
        change(&mut stored.metadata);
        ModelWeights::from_stored(&stored)
    };
    let fewer = |metadata: &mut BTreeMap<String, String>| {
        let text = metadata[CONFIGURATION].replacen("ratio = 0.25", "ratio = 0.125", 1);
        assert_ne!(text, metadata[CONFIGURATION]);
        metadata.insert(CONFIGURATION.to_owned(), text);
    };
    let message = |outcome: Result<ModelWeights, ModelError>| outcome.unwrap_err().to_string();
    assert!(message(edited(&fewer)).contains("metadata (configuration, provenance): expected sha256"));
    let renamed = |metadata: &mut BTreeMap<String, String>| {
        metadata.insert("atsplat.provenance.data".to_owned(), "re10k".to_owned());
    };
    assert!(message(edited(&renamed)).contains("as written"));
    let bare = |metadata: &mut BTreeMap<String, String>| drop(metadata.remove("atsplat.metadata-sha256"));
    assert!(message(edited(&bare)).contains("atsplat.metadata-sha256"), "this format has the hash");
    // The earlier format has no hash: edits cannot be detected.
    let earlier = edited(&|metadata| {
        bare(metadata);
        metadata.insert("atsplat.format".to_owned(), "1".to_owned());
        fewer(metadata);
    });
    let earlier = earlier.unwrap();
    assert!(!earlier.metadata_covered);
    let config = earlier.config.clone();
    assert!(!earlier.for_network(config).unwrap().metadata_covered);
}

#[test]
fn every_precision_round_trips() {
    let weights = nano();
    for (precision, dtype, relative) in [
        (Precision::Single, DType::F32, 0.0),
        (Precision::Half, DType::F16, 2f64.powi(-11)),
        (Precision::Brain, DType::Bf16, 2f64.powi(-8)),
    ] {
        let stored = weights.to_stored(precision).unwrap();
        let read = ModelWeights::from_stored(&StoredTensors::parse(shared(stored.to_safetensors().unwrap())).unwrap());
        for (name, tensor) in &read.unwrap().tensors.tensors {
            assert_eq!(tensor.dtype(), dtype, "{name}");
            let expected = weights.tensors.tensors[name].to_f32().unwrap();
            for (found, expected) in tensor.to_f32().unwrap().into_iter().zip(expected) {
                // Below 6.1e-5, f16 has fewer digits.
                let bound = relative * f64::from(expected.abs()) + 2f64.powi(-25);
                assert!(f64::from((found - expected).abs()) <= bound, "{name}: {found} for {expected}");
            }
        }
    }
}

#[test]
fn the_configuration_is_read_without_tensors() {
    let mut stored = nano().to_stored(Precision::Brain).unwrap();
    stored.tensors.clear();
    assert_eq!(ModelWeights::config_of(&stored).unwrap().name, "nano");
    assert!(ModelWeights::is_one(&stored));
    stored.metadata.remove("atsplat.format");
    assert!(!ModelWeights::is_one(&stored) && ModelWeights::config_of(&stored).is_err());
}

#[test]
fn weights_fit_every_network_with_the_same_parameters() {
    let other = nano().config.with_expansion_in_first(1);
    assert_eq!(nano().for_network(other.clone()).unwrap().config, other);
    assert!(nano().for_network(ModelConfig::named("mini").unwrap()).is_err());
}

#[test]
fn errors_of_absent_weights_say_which_and_where_to_get_them() {
    let advice = |name: &str, hash| ModelWeights::advice(&ModelConfig::named(name).unwrap(), hash);
    let paper = advice("paper-dl3dv", Some(Sha256Digest([0x5a; 32])));
    for part in ["model paper-dl3dv", "sha256 5a5a", "weights import", "dinov2_vitb14_pretrain.pth", "https://"] {
        assert!(paper.contains(part), "{paper}");
    }
    let mut config = ModelConfig::named("nano").unwrap();
    config.backbone = BackboneConfig::Patch { layers: 1 };
    assert!(!ModelWeights::advice(&config, None).contains("backbone"));
    let error = ModelWeights::read("no/such.safetensors".as_ref()).unwrap_err();
    assert!(
        matches!(error, ModelError::Tensors(TensorError::Missing { .. })) && error.to_string().contains("import"),
        "{error}"
    );
}

#[test]
fn any_changed_byte_is_detected() {
    let stored = nano().to_stored(Precision::Half).unwrap();
    let bytes = stored.to_safetensors().unwrap();
    let header = 8 + usize::try_from(u64::from_le_bytes(*bytes.first_chunk().unwrap())).unwrap();
    for at in [header, usize::midpoint(header, bytes.len()), bytes.len() - 1] {
        let mut changed = bytes.clone();
        changed[at] ^= 1;
        let stored = StoredTensors::parse(shared(changed)).unwrap();
        let error = ModelWeights::from_stored(&stored).unwrap_err().to_string();
        assert!(error.contains("sha256"), "{error}");
    }
    for len in [0, 7, 8, 9, header - 1, header, header + 1, bytes.len() - 1] {
        assert!(StoredTensors::parse(shared(&bytes[..len])).is_err(), "{len} bytes");
    }
    assert!(StoredTensors::parse(shared([&bytes[..], b"x"].concat())).is_err(), "a byte too many");
}

#[test]
fn rejects_files_without_our_metadata() {
    let mut stored = nano().to_stored(Precision::Single).unwrap();
    // In the first format, without a hash of what is changed here.
    stored.metadata.remove("atsplat.metadata-sha256");
    stored.metadata.insert("atsplat.format".to_owned(), "1".to_owned());
    for (key, value, expected) in [
        ("atsplat.format", None, "imported by a key map"),
        ("atsplat.format", Some("3"), "expected 1 or 2, found 3"),
        ("atsplat.configuration", Some("name = 1"), "model configuration: line 1"),
        ("atsplat.tensors-sha256", None, "expected a sha256"),
    ] {
        let mut other = stored.clone();
        other.metadata.remove(key);
        other.metadata.extend(value.map(|value| (key.to_owned(), value.to_owned())));
        let error = ModelWeights::from_stored(&other).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let name = stored.tensors.keys().next().unwrap().clone();
    stored.tensors.swap_remove(&name);
    stored.metadata.insert("atsplat.tensors-sha256".to_owned(), stored.digest());
    let error = ModelWeights::from_stored(&stored).unwrap_err();
    assert!(matches!(&error, ModelError::Unfit(report) if report.missing[0].parameter == name), "{error}");
}

/// The path is that of no file: nothing is read again.
#[test]
fn a_backbone_is_verified_in_the_bytes_whose_hash_is_reported() {
    let mut config = ModelConfig::named("paper-re10k").unwrap();
    config.backbone = BackboneConfig::DinoV2 { size: DinoSize::Tiny, registers: false };
    let frozen: Vec<_> = parameters(&config).into_iter().filter(|parameter| !parameter.trained).collect();
    let foreign = KeyMap::resolve("dinov2-official").unwrap().export(&generated(&frozen, 5)).unwrap();
    let bytes = foreign.to_safetensors().unwrap();
    let file = || TensorFile::parse("no/such.safetensors".into(), shared(bytes.clone())).unwrap();
    let verified = Verification::new(file(), Some(&config), None).unwrap().to_string();
    assert!(verified.contains("fits the model paper-re10k"), "{verified}");
    config.backbone = BackboneConfig::DinoV2 { size: DinoSize::Small, registers: false };
    let error = Verification::new(file(), Some(&config), None).unwrap_err();
    assert!(matches!(&error, ModelError::InFile { path, .. } if path.ends_with("such.safetensors")), "{error}");
}

#[test]
fn errors_of_absent_and_wrong_backbones_say_where_to_get_the_right_one() {
    let config = ModelConfig::named("paper-re10k").unwrap();
    let error = read_backbone("no/such.pth".as_ref(), &config, None).unwrap_err().to_string();
    for part in ["dinov2_vitb14_pretrain.pth", "https://dl.fbaipublicfiles.com", "facebook/dinov2-base", "no/such.pth"]
    {
        assert!(error.contains(part), "{error}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nano.safetensors");
    nano().write(&path, Precision::Half).unwrap();
    let error = read_backbone(&path, &config, None).unwrap_err().to_string();
    assert!(error.contains("174 missing") && error.contains("nano.safetensors"), "{error}");
    let error = read_backbone(&path, &config, Some(Sha256Digest([0x5a; 32]))).unwrap_err().to_string();
    assert!(error.contains("expected a file of sha256 5a5a"), "{error}");
}
