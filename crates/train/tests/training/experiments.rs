//! Every configuration in `eval/experiments/` can be read, builds its network and does a step at a tiny size.

use std::path::{Path, PathBuf};

use atsplat_model::ImageSize;
use atsplat_model::budget::budget;
use atsplat_model::config::{AnchorDesign, HeadFrame, Selection};
use atsplat_model::weights::ModelWeights;
use atsplat_numeric::Tolerance;
use atsplat_train::{Parameters, SourceConfig, Start, TrainConfig, Trainer};
use tempfile::tempdir;

fn experiments() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments");
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    paths
}

/// The same experiment with a tiny network and tiny images.
fn tiny(mut config: TrainConfig) -> TrainConfig {
    let changes =
        "resolution = [32, 32]\ntransformer = { dim = 32, head-dim = 16 }\ncoarse.layers = 1\nfine.layers = 1"
            .parse::<toml::Table>();
    for (key, value) in changes.unwrap() {
        config.model.changes.insert(key, value);
    }
    for data in &mut config.data {
        if let SourceConfig::Rooms(rooms) = &mut data.source {
            (rooms.size, rooms.samples, rooms.scenes) = (ImageSize::new(32, 32), 1, 1.try_into().unwrap());
        }
    }
    // No given weights fit this network.
    (config.evaluation, config.model.init) = (None, false);
    config
}

#[test]
fn every_experiment_does_a_step() {
    for path in experiments() {
        let name = path.display();
        let config = TrainConfig::read(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(TrainConfig::from_toml(&config.to_toml().unwrap()).unwrap(), config, "{name}");
        config.model.config().unwrap_or_else(|error| panic!("{name}: {error}"));
        let folder = tempdir().unwrap();
        let mut trainer = Trainer::new(tiny(config), folder.path(), &Start::Fresh).unwrap();
        let before = trainer.state().parameters.values().to_vec();
        trainer.step(&mut |_| ()).unwrap();
        assert_eq!((trainer.state().updates, trainer.state().skipped()), (1, 0), "{name}");
        assert!(trainer.state().parameters.non_finite().is_empty(), "{name}");
        assert!(trainer.state().parameters.values() != before, "{name}");
    }
}

#[test]
fn the_papers_ablations_are_configured() {
    let model = |name: &str| {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../eval/experiments/ablation-{name}.toml"));
        TrainConfig::read(&path).unwrap().model.config().unwrap()
    };
    assert!(matches!(model("anchor-ray-depth").anchors.design, AnchorDesign::RayDepth {}));
    assert!(matches!(model("anchor-learnable").anchors.design, AnchorDesign::LearnableTokens { .. }));
    assert!(matches!(model("anchor-direct-xyz").anchors.design, AnchorDesign::DirectXyz {}));
    assert!(matches!(model("expansion-random").expansion.selection, Selection::Random { .. }));
    assert!(matches!(model("expansion-farthest-point").expansion.selection, Selection::FarthestPoint {}));
    assert!(matches!(model("expansion-straight-through").expansion.selection, Selection::StraightThrough {}));
    let none = model("expansion-none");
    assert!(none.decoder.blocks.iter().all(|block| block.expansion.is_none()));
    let base = TrainConfig::read(&experiments().into_iter().find(|path| path.ends_with("nano-rooms.toml")).unwrap());
    let layers = |model: &atsplat_model::ModelConfig| -> Vec<usize> {
        model.decoder.blocks.iter().map(|block| block.layers).collect()
    };
    assert_eq!(layers(&none), layers(&base.unwrap().model.config().unwrap()), "nothing else differs");
}

/// So that `--init` can start from the embedded weights, and their scores are those of their training.
#[test]
fn the_embedded_weights_fit_the_experiments_networks() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval");
    for (name, seed) in [("micro-rooms", 1), ("micro-yards", 102)] {
        let weights = ModelWeights::read(&folder.join(format!("checkpoints/{name}.safetensors"))).unwrap();
        let config = TrainConfig::read(&folder.join(format!("experiments/{name}.toml"))).unwrap();
        let model = config.model.config().unwrap();
        assert!(config.model.init, "{name}: goes on from weights");
        let evaluation = config.evaluation.and_then(|evaluation| evaluation.seed);
        assert_eq!(evaluation, Some(seed), "{name}: the samples of the figures in eval/checkpoints");
        assert_eq!(weights.config.hash().unwrap(), model.hash().unwrap(), "{name}");
        assert_eq!((&weights.config.name, weights.config.resolution), (&name.to_owned(), model.resolution), "{name}");
        assert_eq!(weights.config.head.frame, HeadFrame::Patch, "{name}");
    }
}

