//! From real files to trials: overlap, extrapolation, built indices, hashes.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_camera::{Camera, Distortion, ImageSize, PoseNormalisation};
use atsplat_numeric::Tolerance;
use atsplat_pixels::DecodeLimits;
use atsplat_protocol::extrapolation::Extrapolation;
use atsplat_protocol::overlap::EpipolarRays;
use atsplat_protocol::trial::{DecodeAhead, Prefetch, SkipReason, TargetImages, Trial, TrialRecipe, Trials};
use atsplat_protocol::{
    DropReason, EvaluationIndex, Filters, IndexEntry, IndexFile, LensDistortion, NearFar, Preset, SamplingRule,
};
use atsplat_scene::nerfstudio::NerfstudioOptions;
use atsplat_scene::preprocess::Preprocessing;
use atsplat_scene::{Dataset, ImageFolder, OpenOptions, Scene, SceneError, SceneSource, Warnings, open, open_with};
use atsplat_tests::shared_data;

const RE10K_SCENE: &str = "000c3ab189999a83";

fn index(data: &Path, file: &str) -> EvaluationIndex {
    IndexFile::read(&data.join("index").join(file)).unwrap().index
}

fn opened(path: PathBuf) -> Arc<Dataset> {
    Arc::new(open(path, &mut Warnings::new()).unwrap())
}

fn re10k_cameras(data: &Path) -> Vec<Camera> {
    let source = opened(data.join("re10k").join(RE10K_SCENE));
    let scene = source.load(RE10K_SCENE, &mut Warnings::new()).unwrap();
    scene.frames.iter().map(|frame| frame.camera).collect()
}

/// One entry's index.
fn only(key: &str, context: &[usize], target: &[usize]) -> EvaluationIndex {
    let entry = IndexEntry { context: context.to_vec(), target: target.to_vec(), overlap: None };
    EvaluationIndex { scenes: [(key.to_owned(), vec![entry])].into_iter().collect() }
}

fn as_it_is() -> TrialRecipe {
    TrialRecipe {
        preprocessing: Preprocessing::default(),
        lens_distortion: LensDistortion::Used,
        pose_normalisation: PoseNormalisation::None,
        near_far: NearFar { near: 0.5, far: 100.0 },
        disparity_planes: None,
        filters: Filters::default(),
        decode_limits: DecodeLimits::default(),
        allow_absent_images: false,
    }
}

fn first(source: Arc<Dataset>, index: &EvaluationIndex, recipe: TrialRecipe) -> (Trial, TargetImages) {
    Trials::new(source, index, recipe, Prefetch::default()).next().unwrap().unwrap()
}

#[test]
fn the_ten_frame_split_of_the_six_view_index() {
    let Some(data) = shared_data("the_ten_frame_split_of_the_six_view_index") else { return };
    let six_views = index(&data, "depthsplat/dl3dv_start_0_distance_50_ctx_6v_video_0_50.json");
    let derivation = Preset::named("dl3dv-6v-extrapolation").unwrap().index.derivation.unwrap();
    let lengths = six_views.scenes.keys().map(|key| (key.clone(), 300)).collect();
    let report = Extrapolation::from(derivation).split(&six_views, &lengths);
    assert_eq!((report.started_at_zero, report.complete, report.shifted_earlier), (109, 140, 0));
    assert!(report.too_short.is_empty() && report.clipped.is_empty() && report.invalid.is_empty());
    for (key, entries) in &report.index.scenes {
        let (first, last) = entries[0].window().unwrap();
        assert_eq!(entries[0].target.len(), 20, "{key}");
        assert!(first >= 10 && last <= 69 && entries[0].target.iter().all(|t| *t < first || *t > last), "{key}");
    }
    // A window of 50 frames needs 70: of scenes that end sooner, none is scored and all are named.
    let short = six_views.scenes.keys().enumerate().map(|(n, key)| (key.clone(), if n % 2 == 0 { 69 } else { 70 }));
    let report = Extrapolation::from(derivation).split(&six_views, &short.collect());
    assert_eq!(report.complete + report.too_short.len(), 140);
    let whole_window = |key: &str| six_views.scenes[key][0].window() == Some((0, 49));
    assert!(report.too_short.iter().all(|key| whole_window(key)), "narrower windows fit");
    assert!(report.too_short.len() > 40, "{} dropped", report.too_short.len());
}

/// pixelSplat's generator walked from one context frame to the other while the overlap stayed at 0.6 or
/// more, so every frame on the way, in one of the two directions, must have that overlap here too.
#[test]
fn overlap_admits_the_pair_that_pixelsplat_published() {
    let Some(data) = shared_data("overlap_admits_the_pair_that_pixelsplat_published") else { return };
    let cameras = re10k_cameras(&data);
    let published = &index(&data, "pixelsplat/evaluation_index_re10k.json").scenes[RE10K_SCENE][0];
    let (a, b) = published.window().unwrap();
    assert_eq!((a, b), (9, 126));
    let rays = EpipolarRays::default();
    let overlap = |first: usize, second: usize| rays.overlap(&cameras[first], &cameras[second]).unwrap();
    let forwards = (a + 45..=b).all(|frame| overlap(a, frame) >= 0.6);
    let backwards = (a..=b - 45).all(|frame| overlap(b, frame) >= 0.6);
    assert!(forwards || backwards, "overlap of the pair: {}", overlap(a, b));
    // The grid hardly matters: four times as many rays move the number by less than a thousandth.
    let fine = EpipolarRays { grid: ImageSize { width: 640, height: 360 }, ..rays };
    let finer = fine.overlap(&cameras[a], &cameras[b]).unwrap();
    Tolerance::absolute(1e-3).assert([overlap(a, b)], [finer], "published grid against one ray a pixel");
}

