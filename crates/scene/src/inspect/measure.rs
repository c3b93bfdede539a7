use std::collections::BTreeMap;

use atsplat_camera::{Camera, Distortion, ImageSize, WorldFromCamera};
use atsplat_numeric::Extremes;
use glam::DVec3;

use super::check::{image_cut_short, is_empty_file, mixed_sizes};
use super::still_cameras::{is_in_one_place, still_cameras};
use super::unlisted::report_unlisted;
use super::{ImageCounts, LensCounts, SizeSampling};
use crate::{Frame, FrameImage, Scene, WarningKind, Warnings};

/// The measurements of one scene, without its images.
pub(super) struct SceneMeasure {
    pub(super) key: String,
    pub(super) images: ImageCounts,
    pub(super) lenses: LensCounts,
    pub(super) sizes: BTreeMap<ImageSize, u64>,
    pub(super) stated_sizes: BTreeMap<ImageSize, u64>,
    pub(super) frames: Vec<FrameMeasure>,
    pub(super) extent: Option<f64>,
    pub(super) path_length: f64,
    pub(super) is_in_one_place: bool,
}

/// The numbers of one frame.
pub(super) struct FrameMeasure {
    /// `fx`, `fy`, `cx`, `cy`, and the horizontal and vertical field of view in degrees.
    pub(super) pinhole: [f64; Self::PINHOLE],
    /// Distance and angle in degrees from the previous frame; `None` for a scene's first frame, and if either has no usable pose.
    pub(super) motion: Option<[f64; Self::MOTION]>,
}

impl FrameMeasure {
    pub(super) const PINHOLE: usize = 6;
    pub(super) const MOTION: usize = 2;

    fn of(camera: &Camera, motion: Option<[f64; 2]>) -> Self {
        let (k, fov) = (camera.intrinsics, camera.intrinsics.field_of_view());
        Self { pinhole: [k.fx, k.fy, k.cx, k.cy, fov.x.to_degrees(), fov.y.to_degrees()], motion }
    }
}

impl SceneMeasure {
    pub(super) fn of(scene: &Scene, sampling: SizeSampling, warnings: &mut Warnings) -> Self {
        let pose = |frame: &Frame| frame.has_pose().then(|| frame.camera.camera_from_world.inverse());
        let poses: Vec<Option<WorldFromCamera>> = scene.frames.iter().map(pose).collect();
        let motions = poses.windows(2).map(|pair| match pair {
            [Some(before), Some(after)] => Some(motion(before, after)),
            _ => None,
        });
        let frames: Vec<FrameMeasure> = std::iter::once(None)
            .chain(motions)
            .zip(&scene.frames)
            .map(|(motion, frame)| FrameMeasure::of(&frame.camera, motion))
            .collect();
        // Not `sum()`, which is −0 if there are no steps.
        let path_length = frames.iter().filter_map(|frame| frame.motion).fold(0.0, |sum, [step, _]| sum + step);
        let mut measure = Self {
            key: scene.key.clone(),
            images: ImageCounts::default(),
            lenses: LensCounts::default(),
            sizes: BTreeMap::new(),
            stated_sizes: BTreeMap::new(),
            frames,
            extent: extent(&poses.into_iter().flatten().collect::<Vec<_>>()),
            path_length,
            is_in_one_place: is_in_one_place(scene),
        };
        let with_image = measure.count(scene, warnings);
        measure.read_headers(&scene.key, &with_image, sampling, warnings);
        report_unlisted(scene, warnings);
        if let Some(detail) = still_cameras(scene) {
            warnings.push(WarningKind::RepeatedPose, scene.key.as_str(), detail);
        }
        measure
    }

