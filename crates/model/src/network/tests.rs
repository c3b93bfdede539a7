//! Against the PyTorch reference, stage by stage, in every variant.

use std::path::{Path, PathBuf};

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_numeric::Tolerance;
use atsplat_tests::on_threads;
use glam::{DMat3, DVec3};

use super::*;
use crate::ImageSize;
use crate::hash::Stream;
use crate::parameters::parameters;
use crate::weights::{StoredTensors, TensorFile, generated};

/// f32 here, f64 there, through a dozen layers on values of order one.
const AGAINST_PYTORCH: Tolerance = Tolerance { absolute: 2e-4, relative: 2e-4 };

pub(super) fn fixtures(folder: &str) -> Vec<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(folder);
    let mut paths: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths
}

/// `hashed.image`.
pub(super) fn image(seed: u64, views: usize, size: ImageSize) -> Vec<f32> {
    let stream = Stream::named(seed, "picture");
    let count = (views * size.height * size.width * 3) as u64;
    #[expect(clippy::cast_possible_truncation, reason = "images are f32")]
    (0..count).map(|at| (0.5 + 0.5 * stream.signed_unit(at)) as f32).collect()
}

pub(super) struct Fixture {
    name: String,
    stored: StoredTensors,
    pub(super) config: ModelConfig,
    pub(super) seed: u64,
}

impl Fixture {
    fn read(path: &Path) -> Self {
        let stored = TensorFile::open(path).unwrap().stored;
        let config = ModelConfig::from_toml(&stored.metadata["configuration"]).unwrap();
        let seed = stored.metadata["seed"].parse().unwrap();
        Self { name: path.file_stem().unwrap().to_string_lossy().into_owned(), stored, config, seed }
    }

    pub(super) fn views(&self) -> Views {
        let doubles = |name: &str| -> Vec<f64> {
            self.stored.tensors[name].bytes().as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect()
        };
        let (poses, intrinsics) = (doubles("poses"), doubles("intrinsics"));
        let cameras = poses.chunks_exact(16).zip(intrinsics.chunks_exact(4)).map(|(m, k)| {
            let rotation = DMat3::from_cols_array(&[m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10]]);
            let pose = WorldFromCamera::new(rotation, DVec3::new(m[3], m[7], m[11])).unwrap();
            Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(k[0], k[1], k[2], k[3]).unwrap())
        });
        let cameras: Vec<Camera> = cameras.collect();
        let size = self.config.resolution;
        Views::new(size, image(self.seed, cameras.len(), size), cameras).unwrap()
    }

    pub(super) fn network(&self, device: &Device) -> Network {
        let weights = generated(&parameters(&self.config), self.seed);
        Network::new(&self.config, device).unwrap().with_weights(&weights).unwrap()
    }

    fn call_seed(&self) -> u64 {
        self.stored.metadata["call_seed"].parse().unwrap()
    }

    fn forward(&self, device: &Device) -> Forward {
        self.network(device).forward(&[self.views()], self.call_seed()).unwrap()
    }

    fn reconstruct(&self, device: &Device) -> Reconstruction {
        self.network(device).reconstruct(&self.views(), self.call_seed()).unwrap()
    }

    /// Compares a tensor if the fixture has it; returns whether it does.
    fn compare<const D: usize>(&self, name: &str, ours: &Tensor<D>) -> bool {
        let Some(theirs) = self.stored.tensors.get(name) else { return false };
        let ours = numbers(ours.clone());
        let theirs = theirs.to_f32().unwrap();
        AGAINST_PYTORCH.assert(ours, theirs.into_iter().map(f64::from), &format!("{} {name}", self.name));
        true
    }
}

pub(super) fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.into_data_as::<f64>().as_slice::<f64>().unwrap().to_vec()
}

