//! A sweep, run into a store and read as a frontier.

use std::sync::Arc;

use crate::common::{Run, Walls, dataset, entry};
use atsplat_eval::ComputeDevice;
use atsplat_eval::method::{
    ConstantsChoice, Method, Prediction, START_POINTS, TrainedUnder, TrialInput, WeightsSource,
};
use atsplat_eval::runner::{Dataset, Plan, current_provenance};
use atsplat_eval::sweep::{Overrides, Part, Setting, Sweep, SweepBase, SweepNetwork, parts};
use atsplat_eval::timing::TimingPlan;
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{ModelWeights, Precision, generated};
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_protocol::trial::{Prefetch, TrialRecipe, Trials};
use atsplat_results::statistics::Leaked;
use atsplat_results::tradeoff::{TradeoffReport, across, tradeoffs};
use atsplat_results::{GapKind, MethodRecord, Results, Store, TrainingRecord};

fn network() -> SweepNetwork {
    let config = ModelConfig::named("nano").unwrap();
    let tensors = generated(&parameters(&config), 1);
    let weights = WeightsSource::Random { seed: 1, backbone_sha256: None };
    SweepNetwork {
        config,
        high_resolution: None,
        tensors,
        weights,
        training: None,
        trained_under: TrainedUnder::default(),
        trained_at: None,
    }
}

fn swept() -> SweepBase {
    SweepBase {
        network: Some(network()),
        changes: Overrides::default(),
        sees_as_given: false,
        call_seed: 0,
        constants: ConstantsChoice::FromPreset,
        background: None,
        device: ComputeDevice::default(),
    }
}

fn with_trained_weights() -> SweepBase {
    let weights = WeightsSource::File { sha256: "00".to_owned() };
    SweepBase { network: Some(SweepNetwork { weights, ..network() }), ..swept() }
}

fn sweep(settings: &str) -> Sweep {
    Sweep::from_toml(&format!("title = 'all overrides'\n{settings}")).unwrap()
}

#[test]
fn every_override_changes_what_it_should() {
    let sweep = sweep(
        "[[settings]]\nlabel = 'as it is'\n\
         [[settings]]\nlabel = 'K 4'\noverrides = { gaussians-per-token = 4 }\n\
         [[settings]]\nlabel = 'no expansion'\noverrides = { ratios = [0.0, 0.0, 0.0] }\n\
         [[settings]]\nlabel = 'thresholds'\noverrides = { thresholds = [1e9, 1e9, 1e9] }\n\
         [[settings]]\nlabel = 'alpha from a tenth'\noverrides = { renderer = { min-alpha = 0.1 } }\n\
         [[settings]]\nlabel = 'refined'\noverrides = { steps = 2 }\n\
         [[settings]]\nlabel = 'from scratch'\noverrides = { strategy = 'mip-splatting', steps = 2 }\n\
         [[settings]]\nlabel = 'two views'\noverrides = { views = 2 }\n",
    );
    let datasets = [dataset(Walls::new(2, 7), &[entry(&[0, 3, 6], &[2])])];
    let folder = tempfile::tempdir().unwrap();
    let parts = parts(&sweep, &swept(), &datasets).unwrap();
    assert_eq!(parts.iter().map(|part| part.methods.len()).collect::<Vec<_>>(), [7, 1]);
    for Part { datasets, methods } in parts {
        Run { timing: Some(TimingPlan::default()), ..Run::new(datasets, methods) }.run(folder.path()).unwrap();
    }
    let results = Results::read(folder.path()).unwrap();
    assert_eq!((results.trials.len(), results.targets.len()), (16, 16));

    let gaussians = |method: &str| results.trials.iter().find(|trial| trial.key.method == method).unwrap().gaussians;
    let renders = |method: &str| -> Vec<Option<String>> {
        let rows = results.targets.iter().filter(|row| row.key.method == method);
        rows.map(|row| row.render_hash.clone()).collect()
    };
    // Three views of 4×4 patches: 48 tokens, 135 after three expansions.
    for (method, count) in [
        ("as it is", 135 * 16),
        ("K 4", 135 * 4),
        ("no expansion", 48 * 16),
        ("thresholds", 48 * 16),
        ("alpha from a tenth", 135 * 16),
        ("refined", 135 * 16),
        ("from scratch", START_POINTS as u64),
        ("two views", 90 * 16),
    ] {
        assert_eq!(gaussians(method), Some(count), "{method}");
        assert_eq!(renders(method) == renders("as it is"), method == "as it is", "{method}");
    }
    assert_eq!(renders("thresholds"), renders("no expansion"), "nothing is that uncertain");
    let record = |name: &str| results.provenance.methods.iter().find(|method| method.name == name).unwrap();
    assert_eq!(["refined", "from scratch"].map(|name| record(name).kind.as_str()), ["atsplat+refine", "mip-splatting"]);
    assert_eq!(record("alpha from a tenth").constants.as_deref(), Some("of the preset, min-alpha 0.1"));

    let apart = tradeoffs(&results, &["psnr"], Leaked::Included).unwrap();
    let names: Vec<&str> = apart.iter().map(|tradeoff| tradeoff.preset.as_str()).collect();
    assert_eq!(names, ["walls", "walls-2-views"]);
    assert_eq!(apart[0].frontiers.iter().map(|frontier| frontier.points.len()).collect::<Vec<_>>(), [7, 7]);
    let across = across(&results, "psnr", Leaked::Included).unwrap();
    assert_eq!(across.frontiers[0].points.len(), 8);
    for point in &across.frontiers[0].points {
        let against = point.against.as_ref().unwrap();
        assert!(point.secs.unwrap() > 0.0, "{point:?}");
        let difference = against.difference;
        assert_eq!((difference.scenes, difference.interval), (2, None), "paired across protocols too");
    }
}

