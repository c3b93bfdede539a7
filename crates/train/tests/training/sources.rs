//! Samples are a function of seed and number, in the network's frame.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use atsplat_camera::{ImageSize, MeanCameraScale, PoseNormalisation};
use atsplat_files::Sha256Digest;
use atsplat_numeric::{Extremes as _, Tolerance};
use atsplat_protocol::Preset;
use atsplat_rooms::{ImageEncoding, Layout, Request, SceneKind, SceneSeed, Split, WriteOptions, write_dataset};
use atsplat_scene::{WarningKind, Warnings};
use atsplat_train::TrainError;
use atsplat_train::samples::{
    DatasetConfig, DatasetSource, ExcludedScenes, Mixture, PatchDistances, ReplacedDraws, RoomsConfig, RoomsSource,
    Sample, SampleId, Source, ViewChoice, mirrored,
};
use glam::{DVec2, DVec3};
use tempfile::tempdir;

use crate::common::sample;

pub(crate) const RULE: PoseNormalisation = PoseNormalisation::mean_camera(MeanCameraScale::LongLrm);
const VIEWS: &str = "{ context = [2, 2], targets = 3, gaps = { min = 3, max = 5 }, inset = 1 }";

fn rooms(scenes: u32, more: &str) -> RoomsSource {
    let text = format!(
        "scenes-of = 'rooms'\nscenes = {scenes}\nsize = [32, 32]\nsamples = 1\nstride = 10\n{more}\nviews = {VIEWS}"
    );
    RoomsSource::new(toml::from_str::<RoomsConfig>(&text).unwrap(), RULE)
}

fn id(number: u64) -> SampleId {
    SampleId { seed: 4, number, step: 0 }
}

fn same(a: &Sample, b: &Sample) -> bool {
    (&a.name, &a.context, &a.targets) == (&b.name, &b.context, &b.targets)
}

fn assert_normalised(sample: &Sample) {
    let cameras = sample.context.cameras.iter();
    let largest = cameras.flat_map(|camera| camera.camera_from_world.inverse().centre().to_array().map(f64::abs));
    Tolerance::F64.assert([largest.fold(0.0, f64::maximum_of)], [1.0], "Long-LRM's scale");
}

#[test]
fn a_sample_is_a_function_of_its_draw() {
    let (source, small) = (rooms(3, ""), rooms(3, "cache-mib = 0"));
    for number in [0, 5, 2, 5, 0] {
        let sample = source.sample(id(number)).unwrap();
        assert!(same(&sample, &rooms(3, "").sample(id(number)).unwrap()), "a fresh source");
        assert!(same(&sample, &small.sample(id(number)).unwrap()), "a source without a cache");
        let other = source.sample(SampleId { seed: 5, ..id(number) }).unwrap();
        assert!(!same(&sample, &other), "another seed");
        assert_normalised(&sample);
    }
}

/// What one context view shows at its exact distances is, seen from the other view, where that view's distances say.
#[test]
fn distances_of_both_views_agree_about_the_scene() {
    let source = rooms(3, "").with_distances(NonZeroUsize::MIN);
    let sample = source.sample(id(1)).unwrap();
    let PatchDistances { columns, distances } = sample.distances.clone().unwrap();
    assert_eq!((columns, distances.len()), (32, 2 * 32 * 32));
    let size = ImageSize { width: 32, height: 32 };
    let [first, second] = [0, 1].map(|view| sample.context.cameras[view]);
    let mut errors = Vec::new();
    for (at, distance) in distances[..32 * 32].iter().map(|distance| f64::from(*distance)).enumerate() {
        let pixel = DVec2::new((at % 32) as f64 + 0.5, (at / 32) as f64 + 0.5);
        let k = first.intrinsics.pixel_from_normalized(size);
        let ray = DVec3::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy, 1.0).normalize();
        let point = first.camera_from_world.inverse().transform_point(ray * distance);
        let seen = second.camera_from_world.transform_point(point);
        let k = second.intrinsics.pixel_from_normalized(size);
        let [x, y] = [k.fx * seen.x / seen.z + k.cx, k.fy * seen.y / seen.z + k.cy];
        if seen.z > 0.0 && (0.0..32.0).contains(&x) && (0.0..32.0).contains(&y) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a pixel of the image")]
            let there = f64::from(distances[32 * 32 + y as usize * 32 + x as usize]);
            errors.push((there / seen.length()).ln().abs());
        }
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors.len() > 300, "{} pixels are in both views", errors.len());
    let median = errors[errors.len() / 2];
    assert!(median < 0.02, "half a pixel apart, surfaces are at nearly the same distance: {median}");
    let flipped = mirrored(&sample).unwrap().distances.unwrap().distances;
    assert!((0..32).all(|x| flipped[x].to_bits() == distances[31 - x].to_bits()));
}

