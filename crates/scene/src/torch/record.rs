use std::path::Path;

use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
use atsplat_pickle::shortened;

use super::{Dict, TorchError, Value};
use crate::checks::cut_short::cut_short;
use crate::{Frame, FrameImage, Scene, SceneError, SharedBytes, WarningKind, Warnings};

/// Columns of a `cameras` row.
const CAMERA_COLUMNS: usize = 18;

/// One scene as stored in a chunk: the dict that pixelSplat's loader reads (`src/dataset/dataset_re10k.py`; written by
/// `real_estate_10k_tools` `src/convert.py:65-152`).
///
/// `timestamps`, `cameras` and `images` have the same length.
#[derive(Clone, Debug)]
pub struct ChunkScene {
    /// The scene's key in evaluation indices.
    pub key: String,
    /// Source of the video; empty if unknown.
    pub url: String,
    /// For RE10K and ACID microseconds since the start of the video, for DL3DV frame numbers.
    pub timestamps: Vec<i64>,
    /// fx, fy, cx, cy in units of the image's size, two zeros, and the row-major 3×4 world-to-camera matrix with OpenCV
    /// axes. Chunks store f32.
    pub cameras: Vec<[f64; CAMERA_COLUMNS]>,
    /// Encoded images: JPEG for RE10K, PNG for DL3DV. Those of a chunk are unread until [`SharedBytes::verify`] is called.
    pub images: Vec<SharedBytes>,
}

impl ChunkScene {
    pub(super) fn from_dict(key: &str, dict: &Dict) -> Result<Self, TorchError> {
        let fields = Fields { key, dict };
        let timestamps = fields.integers("timestamps")?;
        let cameras = fields.camera_rows("cameras")?;
        let images = fields.images("images")?;
        let scene = Self { key: key.to_owned(), url: fields.optional_text("url")?, timestamps, cameras, images };
        scene.require_equal_lengths()?;
        Ok(scene)
    }

    pub(super) fn require_equal_lengths(&self) -> Result<(), TorchError> {
        let frames = self.timestamps.len();
        for (field, len) in [("cameras", self.cameras.len()), ("images", self.images.len())] {
            if len != frames {
                let expected = format!("{frames}, as many as timestamps");
                return Err(TorchError::malformed(at(&self.key, field), expected, len.to_string()));
            }
        }
        Ok(())
    }

    /// The scene, with frames named by timestamp. `path` is the chunk, for messages. A frame whose pose is unusable is
    /// [`FrameImage::Unposed`].
    ///
    /// # Errors
    /// [`SceneError::Camera`] if a row's intrinsics are invalid, [`SceneError::NoPose`] if no row has a usable pose.
    pub fn to_scene(&self, path: &Path) -> Result<Scene, SceneError> {
        let mut frames = Vec::with_capacity(self.timestamps.len());
        let rows = self.timestamps.iter().zip(&self.cameras).zip(&self.images);
        for (position, ((&timestamp, row), image)) in rows.enumerate() {
            let [fx, fy, cx, cy, _, _, pose @ ..] = *row;
            let location = || format!("scene {:?}, frame {position}", shortened(&self.key));
            let located = |source| SceneError::camera(path, location())(source);
            let intrinsics = NormalizedIntrinsics::new(fx, fy, cx, cy).map_err(located)?;
            let image = FrameImage::Encoded(image.clone());
            let (pose, image) = match CameraFromWorld::from_rows(&pose) {
                Ok(pose) => (pose, image),
                Err(error) => (CameraFromWorld::UNKNOWN, image.unposed(located(error).to_string())),
            };
            frames.push(Frame {
                name: timestamp.to_string(),
                timestamp_micros: Some(timestamp),
                camera: Camera::pinhole(pose, intrinsics),
                stated_size: None,
                image,
            });
        }
        let url = (!self.url.is_empty()).then(|| self.url.clone());
        Scene { key: self.key.clone(), url, frames }.require_a_pose()
    }

    /// Warns about lens distortion that is ignored: columns 5 and 6 are RE10K's slots for radial coefficients, which are
    /// zero there.
    pub(super) fn report_radial(&self, warnings: &mut Warnings) {
        let is_distorted = |[_, _, _, _, k1, k2, ..]: &[f64; CAMERA_COLUMNS]| *k1 != 0.0 || *k2 != 0.0;
        if let Some(first) = self.cameras.iter().position(is_distorted) {
            let count = self.cameras.iter().filter(|row| is_distorted(row)).count();
            let detail = format!(
                "field cameras: columns 5 and 6 are not zero in {count} of {} rows, first {first}; no loader of the field \
                 reads them",
                self.cameras.len()
            );
            warnings.push(WarningKind::LensDistortion, &self.key, detail);
        }
    }

