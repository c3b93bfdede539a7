//! Spherical harmonics: evaluates the basis for a chunk of Gaussians, then applies each one's coefficients.

use std::ops::{Add, Mul, Neg, Sub};

use pulp::Simd;

use super::shape::Shapes;
use super::to_f32;
use super::wide::{CHUNK, Row, Row32, Wide, dot, load3, splat3, store3};
use crate::constants::{LARGEST_CHANNEL, ShAxes};
use crate::view::Optics;
use crate::{GaussianParts, PackedHarmonics, RenderOptions, sh, sh_coefficients};

/// SH basis values at the view directions of a chunk of Gaussians.
#[derive(Debug)]
pub(super) struct Basis {
    degree: u8,
    stored: usize,
    values: [Row32; 25],
    /// The directions, and the gradient of each basis function; the gradients are filled only for the backward pass.
    unit: [Row32; 3],
    gradients: Vec<[Row32; 3]>,
}

impl Basis {
    pub(super) fn new(parts: &GaussianParts, options: &RenderOptions) -> Self {
        let degree = options.sh_degree(parts.sh_degree);
        let mut values = [[0.0; CHUNK]; 25];
        values[0] = [to_f32(sh::C0); CHUNK];
        Self {
            degree,
            stored: sh_coefficients(parts.sh_degree),
            values,
            unit: [[0.0; CHUNK]; 3],
            gradients: Vec::new(),
        }
    }

    /// Evaluates the basis at the view directions of a camera.
    #[inline(always)]
    pub(super) fn evaluate<S: Simd>(&mut self, simd: S, shapes: &Shapes, optics: &Optics, axes: ShAxes) {
        if self.degree == 0 {
            return;
        }
        let mut unit = [[0.0; CHUNK]; 3];
        directions(simd, shapes, optics, axes, &mut unit);
        for (narrow, wide) in self.unit.iter_mut().zip(&unit) {
            for (slot, value) in narrow.iter_mut().zip(wide) {
                *slot = to_f32(*value);
            }
        }
        let [x, y, z] = &self.unit;
        let used = sh_coefficients(self.degree);
        let eights = x.as_chunks().0.iter().zip(y.as_chunks().0).zip(z.as_chunks().0);
        for (eight, ((x, y), z)) in eights.enumerate() {
            let basis = sh::basis(self.degree, [F32x8(*x), F32x8(*y), F32x8(*z)]);
            for (row, value) in self.values.iter_mut().zip(basis).take(used).skip(1) {
                row.as_chunks_mut().0[eight] = value.0;
            }
        }
    }

    /// Colour of one of the Gaussians, clamped at 0; `None` if it is invalid.
    #[inline(always)]
    pub(super) fn colour(
        &self,
        parts: &GaussianParts,
        packed: Option<&PackedHarmonics>,
        position: usize,
        lane: usize,
    ) -> Option<[f32; 3]> {
        let lane = lane % CHUNK;
        let used = sh_coefficients(self.degree);
        let (first, upper) = if let Some(packed) = packed {
            packed.coefficients(position)?
        } else {
            let (first, upper) = parts.sh.get(position * self.stored..)?.get(..used)?.split_first()?;
            (*first, upper)
        };
        let rgb = self.sum(first, upper, lane)?;
        let largest = to_f32(LARGEST_CHANNEL);
        let [r, g, b] = rgb.map(|channel| channel.abs() <= largest);
        // A negative zero marks a clamped channel for the backward pass.
        let seen = |channel: f32| if channel < 0.0 { -0.0 } else { channel };
        (r & g & b).then_some([seen(rgb[0]), seen(rgb[1]), seen(rgb[2])])
    }

    /// Sums the first coefficient and those above degree 0, times their basis functions.
    #[inline(always)]
    fn sum(&self, [r, g, b]: [f32; 3], upper: &[[f32; 3]], lane: usize) -> Option<[f32; 3]> {
        let value = self.values[0][lane % CHUNK];
        let mut sum = [0.5 + r * value, 0.5 + g * value, 0.5 + b * value, 0.0];
        // Loads four floats at a time, of which the fourth belongs to the next coefficient; the last coefficient has no
        // successor.
        let Some((last, others)) = upper.split_last() else { return Some([sum[0], sum[1], sum[2]]) };
        let flat = upper.as_flattened();
        for ((index, _), basis) in others.iter().enumerate().zip(&self.values[1..]) {
            let &[r, g, b, next] = flat.get(3 * index..)?.first_chunk()?;
            let value = basis[lane % CHUNK];
            sum = [sum[0] + r * value, sum[1] + g * value, sum[2] + b * value, sum[3] + next * value];
        }
        let value = self.values.get(upper.len())?[lane % CHUNK];
        Some([sum[0] + last[0] * value, sum[1] + last[1] * value, sum[2] + last[2] * value])
    }

