//! Building blocks of the cases.

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use glam::{DMat3, DVec3};

use super::{ErrorBounds, HardCase};
use crate::{
    Channels, GaussianCounts, GaussianParts, Gaussians, RasterMode, RenderOptions, RendererConstants, View,
    sh_coefficients,
};

/// One Gaussian of a case.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    pub(super) mean: [f32; 3],
    pub(super) quaternion: [f32; 4],
    pub(super) log_scales: [f32; 3],
    pub(super) logit: f32,
    pub(super) colour: [f32; 3],
    pub(super) scalar: f32,
}

/// Reddish, a quarter transparent, two units in front of the camera.
pub(super) const SAMPLE: Sample = Sample {
    mean: [0.0, 0.0, 2.0],
    quaternion: [0.9, 0.2, -0.3, 0.25],
    log_scales: [-1.5, -1.25, -1.75],
    logit: 1.1,
    colour: [1.2, -0.4, -0.9],
    scalar: 0.5,
};

/// A Gaussian behind those of the case, visible through them.
pub(super) const BACKDROP: Sample = Sample {
    mean: [0.1, -0.05, 6.0],
    quaternion: [1.0, 0.1, 0.0, 0.3],
    log_scales: [0.75, 0.5, 0.25],
    logit: 2.0,
    colour: [-0.8, 0.3, 1.1],
    scalar: -0.25,
};

/// Gaussians of degree 0 with scalars.
pub(super) fn gaussians(each: impl IntoIterator<Item = Sample>) -> Gaussians {
    of_degree(0, each, |_| [0.0; 3])
}

/// Gaussians with SH coefficients above degree 0 given by `wave` of their index.
pub(super) fn of_degree(
    degree: u8,
    each: impl IntoIterator<Item = Sample>,
    mut wave: impl FnMut(usize) -> [f32; 3],
) -> Gaussians {
    let mut parts = GaussianParts { sh_degree: degree, scalars: Some(Vec::new()), ..GaussianParts::default() };
    for one in each {
        parts.means.push(one.mean);
        parts.quaternions.push(one.quaternion);
        parts.log_scales.push(one.log_scales);
        parts.opacity_logits.push(one.logit);
        parts.scalars.iter_mut().for_each(|scalars| scalars.push(one.scalar));
        parts.sh.push(one.colour);
        for _ in 1..sh_coefficients(degree) {
            let next = parts.sh.len();
            parts.sh.push(wave(next));
        }
    }

    valid(parts)
}

/// Gaussians of these sizes at these places, and [`BACKDROP`].
pub(super) fn fan(means: [[f32; 3]; 5], log_scales: [f32; 3]) -> Gaussians {
    gaussians(means.map(|mean| Sample { mean, log_scales, ..SAMPLE }).into_iter().chain([BACKDROP]))
}

/// Far outside the image of [`view`], but large enough to reach it.
pub(super) fn off_axis() -> Gaussians {
    let means = [[6.0, 0.0, 0.5], [0.0, 12.0, 0.4], [-9.0, 3.0, 0.3], [30.0, -30.0, 0.25], [2.0, 1.0, 0.02]];
    fan(means, [1.5, 1.0, 1.25])
}

/// The same Gaussians with a 3D filter each.
pub(super) fn filtered(gaussians: Gaussians, filter: f32) -> Gaussians {
    let mut parts = gaussians.into_parts();
    parts.filter_3d = Some(vec![filter; parts.means.len()]);
    valid(parts)
}

/// Gaussians of arrays whose lengths agree.
#[expect(clippy::expect_used, reason = "the catalogue's arrays agree in length")]
pub(super) fn valid(parts: GaussianParts) -> Gaussians {
    Gaussians::new(parts).expect("arrays of matching lengths")
}

/// A 24×18 pinhole view along +z from the origin, with a principal point off the image centre.
pub(super) fn view() -> View {
    view_at(DMat3::IDENTITY, DVec3::ZERO, [0.9, 1.2])
}