    /// Converts a scene for storage in a chunk: encoded images are unchanged, lens distortion is dropped with a warning.
    ///
    /// Images are not decoded: one whose header cannot be read, or whose end is missing, is stored with a warning.
    ///
    /// A frame without a timestamp gets the number at the end of its name, as in depthsplat
    /// (`src/scripts/convert_dl3dv_test.py`: the integer after the last `_` of the file stem).
    ///
    /// # Errors
    /// [`SceneError::NoTimestamp`] for a frame with neither timestamp nor number, [`SceneError::NoImage`] for one without an
    /// image, [`SceneError::NoPose`] for one without a usable pose, [`SceneError::Io`] and [`SceneError::Damaged`] if an image
    /// cannot be read.
    pub fn from_scene(scene: &Scene, warnings: &mut Warnings) -> Result<Self, SceneError> {
        let mut stored = Self {
            key: scene.key.clone(),
            url: scene.url.clone().unwrap_or_default(),
            timestamps: Vec::with_capacity(scene.frames.len()),
            cameras: Vec::with_capacity(scene.frames.len()),
            images: Vec::with_capacity(scene.frames.len()),
        };
        let mut distorted = 0;
        for (position, frame) in scene.frames.iter().enumerate() {
            let timestamp = timestamp_of(frame, &scene.key, position)?;
            let header = frame.header(&scene.key, position);
            let image = encoded_image(frame, &scene.key, position)?;
            let problem = match header {
                Ok(header) => {
                    frame.report(&scene.key, position, &header, warnings);
                    let place = frame.image.place();
                    cut_short(&image).map(|problem| format!("frame {position}: {problem} ({place})"))
                }
                Err(error) => Some(error.to_string()),
            };
            if let Some(problem) = problem {
                warnings.push(WarningKind::UnreadableImage, &scene.key, problem);
            }
            stored.images.push(image);
            stored.timestamps.push(timestamp);
            stored.cameras.push(row_from_camera(&frame.camera));
            distorted += usize::from(frame.camera.distortion != atsplat_camera::Distortion::None);
        }
        if distorted > 0 {
            let detail = format!("chunks cannot store the lens distortion of {distorted} frames");
            warnings.push(WarningKind::LensDistortion, &scene.key, detail);
        }
        Ok(stored)
    }
}

fn timestamp_of(frame: &Frame, scene: &str, position: usize) -> Result<i64, SceneError> {
    let timestamp = frame.timestamp_micros.or_else(|| number_at_end(&frame.name));
    timestamp.ok_or_else(|| SceneError::NoTimestamp {
        scene: scene.to_owned(),
        frame: position,
        name: frame.name.clone(),
    })
}

/// The encoded image, verified if it is from a chunk.
fn encoded_image(frame: &Frame, scene: &str, position: usize) -> Result<SharedBytes, SceneError> {
    let bytes = frame.bytes(scene, position)?;
    Ok(if let FrameImage::Encoded(shared) = &frame.image {
        shared.clone()
    } else {
        SharedBytes::new(bytes.into_owned())
    })
}

fn row_from_camera(camera: &Camera) -> [f64; CAMERA_COLUMNS] {
    let mut row = [0.0; CAMERA_COLUMNS];
    let k = camera.intrinsics;
    let pose = camera.camera_from_world.to_rows();
    let numbers = [k.fx, k.fy, k.cx, k.cy, 0.0, 0.0].into_iter().chain(pose);
    for (to, from) in row.iter_mut().zip(numbers) {
        *to = from;
    }
    row
}

fn number_at_end(name: &str) -> Option<i64> {
    name.rsplit('_').next()?.parse().ok()
}

fn at(key: &str, field: &str) -> String {
    format!("scene {:?}, field {field}", shortened(key))
}

/// A scene's dict, with the scene's key for errors.
struct Fields<'a> {
    key: &'a str,
    dict: &'a Dict,
}

impl Fields<'_> {
    fn get(&self, field: &str, expected: &str) -> Result<&Value, TorchError> {
        self.dict.get(field).ok_or_else(|| TorchError::malformed(at(self.key, field), expected, "no such field"))
    }

    fn wrong(&self, field: &str, expected: &str, found: &impl ToString) -> TorchError {
        TorchError::malformed(at(self.key, field), expected, found.to_string())
    }

    fn optional_text(&self, field: &str) -> Result<String, TorchError> {
        match self.dict.get(field) {
            None | Some(Value::None) => Ok(String::new()),
            Some(Value::Str(text)) => Ok(text.to_string()),
            Some(other) => Err(self.wrong(field, "text", other)),
        }
    }

    fn integers(&self, field: &str) -> Result<Vec<i64>, TorchError> {
        const EXPECTED: &str = "an integer tensor of shape [N]";
        match self.get(field, EXPECTED)? {
            Value::Tensor(tensor) if tensor.shape().len() == 1 => {
                tensor.to_i64().map_err(|source| self.wrong(field, EXPECTED, &source))
            }
            other => Err(self.wrong(field, EXPECTED, other)),
        }
    }

    fn camera_rows(&self, field: &str) -> Result<Vec<[f64; CAMERA_COLUMNS]>, TorchError> {
        const EXPECTED: &str = "a float tensor of shape [N, 18]";
        match self.get(field, EXPECTED)? {
            Value::Tensor(tensor) if matches!(tensor.shape(), [_, columns] if *columns == CAMERA_COLUMNS as u64) => {
                let numbers = tensor.to_f64().map_err(|source| self.wrong(field, EXPECTED, &source))?;
                Ok(numbers.as_chunks().0.to_vec())
            }
            other => Err(self.wrong(field, EXPECTED, other)),
        }
    }

    fn images(&self, field: &str) -> Result<Vec<SharedBytes>, TorchError> {
        const EXPECTED: &str = "a list of contiguous uint8 tensors of shape [bytes]";
        let value = self.get(field, EXPECTED)?;
        let items = value.as_sequence().ok_or_else(|| self.wrong(field, EXPECTED, value))?;
        let bytes = items.iter().enumerate().map(|(position, item)| match item {
            // Others would be copied at each of any number of references.
            Value::Tensor(tensor)
                if tensor.dtype() == super::DType::U8 && tensor.shape().len() == 1 && tensor.is_contiguous() =>
            {
                let wrong = |source| self.wrong(&format!("{field}[{position}]"), EXPECTED, &source);
                tensor.to_unread_bytes().map_err(wrong)
            }
            other => Err(self.wrong(&format!("{field}[{position}]"), EXPECTED, other)),
        });
        bytes.collect()
    }
}
