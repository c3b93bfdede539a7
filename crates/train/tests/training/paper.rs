//! The configurations at the paper's scale (`eval/experiments/paper/`): each reads, stands for a row of a table, keeps test
//! scenes out, and does two steps with a network that a test has time for: those of the settings on images of their shape, the
//! others on smaller ones.

use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use atsplat_camera::ImageSize;
use atsplat_files::Sha256Digest;
use atsplat_model::config::{AnchorDesign, Selection};
use atsplat_model::parameters::parameters;
use atsplat_numeric::Tolerance;
use atsplat_protocol::{KNOWN_INDICES, Preset};
use atsplat_rooms::{ImageEncoding, Layout, Request, SceneKind, SceneSeed, Split, WriteOptions, write_dataset};
use atsplat_scene::Warnings;
use atsplat_train::samples::{DatasetConfig, DatasetSource, ExcludedScenes};
use atsplat_train::{PerceptualChoice, SourceConfig, Start, TrainConfig, Trainer};
use tempfile::tempdir;

/// Frames of the scenes that stand for a dataset's: enough for a window of six views.
const FRAMES: usize = 12;

/// One for each setting of the paper's tables; the others change one thing of these.
const SETTINGS: [&str; 7] = ["re10k", "dl3dv-2v", "dl3dv-4v", "dl3dv-6v", "dl3dv-224", "dl3dv-hr", "unified"];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments/paper")
}

fn config(name: &str) -> TrainConfig {
    let path = folder().join(format!("{name}.toml"));
    TrainConfig::read(&path).unwrap()
}

fn names() -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path());
    entries.map(|path| path.file_stem().unwrap().to_string_lossy().into_owned()).collect()
}

fn datasets(config: &TrainConfig) -> Vec<&DatasetConfig> {
    let sources = config.data.iter().map(|data| &data.source);
    sources
        .map(|source| match source {
            SourceConfig::Dataset(dataset) => Some(dataset),
            SourceConfig::Rooms(_) => None,
        })
        .map(Option::unwrap)
        .collect()
}

#[test]
fn every_row_of_the_papers_tables_has_a_configuration() {
    let mut expected: BTreeSet<String> = SETTINGS.map(str::to_owned).into();
    expected.extend([4, 8, 32, 64].map(|k| format!("k-{k}")));
    for ablation in [
        "anchor-ray-depth",
        "anchor-learnable",
        "anchor-direct-xyz",
        "expansion-farthest-point",
        "expansion-random",
        "expansion-straight-through",
        "expansion-none",
    ] {
        expected.extend(["", "-dl3dv"].map(|dataset| format!("ablation-{ablation}{dataset}")));
    }
    assert_eq!(names(), expected);
    for k in [4, 8, 32, 64] {
        assert_eq!(config(&format!("k-{k}")).model.config().unwrap().head.gaussians_per_token, k);
    }
    for (dataset, tokens) in [("", 512), ("-dl3dv", 2688)] {
        let model = |name: &str| config(&format!("ablation-{name}{dataset}")).model.config().unwrap();
        assert!(matches!(model("anchor-ray-depth").anchors.design, AnchorDesign::RayDepth {}));
        assert!(matches!(model("anchor-direct-xyz").anchors.design, AnchorDesign::DirectXyz {}));
        let learnable = model("anchor-learnable").anchors.design;
        assert!(matches!(learnable, AnchorDesign::LearnableTokens { tokens: found } if found == tokens));
        assert!(matches!(model("expansion-farthest-point").expansion.selection, Selection::FarthestPoint {}));
        assert!(matches!(model("expansion-random").expansion.selection, Selection::Random { .. }));
        assert!(matches!(model("expansion-straight-through").expansion.selection, Selection::StraightThrough {}));
        assert!(model("expansion-none").decoder.blocks.iter().all(|block| block.expansion.is_none()));
    }
}