/// The same image size with another pose and focal lengths.
pub(super) fn view_at(rotation: DMat3, translation: DVec3, [fx, fy]: [f64; 2]) -> View {
    let pose = CameraFromWorld::new(rotation, translation);
    let intrinsics = NormalizedIntrinsics::new(fx, fy, 0.49, 0.52);
    let (Ok(pose), Ok(intrinsics)) = (pose, intrinsics) else { unreachable!("the catalogue's cameras are valid") };
    View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: 24, height: 18 } }
}

/// The same camera with another image size.
pub(super) fn view_of_size(width: u32, height: u32) -> View {
    View { size: ImageSize { width, height }, ..view() }
}

/// The same camera with lens distortion.
pub(super) fn view_through(distortion: Distortion) -> View {
    let mut view = view();
    view.camera.distortion = distortion;
    view
}

/// A strong barrel lens.
pub(super) const BARREL: Distortion = Distortion::OpenCv { k1: -0.28, k2: 0.07, k3: -0.01, p1: 0.004, p2: -0.003 };

/// A fisheye of 120 degrees.
pub(super) fn fisheye() -> View {
    let mut view = view_at(DMat3::IDENTITY, DVec3::ZERO, [0.3, 0.4]);
    view.camera.distortion = Distortion::Fisheye { k: [0.05, -0.02, 0.004, -0.0004] };
    view
}

/// Every channel, over a background.
pub(super) fn options() -> RenderOptions {
    RenderOptions {
        background: [0.2, 0.3, 0.4],
        channels: Channels { depth: true, scalar: true, median_depth: true },
        ..RenderOptions::default()
    }
}

/// The default options of a case with other constants.
pub(super) fn options_with(change: impl FnOnce(&mut RendererConstants)) -> RenderOptions {
    let mut options = options();
    change(&mut options.constants);
    options
}

/// The default options of a case, antialiased.
pub(super) fn antialiased() -> RenderOptions {
    RenderOptions { mode: RasterMode::Antialiased, ..options() }
}

/// The default options of a case with the constants of diff-gaussian-rasterization.
pub(super) fn inria() -> RenderOptions {
    let constants = RendererConstants::named("inria").unwrap_or_else(|| unreachable!("a preset"));
    RenderOptions { constants, ..options() }
}

/// A case with the default view and options.
pub(super) fn case(name: &'static str, description: &'static str, gaussians: Gaussians) -> HardCase {
    HardCase {
        name,
        description,
        gaussians,
        view: view(),
        options: options(),
        counts: None,
        bounds: ErrorBounds::default(),
        derivatives_need_f64: false,
        image_in_f32: None,
    }
}

impl HardCase {
    pub(super) fn with_view(self, view: View) -> Self {
        Self { view, ..self }
    }

    pub(super) fn with_options(self, options: RenderOptions) -> Self {
        Self { options, ..self }
    }

    /// Sets a larger gradient bound.
    pub(super) fn with_gradient_bound(self, gradient: f64) -> Self {
        Self { bounds: ErrorBounds { gradient, ..self.bounds }, ..self }
    }

    /// Marks a case whose gradients need geometry in f64.
    pub(super) fn with_gradients_in_f64_only(self) -> Self {
        Self { derivatives_need_f64: true, ..self }
    }

    /// Sets an image bound for geometry in f32, of which only finite gradients are required.
    pub(super) fn with_image_bound_in_f32(self, image: f64) -> Self {
        Self { image_in_f32: Some(image), derivatives_need_f64: true, ..self }
    }

    /// Sets a larger image bound.
    pub(super) fn with_image_bound(self, image: f64) -> Self {
        Self { bounds: ErrorBounds { image, ..self.bounds }, ..self }
    }

    /// Sets the expected counts: drawn, invalid, outside depth, faint, outside the image.
    pub(super) fn with_counts(self, [drawn, invalid, outside_depth, faint, outside_image]: [u64; 5]) -> Self {
        Self { counts: Some(GaussianCounts { drawn, invalid, outside_depth, faint, outside_image }), ..self }
    }
}
