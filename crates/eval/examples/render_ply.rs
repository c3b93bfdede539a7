//! Renders a file of Gaussians (PLY, SPZ, .splat) from a camera in front of it: `render_ply SCENE.ply OUT.png`.

use std::f64::consts::FRAC_PI_3;
use std::path::Path;

use anyhow::Context as _;
use atsplat_camera::{Camera, ImageSize, NormalizedIntrinsics, Turntable};
use atsplat_pixels::{Image, Rounding, encode_png};
use atsplat_splat::cpu::{CpuOptions, CpuRenderer};
use atsplat_splat::{RenderOptions, View, files};
use glam::DVec3;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, out] = arguments.as_slice() else { anyhow::bail!("usage: render_ply SCENE.ply OUT.png") };
    let (gaussians, _) = files::read(Path::new(scene))?;
    let bounds = gaussians.bounds_of_means().context("the file contains no Gaussian")?;

    let size = ImageSize { width: 320, height: 240 };
    let intrinsics = NormalizedIntrinsics::with_horizontal_view(FRAC_PI_3, size)?;
    let table = Turntable {
        target: bounds.centre(),
        up: DVec3::NEG_Y,
        distance: intrinsics.distance_that_frames(0.5 * bounds.size().length())?,
        elevation: 0.2,
        azimuth: 0.0,
        sweep: 0.0,
    };
    let pose = table.poses(1)?[0];
    let view = View { camera: Camera::pinhole(pose.inverse(), intrinsics), size };
    let rendering = CpuRenderer::new(CpuOptions::default()).render(&gaussians, &view, &RenderOptions::default())?;

    let image = Image::new(size.width, size.height, rendering.rgb.into_flattened())?;
    std::fs::write(out, encode_png(&image.to_u8(Rounding::Nearest)?)?)?;
    Ok(())
}
