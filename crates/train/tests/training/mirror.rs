//! A mirrored scene with mirrored cameras renders the mirrored image.

use crate::common::sample;
use atsplat_camera::{Camera, Distortion, ImageSize, PoseNormalisation, WorldFromCamera, normalise};
use atsplat_numeric::SplitMix64;
use atsplat_numeric::Tolerance;
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{GaussianParts, Gaussians, RenderOptions, View};
use atsplat_train::samples::{Sample, mirrored};
use glam::DVec3;

/// All in f32; Gaussians of equal depth may be sorted differently.
const RENDERED: Tolerance = Tolerance::absolute(2e-5);

fn gaussians(mirror: bool) -> Gaussians {
    let mut random = SplitMix64::new(5);
    let mut unit = || random.unit_f32();
    let mut parts = GaussianParts::default();
    let side = if mirror { -1.0 } else { 1.0 };
    for _ in 0..60 {
        parts.means.push([side * (4.0 * unit() - 2.0), 3.0 * unit() - 1.5, 3.0 + 3.0 * unit()]);
        // A rotation's axis is a pseudovector.
        parts.quaternions.push([unit() + 0.2, unit() - 0.5, side * (unit() - 0.5), side * (unit() - 0.5)]);
        parts.log_scales.push([unit() * 2.0 - 3.0, unit() * 2.0 - 3.0, unit() * 2.0 - 3.0]);
        parts.opacity_logits.push(unit() * 4.0 - 1.0);
        parts.sh.push([unit() - 0.5, unit() - 0.5, unit() - 0.5]);
    }
    Gaussians::new(parts).unwrap()
}

fn rendered(gaussians: &Gaussians, sample: &Sample) -> Vec<Vec<[f32; 3]>> {
    let size = ImageSize { width: 32, height: 32 };
    let views: Vec<View> = sample.targets.cameras.iter().map(|&camera| View { camera, size }).collect();
    let images = CpuRenderer::default().render_many(gaussians, &views, &RenderOptions::default()).unwrap();
    images.into_iter().map(|image| image.rgb).collect()
}

#[test]
fn a_mirrored_scene_renders_mirrored() {
    let sample = sample(1);
    let flipped = mirrored(&sample).unwrap();
    let (straight, mirrored) = (rendered(&gaussians(false), &sample), rendered(&gaussians(true), &flipped));
    for (straight, mirrored) in straight.iter().zip(&mirrored) {
        assert!(straight.iter().any(|pixel| pixel[0] > 0.1), "the render is not black");
        let back: Vec<f64> =
            mirrored.chunks_exact(32).flat_map(|row| row.iter().rev().flatten().copied().map(f64::from)).collect();
        RENDERED.assert(back, straight.as_flattened().iter().copied().map(f64::from), "renders");
    }
}

#[test]
fn two_mirrors_change_nothing() {
    let sample = sample(2);
    let twice = mirrored(&mirrored(&sample).unwrap()).unwrap();
    assert_eq!((twice.context.images, twice.targets.images), (sample.context.images, sample.targets.images));
    for (back, camera) in twice.targets.cameras.iter().zip(&sample.targets.cameras) {
        Tolerance::F64.assert(back.camera_from_world.to_rows(), camera.camera_from_world.to_rows(), "pose");
        let centre = |camera: &Camera| [camera.intrinsics.cx, camera.intrinsics.cy];
        Tolerance::F64.assert(centre(back), centre(camera), "principal point");
    }
}

#[test]
fn mirroring_commutes_with_pose_normalisation() {
    let sample = sample(3);
    let rule = PoseNormalisation::mean_camera(atsplat_camera::MeanCameraScale::LongLrm);
    let poses = |sample: &Sample| -> Vec<WorldFromCamera> {
        sample.context.cameras.iter().map(|camera| camera.camera_from_world.inverse()).collect()
    };
    let before = normalise(&poses(&mirrored(&sample).unwrap()), &[], &rule).unwrap().context;
    let mut moved = sample.clone();
    let normal = normalise(&poses(&sample), &[], &rule).unwrap().context;
    for (camera, pose) in moved.context.cameras.iter_mut().zip(normal) {
        camera.camera_from_world = pose.inverse();
    }
    let after = poses(&mirrored(&moved).unwrap());
    for (before, after) in before.iter().zip(&after) {
        Tolerance::F64.assert(before.to_rows(), after.to_rows(), "pose");
    }
}

/// A lens with every term, including tangential ones, mirrors with its image: the mirrored camera projects the mirrored
/// point to the mirrored position.
#[test]
fn lenses_mirror_with_their_images() {
    let lenses = [
        Distortion::OpenCv { k1: -0.12, k2: 0.03, k3: -0.005, p1: 0.011, p2: -0.017 },
        Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.02, p2: 0.0 },
        Distortion::OpenCv { k1: 0.0, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.02 },
        Distortion::Fisheye { k: [0.05, -0.02, 0.01, -0.003] },
        Distortion::None,
    ];
    for distortion in lenses {
        let mut sample = sample(4);
        sample.context.cameras.iter_mut().for_each(|camera| camera.distortion = distortion);
        let flipped = mirrored(&sample).unwrap();
        for (camera, mirror) in sample.context.cameras.iter().zip(&flipped.context.cameras) {
            for point in [[0.4, -0.3, 2.0], [-0.7, 0.5, 2.5], [0.1, 0.6, 1.8], [0.9, 0.2, 3.0]] {
                let projected = |camera: &Camera, point: DVec3| camera.project(point).unwrap().position;
                let (original, mirrored) = (projected(camera, point.into()), projected(mirror, mirrored_point(point)));
                let off = (original - 0.5).abs();
                assert!(off.x > 1e-3 && off.y > 1e-3, "a point at the centre would test nothing: {original}");
                Tolerance::F64.assert(
                    [mirrored.x, mirrored.y],
                    [1.0 - original.x, original.y],
                    &format!("{distortion:?}"),
                );
            }
        }
    }
}

const fn mirrored_point([x, y, z]: [f64; 3]) -> DVec3 {
    DVec3::new(-x, y, z)
}
