//! Networks on a graphics processor against the same ones on the central processor, which other tests compare with PyTorch.
//!
//! Without an adapter these tests say so and pass; with `ATSPLAT_REQUIRE_GPU=1` they fail.

#![expect(clippy::unwrap_used, clippy::indexing_slicing, reason = "helpers of tests fail like tests")]
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "what a device differs by is for people to read")]

use std::path::Path;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_model::ModelConfig;
use atsplat_model::network::{BlockOutcome, Device, Network, Processor, Reconstruction, Views};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::{TensorFile, generated};
use atsplat_numeric::Tolerance;
use atsplat_splat::GaussianParts;
use glam::{DMat3, DVec3};

/// What `Processor::Wgpu` publishes.
const PUBLISHED: Tolerance = Tolerance { absolute: 1e-4, relative: 1e-4 };
/// Scores nearer than this to the last that is chosen may be on either side of it.
const TIE: f32 = 1e-6;

type Part = fn(&GaussianParts) -> &[f32];

const PARTS: [(&str, Part); 5] = [
    ("means", |parts| parts.means.as_flattened()),
    ("quaternions", |parts| parts.quaternions.as_flattened()),
    ("log scales", |parts| parts.log_scales.as_flattened()),
    ("opacity logits", |parts| &parts.opacity_logits),
    ("spherical harmonics", |parts| parts.sh.as_flattened()),
];

fn wgpu() -> Option<Device> {
    match Processor::Wgpu.open() {
        Ok(device) => Some(device),
        Err(error) => {
            assert!(std::env::var("ATSPLAT_REQUIRE_GPU").as_deref() != Ok("1"), "{error}");
            eprintln!("SKIPPED, no graphics adapter: {error}");
            None
        }
    }
}

/// Waves of colour, and cameras that look inwards from an arc.
fn views(config: &ModelConfig) -> Views {
    let (count, size) = (config.views, config.resolution);
    let samples = count * size.height * size.width * 3;
    let pictures = (0..samples).map(|at| 0.5 + 0.5 * (at as f32 * 0.37).sin() * (at as f32 * 0.000_91).cos()).collect();
    let camera = |view: usize| {
        let angle = 0.25 * view as f64;
        let pose = WorldFromCamera::new(DMat3::from_rotation_y(-angle), DVec3::new(2.0 * angle.sin(), 0.0, 0.0));
        Camera::pinhole(pose.unwrap().inverse(), NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap())
    };
    Views::new(size, pictures, (0..count).map(camera).collect()).unwrap()
}

fn made(config: &ModelConfig, device: &Device) -> Reconstruction {
    let weights = generated(&parameters(config), 1);
    let network = Network::new(config, device).unwrap().with_weights(&weights).unwrap();
    network.reconstruct(&views(config), 7).unwrap()
}

#[test]
fn nano_on_wgpu_is_nano() {
    let Some(device) = wgpu() else { return };
    compare("nano", &ModelConfig::named("nano").unwrap(), &device);
}

/// Designs of anchors, backbones, ways to select: those of the fixtures that PyTorch made, at 32×48 pixels.
#[test]
fn every_variant_on_wgpu_is_that_variant() {
    let Some(device) = wgpu() else { return };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/network");
    let mut compared = 0;
    for path in std::fs::read_dir(folder).unwrap() {
        let path = path.unwrap().path();
        let configuration = TensorFile::open(&path).unwrap().stored.metadata["configuration"].clone();
        let config = ModelConfig::from_toml(&configuration).unwrap();
        compared += usize::from(compare(&path.file_stem().unwrap().to_string_lossy(), &config, &device));
    }
    assert!(compared >= 20, "ties spoiled all but {compared}");
}

/// Whether all was compared: where a tie falls otherwise, what comes after it is other work.
fn compare(name: &str, config: &ModelConfig, device: &Device) -> bool {
    let (ours, theirs) = (made(config, device), made(config, &Device::flex()));
    assert_eq!(ours.budget, theirs.budget, "{name}");
    if let (Some(ours), Some(theirs)) = (&ours.anchors, &theirs.anchors) {
        assert_same(ours.as_flattened(), theirs.as_flattened(), &format!("{name}, anchors"));
    }
    for (block, (ours, theirs)) in ours.blocks.iter().zip(&theirs.blocks).enumerate() {
        if let (Some(ours), Some(theirs)) = (&ours.scores, &theirs.scores) {
            assert_same(ours, theirs, &format!("{name}, scores of block {block}"));
        }
        if ours.selected != theirs.selected {
            assert_tied(ours, theirs, &format!("{name}, block {block}"));
            println!("{name}, block {block}: a tie fell otherwise");
            return false;
        }
    }
    let [ours, theirs] = [&ours, &theirs].map(|made| made.gaussians.parts());
    for (what, part) in PARTS {
        assert_same(part(ours), part(theirs), &format!("{name}, {what}"));
    }
    true
}

/// Tokens that one chose and the other did not are as good as the last that was chosen.
fn assert_tied(ours: &BlockOutcome, theirs: &BlockOutcome, what: &str) {
    let scores = theirs.scores.as_ref().unwrap();
    let last = theirs.selected.iter().map(|&token| scores[token]).min_by(f32::total_cmp).unwrap();
    let differing = (0..scores.len()).filter(|token| ours.selected.contains(token) != theirs.selected.contains(token));
    for token in differing {
        let apart = (scores[token] - last).abs();
        assert!(apart <= TIE * (1.0 + last), "{what}: token {token} is {apart} from the last that is chosen");
    }
}

fn assert_same(ours: &[f32], theirs: &[f32], what: &str) {
    let wide = |numbers: &[f32]| numbers.iter().copied().map(f64::from).collect::<Vec<f64>>();
    let (ours, theirs) = (wide(ours), wide(theirs));
    let shares = ours.iter().zip(&theirs).map(|(ours, theirs)| (ours - theirs).abs() / (1.0 + theirs.abs()));
    println!("{what}: at most {:.1e} of 1 + the number", shares.max_by(f64::total_cmp).unwrap_or_default());
    PUBLISHED.assert(ours, theirs, what);
}
