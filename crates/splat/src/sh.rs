//! Real spherical harmonics up to degree 4 in the basis of 3DGS and gsplat (`SphericalHarmonicsCUDA.cu`), as
//! polynomials of a unit direction; coefficient `l² + l + m`.

use std::ops::{Add, Mul, Neg, Sub};

/// A float that the basis can be evaluated in.
pub trait Real: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> {
    /// Rounds a constant to this type.
    fn of(constant: f64) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn of(constant: f64) -> Self {
        constant
    }
}

impl Real for f32 {
    #[expect(clippy::cast_possible_truncation, reason = "constants are rounded to f32")]
    #[inline(always)]
    fn of(constant: f64) -> Self {
        constant as Self
    }
}

/// `Y₀₀`: at degree 0 the RGB colour is `0.5 + C0 · sh[0]`.
pub const C0: f64 = 0.282_094_791_773_878_14;
const C1: f64 = 0.488_602_511_902_92;
const C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
const C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_8,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_8,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];
const C4: [f64; 9] = [
    2.503_342_941_796_704_8,
    -1.770_130_769_779_930_6,
    0.946_174_695_757_560_1,
    -0.669_046_543_557_289_2,
    0.105_785_546_915_204_3,
    -0.669_046_543_557_289_2,
    0.473_087_347_878_780_04,
    -1.770_130_769_779_930_6,
    0.625_835_735_449_176_2,
];

/// Values of the basis functions at a unit direction; zero above `degree`.
#[inline(always)]
pub fn basis<T: Real>(degree: u8, [x, y, z]: [T; 3]) -> [T; 25] {
    let c = T::of;
    let mut y_lm = [c(0.0); 25];
    y_lm[0] = c(C0);
    if degree >= 1 {
        y_lm[1] = c(-C1) * y;
        y_lm[2] = c(C1) * z;
        y_lm[3] = c(-C1) * x;
    }
    let (xx, yy, zz, xy, yz, xz) = (x * x, y * y, z * z, x * y, y * z, x * z);
    if degree >= 2 {
        y_lm[4] = c(C2[0]) * xy;
        y_lm[5] = c(C2[1]) * yz;
        y_lm[6] = c(C2[2]) * (c(2.0) * zz - xx - yy);
        y_lm[7] = c(C2[3]) * xz;
        y_lm[8] = c(C2[4]) * (xx - yy);
    }
    if degree >= 3 {
        y_lm[9] = c(C3[0]) * y * (c(3.0) * xx - yy);
        y_lm[10] = c(C3[1]) * xy * z;
        y_lm[11] = c(C3[2]) * y * (c(4.0) * zz - xx - yy);
        y_lm[12] = c(C3[3]) * z * (c(2.0) * zz - c(3.0) * xx - c(3.0) * yy);
        y_lm[13] = c(C3[4]) * x * (c(4.0) * zz - xx - yy);
        y_lm[14] = c(C3[5]) * z * (xx - yy);
        y_lm[15] = c(C3[6]) * x * (xx - c(3.0) * yy);
    }
    if degree >= 4 {
        y_lm[16] = c(C4[0]) * xy * (xx - yy);
        y_lm[17] = c(C4[1]) * yz * (c(3.0) * xx - yy);
        y_lm[18] = c(C4[2]) * xy * (c(7.0) * zz - c(1.0));
        y_lm[19] = c(C4[3]) * yz * (c(7.0) * zz - c(3.0));
        y_lm[20] = c(C4[4]) * (zz * (c(35.0) * zz - c(30.0)) + c(3.0));
        y_lm[21] = c(C4[5]) * xz * (c(7.0) * zz - c(3.0));
        y_lm[22] = c(C4[6]) * (xx - yy) * (c(7.0) * zz - c(1.0));
        y_lm[23] = c(C4[7]) * xz * (xx - c(3.0) * yy);
        y_lm[24] = c(C4[8]) * (xx * (xx - c(3.0) * yy) - yy * (c(3.0) * xx - yy));
    }
    y_lm
}

