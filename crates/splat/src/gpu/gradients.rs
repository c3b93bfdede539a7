use super::GpuError;
use super::context::Context;
use super::gaussians::GpuGaussians;
use super::kernels::Pool;
use super::render::Allocate;
use crate::renderer::saturated;
use crate::{Gaussians, Gradients, ImageGradients, SplatError, View, sh_coefficients};

/// Gradients of a loss with respect to the images of a [`super::GpuRendering`], in the strips of
/// [`super::GpuRenderer::strips`]. Sums over them are in f32: those of magnitudes far beyond 1e6 or below 1e-15 may overflow, which gives
/// NaN, or vanish. [`crate::Renderer::backward`] scales such gradients.
#[derive(Clone, Debug)]
pub struct GpuImageGradients {
    /// From top to bottom.
    pub strips: Vec<GpuStripGradients>,
}

/// Gradients of the pixels of a strip: four f32 per pixel in each buffer, row-major.
#[derive(Clone, Debug)]
pub struct GpuStripGradients {
    /// With respect to red, green, blue, alpha.
    pub colours: wgpu::Buffer,
    /// With respect to depth and scalar; the other two are ignored. `None` for zeros.
    pub extras: Option<wgpu::Buffer>,
}

/// Gradients of a loss with respect to every input of a rendering, in device memory.
#[derive(Clone, Debug)]
pub struct GpuGradients {
    /// Degree of the spherical harmonics.
    pub sh_degree: u8,
    /// One for each part of [`super::GpuGaussians`].
    pub parts: Vec<GpuGradientPart>,
    /// Twelve f32: gradients of the camera's rotation, 0, its translation, 0, the background, 0; of a batch, summed over its
    /// views. See [`crate::Gradients::pose`].
    pub pose_and_background: wgpu::Buffer,
}

/// Gradients of a part of the Gaussians: tightly packed f32, as in [`crate::Gradients`].
#[derive(Clone, Debug)]
pub struct GpuGradientPart {
    /// Number of Gaussians.
    pub count: u32,
    /// Three per Gaussian.
    pub means: wgpu::Buffer,
    /// Four per Gaussian.
    pub quaternions: wgpu::Buffer,
    /// Three per Gaussian.
    pub log_scales: wgpu::Buffer,
    /// One per Gaussian.
    pub opacity_logits: wgpu::Buffer,
    /// Three per SH coefficient.
    pub sh: wgpu::Buffer,
    /// One per Gaussian, if there are scalars.
    pub scalars: Option<wgpu::Buffer>,
    /// Two per Gaussian.
    pub means_2d: wgpu::Buffer,
    /// Three per Gaussian.
    pub conics: wgpu::Buffer,
    /// Two per Gaussian: its absolute gradients of [`ScreenGradients`], or −1 if it is not drawn.
    pub(super) screen: Option<wgpu::Buffer>,
}

/// What density control of an optimisation needs besides [`Gradients`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScreenGradients {
    /// Positions of the Gaussians that are drawn, in order.
    pub drawn: Vec<u32>,
    /// Sums over pixels of the magnitudes of their gradients with respect to each projected mean, along columns and rows;
    /// zeros if they were not requested. See [`crate::cpu::Recording::backward_with_absolute`].
    pub absolute_2d: Vec<[f32; 2]>,
}

impl ScreenGradients {
    /// From pairs that are −1 for Gaussians that are not drawn.
    pub(super) fn new(mut pairs: Vec<[f32; 2]>) -> Self {
        let mut drawn = Vec::new();
        for (position, pair) in (0..).zip(&mut pairs) {
            if pair[0] < 0.0 {
                *pair = [0.0; 2];
            } else {
                drawn.push(position);
            }
        }
        Self { drawn, absolute_2d: pairs }
    }
}

impl GpuImageGradients {
    /// Copies gradients to the device, into buffers of the pool.
    pub(super) fn upload(
        context: &Context,
        pool: &mut Pool,
        view: &View,
        strips: &[[u32; 2]],
        images: &ImageGradients<f32>,
    ) -> Result<Self, GpuError> {
        let with_extras = images.depth.is_some() || images.scalar.is_some();
        let mut upload = |name, at, values: Vec<[f32; 4]>| -> Result<wgpu::Buffer, GpuError> {
            let bytes: &[u8] = bytemuck::cast_slice(&values);
            let buffer = pool.get(context, name, at, bytes.len() as u64)?;
            context.write(&buffer, bytes);
            Ok(buffer)
        };
        let mut uploaded = Vec::new();
        for (at, [first, rows]) in strips.iter().enumerate() {
            let width = view.size.width as usize;
            let pixels = *first as usize * width..(first + rows) as usize * width;
            let colours =
                pixels.clone().map(|pixel| images.at(pixel)).map(|by| [by.rgb[0], by.rgb[1], by.rgb[2], by.alpha]);
            let colours = upload("colour gradients", at, colours.collect())?;
            let extras = || pixels.clone().map(|pixel| images.at(pixel)).map(|by| [by.depth, by.scalar, 0.0, 0.0]);
            let extras = with_extras.then(|| upload("extra gradients", at, extras().collect())).transpose()?;
            uploaded.push(GpuStripGradients { colours, extras });
        }
        Ok(Self { strips: uploaded })
    }
}