/// Tables name the dataset of such an index, but do not call it the published one.
#[test]
fn an_index_with_fewer_views_knows_the_published_one() {
    let mut dataset = dataset(Walls::new(1, 7), &[entry(&[0, 3, 6], &[2])]);
    dataset.index.name = Some("depthsplat-dl3dv-12v".to_owned());
    let whole = dataset.index.clone();
    let overrides = ["views = 2", "views = 3", "steps = 2"]
        .map(|overrides| format!("[[settings]]\nlabel = '{overrides}'\noverrides = {{ {overrides} }}\n"));
    let parts = parts(&sweep(&overrides.concat()), &swept(), &[dataset]).unwrap();
    let names: Vec<[Option<&str>; 2]> = parts
        .iter()
        .map(|part| &part.datasets[0].index)
        .map(|index| [&index.name, &index.reduced_from].map(Option::as_deref))
        .collect();
    let published = Some("depthsplat-dl3dv-12v");
    assert_eq!(names, [[None, published], [published, None], [published, None]]);
    let reduced = &parts[0].datasets[0].index;
    assert_ne!(reduced.sha256, whole.sha256);
    assert_eq!(reduced.description, "made for a test, fewer context views");
    for part in &parts[1..] {
        assert_eq!(part.datasets[0].index, whole, "all of its views are the published index, with its SHA-256");
    }
}

#[test]
fn an_invalid_override_is_rejected_before_the_sweep_runs() {
    let datasets = [dataset(Walls::new(1, 7), &[entry(&[0, 6], &[2])])];
    for (overrides, message) in [
        ("views = 3", "\"a\", views: from 1 to 2"),
        ("resolution = [32, 0]", "resolution"),
        ("tolerance = -0.5", "tolerance"),
        ("ratios = [0.5]", "\"a\", ratios: 3, one for each block"),
        ("steps = 0", "steps"),
        ("steps = 3, seconds = 1.0", "seconds"),
        ("seconds = -1.0", "seconds"),
        ("matmul-precision = 'bf16', steps = 3", "\"a\", matmul-precision: f32 with"),
        ("matmul-precision = 'f16'", "bf16 on the CPU"),
        ("strategy = 'mcmc'", "strategy"),
        ("strategy = 'fixed', steps = 3", "strategy"),
        ("renderer = { min-alpha = 2.0 }", "renderer"),
        ("renderer = { constants = 'none' }", "constants"),
        ("weights = '/nowhere.safetensors'", "nowhere"),
    ] {
        let text = format!("title = 'one'\n[[settings]]\nlabel = 'a'\noverrides = {{ {overrides} }}");
        let error =
            Sweep::from_toml(&text).and_then(|sweep| parts(&sweep, &swept(), &datasets)).unwrap_err().to_string();
        assert!(error.contains(message), "{overrides}: {error}");
    }
}

/// Of a method's prediction for the last trial of a dataset.
fn predicted<T>(method: &dyn Method, dataset: &Dataset, of: impl Fn(&dyn Prediction) -> T) -> T {
    let Dataset { source, index, preset, .. } = dataset;
    let recipe = TrialRecipe::of(preset, "ATSplat");
    let (trial, _) =
        Trials::new(Arc::clone(source), &index.index, recipe, Prefetch::default()).last().unwrap().unwrap();
    let images: Vec<_> = trial.context().iter().map(|view| view.image().unwrap()).collect();
    of(method.predict(TrialInput { preset, trial: &trial, images: &images }).unwrap().as_ref())
}

