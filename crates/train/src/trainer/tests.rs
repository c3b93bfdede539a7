use atsplat_model::weights::{ModelWeights, TensorFile};
use atsplat_numeric::Tolerance;
use atsplat_protocol::Preset;
use atsplat_rooms::{ImageEncoding, Layout, Request, SceneKind, SceneSeed, Split, WriteOptions, write_dataset};
use atsplat_scene::WarningKind;
use atsplat_scene::preprocess::PatchCrop;

use super::*;

const CONFIG: &str = r#"
    title = "a dataset with a missing image"
    seed = 1
    steps = 6
    batch = 2

    [model]
    base = "nano"

    [model.changes]
    resolution = [32, 32]
    transformer = { dim = 32, head-dim = 16 }

    [[data]]
    [data.source.dataset]
    path = "DATA"
    preset = "PRESET"
    views = { context = [2, 2], targets = 1, gaps = { min = 2, max = 3 }, inset = 1 }

    [evaluation]
    every = 6
    samples = 1
    source.dataset = { path = "DATA", preset = "PRESET", views = { context = [2, 2], targets = 1, gaps = { min = 2, max = 3 }, inset = 1 } }
"#;

#[test]
fn warnings_of_datasets_reach_the_caller_once_per_scene() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    write_scenes(&data, 1);
    let seed = SceneSeed { split: Split::Train, number: 0 };
    let name = "66667.png";
    std::fs::remove_file(data.join("train").join(seed.key(SceneKind::Rooms)).join(name)).unwrap();
    let config = CONFIG.replace("DATA", &data.join("train").to_string_lossy());
    let config = TrainConfig::from_toml(&config.replace("PRESET", &tiny_preset(folder.path()))).unwrap();

    let mut trainer = Trainer::new(config, &folder.path().join("run"), &Start::Fresh).unwrap();
    assert_eq!(trainer.warnings().count(WarningKind::MissingImage), 1, "of both sources");
    let mut notices = Vec::new();
    let mut evaluated = Vec::new();
    let mut on_event = |event: &Event<'_>| match event {
        Event::Notice(text) if text.starts_with("warning: ") => notices.push((*text).to_owned()),
        Event::Evaluation(record) => evaluated.push((*record).clone()),
        _ => {}
    };
    assert!(trainer.run(Limits::default(), &mut on_event).unwrap());
    assert_evaluated_before_and_after(&trainer, &evaluated, &folder.path().join("run"));
    assert_eq!(trainer.warnings().count(WarningKind::MissingImage), 1, "however often they are read");
    let [notice] = notices.as_slice() else { panic!("{notices:?}") };
    let expected = format!("warning: 1 × missing-image; the first: {}: frame 2: no ", seed.key(SceneKind::Rooms));
    assert!(notice.starts_with(&expected) && notice.ends_with(name), "{notice}");
}

/// The evaluation's data are others, whose scene has the same name.
#[test]
fn warnings_of_other_data_are_counted_as_well() {
    let folder = tempfile::tempdir().unwrap();
    let key = SceneSeed { split: Split::Train, number: 0 }.key(SceneKind::Rooms);
    let mut config = CONFIG.replace("PRESET", &tiny_preset(folder.path()));
    for name in ["first", "second"] {
        let data = folder.path().join(name);
        write_scenes(&data, 1);
        std::fs::remove_file(data.join("train").join(&key).join("66667.png")).unwrap();
        config = config.replacen("DATA", &data.join("train").to_string_lossy(), 1);
    }
    let config = TrainConfig::from_toml(&config).unwrap();
    let trainer = Trainer::new(config, &folder.path().join("run"), &Start::Fresh).unwrap();
    assert_eq!(trainer.warnings().count(WarningKind::MissingImage), 2);
}

