//! Spherical harmonics: the basis for many Gaussians side by side, then each one's coefficients, read once.

use std::ops::{Add, Mul, Neg, Sub};

use pulp::Simd;

use super::narrowed;
use super::shape::Shapes;
use super::wide::{Row, Row32, SIDE_BY_SIDE, Wide, dot, load3, splat3, store3};
use crate::constants::{LARGEST_CHANNEL, ShAxes};
use crate::view::Optics;
use crate::{GaussianParts, RenderOptions, sh, sh_coefficients};

/// Values of the basis in the directions of Gaussians side by side.
#[derive(Debug)]
pub(super) struct Basis {
    degree: u8,
    stored: usize,
    values: [Row32; 25],
    /// The directions, and the basis' slopes along each axis; the derivative alone fills the slopes.
    unit: [Row32; 3],
    slopes: Vec<[Row32; 3]>,
}

impl Basis {
    pub(super) fn new(parts: &GaussianParts, options: &RenderOptions) -> Self {
        let degree = if options.max_sh_degree < parts.sh_degree { options.max_sh_degree } else { parts.sh_degree };
        let mut values = [[0.0; SIDE_BY_SIDE]; 25];
        values[0] = [narrowed(sh::C0); SIDE_BY_SIDE];
        Self {
            degree,
            stored: sh_coefficients(parts.sh_degree),
            values,
            unit: [[0.0; SIDE_BY_SIDE]; 3],
            slopes: Vec::new(),
        }
    }

    /// Evaluates the basis in the directions from a camera.
    #[inline(always)]
    pub(super) fn look<S: Simd>(&mut self, simd: S, shapes: &Shapes, optics: &Optics, axes: ShAxes) {
        if self.degree == 0 {
            return;
        }
        let mut unit = [[0.0; SIDE_BY_SIDE]; 3];
        directions(simd, shapes, optics, axes, &mut unit);
        for (narrow, wide) in self.unit.iter_mut().zip(&unit) {
            for (slot, value) in narrow.iter_mut().zip(wide) {
                *slot = narrowed(*value);
            }
        }
        let [x, y, z] = &self.unit;
        let used = sh_coefficients(self.degree);
        let eights = x.as_chunks().0.iter().zip(y.as_chunks().0).zip(z.as_chunks().0);
        for (at, ((x, y), z)) in eights.enumerate() {
            let basis = sh::basis(self.degree, [Eight(*x), Eight(*y), Eight(*z)]);
            for (row, value) in self.values.iter_mut().zip(basis).take(used).skip(1) {
                if let Some(slot) = row.as_chunks_mut().0.get_mut(at) {
                    *slot = value.0;
                }
            }
        }
    }

    /// Colour of one of the Gaussians, clamped at 0; `None` where it cannot be used.
    #[inline(always)]
    pub(super) fn colour(&self, parts: &GaussianParts, position: usize, lane: usize) -> Option<[f32; 3]> {
        let lane = lane % SIDE_BY_SIDE;
        let coefficients = parts.sh.get(position * self.stored..)?;
        let mut sum = [0.5f32; 4];
        let used = sh_coefficients(self.degree);
        // Four floats at a time, of which the last are the next coefficient's; the very last has none behind it.
        let (last, others) = coefficients.get(..used)?.split_last()?;
        let flat = coefficients.as_flattened();
        for ((at, _), basis) in others.iter().enumerate().zip(&self.values) {
            let &[r, g, b, next] = flat.get(3 * at..)?.first_chunk()?;
            let value = basis[lane];
            sum = [sum[0] + r * value, sum[1] + g * value, sum[2] + b * value, sum[3] + next * value];
        }
        let value = self.values.get(used - 1)?[lane];
        let [r, g, b] = [sum[0] + last[0] * value, sum[1] + last[1] * value, sum[2] + last[2] * value];
        let largest = narrowed(LARGEST_CHANNEL);
        let usable = (r.abs() <= largest) & (g.abs() <= largest) & (b.abs() <= largest);
        // The sign of zero tells the derivative that nothing passes.
        let seen = |channel: f32| if channel < 0.0 { -0.0 } else { channel };
        usable.then_some([seen(r), seen(g), seen(b)])
    }

    /// Coefficients that a Gaussian has.
    pub(super) const fn stored(&self) -> usize {
        self.stored
    }

