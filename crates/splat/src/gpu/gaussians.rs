use super::GpuError;
use super::context::Context;
use super::kernels::Pool;
use crate::{Gaussians, SplatError, sh_coefficients};

/// Gaussians in the device's memory: tightly packed f32, as [`crate::GaussianParts`] holds them.
///
/// Cut into parts of consecutive Gaussians, each small enough for the adapter's bindings.
#[derive(Clone, Debug)]
pub struct GpuGaussians {
    pub(super) sh_degree: u8,
    pub(super) parts: Vec<GpuPart>,
}

/// A run of Gaussians in buffers of usage `STORAGE`, which may be longer than the numbers in them.
#[derive(Clone, Debug)]
pub struct GpuPart {
    /// How many there are.
    pub count: u32,
    /// x, y, z of each.
    pub means: wgpu::Buffer,
    /// w, x, y, z of each.
    pub quaternions: wgpu::Buffer,
    /// x, y, z of each.
    pub log_scales: wgpu::Buffer,
    /// One of each.
    pub opacity_logits: wgpu::Buffer,
    /// RGB of each coefficient of each.
    pub sh: wgpu::Buffer,
    /// One of each, where there are any.
    pub scalars: Option<wgpu::Buffer>,
    /// One of each, where there are any.
    pub filter_3d: Option<wgpu::Buffer>,
}

/// Some numbers of each Gaussian.
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
    /// Takes buffers that are in the device's memory already. Those of another device are refused when they are rendered,
    /// as [`GpuError::Refused`]; of a device of another `wgpu::Instance`, wgpu panics.
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

    /// How many there are.
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

    /// Bytes of all numbers.
    pub(super) fn size_in_bytes(&self) -> u64 {
        let bytes = |part: &GpuPart| -> u64 {
            part.fields(self.sh_degree).map(|field| 4 * field.each * u64::from(part.count)).sum()
        };
        self.parts.iter().map(bytes).sum()
    }

    /// Whether kernels can see these buffers, which may be others' than ours.
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
    pub(super) fn upload(context: &Context, pool: &mut Pool, gaussians: &Gaussians) -> Result<Self, GpuError> {
        let of = gaussians.parts();
        let stored = sh_coefficients(of.sh_degree);
        let each = part_length(context, of.sh_degree);
        let mut parts = Vec::new();
        for (at, from) in (0..gaussians.len()).step_by(each).enumerate() {
            let past = (from + each).min(gaussians.len());
            let mut put = |name, values: &[f32]| -> Result<wgpu::Buffer, GpuError> {
                let bytes: &[u8] = bytemuck::cast_slice(values);
                let buffer = pool.get(context, name, at, bytes.len() as u64)?;
                if !bytes.is_empty() {
                    context.queue.write_buffer(&buffer, 0, bytes);
                }
                Ok(buffer)
            };
            parts.push(GpuPart {
                count: u32::try_from(past - from).unwrap_or(u32::MAX),
                means: put("means", rows(&of.means, from..past).as_flattened())?,
                quaternions: put("quaternions", rows(&of.quaternions, from..past).as_flattened())?,
                log_scales: put("log scales", rows(&of.log_scales, from..past).as_flattened())?,
                opacity_logits: put("opacity logits", rows(&of.opacity_logits, from..past))?,
                sh: put("harmonics", rows(&of.sh, from * stored..past * stored).as_flattened())?,
                scalars: of.scalars.as_ref().map(|values| put("scalars", rows(values, from..past))).transpose()?,
                filter_3d: of
                    .filter_3d
                    .as_ref()
                    .map(|values| put("3D filters", rows(values, from..past)))
                    .transpose()?,
            });
        }
        Ok(Self { sh_degree: of.sh_degree, parts })
    }
}

/// Gaussians of which the longest array still is one binding, whole workgroups of them.
pub(super) fn part_length(context: &Context, sh_degree: u8) -> usize {
    // Records of the derivative take 96 bytes.
    let widest = (12 * sh_coefficients(sh_degree) as u64).max(96);
    let fitting = context.binding_limit / widest / 64 * 64;
    usize::try_from(fitting.clamp(64, 1 << 30)).unwrap_or(64)
}

fn rows<T>(values: &[T], range: std::ops::Range<usize>) -> &[T] {
    values.get(range).unwrap_or_default()
}
