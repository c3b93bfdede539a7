use atsplat_camera::{Camera, CameraError, CameraFromWorld, Distortion, NormalizedIntrinsics};
use glam::{DMat3, DVec3};

use super::{PatchDistances, PosedImages, Sample};

/// x ↦ −x, of the world and of every camera.
const MIRROR: DMat3 = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));

/// The mirrored scene: images swap left and right, and cameras move to their mirror images. A pose is mirrored on both
/// sides (world and camera), so that its rotation stays a rotation.
///
/// # Errors
/// [`CameraError`] for invalid poses.
pub fn mirrored(sample: &Sample) -> Result<Sample, CameraError> {
    let posed = |posed: &PosedImages| -> Result<PosedImages, CameraError> {
        let row = (posed.size.width * 3).max(1);
        let images = posed.images.chunks_exact(row).flat_map(|row| row.as_chunks::<3>().0.iter().rev().flatten());
        let cameras: Result<Vec<Camera>, CameraError> = posed.cameras.iter().map(mirrored_camera).collect();
        Ok(PosedImages { size: posed.size, images: images.copied().collect(), cameras: cameras? })
    };
    Ok(Sample {
        name: format!("{}, mirrored", sample.name),
        context: posed(&sample.context)?,
        targets: posed(&sample.targets)?,
        distances: sample.distances.as_ref().map(PatchDistances::mirrored),
    })
}

fn mirrored_camera(camera: &Camera) -> Result<Camera, CameraError> {
    let pose = &camera.camera_from_world;
    let NormalizedIntrinsics { fx, fy, cx, cy } = camera.intrinsics;
    Ok(Camera {
        camera_from_world: CameraFromWorld::new(MIRROR * pose.rotation() * MIRROR, MIRROR * pose.translation())?,
        intrinsics: NormalizedIntrinsics::new(fx, fy, 1.0 - cx, cy)?,
        distortion: match camera.distortion {
            // Of the tangential terms, the one that is even in x changes sign.
            Distortion::OpenCv { k1, k2, k3, p1, p2 } => Distortion::OpenCv { k1, k2, k3, p1, p2: -p2 },
            // They depend on the distance from the axis alone.
            radial @ (Distortion::None | Distortion::Fisheye { .. }) => radial,
        },
    })
}