/// The size that a preset expects is known before an image is read; and three skipped steps do not stop a run, which writes a
/// checkpoint after the second.
#[test]
fn a_run_without_a_sample_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let [data, run] = ["data", "run"].map(|name| folder.path().join(name));
    write_scenes(&data, 1);
    let text = CONFIG.replace("DATA", &data.join("train").to_string_lossy());
    let (text, _evaluation) = text.split_once("[evaluation]").unwrap();
    let text = format!("{}[checkpoints]\nevery = 2\n", text.replace("steps = 6", "steps = 3"));
    let open = |preset: &str, start: &Start| {
        let config = TrainConfig::from_toml(&text.replace("PRESET", preset)).unwrap();
        Trainer::new(config, &run, start)
    };
    let other = tiny_preset(folder.path());
    let resized = std::fs::read_to_string(&other).unwrap();
    let sized = format!("{resized}\n[preprocessing.expected-size]\nwidth = 48\nheight = 40\n");
    let path = folder.path().join("sized.toml");
    let path = path.to_string_lossy();
    std::fs::write(&*path, sized).unwrap();
    let error = open(&path, &Start::Fresh).unwrap_err().to_string();
    assert!(error.contains("20 draws gave no sample") && error.ends_with("is 32×32, expected 48×40"), "{error}");
    assert!(error.contains(": image-size: frame "), "{error}");
    assert!(!run.exists());

    let mut trainer = open(&other, &Start::Fresh).unwrap();
    std::fs::rename(&data, folder.path().join("gone")).unwrap();
    let error = trainer.run(Limits::default(), &mut |_| ()).unwrap_err();
    assert!(matches!(error, TrainError::Untrained { steps: 3, .. }), "{error}");
    let expected =
        "none of the run's 3 steps so far could be used, so that its weights are not trained; the last: step 2: ";
    assert!(error.to_string().starts_with(expected), "{error}");
    assert!(Checkpoints::exist_in(&run).unwrap() && !run.join(WEIGHTS).exists());
}

/// Half of the draws are of a scene without readable images.
#[test]
fn what_opening_draws_in_vain_is_not_counted() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    write_scenes(&data, 2);
    break_images(&data, 1);
    let config = CONFIG.replace("DATA", &data.join("train").to_string_lossy());
    let config = config.replace("PRESET", &tiny_preset(folder.path()));
    for seed in 1..6 {
        let config = TrainConfig::from_toml(&config.replace("seed = 1", &format!("seed = {seed}"))).unwrap();
        assert_eq!(config.samples(&mut Warnings::new()).unwrap().replaced().count, 0, "seed {seed}");
    }
}

/// As a process leaves them that is killed while it writes.
#[test]
fn unfinished_files_of_killed_trainings_are_removed() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    write_scenes(&data, 1);
    let config = CONFIG.replace("DATA", &data.join("train").to_string_lossy());
    let config = TrainConfig::from_toml(&config.replace("PRESET", &tiny_preset(folder.path()))).unwrap();
    let open = |start: &Start| Trainer::new(config.clone(), &run, start).unwrap();
    open(&Start::Fresh).write_checkpoint().unwrap();
    let left = [".AbC123.partial", "checkpoints/.dEf456.partial", "checkpoints/.gHi789.partial", ".notes"];
    let left = left.map(|name| run.join(name));
    for path in &left {
        std::fs::write(path, "half").unwrap();
    }
    let notices = open(&Start::Resume).notices;
    assert_eq!(left.map(|path| path.exists()), [false, false, false, true]);
    let expected = format!("removed 3 unfinished files from {}, of a training that was killed", run.display());
    assert!(notices.contains(&expected), "{notices:?}");
}

/// The same data elsewhere are recognised by their samples; a log without them leaves nothing to compare.
#[test]
fn a_run_resumes_on_the_same_data_elsewhere() {
    let folder = tempfile::tempdir().unwrap();
    let [data, moved, other, run] = ["data", "moved", "other", "run"].map(|name| folder.path().join(name));
    write_scenes(&data, 1);
    write_scenes_of(&other, 1, 12, 2);
    let text = CONFIG.replace("PRESET", &tiny_preset(folder.path()));
    let open = |data: &Path, start: &Start| {
        let config = TrainConfig::from_toml(&text.replace("DATA", &data.join("train").to_string_lossy())).unwrap();
        Trainer::new(config, &run, start)
    };
    open(&data, &Start::Fresh).unwrap().run(Limits { steps: Some(2), time: None }, &mut |_| ()).unwrap();
    std::fs::rename(&data, &moved).unwrap();
    let notices = open(&moved, &Start::Resume).unwrap().notices;
    let named = "settings that change no result differ from those of the run so far: data[0].source.dataset.path: ";
    assert!(notices.iter().any(|notice| notice.starts_with(named)), "{notices:?}");
    let error = open(&other, &Start::Resume).unwrap_err().to_string();
    assert!(error.starts_with("training data: samples of step "), "{error}");
    std::fs::remove_file(run.join(STEPS)).unwrap();
    let error = open(&moved, &Start::Resume).unwrap_err().to_string();
    let expected = "training data: steps.jsonl: expected hashes to compare the data at another path with, or the path";
    assert!(error.starts_with(expected) && error.ends_with("found the file is gone"), "{error}");
}