/// "a total batch size of 32 for RealEstate10K and 64 for DL3DV experiments", whatever their resolution; the optimiser's decay and rate; the
/// weights of the losses; the numbers of input views.
#[test]
fn what_the_paper_states_is_in_every_configuration() {
    for name in names() {
        let config = config(&name);
        let is_of_dl3dv = name.contains("dl3dv") || name == "unified";
        assert_eq!(config.batch.get(), if is_of_dl3dv { 64 } else { 32 }, "{name}");
        let losses = &config.losses;
        let found = [
            config.schedule.learning_rate,
            config.optimiser.weight_decay,
            losses.perceptual_weight,
            losses.intermediate_weight,
            losses.uncertainty_weight,
        ];
        // Of the straight-through estimator, the rendering loss trains the scores.
        let of_scores = if name.contains("straight-through") { 0.0 } else { 0.1 };
        Tolerance::EXACT.assert(found, [2e-4, 0.05, 0.5, 0.5, of_scores], &name);
        assert!(config.schedule.warm_up_steps > 0, "{name}");
        assert!(matches!(losses.perceptual, PerceptualChoice::Learned { .. }), "{name}");
    }
    for (name, views) in [("re10k", 2), ("dl3dv-6v", 6), ("dl3dv-224", 6), ("dl3dv-hr", 10)] {
        let config = config(name);
        let found: Vec<_> = datasets(&config).iter().map(|dataset| dataset.views.context).collect();
        assert_eq!(found, [[NonZeroUsize::new(views).unwrap(); 2]], "{name}");
    }
}

/// Rows of DL3DV go on from the same row of RealEstate10K, whose weights have all of their parameters but those that are new.
#[test]
fn rows_of_dl3dv_start_from_the_weights_of_realestate10k() {
    let mut ablations = 0;
    for name in names() {
        let row = config(&name);
        let expected = name.starts_with("dl3dv-") || name.ends_with("-dl3dv");
        assert_eq!(row.model.init, expected, "{name}: whether the run needs weights");
        let Some(same) = name.strip_suffix("-dl3dv") else { continue };
        ablations += 1;
        let trained = |config: &TrainConfig| {
            let all = parameters(&config.model.config().unwrap()).into_iter().filter(|parameter| parameter.trained);
            all.map(|parameter| (parameter.name, parameter.shape)).collect::<BTreeMap<_, _>>()
        };
        let given = trained(&config(same));
        let new = trained(&row).into_iter().filter(|(name, shape)| given.get(name) != Some(shape));
        let new: Vec<String> = new.map(|(name, _)| name).collect();
        assert_eq!(new, row.model.fresh, "{name}");
    }
    assert_eq!(ablations, 7);
    assert_eq!(config("ablation-anchor-learnable-dl3dv").model.fresh, ["anchors.tokens"]);
}

/// The indices that its protocols are published with are excluded, under the hashes that they are known by.
#[test]
fn test_scenes_are_excluded_by_the_hash_of_their_index() {
    for name in names() {
        let config = config(&name);
        for dataset in datasets(&config) {
            assert!(!dataset.exclude.is_empty(), "{name}");
            for excluded in &dataset.exclude {
                let known = excluded.index.file_stem().unwrap().to_string_lossy();
                let published = KNOWN_INDICES.iter().find(|index| index.name == known);
                let published = published.unwrap_or_else(|| panic!("{name}: {known} is not a published index"));
                assert_eq!(excluded.sha256, published.sha256, "{name}: {known}");
            }
            let accepted = Preset::resolve(&dataset.preset).unwrap().index.accepted;
            let first = accepted.first().unwrap();
            assert!(dataset.exclude.iter().any(|excluded| excluded.sha256 == first.sha256), "{name}: {}", first.name);
        }
    }
}

#[test]
fn every_setting_does_two_steps_on_images_of_its_shape() {
    let data = tempdir().unwrap();
    for name in SETTINGS {
        do_two_steps(name, None, data.path());
    }
}

/// Rows of ablations and of the number of Gaussians differ from the settings in the network alone.
#[test]
fn every_other_row_does_two_steps_on_smaller_images() {
    let others: Vec<String> = names().into_iter().filter(|name| !SETTINGS.contains(&name.as_str())).collect();
    assert_eq!(others.len(), 18);
    let data = tempdir().unwrap();
    for name in others {
        do_two_steps(&name, Some(("rooms-2v-64", "resolution = [64, 64]")), data.path());
    }
}

