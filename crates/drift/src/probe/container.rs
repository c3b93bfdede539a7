use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
use atsplat_model::weights::{DType, StoredTensor, StoredTensors};
use atsplat_pixels::{Image, ImageU8};
use atsplat_scene::SharedBytes;
use atsplat_splat::{GaussianParts, Gaussians};

use super::{Inputs, Outputs, View};
use crate::DriftError;

const WHAT: &str = "the probe's file";
/// The older name of the renderer, which files have.
const RENDERS: &str = "splatter";

pub(super) fn write(outputs: &Outputs) -> Result<Vec<u8>, DriftError> {
    let mut file = Writer::default();
    let Inputs { files, cameras, context, limit_scene } = &outputs.inputs;
    file.put("context", DType::U8, vec![*context], vec![1; *context])?;
    for (index, (bytes, camera)) in files.iter().zip(cameras).enumerate() {
        file.put(&format!("file.{index}"), DType::U8, vec![bytes.len()], bytes.clone())?;
        file.doubles(&format!("camera.{index}"), &numbers(camera))?;
    }
    for (index, image) in outputs.decoded.iter().enumerate() {
        file.image(&format!("decode.{index}"), image)?;
    }
    for (index, view) in outputs.views.iter().enumerate() {
        file.image(&format!("resize.{index}"), &view.image)?;
        file.doubles(&format!("resize.{index}.camera"), &numbers(&view.camera))?;
    }
    file.gaussians("model", &outputs.gaussians)?;
    file.gaussians("sheet", limit_scene)?;
    file.render("sheet", &outputs.limit_render)?;
    for (index, render) in outputs.renders.iter().enumerate() {
        file.render(&format!("{RENDERS}.{index}"), render)?;
    }
    for (index, scores) in outputs.scores.iter().enumerate() {
        for (id, score) in scores {
            file.doubles(&format!("metric.{index}.{id}"), &[*score])?;
        }
    }
    file.0.to_safetensors().map_err(|error| DriftError::invalid(WHAT, "tensors", error))
}

pub(super) fn read(bytes: &[u8]) -> Result<Outputs, DriftError> {
    let stored = StoredTensors::parse(SharedBytes::new(bytes.to_vec()));
    let file = Reader(stored.map_err(|error| DriftError::invalid(WHAT, "safetensors", error))?);
    let views = file.count("file");
    let mut inputs = Inputs {
        files: Vec::new(),
        cameras: Vec::new(),
        context: file.get("context", DType::U8)?.bytes().len(),
        limit_scene: file.gaussians("sheet")?,
    };
    let (mut decoded, mut resized) = (Vec::new(), Vec::new());
    for index in 0..views {
        inputs.files.push(file.get(&format!("file.{index}"), DType::U8)?.bytes().to_vec());
        inputs.cameras.push(file.camera(&format!("camera.{index}"))?);
        decoded.push(file.image(&format!("decode.{index}"))?);
        let image = file.image(&format!("resize.{index}"))?;
        resized.push(View { image, camera: file.camera(&format!("resize.{index}.camera"))? });
    }
    let (mut renders, mut scores) = (Vec::new(), Vec::new());
    for index in 0..file.count(RENDERS) {
        let name = format!("{RENDERS}.{index}");
        renders.push(file.render(&name)?);
        let prefix = format!("metric.{index}.");
        let ids = file.0.tensors.keys().filter_map(|name| Some((name, name.strip_prefix(&prefix)?)));
        let score = |(name, id): (&String, &str)| {
            let [score] = file.doubles(name)?;
            Ok((id.to_owned(), score))
        };
        scores.push(ids.map(score).collect::<Result<_, DriftError>>()?);
    }
    let (gaussians, limit_render) = (file.gaussians("model")?, file.render("sheet")?);
    Ok(Outputs { inputs, decoded, views: resized, gaussians, renders, limit_render, scores })
}

/// The rows of the pose, then the intrinsics.
fn numbers(camera: &Camera) -> [f64; 16] {
    let mut numbers = [0.0; 16];
    let k = camera.intrinsics;
    let all = camera.camera_from_world.to_rows().into_iter().chain([k.fx, k.fy, k.cx, k.cy]);
    numbers.iter_mut().zip(all).for_each(|(slot, number)| *slot = number);
    numbers
}

#[derive(Default)]
struct Writer(StoredTensors);

impl Writer {
    fn put(&mut self, name: &str, dtype: DType, shape: Vec<usize>, bytes: Vec<u8>) -> Result<(), DriftError> {
        let tensor = StoredTensor::new(dtype, shape, SharedBytes::new(bytes));
        let tensor = tensor.map_err(|error| DriftError::invalid(WHAT, "a tensor", error))?;
        self.0.tensors.insert(name.to_owned(), tensor);
        Ok(())
    }

