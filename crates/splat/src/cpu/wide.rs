//! SIMD vectors of f64 with scalar syntax.

use std::ops::{Add, Div, Mul, Neg, Sub};

use pulp::Simd;

/// Gaussians per chunk, processed together in structure-of-arrays form: their intermediate data fits the L1 and L2
/// caches.
pub(super) const CHUNK: usize = 64;

/// One value per Gaussian of a chunk.
pub(super) type Row = [f64; CHUNK];
/// As [`Row`], in f32.
pub(super) type Row32 = [f32; CHUNK];

/// A vector with one value per Gaussian.
///
/// Every operation rounds each lane independently, and only [`Wide::mul_add`] is fused, on all but the portable
/// instruction sets. So results depend neither on the number of lanes nor on a Gaussian's lane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wide<S: Simd> {
    simd: S,
    lanes: S::f64s,
}

impl<S: Simd> Wide<S> {
    #[inline(always)]
    pub(super) fn splat(simd: S, value: f64) -> Self {
        Self { simd, lanes: simd.splat_f64s(value) }
    }

    /// A vector of a row, by index.
    #[inline(always)]
    pub(super) fn load(simd: S, row: &Row, vector: usize) -> Self {
        Self { simd, lanes: S::as_simd_f64s(row).0[vector] }
    }

    #[inline(always)]
    pub(super) fn store(self, row: &mut Row, vector: usize) {
        S::as_mut_simd_f64s(row).0[vector] = self.lanes;
    }

    #[inline(always)]
    pub(super) fn of(self, value: f64) -> Self {
        Self::splat(self.simd, value)
    }

    /// `self · factor + term`.
    #[inline(always)]
    pub(super) fn mul_add(self, factor: Self, term: Self) -> Self {
        Self { lanes: self.simd.mul_add_e_f64s(self.lanes, factor.lanes, term.lanes), ..self }
    }

    #[inline(always)]
    pub(super) fn sqrt(self) -> Self {
        Self { lanes: self.simd.sqrt_f64s(self.lanes), ..self }
    }

    /// The floor, for magnitudes up to 2⁵¹.
    #[inline(always)]
    pub(super) fn floor(self) -> Self {
        // Adding and subtracting 1.5·2⁵² rounds to the nearest integer.
        let rounder = self.of(6_755_399_441_055_744.0);
        let nearest = (self + rounder) - rounder;
        (nearest - self.of(1.0)).where_above(nearest, self, nearest)
    }

    #[inline(always)]
    pub(super) fn clamp(self, low: Self, high: Self) -> Self {
        let above = self.simd.max_f64s(self.lanes, low.lanes);
        Self { lanes: self.simd.min_f64s(above, high.lanes), ..self }
    }

    /// `self` where `value` equals `other`, `otherwise` elsewhere.
    #[inline(always)]
    pub(super) fn where_equal(self, value: Self, other: Self, otherwise: Self) -> Self {
        let equal = self.simd.equal_f64s(value.lanes, other.lanes);
        Self { lanes: self.simd.select_f64s(equal, self.lanes, otherwise.lanes), ..self }
    }

    /// `self` where `value > bound`, `other` elsewhere and where either is NaN.
    #[inline(always)]
    pub(super) fn where_above(self, value: Self, bound: Self, other: Self) -> Self {
        let above = self.simd.greater_than_f64s(value.lanes, bound.lanes);
        Self { lanes: self.simd.select_f64s(above, self.lanes, other.lanes), ..self }
    }
}

/// `a · b`.
#[inline(always)]
pub(super) fn dot<S: Simd>(a: [Wide<S>; 3], b: [Wide<S>; 3]) -> Wide<S> {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

/// `a × b`.
#[inline(always)]
pub(super) fn cross<S: Simd>(a: [Wide<S>; 3], b: [Wide<S>; 3]) -> [Wide<S>; 3] {
    [a[1].mul_add(b[2], -(a[2] * b[1])), a[2].mul_add(b[0], -(a[0] * b[2])), a[0].mul_add(b[1], -(a[1] * b[0]))]
}

/// `Σ weights · vectors`.
#[inline(always)]
pub(super) fn combine<S: Simd>([a, b, c]: [[Wide<S>; 3]; 3], weights: [Wide<S>; 3]) -> [Wide<S>; 3] {
    [dot([a[0], b[0], c[0]], weights), dot([a[1], b[1], c[1]], weights), dot([a[2], b[2], c[2]], weights)]
}

// Arrays are written out, because closures of `array::map` are not always inlined, and only inlined code is vectorised.

#[inline(always)]
pub(super) fn splat3<S: Simd>(simd: S, [x, y, z]: [f64; 3]) -> [Wide<S>; 3] {
    [Wide::splat(simd, x), Wide::splat(simd, y), Wide::splat(simd, z)]
}

#[inline(always)]
pub(super) fn load2<S: Simd>(simd: S, [x, y]: &[Row; 2], vector: usize) -> [Wide<S>; 2] {
    [Wide::load(simd, x, vector), Wide::load(simd, y, vector)]
}

#[inline(always)]
pub(super) fn load3<S: Simd>(simd: S, [x, y, z]: &[Row; 3], vector: usize) -> [Wide<S>; 3] {
    [Wide::load(simd, x, vector), Wide::load(simd, y, vector), Wide::load(simd, z, vector)]
}

#[inline(always)]
pub(super) fn store2<S: Simd>([x, y]: [Wide<S>; 2], rows: &mut [Row; 2], vector: usize) {
    let [row_x, row_y] = rows;
    x.store(row_x, vector);
    y.store(row_y, vector);
}

#[inline(always)]
pub(super) fn store3<S: Simd>([x, y, z]: [Wide<S>; 3], rows: &mut [Row; 3], vector: usize) {
    let [row_x, row_y, row_z] = rows;
    x.store(row_x, vector);
    y.store(row_y, vector);
    z.store(row_z, vector);
}

macro_rules! operator {
    ($trait:ident, $method:ident, $vector:ident) => {
        impl<S: Simd> $trait for Wide<S> {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self { lanes: self.simd.$vector(self.lanes, other.lanes), ..self }
            }
        }
    };
}

operator!(Add, add, add_f64s);
operator!(Sub, sub, sub_f64s);
operator!(Mul, mul, mul_f64s);
operator!(Div, div, div_f64s);

impl<S: Simd> Neg for Wide<S> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        Self { lanes: self.simd.neg_f64s(self.lanes), ..self }
    }
}
