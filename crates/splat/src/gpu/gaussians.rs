use std::borrow::Cow;

use super::GpuError;
use super::context::Context;
use super::kernels::Pool;
use crate::{Gaussians, SplatError, sh_coefficients};

/// Gaussians in device memory: tightly packed f32, as in [`crate::GaussianParts`].
///
/// Split into parts of consecutive Gaussians that fit the adapter's bindings.
#[derive(Clone, Debug)]
pub struct GpuGaussians {
    pub(super) sh_degree: u8,
    pub(super) parts: Vec<GpuPart>,
}

/// A part of the Gaussians, in buffers of usage `STORAGE`, which may be longer than their contents.
#[derive(Clone, Debug)]
pub struct GpuPart {
    /// Number of Gaussians.
    pub count: u32,
    /// x, y, z per Gaussian.
    pub means: wgpu::Buffer,
    /// w, x, y, z per Gaussian.
    pub quaternions: wgpu::Buffer,
    /// x, y, z per Gaussian.
    pub log_scales: wgpu::Buffer,
    /// One per Gaussian.
    pub opacity_logits: wgpu::Buffer,
    /// RGB per SH coefficient per Gaussian.
    pub sh: wgpu::Buffer,
    /// One per Gaussian, if present.
    pub scalars: Option<wgpu::Buffer>,
    /// One per Gaussian, if present.
    pub filter_3d: Option<wgpu::Buffer>,
}

/// A per-Gaussian array.
struct Field<'a> {
    name: &'static str,
    buffer: &'a wgpu::Buffer,
    each: u64,
}

impl GpuPart {
    fn fields(&self, sh_degree: u8) -> impl Iterator<Item = Field<'_>> {
        let fields = [
            ("means", Some(&self.means), 3),
            ("quaternions", Some(&self.quaternions), 4),
            ("log_scales", Some(&self.log_scales), 3),
            ("opacity_logits", Some(&self.opacity_logits), 1),
            ("sh", Some(&self.sh), 3 * sh_coefficients(sh_degree) as u64),
            ("scalars", self.scalars.as_ref(), 1),
            ("filter_3d", self.filter_3d.as_ref(), 1),
        ];
        fields.into_iter().filter_map(|(name, buffer, each)| Some(Field { name, buffer: buffer?, each }))
    }
}

impl GpuGaussians {
    /// Wraps buffers in device memory. Buffers of another device are rejected on rendering, as [`GpuError::Rejected`];
    /// for a device of another `wgpu::Instance`, wgpu panics.
    ///
    /// # Errors
    /// [`SplatError::ShDegree`], and [`SplatError::Length`] for a buffer that is too short.
    pub fn from_parts(parts: Vec<GpuPart>, sh_degree: u8) -> Result<Self, SplatError> {
        if sh_degree > crate::MAX_SH_DEGREE {
            return Err(SplatError::ShDegree { found: sh_degree });
        }
        for part in &parts {
            for Field { name, buffer, each } in part.fields(sh_degree) {
                let found = usize::try_from(buffer.size() / 4).unwrap_or(usize::MAX);
                let expected = usize::try_from(each * u64::from(part.count)).unwrap_or(usize::MAX);
                if found < expected {
                    return Err(SplatError::Length { field: name, expected, found });
                }
            }
        }
        Ok(Self { sh_degree, parts })
    }

    /// Number of Gaussians.
    pub fn len(&self) -> u64 {
        self.parts.iter().map(|part| u64::from(part.count)).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Degree of the spherical harmonics.
    pub const fn sh_degree(&self) -> u8 {
        self.sh_degree
    }

    /// Size of the contents in bytes.
    pub(super) fn size_in_bytes(&self) -> u64 {
        let bytes = |part: &GpuPart| -> u64 {
            part.fields(self.sh_degree).map(|field| 4 * field.each * u64::from(part.count)).sum()
        };
        self.parts.iter().map(bytes).sum()
    }

    /// Checks that kernels can bind these buffers, which may be the caller's.
    pub(super) fn check(&self, context: &Context) -> Result<(), GpuError> {
        for part in &self.parts {
            for Field { name, buffer, each } in part.fields(self.sh_degree) {
                context.check_binding(name, buffer, 4 * each * u64::from(part.count))?;
            }
        }
        Ok(())
    }

    /// The buffers.
    pub fn parts(&self) -> &[GpuPart] {
        &self.parts
    }

    /// Copies Gaussians to the device, into buffers of the pool.
    ///
    /// Bands above `max_degree` stay behind, which shortens the largest of the copies.
    pub(super) fn upload(
        context: &Context,
        pool: &mut Pool,
        gaussians: &Gaussians,
        max_degree: u8,
    ) -> Result<Self, GpuError> {
        let arrays = gaussians.parts();
        let (stored, sh_degree) = (sh_coefficients(arrays.sh_degree), arrays.sh_degree.min(max_degree));
        let used = sh_coefficients(sh_degree);
        let each = part_length(context, sh_degree);
        let mut parts = Vec::new();
        for (at, from) in (0..gaussians.len()).step_by(each).enumerate() {
            let past = (from + each).min(gaussians.len());
            let sh = &arrays.sh[from * stored..past * stored];
            let sh: Cow<'_, [[f32; 3]]> = if used == stored {
                Cow::Borrowed(sh)
            } else {
                Cow::Owned(sh.chunks_exact(stored).flat_map(|sh| sh.iter().take(used)).copied().collect())
            };
            let mut upload = |name, values: &[f32]| -> Result<wgpu::Buffer, GpuError> {
                let bytes: &[u8] = bytemuck::cast_slice(values);
                let buffer = pool.get(context, name, at, bytes.len() as u64)?;
                context.write(&buffer, bytes);
                Ok(buffer)
            };
            #[expect(clippy::expect_used, reason = "see `part_length`")]
            let count = u32::try_from(past - from).expect("at most 2^30 Gaussians");
            parts.push(GpuPart {
                count,
                means: upload("means", arrays.means[from..past].as_flattened())?,
                quaternions: upload("quaternions", arrays.quaternions[from..past].as_flattened())?,
                log_scales: upload("log scales", arrays.log_scales[from..past].as_flattened())?,
                opacity_logits: upload("opacity logits", &arrays.opacity_logits[from..past])?,
                sh: upload("harmonics", sh.as_flattened())?,
                scalars: arrays.scalars.as_ref().map(|values| upload("scalars", &values[from..past])).transpose()?,
                filter_3d: arrays
                    .filter_3d
                    .as_ref()
                    .map(|values| upload("3D filters", &values[from..past]))
                    .transpose()?,
            });
        }
        Ok(Self { sh_degree, parts })
    }
}

/// Number of Gaussians, in whole workgroups, whose longest array fits one binding.
pub(super) fn part_length(context: &Context, sh_degree: u8) -> usize {
    // Records of the backward pass take 96 bytes.
    let widest = (12 * sh_coefficients(sh_degree) as u64).max(96);
    let fitting = context.binding_limit / widest / 64 * 64;
    usize::try_from(fitting.clamp(64, 1 << 30)).unwrap_or(64)
}
