use super::axes::Axes;
use super::header::Header;
use super::quaternions::{to_four_bytes, to_three_bytes};
use super::{COLOUR_SCALE, ExportReport, Malformed};
use crate::{GaussianParts, sh_coefficients};

/// As in the reference: a quarter of a millimetre if a scene unit is a metre.
const FRACTIONAL_BITS: u8 = 12;
/// Centres are signed 24-bit integers.
const LARGEST_CENTRE: f64 = 8_388_607.0;
/// SH coefficients are rounded to multiples of these, with 256 levels over [−1, 1): as in the reference, 5 bits for
/// degree 1 and 4 bits above.
const STEPS: (i32, i32) = (1 << 3, 1 << 4);

/// Encodes the uncompressed payload of version 2 or 3, and counts what it clamps or rounds more coarsely than usual.
///
/// A scene extending beyond ±2047 gets fewer fractional bits.
pub(in super::super) fn encode(
    parts: &GaussianParts,
    version: u32,
    antialiased: bool,
) -> Result<(Vec<u8>, ExportReport), Malformed> {
    check(parts)?;
    let mut parts = parts.clone();
    // Signs are their own inverse.
    Axes::RUB.ply_from_stored(&mut parts);
    let header = Header {
        version,
        count: u32::try_from(parts.means.len())
            .map_err(|_too_large| Malformed::new("Gaussians", "fewer than 2³²", parts.means.len().to_string()))?,
        sh_degree: parts.sh_degree,
        fractional_bits: fractional_bits(&parts)?,
        antialiased,
        has_extensions: false,
        unknown_flags: 0,
    };
    let mut payload = header.to_bytes().to_vec();
    let scale = f64::from(header.fractional_bits).exp2();
    for centre in parts.means.as_flattened() {
        #[expect(clippy::cast_possible_truncation, reason = "fractional_bits keeps it in 24 bits")]
        let [low, middle, high, _] = ((f64::from(*centre) * scale).round() as i32).to_le_bytes();
        payload.extend([low, middle, high]);
    }
    payload.extend(parts.opacity_logits.iter().map(|logit| byte(255.0 / (1.0 + (-f64::from(*logit)).exp()))));
    let coefficients = sh_coefficients(parts.sh_degree);
    for dc in parts.sh.chunks_exact(coefficients).filter_map(<[_]>::first) {
        payload.extend(dc.map(|value| byte((0.5 + COLOUR_SCALE * f64::from(value)) * 255.0)));
    }
    payload.extend(parts.log_scales.as_flattened().iter().map(|scale| byte((f64::from(*scale) + 10.0) * 16.0)));
    for quaternion in &parts.quaternions {
        let [w, x, y, z] = unit(quaternion);
        if version >= 3 {
            payload.extend(to_four_bytes([x, y, z, w]));
        } else {
            payload.extend(to_three_bytes([x, y, z, w]));
        }
    }
    for of_one in parts.sh.chunks_exact(coefficients) {
        for (k, rgb) in of_one.iter().enumerate().skip(1) {
            payload.extend(rgb.map(|value| coefficient(value, step(k))));
        }
    }
    let centres = coarser(parts.means.as_flattened(), header.fractional_bits);
    // As the reference warns.
    let degree_is_unknown = version < 3 && parts.sh_degree > 3;
    Ok((payload, ExportReport { centres, degree_is_unknown, ..clamped(&parts) }))
}

/// The step of coefficient `k`, above degree 0.
const fn step(k: usize) -> i32 {
    if k < 4 { STEPS.0 } else { STEPS.1 }
}

/// Counts the values of Gaussians in the stored axes that are beyond the format's ranges.
fn clamped(parts: &GaussianParts) -> ExportReport {
    let log_scales = beyond(parts.log_scales.as_flattened(), [-10.0, 5.9375], 1.0 / 16.0);
    let mut export = ExportReport { log_scales, ..ExportReport::default() };
    let largest = 0.5 / COLOUR_SCALE;
    for of_one in parts.sh.chunks_exact(sh_coefficients(parts.sh_degree)) {
        for (k, rgb) in of_one.iter().enumerate() {
            if k == 0 {
                export.colours += beyond(rgb, [-largest, largest], 1.0 / (255.0 * COLOUR_SCALE));
            } else {
                export.coefficients += beyond(rgb, [-1.0, 127.0 / 128.0], f64::from(step(k)) / 128.0);
            }
        }
    }
    export
}

/// Counts coordinates that are further from what is stored than [`FRACTIONAL_BITS`] would leave them.
fn coarser(centres: &[f32], fractional_bits: u8) -> u64 {
    let usual = (-f64::from(FRACTIONAL_BITS)).exp2() / 2.0;
    let scale = f64::from(fractional_bits).exp2();
    let error = |centre: f64| ((centre * scale).round() / scale - centre).abs();
    centres.iter().filter(|centre| error(f64::from(**centre)) > usual).count() as u64
}

/// Counts values that are further beyond a range than values within are from what is stored.
fn beyond(values: &[f32], [low, high]: [f64; 2], step: f64) -> u64 {
    let stored = low - step / 2.0..=high + step / 2.0;
    values.iter().filter(|value| !stored.contains(&f64::from(**value))).count() as u64
}

