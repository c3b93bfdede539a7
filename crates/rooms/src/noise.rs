use glam::{Vec3, Vec4};

/// Hashes integer lattice coordinates to 32 bits by a few multiplications and shifts (after Jarzynski and Olano, "Hash
/// functions for GPU rendering", 2020).
pub(crate) const fn lattice(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    scrambled(folded(x, y, z, seed))
}

const fn folded(x: i32, y: i32, z: i32, seed: u32) -> u32 {
    seed.wrapping_add(x.cast_unsigned().wrapping_mul(0x9e37_79b1))
        .wrapping_add(y.cast_unsigned().wrapping_mul(0x85eb_ca77))
        .wrapping_add(z.cast_unsigned().wrapping_mul(0xc2b2_ae3d))
}

const fn scrambled(mut h: u32) -> u32 {
    h ^= h >> 15;
    h = h.wrapping_mul(0x2c1b_3c6d);
    h ^= h >> 12;
    h = h.wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// A size, share or cosine in the precision of colours.
#[expect(clippy::cast_possible_truncation, reason = "the one rounding to the precision of colours")]
pub(crate) const fn as_f32(value: f64) -> f32 {
    value as f32
}

/// Uniform in [0, 1) from the upper 24 bits.
pub(crate) const fn unit(bits: u32) -> f32 {
    (bits >> 8) as f32 / (1u32 << 24) as f32
}

/// Smooth value noise in [−1, 1], one feature a unit.
#[expect(clippy::cast_possible_truncation, reason = "texture coordinates are a few thousand units at most")]
pub(crate) fn value_noise(p: Vec3, seed: u32) -> f32 {
    // Not `floor`, which is a function call on baseline x86-64.
    let below = |x: f32| x as i32 - i32::from((x as i32) as f32 > x);
    let (x, y, z) = (below(p.x), below(p.y), below(p.z));
    let f = p - Vec3::new(x as f32, y as f32, z as f32);
    let s = f * f * (Vec3::splat(3.0) - 2.0 * f);
    // The corners with the lower x and those with the upper, ordered by y, then z: four lanes of vector arithmetic.
    let base = folded(x, y, z, seed);
    let corners = |dx: i32| {
        let offsets = [folded(dx, 0, 0, 0), folded(dx, 1, 0, 0), folded(dx, 0, 1, 0), folded(dx, 1, 1, 0)];
        Vec4::from(offsets.map(|offset| unit(scrambled(base.wrapping_add(offset)))))
    };
    let lower = corners(0);
    let edges = (lower + (corners(1) - lower) * s.x).to_array();
    let mix = |a: f32, b: f32, t: f32| a + (b - a) * t;
    2.0 * mix(mix(edges[0], edges[1], s.y), mix(edges[2], edges[3], s.y), s.z) - 1.0
}

/// Octaves of value noise, each half as wide and half as strong, in about [−1, 1]. Fine octaves, which would alias, are faded as
/// [`visible`] says.
pub(crate) fn fractal_noise(p: Vec3, octaves: u32, footprint: f32, seed: u32) -> f32 {
    let (mut sum, mut strength, mut scale) = (0.0, 0.5, 1.0);
    for octave in 0..octaves {
        let share = visible(1.0 / scale, footprint);
        if share <= 0.0 {
            break;
        }
        sum += strength * share * value_noise(p * scale, seed.wrapping_add(octave));
        strength *= 0.5;
        scale *= 2.03;
    }
    sum
}

/// How visible a detail of this size is in a pixel of this footprint, in [0, 1]: not at all up to one footprint, fully from three.
pub(crate) fn visible(size: f32, footprint: f32) -> f32 {
    (size / (footprint * 2.0 + f32::MIN_POSITIVE) - 0.5).clamp(0.0, 1.0)
}

/// A value of a detail of this size, which fades to its mean where a pixel of this footprint cannot show it.
pub(crate) fn faded(detail: f32, mean: f32, size: f32, footprint: f32) -> f32 {
    mean + (detail - mean) * visible(size, footprint)
}

/// Antialiased edge at signed `distance` 0, one footprint wide: 1 inside (positive), 0 outside.
pub(crate) fn edge(distance: f32, footprint: f32) -> f32 {
    (0.5 + distance / (footprint + 1e-9)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn details_fade_between_three_footprints_and_one() {
        let of_sizes = [0.2f32, 0.5, 1.0, 1.5, 4.0].map(|size| f64::from(visible(size, 0.5)));
        atsplat_numeric::Tolerance::F32_ROUND_TRIP.assert(of_sizes, [0.0, 0.0, 0.5, 1.0, 1.0], "visible shares");
    }

    #[test]
    fn noise_is_bounded_continuous_and_fades() {
        let mut last = value_noise(Vec3::new(0.0, 3.3, -1.7), 7);
        for step in 1..2000u16 {
            let p = Vec3::new(0.0137 * f32::from(step), 3.3, -1.7);
            let value = value_noise(p, 7);
            assert!(value.abs() <= 1.0);
            assert!((value - last).abs() < 0.06, "a jump of {} at {p}", value - last);
            last = value_noise(p, 7);
            assert!(fractal_noise(p, 6, 100.0, 7).abs() <= f32::EPSILON, "a pixel as wide as a hundred features");
        }
    }
}
