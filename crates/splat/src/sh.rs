//! Real spherical harmonics up to degree 4 in the basis of 3DGS and gsplat (`SphericalHarmonicsCUDA.cu`), as
//! polynomials of a unit direction; coefficient `l² + l + m`.

use glam::DVec3;

/// `Y₀₀`: an RGB colour is `0.5 + C0 · sh[0]` where the degree is 0.
pub(crate) const C0: f64 = 0.282_094_791_773_878_14;

/// Values of the basis in a unit direction; those above `degree` are zero.
pub(crate) fn basis(degree: u8, direction: DVec3) -> [f64; 25] {
    let DVec3 { x, y, z } = direction;
    let (xx, yy, zz) = (x * x, y * y, z * z);
    let mut values = [0.0; 25];
    values[0] = C0;
    if degree >= 1 {
        const C1: f64 = 0.488_602_511_902_919_9;
        values[1..4].copy_from_slice(&[-C1 * y, C1 * z, -C1 * x]);
    }
    if degree >= 2 {
        values[4..9].copy_from_slice(&[
            1.092_548_430_592_079_2 * x * y,
            -1.092_548_430_592_079_2 * y * z,
            0.315_391_565_252_520_05 * (2.0 * zz - xx - yy),
            -1.092_548_430_592_079_2 * x * z,
            0.546_274_215_296_039_6 * (xx - yy),
        ]);
    }
    if degree >= 3 {
        values[9..16].copy_from_slice(&[
            -0.590_043_589_926_643_5 * y * (3.0 * xx - yy),
            2.890_611_442_640_554 * x * y * z,
            -0.457_045_799_464_465_8 * y * (4.0 * zz - xx - yy),
            0.373_176_332_590_115_4 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            -0.457_045_799_464_465_8 * x * (4.0 * zz - xx - yy),
            1.445_305_721_320_277 * z * (xx - yy),
            -0.590_043_589_926_643_5 * x * (xx - 3.0 * yy),
        ]);
    }
    if degree >= 4 {
        values[16..25].copy_from_slice(&[
            2.503_342_941_796_704_8 * x * y * (xx - yy),
            -1.770_130_769_779_930_6 * y * z * (3.0 * xx - yy),
            0.946_174_695_757_560_1 * x * y * (7.0 * zz - 1.0),
            -0.669_046_543_557_289_2 * y * z * (7.0 * zz - 3.0),
            0.105_785_546_915_204_3 * (zz * (35.0 * zz - 30.0) + 3.0),
            -0.669_046_543_557_289_2 * x * z * (7.0 * zz - 3.0),
            0.473_087_347_878_780_04 * (xx - yy) * (7.0 * zz - 1.0),
            -1.770_130_769_779_930_6 * x * z * (xx - 3.0 * yy),
            0.625_835_735_449_176_2 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)),
        ]);
    }
    values
}