/// With a network that a test has time for; under another protocol than its own, and with a change of the network for it, if given.
/// Datasets are in the folder `data`.
#[expect(clippy::panic, reason = "a helper of tests")]
fn do_two_steps(name: &str, smaller: Option<(&str, &str)>, data: &Path) {
    let folder = tempdir().unwrap();
    let mut stand_in = config(name);
    let changes = "transformer = { dim = 32, head-dim = 16 }\nbackbone = { kind = 'patch', layers = 0 }\n\
                       coarse.layers = 1\nfine.layers = 1";
    let changes = format!("{changes}\n{}", smaller.map_or("", |(_, change)| change));
    for (key, value) in changes.parse::<toml::Table>().unwrap() {
        stand_in.model.changes.insert(key, value);
    }
    (stand_in.model.backbone, stand_in.losses.perceptual) = (None, PerceptualChoice::DSsim);
    // No given weights fit this network.
    (stand_in.model.init, stand_in.model.fresh) = (false, Vec::new());
    stand_in.batch = 1.try_into().unwrap();
    for source in &mut stand_in.data {
        let SourceConfig::Dataset(dataset) = &mut source.source else { panic!("{name}: not a dataset") };
        if let Some((protocol, _)) = smaller {
            protocol.clone_into(&mut dataset.preset);
        }
        simulate(dataset, data);
    }
    let mut trainer = Trainer::new(stand_in, &folder.path().join("run"), &Start::Fresh)
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    let before = trainer.state().parameters.values().to_vec();
    for _ in 0..2 {
        trainer.step(&mut |_| ()).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
    assert_eq!((trainer.state().updates, trainer.state().skipped()), (2, 0), "{name}");
    assert!(trainer.state().parameters.non_finite().is_empty(), "{name}");
    assert!(trainer.state().parameters.values() != before, "{name}");
}

/// Two scenes of the images that the protocol takes, one of them excluded, in a folder of `data` for images of this size; windows and
/// targets as small as a test's clips.
fn simulate(dataset: &mut DatasetConfig, data: &Path) {
    let size = Preset::resolve(&dataset.preset).unwrap().preprocessing.expected_size.unwrap();
    let folder = data.join(format!("{}x{}", size.width, size.height));
    if !folder.exists() {
        let request = |(number, frames)| {
            let mut request = Request::new(SceneKind::Rooms, SceneSeed { split: Split::Train, number });
            request.size = ImageSize { width: size.width, height: size.height };
            (request.samples, request.frames) = (1, frames);
            request
        };
        let options = WriteOptions { layout: Layout::Re10k, encoding: ImageEncoding::Png, depth: false };
        // Of the excluded one, no frame is read.
        let scenes = [(0, FRAMES), (1, 2)].map(request);
        write_dataset(&folder, scenes, &options, &mut Warnings::new(), |_, _| ()).unwrap();
    }
    let index = folder.join("index.json");
    let json = r#"{"rooms-train-00000001": {"context": [0, 3], "target": [1]}}"#;
    std::fs::write(&index, json).unwrap();
    dataset.path = folder.join("train");
    dataset.exclude = vec![ExcludedScenes { index, sha256: Sha256Digest::of(json.as_bytes()) }];
    let gaps = &mut dataset.views.gaps;
    (gaps.min, gaps.max, gaps.initial_min, gaps.initial_max) = (6, 9, 6, 9);
    dataset.views.targets = 1.try_into().unwrap();
    // Twelve images of 512x960 are for a graphics card.
    dataset.views.context = dataset.views.context.map(|views| views.min(6.try_into().unwrap()));
    if size.width > 640 {
        dataset.views.context = [2.try_into().unwrap(); 2];
    }
    let open = |dataset: &DatasetConfig| {
        let normalisation = atsplat_camera::PoseNormalisation::mean_camera(atsplat_camera::MeanCameraScale::LongLrm);
        DatasetSource::open(dataset.clone(), normalisation, &mut Warnings::new())
    };
    assert_eq!(open(dataset).unwrap().keys(), ["rooms-train-00000000"], "the other is excluded");
    let mut other_bytes = dataset.clone();
    other_bytes.exclude[0].sha256 = Sha256Digest::of(b"another file of that name");
    let message = open(&other_bytes).unwrap_err().to_string();
    assert!(message.contains("index.json") && message.contains("expected sha256"), "{message}");
}