/// Of the weights that a setting has, which are not always those of the sweep.
#[test]
fn settings_keep_the_training_of_their_weights() {
    let training = |data: &str| Some(TrainingRecord { data: data.to_owned(), seed: None });
    let trained_under = TrainedUnder { poses: Some("first".to_owned()), background: None };
    let network = SweepNetwork { training: training("rooms"), trained_under, ..network() };
    let provenance = [("data", "yards"), ("pose-normalisation", "second"), ("background", "[0.5, 0.0, 1.0]")];
    let provenance = provenance.map(|(key, value)| (key.to_owned(), value.to_owned())).into();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.safetensors");
    let other = ModelWeights::new(network.config.clone(), provenance, &network.tensors).unwrap();
    other.write(&path, Precision::Single).unwrap();
    let base = SweepBase { network: Some(network), ..swept() };
    let sweep = sweep(&format!(
        "[[settings]]\nlabel = 'of the sweep'\n\
         [[settings]]\nlabel = 'other'\noverrides = {{ weights = '{path}' }}\n\
         [[settings]]\nlabel = 'of the sweep, refined'\noverrides = {{ steps = 1 }}\n\
         [[settings]]\nlabel = 'other, refined'\noverrides = {{ weights = '{path}', steps = 1 }}\n",
        path = path.display()
    ));
    let datasets = [dataset(Walls::new(1, 7), &[entry(&[0, 6], &[2])])];
    let parts = parts(&sweep, &base, &datasets).unwrap();
    let poses = datasets[0].preset.setting_for("ATSplat").pose_normalisation.name();
    let expected = [(training("rooms"), "first"), (training("yards"), "second")];
    assert_eq!(parts[0].methods.len(), 4);
    for (method, (training, trained)) in parts[0].methods.iter().zip(expected.iter().cycle()) {
        assert_eq!(method.record().training, *training);
        let notes = predicted(method.as_ref(), &datasets[0], |prediction| prediction.cost().notes);
        let said = format!("trained with the pose normalisation {trained}, evaluated with {poses}");
        assert!(notes.contains(&said), "{notes:?}");
        let background = "trained on the background [0.5, 0.0, 1.0], evaluated on [";
        assert_eq!(notes.iter().any(|note| note.starts_with(background)), *trained == "second", "{notes:?}");
    }
}

/// The base is untrained and sees images as given; weights of a setting are resized for, unless the base says that none are.
#[test]
fn weights_of_a_setting_run_with_the_changes_of_the_base() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.safetensors");
    let (base, SweepNetwork { config, tensors, .. }) = (swept(), network());
    let other = ModelWeights::new(config.clone(), [].into(), &tensors).unwrap();
    other.write(&path, Precision::Single).unwrap();
    let sweep = sweep(&format!(
        "[[settings]]\nlabel = 'other'\noverrides = {{ weights = '{path}' }}\n\
         [[settings]]\nlabel = 'other, first two'\noverrides = {{ weights = '{path}', expand-first = 2 }}\n",
        path = path.display()
    ));
    let datasets = [dataset(Walls::new(1, 7), &[entry(&[0, 6], &[2])])];
    let records = |base: &SweepBase| -> Vec<_> {
        parts(&sweep, base, &datasets).unwrap()[0].methods.iter().map(|method| method.record()).collect()
    };
    let hashes = |base: &SweepBase| -> Vec<_> {
        records(base).iter().map(|record| record.model_hash().map(str::to_owned)).collect()
    };
    let hash = |blocks| Some(config.with_expansion_in_first(blocks).hash().unwrap());
    assert_eq!(hashes(&base), [hash(3), hash(2)]);
    let changes = Overrides { expand_first: Some(1), ..Overrides::default() };
    let changed = SweepBase { changes, ..base.clone() };
    assert_eq!(hashes(&changed), [hash(1), hash(1)], "blocks that the base does not expand stay so");
    let resized = |base: &SweepBase| -> Vec<_> {
        let size = |record: &MethodRecord| record.parameters.get("context-at-scale-of").cloned();
        records(base).iter().map(size).collect()
    };
    let trained = Some(serde_json::Value::from(config.resolution.to_string()));
    assert_eq!(resized(&base), [trained.clone(), trained]);
    let given = SweepBase { sees_as_given: true, ..base.clone() };
    assert_eq!(resized(&given), [None, None]);
    let large = |base: &SweepBase| -> Vec<_> {
        records(base).iter().map(|record| record.parameters.get("high-resolution").cloned()).collect()
    };
    let high = config.for_high_resolution().unwrap().unwrap();
    let expanding = |blocks| Some(serde_json::to_value(high.with_expansion_in_first(blocks)).unwrap());
    assert_eq!(large(&base), [expanding(3), expanding(2)]);
    assert_eq!(large(&changed), [expanding(1), expanding(1)]);
    assert_eq!(large(&given), [None, None]);
}

