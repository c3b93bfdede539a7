//! The settings of `eval/sweeps/cut-offs.toml` under every preset.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{GaussianParts, Gaussians, ReferenceRenderer, RenderOptions, Renderer, RendererConstants, View};

const SWEEP: &str = include_str!("../../../eval/sweeps/cut-offs.toml");

/// An opaque Gaussian that covers the image, in front of nothing.
fn sheet() -> Gaussians {
    Gaussians::new(GaussianParts {
        means: vec![[0.0, 0.0, 1.0]],
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[3.0, 3.0, -3.0]],
        opacity_logits: vec![20.0],
        sh: vec![[0.5, 0.1, -0.2]],
        ..GaussianParts::default()
    })
    .unwrap()
}

fn view() -> View {
    let camera = Camera::pinhole(CameraFromWorld::IDENTITY, NormalizedIntrinsics::new(1.0, 1.5, 0.5, 0.5).unwrap());
    View { camera, size: ImageSize { width: 3, height: 2 } }
}

/// A pixel stops before the Gaussian that takes the transmittance to its minimum: with too large a minimum, nothing opaque is
/// drawn.
#[test]
fn every_setting_draws_opaque_surfaces() {
    let overrides = SWEEP.lines().filter_map(|line| line.strip_prefix("overrides = { renderer = { "));
    let overrides: Vec<&str> = overrides.map(|overrides| overrides.strip_suffix(" } }").unwrap()).collect();
    assert_eq!(overrides.len() + 1, SWEEP.matches("[[settings]]").count(), "all but the first change the renderer");
    let mut renderers: [Box<dyn Renderer>; 2] = [Box::new(ReferenceRenderer), Box::new(CpuRenderer::default())];
    for preset in RendererConstants::preset_names() {
        for setting in &overrides {
            let mut constants = RendererConstants::named(preset).unwrap();
            for (name, value) in setting.split(", ").map(|field| field.split_once(" = ").unwrap()) {
                let constant = match name {
                    "min-alpha" => &mut constants.min_alpha,
                    "max-alpha" => &mut constants.max_alpha,
                    "min-transmittance" => &mut constants.min_transmittance,
                    "blur" => &mut constants.blur,
                    other => panic!("{other} is not known here"),
                };
                *constant = value.parse().unwrap();
            }
            let options = RenderOptions { constants, ..RenderOptions::default() };
            for renderer in &mut renderers {
                let rendering = renderer.render(&sheet(), &view(), &options).unwrap();
                let what = format!("{preset}, {setting}, {}: {:?}", renderer.name(), rendering.alpha);
                assert!(rendering.alpha.iter().all(|alpha| *alpha > 0.8), "{what}");
            }
        }
    }
}
