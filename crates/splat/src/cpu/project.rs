use std::ops::Range;

use glam::{DMat2, DMat3, DQuat, DVec2, DVec3, Vec3};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

use super::{SimdLevel, narrowed};
use crate::constants::{LARGEST_CHANNEL, ShAxes};
use crate::reach::reach;
use crate::view::Optics;
use crate::{Census, Gaussians, LOG_SCALE_LIMIT, RasterMode, RenderOptions, View, sh, sh_coefficients};

/// One Gaussian as the picture sees it, in one line of the cache.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct Splat {
    /// `√(½ log₂e)` times the Cholesky factor `(l₁₁, l₁₂, l₂₂)` of the inverse screen covariance: the exponent to
    /// base 2 is `−(l₁₁·dx + l₁₂·dy)² − (l₂₂·dy)²`. A sum of squares does not cancel where the Gaussian is a needle.
    pub(super) whitener: [f32; 3],
    pub(super) opacity: f32,
    pub(super) rgb: [f32; 3],
    pub(super) depth: f32,
    pub(super) scalar: f32,
    /// From the centre to the centre of the pixel `base`; with `base` apart, f32 holds it to 1e-7 pixels.
    pub(super) offset: [f32; 2],
    pub(super) base: [i32; 2],
    /// First and one past the last column, then row, that it may reach.
    pub(super) reach: [[u16; 2]; 2],
    /// In the list of Gaussians.
    pub(super) position: u32,
}

/// `√(½ log₂e)`.
const HALF_LOG2_E: f64 = 0.849_321_800_288_019;

/// Why a Gaussian is not drawn.
enum Culled {
    Invalid,
    OutsideDepth,
    Faint,
    OutsidePicture,
}

/// Projects every Gaussian that the picture can show, in the order of the list.
pub(super) fn project_all(
    gaussians: &Gaussians,
    view: &View,
    optics: &Optics,
    options: &RenderOptions,
    simd: SimdLevel,
    splats: &mut Vec<Splat>,
) -> Census {
    const CHUNK: usize = 4096;
    let projector = Projector { gaussians, view, optics, options };
    let chunks: Vec<(Vec<Splat>, Census)> = (0..gaussians.len().div_ceil(CHUNK))
        .into_par_iter()
        .map(|chunk| {
            let past = ((chunk + 1) * CHUNK).min(gaussians.len());
            simd.dispatch(ProjectSome { projector: &projector, positions: chunk * CHUNK..past })
        })
        .collect();
    splats.clear();
    splats.reserve(chunks.iter().map(|(drawn, _)| drawn.len()).sum());
    let mut total = Census::default();
    for (drawn, census) in chunks {
        splats.extend_from_slice(&drawn);
        total += census;
    }
    total
}

/// A run of Gaussians, compiled for each instruction set: same operations, fewer instructions.
struct ProjectSome<'a> {
    projector: &'a Projector<'a>,
    positions: Range<usize>,
}

impl WithSimd for ProjectSome<'_> {
    type Output = (Vec<Splat>, Census);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Self::Output {
        let mut census = Census::default();
        let mut drawn = Vec::with_capacity(self.positions.len());
        for position in self.positions {
            match self.projector.project(position) {
                Ok(splat) => drawn.push(splat),
                Err(Culled::Invalid) => census.invalid += 1,
                Err(Culled::OutsideDepth) => census.outside_depth += 1,
                Err(Culled::Faint) => census.faint += 1,
                Err(Culled::OutsidePicture) => census.outside_picture += 1,
            }
        }
        census.drawn = drawn.len() as u64;
        (drawn, census)
    }
}

struct Projector<'a> {
    gaussians: &'a Gaussians,
    view: &'a View,
    optics: &'a Optics,
    options: &'a RenderOptions,
}

