use glam::DVec3;

use super::Malformed;
use crate::sh::basis;
use crate::{GaussianParts, MAX_SH_DEGREE, sh_coefficients};

/// `SPZ_ADOBE_coordinate_system` (nianticlabs/spz `extensions/cc/splat-extensions.h`).
const COORDINATE_SYSTEM: u32 = 0xadbe_0003;

/// Signs of the stored axes relative to PLY's axes (right, down, front).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Axes {
    signs: DVec3,
}

impl Axes {
    /// Right, up, back: the default.
    pub(super) const RUB: Self = Self { signs: DVec3::new(1.0, -1.0, -1.0) };

    /// The axes declared by an extension, which may not contradict another. Other extensions do not affect the Gaussians and
    /// are listed as unused.
    pub(super) fn from_extensions(mut records: &[u8], unused: &mut Vec<String>) -> Result<Self, Malformed> {
        let mut declared = None;
        while let Some((kind, rest)) = records.split_first_chunk() {
            let kind = u32::from_le_bytes(*kind);
            let record = rest
                .split_first_chunk()
                .and_then(|(length, rest)| rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?));
            let (payload, rest) = record
                .ok_or_else(|| Malformed::new("SPZ extensions", "a record of (type, length, bytes)", "the end"))?;
            match (kind, payload.first_chunk()) {
                (COORDINATE_SYSTEM, Some(system)) => {
                    let code = u32::from_le_bytes(*system);
                    let first = *declared.get_or_insert(code);
                    if code != first {
                        let expected = format!("one coordinate system, {first}");
                        return Err(Malformed::new("SPZ extensions", expected, format!("another, {code}")));
                    }
                }
                (COORDINATE_SYSTEM, None) => {
                    let found = format!("{} bytes", payload.len());
                    return Err(Malformed::new("SPZ extensions", "a coordinate system of 4 bytes", found));
                }
                _ => unused.push(format!("extension 0x{kind:08x}")),
            }
            records = rest;
        }
        declared.map_or(Ok(Self::RUB), Self::from_code)
    }

    /// 1 to 8 are LDB, RDB, LUB, RUB, LDF, RDF, LUF, RUF; 0 is unspecified.
    fn from_code(code: u32) -> Result<Self, Malformed> {
        if code == 0 {
            return Ok(Self::RUB);
        }
        let Some(bits @ 0..8) = code.checked_sub(1) else {
            // 9 to 16 have y and z swapped; for some of them the reference's arithmetic contradicts their names, so
            // that their meaning is ambiguous.
            return Err(Malformed::new("SPZ extensions", "coordinate system 0 to 8", code.to_string()));
        };
        let sign = |bit: u32, same: u32| if (bits >> bit) & 1 == same { 1.0 } else { -1.0 };
        Ok(Self { signs: DVec3::new(sign(0, 1), sign(1, 0), sign(2, 1)) })
    }

    /// Converts Gaussians to or from PLY's axes, exactly, since only signs change. Mirroring an ellipsoid also mirrors
    /// its own axes: `D R D`, which is again a rotation.
    pub(super) fn ply_from_stored(self, parts: &mut GaussianParts) {
        let narrow = |sign: f64| if sign < 0.0 { -1.0f32 } else { 1.0 };
        let DVec3 { x, y, z } = self.signs;
        let signed = |value: &mut f32, sign: f64| *value *= narrow(sign);
        for [mean_x, mean_y, mean_z] in &mut parts.means {
            signed(mean_x, x);
            signed(mean_y, y);
            signed(mean_z, z);
        }
        for [_, i, j, k] in &mut parts.quaternions {
            signed(i, y * z);
            signed(j, x * z);
            signed(k, x * y);
        }
        let signs = self.sh_signs();
        for of_one in parts.sh.chunks_exact_mut(sh_coefficients(parts.sh_degree)) {
            for (rgb, sign) in of_one.iter_mut().zip(signs) {
                for value in rgb {
                    signed(value, sign);
                }
            }
        }
    }

    /// Signs of the SH coefficients. Each basis function is even or odd in each axis, so evaluating it in one direction
    /// gives its sign.
    ///
    /// The last function of degree 4 is even in y, but the reference implementation flips it; this follows the
    /// reference, which writes the files.
    fn sh_signs(self) -> [f64; 25] {
        let direction = DVec3::new(0.3, 0.5, 0.7).normalize();
        let mut signs = basis(MAX_SH_DEGREE, direction.to_array());
        for (sign, flipped) in signs.iter_mut().zip(basis(MAX_SH_DEGREE, (direction * self.signs).to_array())) {
            *sign = sign.signum() * flipped.signum();
        }
        signs[24] *= self.signs.y;
        signs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The table of nianticlabs/spz `src/cc/splat-types.h`, for RUB to RDF: y = z = −1.
    #[test]
    fn sh_signs_match_the_reference() {
        let signs: String = Axes::RUB.sh_signs().iter().map(|sign| if *sign > 0.0 { '+' } else { '-' }).collect();
        assert_eq!(signs, ["+", "--+", "-++-+", "-+--+-+", "-+-++-+--"].concat());
    }

    fn record(kind: u32, payload: &[u8]) -> Vec<u8> {
        let length = u32::try_from(payload.len()).unwrap().to_le_bytes();
        [&kind.to_le_bytes()[..], &length[..], payload].concat()
    }

    /// The default in its place would mirror the Gaussians.
    #[test]
    fn a_coordinate_system_without_its_code_is_rejected() {
        let of = |payload: &[u8]| Axes::from_extensions(&record(COORDINATE_SYSTEM, payload), &mut Vec::new());
        assert_eq!(of(&[7, 0, 0, 0]).unwrap(), Axes::from_code(7).unwrap());
        assert!(of(&[7, 0]).is_err());
        assert!(of(&[9, 0, 0, 0]).is_err());
    }

    #[test]
    fn a_second_coordinate_system_may_not_contradict_the_first() {
        let of = |codes: [u32; 2]| {
            let [first, second] = codes.map(|code| record(COORDINATE_SYSTEM, &code.to_le_bytes()));
            Axes::from_extensions(&[first, record(5, &[1, 2]), second].concat(), &mut Vec::new())
        };
        assert_eq!(of([7, 7]).unwrap(), Axes::from_code(7).unwrap());
        for codes in [[7, 4], [4, 7]] {
            let error = of(codes).unwrap_err();
            let expected = (format!("one coordinate system, {}", codes[0]), format!("another, {}", codes[1]));
            assert_eq!((error.expected, error.found), expected);
        }
    }

    #[test]
    fn coordinate_system_codes_map_to_axes() {
        assert_eq!(Axes::from_code(4).unwrap(), Axes::RUB);
        assert_eq!(Axes::from_code(6).unwrap().signs, DVec3::ONE, "RDF is PLY's");
        assert_eq!(Axes::from_code(7).unwrap().signs, DVec3::new(-1.0, -1.0, 1.0), "LUF");
        assert!(Axes::from_code(9).is_err());
        assert!(Axes::from_code(u32::MAX).is_err());
    }
}
