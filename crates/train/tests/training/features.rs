//! The cache of a frozen backbone's features changes the duration of a step and nothing else.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_model::ModelConfig;
use atsplat_model::network::{Device, MatmulPrecision, Network, f32_values};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, Precision, StoredTensor, StoredTensors, TensorFile, generated};
use atsplat_train::{FeatureCache, Start, TrainConfig, Trainer};
use tempfile::tempdir;

use crate::common::{Noise, bits, config, sample, trainer};

const BACKBONE: &str = "backbone.";

fn with_dino() -> TrainConfig {
    let mut config = config("");
    let backbone = r#"{ kind = "dino-v2", size = "tiny", registers = true }"#;
    let changes = &mut config.model.changes;
    changes
        .insert("backbone".to_owned(), toml::from_str::<toml::Table>(&format!("b = {backbone}")).unwrap()["b"].clone());
    config
}

fn backbone(weights: &StoredTensors) -> StoredTensors {
    let mut frozen = weights.clone();
    frozen.tensors.retain(|name, _| name.starts_with(BACKBONE));
    frozen
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let below = |folder: &Path| folder.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect::<Vec<_>>();
    let mut files: Vec<PathBuf> = below(folder).iter().flat_map(|folder| below(folder)).collect();
    files.sort();
    files
}

#[test]
fn features_from_disk_equal_the_backbones() {
    let config: ModelConfig = with_dino().model.config().unwrap();
    let weights = generated(&parameters(&config), 1);
    let network = Network::new(&config, &Device::flex()).unwrap().with_weights(&weights).unwrap();
    let sample = sample(0);
    let means = |views| f32_values(network.forward(&[views], 0).unwrap().gaussians.means);
    let expected = means(sample.context.views().unwrap());

    let folder = tempdir().unwrap();
    let open_in =
        |frozen: &StoredTensors, precision| FeatureCache::open(folder.path(), &config, frozen, precision).unwrap();
    let open = |frozen: &StoredTensors| open_in(frozen, MatmulPrecision::F32);
    let cache = open(&backbone(&weights));
    assert_eq!(means(cache.views(&network, &sample.context).unwrap()), expected, "when written");
    let kept = files(folder.path());
    assert_eq!(kept.len(), sample.context.cameras.len(), "one file per image");
    let written = || kept.iter().map(|path| path.metadata().unwrap().modified().unwrap()).collect::<Vec<_>>();
    let first = written();
    assert_eq!(means(open(&backbone(&weights)).views(&network, &sample.context).unwrap()), expected, "from disk");
    assert_eq!(written(), first, "nothing was computed again");

    let mut bytes = std::fs::read(&kept[0]).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&kept[0], &bytes).unwrap();
    std::fs::write(&kept[1], b"half a f").unwrap();
    assert_eq!(means(cache.views(&network, &sample.context).unwrap()), expected, "damaged files are computed again");

    let other = backbone(&generated(&parameters(&config), 2));
    open(&other).views(&network, &sample.context).unwrap();
    assert_eq!(files(folder.path()).len(), 2 * kept.len(), "other weights have other files");

    let rounded = open_in(&backbone(&weights), MatmulPrecision::Bf16);
    let of_rounded = MatmulPrecision::Bf16.scope(|| rounded.views(&network, &sample.context).unwrap());
    assert_eq!(files(folder.path()).len(), 3 * kept.len(), "products in bfloat16 have other files");
    assert!(means(of_rounded) != expected, "made of other features");
    assert_eq!(means(cache.views(&network, &sample.context).unwrap()), expected, "and leave those of f32");
}

#[test]
fn training_with_the_cache_gives_identical_weights() {
    let folder = tempdir().unwrap();
    let plain = with_dino();
    let mut cached = plain.clone();
    cached.model.feature_cache = Some(folder.path().join("features"));
    let model = plain.model.config().unwrap();
    let start = folder.path().join("start.safetensors");
    let weights = ModelWeights::new(model.clone(), BTreeMap::new(), &generated(&parameters(&model), 1)).unwrap();
    weights.write(&start, Precision::Single).unwrap();
    let trained = |config: TrainConfig, name: &str| {
        let mut trainer = trainer(
            config,
            &folder.path().join(name),
            &Start::Weights(TensorFile::open(&start).unwrap()),
            Noise::CLEAN,
        );
        for _ in 0..3 {
            trainer.step(&mut |_| ()).unwrap();
        }
        assert_eq!(trainer.state().skipped(), 0);
        bits(&trainer)
    };
    assert_eq!(trained(plain, "plain"), trained(cached, "cached"));
    assert!(!files(&folder.path().join("features")).is_empty());
}

#[test]
fn rejects_the_cache_of_a_trained_backbone() {
    let config = ModelConfig::named("nano").unwrap();
    let (folder, frozen) = (tempdir().unwrap(), StoredTensors::default());
    let error = FeatureCache::open(folder.path(), &config, &frozen, MatmulPrecision::F32).unwrap_err();
    assert!(error.to_string().contains("model.feature-cache: expected a frozen backbone, found Patch"), "{error}");
}

