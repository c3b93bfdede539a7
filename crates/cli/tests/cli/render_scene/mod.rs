//! A small scene and its renders.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{RenderOptions, Rendering, View, files};
use serde_json::Value;

use crate::common::{read_json, write_trajectory};

/// A few Gaussians that an independent script wrote.
pub(crate) fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../splat/tests/fixtures/files").join(name)
}

/// Six Gaussians in front of a camera at the origin, one of them with an infinite logit and one with a NaN.
pub(crate) const SCENE: &str = "ply
format ascii 1.0
element vertex 6
property float x
property float y
property float z
property float f_dc_0
property float f_dc_1
property float f_dc_2
property float opacity
property float scale_0
property float scale_1
property float scale_2
property float rot_0
property float rot_1
property float rot_2
property float rot_3
property float uncertainty
end_header
0 0 3 1 0 -1 2 -2 -2.5 -3 1 0 0 0 0.5
0.5 0.1 2.5 0 1 0.5 1 -2 -2 -2 0.9 0.1 0.2 0 0.25
-0.6 -0.2 4 -0.5 0.3 1.5 inf -1.5 -2 -2 1 0 0.5 0 0.125
0.2 -0.4 3.5 1.2 1.2 1.2 -1 -1 -1 -1 1 0 0 0 1
0 0 -5 1 1 1 3 -1 -1 -1 1 0 0 0 1
nan 0 3 1 1 1 3 -1 -1 -1 1 0 0 0 1
";

/// A scene and a trajectory in an empty folder.
pub(crate) fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.ply"), SCENE).unwrap();
    write_trajectory(&folder.path().join("path.txt"), 12);
    folder
}

pub(crate) fn record(folder: &Path) -> Value {
    read_json(&folder.join("render.json"))
}

/// Every file of a folder, by name.
pub(crate) fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder).unwrap().map(|file| file.unwrap());
    files.map(|file| (file.file_name().into_string().unwrap(), fs::read(file.path()).unwrap())).collect()
}

/// The view that `render.json` tells of, rendered by the library.
pub(crate) fn rendered(scene: &Path, view: &Value, options: &RenderOptions) -> Rendering<f32> {
    let (gaussians, _) = files::read(scene).unwrap();
    let rows: [f64; 12] = serde_json::from_value(view["camera-from-world"].clone()).unwrap();
    let intrinsics: NormalizedIntrinsics = serde_json::from_value(view["intrinsics"].clone()).unwrap();
    let camera = atsplat_camera::Camera::pinhole(CameraFromWorld::from_rows(&rows).unwrap(), intrinsics);
    let side = |name: &str| u32::try_from(view[name].as_u64().unwrap()).unwrap();
    let size = atsplat_camera::ImageSize { width: side("width"), height: side("height") };
    CpuRenderer::default().render(&gaussians, &View { camera, size }, options).unwrap()
}

pub(crate) fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}