/// All samples so far are of the first source.
#[test]
fn a_source_that_was_never_drawn_from_cannot_move() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, moved, run] = ["first", "second", "moved", "run"].map(|name| folder.path().join(name));
    write_scenes(&first, 1);
    write_scenes(&second, 1);
    let (training, _evaluation) = CONFIG.split_once("[evaluation]").unwrap();
    let (settings, source) = training.split_once("[[data]]").unwrap();
    let text = format!("{settings}[[data]]\nshare = 1e9{source}[[data]]{}", source.replace("DATA", "SECOND"));
    let text = text.replace("PRESET", &tiny_preset(folder.path()));
    let open = |[first, second]: [&Path; 2], start: &Start| {
        let [first, second] = [first, second].map(|data| data.join("train").to_string_lossy().into_owned());
        let config = TrainConfig::from_toml(&text.replace("DATA", &first).replace("SECOND", &second)).unwrap();
        Trainer::new(config, &run, start)
    };
    open([&first, &second], &Start::Fresh).unwrap().run(Limits { steps: Some(1), time: None }, &mut |_| ()).unwrap();
    write_scenes_of(&moved, 1, 12, 2);
    let error = open([&first, &moved], &Start::Resume).unwrap_err().to_string();
    let expected =
        "training data: data[1].source.dataset: expected samples in steps.jsonl to compare the data at another path";
    assert!(error.starts_with(expected), "{error}");
    open([&second, &second], &Start::Resume).unwrap();
}

/// Of a longer list, a draw is of another scene: those of the training and of the evaluation are compared, each under its field.
#[test]
fn a_run_resumes_on_no_other_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, other, run] = ["first", "second", "other", "run"].map(|name| folder.path().join(name));
    for (path, scenes) in [(&first, 1), (&second, 1), (&other, 2)] {
        write_scenes(path, scenes);
    }
    let config = CONFIG.replacen("DATA", &first.join("train").to_string_lossy(), 1);
    let config = config.replace("DATA", &second.join("train").to_string_lossy());
    let config = TrainConfig::from_toml(&config.replace("PRESET", &tiny_preset(folder.path()))).unwrap();
    let open = |start: &Start| Trainer::new(config.clone(), &run, start);
    open(&Start::Fresh).unwrap().write_checkpoint().unwrap();
    for (path, field) in [(&first, "data[0]"), (&second, "evaluation")] {
        let hidden = folder.path().join("hidden");
        std::fs::rename(path, &hidden).unwrap();
        std::fs::rename(&other, path).unwrap();
        let error = open(&Start::Resume).unwrap_err().to_string();
        let expected = format!("checkpoint: {field}.source.dataset.scenes-sha256: expected ");
        assert!(error.contains(&expected) && error.contains("or a new run from its weights"), "{error}");
        std::fs::rename(path, &other).unwrap();
        std::fs::rename(&hidden, path).unwrap();
        open(&Start::Resume).unwrap();
    }
}

