mod bounds;
mod clean;
mod edit;
mod sh_rotation;
mod transform;
mod validate;

pub use bounds::Bounds;
pub use clean::{Cleaning, LOGIT_OF_INFINITY};
pub use validate::{Field, Finding, LOG_SCALE_LIMIT, LOGIT_LIMIT, Problem, Validation};

use crate::SplatError;

/// The highest supported degree of spherical harmonics.
pub const MAX_SH_DEGREE: u8 = 4;

/// Number of SH coefficients per colour channel: `(degree + 1)²`.
pub const fn sh_coefficients(degree: u8) -> usize {
    (degree as usize + 1) * (degree as usize + 1)
}

/// The arrays of [`Gaussians`]; each is as long as `means`, except `sh`, which is `(sh_degree + 1)²` times as long.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaussianParts {
    /// Centres in scene units.
    pub means: Vec<[f32; 3]>,
    /// Rotations `world_from_gaussian` as `w, x, y, z`; of any norm but zero, normalised on use.
    pub quaternions: Vec<[f32; 4]>,
    /// Natural logarithms of the standard deviations along the Gaussian's axes, in scene units.
    pub log_scales: Vec<[f32; 3]>,
    /// Opacity before the sigmoid.
    pub opacity_logits: Vec<f32>,
    /// Degree of the spherical harmonics, at most [`MAX_SH_DEGREE`].
    pub sh_degree: u8,
    /// RGB coefficients, Gaussian by Gaussian; within one at index `l² + l + m`, with `colour = Σ basis · coefficient +
    /// 0.5`.
    pub sh: Vec<[f32; 3]>,
    /// One value per Gaussian that is composited like a colour, such as ATSplat's uncertainty.
    pub scalars: Option<Vec<f32>>,
    /// Mip-Splatting's 3D smoothing filter, a standard deviation in scene units per Gaussian.
    pub filter_3d: Option<Vec<f32>>,
}

/// 3D Gaussians as a structure of arrays, parameterised as 3DGS (Kerbl et al. 2023) and its PLY files do.
///
/// The array lengths always agree. The values may be anything: [`Gaussians::validate`] counts invalid ones, and
/// renderers cull them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians(GaussianParts);

impl Gaussians {
    /// Wraps arrays of matching lengths.
    ///
    /// # Errors
    /// [`SplatError::Length`] naming the first array of a wrong length, [`SplatError::ShDegree`].
    pub fn new(parts: GaussianParts) -> Result<Self, SplatError> {
        if parts.sh_degree > MAX_SH_DEGREE {
            return Err(SplatError::ShDegree { found: parts.sh_degree });
        }
        let count = parts.means.len();
        let lengths = [
            ("quaternions", Some(parts.quaternions.len()), count),
            ("log_scales", Some(parts.log_scales.len()), count),
            ("opacity_logits", Some(parts.opacity_logits.len()), count),
            ("sh", Some(parts.sh.len()), count.saturating_mul(sh_coefficients(parts.sh_degree))),
            ("scalars", parts.scalars.as_ref().map(Vec::len), count),
            ("filter_3d", parts.filter_3d.as_ref().map(Vec::len), count),
        ];
        for (field, found, expected) in lengths {
            match found {
                Some(found) if found != expected => return Err(SplatError::Length { field, expected, found }),
                _ => {}
            }
        }
        Ok(Self(parts))
    }

    /// Returns the arrays.
    pub fn into_parts(self) -> GaussianParts {
        self.0
    }

    /// The arrays.
    pub const fn parts(&self) -> &GaussianParts {
        &self.0
    }

    /// Number of Gaussians.
    pub const fn len(&self) -> usize {
        self.0.means.len()
    }

    /// Whether there are none.
    pub const fn is_empty(&self) -> bool {
        self.0.means.is_empty()
    }

    /// Degree of the spherical harmonics.
    pub const fn sh_degree(&self) -> u8 {
        self.0.sh_degree
    }

    /// Size of the arrays' contents in bytes.
    pub fn size_in_bytes(&self) -> u64 {
        let optional = u64::from(self.0.scalars.is_some()) + u64::from(self.0.filter_3d.is_some());
        let floats = 11 + 3 * sh_coefficients(self.0.sh_degree) as u64 + optional;
        4 * floats * self.len() as u64
    }
}