    /// Number of coefficients stored per Gaussian.
    pub(super) const fn stored(&self) -> usize {
        self.stored
    }

    /// Evaluates the gradients of the basis at the same directions.
    #[inline(always)]
    pub(super) fn evaluate_gradients(&mut self) {
        if self.degree == 0 {
            return;
        }
        let used = sh_coefficients(self.degree);
        self.gradients.resize(used, [[0.0; CHUNK]; 3]);
        let [x, y, z] = &self.unit;
        let eights = x.as_chunks().0.iter().zip(y.as_chunks().0).zip(z.as_chunks().0);
        for (eight, ((x, y), z)) in eights.enumerate() {
            let gradients = sh::basis_gradient(self.degree, [F32x8(*x), F32x8(*y), F32x8(*z)]);
            for (rows, gradients) in self.gradients.iter_mut().zip(gradients) {
                for (row, slope) in rows.iter_mut().zip(gradients) {
                    row.as_chunks_mut().0[eight] = slope.0;
                }
            }
        }
    }

    /// Backward pass of [`Self::colour`]: from the colour `seen` and the gradient `by` with respect to it, writes the
    /// gradients of the coefficients to `rows` and returns that of the direction (zero without basis gradients).
    #[inline(always)]
    pub(super) fn backward(
        &self,
        parts: &GaussianParts,
        position: usize,
        lane: usize,
        (seen, by): ([f32; 3], [f32; 3]),
        rows: &mut [[f32; 3]],
    ) -> [f64; 3] {
        let lane = lane % CHUNK;
        let through = |seen: f32, by: f32| if seen.is_sign_negative() { 0.0 } else { by };
        let [r, g, b] = [through(seen[0], by[0]), through(seen[1], by[1]), through(seen[2], by[2])];
        let used = sh_coefficients(self.degree);
        for (row, basis) in rows.iter_mut().zip(&self.values).take(used) {
            let value = basis[lane];
            *row = [r * value, g * value, b * value];
        }
        let coefficients = &parts.sh[position * self.stored..];
        // In f64, which cannot overflow here.
        let [r, g, b] = [f64::from(r), f64::from(g), f64::from(b)];
        let mut sum = [0.0f64; 3];
        for (coefficient, [x, y, z]) in coefficients.iter().zip(&self.gradients) {
            let [cr, cg, cb] = *coefficient;
            let d_basis = f64::from(cr) * r + f64::from(cg) * g + f64::from(cb) * b;
            let [x, y, z] = [f64::from(x[lane]), f64::from(y[lane]), f64::from(z[lane])];
            sum = [sum[0] + x * d_basis, sum[1] + y * d_basis, sum[2] + z * d_basis];
        }
        sum
    }
}

/// Unit directions from the camera, in the axis order of the spherical harmonics.
#[inline(always)]
pub(super) fn directions<S: Simd>(simd: S, shapes: &Shapes, optics: &Optics, axes: ShAxes, rows: &mut [Row; 3]) {
    for vector in 0..CHUNK / S::F64_LANES {
        let ([x, y, z], _) = view_direction(simd, shapes, optics, vector);
        let unit = match axes {
            ShAxes::Standard => [x, y, z],
            ShAxes::E3nn => [z, x, y],
        };
        store3(unit, rows, vector);
    }
}

/// Unit direction from the camera, +z at the camera centre, and the distance.
#[inline(always)]
pub(super) fn view_direction<S: Simd>(
    simd: S,
    shapes: &Shapes,
    optics: &Optics,
    vector: usize,
) -> ([Wide<S>; 3], Wide<S>) {
    let [x, y, z] = load3(simd, &shapes.mean, vector);
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

/// Eight f32, which the compiler turns into a vector.
#[derive(Clone, Copy)]
struct F32x8([f32; 8]);

impl F32x8 {
    #[inline(always)]
    fn zip(self, other: Self, of: impl Fn(f32, f32) -> f32) -> Self {
        let mut values = self.0;
        for (value, other) in values.iter_mut().zip(other.0) {
            *value = of(*value, other);
        }
        Self(values)
    }
}

macro_rules! lanewise {
    ($trait:ident, $method:ident, $operator:tt) => {
        impl $trait for F32x8 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, |a, b| a $operator b)
            }
        }
    };
}

lanewise!(Add, add, +);
lanewise!(Sub, sub, -);
lanewise!(Mul, mul, *);

impl Neg for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.zip(self, |value, _| -value)
    }
}

impl sh::Real for F32x8 {
    #[inline(always)]
    fn of(constant: f64) -> Self {
        Self([to_f32(constant); 8])
    }
}
