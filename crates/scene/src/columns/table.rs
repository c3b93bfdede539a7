use std::path::Path;
use std::sync::Arc;

use arrow_array::builder::{Float64Builder, Int64Builder, StringBuilder, UInt32Builder, UInt64Builder};
use arrow_array::{ArrayRef, RecordBatch};
use atsplat_camera::Distortion;

use super::ColumnsError;
use super::schema::{CENTRE, INTRINSICS, LENS, POSE, schema};
use crate::{Frame, FrameImage, Scene};

/// Collects frames of any number of scenes into record batches.
#[derive(Debug, Default)]
pub struct CameraTable {
    rows: usize,
    text_bytes: usize,
    scene: StringBuilder,
    url: StringBuilder,
    frame: UInt64Builder,
    name: StringBuilder,
    timestamp_micros: Int64Builder,
    intrinsics: [Float64Builder; INTRINSICS.len()],
    distortion: StringBuilder,
    lens: [Float64Builder; LENS.len()],
    pose: [Float64Builder; POSE.len()],
    centre: [Float64Builder; CENTRE.len()],
    stated_width: UInt32Builder,
    stated_height: UInt32Builder,
    image: StringBuilder,
    image_path: StringBuilder,
    image_bytes: UInt64Builder,
}

impl CameraTable {
    /// Maximum rows of a batch: about 20 MB of numbers.
    pub const ROW_LIMIT: usize = 1 << 16;
    /// Maximum bytes of text of a batch.
    pub const TEXT_LIMIT: usize = 1 << 26;

    /// An empty table.
    pub fn new() -> Self {
        Self::default()
    }

    /// Rows added since the last [`Self::take`].
    pub const fn rows(&self) -> usize {
        self.rows
    }

    /// Adds all frames of a scene and passes every full batch to `full`. The remaining rows stay for the next scene or
    /// [`Self::take`].
    ///
    /// # Errors
    /// [`ColumnsError::RowTooLong`], [`ColumnsError::Arrow`], and those of `full`.
    pub fn push_scene<E: From<ColumnsError>>(
        &mut self,
        scene: &Scene,
        mut full: impl FnMut(RecordBatch) -> Result<(), E>,
    ) -> Result<(), E> {
        for (position, frame) in scene.frames.iter().enumerate() {
            let text = text_bytes(scene, frame);
            let too_full = self.rows >= Self::ROW_LIMIT || self.text_bytes.saturating_add(text) > Self::TEXT_LIMIT;
            if self.rows > 0 && too_full {
                full(self.take()?)?;
            }
            self.push(scene, position, frame)?;
        }
        Ok(())
    }

    /// Adds one frame.
    ///
    /// # Errors
    /// [`ColumnsError::RowTooLong`] if the frame's text alone exceeds a batch.
    pub fn push(&mut self, scene: &Scene, position: usize, frame: &Frame) -> Result<(), ColumnsError> {
        let text = text_bytes(scene, frame);
        if text > Self::TEXT_LIMIT {
            let scene = scene.key.chars().take(40).collect();
            return Err(ColumnsError::RowTooLong { scene, frame: position, limit: Self::TEXT_LIMIT, found: text });
        }
        self.rows += 1;
        self.text_bytes += text;

        self.scene.append_value(&scene.key);
        self.url.append_option(scene.url.as_deref());
        self.frame.append_value(position as u64);
        self.name.append_value(&frame.name);
        self.timestamp_micros.append_option(frame.timestamp_micros);

        let k = frame.camera.intrinsics;
        append(&mut self.intrinsics, [k.fx, k.fy, k.cx, k.cy]);
        let (model, lens) = lens_columns(&frame.camera.distortion);
        self.distortion.append_value(model);
        for (builder, value) in self.lens.iter_mut().zip(lens) {
            builder.append_option(value);
        }
        let pose = frame.camera.camera_from_world;
        let (rows, centre) = if frame.has_pose() {
            (pose.to_rows(), pose.inverse().centre().to_array())
        } else {
            ([f64::NAN; POSE.len()], [f64::NAN; CENTRE.len()])
        };
        append(&mut self.pose, rows);
        append(&mut self.centre, centre);

        self.stated_width.append_option(frame.stated_size.map(|size| size.width));
        self.stated_height.append_option(frame.stated_size.map(|size| size.height));
        self.image.append_value(match &frame.image {
            FrameImage::Absent => "absent",
            FrameImage::Missing(_) | FrameImage::Ambiguous(_) => "missing",
            FrameImage::File(_) => "file",
            FrameImage::Encoded(_) => "encoded",
            FrameImage::Generated(_) => "generated",
            FrameImage::Unposed { .. } => "unposed",
        });
        self.image_path.append_option(frame.image.listed_file().map(Path::to_string_lossy));
        self.image_bytes.append_option(match frame.image.in_source() {
            FrameImage::Encoded(bytes) => Some(bytes.len() as u64),
            _ => None,
        });
        Ok(())
    }