/// Said before the run has a folder, in which another start would find a run.
#[test]
fn a_new_network_needs_the_file_of_its_frozen_backbone() {
    let folder = tempdir().unwrap();
    let run = folder.path().join("run");
    let opened = Trainer::with_samples(with_dino(), Box::new(Noise::CLEAN), &run, &Start::Fresh);
    let error = opened.unwrap_err().to_string();
    assert!(error.contains("model.backbone: expected the file of the frozen backbone's weights"), "{error}");
    assert!(!run.exists());
}

/// The file of given weights may be gone when their run resumes: its checkpoints contain the frozen backbone.
#[test]
fn a_run_from_given_weights_resumes_with_their_backbone() {
    let folder = tempdir().unwrap();
    let (config, start, run) = (with_dino(), folder.path().join("start.safetensors"), folder.path().join("run"));
    let model = config.model.config().unwrap();
    let weights = ModelWeights::new(model.clone(), BTreeMap::new(), &generated(&parameters(&model), 1)).unwrap();
    weights.write(&start, Precision::Half).unwrap();
    let mut killed = trainer(config.clone(), &run, &Start::Weights(TensorFile::open(&start).unwrap()), Noise::CLEAN);
    killed.step(&mut |_| ()).unwrap();
    assert_eq!(killed.state().skipped(), 0);
    let expected = bits(&killed);
    drop(killed);
    std::fs::remove_file(start).unwrap();
    let mut resumed = trainer(config, &run, &Start::Resume, Noise::CLEAN);
    assert_eq!(resumed.state().step, 0, "killed before its first checkpoint");
    resumed.step(&mut |_| ()).unwrap();
    assert_eq!(resumed.state().skipped(), 0);
    assert!(bits(&resumed) == expected);
}

/// Weights files contain the backbone rounded to f16; the exact one is used if the configuration names it, and resumed without its file.
#[test]
fn a_backbone_next_to_given_weights_is_used_and_has_to_be_theirs() {
    let folder = tempdir().unwrap();
    let [start, exact, other] =
        ["start", "exact", "other"].map(|name| folder.path().join(format!("{name}.safetensors")));
    let mut config = with_dino();
    let model = config.model.config().unwrap();
    let weights = generated(&parameters(&model), 1);
    ModelWeights::new(model, BTreeMap::new(), &weights).unwrap().write(&start, Precision::Half).unwrap();
    let mut frozen = backbone(&weights);
    frozen.write(&exact).unwrap();
    let digest = frozen.digest();
    config.model.backbone = Some(exact.clone());
    let opened = |config: &TrainConfig, run: &str, start: &Start| {
        Trainer::with_samples(config.clone(), Box::new(Noise::CLEAN), &folder.path().join(run), start)
    };
    let digest_of = |trainer: &Trainer| trainer.state().parameters.frozen().digest();
    let given = Start::Weights(TensorFile::open(&start).unwrap());
    assert_eq!(digest_of(&opened(&config, "given", &given).unwrap()), digest, "without the rounding");
    opened(&config, "fresh", &Start::Fresh).unwrap().write_checkpoint().unwrap();
    assert_eq!(digest_of(&opened(&config, "fresh", &Start::Resume).unwrap()), digest, "from the file");
    std::fs::remove_file(exact).unwrap();
    assert_eq!(digest_of(&opened(&config, "given", &Start::Resume).unwrap()), digest, "from the checkpoint");
    assert!(opened(&config, "fresh", &Start::Resume).unwrap_err().to_string().contains("exact.safetensors"));

    let (name, tensor) = frozen.tensors.last().map(|(name, tensor)| (name.clone(), tensor.clone())).unwrap();
    let mut values = tensor.to_f32().unwrap();
    values[0] += 0.01;
    frozen.tensors.insert(name.clone(), StoredTensor::from_f32(tensor.shape().to_vec(), &values).unwrap());
    frozen.write(&other).unwrap();
    config.model.backbone = Some(other.clone());
    let error = opened(&config, "refused", &given).unwrap_err().to_string();
    assert!(error.ends_with(&format!("others in {}: {name}", other.display())), "{error}");
}

/// Weights files contain the frozen tensors too.
#[test]
fn a_backbone_beyond_f16_is_an_error() {
    let folder = tempdir().unwrap();
    let (path, run) = (folder.path().join("backbone.safetensors"), folder.path().join("run"));
    let mut config = with_dino();
    let mut frozen = backbone(&generated(&parameters(&config.model.config().unwrap()), 1));
    let (name, tensor) = frozen.tensors.first().map(|(name, tensor)| (name.clone(), tensor.clone())).unwrap();
    let mut values = tensor.to_f32().unwrap();
    values[0] = 7e4;
    frozen.tensors.insert(name.clone(), StoredTensor::from_f32(tensor.shape().to_vec(), &values).unwrap());
    frozen.write(&path).unwrap();
    config.model.backbone = Some(path.clone());
    let refused = Trainer::with_samples(config, Box::new(Noise::CLEAN), &run, &Start::Fresh);
    let error = refused.unwrap_err().to_string();
    let start = format!("initial weights: {}, field {name}: expected values up to 65504", path.display());
    assert!(error.starts_with(&start) && error.ends_with("found 70000"), "{error}");
    assert!(!run.exists());
}