#[test]
fn weights_of_a_setting_without_a_valid_one_for_large_images_are_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("long.safetensors");
    let SweepNetwork { config, tensors, .. } = network();
    let config = ModelConfig { resolution: ImageSize::new(8208, 16), ..config };
    ModelWeights::new(config, [].into(), &tensors).unwrap().write(&path, Precision::Single).unwrap();
    let sweep = sweep(&format!("[[settings]]\nlabel = 'a'\noverrides = {{ weights = '{}' }}", path.display()));
    let datasets = [dataset(Walls::new(1, 7), &[entry(&[0, 6], &[2])])];
    let error = parts(&sweep, &swept(), &datasets).unwrap_err().to_string();
    let says_why = error.contains("setting for large images: ") && error.contains("found 16416");
    assert!(says_why && error.contains("long.safetensors"), "{error}");
}

#[test]
fn an_index_with_fewer_views_is_not_the_published_one() {
    let mut published = dataset(Walls::new(1, 7), &[entry(&[0, 3, 6], &[2])]);
    published.index.name = Some("published".to_owned());
    let sweep = sweep(
        "[[settings]]\nlabel = 'as it is'\n\
         [[settings]]\nlabel = 'two'\noverrides = { views = 2 }\n\
         [[settings]]\nlabel = 'all'\noverrides = { views = 3 }\n\
         [[settings]]\nlabel = 'small'\noverrides = { resolution = [32, 32] }\n",
    );
    let parts = parts(&sweep, &swept(), &[published]).unwrap();
    let names: Vec<_> = parts.iter().map(|part| part.datasets[0].index.name.as_deref()).collect();
    assert_eq!(names, [Some("published"), None, Some("published"), Some("published")]);
}

/// Fewer Gaussians per token keep the first ones of the trained weights; more than they have are an error.
#[test]
fn trained_weights_can_give_fewer_gaussians_per_token() {
    let datasets = [dataset(Walls::new(1, 7), &[entry(&[0, 6], &[2])])];
    let trained = with_trained_weights();
    let of = |overrides: &str| {
        parts(&sweep(&format!("[[settings]]\nlabel = 'a'\noverrides = {{ {overrides} }}")), &trained, &datasets)
    };
    let renders = |part: &Part, target| {
        predicted(part.methods[0].as_ref(), &datasets[0], |prediction| {
            (prediction.cost().gaussians, prediction.render(&[target]).remove(0).unwrap().image)
        })
    };
    let [few, all] =
        ["gaussians-per-token = 2", "gaussians-per-token = 16"].map(|overrides| renders(&of(overrides).unwrap()[0], 0));
    assert_eq!((few.0.unwrap() * 8, few.1 == all.1), (all.0.unwrap(), false));
    assert_eq!(all, renders(&of("").unwrap()[0], 0), "all of them are the weights as they are");
    let record = of("tolerance = 0.5").unwrap()[0].methods[0].record();
    assert_eq!((&record.parameters["tolerance"], &record.parameters["effects"]), (&0.5.into(), &"auto".into()));
    let [exact, rounded] =
        ["matmul-precision = 'f32'", "matmul-precision = 'bf16'"].map(|overrides| of(overrides).unwrap());
    assert!(!exact[0].methods[0].record().parameters.contains_key("matmul-precision"), "the default");
    assert_eq!(rounded[0].methods[0].record().parameters["matmul-precision"], "bf16");
    assert_eq!(renders(&exact[0], 0), all);
    let rounded = renders(&rounded[0], 0);
    let moved: f32 = rounded.1.samples().iter().zip(all.1.samples()).map(|(a, b)| (a - b).abs()).sum();
    let mean = moved / all.1.samples().len() as f32;
    assert!(rounded.0 == all.0 && mean > 0.0 && mean < 0.03, "samples moved by {mean}");
    let error = of("gaussians-per-token = 32").unwrap_err().to_string();
    assert!(error.contains("gaussians-per-token") && error.contains("head."), "{error}");
}