impl GpuGradients {
    /// Allocates gradients of every input of a rendering.
    pub(super) fn allocate(
        pool: &mut Pool,
        gaussians: &GpuGaussians,
        with_screen: bool,
        allocate: Allocate<'_>,
    ) -> Result<Self, GpuError> {
        let stored = sh_coefficients(gaussians.sh_degree) as u64;
        let mut parts = Vec::new();
        for (at, part) in gaussians.parts.iter().enumerate() {
            let count = u64::from(part.count);
            let mut field = |pool: &mut Pool, name, each: u64| allocate(pool, name, at, 4 * each * count);
            parts.push(GpuGradientPart {
                count: part.count,
                means: field(pool, "mean gradients", 3)?,
                quaternions: field(pool, "quaternion gradients", 4)?,
                log_scales: field(pool, "log-scale gradients", 3)?,
                opacity_logits: field(pool, "opacity-logit gradients", 1)?,
                sh: field(pool, "SH gradients", 3 * stored)?,
                scalars: part.scalars.is_some().then(|| field(pool, "scalar gradients", 1)).transpose()?,
                means_2d: field(pool, "2D mean gradients", 2)?,
                conics: field(pool, "conic gradients", 3)?,
                screen: with_screen.then(|| field(pool, "screen gradients", 2)).transpose()?,
            });
        }
        let pose_and_background = allocate(pool, "pose and background", 0, 48)?;
        Ok(Self { sh_degree: gaussians.sh_degree, parts, pose_and_background })
    }

    /// What to copy to the host: the arrays of each part, then the rest.
    pub(super) fn sources(&self) -> Vec<(&wgpu::Buffer, u64)> {
        let stored = sh_coefficients(self.sh_degree) as u64;
        let mut sources = Vec::new();
        for part in &self.parts {
            let bytes = |each: u64| 4 * each * u64::from(part.count);
            sources.extend([
                (&part.means, bytes(3)),
                (&part.quaternions, bytes(4)),
                (&part.log_scales, bytes(3)),
                (&part.opacity_logits, bytes(1)),
                (&part.sh, bytes(3 * stored)),
                (&part.means_2d, bytes(2)),
                (&part.conics, bytes(3)),
            ]);
            sources.extend(part.scalars.as_ref().map(|scalars| (scalars, bytes(1))));
            sources.extend(part.screen.as_ref().map(|screen| (screen, bytes(2))));
        }
        sources.push((&self.pose_and_background, 48));
        sources
    }

    /// The gradients from their copies, times `unit`, and those of the screen if they were allocated; `gaussians` have passed
    /// [`Self::check`]. Infinite ones become the largest number; NaN stays.
    pub(super) fn arrange(
        &self,
        contents: &[Vec<u8>],
        gaussians: &Gaussians,
        unit: f64,
    ) -> (Gradients<f32>, Vec<[f32; 2]>) {
        let number = |word: [u8; 4]| saturated(f64::from(f32::from_le_bytes(word)) * unit);
        let mut gradients = Gradients::zero(gaussians);
        let mut screen = vec![[0.0; 2]; gaussians.len()];
        let stored = sh_coefficients(self.sh_degree);
        let mut contents = contents.iter();
        let mut first = 0;
        for part in &self.parts {
            let count = part.count as usize;
            let targets: [(bool, &mut [f32], usize); 9] = [
                (true, gradients.means.as_flattened_mut(), 3),
                (true, gradients.quaternions.as_flattened_mut(), 4),
                (true, gradients.log_scales.as_flattened_mut(), 3),
                (true, &mut gradients.opacity_logits, 1),
                (true, gradients.sh.as_flattened_mut(), 3 * stored),
                (true, gradients.means_2d.as_flattened_mut(), 2),
                (true, gradients.conics.as_flattened_mut(), 3),
                (part.scalars.is_some(), &mut gradients.scalars, 1),
                (part.screen.is_some(), screen.as_flattened_mut(), 2),
            ];
            for (_, target, each) in targets.into_iter().filter(|(is_read, ..)| *is_read) {
                let Some(bytes) = contents.next() else { continue };
                let slots = target.iter_mut().skip(first * each).take(count * each);
                for (slot, word) in slots.zip(bytes.as_chunks().0) {
                    *slot = number(*word);
                }
            }
            first += count;
        }
        let rest = contents.next().map_or(&[][..], Vec::as_slice);
        let numbers: Vec<f32> = rest.as_chunks().0.iter().map(|word| number(*word)).collect();
        let [rx, ry, rz, _, tx, ty, tz, _, red, green, blue, _] = *numbers else {
            unreachable!("48 bytes are twelve f32")
        };
        gradients.pose = [rx, ry, rz, tx, ty, tz];
        gradients.background = [red, green, blue];
        (gradients, screen)
    }

    /// Checks that these are gradients of such Gaussians.
    pub(super) fn check(&self, gaussians: &Gaussians) -> Result<(), SplatError> {
        let stored = gaussians.parts();
        let counts = |parts: &mut dyn Iterator<Item = &GpuGradientPart>| parts.map(|part| part.count as usize).sum();
        let scalars = stored.scalars.as_ref().map_or(0, Vec::len);
        let lengths: [(_, usize, usize); 3] = [
            ("gradients", gaussians.len(), counts(&mut self.parts.iter())),
            ("gradients of scalars", scalars, counts(&mut self.parts.iter().filter(|part| part.scalars.is_some()))),
            (
                "gradients of SH coefficients per Gaussian",
                sh_coefficients(stored.sh_degree),
                if gaussians.is_empty() { sh_coefficients(stored.sh_degree) } else { sh_coefficients(self.sh_degree) },
            ),
        ];
        match lengths.into_iter().find(|(_, expected, found)| expected != found) {
            Some((field, expected, found)) => Err(SplatError::Length { field, expected, found }),
            None => Ok(()),
        }
    }
}