/// The rows behind the paper's claims: each goes on from the embedded weights, and they differ in nothing but their model, the losses
/// of straight-through scores, and the new parts of a model; those of 2 Gaussians per token also have another learning rate.
#[test]
fn rows_of_claims_start_from_the_embedded_weights() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval");
    let weights = ModelWeights::read(&folder.join("checkpoints/micro-rooms.safetensors")).unwrap();
    let read = |name: &str| TrainConfig::read(&folder.join(format!("experiments/claims/{name}.toml"))).unwrap();
    let full = read("full");
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder.join("experiments/claims")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        if ["unified", "separate-", "yards", "window"].iter().any(|start| name.starts_with(start)) {
            continue;
        }
        let row = read(&name);
        let model = row.model.config().unwrap();
        Parameters::from_weights(&model, &weights.tensors, &row.model.fresh, row.seed).unwrap();
        assert!(row.model.fresh.contains(&"head".to_owned()), "{name}: every row has a new head");
        let expands = model.decoder.blocks.iter().filter(|block| block.expansion.is_some()).count();
        let new = row.model.fresh.iter().filter(|part| part.ends_with(".expansion")).count();
        assert_eq!(new, expands, "{name}: every expansion is new");
        let straight_through = matches!(model.expansion.selection, Selection::StraightThrough {});
        assert_eq!(row.losses.uncertainty_weight == 0.0, straight_through, "{name}");
        let times = match name.strip_suffix("-long") {
            None => 1,
            Some(short) if short.starts_with("anchor-") => 2,
            Some(_) => 3,
        };
        assert_eq!(row.steps.get(), times * full.steps.get(), "{name}");
        let mut common = TrainConfig { title: full.title.clone(), steps: full.steps, model: full.model.clone(), ..row };
        common.losses.uncertainty_weight = full.losses.uncertainty_weight;
        if name.starts_with("sparser") {
            let times = common.schedule.learning_rate / full.schedule.learning_rate;
            assert!((times - 2.0).abs() < 1e-9, "{name}: twice the learning rate");
            common.schedule.learning_rate = full.schedule.learning_rate;
        }
        assert_eq!(common, full, "{name}: the same samples and losses");
        names.push((name, model));
    }
    assert_eq!(names.len(), 31);
    let model = |name: &str| names.iter().find(|(known, _)| known == name).map(|(_, model)| model).unwrap();
    let gaussians = |name: &str| budget(model(name), 2, ImageSize::new(64, 64)).unwrap().fixed().unwrap().gaussians;
    assert_eq!(gaussians("expansion-none-k45"), gaussians("full"));
    assert_eq!(gaussians("k-64"), 4 * gaussians("full"));
    for name in ["random", "farthest-point", "straight-through"].map(|name| format!("sparse-{name}")) {
        assert_eq!(gaussians(&name), gaussians("k-4"), "{name}");
    }
    for name in ["random", "farthest-point", "straight-through"].map(|name| format!("sparsest-{name}")) {
        assert_eq!(gaussians(&name), gaussians("k-1"), "{name}");
    }
    assert_eq!((gaussians("sparser-random"), gaussians("sparser")), (720, 720));
    // As many as whole Gaussians per token allow.
    assert_eq!((gaussians("sparse-none-k11"), gaussians("k-4")), (1408, 1440));
    assert_eq!((gaussians("sparsest-none-k3"), gaussians("k-1")), (384, 360));
    for name in ["anchor-ray-depth", "anchor-direct-xyz", "anchor-learnable", "anchor-offset"] {
        assert_eq!(model(name).head.frame, HeadFrame::World, "{name}: without anchors there is no frame of a patch");
    }
}