#[test]
fn training_and_test_scenes_differ() {
    let train = rooms(1, "").sample(id(0)).unwrap();
    let test = rooms(1, "split = 'test'").sample(id(0)).unwrap();
    assert!(train.name.contains("train") && test.name.contains("test"));
    assert_ne!(train.context.images, test.context.images);
}

/// A source whose samples have its name and are noise.
#[derive(Debug)]
struct Named(&'static str);

impl Source for Named {
    fn name(&self) -> String {
        self.0.to_owned()
    }

    fn sample(&self, id: SampleId) -> Result<Sample, TrainError> {
        let sample = sample(id.number);
        Ok(Sample { name: format!("{}, {}", self.0, sample.name), ..sample })
    }
}

#[test]
fn a_mixture_follows_its_shares_mirrors_half_and_repeats() {
    let mixture = |flips, distinct| {
        let sources: Vec<(f64, Box<dyn Source>)> =
            vec![(3.0, Box::new(Named("training"))), (1.0, Box::new(Named("test")))];
        Mixture::new(sources, flips, distinct).unwrap()
    };
    let (flipping, straight) = (mixture(true, None), mixture(false, None));
    assert_eq!(straight.name(), "3 × training + 1 × test");
    let names: Vec<String> = (0..200).map(|number| flipping.sample(id(number)).unwrap().name).collect();
    let count = |word: &str| names.iter().filter(|name| name.contains(word)).count();
    assert!((30..=70).contains(&count("test")), "{} of 200 from a share of a quarter", count("test"));
    assert!((70..=130).contains(&count("mirrored")), "{} of 200 are mirrored", count("mirrored"));
    assert!((0..50).all(|number| !straight.sample(id(number)).unwrap().name.contains("mirrored")));
    let repeating = mixture(true, Some(3));
    assert!(same(&repeating.sample(id(1)).unwrap(), &repeating.sample(id(7)).unwrap()));
    for (number, name) in (0..).zip(&names) {
        assert_eq!(flipping.source_of(id(number)), usize::from(name.contains("test")), "{name}");
        assert_eq!(repeating.source_of(id(number)), flipping.source_of(id(number % 3)), "{number}");
    }
    assert!(Mixture::new(Vec::new(), false, None).is_err());
    assert!(Mixture::new(vec![(0.0, Box::new(Named("training")))], false, None).is_err());
}

/// Parts of a mixture may differ in their views alone. Draws depend on the scenes and their size, whatever the record says:
/// these are the scenes that every version drew.
#[test]
fn names_state_views_and_draws_do_not_depend_on_them() {
    let source = |views: &str| {
        let text = "scenes-of = 'rooms'\nscenes = 500\nsize = [32, 32]\nsamples = 1\nstride = 10\nviews = ";
        RoomsSource::new(toml::from_str::<RoomsConfig>(&format!("{text}{views}")).unwrap(), RULE)
    };
    let warm_up = "initial-min = 4, initial-max = 8, warm-up-steps = 7";
    let two = source("{ context = [2, 2], targets = 3, gaps = { min = 4, max = 5 }, inset = 1 }");
    let more = source(&format!("{{ context = [2, 4], targets = 2, gaps = {{ min = 6, max = 9, {warm_up} }} }}"));
    assert_eq!(two.name(), "rooms train 0 to 499 at 32x32 (2 views, gaps 4 to 5, targets 3, stride 10, generation 2)");
    let expected =
        "rooms train 0 to 499 at 32x32 (2 to 4 views, gaps 4 to 8, then 6 to 9, targets 2, stride 10, generation 2)";
    assert_eq!(more.name(), expected);
    for (number, scene) in (0..).zip([318, 459, 220]) {
        for source in [&two, &more] {
            let name = source.sample(id(number)).unwrap().name;
            assert!(name.starts_with(&format!("rooms-train-{scene:08}, frames ")), "{number}: {name}");
        }
    }
}

/// Windows of three frames have two inside: a third of the draws, which other draws replace.
#[test]
fn draws_of_simulated_scenes_with_too_few_targets_are_counted() {
    let source = rooms(1, "");
    for number in 0..12 {
        source.sample(id(number)).unwrap();
    }
    let replaced = source.replaced();
    let reason = "rooms-train-00000000: needs 3 target frames, has 2 candidates";
    assert_eq!(replaced.scenes, BTreeMap::from([("rooms-train-00000000".to_owned(), reason.to_owned())]));
    assert_eq!((replaced.count, source.replaced_count()), (7, 7));
}

/// Samples from files have the same sizes and scale as from the simulation.
#[test]
fn a_dataset_on_disk_gives_samples() {
    let folder = tempdir().unwrap();
    let data = folder.path().join("data");
    let config = rooms_on_disk(folder.path());
    let open = || DatasetSource::open(config.clone(), RULE, &mut Warnings::new()).unwrap();
    let name = format!("{} under {} (2 views, gaps 4 to 9, targets 3)", config.path.display(), config.preset);
    assert_eq!(open().name(), name);
    let simulated = rooms(1, "").sample(id(0)).unwrap();
    for number in 0..4 {
        let sample = open().sample(id(number)).unwrap();
        assert!(same(&sample, &open().sample(id(number)).unwrap()));
        assert_eq!((sample.context.cameras.len(), sample.targets.cameras.len()), (2, 3));
        assert_eq!((sample.context.size, sample.targets.size), (simulated.context.size, simulated.targets.size));
        assert_normalised(&sample);
        assert!(sample.context.images.iter().all(|value| (0.0..=1.0).contains(value)));
        assert!(sample.context.images.iter().any(|value| *value > 0.1));
        assert_eq!(sample.nearest().len(), 3);
    }
    let (before, moved) = (open().sample(id(1)).unwrap(), folder.path().join("moved"));
    std::fs::rename(&data, &moved).unwrap();
    let config = DatasetConfig { path: moved.join("train"), ..config };
    let open = || DatasetSource::open(config.clone(), RULE, &mut Warnings::new()).unwrap();
    assert!(same(&before, &open().sample(id(1)).unwrap()), "elsewhere, the same data gives the same samples");
    // By the rule that was given, not by the preset's, which has another scale.
    let rule = PoseNormalisation::BaselineOne { minimum: 0.0, maximum: None };
    let sample = DatasetSource::open(config.clone(), rule, &mut Warnings::new()).unwrap().sample(id(0)).unwrap();
    let centres = [0, 1].map(|view| sample.context.cameras[view].camera_from_world.inverse().centre());
    Tolerance::F64.assert([(centres[1] - centres[0]).length()], [1.0], "the baseline");
    let absent = DatasetConfig { path: folder.path().join("absent"), ..config.clone() };
    let error = DatasetSource::open(absent, RULE, &mut Warnings::new()).unwrap_err().to_string();
    assert!(error.starts_with("path: ") && error.contains("absent"), "{error}");
    let absent = DatasetConfig { preset: "absent.toml".to_owned(), ..config.clone() };
    let error = DatasetSource::open(absent, RULE, &mut Warnings::new()).unwrap_err().to_string();
    assert!(error.starts_with("preset: ") && error.contains("absent.toml"), "{error}");
    let mut impossible = config;
    impossible.views.gaps.min = 500;
    impossible.views.gaps.max = 600;
    let error = DatasetSource::open(impossible, RULE, &mut Warnings::new()).unwrap().sample(id(0)).unwrap_err();
    assert!(error.to_string().contains("needs"), "{error}");
}

/// In subsets of scenes, as in DL3DV's training set (`1K/<hash>/…`), keys have a prefix that the evaluation indices do not have.
#[test]
fn scenes_are_excluded_with_and_without_the_prefix_of_dl3dv() {
    let folder = tempdir().unwrap();
    let (data, index) = (folder.path().join("train"), folder.path().join("index.json"));
    for hash in ["aaa", "bbb", "ccc"] {
        let scene = data.join("1K").join(hash);
        std::fs::create_dir_all(&scene).unwrap();
        std::fs::write(scene.join("transforms.json"), "{}").unwrap();
    }
    let views: BTreeMap<String, ViewChoice> = toml::from_str(&format!("v = {VIEWS}")).unwrap();
    for (path, test_scenes, trained_on, count) in [
        (data.clone(), r#"{"bbb": null}"#, vec!["dl3dv_aaa", "dl3dv_ccc"], "1 of 3"),
        (data.clone(), r#"{"dl3dv_bbb": null, "ccc": null}"#, vec!["dl3dv_aaa"], "2 of 3"),
        (data.clone(), r#"{"ddd": null}"#, vec!["dl3dv_aaa", "dl3dv_bbb", "dl3dv_ccc"], "0 of 3"),
        (data.join("1K"), r#"{"dl3dv_bbb": null}"#, vec!["aaa", "ccc"], "1 of 3"),
    ] {
        std::fs::write(&index, test_scenes).unwrap();
        let sha256 = Sha256Digest::of(test_scenes.as_bytes());
        let config = DatasetConfig {
            path: path.clone(),
            preset: "dl3dv-2v-256x448".to_owned(),
            images: None,
            frames: None,
            prefer_undistorted: false,
            views: views["v"].clone(),
            exclude: vec![ExcludedScenes { index: index.clone(), sha256 }],
        };
        let source = DatasetSource::open(config, RULE, &mut Warnings::new()).unwrap();
        assert_eq!(source.keys(), trained_on);
        let expected = format!("{}: {count} scenes excluded by {}", path.display(), index.display());
        assert_eq!(source.notices(), std::slice::from_ref(&expected));
        let mixture = Mixture::new(vec![(1.0, Box::new(source))], false, None).unwrap();
        assert_eq!(mixture.notices(), [expected], "of a run's data");
    }
}

/// Whether its header or its content is damaged, an image is counted once, and the samples are of other frames.
#[test]
fn unreadable_images_of_a_dataset_are_counted_once_each() {
    let folder = tempdir().unwrap();
    let config = rooms_on_disk(folder.path());
    let image = |key: &str, frame: usize| -> PathBuf {
        let entries = std::fs::read_dir(config.path.join(key)).unwrap().map(|entry| entry.unwrap().path());
        let numbered = |path: PathBuf| Some((path.file_stem()?.to_str()?.parse::<u64>().ok()?, path));
        let frames: BTreeMap<u64, PathBuf> = entries.filter_map(numbered).collect();
        assert_eq!(frames.len(), 12, "{key}");
        frames.into_values().nth(frame).unwrap()
    };
    let keys = ["rooms-train-00000000", "rooms-train-00000001"];
    std::fs::write(image(keys[0], 5), b"no image").unwrap();
    let (cut, whole) = (image(keys[1], 6), std::fs::read(image(keys[1], 6)).unwrap());
    std::fs::write(cut, &whole[..whole.len() / 2]).unwrap();
    let source = DatasetSource::open(config, RULE, &mut Warnings::new()).unwrap();
    let before = source.warnings().total();
    let names: Vec<String> = (0..40).map(|number| source.sample(id(number)).unwrap().name).collect();
    assert!(keys.iter().all(|key| names.iter().any(|name| name.starts_with(*key))), "{names:?}");
    let warnings = source.warnings();
    assert_eq!((before, warnings.count(WarningKind::UnreadableImage)), (0, 2), "{:?}", warnings.kept());
    let unreadable = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::UnreadableImage);
    let mut found: Vec<(&str, bool)> = unreadable
        .map(|warning| {
            let frame = if warning.scene == keys[0] { "frame 5 " } else { "frame 6 " };
            (warning.scene.as_str(), warning.detail.starts_with(frame))
        })
        .collect();
    found.sort_unstable();
    assert_eq!(found, keys.map(|key| (key, true)));
}

/// A reason that the place alone does not tell.
#[test]
fn draws_of_a_missing_image_say_that_it_is_missing() {
    let folder = tempdir().unwrap();
    let config = rooms_of(folder.path(), [12, 4]);
    let images = std::fs::read_dir(config.path.join("rooms-train-00000000")).unwrap();
    for image in images.map(|entry| entry.unwrap().path()) {
        std::fs::remove_file(image).unwrap();
    }
    let source = DatasetSource::open(config, RULE, &mut Warnings::new()).unwrap();
    source.sample(id(0)).unwrap_err();
    let replaced = source.replaced().scenes["rooms-train-00000000"].clone();
    assert!(replaced.contains(": image-missing: frame "), "{replaced}");
}

/// A capture at twice the preset's size, with a smaller copy of its images.
#[test]
fn a_dataset_is_read_from_the_chosen_copy_of_its_images() {
    let folder = tempdir().unwrap();
    let (data, smaller) = (folder.path().join("capture"), folder.path().join("smaller"));
    for (folder, side) in [(&data, 64), (&smaller, 32)] {
        let mut request = Request::new(SceneKind::Rooms, SceneSeed { split: Split::Train, number: 0 });
        request.size = ImageSize { width: side, height: side };
        (request.samples, request.frames) = (1, 12);
        let options = WriteOptions { layout: Layout::Nerfstudio, encoding: ImageEncoding::Png, depth: false };
        write_dataset(folder, vec![request], &options, &mut Warnings::new(), |_, _| ()).unwrap();
    }
    let capture = |folder: &Path| folder.join("rooms-train-00000000/nerfstudio");
    std::fs::rename(capture(&smaller).join("images"), capture(&data).join("images_2")).unwrap();
    let config = rooms_on_disk(folder.path());
    let text = std::fs::read_to_string(&config.preset).unwrap();
    let preset = folder.path().join("sized.toml");
    std::fs::write(&preset, format!("{text}\n[preprocessing.expected-size]\nwidth = 32\nheight = 32\n")).unwrap();
    let preset = preset.to_string_lossy().into_owned();
    let open = |images| {
        let config = DatasetConfig { path: data.clone(), preset: preset.clone(), images, ..config.clone() };
        DatasetSource::open(config, RULE, &mut Warnings::new()).unwrap()
    };
    for images in [None, Some(1)] {
        let error = open(images).sample(id(0)).unwrap_err().to_string();
        assert!(error.ends_with("is 64×64, expected 32×32"), "{error}");
    }
    let source = open(Some(2));
    assert_eq!(source.sample(id(0)).unwrap().context.size, atsplat_model::ImageSize::new(32, 32));
    assert!(source.name().ends_with("targets 3, images 2)"), "{}", source.name());

    // Without the listed folder, the copy of the preset's size is read, not the largest.
    let rename = |from: &str, to: &str| std::fs::rename(capture(&data).join(from), capture(&data).join(to)).unwrap();
    rename("images_2", "images_4");
    rename("images", "images_2");
    assert_eq!(open(None).sample(id(0)).unwrap().context.size, atsplat_model::ImageSize::new(32, 32));

    // Trajectories have one folder of images.
    let other = DatasetConfig { images: Some(2), ..config.clone() };
    let error = DatasetSource::open(other, RULE, &mut Warnings::new()).unwrap_err().to_string();
    let expected = "expected captures of nerfstudio or COLMAP, found a dataset in the format re10k";
    assert!(error.starts_with("images: dataset: ") && error.ends_with(expected), "{error}");
    // So that checkpoints and weights of runs without them stay as they are.
    let text = toml::to_string(&config).unwrap();
    assert!(["images", "frames", "prefer-undistorted"].iter().all(|field| !text.contains(field)), "{text}");
}

/// The scene's loading warns of it; its image can be read.
#[test]
fn a_frame_without_a_pose_is_not_counted_as_an_unreadable_image() {
    let folder = tempdir().unwrap();
    let config = rooms_on_disk(folder.path());
    let trajectory = config.path.join("rooms-train-00000000.txt");
    let text = std::fs::read_to_string(&trajectory).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    let line = lines.iter_mut().nth_back(6).unwrap();
    let fields = line.split(' ').take(7).chain(["NaN"; 12]);
    *line = fields.collect::<Vec<_>>().join(" ");
    std::fs::write(&trajectory, lines.join("\n")).unwrap();
    let source = DatasetSource::open(config, RULE, &mut Warnings::new()).unwrap();
    for number in 0..40 {
        source.sample(id(number)).unwrap();
    }
    let warnings = source.warnings();
    let counts = [WarningKind::BadCamera, WarningKind::UnreadableImage].map(|kind| warnings.count(kind));
    assert_eq!(counts, [1, 0], "{:?}", warnings.kept());
    assert!(source.replaced().scenes.contains_key("rooms-train-00000000"), "{}", source.replaced());
}

/// Other scenes replace one that no window fits, and it is counted.
#[test]
fn draws_of_scenes_with_too_few_frames_are_counted() {
    let folder = tempdir().unwrap();
    let config = rooms_of(folder.path(), [12, 4]);
    let source = DatasetSource::open(config, RULE, &mut Warnings::new()).unwrap();
    assert_eq!(source.replaced(), ReplacedDraws::default());
    let names: Vec<String> = (0..20).map(|number| source.sample(id(number)).unwrap().name).collect();
    assert!(names.iter().all(|name| name.starts_with("rooms-train-00000000")), "{names:?}");
    let replaced = source.replaced();
    assert!((2..100).contains(&replaced.count), "{replaced}");
    let reason = "rooms-train-00000001: needs 5 frames, has 4";
    assert_eq!(replaced.scenes, BTreeMap::from([("rooms-train-00000001".to_owned(), reason.to_owned())]));
    assert!(
        replaced
            .to_string()
            .ends_with(&format!("draws of 1 scene replaced because they gave no sample, such as {reason}")),
        "{replaced}"
    );
    let mixture = Mixture::new(vec![(1.0, Box::new(source))], false, None).unwrap();
    assert_eq!(mixture.replaced(), replaced, "of a run's data");
    let simulated = rooms(1, "");
    for number in 0..12 {
        simulated.sample(id(number)).unwrap();
    }
    let sources: Vec<(f64, Box<dyn Source>)> = vec![(1.0, Box::new(mixture)), (1.0, Box::new(simulated))];
    let both = Mixture::new(sources, false, None).unwrap();
    assert_eq!([both.replaced_count(), both.replaced().count], [replaced.count + 7; 2], "of both sources");
}

/// Two scenes of 12 frames in `data`, and a preset for their images.
fn rooms_on_disk(folder: &Path) -> DatasetConfig {
    rooms_of(folder, [12, 12])
}

/// Two scenes with this many frames each.
pub(crate) fn rooms_of(folder: &Path, frames: [usize; 2]) -> DatasetConfig {
    let (data, preset) = (folder.join("data"), folder.join("tiny.toml"));
    write_rooms(&data, frames);
    // The published preset at the test's image size, so that nothing is cropped.
    let text = Preset::text_of("re10k-2v-256").unwrap().replacen("name = \"re10k-2v-256\"", "name = \"tiny\"", 1);
    let text = text.replace("height = 256, width = 256", "height = 32, width = 32");
    let text = text.replace("expected-size = { width = 640, height = 360 }\n", "");
    std::fs::write(&preset, text).unwrap();
    let views = VIEWS.replace("min = 3, max = 5", "min = 4, max = 9");
    let views: BTreeMap<String, ViewChoice> = toml::from_str(&format!("v = {views}")).unwrap();
    DatasetConfig {
        path: data.join("train"),
        preset: preset.to_string_lossy().into_owned(),
        images: None,
        frames: None,
        prefer_undistorted: false,
        views: views["v"].clone(),
        exclude: Vec::new(),
    }
}

fn write_rooms(folder: &Path, frames: [usize; 2]) {
    let requests: Vec<Request> = [(0, frames[0]), (1, frames[1])]
        .map(|(number, frames)| {
            let mut request = Request::new(SceneKind::Rooms, SceneSeed { split: Split::Train, number });
            request.size = ImageSize { width: 32, height: 32 };
            (request.samples, request.frames) = (1, frames);
            request
        })
        .into();
    let options = WriteOptions { layout: Layout::Re10k, encoding: ImageEncoding::Png, depth: false };
    write_dataset(folder, requests, &options, &mut Warnings::new(), |_, _| ()).unwrap();
}