#[test]
fn every_variant_agrees_with_pytorch() {
    let device = Device::flex();
    let mut stages = 0;
    for path in fixtures("network") {
        let fixture = Fixture::read(&path);
        let made = fixture.forward(&device);
        for (name, ours) in [
            ("backbone", &made.coarse.backbone),
            ("coarse_tokens", &made.coarse.tokens),
            ("coarse", &made.coarse.features),
            ("fine", &made.fine),
            ("tokens_initial", &made.initial.features),
        ] {
            stages += usize::from(fixture.compare(name, ours));
        }
        if let Place::Anchored { anchors, depths, .. } = &made.initial.place {
            assert!(fixture.compare("depths", depths) && fixture.compare("anchors", anchors), "{path:?}");
        }
        for (position, block) in made.blocks.iter().enumerate() {
            if let Some(expanded) = &block.expanded {
                if let Some(scores) = &expanded.scores {
                    assert!(fixture.compare(&format!("scores_{position}"), scores));
                }
                let theirs = fixture.stored.tensors[&format!("selected_{position}")].bytes().as_chunks::<4>().0;
                let theirs: Vec<usize> =
                    theirs.iter().map(|bytes| usize::try_from(i32::from_le_bytes(*bytes)).unwrap()).collect();
                assert_eq!(expanded.selected, [theirs], "{path:?}, block {position}");
            }
            stages += usize::from(fixture.compare(&format!("tokens_{position}"), &block.tokens.features));
        }
        let gaussians = &made.gaussians;
        let compared = fixture.compare("means", &gaussians.means)
            && fixture.compare("quaternions", &gaussians.quaternions)
            && fixture.compare("log_scales", &gaussians.log_scales)
            && fixture.compare("opacity_logits", &gaussians.opacity_logits)
            && fixture.compare("sh", &gaussians.sh);
        assert!(compared, "{path:?}");
        let scene = gaussians.scene(0).unwrap();
        let Reconstruction { gaussians: plain, budget, blocks, .. } = fixture.reconstruct(&device);
        assert_eq!((scene.len(), &scene), (budget.gaussians, &plain));
        let scores: Vec<Vec<f32>> = blocks.into_iter().filter_map(|block| block.scores).collect();
        assert_eq!(fixture.network(&device).scores(&fixture.views(), fixture.call_seed()).unwrap(), scores, "{path:?}");
        assert!(gaussians.scene(1).is_err());
    }
    assert!(stages >= 27, "three fixtures have every stage: {stages}");
}

pub(super) fn base() -> Fixture {
    named("base.safetensors")
}

pub(super) fn straight_through() -> Fixture {
    named("straight_through.safetensors")
}

fn named(file: &str) -> Fixture {
    Fixture::read(&fixtures("network").into_iter().find(|path| path.ends_with(file)).unwrap())
}

#[test]
fn weights_round_trip_through_the_network() {
    let device = Device::flex();
    for name in ["base", "dino_registers", "biases", "learnable"] {
        let paths = fixtures("network");
        let fixture = Fixture::read(paths.iter().find(|path| path.file_stem().unwrap() == name).unwrap());
        let weights = generated(&parameters(&fixture.config), fixture.seed);
        assert_eq!(fixture.network(&device).weights().unwrap().digest(), weights.digest(), "{name}");
        let mut lacking = weights.clone();
        lacking.tensors.shift_remove("head.mlp.fc2.weight");
        let error = Network::new(&fixture.config, &device).unwrap().with_weights(&lacking).unwrap_err().to_string();
        assert!(error.contains("head.mlp.fc2.weight"), "{error}");
    }
}

#[test]
fn a_scene_does_not_depend_on_its_batch_or_on_threads() {
    let device = Device::flex();
    let fixture = base();
    let network = fixture.network(&device);
    let views = fixture.views();
    let mut other = views.clone();
    other.images.reverse();
    let alone = network.forward(std::slice::from_ref(&views), 0).unwrap();
    let together = network.forward(&[other, views.clone()], 0).unwrap();
    assert_eq!(together.gaussians.scene(1).unwrap(), alone.gaussians.scene(0).unwrap());
    let single = on_threads(1, || network.forward(&[views], 0).unwrap());
    assert_eq!(single.gaussians.scene(0).unwrap(), alone.gaussians.scene(0).unwrap());
}