impl Projector<'_> {
    #[inline(always)]
    fn project(&self, position: usize) -> Result<Splat, Culled> {
        let (parts, constants) = (self.gaussians.parts(), &self.options.constants);
        let mean = widened(read(&parts.means, position)?);
        let in_camera = self.optics.rotation * mean + self.optics.translation;
        if !in_camera.is_finite() {
            return Err(Culled::Invalid);
        }
        if !constants.keeps_depth(in_camera.z) {
            return Err(Culled::OutsideDepth);
        }
        let mut opacity = f64::from(1.0 / (1.0 + (-read(&parts.opacity_logits, position)?).exp()));
        if opacity.is_nan() {
            return Err(Culled::Invalid);
        }
        if opacity < constants.min_alpha {
            return Err(Culled::Faint);
        }
        let (axes, filter) = self.axes(position)?;
        opacity *= filter;
        let (centre, jacobian) = self.screen(in_camera)?;
        let world = axes.transpose() * self.optics.rotation.transpose();
        let (u, v) = (world * jacobian[0], world * jacobian[1]);
        let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
        let sharp = u.cross(v).length_squared();
        let determinant = sharp + constants.blur * (uu + vv) + constants.blur * constants.blur;
        if !(determinant > 0.0 && determinant.is_finite() && centre.is_finite()) {
            return Err(Culled::Invalid);
        }
        if self.options.mode == RasterMode::Antialiased {
            let ratio = (sharp / determinant).sqrt();
            opacity *= if ratio < constants.min_compensation { constants.min_compensation } else { ratio };
        }
        if !(opacity >= constants.min_alpha) {
            return Err(Culled::Faint);
        }
        let (xx, yy) = (uu + constants.blur, vv + constants.blur);
        let reach = reach(centre, [xx, uv, yy], opacity, self.view.size, constants).ok_or(Culled::OutsidePicture)?;
        let rgb = self.colour(position, mean)?;
        let scalar = parts.scalars.as_ref().map_or(Ok(0.0), |scalars| read(scalars, position))?;
        if !(scalar.abs() <= narrowed(LARGEST_CHANNEL)) {
            return Err(Culled::Invalid);
        }
        let leg = HALF_LOG2_E / (yy * determinant).sqrt();
        let base = [nearest(centre.x), nearest(centre.y)];
        Ok(Splat {
            whitener: [narrowed(yy * leg), narrowed(-uv * leg), narrowed(HALF_LOG2_E / yy.sqrt())],
            opacity: narrowed(opacity),
            rgb,
            depth: narrowed(in_camera.z),
            scalar,
            offset: [narrowed(f64::from(base[0]) + 0.5 - centre.x), narrowed(f64::from(base[1]) + 0.5 - centre.y)],
            base,
            position: u32::try_from(position).unwrap_or(u32::MAX),
            reach: [[short(reach[0][0]), short(reach[0][1])], [short(reach[1][0]), short(reach[1][1])]],
        })
    }

    /// Axes of the ellipsoid, one standard deviation long, as columns; and what the 3D filter leaves of opacity.
    #[inline(always)]
    fn axes(&self, position: usize) -> Result<(DMat3, f64), Culled> {
        let parts = self.gaussians.parts();
        let [w, x, y, z] = read(&parts.quaternions, position)?;
        let quaternion = DQuat::from_xyzw(x.into(), y.into(), z.into(), w.into());
        let norm = quaternion.length();
        let [log_x, log_y, log_z] = read(&parts.log_scales, position)?;
        let scales = widened([log_x.exp(), log_y.exp(), log_z.exp()]);
        let usable = log_x <= LOG_SCALE_LIMIT && log_y <= LOG_SCALE_LIMIT && log_z <= LOG_SCALE_LIMIT;
        if !(norm > 0.0 && norm.is_finite() && usable) {
            return Err(Culled::Invalid);
        }
        let rotation = DMat3::from_quat(quaternion * norm.recip());
        let Some(filters) = &parts.filter_3d else { return Ok((rotation * DMat3::from_diagonal(scales), 1.0)) };
        let filter = f64::from(read(filters, position)?);
        if !filter.is_finite() {
            return Err(Culled::Invalid);
        }
        if filter == 0.0 {
            return Ok((rotation * DMat3::from_diagonal(scales), 1.0));
        }
        let own = scales * scales;
        let total = own + DVec3::splat(filter * filter);
        let share = own / total;
        let scales = DVec3::from_array(total.to_array().map(f64::sqrt));
        Ok((rotation * DMat3::from_diagonal(scales), (share.x * share.y * share.z).sqrt()))
    }

    /// Projected centre in pixels and the rows of `∂pixel/∂(x, y, z)`.
    #[inline(always)]
    fn screen(&self, in_camera: DVec3) -> Result<(DVec2, [DVec3; 2]), Culled> {
        let optics = self.optics;
        let true_slope = in_camera.truncate() / in_camera.z;
        let slope = true_slope.clamp(optics.jacobian_range[0], optics.jacobian_range[1]);
        let focal = DMat2::from_diagonal(optics.focal);
        let (bent, pixel_from_slope) = match &optics.lens {
            None => (true_slope, focal),
            Some(lens) => match (lens.distorted_from_undistorted(true_slope), lens.jacobian(slope)) {
                (Ok(bent), Ok(jacobian)) => (bent, focal * jacobian),
                _ => return Err(Culled::OutsidePicture),
            },
        };
        let rows = pixel_from_slope.transpose();
        let near = in_camera.z.recip();
        let row = |row: DVec2| row.extend(-row.dot(slope)) * near;
        let jacobian = [row(rows.x_axis), row(rows.y_axis)];
        Ok((optics.focal * bent + optics.principal, jacobian))
    }

    #[inline(always)]
    fn colour(&self, position: usize, mean: DVec3) -> Result<[f32; 3], Culled> {
        let parts = self.gaussians.parts();
        let stored = sh_coefficients(parts.sh_degree);
        let degree =
            if self.options.max_sh_degree < parts.sh_degree { self.options.max_sh_degree } else { parts.sh_degree };
        let coefficients = parts.sh.get(position * stored..(position + 1) * stored).ok_or(Culled::Invalid)?;
        let mut sum = Vec3::splat(0.5);
        let mut add = |values: &[f32]| {
            for (coefficient, value) in coefficients.iter().zip(values) {
                sum += Vec3::from_array(*coefficient) * *value;
            }
        };
        if degree == 0 {
            add(&[narrowed(sh::C0)]);
        } else {
            let away = mean - self.optics.centre;
            let distance = away.length();
            let unit = if distance > 0.0 { away / distance } else { DVec3::Z };
            let [x, y, z] = unit.to_array().map(narrowed);
            let direction = match self.options.constants.sh_axes {
                ShAxes::Standard => [x, y, z],
                ShAxes::E3nn => [z, x, y],
            };
            let basis = sh::basis(degree, direction);
            add(basis.get(..sh_coefficients(degree)).unwrap_or_default());
        }
        let seen = |channel: f32| if channel < 0.0 { 0.0 } else { channel };
        if sum.is_finite() && sum.abs().max_element() <= narrowed(LARGEST_CHANNEL) {
            Ok([seen(sum.x), seen(sum.y), seen(sum.z)])
        } else {
            Err(Culled::Invalid)
        }
    }
}

#[inline(always)]
fn read<T: Copy>(values: &[T], position: usize) -> Result<T, Culled> {
    values.get(position).copied().ok_or(Culled::Invalid)
}

#[inline(always)]
fn widened([x, y, z]: [f32; 3]) -> DVec3 {
    DVec3::new(x.into(), y.into(), z.into())
}

#[inline(always)]
fn short(pixel: u32) -> u16 {
    u16::try_from(pixel).unwrap_or(u16::MAX)
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "far centres saturate, and their offset makes up for it")]
fn nearest(value: f64) -> i32 {
    // Half of i32's range, so that differences to pixels do not overflow.
    value.floor().clamp(-1e9, 1e9) as i32
}