    /// Removes the rows added so far, as a batch of [`schema`].
    ///
    /// # Errors
    /// [`ColumnsError::Arrow`] if the columns do not match the schema.
    pub fn take(&mut self) -> Result<RecordBatch, ColumnsError> {
        let table = std::mem::take(self);
        Ok(RecordBatch::try_new(schema(), table.into_columns())?)
    }

    /// In the order of [`schema`].
    fn into_columns(mut self) -> Vec<ArrayRef> {
        fn floats<const N: usize>(builders: &mut [Float64Builder; N]) -> [ArrayRef; N] {
            builders.each_mut().map(|builder| Arc::new(builder.finish()) as ArrayRef)
        }
        let [r00, r01, r02, t0, r10, r11, r12, t1, r20, r21, r22, t2] = floats(&mut self.pose);
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(self.scene.finish()),
            Arc::new(self.url.finish()),
            Arc::new(self.frame.finish()),
            Arc::new(self.name.finish()),
            Arc::new(self.timestamp_micros.finish()),
        ];
        columns.extend(floats(&mut self.intrinsics));
        columns.push(Arc::new(self.distortion.finish()));
        columns.extend(floats(&mut self.lens));
        columns.extend([r00, r01, r02, r10, r11, r12, r20, r21, r22, t0, t1, t2]);
        columns.extend(floats(&mut self.centre));
        columns.push(Arc::new(self.stated_width.finish()));
        columns.push(Arc::new(self.stated_height.finish()));
        columns.push(Arc::new(self.image.finish()));
        columns.push(Arc::new(self.image_path.finish()));
        columns.push(Arc::new(self.image_bytes.finish()));
        columns
    }
}

fn append<const N: usize>(builders: &mut [Float64Builder; N], values: [f64; N]) {
    for (builder, value) in builders.iter_mut().zip(values) {
        builder.append_value(value);
    }
}

/// The model's name and its coefficients in the order of [`LENS`].
fn lens_columns(distortion: &Distortion) -> (&'static str, [Option<f64>; LENS.len()]) {
    match *distortion {
        Distortion::None => ("none", [None; 6]),
        Distortion::OpenCv { k1, k2, k3, p1, p2 } => {
            ("opencv", [Some(k1), Some(k2), Some(k3), None, Some(p1), Some(p2)])
        }
        Distortion::Fisheye { k: [k1, k2, k3, k4] } => {
            ("fisheye", [Some(k1), Some(k2), Some(k3), Some(k4), None, None])
        }
    }
}

/// Bytes of a row's text; an upper bound for a path that is not UTF-8.
fn text_bytes(scene: &Scene, frame: &Frame) -> usize {
    // A byte that is not UTF-8 becomes U+FFFD, three bytes.
    let path = frame.image.listed_file().map_or(0, |path| path.as_os_str().len().saturating_mul(3));
    [scene.url.as_ref().map_or(0, String::len), frame.name.len(), path]
        .into_iter()
        .fold(scene.key.len(), usize::saturating_add)
}
