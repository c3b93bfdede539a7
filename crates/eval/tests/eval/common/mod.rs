//! Scenes of a painted wall, whose images are known in closed form, and runs on them.

pub(crate) mod methods;
pub(crate) mod shell;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_eval::EvalError;
use atsplat_eval::method::{Method, NearestView, Rendered, Warp};
use atsplat_eval::runner::{
    Dataset, KeepImages, Plan, PlannedIndex, Selection, current_provenance, named_metrics, run,
};
use atsplat_eval::timing::TimingPlan;
use atsplat_files::Sha256Digest;
use atsplat_metrics::learned::{LpipsNetwork, Step};
use atsplat_metrics::{Networks, Suite};
use atsplat_model::weights::{StoredTensor, StoredTensors};
use atsplat_pixels::{Image, ImageU8, encode_png};
use atsplat_protocol::trial::Prefetch;
use atsplat_protocol::{EvaluationIndex, IndexEntry, Preset};
use atsplat_results::RunCounts;
use atsplat_results::{MethodRecord, Results, Store, TargetRow, TrialRow};
use atsplat_scene::{Frame, FrameImage, Scene, SceneError, SceneSource, SharedBytes, WarningKind, Warnings};
use glam::{DMat3, DVec3};

pub(crate) const SIZE: ImageSize = ImageSize { width: 64, height: 64 };
/// Depth of the wall in every camera.
pub(crate) const WALL: f64 = 4.0;

/// Cameras side by side that look along +z at a wall with waves of colour.
pub(crate) struct Walls {
    pub(crate) keys: Vec<String>,
    pub(crate) frames: usize,
    /// Scene and frame whose image file is truncated.
    pub(crate) damaged: Option<(usize, usize)>,
    /// Scene and frame whose image is changed in brightness, and by how much.
    pub(crate) brighter: Option<(usize, usize, i16)>,
    /// Whether every seventh frame's image is missing.
    pub(crate) gaps: bool,
    /// Scenes and frames whose image shows another scene.
    pub(crate) replaced: Vec<(usize, usize)>,
    /// Whether cameras stand together more closely than where the images were taken.
    pub(crate) close: bool,
    /// Whether loading a scene emits a warning.
    pub(crate) warns: bool,
}

impl Walls {
    pub(crate) fn new(scenes: usize, frames: usize) -> Self {
        Self {
            keys: (0..scenes).map(|scene| format!("wall-{scene}")).collect(),
            frames,
            damaged: None,
            brighter: None,
            gaps: false,
            replaced: Vec::new(),
            close: false,
            warns: false,
        }
    }
}

pub(crate) fn camera(frame: usize) -> Camera {
    camera_at(0.2 * frame as f64)
}

fn camera_at(x: f64) -> Camera {
    let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
    Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap())
}

fn colour(scene: usize, point: DVec3) -> [f64; 3] {
    let wave = |a: f64, b: f64| 0.5 + 0.35 * (a * point.x + b * point.y + scene as f64).sin();
    [wave(2.5, 0.7), wave(-1.1, 2.3), wave(1.7, 1.9)]
}

pub(crate) fn image(scene: usize, frame: usize) -> ImageU8 {
    let projector = camera(frame).projector().unwrap();
    let mut samples = Vec::new();
    for ray in projector.pixel_rays(SIZE, atsplat_camera::DirectionScale::UnitDepth).unwrap() {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours are in [0, 1]")]
        samples.extend(colour(scene, ray.unwrap().at(WALL)).map(|value| (255.0 * value).round() as u8));
    }
    ImageU8::new(SIZE.width, SIZE.height, samples).unwrap()
}

impl SceneSource for Walls {
    fn keys(&self) -> &[String] {
        &self.keys
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        if self.warns {
            warnings.push(WarningKind::OffCentrePrincipalPoint, key, "for the test");
        }
        let scene = self.keys.iter().position(|known| known == key);
        let scene = scene.ok_or_else(|| SceneError::UnknownScene { key: key.to_owned(), path: "walls".into() })?;
        let frame = |frame: usize| {
            let seen = if self.replaced.contains(&(scene, frame)) { scene + 100 } else { scene };
            let mut shown = image(seen, frame);
            if let Some((.., by)) = self.brighter.filter(|(of, at, _)| (*of, *at) == (scene, frame)) {
                let samples = shown.samples().iter();
                let samples = samples.map(|sample| u8::try_from((i16::from(*sample) + by).clamp(0, 255)).unwrap());
                shown = ImageU8::new(SIZE.width, SIZE.height, samples.collect()).unwrap();
            }
            let mut png = encode_png(&shown).unwrap();
            if self.damaged == Some((scene, frame)) {
                let middle = png.len() / 2;
                png.truncate(middle);
            }
            Frame {
                name: frame.to_string(),
                timestamp_micros: None,
                camera: if self.close { camera_at(0.05 * frame as f64) } else { camera(frame) },
                stated_size: Some(SIZE),
                image: match frame % 7 {
                    3 if self.gaps => FrameImage::Missing(format!("{frame}.png").into()),
                    _ => FrameImage::Encoded(SharedBytes::new(png)),
                },
            }
        };
        Ok(Scene { key: key.to_owned(), url: None, frames: (0..self.frames).map(frame).collect() })
    }
}

