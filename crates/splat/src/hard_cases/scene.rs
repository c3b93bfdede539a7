//! What the cases are put together from.

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use glam::{DMat3, DVec3};

use super::{ErrorBounds, HardCase};
use crate::{Census, Channels, GaussianParts, Gaussians, RenderOptions, RendererConstants, View, sh_coefficients};

/// One Gaussian as the cases write it down: red, a quarter see-through, a third of a unit wide, two units ahead.
#[derive(Clone, Copy, Debug)]
pub(super) struct One {
    pub(super) mean: [f32; 3],
    pub(super) quaternion: [f32; 4],
    pub(super) log_scales: [f32; 3],
    pub(super) logit: f32,
    pub(super) colour: [f32; 3],
    pub(super) scalar: f32,
}

pub(super) const ONE: One = One {
    mean: [0.0, 0.0, 2.0],
    quaternion: [0.9, 0.2, -0.3, 0.25],
    log_scales: [-1.5, -1.25, -1.75],
    logit: 1.1,
    colour: [1.2, -0.4, -0.9],
    scalar: 0.5,
};

/// A Gaussian behind the case's own, so that what they let through shows.
pub(super) const BACKDROP: One = One {
    mean: [0.1, -0.05, 6.0],
    quaternion: [1.0, 0.1, 0.0, 0.3],
    log_scales: [0.75, 0.5, 0.25],
    logit: 2.0,
    colour: [-0.8, 0.3, 1.1],
    scalar: -0.25,
};

/// Gaussians of degree 0 with scalars.
pub(super) fn gaussians(each: impl IntoIterator<Item = One>) -> Gaussians {
    of_degree(0, each, |_| [0.0; 3])
}

/// Gaussians whose harmonics above degree 0 are `wave` of their number.
pub(super) fn of_degree(
    degree: u8,
    each: impl IntoIterator<Item = One>,
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
    // The lengths agree by construction.
    Gaussians::new(parts).unwrap_or_default()
}

/// Looks along +z from the origin on 24×18 pixels, without a lens, with a principal point beside the centre.
pub(super) fn view() -> View {
    looking(DMat3::IDENTITY, DVec3::ZERO, [0.9, 1.2])
}

/// The same picture by another pose and focal lengths.
pub(super) fn looking(rotation: DMat3, translation: DVec3, [fx, fy]: [f64; 2]) -> View {
    let pose = CameraFromWorld::new(rotation, translation);
    let intrinsics = NormalizedIntrinsics::new(fx, fy, 0.49, 0.52);
    let (Ok(pose), Ok(intrinsics)) = (pose, intrinsics) else { unreachable!("the catalogue's cameras are cameras") };
    View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: 24, height: 18 } }
}

/// The same camera with another size of picture.
pub(super) fn sized(width: u32, height: u32) -> View {
    View { size: ImageSize { width, height }, ..view() }
}

/// The same camera through a lens.
pub(super) fn through(distortion: Distortion) -> View {
    let mut view = view();
    view.camera.distortion = distortion;
    view
}

/// Every image on a background.
pub(super) fn options() -> RenderOptions {
    RenderOptions {
        background: [0.2, 0.3, 0.4],
        channels: Channels { depth: true, scalar: true, median_depth: true },
        ..RenderOptions::default()
    }
}

/// With some constants of their own.
pub(super) fn with(change: impl FnOnce(&mut RendererConstants)) -> RenderOptions {
    let mut options = options();
    change(&mut options.constants);
    options
}

/// A case in the usual view, drawn as usual.
pub(super) fn case(name: &'static str, description: &'static str, gaussians: Gaussians) -> HardCase {
    HardCase {
        name,
        description,
        gaussians,
        view: view(),
        options: options(),
        census: None,
        bounds: ErrorBounds::default(),
        derivatives_need_f64: false,
    }
}

impl HardCase {
    pub(super) fn seen(self, view: View) -> Self {
        Self { view, ..self }
    }

    pub(super) fn drawn(self, options: RenderOptions) -> Self {
        Self { options, ..self }
    }

    /// A case at which derivatives are worse than usual.
    pub(super) fn with_gradient_to(self, gradient: f64) -> Self {
        Self { bounds: ErrorBounds { gradient, ..self.bounds }, ..self }
    }

    /// A case whose derivatives geometry in f32 cannot give.
    pub(super) fn beyond_f32(self) -> Self {
        Self { derivatives_need_f64: true, ..self }
    }

    /// A case at which images are worse than usual.
    pub(super) fn with_image_to(self, image: f64) -> Self {
        Self { bounds: ErrorBounds { image, ..self.bounds }, ..self }
    }

    /// How many are drawn, invalid, outside depth, faint, outside the picture.
    pub(super) fn counted(self, [drawn, invalid, outside_depth, faint, outside_picture]: [u64; 5]) -> Self {
        Self { census: Some(Census { drawn, invalid, outside_depth, faint, outside_picture }), ..self }
    }
}