/// The rows on yards, and those for leads outside the window: as the rows on rooms, with other samples, at twice the learning rate, and
/// some for longer.
#[test]
fn rows_with_other_samples_differ_in_nothing_else_but_rate_and_length() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments/claims");
    let read = |name: &str| TrainConfig::read(&folder.join(format!("{name}.toml"))).unwrap();
    let yards = [("yards", "k-4"), ("yards-random", "sparse-random"), ("yards-none-k11", "sparse-none-k11")];
    let window = [("window", "full"), ("window-ray-depth", "anchor-ray-depth")];
    for (rows, times) in [(&yards[..], 1), (&window[..], 3)] {
        let shared = read(rows[0].0).data;
        for (name, on_rooms) in rows {
            let (row, on_rooms) = (read(name), read(on_rooms));
            let model = atsplat_model::ModelConfig {
                name: on_rooms.model.config().unwrap().name,
                ..row.model.config().unwrap()
            };
            assert_eq!(model, on_rooms.model.config().unwrap(), "{name}");
            assert_eq!(row.model.fresh, on_rooms.model.fresh, "{name}");
            assert_eq!(row.data, shared, "{name}: the samples of the other rows");
            assert_eq!(row.steps.get(), times * on_rooms.steps.get(), "{name}");
            Tolerance::F64.assert([row.schedule.learning_rate], [2.0 * on_rooms.schedule.learning_rate], name);
            let TrainConfig { title, notes, data, model, schedule, steps, .. } = on_rooms.clone();
            assert_eq!(TrainConfig { title, notes, data, model, schedule, steps, ..row }, on_rooms, "{name}");
        }
    }
}

/// One network for all settings sees as many samples of each as the network that is trained on it alone, and nothing else differs.
#[test]
fn the_unified_network_sees_the_samples_of_the_separate_ones() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments/claims");
    let read = |name: &str| TrainConfig::read(&folder.join(format!("{name}.toml"))).unwrap();
    let unified = read("unified");
    let separate = ["rooms", "yards-2v", "yards-4v", "yards-6v"].map(|name| read(&format!("separate-{name}")));
    let shares: Vec<f64> = unified.data.iter().map(|data| data.share).collect();
    Tolerance::F64.assert(shares, [1.0; 4], "equal shares");
    assert_eq!(unified.steps.get(), separate.iter().map(|config| config.steps.get()).sum::<u64>());
    for (config, data) in separate.into_iter().zip(&unified.data) {
        assert_eq!(config.data, std::slice::from_ref(data), "{}", config.title);
        assert!(config.model.fresh.is_empty() && unified.model.fresh.is_empty(), "{}", config.title);
        let name = unified.model.config().unwrap().name;
        let model = atsplat_model::ModelConfig { name, ..config.model.config().unwrap() };
        assert_eq!(model, unified.model.config().unwrap(), "{}", config.title);
        let (title, steps, data) = (unified.title.clone(), unified.steps, unified.data.clone());
        assert_eq!(TrainConfig { title, steps, data, model: unified.model.clone(), ..config }, unified);
    }
}

/// Adds a part of the second configuration to the first.
type AddPart = fn(&mut TrainConfig, &TrainConfig);