pub(crate) fn entry(context: &[usize], target: &[usize]) -> IndexEntry {
    IndexEntry { context: context.to_vec(), target: target.to_vec(), overlap: Some(0.5.into()) }
}

/// A published protocol without preprocessing, and with targets on any side of the window.
pub(crate) fn preset() -> Preset {
    let mut preset = Preset::named("re10k-2v-256").unwrap();
    preset.index.sampler = None;
    preset.preprocessing.expected_size = None;
    preset.preprocessing.steps.clear();
    preset
}

/// A dataset with the same index entries for every scene.
pub(crate) fn dataset(walls: Walls, entries: &[IndexEntry]) -> Dataset {
    let scenes = walls.keys.iter().map(|key| (key.clone(), entries.to_vec())).collect();
    let index = PlannedIndex {
        index: EvaluationIndex { scenes },
        description: "made for a test".to_owned(),
        sha256: Sha256Digest::of(b"test"),
        name: None,
        reduced_from: None,
        left_out: 0,
        notices: std::collections::BTreeMap::new(),
    };
    let source: Arc<dyn SceneSource> = Arc::new(walls);
    Dataset { name: "walls".to_owned(), preset: preset(), source, description: "walls".to_owned(), index }
}

/// A uniformly grey image of the walls' size.
pub(crate) fn grey() -> Rendered {
    let samples = vec![0.5; (SIZE.width * SIZE.height * 3) as usize];
    Rendered { image: Image::new(SIZE.width, SIZE.height, samples).unwrap(), drawn: None, effects: Vec::new() }
}

pub(crate) fn record(name: &str) -> MethodRecord {
    MethodRecord { name: name.to_owned(), kind: "test".to_owned(), ..MethodRecord::default() }
}

/// The lower baselines: the nearest view and the plane warp.
pub(crate) fn baselines() -> Vec<Arc<dyn Method>> {
    vec![Arc::new(NearestView), Arc::new(Warp)]
}

/// The rows without the provenance.
pub(crate) fn rows(results: &Results) -> (&[TrialRow], &[TargetRow]) {
    (&results.trials, &results.targets)
}

/// Settings of a run; by default without timing pass and images, on PSNR.
pub(crate) struct Run {
    pub(crate) datasets: Vec<Dataset>,
    pub(crate) methods: Vec<Arc<dyn Method>>,
    pub(crate) suite: Suite,
    pub(crate) selection: Selection,
    pub(crate) timing: Option<TimingPlan>,
    pub(crate) images: KeepImages,
}

impl Run {
    pub(crate) fn new(datasets: Vec<Dataset>, methods: Vec<Arc<dyn Method>>) -> Self {
        Self {
            datasets,
            methods,
            suite: suite(&["psnr"]),
            selection: Selection::default(),
            timing: None,
            images: KeepImages::Nothing,
        }
    }

    pub(crate) fn plan(&self) -> Plan<'_> {
        let Self { datasets, methods, suite, selection, timing, images } = self;
        let (selection, timing, images) = (*selection, *timing, *images);
        Plan { datasets, methods, suite, selection, timing, images, prefetch: Prefetch::default() }
    }

    /// Its store in a new or existing folder.
    pub(crate) fn store(&self, folder: &Path) -> Result<Store, EvalError> {
        Ok(Store::resume(folder, self.plan().provenance(current_provenance("0", None, Vec::new()))?)?)
    }

    /// Runs into a new or existing store, and checks the number of steps.
    pub(crate) fn run(&self, folder: &Path) -> Result<(Results, RunCounts), EvalError> {
        let (plan, store) = (self.plan(), self.store(folder)?);
        let steps = AtomicU64::new(0);
        let outcome = run(&plan, store, &|_| _ = steps.fetch_add(1, Ordering::Relaxed))?;
        assert_eq!(steps.into_inner(), plan.steps(), "every result and every timed method is a step");
        Ok(outcome)
    }
}

pub(crate) fn suite(ids: &[&str]) -> Suite {
    Suite::new(named_metrics(ids.iter().copied()).unwrap(), Networks::default(), 0)
}

/// Writes weights of a learned metric that are all zero, under the published file's name.
pub(crate) fn write_zero_weights(folder: &Path, network: LpipsNetwork) -> PathBuf {
    let mut weights = StoredTensors::default();
    for step in network.steps() {
        let Step::Convolution { name, channels_in, channels_out, kernel, .. } = step else { continue };
        for (part, shape) in [("weight", vec![channels_out, channels_in, kernel, kernel]), ("bias", vec![channels_out])]
        {
            let zeros = vec![0.0; shape.iter().product()];
            weights.tensors.insert(format!("{name}.{part}"), StoredTensor::from_f32(shape, &zeros).unwrap());
        }
    }
    let file = folder.join(network.file());
    weights.write(&file).unwrap();
    file
}