    /// Evaluates the slopes of the basis, in the directions that it was evaluated in.
    #[inline(always)]
    pub(super) fn slopes(&mut self) {
        if self.degree == 0 {
            return;
        }
        let used = sh_coefficients(self.degree);
        self.slopes.resize(used, [[0.0; SIDE_BY_SIDE]; 3]);
        let [x, y, z] = &self.unit;
        let eights = x.as_chunks().0.iter().zip(y.as_chunks().0).zip(z.as_chunks().0);
        for (at, ((x, y), z)) in eights.enumerate() {
            let slopes = sh::basis_gradient(self.degree, [Eight(*x), Eight(*y), Eight(*z)]);
            for (rows, slopes) in self.slopes.iter_mut().zip(slopes) {
                for (row, slope) in rows.iter_mut().zip(slopes) {
                    if let Some(slot) = row.as_chunks_mut().0.get_mut(at) {
                        *slot = slope.0;
                    }
                }
            }
        }
    }

    /// Carries the derivative by the colour of one of the Gaussians, of which `seen` is the colour, to its
    /// coefficients; returns that by the direction, nothing without slopes.
    #[inline(always)]
    pub(super) fn carry(
        &self,
        parts: &GaussianParts,
        position: usize,
        lane: usize,
        (seen, by): ([f32; 3], [f32; 3]),
        rows: &mut [[f32; 3]],
    ) -> [f64; 3] {
        let lane = lane % SIDE_BY_SIDE;
        let through = |seen: f32, by: f32| if seen.is_sign_negative() { 0.0 } else { by };
        let [r, g, b] = [through(seen[0], by[0]), through(seen[1], by[1]), through(seen[2], by[2])];
        let used = sh_coefficients(self.degree);
        for (row, basis) in rows.iter_mut().zip(&self.values).take(used) {
            let value = basis[lane];
            *row = [r * value, g * value, b * value];
        }
        let coefficients = parts.sh.get(position * self.stored..).unwrap_or_default();
        // In f64, where no coefficient overflows.
        let [r, g, b] = [f64::from(r), f64::from(g), f64::from(b)];
        let mut sum = [0.0f64; 3];
        for (coefficient, [x, y, z]) in coefficients.iter().zip(&self.slopes) {
            let [cr, cg, cb] = *coefficient;
            let worth = f64::from(cr) * r + f64::from(cg) * g + f64::from(cb) * b;
            let [x, y, z] = [f64::from(x[lane]), f64::from(y[lane]), f64::from(z[lane])];
            sum = [sum[0] + x * worth, sum[1] + y * worth, sum[2] + z * worth];
        }
        sum
    }
}

/// Unit directions from the camera, in the axes that the harmonics are evaluated on; returns nothing of the
/// distances, which [`away`] tells.
#[inline(always)]
pub(super) fn directions<S: Simd>(simd: S, shapes: &Shapes, optics: &Optics, axes: ShAxes, rows: &mut [Row; 3]) {
    for at in 0..SIDE_BY_SIDE / S::F64_LANES {
        let ([x, y, z], _) = away(simd, shapes, optics, at);
        let unit = match axes {
            ShAxes::Standard => [x, y, z],
            ShAxes::E3nn => [z, x, y],
        };
        store3(unit, rows, at);
    }
}

/// Unit direction from the camera, the optical axis' own where there is none, and the distance.
#[inline(always)]
pub(super) fn away<S: Simd>(simd: S, shapes: &Shapes, optics: &Optics, at: usize) -> ([Wide<S>; 3], Wide<S>) {
    let [x, y, z] = load3(simd, &shapes.mean, at);
    let centre = splat3(simd, optics.centre.to_array());
    let (x, y, z) = (x - centre[0], y - centre[1], z - centre[2]);
    let distance = dot([x, y, z], [x, y, z]).sqrt();
    let (zero, one) = (distance.of(0.0), distance.of(1.0));
    let unit = [
        (x / distance).where_above(distance, zero, zero),
        (y / distance).where_above(distance, zero, zero),
        (z / distance).where_above(distance, zero, one),
    ];
    (unit, distance)
}

/// Eight numbers, which compilers turn into vectors.
#[derive(Clone, Copy)]
struct Eight([f32; 8]);

impl Eight {
    #[inline(always)]
    fn zip(self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let mut values = self.0;
        for (value, other) in values.iter_mut().zip(other.0) {
            *value = of(*value, other);
        }
        Self(values)
    }
}

impl Add for Eight {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Eight {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Eight {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Neg for Eight {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.zip(self, |value, _| -value)
    }
}

impl sh::Real for Eight {
    #[inline(always)]
    fn of(constant: f64) -> Self {
        Self([narrowed(constant); 8])
    }
}
