use atsplat_splat::gpu::{GpuGaussians, GpuImageGradients, GpuOptions, GpuRenderer, GpuStripGradients};
use atsplat_splat::{Renderer, SplatError};

use crate::scenes::{cloud, everything, gpu, narrow, ripples, view};

/// Gaussians, pictures and gradients that stay on the device are those that pass through the host.
#[test]
fn nothing_changes_on_the_way() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(700, 1, 19), view(53, 41));
    let resident = gpu.upload(&gaussians).unwrap();
    assert_eq!((resident.len(), resident.sh_degree(), resident.is_empty()), (700, 1, false));
    let rendering = gpu.render_resident(&resident, &view, &everything()).unwrap();
    let through_host = gpu.render(&gaussians, &view, &everything()).unwrap();
    assert!(gpu.read(&rendering).unwrap() == through_host);

    let images = narrow(&ripples(&view));
    let strips = GpuImageGradients {
        strips: vec![GpuStripGradients {
            colours: rendering.strips[0].colours.clone(),
            extras: rendering.strips[0].extras.clone(),
        }],
    };
    // A picture is as good a gradient as any: here of half its own sum of squares.
    let gradients = gpu.backward_resident(&resident, &view, &everything(), &strips).unwrap();
    let own = atsplat_splat::ImageGradients {
        rgb: through_host.rgb,
        alpha: Some(through_host.alpha),
        depth: through_host.depth,
        scalar: through_host.scalar,
    };
    let expected = gpu.backward(&gaussians, &view, &everything(), &own).unwrap();
    assert!(gpu.read_gradients(&gradients, &gaussians).unwrap() == expected);
    assert!(gpu.backward(&gaussians, &view, &everything(), &images).unwrap() != expected);
}

#[test]
fn buffers_and_devices_of_others_are_taken() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(300, 1, 19), view(30, 20));
    let uploaded = gpu.upload(&gaussians).unwrap();
    let mut guest = GpuRenderer::with_device(gpu.device().clone(), gpu.queue().clone(), GpuOptions::default()).unwrap();
    let taken = GpuGaussians::from_parts(uploaded.parts().to_vec(), 1).unwrap();
    let rendering = guest.render_resident(&taken, &view, &everything()).unwrap();
    assert!(guest.read(&rendering).unwrap() == gpu.render(&gaussians, &view, &everything()).unwrap());

    let mut short = uploaded.parts().to_vec();
    short[0].count = 100_000;
    assert!(matches!(GpuGaussians::from_parts(short, 1), Err(SplatError::Length { .. })));
    let five = GpuGaussians::from_parts(uploaded.parts().to_vec(), 5);
    assert!(matches!(five, Err(SplatError::ShDegree { found: 5 })));
}

#[test]
fn stages_are_timed() {
    let Some(mut gpu) = gpu() else { return };
    gpu.render(&cloud(300, 1, 19), &view(30, 20), &everything()).unwrap();
    let stages = gpu.stages();
    assert!(!stages.is_empty() && stages.iter().all(|stage| stage.secs >= 0.0 && stage.secs < 60.0), "{stages:?}");
    assert!(gpu.name().starts_with("gpu, ") && gpu.name().contains(gpu.adapter()));
}