/// Keys and sizes stay the same.
#[test]
fn a_run_resumes_on_no_other_images_or_clips() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, hidden, run] = ["first", "second", "hidden", "run"].map(|name| folder.path().join(name));
    write_scenes(&first, 1);
    write_scenes(&second, 1);
    let config = CONFIG.replacen("DATA", &first.join("train").to_string_lossy(), 1);
    let config = config.replace("DATA", &second.join("train").to_string_lossy());
    let config = TrainConfig::from_toml(&config.replace("PRESET", &tiny_preset(folder.path()))).unwrap();
    let open = |start: &Start| Trainer::new(config.clone(), &run, start);
    open(&Start::Fresh).unwrap().run(Limits { steps: Some(2), time: None }, &mut |_| ()).unwrap();
    let logs = || [STEPS, EVALUATIONS].map(|name| std::fs::read_to_string(run.join(name)).unwrap());
    let before = logs();
    let training = ["training data: samples of step ", ": expected those that steps.jsonl records"];
    let evaluation = ["evaluation data: samples after step 0: ", "expected those that evaluations.jsonl records"];
    for (path, (frames, rays), expected) in
        [(&first, (12, 2), training), (&first, (6, 1), training), (&second, (12, 2), evaluation)]
    {
        std::fs::rename(path, &hidden).unwrap();
        write_scenes_of(path, 1, frames, rays);
        let error = open(&Start::Resume).unwrap_err().to_string();
        let advice = "put the data back as they were, or start a new run from the weights";
        assert!(error.starts_with(expected[0]) && error.contains(expected[1]) && error.contains(advice), "{error}");
        assert_eq!(logs(), before, "nothing is changed");
        std::fs::remove_dir_all(path).unwrap();
        std::fs::rename(&hidden, path).unwrap();
        open(&Start::Resume).unwrap();
    }

    for path in [&first, &second] {
        std::fs::remove_dir_all(path).unwrap();
        write_scenes_of(path, 1, 12, 2);
    }
    let noticed = |expected: [&str; 2]| {
        let notices = open(&Start::Resume).unwrap().notices;
        let found = |expected: &&str| notices.iter().any(|notice| notice.starts_with(*expected));
        assert!(expected.iter().all(found), "{notices:?}");
    };
    // The latest steps as on another type of processor, which may have other bits.
    let checkpoint = run.join("checkpoints/step-00000002.safetensors");
    let mut stored = TensorFile::open(&checkpoint).unwrap().stored;
    stored.metadata.remove("metadata-sha256").unwrap();
    stored.metadata.insert("processor".to_owned(), "an older one".to_owned());
    stored.write(&checkpoint).unwrap();
    noticed([
        "training data: samples of step 1: not those that",
        "evaluation data: samples after step 0: not those that",
    ]);
    // Logs as earlier versions wrote them.
    for name in [STEPS, EVALUATIONS] {
        let mut text = String::new();
        for line in std::fs::read_to_string(run.join(name)).unwrap().lines() {
            let mut record: serde_json::Value = serde_json::from_str(line).unwrap();
            record.as_object_mut().unwrap().remove("samples-sha256").unwrap();
            text = format!("{text}{record}\n");
        }
        std::fs::write(run.join(name), text).unwrap();
    }
    noticed(["steps.jsonl: no hashes of samples", "evaluations.jsonl: no hashes of samples"]);
    for name in [STEPS, EVALUATIONS] {
        std::fs::remove_file(run.join(name)).unwrap();
    }
    noticed(["steps.jsonl: the file is gone: whether", "evaluations.jsonl: the file is gone: whether"]);
}

/// Draws of a scene without readable images are replaced: as many in a run that is resumed as in one that is not.
#[test]
fn replaced_draws_are_counted_reported_at_the_end_and_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let [data, whole, parts] = ["data", "whole", "parts"].map(|name| folder.path().join(name));
    write_scenes(&data, 2);
    break_images(&data, 1);
    let config = CONFIG.replace("DATA", &data.join("train").to_string_lossy());
    let config = TrainConfig::from_toml(&config.replace("PRESET", &tiny_preset(folder.path()))).unwrap();
    let run = |folder: &Path, start: &Start, steps: u64| {
        let mut trainer = Trainer::new(config.clone(), folder, start).unwrap();
        let mut last = String::new();
        let mut on_event = |event: &Event<'_>| {
            if let Event::Notice(text) = event {
                (*text).clone_into(&mut last);
            }
        };
        trainer.run(Limits { steps: Some(steps), time: None }, &mut on_event).unwrap();
        let weights = ModelWeights::read(&folder.join(WEIGHTS)).unwrap();
        (trainer.samples.replaced().count, last, weights.provenance["replaced-draws"].clone())
    };
    let (count, last, recorded) = run(&whole, &Start::Fresh, 6);
    assert!(count > 0);
    assert_eq!(last, format!("draws that gave no sample and were replaced, up to step 6: {count}"));
    assert_eq!(recorded, count.to_string());
    run(&parts, &Start::Fresh, 3);
    let (_, resumed, recorded) = run(&parts, &Start::Resume, 6);
    assert_eq!((resumed, recorded), (last, count.to_string()));
}

