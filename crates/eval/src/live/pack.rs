use atsplat_numeric::Extremes as _;
use atsplat_splat::{GaussianParts, Gaussians, sh};

/// Bytes of a packed Gaussian.
pub const BYTES: usize = 16;
/// Log-scales that are smaller than the largest by more than this are stored as the lower end of the range: such scales
/// are far below a pixel.
const LARGEST_RATIO: f32 = 12.0;
/// Largest imaginary part of a unit quaternion whose real part is its largest.
const LARGEST_IMAGINARY: f32 = std::f32::consts::FRAC_1_SQRT_2;

/// Gaussians of 16 bytes, for display. Spherical harmonics are reduced to their constant band, and Gaussians that no pixel
/// shows are dropped.
///
/// Little-endian: the mean as 3 × 16 bits within [`low`](Self::low) and [`high`](Self::high); logarithms of the scales as
/// 3 × 8 bits within [`log_scales`](Self::log_scales); the imaginary part of the rotation as 3 × 8 bits, 127 for 0 and 127
/// steps for `1/√2`; red, green and blue as 8 bits from 0 to [`brightest`](Self::brightest); opacity as 8 bits. An
/// ellipsoid stays the same when turned by half a turn about one of its axes, so that the real part can be chosen to be the
/// largest.
#[derive(Clone, Debug, PartialEq)]
pub struct Packed {
    /// Smallest coordinates of the means.
    pub low: [f32; 3],
    /// Largest coordinates of the means.
    pub high: [f32; 3],
    /// Smallest and largest stored logarithm of a scale.
    pub log_scales: [f32; 2],
    /// Largest stored colour channel, at least 1.
    pub brightest: f32,
    /// [`BYTES`] per Gaussian, in their order.
    pub bytes: Vec<u8>,
}

/// Packs the Gaussians whose opacity is at least `min_alpha`; also returns their positions. Gaussians must be finite and
/// without a 3D filter, as a network predicts them.
pub(super) fn pack(gaussians: &Gaussians, min_alpha: f64) -> (Packed, Vec<usize>) {
    let parts = gaussians.parts();
    let kept: Vec<usize> =
        (0..gaussians.len()).filter(|&index| f64::from(opacity(parts, index)) >= min_alpha).collect();
    let mut packed = Packed {
        low: [0, 1, 2].map(|axis| extreme(kept.iter().map(|&index| parts.means[index][axis]), f32::minimum_of)),
        high: [0, 1, 2].map(|axis| extreme(kept.iter().map(|&index| parts.means[index][axis]), f32::maximum_of)),
        log_scales: [f32::minimum_of, f32::maximum_of]
            .map(|better| extreme(kept.iter().flat_map(|&index| parts.log_scales[index]), better)),
        brightest: extreme(kept.iter().flat_map(|&index| colour(parts, index)), f32::maximum_of).maximum_of(1.0),
        bytes: Vec::with_capacity(kept.len() * BYTES),
    };
    packed.log_scales[0] = packed.log_scales[0].maximum_of(packed.log_scales[1] - LARGEST_RATIO);
    for &index in &kept {
        packed.push(parts, index);
    }
    (packed, kept)
}

impl Packed {
    fn push(&mut self, parts: &GaussianParts, index: usize) {
        for axis in 0..3 {
            let step = level(parts.means[index][axis], [self.low[axis], self.high[axis]], 65535.0);
            self.bytes.extend(step.to_le_bytes());
        }
        let scales = parts.log_scales[index].map(|log| level(log, self.log_scales, 255.0));
        let imaginary = imaginary_of(parts.quaternions[index]);
        let rotation = imaginary.map(|part| level(part, [-LARGEST_IMAGINARY, LARGEST_IMAGINARY], 254.0));
        let colour = colour(parts, index).map(|channel| level(channel, [0.0, self.brightest], 255.0));
        let opacity = level(opacity(parts, index), [0.0, 1.0], 255.0);
        let bytes = scales.into_iter().chain(rotation).chain(colour).chain([opacity]);
        self.bytes.extend(bytes.map(|step| step.to_le_bytes()[0]));
    }
}

/// 0 without values.
fn extreme(values: impl Iterator<Item = f32>, better: impl Fn(f32, f32) -> f32) -> f32 {
    values.reduce(better).unwrap_or(0.0)
}

/// The nearest of `steps + 1` levels from `low` to `high`.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to [0, 65535]")]
pub(super) fn level(value: f32, [low, high]: [f32; 2], steps: f32) -> u16 {
    let share = if high > low { (value - low) / (high - low) } else { 0.0 };
    (share.clamp(0.0, 1.0) * steps).round() as u16
}

fn opacity(parts: &GaussianParts, index: usize) -> f32 {
    1.0 / (1.0 + (-parts.opacity_logits[index]).exp())
}

/// Colour without dependence on the view, at least 0.
#[expect(clippy::cast_possible_truncation, reason = "a constant of f32")]
fn colour(parts: &GaussianParts, index: usize) -> [f32; 3] {
    let stored = atsplat_splat::sh_coefficients(parts.sh_degree);
    parts.sh[index * stored].map(|coefficient| (0.5 + sh::C0 as f32 * coefficient).maximum_of(0.0))
}