    /// Counts the frames, and returns those with an image that is not empty, with their positions.
    fn count<'a>(&mut self, scene: &'a Scene, warnings: &mut Warnings) -> Vec<(usize, &'a Frame)> {
        let mut with_image = Vec::new();
        for (position, frame) in scene.frames.iter().enumerate() {
            let counts = &mut self.images;
            let (count, is_there) = match &frame.image {
                FrameImage::File(path) if is_empty_file(path) => {
                    let detail = format!("frame {position}: the file is empty ({})", path.display());
                    warnings.push(WarningKind::EmptyImage, scene.key.as_str(), detail);
                    (&mut counts.empty, false)
                }
                FrameImage::File(_) => (&mut counts.files, true),
                FrameImage::Encoded(_) | FrameImage::Generated(_) => (&mut counts.encoded, true),
                FrameImage::Missing(_) | FrameImage::Ambiguous(_) => (&mut counts.missing, false),
                FrameImage::Unposed { .. } => (&mut counts.unposed, false),
                FrameImage::Absent => (&mut counts.absent, false),
            };
            *count += 1;
            if is_there {
                with_image.push((position, frame));
            }
            *match frame.camera.distortion {
                Distortion::None => &mut self.lenses.pinhole,
                Distortion::OpenCv { .. } => &mut self.lenses.opencv,
                Distortion::Fisheye { .. } => &mut self.lenses.fisheye,
            } += 1;
            if let Some(size) = frame.stated_size {
                *self.stated_sizes.entry(size).or_default() += 1;
            }
        }
        with_image
    }

    fn read_headers(
        &mut self,
        key: &str,
        with_image: &[(usize, &Frame)],
        sampling: SizeSampling,
        warnings: &mut Warnings,
    ) {
        let mut sizes = Vec::new();
        for chosen in evenly_spread(with_image.len(), sampling) {
            let Some((position, frame)) = with_image.get(chosen) else { continue };
            let read = frame.header(key, *position).and_then(|header| Ok((header, image_cut_short(&frame.image)?)));
            match read {
                Ok((header, problem)) => {
                    self.images.headers_read += 1;
                    *self.sizes.entry(header.size).or_default() += 1;
                    sizes.push((*position, header.size));
                    let mismatch = frame.mismatch(header.size);
                    self.images.unfit += u64::from(mismatch.is_some_and(|mismatch| mismatch.is_fatal()));
                    frame.report(key, *position, &header, warnings);
                    if let Some(problem) = problem {
                        self.images.cut_short += 1;
                        let detail = format!("frame {position}: {problem} ({})", frame.image.place());
                        warnings.push(WarningKind::UnreadableImage, key, detail);
                    }
                }
                Err(error) => {
                    self.images.headers_unreadable += 1;
                    warnings.push(WarningKind::UnreadableImage, key, error.to_string());
                }
            }
        }
        if let Some(detail) = mixed_sizes(&sizes) {
            warnings.push(WarningKind::MixedSizes, key, detail);
        }
    }
}

/// Distance and angle in degrees from one camera to the next.
fn motion(before: &WorldFromCamera, after: &WorldFromCamera) -> [f64; 2] {
    // ‖R₁ − R₂‖ = 2√2 · sin(θ/2): exact for the small angles of a video, where arccos of the trace is not.
    let difference = after.rotation() - before.rotation();
    let frobenius = difference.to_cols_array().iter().map(|entry| entry * entry).sum::<f64>().sqrt();
    let half_sine = (frobenius / 8f64.sqrt()).minimum_of(1.0);
    [after.centre().distance(before.centre()), (2.0 * half_sine.asin()).to_degrees()]
}

/// Largest distance from the mean centre; `None` without cameras.
fn extent(poses: &[WorldFromCamera]) -> Option<f64> {
    let mean = poses.iter().map(WorldFromCamera::centre).sum::<DVec3>() / poses.len() as f64;
    poses.iter().map(|pose| pose.centre().distance(mean)).reduce(Extremes::maximum_of)
}

/// Positions in `0..count`, evenly spread from the first to the last.
fn evenly_spread(count: usize, sampling: SizeSampling) -> Vec<usize> {
    let chosen = match sampling {
        SizeSampling::PerScene(at_most) => at_most.min(count),
        SizeSampling::All => count,
    };
    let (last, gaps) = (count.saturating_sub(1), chosen.saturating_sub(1).max(1));
    (0..chosen).map(|n| n * last / gaps).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_include_the_first_and_the_last() {
        assert_eq!(evenly_spread(10, SizeSampling::PerScene(3)), [0, 4, 9]);
        assert_eq!(evenly_spread(10, SizeSampling::PerScene(1)), [0]);
        assert_eq!(evenly_spread(2, SizeSampling::PerScene(5)), [0, 1]);
        assert_eq!(evenly_spread(3, SizeSampling::All), [0, 1, 2]);
        assert!(evenly_spread(3, SizeSampling::PerScene(0)).is_empty());
        assert!(evenly_spread(0, SizeSampling::All).is_empty());
    }
}