/// The sampler that imitates pixelSplat's generator, on the real trajectory.
#[test]
fn overlap_pairs_of_a_real_scene_keep_their_promises() {
    let Some(data) = shared_data("overlap_pairs_of_a_real_scene_keep_their_promises") else { return };
    let cameras = re10k_cameras(&data);
    let source = opened(data.join("re10k").join(RE10K_SCENE));
    for (side, seed) in [("'inside'", 1), ("'outside', reach = 45", 2)] {
        let text = format!(
            "sampler = {{ sampler = 'overlap-pairs', seed = {seed}, targets = {{ side = {side}, count = 3 }} }}\n\
             overlap = {{ estimator = {{ estimator = 'epipolar-ray' }}, minimum = 0.6 }}"
        );
        let rule: SamplingRule = rule_of(&text);
        let built = rule.build(source.as_ref(), &|| (), &mut Warnings::new());
        let entry = &built.index.scenes[RE10K_SCENE][0];
        let (a, b) = entry.window().unwrap();
        assert!((45..=136).contains(&(b - a)));
        let measured = EpipolarRays::default().overlap(&cameras[a], &cameras[b]).unwrap();
        Tolerance::EXACT.assert(entry.overlap.iter().map(|overlap| overlap.value), [measured], "overlap in the index");
        let again = rule.build(source.as_ref(), &|| (), &mut Warnings::new());
        assert_eq!(again, built);
    }
}

fn rule_of(text: &str) -> SamplingRule {
    toml::from_str(text).unwrap()
}

/// A copy of the scene whose trajectory states the focal length of its 256×256 crops, not of 640×360.
fn with_the_crops_intrinsics(scene: &Path) -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    let name = format!("{RE10K_SCENE}.txt");
    let text = std::fs::read_to_string(scene.join(&name)).unwrap();
    let crops = text.replace(" 0.482334223 ", &format!(" {:.9} ", 0.482_334_223 * 640.0 / 360.0));
    std::fs::write(copy.path().join(name), crops).unwrap();
    std::fs::create_dir(copy.path().join("images")).unwrap();
    for image in std::fs::read_dir(scene.join("images")).unwrap() {
        let image = image.unwrap();
        std::fs::copy(image.path(), copy.path().join("images").join(image.file_name())).unwrap();
    }
    copy
}

#[test]
fn a_chunk_and_a_trajectory_with_frames_make_the_same_trial() {
    let Some(data) = shared_data("a_chunk_and_a_trajectory_with_frames_make_the_same_trial") else { return };
    let published = only(RE10K_SCENE, &[9, 126], &[29, 30, 46]);
    let as_stated = opened(data.join("re10k").join(RE10K_SCENE));
    let skipped = Trials::new(as_stated, &published, as_it_is(), Prefetch::default()).next().unwrap().unwrap_err();
    assert_eq!(skipped.reason, SkipReason::ImageMisfit, "squares under the intrinsics of the whole image");
    let (from_chunk, images) = first(opened(data.join("re10k/chunk")), &published, as_it_is());
    let corrected = with_the_crops_intrinsics(&data.join("re10k").join(RE10K_SCENE));
    let (from_crops, _) = first(opened(corrected.path().to_path_buf()), &published, as_it_is());
    assert_eq!(from_crops.pose_hash(), from_chunk.pose_hash());
    assert_eq!(from_crops.hash(), from_chunk.hash());
    for (text, chunk) in from_crops.targets().iter().zip(from_chunk.targets()) {
        let [text, chunk] = [text, chunk].map(|view| view.camera.camera_from_world.to_rows());
        Tolerance::F32_ROUND_TRIP.assert(text, chunk, "target pose");
    }
    let image = images.get(2).unwrap().unwrap();
    assert_eq!((image.width(), image.height()), (256, 256));
    let (other, _) = first(opened(data.join("re10k/chunk")), &only(RE10K_SCENE, &[9, 127], &[29, 30, 46]), as_it_is());
    assert_ne!(other.pose_hash(), from_chunk.pose_hash(), "another frame");
}

