//! Reads cameras from files: any dataset that `scene` reads, the `cameras.json` of models trained with 3DGS, lists of
//! poses, and the `render.json` of `atsplat render`.

use std::path::Path;

use anyhow::{Context as _, bail};
use atsplat_camera::{
    Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics, PixelIntrinsics, WorldFromCamera,
};
use atsplat_scene::{SceneSource as _, Warnings, json, poses};
use atsplat_splat::{Exposure, View};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::views::Shot;
use crate::dataset_args::key_of;

/// A camera read from a file.
#[derive(Clone, Debug)]
pub(crate) struct FileCamera {
    /// Number in the names of its image files.
    pub(crate) number: usize,
    /// Name in the camera file.
    pub(crate) name: String,
    pub(crate) camera: Camera,
    /// In pixels, if known from the file or the image.
    pub(crate) size: Option<ImageSize>,
    pub(crate) exposure: Option<Exposure>,
}

/// The lens for files that hold only poses.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LensOfPoses {
    /// Horizontal field of view in degrees; an error for files with intrinsics.
    pub(crate) fov: Option<f64>,
    pub(crate) size: Option<ImageSize>,
}

/// A camera in `render.json`, without loss of precision.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct CameraRecord {
    number: usize,
    name: String,
    width: u32,
    height: u32,
    camera_from_world: [f64; 12],
    /// Relative to image width and height.
    intrinsics: NormalizedIntrinsics,
    #[serde(default)]
    distortion: Distortion,
    /// The 3×4 array of 3DGS' exposure.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    exposure: Option<[[f64; 4]; 3]>,
}

/// A camera as written by 3DGS' `camera_to_JSON` (graphdeco-inria/gaussian-splatting `utils/camera_utils.py`): centre and
/// axes of the camera in the world, focal lengths in pixels, the principal point in the middle.
#[derive(Debug, Deserialize)]
struct TrainedCamera {
    img_name: String,
    width: u32,
    height: u32,
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
}

/// Reads every camera of a file or folder; `key` selects a scene if there are several. Images may be missing.
pub(crate) fn read(
    path: &Path,
    key: Option<&str>,
    lens: LensOfPoses,
    warnings: &mut Warnings,
) -> anyhow::Result<Vec<FileCamera>> {
    let json = if path.is_file() { json_of(path)? } else { None };
    if let Some(list @ Value::Array(entries)) = &json
        && poses::is_list_of_poses(list)
    {
        return posed(entries, path, lens);
    }
    if lens.fov.is_some() {
        bail!("--fov is for files with only poses: {} has intrinsics of its own", path.display());
    }
    let cameras = match json {
        Some(list @ Value::Array(_)) => trained_cameras(list).with_context(|| in_file(path))?,
        // OpenMVG has a field of this name, too.
        Some(Value::Object(mut object)) if object.contains_key("views") && !object.contains_key("sfm_data_version") => {
            let views = object.remove("views").map(serde_json::from_value).transpose();
            let views: Option<Vec<Value>> = views.with_context(|| format!("{}: views", in_file(path)))?;
            each(views.context("no views")?, recorded).with_context(|| in_file(path))?
        }
        _ => {
            let mut found = Warnings::new();
            let cameras = of_dataset(path, key, &mut found);
            warnings.merge(found.about_cameras());
            cameras?
        }
    };
    if cameras.is_empty() {
        bail!("{} holds no camera", path.display());
    }
    Ok(cameras)
}

fn in_file(path: &Path) -> String {
    format!("reading cameras from {}", path.display())
}

/// Parses the file if it looks like JSON.
fn json_of(path: &Path) -> anyhow::Result<Option<Value>> {
    let bytes = std::fs::read(path).with_context(|| in_file(path))?;
    let start = bytes.trim_ascii_start();
    if !start.starts_with(b"[") && !start.starts_with(b"{") {
        return Ok(None);
    }
    json::parse(start).map(Some).with_context(|| format!("{}: expected JSON", in_file(path)))
}

/// Reads 3DGS' list of cameras.
fn trained_cameras(list: Value) -> anyhow::Result<Vec<FileCamera>> {
    let is_trained = |camera: &Value| camera.get("position").is_some() && camera.get("rotation").is_some();
    match list {
        Value::Array(entries) if entries.first().is_some_and(is_trained) => each(entries, trained),
        other => bail!(
            "expected a dataset's cameras, a render.json, 3DGS' cameras.json or a list of camera matrices, found {}",
            json::describe(&other)
        ),
    }
}