/// The path of a preset says nothing about its content.
#[test]
fn weights_record_the_content_of_the_presets_that_they_were_trained_under() {
    let folder = tempfile::tempdir().unwrap();
    let (data, run) = (folder.path().join("data"), folder.path().join("run"));
    write_scenes(&data, 1);
    let preset = tiny_preset(folder.path());
    let config = CONFIG.replace("DATA", &data.join("train").to_string_lossy()).replace("PRESET", &preset);
    let trainer = Trainer::new(TrainConfig::from_toml(&config).unwrap(), &run, &Start::Fresh).unwrap();
    trainer.write_checkpoint().unwrap();
    let provenance = ModelWeights::read(&run.join(WEIGHTS)).unwrap().provenance;
    let expected = Preset::resolve(&preset).unwrap().hash().unwrap().to_string();
    for source in ["data[0].source", "evaluation.source"] {
        assert_eq!(provenance[&format!("{source}.dataset.preset-sha256")], expected);
        assert!(provenance.contains_key(&format!("{source}.dataset.scenes-sha256")), "{provenance:?}");
    }
}

/// The reader of chunks prefers `test` to `train`.
#[test]
fn training_on_a_folder_with_test_scenes_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_chunks(folder.path(), &[Split::Train, Split::Test]);
    let error = samples_of(folder.path()).unwrap_err().to_string();
    for expected in ["data[0].source.dataset.path", "train, without the test scenes in ", "test, found "] {
        assert!(error.contains(expected), "{error}");
    }
    samples_of(&folder.path().join("train")).unwrap();
}

#[test]
fn training_on_a_folder_with_test_scenes_alone_needs_its_name() {
    let folder = tempfile::tempdir().unwrap();
    write_chunks(folder.path(), &[Split::Test]);
    let test = folder.path().join("test");
    // A download that was stopped, for example.
    for with_empty_train in [false, true] {
        if with_empty_train {
            std::fs::create_dir(folder.path().join("train")).unwrap();
        }
        let error = samples_of(folder.path()).unwrap_err().to_string();
        let asked_for = format!("{} to train on those", test.display());
        for expected in
            ["data[0].source.dataset.path", asked_for.as_str(), "whose scene rooms-test-00000000 is in test"]
        {
            assert!(error.contains(expected), "{error}");
        }
    }
    samples_of(&test).unwrap();
}

/// Its scenes are unknown, so they may be among those that would be drawn. A folder without a dataset is fine.
#[test]
fn training_next_to_a_test_folder_that_cannot_be_opened_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_chunks(folder.path(), &[Split::Train, Split::Test]);
    let (train, test) = (folder.path().join("train"), folder.path().join("test"));
    std::fs::write(test.join("index.json"), "{\"a\": ").unwrap();
    // As `train` alone would be read.
    for chunks in [folder.path(), train.as_path()] {
        if chunks == train {
            std::fs::rename(&test, train.join("test")).unwrap();
        }
        let error = samples_of(chunks).unwrap_err();
        let error = error.to_string();
        assert!(error.starts_with("data[0].source.dataset.path: ") && error.contains("index.json"), "{error}");
    }
    std::fs::remove_dir_all(train.join("test")).unwrap();
    std::fs::create_dir(train.join("test")).unwrap();
    std::fs::write(train.join("test/notes.txt"), "hello world").unwrap();
    samples_of(&train).unwrap();
}

/// Chunks in the folder itself are read, whatever is in `test`.
#[test]
fn training_on_chunks_beside_test_scenes_is_allowed() {
    let folder = tempfile::tempdir().unwrap();
    write_chunks(folder.path(), &[Split::Train, Split::Test]);
    let train = folder.path().join("train");
    std::fs::rename(folder.path().join("test"), train.join("test")).unwrap();
    samples_of(&train).unwrap();
}

/// A preset that keeps the size of images, which nobody knows before one is read.
#[test]
fn images_of_another_scale_than_the_networks_are_refused_before_the_first_step() {
    let folder = tempfile::tempdir().unwrap();
    write_scenes(folder.path(), 1);
    let mut preset = Preset::named("re10k-2v-256").unwrap();
    preset.name = "any-size".to_owned();
    (preset.preprocessing.expected_size, preset.preprocessing.steps) = (None, vec![PatchCrop::new(16).into()]);
    let path = folder.path().join("preset.toml");
    std::fs::write(&path, preset.to_toml().unwrap()).unwrap();
    let data = folder.path().join("train").to_string_lossy().into_owned();
    let config = CONFIG.replace("DATA", &data).replace("PRESET", &path.to_string_lossy());
    let open = |side: u32| {
        let config = config.replace("resolution = [32, 32]", &format!("resolution = [{side}, {side}]"));
        let config = TrainConfig::from_toml(&config).unwrap();
        let opened = Trainer::new(config, &folder.path().join(format!("run-{side}")), &Start::Fresh);
        opened.map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(open(32), Ok(()));
    let refused = open(64).unwrap_err();
    let expected = "size of the images: expected the shorter side of the model's resolution, 64x64, found 32x32";
    assert!(refused.starts_with(&format!("training data: {data} under ")) && refused.ends_with(expected), "{refused}");
    assert!(!folder.path().join("run-64").exists());
}

/// Makes the images of a scene unreadable.
fn break_images(folder: &Path, number: u32) {
    let scene = folder.join("train").join(SceneSeed { split: Split::Train, number }.key(SceneKind::Rooms));
    for entry in std::fs::read_dir(scene).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.extension().is_some_and(|extension| extension == "png") {
            std::fs::write(entry, "no image").unwrap();
        }
    }
}

