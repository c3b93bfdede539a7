//! Hard inputs: finite ones give finite Gaussians, others a typed error.

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{RenderOptions, View};
use glam::{DMat3, DVec3};

use super::tests::image;
use super::*;
use crate::ImageSize;
use crate::budget::budget;
use crate::parameters::parameters;
use crate::weights::generated;

const SIZE: ImageSize = ImageSize::new(64, 96);

fn nano() -> Network {
    let config = ModelConfig::named("nano").unwrap();
    let weights = generated(&parameters(&config), 3);
    Network::new(&config, &Device::flex()).unwrap().with_weights(&weights).unwrap()
}

/// A camera at a position, rotated about the vertical axis.
fn camera(position: DVec3, angle: f64) -> Camera {
    let pose = WorldFromCamera::new(DMat3::from_rotation_y(angle), position).unwrap();
    Camera::pinhole(pose.inverse(), NormalizedIntrinsics::new(0.8, 1.2, 0.5, 0.5).unwrap())
}

fn noise(views: usize, size: ImageSize) -> Vec<f32> {
    image(5, views, size)
}

fn views(images: Vec<f32>, cameras: Vec<Camera>) -> Views {
    Views::new(SIZE, images, cameras).unwrap()
}

#[test]
fn hard_views_give_finite_gaussians_and_images() {
    let network = nano();
    let (left, right) = (camera(DVec3::ZERO, 0.0), camera(DVec3::new(0.4, 0.0, 0.0), -0.1));
    let pixels = SIZE.height * SIZE.width * 3;
    let twelve: Vec<Camera> = (0..12).map(|at| camera(DVec3::new(0.1 * f64::from(at), 0.0, 0.0), 0.0)).collect();
    let cases = [
        ("one view", views(noise(1, SIZE), vec![left])),
        ("identical views", views(noise(1, SIZE).repeat(2), vec![left, left])),
        ("black images", views(vec![0.0; 2 * pixels], vec![left, right])),
        ("white images", views(vec![1.0; 2 * pixels], vec![left, right])),
        ("opposed cameras", views(noise(2, SIZE), vec![left, camera(DVec3::Z, std::f64::consts::PI)])),
        ("zero baseline", views(noise(2, SIZE), vec![left, camera(DVec3::ZERO, 0.5)])),
        ("far apart", views(noise(2, SIZE), vec![left, camera(DVec3::new(1e4, 0.0, 0.0), 0.0)])),
        ("twelve views", views(noise(12, SIZE), twelve)),
    ];
    for (name, views) in cases {
        let made = network.reconstruct(&views, 0).unwrap_or_else(|error| panic!("{name}: {error}"));
        let range = budget(network.config(), views.len(), SIZE).unwrap();
        assert_eq!(Some(&made.budget), range.fixed(), "{name}");
        assert_eq!(made.gaussians.len(), made.budget.gaussians, "{name}");
        let size = atsplat_camera::ImageSize { width: 48, height: 32 };
        let view = View { camera: left, size };
        let image = CpuRenderer::default().render(&made.gaussians, &view, &RenderOptions::default()).unwrap();
        assert_eq!(image.non_finite(), 0, "{name}");
    }
}

#[test]
fn tokens_keep_their_parents_and_anchors() {
    let network = nano();
    let cameras = vec![camera(DVec3::ZERO, 0.0), camera(DVec3::new(0.4, 0.0, 0.0), -0.1)];
    let made = network.reconstruct(&views(noise(2, SIZE), cameras), 0).unwrap();
    let (origins, anchors) = (made.origins(), made.anchors.as_ref().unwrap());
    assert_eq!((anchors.len(), origins.len()), (made.budget.initial_tokens, made.budget.final_tokens));
    for (block, outcome) in made.blocks.iter().enumerate() {
        let entered = block.checked_sub(1).map_or(made.budget.initial_tokens, |before| made.budget.tokens[before]);
        assert_eq!(outcome.parents.len(), made.budget.tokens[block]);
        assert_eq!(outcome.scores.as_ref().map(Vec::len), (block > 0).then_some(entered));
        for token in 0..entered {
            let children = outcome.parents.iter().filter(|&&parent| parent == token).count();
            assert_eq!(children, if outcome.selected.contains(&token) { 2 } else { 1 }, "block {block} token {token}");
        }
    }
    // The highest scores were expanded.
    for outcome in &made.blocks[1..] {
        let scores = outcome.scores.as_ref().unwrap();
        let chosen = outcome.selected.iter().map(|&token| scores[token]);
        let lowest = chosen.fold(f32::INFINITY, |low, score| if score < low { score } else { low });
        let better = scores.iter().filter(|&&score| score > lowest).count();
        assert!(better < outcome.selected.len(), "{better} above the lowest of {}", outcome.selected.len());
    }
    let stages: f64 = made.seconds.stages().iter().map(|(_, seconds)| seconds).sum();
    assert!(stages > 0.0 && made.memory.peak_bytes() > made.memory.weight_bytes);
}

#[test]
fn input_that_is_not_finite_is_a_typed_error() {
    let network = nano();
    let left = camera(DVec3::ZERO, 0.0);
    for broken in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut images = noise(2, SIZE);
        let at = images.len() - 1;
        images[at] = broken;
        let error = Views::new(SIZE, images, vec![left, left]).unwrap_err();
        assert!(matches!(&error, ModelError::NonFinite { location, count: 1 } if location == "image 1"), "{error}");
    }
    assert!(WorldFromCamera::new(DMat3::IDENTITY, DVec3::new(f64::NAN, 0.0, 0.0)).is_err());
    // Finite in f64 but not in f32; then finite in f32, but not after multiplications in the network.
    let beyond = views(noise(2, SIZE), vec![left, camera(DVec3::new(1e39, 0.0, 0.0), 0.0)]);
    let error = network.reconstruct(&beyond, 0).unwrap_err();
    assert!(matches!(&error, ModelError::NonFinite { location, .. } if location == "rays of camera 1"), "{error}");
    let overflowing = views(noise(2, SIZE), vec![left, camera(DVec3::new(1e38, 0.0, 0.0), 0.0)]);
    let error = network.reconstruct(&overflowing, 0).unwrap_err();
    assert!(matches!(error, ModelError::NonFinite { .. } | ModelError::Malformed(_)), "{error}");
}

#[test]
fn weights_that_are_not_finite_give_no_gaussians() {
    let config = ModelConfig::named("nano").unwrap();
    let mut weights = generated(&parameters(&config), 3);
    let name = "head.mlp.fc2.weight";
    let shape = weights.tensors[name].shape().to_vec();
    let mut values = weights.tensors[name].to_f32().unwrap();
    values[0] = f32::NAN;
    weights.tensors[name] = crate::weights::StoredTensor::from_f32(shape, &values).unwrap();
    let network = Network::new(&config, &Device::flex()).unwrap().with_weights(&weights);
    let outcome =
        network.and_then(|network| network.reconstruct(&views(noise(1, SIZE), vec![camera(DVec3::ZERO, 0.0)]), 0));
    assert!(outcome.is_err());
}

#[test]
fn patches_that_do_not_divide_an_image_are_named() {
    let network = nano();
    let size = ImageSize::new(64, 90);
    let views = Views::new(size, noise(1, size), vec![camera(DVec3::ZERO, 0.0)]).unwrap();
    let error = network.reconstruct(&views, 0).unwrap_err();
    assert!(matches!(error, ModelError::Indivisible { step: 16, found, .. } if found == size), "{error}");
}