/// A network whose branches both downscale by 2 has the same patches and rays on an image twice as large.
#[test]
fn images_are_resized_to_the_scale_of_the_training_images() {
    let device = Device::flex();
    let fixture = base();
    let large = ImageSize::new(64, 96);
    let views = Views::new(large, image(9, 2, large), fixture.views().cameras).unwrap();
    let trained = fixture.network(&device).trained_at(fixture.config.resolution);
    let mut halved = fixture.config.clone();
    (halved.coarse.image_downscale, halved.fine.image_downscale, halved.resolution) = (2, 2, large);
    let weights = generated(&parameters(&halved), fixture.seed);
    let halved = Network::new(&halved, &device).unwrap().with_weights(&weights).unwrap();

    let made = trained.reconstruct(&views, 0).unwrap();
    assert_eq!(made.input_size, fixture.config.resolution);
    assert_eq!(made.gaussians, halved.reconstruct(&views, 0).unwrap().gaussians);
    assert_eq!(made.gaussians, trained.trace(&views, 0).unwrap().reconstruction.gaussians);
    let given = trained.clone().without_resizing().reconstruct(&views, 0).unwrap();
    assert_eq!((given.input_size, given.budget.initial_tokens), (large, 4 * made.budget.initial_tokens));
    // The aspect ratio is kept, in whole patches; resizing also makes sizes fit that patches do not divide.
    let odd = views.resized(ImageSize::new(50, 60));
    assert_eq!(trained.reconstruct(&odd, 0).unwrap().input_size, ImageSize::new(32, 32));
    assert!(trained.without_resizing().reconstruct(&odd, 0).is_err());
}

#[test]
fn gradients_reach_every_parameter_except_frozen_and_detached_ones() {
    let device = Device::flex().autodiff();
    for (name, frozen) in [("dino", "backbone."), ("base", "expansion.score"), ("straight_through", "nothing")] {
        let paths = fixtures("network");
        let fixture = Fixture::read(paths.iter().find(|path| path.file_stem().unwrap() == name).unwrap());
        let network = fixture.network(&device);
        let made = network.forward(&[fixture.views()], 0).unwrap();
        let gaussians = &made.gaussians;
        let loss = gaussians.means.clone().square().mean() + gaussians.log_scales.clone().square().mean();
        let gradients = loss.backward();
        let reached = network.gradients(&gradients);
        let names = || parameters(&fixture.config).into_iter().map(|parameter| parameter.name);
        let without: Vec<String> = names().filter(|name| !reached.contains_key(name)).collect();
        let expected = names();
        let scored = |name: &str| name.contains("expansion.score") && frozen != "nothing";
        let expected: Vec<String> = expected.filter(|name| name.contains(frozen) || scored(name)).collect();
        assert_eq!(without, expected, "{name}");
    }
}

#[test]
fn rejects_input_that_does_not_fit() {
    let device = Device::flex();
    let fixture = base();
    let network = fixture.network(&device);
    let views = fixture.views();
    let rejected = |scenes: &[Views]| network.forward(scenes, 0).unwrap_err().to_string();
    assert!(rejected(&[]).contains("at least one"));
    let small = views.resized(ImageSize::new(32, 32));
    assert!(rejected(&[views.clone(), small]).contains("2 views of 32x48 in each"));
    assert!(
        rejected(&[views.resized(ImageSize::new(30, 48))]).contains("divisible by 16, found 30x48 (height x width)")
    );
    assert!(Views::new(views.size(), vec![0.0; 5], views.cameras.clone()).is_err());
    let mut broken = views.images.clone();
    broken[7] = f32::NAN;
    let error = Views::new(views.size(), broken, views.cameras.clone()).unwrap_err().to_string();
    assert!(error.contains("image 0") && error.contains("NaN"), "{error}");
}

#[test]
fn the_seconds_of_all_stages_add_up() {
    let seconds = StageSeconds { coarse: 1.0, anchors: 2.0, fine: 4.0, decoder: 8.0, head: 16.0 };
    let stages = seconds.stages();
    assert_eq!(stages.map(|(name, _)| name), ["coarse", "anchors", "fine", "decoder", "head"]);
    Tolerance::EXACT.assert(stages.map(|(_, seconds)| seconds), [1.0, 2.0, 4.0, 8.0, 16.0], "stages");
    Tolerance::EXACT.assert([seconds.total()], [31.0], "total");
}