    fn doubles(&mut self, name: &str, values: &[f64]) -> Result<(), DriftError> {
        self.put(name, DType::F64, vec![values.len()], values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn floats(&mut self, name: &str, shape: Vec<usize>, values: &[f32]) -> Result<(), DriftError> {
        self.put(name, DType::F32, shape, values.iter().flat_map(|v| v.to_le_bytes()).collect())
    }

    fn gaussians(&mut self, stage: &str, gaussians: &Gaussians) -> Result<(), DriftError> {
        let parts = gaussians.parts();
        for (name, wide, values) in [
            ("means", 3, parts.means.as_flattened()),
            ("quaternions", 4, parts.quaternions.as_flattened()),
            ("log-scales", 3, parts.log_scales.as_flattened()),
            ("opacity-logits", 1, parts.opacity_logits.as_slice()),
            ("sh", 3, parts.sh.as_flattened()),
        ] {
            self.floats(&format!("{stage}.{name}"), vec![values.len() / wide, wide], values)?;
        }
        Ok(())
    }

    fn render(&mut self, name: &str, render: &Image) -> Result<(), DriftError> {
        let shape = vec![render.height() as usize, render.width() as usize, 3];
        self.floats(name, shape, render.samples())
    }

    fn image(&mut self, name: &str, image: &ImageU8) -> Result<(), DriftError> {
        let shape = vec![image.height() as usize, image.width() as usize, 3];
        self.put(name, DType::U8, shape, image.samples().to_vec())
    }
}

struct Reader(StoredTensors);

impl Reader {
    /// Number of tensors named `prefix.0`, `prefix.1` and so on.
    fn count(&self, prefix: &str) -> usize {
        let exists = |index: &usize| self.0.tensors.contains_key(&format!("{prefix}.{index}"));
        (0..self.0.tensors.len()).take_while(exists).count()
    }

    fn get(&self, name: &str, dtype: DType) -> Result<&StoredTensor, DriftError> {
        let tensor = self.0.tensors.get(name);
        let tensor = tensor.ok_or_else(|| DriftError::invalid(WHAT, format!("a tensor {name:?}"), "none"))?;
        if tensor.dtype() == dtype {
            return Ok(tensor);
        }
        Err(DriftError::invalid(WHAT, format!("{dtype} in {name:?}"), tensor.dtype()))
    }

    fn floats(&self, name: &str) -> Result<Vec<f32>, DriftError> {
        let bytes = self.get(name, DType::F32)?.bytes();
        Ok(bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }

    fn doubles<const COUNT: usize>(&self, name: &str) -> Result<[f64; COUNT], DriftError> {
        let bytes = self.get(name, DType::F64)?.bytes();
        let values: Vec<f64> = bytes.as_chunks().0.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect();
        let count = values.len();
        values.try_into().ok().ok_or_else(|| DriftError::invalid(WHAT, format!("{COUNT} numbers in {name:?}"), count))
    }

    fn camera(&self, name: &str) -> Result<Camera, DriftError> {
        let [rows @ .., fx, fy, cx, cy] = self.doubles::<16>(name)?;
        let invalid = |error: &dyn std::fmt::Display| DriftError::invalid(WHAT, format!("a camera in {name:?}"), error);
        let pose = CameraFromWorld::from_rows(&rows).map_err(|error| invalid(&error))?;
        let intrinsics = NormalizedIntrinsics::new(fx, fy, cx, cy).map_err(|error| invalid(&error))?;
        Ok(Camera::pinhole(pose, intrinsics))
    }

    fn size(&self, name: &str, dtype: DType) -> Result<[u32; 2], DriftError> {
        let shape = self.get(name, dtype)?.shape();
        let sides = match shape {
            [height, width, 3] => u32::try_from(*height).ok().zip(u32::try_from(*width).ok()),
            _ => None,
        };
        let sides =
            sides.ok_or_else(|| DriftError::invalid(WHAT, format!("an image in {name:?}"), format!("{shape:?}")))?;
        Ok(sides.into())
    }

    fn gaussians(&self, stage: &str) -> Result<Gaussians, DriftError> {
        let floats = |field: &str| self.floats(&format!("{stage}.{field}"));
        let triples = |field: &str| Ok::<_, DriftError>(floats(field)?.as_chunks().0.to_vec());
        let (means, sh) = (triples("means")?, triples("sh")?);
        // Without Gaussians the degree is 0.
        let coefficients = sh.len().checked_div(means.len()).unwrap_or(1);
        let degrees = 0..=atsplat_splat::MAX_SH_DEGREE;
        let degree = degrees.into_iter().find(|degree| atsplat_splat::sh_coefficients(*degree) == coefficients);
        let parts = GaussianParts {
            quaternions: floats("quaternions")?.as_chunks().0.to_vec(),
            log_scales: triples("log-scales")?,
            opacity_logits: floats("opacity-logits")?,
            sh_degree: degree
                .ok_or_else(|| DriftError::invalid(WHAT, "a square number of coefficients", coefficients))?,
            scalars: None,
            filter_3d: None,
            means,
            sh,
        };
        Gaussians::new(parts).map_err(|error| DriftError::invalid(WHAT, format!("Gaussians of {stage:?}"), error))
    }

    fn render(&self, name: &str) -> Result<Image, DriftError> {
        let [height, width] = self.size(name, DType::F32)?;
        let render = Image::new(width, height, self.floats(name)?);
        render.map_err(|error| DriftError::invalid(WHAT, format!("an image in {name:?}"), error))
    }

    fn image(&self, name: &str) -> Result<ImageU8, DriftError> {
        let [height, width] = self.size(name, DType::U8)?;
        let image = ImageU8::new(width, height, self.get(name, DType::U8)?.bytes().to_vec());
        image.map_err(|error| DriftError::invalid(WHAT, format!("an image in {name:?}"), error))
    }
}
