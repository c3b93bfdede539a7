//! Absolute gradients with respect to the projected means, against one backward pass per pixel.

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_splat::cpu::{CpuOptions, CpuRenderer, SimdLevel};
use atsplat_splat::{GaussianParts, Gaussians, Gradients, ImageGradients, RenderOptions, View};

#[test]
fn absolute_gradients_sum_the_magnitudes_of_single_pixels() {
    let mut generator = SplitMix64::new(8);
    let mut random = |low: f32, high: f32| low + (high - low) * generator.unit_f32();
    let mut parts = GaussianParts::default();
    for _ in 0..12 {
        parts.means.push([random(-1.0, 1.0), random(-0.6, 0.6), random(2.0, 4.0)]);
        parts.quaternions.push([1.0, random(-1.0, 1.0), random(-1.0, 1.0), random(-1.0, 1.0)]);
        parts.log_scales.push([random(-3.0, -0.5), random(-3.0, -0.5), random(-3.0, -0.5)]);
        parts.opacity_logits.push(random(-1.0, 2.0));
        parts.sh.push([random(-1.0, 1.0), random(-1.0, 1.0), random(-1.0, 1.0)]);
    }
    // Behind the camera: not drawn.
    parts.means[5][2] = -1.0;
    let gaussians = Gaussians::new(parts).unwrap();
    let size = ImageSize { width: 37, height: 21 };
    let intrinsics = NormalizedIntrinsics::new(0.9, 1.6, 0.5, 0.5).unwrap();
    let view = View { camera: Camera::pinhole(CameraFromWorld::IDENTITY, intrinsics), size };
    let weights: Vec<[f32; 3]> =
        (0..37 * 21).map(|_| [random(-1.0, 1.0), random(-1.0, 1.0), random(-1.0, 1.0)]).collect();
    let images = |rgb| ImageGradients { rgb, alpha: None, depth: None, scalar: None };
    let options = RenderOptions::default();

    let mut expected = vec![[0.0f64; 2]; gaussians.len()];
    let mut one = CpuRenderer::default().record(&gaussians, &view, &options).unwrap();
    for pixel in 0..weights.len() {
        let mut rgb = vec![[0.0; 3]; weights.len()];
        rgb[pixel] = weights[pixel];
        for (sum, gradient) in expected.iter_mut().zip(one.backward(&images(rgb)).unwrap().means_2d) {
            sum.iter_mut().zip(gradient).for_each(|(sum, part)| *sum += f64::from(part.abs()));
        }
    }
    assert_eq!(one.drawn().collect::<Vec<_>>(), [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11]);
    assert!(expected.iter().filter(|sum| sum[0] > 1e-3 && sum[1] > 1e-3).count() > 8, "{expected:?}");

    for simd in SimdLevel::available() {
        let mut renderer = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() });
        let mut recording = renderer.record(&gaussians, &view, &options).unwrap();
        let (mut gradients, mut absolute) = (Gradients::default(), vec![[9.0; 2]; 3]);
        recording.backward_with_absolute(&images(weights.clone()), &mut gradients, &mut absolute).unwrap();
        let found = absolute.as_flattened().iter().copied().map(f64::from);
        let close = Tolerance { absolute: 1e-5, relative: 1e-4 };
        close.assert(found, expected.as_flattened().iter().copied(), &format!("{simd}"));
        assert_eq!(gradients, recording.backward(&images(weights.clone())).unwrap(), "{simd}: signed gradients");
        let depth = Some(vec![0.0; weights.len()]);
        let with_depth = ImageGradients { depth, ..images(weights.clone()) };
        assert!(recording.backward_with_absolute(&with_depth, &mut gradients, &mut absolute).is_err());
    }
}
