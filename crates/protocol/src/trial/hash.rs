//! Byte layout of the hashes of a trial, each a SHA-256 over a concatenation. The hashes of trial and poses:
//!
//! | part | bytes | in `pose_hash` |
//! |---|---|---|
//! | domain | `atsplat trial 2` or `atsplat poses 1`, as text | yes |
//! | scene key | text | no |
//! | context frames | count, then each position, u64 little-endian | no |
//! | target frames | the same | no |
//! | counts | of context, of target, u64 little-endian | yes |
//! | cameras *of the source* | context, then target in index order, each as f32 little-endian: fx fy cx cy | no |
//! | | and the row-major 3×4 world-to-camera matrix | yes |
//! | lenses *of the source* | in the cameras' order, each a name as text: `none`; `opencv`, then k1 k2 k3 p1 p2; `fisheye`, then k1 k2 k3 k4; coefficients as f32 little-endian | no |
//! | preprocessing | its one-line `Display`, text | no |
//! | normalisation | the rule as compact JSON, text | no |
//! | near, far | before normalisation, f64 little-endian | no |
//! | planes by disparity | nothing without them; else `planes by disparity`, as text, and multiples of the shorter side at the near plane, pixels at the far one, f64 little-endian | no |
//!
//! The hash of the data:
//!
//! | part | bytes |
//! |---|---|
//! | domain | `atsplat data 1`, as text |
//! | counts | of context, of target, u64 little-endian |
//! | cameras and lenses *of the source* | as above, all of them |
//! | images | context, then target in index order, each as the byte 1 and the SHA-256 of its encoded bytes, or of the fingerprint of a generated image; the byte 0 if it cannot be read |
//!
//! Text is hashed as its length in bytes (u64 little-endian), then UTF-8. Cameras are f32 because `.torch` chunks
//! store no more: a trajectory file and a chunk of the same scene have equal hashes. Intrinsics depend on the crop of the
//! images, so differently cropped copies of a scene share only the hash of their poses. Negative zero is hashed as
//! zero. The first version of the trial's hash, `atsplat trial 1`, did not include the lenses.

use atsplat_camera::{Camera, Distortion};
use atsplat_files::{Malformed, Sha256Digest};
use sha2::{Digest, Sha256};

use super::TrialRecipe;
use crate::preset::DisparityPlanes;
use crate::{IndexEntry, ProtocolError};

/// Hash of the whole trial. `cameras` are those of the source, context then target.
pub(super) fn of_trial(
    scene: &str,
    entry: &IndexEntry,
    cameras: &[Camera],
    recipe: &TrialRecipe,
) -> Result<Sha256Digest, ProtocolError> {
    let rule = serde_json::to_string(&recipe.pose_normalisation).map_err(|error| {
        Malformed::new("pose normalisation", "its parameters", "numbers that JSON can represent", error)
    })?;
    let mut hasher = Sha256::new();
    text(&mut hasher, "atsplat trial 2");
    text(&mut hasher, scene);
    for frames in [&entry.context, &entry.target] {
        number(&mut hasher, frames.len());
        for frame in frames {
            number(&mut hasher, *frame);
        }
    }
    whole_cameras(&mut hasher, entry, cameras);
    text(&mut hasher, &recipe.preprocessing.to_string());
    text(&mut hasher, &rule);
    hasher.update((recipe.near_far.near + 0.0).to_le_bytes());
    hasher.update((recipe.near_far.far + 0.0).to_le_bytes());
    if let Some(DisparityPlanes { near_sides, far_pixels }) = recipe.disparity_planes {
        text(&mut hasher, "planes by disparity");
        hasher.update(near_sides.to_le_bytes());
        hasher.update(far_pixels.to_le_bytes());
    }
    Ok(Sha256Digest::finish(hasher))
}

/// Hash of the source poses alone.
pub(super) fn of_poses(entry: &IndexEntry, cameras: &[Camera]) -> Sha256Digest {
    let mut hasher = Sha256::new();
    text(&mut hasher, "atsplat poses 1");
    rows(&mut hasher, entry, cameras, |camera| camera.camera_from_world.to_rows());
    Sha256Digest::finish(hasher)
}

/// The hasher of a trial's data after its cameras; the images follow. `cameras` are those of the source, context then
/// target.
pub(super) fn of_data(entry: &IndexEntry, cameras: &[Camera]) -> Sha256 {
    let mut hasher = Sha256::new();
    text(&mut hasher, "atsplat data 1");
    whole_cameras(&mut hasher, entry, cameras);
    hasher
}

/// Adds an image to the hash of a trial's data.
pub(super) fn image(hasher: &mut Sha256, digest: Option<Sha256Digest>) {
    match digest {
        Some(digest) => {
            hasher.update([1]);
            hasher.update(digest.0);
        }
        None => hasher.update([0]),
    }
}

fn whole_cameras(hasher: &mut Sha256, entry: &IndexEntry, cameras: &[Camera]) {
    rows(hasher, entry, cameras, |camera| {
        let k = camera.intrinsics;
        [k.fx, k.fy, k.cx, k.cy].into_iter().chain(camera.camera_from_world.to_rows())
    });
    for camera in cameras {
        lens(hasher, &camera.distortion);
    }
}

fn rows<I: IntoIterator<Item = f64>>(
    hasher: &mut Sha256,
    entry: &IndexEntry,
    cameras: &[Camera],
    row: impl Fn(&Camera) -> I,
) {
    number(hasher, entry.context.len());
    number(hasher, entry.target.len());
    for camera in cameras {
        for value in row(camera) {
            single(hasher, value);
        }
    }
}

fn lens(hasher: &mut Sha256, distortion: &Distortion) {
    let (name, coefficients): (_, &[f64]) = match distortion {
        Distortion::None => ("none", &[]),
        Distortion::OpenCv { k1, k2, k3, p1, p2 } => ("opencv", &[*k1, *k2, *k3, *p1, *p2]),
        Distortion::Fisheye { k } => ("fisheye", k),
    };
    text(hasher, name);
    for coefficient in coefficients {
        single(hasher, *coefficient);
    }
}

fn single(hasher: &mut Sha256, value: f64) {
    #[expect(clippy::cast_possible_truncation, reason = "chunks store f32")]
    let stored = value as f32 + 0.0;
    hasher.update(stored.to_le_bytes());
}

fn text(hasher: &mut Sha256, text: &str) {
    number(hasher, text.len());
    hasher.update(text.as_bytes());
}

fn number(hasher: &mut Sha256, number: usize) {
    hasher.update((number as u64).to_le_bytes());
}