/// Every shipped sweep expands into methods and protocols on a scene of twelve views.
#[test]
fn shipped_sweeps_expand() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/sweeps");
    let datasets = [dataset(Walls::new(1, 13), &[entry(&[0, 1, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12], &[2])])];
    let trained = with_trained_weights();
    let mut used_overrides = Vec::new();
    for file in std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path()) {
        if file.extension().is_some_and(|extension| extension == "toml") {
            let sweep = Sweep::from_toml(&std::fs::read_to_string(&file).unwrap()).unwrap();
            let expanded = parts(&sweep, &trained, &datasets);
            if file.ends_with("matmul-precision-on-adapter.toml") {
                let error = expanded.err().unwrap().to_string();
                assert!(error.contains("matmul-precision") && error.contains("f16"), "on the CPU: {error}");
                continue;
            }
            let expanded = expanded.unwrap_or_else(|error| panic!("{}: {error}", file.display()));
            assert_eq!(expanded.iter().map(|part| part.methods.len()).sum::<usize>(), sweep.settings.len());
            for Setting { overrides, .. } in &sweep.settings {
                used_overrides.extend(overrides.gaussians_per_token.map(|_| "Gaussians per token"));
                used_overrides.extend(overrides.thresholds.as_ref().map(|_| "thresholds"));
                used_overrides.extend(overrides.views.map(|_| "views"));
                used_overrides.extend(overrides.resolution.map(|_| "size"));
                used_overrides.extend(overrides.steps.map(|_| "steps"));
                used_overrides.extend(overrides.matmul_precision.map(|_| "matmul precision"));
                used_overrides.extend(overrides.seconds.map(|_| "seconds"));
                used_overrides.extend(overrides.tolerance.map(|_| "tolerance"));
                used_overrides.extend(overrides.renderer.min_alpha.map(|_| "renderer"));
            }
        }
    }
    used_overrides.sort_unstable();
    used_overrides.dedup();
    assert_eq!(
        used_overrides,
        [
            "Gaussians per token",
            "matmul precision",
            "renderer",
            "seconds",
            "size",
            "steps",
            "thresholds",
            "tolerance",
            "views"
        ]
    );
}

/// A sweep that was killed after its first part, and went on later.
#[test]
fn what_a_sweep_has_not_reached_is_missing_from_its_store() {
    let sweep = sweep("[[settings]]\nlabel = 'all'\n[[settings]]\nlabel = 'two'\noverrides = { views = 2 }\n");
    let datasets = [dataset(Walls::new(1, 7), &[entry(&[0, 3, 6], &[2])])];
    let parts = parts(&sweep, &swept(), &datasets).unwrap();
    let runs: Vec<Run> = parts.into_iter().map(|Part { datasets, methods }| Run::new(datasets, methods)).collect();
    let plans: Vec<Plan<'_>> = runs.iter().map(Run::plan).collect();
    let here = current_provenance("0", None, Vec::new());
    let folder = tempfile::tempdir().unwrap();
    drop(Store::resume(folder.path(), Plan::joint_provenance(&plans, &here).unwrap()).unwrap());
    let missing = |results: &Results| -> Vec<String> {
        let unfinished = results.gaps().into_iter().filter(|gap| gap.kind == GapKind::Unfinished);
        unfinished.map(|gap| format!("{}: {}", gap.preset, gap.first)).collect()
    };
    let (first, _) = runs[0].run(folder.path()).unwrap();
    // No row says that the method of the second part has nothing to do in the first one.
    let [there, elsewhere] = ["walls", "walls-2-views"].map(|preset| format!("{preset}: 0 of 1 index entries"));
    assert_eq!(missing(&first), [there, elsewhere.clone(), elsewhere]);
    let tradeoffs = vec![across(&first, "psnr", Leaked::Included).unwrap()];
    let text = TradeoffReport { tradeoffs, unfinished: first.cut_off() }.to_string();
    assert!(text.ends_with("walls-2-views: the run is unfinished: it has not reached all, two\n"), "{text}");
    let (second, _) = runs[1].run(folder.path()).unwrap();
    assert_eq!(missing(&second), [""; 0]);
    let twice = Plan::joint_provenance(&[plans[0], plans[0]], &here).unwrap_err().to_string();
    assert!(twice.contains("all twice"), "{twice}");
}