/// Cameras from poses that share one lens.
fn posed(entries: &[Value], path: &Path, LensOfPoses { fov, size }: LensOfPoses) -> anyhow::Result<Vec<FileCamera>> {
    let (Some(fov), Some(size)) = (fov, size) else {
        bail!(
            "{} holds camera matrices without intrinsics: set the field of view with --fov and the image size with --size",
            path.display()
        )
    };
    let intrinsics = NormalizedIntrinsics::with_horizontal_view(fov.to_radians(), size)?;
    let camera = |(number, pose)| FileCamera {
        number,
        name: number.to_string(),
        camera: Camera::pinhole(pose, intrinsics),
        size: Some(size),
        exposure: None,
    };
    Ok(poses::poses(entries, path)?.into_iter().enumerate().map(camera).collect())
}

fn each<T: for<'de> Deserialize<'de>>(
    entries: Vec<Value>,
    camera: impl Fn(usize, T) -> anyhow::Result<FileCamera>,
) -> anyhow::Result<Vec<FileCamera>> {
    let one = |(at, entry)| {
        let read = serde_json::from_value(entry).map_err(anyhow::Error::from).and_then(|entry| camera(at, entry));
        read.with_context(|| format!("camera {at}"))
    };
    entries.into_iter().enumerate().map(one).collect()
}

fn trained(at: usize, entry: TrainedCamera) -> anyhow::Result<FileCamera> {
    let size = ImageSize { width: entry.width, height: entry.height };
    let centre = (0.5 * f64::from(size.width), 0.5 * f64::from(size.height));
    let intrinsics = PixelIntrinsics::new(entry.fx, entry.fy, centre.0, centre.1)?.normalized_from_pixel(size)?;
    let ([r0, r1, r2], [x, y, z]) = (entry.rotation, entry.position);
    let rows = [r0[0], r0[1], r0[2], x, r1[0], r1[1], r1[2], y, r2[0], r2[1], r2[2], z];
    let pose = WorldFromCamera::from_rows(&rows)?;
    Ok(FileCamera {
        number: at,
        name: entry.img_name,
        camera: Camera::pinhole(pose.inverse(), intrinsics),
        size: Some(size),
        exposure: None,
    })
}

fn recorded(_: usize, entry: CameraRecord) -> anyhow::Result<FileCamera> {
    let NormalizedIntrinsics { fx, fy, cx, cy } = entry.intrinsics;
    let camera = Camera {
        camera_from_world: CameraFromWorld::from_rows(&entry.camera_from_world)?,
        intrinsics: NormalizedIntrinsics::new(fx, fy, cx, cy)?,
        distortion: entry.distortion,
    };
    let size = ImageSize { width: entry.width, height: entry.height };
    let exposure = entry.exposure.map(Exposure::from_3dgs);
    Ok(FileCamera { number: entry.number, name: entry.name, camera, size: Some(size), exposure })
}

impl CameraRecord {
    pub(crate) fn of(Shot { number, name, view: View { camera, size }, exposure }: &Shot) -> Self {
        Self {
            number: *number,
            name: name.clone(),
            width: size.width,
            height: size.height,
            camera_from_world: camera.camera_from_world.to_rows(),
            intrinsics: camera.intrinsics,
            distortion: camera.distortion,
            exposure: exposure.map(|exposure| exposure.to_3dgs()),
        }
    }
}

fn of_dataset(path: &Path, key: Option<&str>, warnings: &mut Warnings) -> anyhow::Result<Vec<FileCamera>> {
    let dataset = atsplat_scene::open(path, warnings)?;
    let key = key_of(&dataset, key)?;
    let scene = dataset.load(key, warnings)?;
    let cameras = scene.frames.iter().enumerate().map(|(number, frame)| {
        // If an image cannot be read, its size stays unknown.
        let of_picture = || if frame.picture.is_there() { frame.size(key, number).ok() } else { None };
        let size = frame.stated_size.or_else(of_picture);
        FileCamera { number, name: frame.name.clone(), camera: frame.camera, size, exposure: None }
    });
    Ok(cameras.collect())
}