/// Each trial of the recipe differs from the plain run in one part, and the last one has them all.
#[test]
fn trials_of_the_recipe_add_one_part_each() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/experiments/recipe");
    let read = |name: &str| {
        let config = TrainConfig::read(&folder.join(format!("{name}.toml"))).unwrap();
        TrainConfig { title: String::new(), ..config }
    };
    let gaps = |config: &TrainConfig| match &config.data[0].source {
        SourceConfig::Rooms(rooms) => rooms.views.gaps,
        SourceConfig::Dataset(_) => panic!("exact distances are those of simulated scenes"),
    };
    let (plain, all) = (read("plain"), read("all"));
    let parts: [(&str, AddPart); 5] = [
        ("average", |config, all| config.average = all.average),
        ("flips", |config, all| config.flips = all.flips),
        ("curriculum", |config, all| config.data.clone_from(&all.data)),
        ("distances", |config, all| config.losses.distance_weight = all.losses.distance_weight),
        ("late-d-ssim", |config, all| config.losses.late_perceptual_weight = all.losses.late_perceptual_weight),
    ];
    let mut together = plain.clone();
    for (name, add) in parts {
        let mut expected = plain.clone();
        add(&mut expected, &all);
        assert_ne!(expected, plain, "{name}");
        assert_eq!(read(name), expected, "{name}");
        add(&mut together, &all);
    }
    assert_eq!(together, all);
    assert_eq!((gaps(&plain).warm_up_steps, gaps(&plain).max, gaps(&all).max), (0, 27, 27));
    assert!(gaps(&all).initial_max < gaps(&all).max);
}

/// The message for a configuration with this text, in a file `run.toml`.
fn error_of(text: &str) -> String {
    let folder = tempdir().unwrap();
    let path = folder.path().join("run.toml");
    std::fs::write(&path, text).unwrap();
    TrainConfig::read(&path).unwrap_err().to_string()
}

fn nano() -> String {
    std::fs::read_to_string(experiments().into_iter().find(|path| path.ends_with("nano-rooms.toml")).unwrap()).unwrap()
}

/// Changes of [`nano`], each with the field and the text that its message must have.
fn assert_refused(changes: &[(&str, &str, &str, &str)]) {
    let nano = nano();
    for (from, to, field, expected) in changes {
        let changed = nano.replacen(from, to, 1);
        assert_ne!(changed, nano, "{from} was replaced");
        let message = error_of(&changed);
        assert!(
            message.contains("run.toml, field ") && message.contains(field) && message.contains(expected),
            "{message}"
        );
    }
}

#[test]
fn windows_that_hold_no_sample_name_file_and_field() {
    assert_refused(&[
        ("min = 4, max = 9", "min = 9, max = 4", "data[0].source.rooms.views.gaps", "min and max in order"),
        (
            "min = 4, max = 9",
            "min = 4, max = 9, initial-min = 5, initial-max = 9, warm-up-steps = 9",
            "data[0].source.rooms.views.gaps",
            "initial-min and min in order, because windows grow during the warm-up, found 5 and 4",
        ),
        (
            "min = 4, max = 9",
            "min = 4, max = 9, initial-min = 4, initial-max = 10, warm-up-steps = 9",
            "data[0].source.rooms.views.gaps",
            "initial-max and max in order, because windows grow during the warm-up, found 10 and 9",
        ),
        (
            "min = 4, max = 9",
            "min = 4, max = 9, initial-min = 2, initial-max = 4",
            "data[0].source.rooms.views.gaps.warm-up-steps",
            "a positive number if initial-min or initial-max is set, found 0",
        ),
        (
            "min = 4, max = 9",
            "min = 15, max = 20",
            "data[0].source.rooms.views",
            "windows that fit into the 15 frames of a clip",
        ),
        // Windows of nine frames allow ten context views, not eleven.
        (
            "context = [2, 2]",
            "context = [8, 12]",
            "data[0].source.rooms.views",
            "needs gaps of at least 10 frames, has at most 9, for 11 context views at step 0",
        ),
    ]);
}

