use atsplat_camera::{Camera, Distortion, NormalizedIntrinsics};
use atsplat_files::Sha256Digest;

use super::{PosedImages, Sample};

impl Sample {
    /// A hash of all that the network and the losses see, to the bit: images, cameras and distances. The name is left out, because
    /// another version may word it differently.
    pub(crate) fn digest(&self) -> Sha256Digest {
        let distances = self.distances.as_ref().map(|distances| (distances.columns, distances.distances.as_slice()));
        let (columns, distances) = distances.unwrap_or_default();
        let parts = [
            digest_of_images(&self.context),
            digest_of_images(&self.targets),
            digest_of_numbers(&[columns], distances),
        ];
        digest_of_all(&parts)
    }
}

/// A hash of several, in their order.
pub(crate) fn digest_of_all(digests: &[Sha256Digest]) -> Sha256Digest {
    Sha256Digest::of(digests.iter().map(|digest| digest.0).collect::<Vec<_>>().as_flattened())
}

fn digest_of_images(posed: &PosedImages) -> Sha256Digest {
    let images = digest_of_numbers(&[posed.size.height, posed.size.width], &posed.images);
    let mut cameras = Vec::new();
    for camera in &posed.cameras {
        add_camera(&mut cameras, camera);
    }
    digest_of_all(&[images, Sha256Digest::of(&cameras)])
}

/// Sizes, then numbers, little-endian.
fn digest_of_numbers(sizes: &[usize], numbers: &[f32]) -> Sha256Digest {
    let mut bytes = Vec::with_capacity(8 * sizes.len() + 4 * numbers.len());
    bytes.extend(sizes.iter().flat_map(|size| (*size as u64).to_le_bytes()));
    for number in numbers {
        bytes.extend_from_slice(&number.to_le_bytes());
    }
    Sha256Digest::of(&bytes)
}

fn add_camera(bytes: &mut Vec<u8>, camera: &Camera) {
    let Camera { camera_from_world, intrinsics, distortion } = camera;
    let NormalizedIntrinsics { fx, fy, cx, cy } = *intrinsics;
    let rotation = camera_from_world.rotation().to_cols_array();
    let numbers = rotation.into_iter().chain(camera_from_world.translation().to_array()).chain([fx, fy, cx, cy]);
    bytes.extend(numbers.flat_map(f64::to_le_bytes));
    if *distortion != Distortion::None {
        #[expect(clippy::expect_used, reason = "JSON can represent any numbers under fixed names")]
        let stored = serde_json::to_vec(distortion).expect("a lens as JSON");
        bytes.extend(stored);
    }
}

#[cfg(test)]
mod tests {
    use atsplat_camera::CameraFromWorld;
    use atsplat_model::ImageSize;
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::samples::PatchDistances;

    fn posed(first: f32) -> PosedImages {
        let pose = CameraFromWorld::new(DMat3::from_rotation_y(0.1), DVec3::new(f64::from(first), 0.2, 0.3)).unwrap();
        let camera = Camera::pinhole(pose, NormalizedIntrinsics::new(0.9, 0.8, 0.5, 0.4).unwrap());
        PosedImages { size: ImageSize::new(1, 2), images: vec![first, 0.1, 0.2, 0.3, 0.4, 0.5], cameras: vec![camera] }
    }

    /// Each part counts, and so does its place; the name does not.
    #[test]
    fn a_digest_is_of_images_cameras_and_distances() {
        let distances = Some(PatchDistances { columns: 2, distances: vec![1.0, 2.0] });
        let sample = Sample { name: "a".to_owned(), context: posed(0.6), targets: posed(0.7), distances };
        let changed = |change: fn(&mut Sample)| {
            let mut other = sample.clone();
            change(&mut other);
            other.digest()
        };
        let changes: [fn(&mut Sample); 9] = [
            |sample| sample.context.images[5] = 0.500_001,
            |sample| sample.targets.images.swap(1, 2),
            |sample| (sample.context, sample.targets) = (sample.targets.clone(), sample.context.clone()),
            |sample| sample.context.size = ImageSize::new(2, 1),
            |sample| sample.targets.cameras[0].intrinsics.fx = 0.91,
            |sample| sample.targets.cameras[0].camera_from_world = posed(0.8).cameras[0].camera_from_world,
            |sample| {
                sample.context.cameras[0].distortion =
                    Distortion::OpenCv { k1: 0.1, k2: 0.0, k3: 0.0, p1: 0.0, p2: 0.0 };
            },
            |sample| sample.distances = None,
            |sample| sample.distances = Some(PatchDistances { columns: 2, distances: vec![2.0, 1.0] }),
        ];
        let mut all: Vec<Sha256Digest> = changes.into_iter().map(changed).collect();
        all.push(sample.digest());
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 10, "all differ");
        assert_eq!(changed(|sample| "b".clone_into(&mut sample.name)), sample.digest());
    }
}