/// Gradients of [`basis`] with respect to x, y and z as independent variables. Only the component tangential to the
/// sphere is meaningful; the radial part vanishes when the direction is normalised.
#[inline(always)]
pub fn basis_gradient<T: Real>(degree: u8, [x, y, z]: [T; 3]) -> [[T; 3]; 25] {
    let c = T::of;
    let zero = c(0.0);
    let mut d = [[zero; 3]; 25];
    if degree >= 1 {
        d[1] = [zero, c(-C1), zero];
        d[2] = [zero, zero, c(C1)];
        d[3] = [c(-C1), zero, zero];
    }
    let (xx, yy, zz, xy, yz, xz) = (x * x, y * y, z * z, x * y, y * z, x * z);
    let scaled = |k: f64, [a, b, e]: [T; 3]| [c(k) * a, c(k) * b, c(k) * e];
    if degree >= 2 {
        d[4] = scaled(C2[0], [y, x, zero]);
        d[5] = scaled(C2[1], [zero, z, y]);
        d[6] = scaled(2.0 * C2[2], [-x, -y, c(2.0) * z]);
        d[7] = scaled(C2[3], [z, zero, x]);
        d[8] = scaled(2.0 * C2[4], [x, -y, zero]);
    }
    if degree >= 3 {
        let ring = c(4.0) * zz - xx - yy;
        d[9] = scaled(3.0 * C3[0], [c(2.0) * xy, xx - yy, zero]);
        d[10] = scaled(C3[1], [yz, xz, xy]);
        d[11] = scaled(C3[2], [c(-2.0) * xy, ring - c(2.0) * yy, c(8.0) * yz]);
        d[12] = scaled(3.0 * C3[3], [c(-2.0) * xz, c(-2.0) * yz, c(2.0) * zz - xx - yy]);
        d[13] = scaled(C3[4], [ring - c(2.0) * xx, c(-2.0) * xy, c(8.0) * xz]);
        d[14] = scaled(C3[5], [c(2.0) * xz, c(-2.0) * yz, xx - yy]);
        d[15] = scaled(3.0 * C3[6], [xx - yy, c(-2.0) * xy, zero]);
    }
    if degree >= 4 {
        let (seven1, seven3) = (c(7.0) * zz - c(1.0), c(7.0) * zz - c(3.0));
        d[16] = scaled(C4[0], [y * (c(3.0) * xx - yy), x * (xx - c(3.0) * yy), zero]);
        d[17] = scaled(C4[1], [c(6.0) * xy * z, c(3.0) * z * (xx - yy), y * (c(3.0) * xx - yy)]);
        d[18] = scaled(C4[2], [y * seven1, x * seven1, c(14.0) * xy * z]);
        d[19] = scaled(C4[3], [zero, z * seven3, y * (c(21.0) * zz - c(3.0))]);
        d[20] = scaled(C4[4], [zero, zero, z * (c(140.0) * zz - c(60.0))]);
        d[21] = scaled(C4[5], [z * seven3, zero, x * (c(21.0) * zz - c(3.0))]);
        d[22] = scaled(C4[6], [c(2.0) * x * seven1, c(-2.0) * y * seven1, c(14.0) * z * (xx - yy)]);
        d[23] = scaled(C4[7], [c(3.0) * z * (xx - yy), c(-6.0) * xy * z, x * (xx - c(3.0) * yy)]);
        d[24] = scaled(4.0 * C4[8], [x * (xx - c(3.0) * yy), y * (yy - c(3.0) * xx), zero]);
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;
    use glam::DVec3;

    fn directions(count: u32) -> impl Iterator<Item = DVec3> {
        let golden = std::f64::consts::PI * (3.0 - 5.0f64.sqrt());
        (0..count).map(move |n| {
            let z = 1.0 - (2.0 * f64::from(n) + 1.0) / f64::from(count);
            let (sin, cos) = (golden * f64::from(n)).sin_cos();
            DVec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + DVec3::Z * z
        })
    }

    /// The mean over the sphere of each product of two basis functions is `1/4π` or 0, approximately so on a Fibonacci
    /// lattice.
    #[test]
    fn basis_is_orthonormal() {
        const COUNT: u32 = 20_000;
        let mut products = [[0.0; 25]; 25];
        for direction in directions(COUNT) {
            let values = basis(4, direction.to_array());
            for (row, a) in products.iter_mut().zip(values) {
                for (sum, b) in row.iter_mut().zip(values) {
                    *sum += a * b * 4.0 * std::f64::consts::PI / f64::from(COUNT);
                }
            }
        }
        for (i, row) in products.iter().enumerate() {
            for (j, sum) in row.iter().enumerate() {
                Tolerance::absolute(1e-3).assert([*sum], [f64::from(u8::from(i == j))], &format!("{i} and {j}"));
            }
        }
    }

    #[test]
    fn gradients_match_central_differences() {
        const STEP: f64 = 1e-5;
        for direction in directions(50) {
            let gradient = basis_gradient(4, direction.to_array());
            for (axis, unit) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                let [ahead, behind] = [STEP, -STEP].map(|step| basis(4, (direction + unit * step).to_array()));
                let numeric = ahead.iter().zip(behind).map(|(a, b)| (a - b) / (2.0 * STEP));
                Tolerance::absolute(1e-8).assert(gradient.map(|of_one| of_one[axis]), numeric, "gradient");
            }
        }
    }
}