#[test]
fn errors_of_a_configuration_name_file_and_field() {
    let whole = std::fs::read_to_string(&experiments()[experiments().len() - 1]).unwrap();
    assert!(error_of(&whole.replace("seed = 1", "sead = 1")).contains("sead"));
    assert!(error_of(&whole.replace("learning-rate = ", "learning-rate = -")).contains("a positive number"));
    assert_refused(&[
        ("size = [128, 128]", "size = [128, 100]", "data[0].source.rooms.size", "branch's patches, found 128x100"),
        (
            "scenes = 400",
            "scenes = 400\nfirst = 4294966897",
            "data[0].source.rooms.first",
            "scenes up to number 4294967295, found 400 scenes from 4294966897 on",
        ),
        (
            "base = \"nano\"",
            "base = \"nano\"\nbackbone = \"some.pth\"",
            "model.backbone",
            "none, as the network has no frozen backbone, found some.pth",
        ),
        (
            "base = \"nano\"",
            "base = \"nano\"\nfresh = [\"head\", \"hea\"]",
            "model.fresh",
            "parts with trained parameters, found hea",
        ),
        (
            "[model.changes]",
            "[model.changes]\ncoarse.layerz = 1",
            "model.changes.coarse: expected one of ",
            "`layers`, found unknown field `layerz`",
        ),
        (
            "[model.changes]",
            "[model.changes]\ncoarse.layers = \"x\"",
            "model.changes.coarse.layers",
            "expected a whole number of at least 0, found \"x\"",
        ),
        ("samples = 2", "samples = 0", "data[0].source.rooms.samples", "1 to 256 rays a pixel, found 0"),
        ("context = [2, 2]", "context = [3, 2]", "data[0].source.rooms.views.context", "found 3 and 2"),
        ("context = [2, 2]", "context = [1, 2]", "data[0].source.rooms.views.context", "at least 2"),
        ("[losses]", "[losses]\ndistance-weight = -1.0", "losses.distance-weight", "found -1"),
        (
            "[losses]",
            "[losses]\ndistance-until = 0.0",
            "losses.distance-until",
            "a share of the run, above 0, at most 1, found 0",
        ),
        // White, as 8-bit images have it.
        ("[losses]", "[losses]\nbackground = [1, 1, 255]", "losses.background", "channels from 0 to 1, found 255"),
    ]);
    let nano = nano();
    for (from, to, field, problem) in [
        (
            "[losses]",
            "[losses]\nperceptual-wait = 0.1",
            "losses.perceptual-wait",
            "found unknown field `perceptual-wait`",
        ),
        ("seed = 1", "seed = 1.5", "seed", "expected a whole number of at least 0, found 1.5 ("),
        (
            "[losses]",
            "[losses]\nperceptual = \"lpips-vgg\"",
            "losses.perceptual",
            "expected a table such as { kind = \"d-ssim\" } or { kind = \"learned\", network = …, weights = … }, found \"lpips-vgg\"",
        ),
    ] {
        let message = error_of(&nano.replacen(from, to, 1));
        assert!(message.starts_with("training configuration: line "), "{message}");
        assert!(message.contains(&format!(", field {field}: expected ")) && message.contains(problem), "{message}");
        assert!(message.ends_with("run.toml)"), "{message}");
    }
    for (from, to, expected) in [
        (
            "[model.changes]",
            "[model.changes]\ncoarse.layers = 999",
            "field coarse.layers: expected 0 to 256, found 999",
        ),
        ("base = \"nano\"", "base = \"nanno\"", "found \"nanno\""),
    ] {
        let message = error_of(&nano.replacen(from, to, 1));
        assert!(message.contains(expected) && message.ends_with("run.toml)"), "{message}");
    }
    assert!(error_of("base = \"run.toml\"").contains("at most 8 files"));
    assert!(error_of("base = 3").contains("a path as `base`"));
    assert!(error_of("base = \"absent.toml\"").contains("absent.toml"));
}