/// Simulated scenes of 12 frames as folders of images in `train`.
fn write_scenes(folder: &Path, count: u32) {
    write_scenes_of(folder, count, 12, 1);
}

/// Simulated scenes with numbers of frames and of rays per pixel.
fn write_scenes_of(folder: &Path, count: u32, frames: usize, samples: u32) {
    let size = atsplat_camera::ImageSize { width: 32, height: 32 };
    let scenes = (0..count).map(|number| {
        let seed = SceneSeed { split: Split::Train, number };
        Request { size, samples, frames, ..Request::new(SceneKind::Rooms, seed) }
    });
    let options = WriteOptions { layout: Layout::Re10k, encoding: ImageEncoding::Png, depth: false };
    write_dataset(folder, scenes, &options, &mut Warnings::new(), |_, _| ()).unwrap();
}

/// Path of a preset for their images: the published one at their size, so that nothing is cropped.
fn tiny_preset(folder: &Path) -> String {
    let text = Preset::text_of("re10k-2v-256").unwrap().replacen("name = \"re10k-2v-256\"", "name = \"tiny\"", 1);
    let text = text.replace("height = 256, width = 256", "height = 32, width = 32");
    let text = text.replace("expected-size = { width = 640, height = 360 }\n", "");
    let path = folder.join("tiny.toml");
    std::fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

/// One simulated scene of each split, as chunks in `train` and `test`.
fn write_chunks(folder: &Path, splits: &[Split]) {
    let size = atsplat_camera::ImageSize { width: 32, height: 32 };
    let scenes = splits.iter().map(|split| {
        let seed = SceneSeed { split: *split, number: 0 };
        Request { size, samples: 1, frames: 12, ..Request::new(SceneKind::Rooms, seed) }
    });
    let options = WriteOptions { layout: Layout::Chunks, encoding: ImageEncoding::Png, depth: false };
    write_dataset(folder, scenes, &options, &mut Warnings::new(), |_, _| ()).unwrap();
}

/// Opens the samples of a run on a dataset.
fn samples_of(path: &Path) -> Result<(), TrainError> {
    let folder = tempfile::tempdir().unwrap();
    let text = CONFIG.replace("DATA", &path.to_string_lossy()).replace("PRESET", &tiny_preset(folder.path()));
    TrainConfig::from_toml(&text).unwrap().samples(&mut Warnings::new()).map(drop)
}

/// Before the first and after the last step, with the scores of the evaluation's sample, reported and logged.
fn assert_evaluated_before_and_after(trainer: &Trainer, reported: &[EvaluationRecord], folder: &Path) {
    let [start, record] = reported else { panic!("{reported:?}") };
    let evaluation = trainer.evaluation().unwrap();
    let [sample] = evaluation.samples() else { panic!("{} samples", evaluation.samples().len()) };
    let render = evaluation.renders(&trainer.network().unwrap(), sample).unwrap().remove(0);
    let pairs = || render.samples().iter().zip(sample.targets.image(0));
    let squares: f64 = pairs().map(|(a, b)| (f64::from(a.clamp(0.0, 1.0)) - f64::from(*b)).powi(2)).sum();
    let psnr = -10.0 * (squares / pairs().count() as f64).log10();
    Tolerance::absolute(1e-6).assert([record.psnr], [psnr], "PSNR of the only target");
    assert_eq!((start.step, record.step, record.targets), (0, 6, 1));
    let logged: Vec<EvaluationRecord> = crate::logs::read(&folder.join("evaluations.jsonl")).unwrap();
    let bits = |records: &[EvaluationRecord]| records.iter().map(|record| record.psnr.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&logged), bits(reported));
}