/// The imaginary part of the equivalent rotation with the largest real part.
fn imaginary_of([w, x, y, z]: [f32; 4]) -> [f32; 3] {
    // Products with 1, i, j and k: turned by half a turn about the ellipsoid's axes.
    let turned = [[w, x, y, z], [-x, w, z, -y], [-y, -z, w, x], [-z, y, -x, w]];
    let [real, parts @ ..] = turned.into_iter().max_by(|a, b| a[0].abs().total_cmp(&b[0].abs())).unwrap_or(turned[0]);
    let norm = (w * w + x * x + y * y + z * z).sqrt().copysign(real);
    parts.map(|part| part / norm)
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::{SplitMix64, Tolerance};

    use super::*;
    use glam::{DMat3, DQuat, DVec3};

    /// What the page reads, written from the description of the format.
    fn unpacked(packed: &Packed, index: usize) -> ([f64; 3], DMat3, [f64; 3], f64) {
        let bytes = &packed.bytes[index * BYTES..][..BYTES];
        let share = |byte: u8| f64::from(byte) / 255.0;
        let mean = [0, 1, 2].map(|axis| {
            let share = f64::from(u16::from_le_bytes([bytes[2 * axis], bytes[2 * axis + 1]])) / 65535.0;
            f64::from(packed.low[axis]) + share * f64::from(packed.high[axis] - packed.low[axis])
        });
        let [least, most] = packed.log_scales.map(f64::from);
        let scales = DVec3::from([6, 7, 8].map(|index| (least + share(bytes[index]) * (most - least)).exp()));
        let [x, y, z] = [9, 10, 11].map(|index| (f64::from(bytes[index]) / 127.0 - 1.0) * 0.5f64.sqrt());
        let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, (1.0 - x * x - y * y - z * z).sqrt()));
        let colour = [12, 13, 14].map(|index| share(bytes[index]) * f64::from(packed.brightest));
        let covariance = rotation * DMat3::from_diagonal(scales * scales) * rotation.transpose();
        (mean, covariance, colour, share(bytes[15]))
    }

    #[test]
    fn unpacked_gaussians_are_close_to_the_packed_ones() {
        let mut random = SplitMix64::new(3);
        let count = 400;
        let mut draw = |low: f32, high: f32| low + (high - low) * random.unit_f32();
        let parts = GaussianParts {
            means: (0..count).map(|_| [draw(-3.0, 1.0), draw(0.0, 2.0), draw(1.0, 20.0)]).collect(),
            quaternions: (0..count).map(|_| [0; 4].map(|_| draw(-2.0, 2.0))).collect(),
            log_scales: (0..count).map(|_| [0; 3].map(|_| draw(-6.0, -1.0))).collect(),
            opacity_logits: (0..count).map(|index| if index % 5 == 0 { -9.0 } else { draw(-3.0, 4.0) }).collect(),
            sh: (0..count).map(|_| [draw(-3.0, 3.0), draw(-1.0, 1.0), draw(-1.0, 1.0)]).collect(),
            ..GaussianParts::default()
        };
        let gaussians = Gaussians::new(parts.clone()).unwrap();
        let (packed, kept) = pack(&gaussians, 1.0 / 255.0);
        assert_eq!((kept.len(), packed.bytes.len()), (320, 320 * BYTES));
        assert!(kept.iter().all(|index| index % 5 != 0) && packed.brightest > 1.2);
        for (place, &index) in kept.iter().enumerate() {
            let (mean, covariance, colour, opacity) = unpacked(&packed, place);
            Tolerance::absolute(2e-4).assert(mean, parts.means[index].map(f64::from), "mean");
            let [w, x, y, z] = parts.quaternions[index].map(f64::from);
            let rotation = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
            let scales = DVec3::from(parts.log_scales[index].map(|log| f64::from(log).exp()));
            let expected = rotation * DMat3::from_diagonal(scales * scales) * rotation.transpose();
            let largest = scales.max_element() * scales.max_element();
            let difference = (covariance - expected).to_cols_array().map(|entry| (entry / largest).abs());
            assert!(difference.iter().all(|share| *share < 0.03), "{difference:?}");
            let seen = parts.sh[index]
                .map(|band| if f64::from(band) < -0.5 / sh::C0 { 0.0 } else { 0.5 + sh::C0 * f64::from(band) });
            Tolerance::absolute(4e-3).assert(colour, seen, "colour");
            Tolerance::absolute(2e-3).assert(
                [opacity],
                [1.0 / (1.0 + (-f64::from(parts.opacity_logits[index])).exp())],
                "",
            );
        }
    }

    #[test]
    fn nothing_and_one_gaussian_are_packed() {
        let none = Gaussians::new(GaussianParts::default()).unwrap();
        assert!(pack(&none, 0.01).0.bytes.is_empty());
        let one = GaussianParts {
            means: vec![[1.0, 2.0, 3.0]],
            quaternions: vec![[0.0, 0.0, 0.0, -1.0]],
            log_scales: vec![[-1.0; 3]],
            opacity_logits: vec![f32::INFINITY],
            sh: vec![[0.0; 3]],
            ..GaussianParts::default()
        };
        let (packed, _) = pack(&Gaussians::new(one).unwrap(), 0.01);
        let (mean, _, colour, opacity) = unpacked(&packed, 0);
        Tolerance::absolute(3e-3).assert(
            [mean.as_slice(), &colour, &[opacity]].concat(),
            [1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 1.0],
            "",
        );
    }
}
