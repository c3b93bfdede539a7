//! Every renderer on every hard case.

#![expect(clippy::expect_used, reason = "a test fails by panicking")]

use std::fmt::Write as _;

use atsplat_camera::{Camera, CameraFromWorld};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::gpu::AdapterChoice;
use atsplat_splat::hard_cases::catalogue;
use atsplat_splat::stress::{ErrorKind, RendererUnderTest, cpu_under_test, gpu_under_test, rows};
use atsplat_splat::{
    Gaussians, Gradients, ImageGradients, RenderOptions, Renderer, Rendering, SplatError, Stage, View,
};
use atsplat_tests::skip_without_graphics;
use glam::DMat3;

#[test]
fn every_renderer_passes_every_case() {
    let mut renderers = cpu_under_test();
    match gpu_under_test(&AdapterChoice::Automatic, &()) {
        Ok(gpu) => renderers.push(gpu),
        Err(error) => {
            skip_without_graphics("every_renderer_passes_every_case", error);
        }
    }
    let (mut failed, mut compared) = (String::new(), 0);
    for case in catalogue() {
        let rows = rows(&case, &mut renderers).unwrap();
        // The same parameters of every renderer.
        compared += rows[0].error(ErrorKind::Differences).unwrap().compared;
        for row in rows.iter().filter(|row| !row.passes()) {
            writeln!(failed, "{row:?}").unwrap();
        }
    }
    assert!(failed.is_empty(), "\n{failed}");
    assert!(compared > 3500, "{compared} parameters compared with differences");
}

/// Four views share what does not depend on the camera, and the buffers of views before.
#[test]
fn views_together_equal_views_alone() {
    let mut renderer = CpuRenderer::default();
    for case in catalogue() {
        let views = [0.0, 0.04, -0.07, 0.11].map(|angle| turned(&case.view, angle));
        let together = renderer.render_many(&case.gaussians, &views, &case.options).unwrap();
        for (number, (view, found)) in views.iter().zip(together).enumerate() {
            let alone = renderer.render(&case.gaussians, view, &case.options).unwrap();
            assert!(found == alone, "{}, view {number}", case.name);
        }
    }
}

/// The view with its camera turned about its own axes.
fn turned(view: &View, angle: f64) -> View {
    let turn = DMat3::from_rotation_y(angle) * DMat3::from_rotation_x(0.5 * angle);
    let pose = view.camera.camera_from_world;
    let pose =
        CameraFromWorld::new(turn * pose.rotation(), turn * pose.translation()).expect("rotations stay rotations");
    View { camera: Camera { camera_from_world: pose, ..view.camera }, ..*view }
}

#[test]
fn names_are_unique() {
    let mut names: Vec<&str> = catalogue().iter().map(|case| case.name).collect();
    names.sort_unstable();
    let count = names.len();
    names.dedup();
    assert!(names.len() == count && count >= 90, "{count} cases");
}

/// Renders with the reference, and introduces one error.
struct Faulty(fn(&mut Rendering<f32>), fn(&mut Gradients<f32>));

impl Renderer for Faulty {
    fn name(&self) -> String {
        "faulty".to_owned()
    }

    fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        let mut rendering = atsplat_splat::ReferenceRenderer.render(gaussians, view, options)?;
        (self.0)(&mut rendering);
        Ok(rendering)
    }

    fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        let mut gradients = atsplat_splat::ReferenceRenderer.backward(gaussians, view, options, images)?;
        (self.1)(&mut gradients);
        Ok(gradients)
    }

    fn stages(&self) -> Vec<Stage> {
        Vec::new()
    }
}

/// Tests the harness: a small error in any image, gradient or count is detected, and so is a NaN.
#[test]
fn detects_errors() {
    let case = catalogue().into_iter().find(|case| case.name == "needle-end-on").unwrap();
    let fails = |image: fn(&mut Rendering<f32>), gradient: fn(&mut Gradients<f32>)| {
        let faulty = RendererUnderTest { renderer: Box::new(Faulty(image, gradient)), slack: 1.0 };
        !rows(&case, &mut [faulty]).unwrap().pop().unwrap().passes()
    };
    assert!(!fails(|_| {}, |_| {}), "no error");
    let images: [fn(&mut Rendering<f32>); 6] = [
        |rendering| rendering.rgb[100][1] += 1e-4,
        |rendering| rendering.alpha[200] -= 1e-4,
        |rendering| rendering.depth.as_mut().unwrap()[210] += 1e-2,
        |rendering| rendering.scalar.as_mut().unwrap()[210] = f32::NAN,
        |rendering| rendering.median_depth.as_mut().unwrap()[210] += 1.0,
        |rendering| rendering.counts.faint += 1,
    ];
    for (number, image) in images.into_iter().enumerate() {
        assert!(fails(image, |_| {}), "image {number}");
    }
    let gradients: [fn(&mut Gradients<f32>); 6] = [
        |gradients| gradients.means.iter_mut().flatten().for_each(|value| *value *= 1.01),
        |gradients| gradients.quaternions[1][3] = f32::INFINITY,
        |gradients| gradients.log_scales[1] = [0.0; 3],
        |gradients| gradients.sh.iter_mut().flatten().for_each(|value| *value *= 0.99),
        |gradients| gradients.background[2] += 1.0,
        |gradients| gradients.pose[4] = -gradients.pose[4],
    ];
    for (number, gradient) in gradients.into_iter().enumerate() {
        assert!(fails(|_| {}, gradient), "gradient {number}");
    }
}