/// Rejects what the format cannot store: non-finite values and unsupported fields.
fn check(parts: &GaussianParts) -> Result<(), Malformed> {
    for (field, is_present) in [("filter_3d", parts.filter_3d.is_some()), ("scalars", parts.scalars.is_some())] {
        if is_present {
            return Err(Malformed::new(
                "Gaussians",
                format!("no {field}, which SPZ cannot store"),
                format!("{field} for each"),
            ));
        }
    }
    let coefficients = sh_coefficients(parts.sh_degree);
    let rows = parts.means.iter().zip(&parts.quaternions).zip(&parts.log_scales).zip(&parts.opacity_logits);
    for (position, ((((mean, quaternion), scales), logit), sh)) in
        rows.zip(parts.sh.chunks_exact(coefficients)).enumerate()
    {
        let malformed =
            |expected: &str, found: String| Err(Malformed::new(format!("Gaussian {position}"), expected, found));
        let finite = |values: &[f32]| values.iter().all(|value| value.is_finite());
        if !(finite(mean) && finite(quaternion) && finite(sh.as_flattened())) {
            return malformed("finite centre, quaternion and colour", format!("{mean:?}, {quaternion:?}, {sh:?}"));
        }
        // An infinite log-scale or logit is clamped to the end of the format's range.
        if logit.is_nan() || scales.iter().any(|scale| scale.is_nan()) {
            return malformed("log-scales and an opacity logit that are not NaN", format!("{scales:?}, {logit}"));
        }
        if quaternion.iter().all(|part| *part == 0.0) {
            return malformed("a quaternion that is not zero", format!("{quaternion:?}"));
        }
    }
    Ok(())
}

fn fractional_bits(parts: &GaussianParts) -> Result<u8, Malformed> {
    let fits = |bits: u8| {
        let largest = LARGEST_CENTRE / f64::from(bits).exp2();
        parts.means.as_flattened().iter().all(|centre| f64::from(centre.abs()) <= largest)
    };
    let expected = || Malformed::new("Gaussians", format!("centres within ±{LARGEST_CENTRE}"), "one beyond");
    (0..=FRACTIONAL_BITS).rev().find(|bits| fits(*bits)).ok_or_else(expected)
}

fn unit(quaternion: &[f32; 4]) -> [f64; 4] {
    let wide = quaternion.map(f64::from);
    let norm = wide.iter().map(|part| part * part).sum::<f64>().sqrt();
    wide.map(|part| part / norm)
}

/// Rounds half away from zero, as C++ does, to the middle of a step; zero is the middle of a step.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
fn coefficient(value: f32, step: i32) -> u8 {
    // Clamped so that the sum below cannot overflow an i32.
    let level = (value.clamp(-2.0, 2.0) * 128.0).round() as i32 + 128;
    ((level + step / 2).div_euclid(step) * step).clamp(0, 255) as u8
}

/// Rounds to the nearest byte, saturating.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded, and `as` saturates")]
pub(super) fn byte(value: f64) -> u8 {
    value.round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mirrored axes exchange the ends of coefficients' ranges, which differ.
    #[test]
    fn values_beyond_the_format_are_counted_by_kind() {
        let within = GaussianParts {
            means: vec![[0.0; 3]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-10.03, 0.0, 5.96]],
            opacity_logits: vec![f32::INFINITY],
            sh_degree: 1,
            sh: vec![[3.34, -3.34, 0.0], [1.03, -1.02, 0.0], [0.0; 3], [0.0; 3]],
            ..GaussianParts::default()
        };
        assert_eq!(encode(&within, 3, false).unwrap().1, ExportReport::default(), "rounding");
        let mut beyond = within;
        beyond.log_scales = vec![[f32::NEG_INFINITY, 0.0, 5.98]];
        beyond.sh = vec![[3.5, -3.4, -9.0], [1.03, 1.03, -1.03], [0.0; 3], [0.0; 3]];
        let expected = ExportReport { log_scales: 2, colours: 3, coefficients: 1, ..ExportReport::default() };
        assert_eq!(encode(&beyond, 2, true).unwrap().1, expected);
    }

    #[test]
    fn degree_4_in_version_2_is_told() {
        let of = |version: u32, sh_degree: u8| {
            let parts = GaussianParts {
                means: vec![[0.0; 3]],
                quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
                log_scales: vec![[0.0; 3]],
                opacity_logits: vec![0.0],
                sh_degree,
                sh: vec![[0.0; 3]; sh_coefficients(sh_degree)],
                ..GaussianParts::default()
            };
            encode(&parts, version, false).unwrap().1.warnings()
        };
        let told =
            "spherical harmonics of degree 4 in SPZ 2: programs that read no later version will not load the file";
        assert_eq!(of(2, 4), [told]);
        for (version, degree) in [(2, 3), (3, 4)] {
            assert_eq!(of(version, degree), [""; 0], "SPZ {version}, degree {degree}");
        }
    }

    /// Coordinates that coarser steps store as well are not.
    #[test]
    fn centres_that_lose_bits_to_a_distant_one_are_counted() {
        let exported = |mean: [f32; 3]| {
            let parts = GaussianParts {
                means: vec![mean],
                quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
                log_scales: vec![[0.0; 3]],
                opacity_logits: vec![0.0],
                sh: vec![[0.0; 3]],
                ..GaussianParts::default()
            };
            encode(&parts, 3, false).unwrap().1
        };
        let odd = 1.0 / 4096.0;
        assert_eq!(exported([2047.0, odd, 0.1]), ExportReport::default(), "steps of 1/4096");
        assert_eq!(
            exported([3000.0, odd, 0.5]),
            ExportReport { centres: 1, ..ExportReport::default() },
            "steps of 1/2048"
        );
        let whole = exported([8_388_607.0, 0.3, -0.6]);
        let expected =
            "coordinates of centres rounded more coarsely than SPZ's usual 1/4096, because one is beyond ±2047: 2";
        assert_eq!(whole.warnings(), [expected]);
    }
}
