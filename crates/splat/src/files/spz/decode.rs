use super::COLOUR_SCALE;
use super::header::Header;
use super::quaternions::{from_four_bytes, from_three_bytes};
use crate::files::finite_logit;
use crate::{GaussianParts, sh_coefficients};

/// Decodes Gaussians, in the stored axes.
#[expect(clippy::cast_possible_truncation, reason = "Gaussians are stored as f32")]
pub(super) fn decode(header: &Header, attributes: &[Vec<u8>; 6]) -> GaussianParts {
    let [centres, opacities, colours, log_scales, quaternions, rest] = attributes;
    let narrow = |value: f64| value as f32;
    let unit = |byte: u8| f64::from(byte) / 255.0;
    let wxyz = |[x, y, z, w]: [f64; 4]| [w, x, y, z].map(narrow);
    let colour = |byte: u8| narrow((unit(byte) - 0.5) / COLOUR_SCALE);
    let log_scale = |byte: u8| f32::from(byte) / 16.0 - 10.0;
    let coefficient = |byte: u8| (f32::from(byte) - 128.0) / 128.0;
    let higher = sh_coefficients(header.sh_degree) - 1;
    let mut rest = rest.as_chunks::<3>().0.iter();
    let mut sh = Vec::with_capacity(opacities.len() * (1 + higher));
    for rgb in colours.as_chunks::<3>().0 {
        sh.push(rgb.map(colour));
        sh.extend(rest.by_ref().take(higher).map(|rgb| rgb.map(coefficient)));
    }
    GaussianParts {
        means: means(header, centres),
        quaternions: if header.version >= 3 {
            quaternions.as_chunks().0.iter().map(|bytes| wxyz(from_four_bytes(*bytes))).collect()
        } else {
            quaternions.as_chunks().0.iter().map(|bytes| wxyz(from_three_bytes(*bytes))).collect()
        },
        log_scales: log_scales.as_chunks().0.iter().map(|three| three.map(log_scale)).collect(),
        opacity_logits: opacities.iter().map(|byte| finite_logit(unit(*byte))).collect(),
        sh_degree: header.sh_degree,
        sh,
        scalars: None,
        filter_3d: None,
    }
}

/// Version 1 stores half floats, later versions 24-bit integers.
#[expect(clippy::cast_possible_truncation, reason = "24 bits fit an f32, halves too")]
fn means(header: &Header, centres: &[u8]) -> Vec<[f32; 3]> {
    if header.version == 1 {
        let half = |bytes: &[u8; 2]| half_to_f32(u16::from_le_bytes(*bytes));
        let halves = centres.as_chunks::<2>().0.as_chunks::<3>().0;
        return halves.iter().map(|[x, y, z]| [half(x), half(y), half(z)]).collect();
    }
    let step = (-f64::from(header.fractional_bits)).exp2();
    let fixed = |[low, middle, high]: &[u8; 3]| {
        // The arithmetic shift extends the sign of the highest byte.
        (f64::from(i32::from_le_bytes([0, *low, *middle, *high]) >> 8) * step) as f32
    };
    let centres = centres.as_chunks::<3>().0.as_chunks::<3>().0;
    centres.iter().map(|[x, y, z]| [fixed(x), fixed(y), fixed(z)]).collect()
}

/// IEEE 754 binary16.
#[expect(clippy::cast_possible_truncation, reason = "every half is an f32")]
fn half_to_f32(bits: u16) -> f32 {
    let (exponent, mantissa) = ((bits >> 10) & 0x1f, f64::from(bits & 0x3ff) / 1024.0);
    let magnitude = match exponent {
        0 => mantissa * (-14f64).exp2(),
        0x1f if mantissa > 0.0 => f64::NAN,
        0x1f => f64::INFINITY,
        _ => (1.0 + mantissa) * (f64::from(exponent) - 15.0).exp2(),
    };
    if bits >> 15 == 1 { -magnitude as f32 } else { magnitude as f32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn converts_half_floats() {
        for (bits, expected) in [
            (0x3c00, 1.0f32),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 5.960_464_5e-8),
            (0x0400, 6.103_515_6e-5),
            (0x8000, -0.0),
            (0x7c00, f32::INFINITY),
        ] {
            assert_eq!(half_to_f32(bits).to_bits(), expected.to_bits(), "{bits:#06x}");
        }
        assert!(half_to_f32(0x7e00).is_nan());
    }
}