/// The copy on disk holds 256×256 crops; the published loader drops every scene that is not 360×640.
#[test]
fn the_preset_drops_images_of_another_size() {
    let Some(data) = shared_data("the_preset_drops_images_of_another_size") else { return };
    let recipe = TrialRecipe::of(&Preset::named("re10k-2v-256").unwrap(), "pixelSplat");
    let index = index(&data, "pixelsplat/evaluation_index_re10k.json");
    let scenes = index.scenes.into_iter();
    let first_hundred = EvaluationIndex {
        scenes: scenes.enumerate().filter(|(n, (key, _))| *n < 99 || key == RE10K_SCENE).map(|(_, one)| one).collect(),
    };
    let mut trials = Trials::new(opened(data.join("re10k/chunk")), &first_hundred, recipe, Prefetch::default());
    trials.by_ref().for_each(drop);
    let counts = trials.report().counts();
    let of = |reason| counts.get(&reason).copied().unwrap_or_default();
    let nulls = first_hundred.scenes.values().filter(|entries| entries.is_empty()).count();
    let holds_the_scene = usize::from(first_hundred.scenes.contains_key(RE10K_SCENE));
    assert_eq!(of(SkipReason::NullEntry), nulls);
    assert_eq!(of(SkipReason::Dropped(DropReason::ImageSize)), holds_the_scene);
    assert_eq!(of(SkipReason::Dropped(DropReason::SceneMissing)), 100 - nulls - holds_the_scene);
    assert_eq!((holds_the_scene, trials.report().trials), (1, 0));
}

/// A capture in DL3DV's layout, an index sampled as DepthSplat sampled its own, trials of that protocol.
#[test]
fn trials_of_the_six_view_protocol_from_a_sampled_index() {
    let Some(data) = shared_data("trials_of_the_six_view_protocol_from_a_sampled_index") else { return };
    let nerfstudio = NerfstudioOptions { images: ImageFolder::Downscaled(8), ..NerfstudioOptions::default() };
    let options = OpenOptions { nerfstudio, ..OpenOptions::default() };
    let source = Arc::new(open_with(data.join("dl3dv_like"), &options, &mut Warnings::new()).unwrap());
    let rule: SamplingRule = rule_of(
        "sampler = { sampler = 'farthest-point', window = 50, context-views = 6, targets = { rule = 'window' } }",
    );
    let built = rule.build(source.as_ref(), &|| (), &mut Warnings::new());
    assert_eq!((built.scenes, built.entries), (1, 1));
    let recipe = TrialRecipe::of(&Preset::named("dl3dv-6v-256x448").unwrap(), "ATSplat");
    let prefetch = Prefetch { decode: DecodeAhead::Context, ..Prefetch::default() };
    let mut trials = Trials::new(source, &built.index, recipe, prefetch);
    let (trial, images) = trials.next().unwrap().unwrap();
    assert_eq!((trial.context().len(), trial.targets().len(), images.len()), (6, 50, 50));
    assert_eq!(trial.targets().iter().filter(|view| view.label.leaked).count(), 6);
    let size = ImageSize { width: 448, height: 256 };
    assert!(trial.targets().iter().all(|view| view.size == size));
    let image = trial.context()[5].image().unwrap();
    assert_eq!((image.width(), image.height()), (448, 256));
    let farthest = trial.context().iter().flat_map(|view| view.camera.camera_from_world.inverse().centre().to_array());
    let farthest = farthest.map(f64::abs).fold(0.0, |most: f64, x| if x > most { x } else { most });
    Tolerance::F64.assert([farthest], [1.0], "the mean camera's scale");
    assert!(trials.next().is_none());
    assert_eq!(trials.report().trials, 1);
}

/// The fox's lens bends: a trial of the same cameras as pinholes asks another question.
#[test]
fn the_lens_is_part_of_the_trial_and_not_of_its_poses() {
    struct Pinholes(Arc<Dataset>);
    impl SceneSource for Pinholes {
        fn keys(&self) -> &[String] {
            self.0.keys()
        }

        fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
            let mut scene = self.0.load(key, warnings)?;
            for frame in &mut scene.frames {
                assert!(matches!(frame.camera.distortion, Distortion::OpenCv { k1, .. } if k1.abs() > 1e-3));
                frame.camera.distortion = Distortion::None;
            }
            Ok(scene)
        }
    }
    let Some(data) = shared_data("the_lens_is_part_of_the_trial") else { return };
    let fox = opened(data.join("fox"));
    let key = fox.keys().first().unwrap().clone();
    let scene = fox.load(&key, &mut Warnings::new()).unwrap();
    let there = scene.frames.iter().enumerate().filter(|(_, frame)| !frame.image.is_missing());
    let positions: Vec<usize> = there.map(|(at, _)| at).take(3).collect();
    let index = only(&key, &positions[..2], &positions[2..]);
    let trial = |source: Arc<dyn SceneSource>| {
        let cameras_only = Prefetch { decode: DecodeAhead::Nothing, ..Prefetch::default() };
        Trials::new(source, &index, as_it_is(), cameras_only).next().unwrap().unwrap().0
    };
    let (bent, straight) = (trial(Arc::clone(&fox) as Arc<dyn SceneSource>), trial(Arc::new(Pinholes(fox))));
    assert_ne!(bent.hash(), straight.hash());
    assert_eq!(bent.pose_hash(), straight.pose_hash());
}
