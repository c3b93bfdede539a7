use super::Malformed;
use crate::{MAX_SH_DEGREE, sh_coefficients};

/// The first bytes of every header.
pub(in super::super) const MAGIC: [u8; 4] = *b"NGSP";

/// The fields that both header layouts share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Header {
    pub(super) version: u32,
    pub(super) count: u32,
    pub(super) sh_degree: u8,
    /// Centres are integers divided by 2 to this power.
    pub(super) fractional_bits: u8,
    pub(super) antialiased: bool,
    pub(super) has_extensions: bool,
    /// Flags that the format does not define.
    pub(super) unknown_flags: u8,
}

impl Header {
    /// Bytes of the header of versions 1 to 3.
    pub(super) const OLD_SIZE: usize = 16;
    /// Bytes of the header of version 4.
    pub(super) const NEW_SIZE: usize = 32;

    /// Parses the shared fields, from the first 16 bytes.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, Malformed> {
        let Some((start, _)) = bytes.split_first_chunk::<16>() else {
            return Err(Malformed::new("SPZ header", "16 bytes", format!("{} bytes", bytes.len())));
        };
        let [m0, m1, m2, m3, v0, v1, v2, v3, n0, n1, n2, n3, sh_degree, fractional_bits, flags, _] = *start;
        if [m0, m1, m2, m3] != MAGIC {
            return Err(Malformed::new("SPZ header", "\"NGSP\"", format!("{:?}", [m0, m1, m2, m3])));
        }
        let version = u32::from_le_bytes([v0, v1, v2, v3]);
        if !(1..=4).contains(&version) {
            return Err(Malformed::new("SPZ header", "version 1 to 4", version.to_string()));
        }
        if sh_degree > MAX_SH_DEGREE {
            let expected = format!("spherical harmonics of degree 0 to {MAX_SH_DEGREE}");
            return Err(Malformed::new("SPZ header", expected, sh_degree.to_string()));
        }
        if fractional_bits >= 32 {
            return Err(Malformed::new("SPZ header", "fewer than 32 fractional bits", fractional_bits.to_string()));
        }
        Ok(Self {
            version,
            count: u32::from_le_bytes([n0, n1, n2, n3]),
            sh_degree,
            fractional_bits,
            antialiased: flags & 1 != 0,
            has_extensions: flags & 2 != 0,
            unknown_flags: flags & !3,
        })
    }

    /// The header of versions 1 to 3.
    pub(super) fn to_bytes(self) -> [u8; Self::OLD_SIZE] {
        let [m0, m1, m2, m3] = MAGIC;
        let [v0, v1, v2, v3] = self.version.to_le_bytes();
        let [n0, n1, n2, n3] = self.count.to_le_bytes();
        let flags = u8::from(self.antialiased) | u8::from(self.has_extensions) << 1;
        [m0, m1, m2, m3, v0, v1, v2, v3, n0, n1, n2, n3, self.sh_degree, self.fractional_bits, flags, 0]
    }

    /// Bytes per Gaussian of its centre, opacity, colour, log-scales, quaternion and higher coefficients, in the
    /// order of the file.
    pub(super) const fn row_sizes(&self) -> [usize; 6] {
        let centre = if self.version == 1 { 6 } else { 9 };
        let quaternion = if self.version >= 3 { 4 } else { 3 };
        [centre, 1, 3, 3, quaternion, 3 * (sh_coefficients(self.sh_degree) - 1)]
    }

    /// Bytes of each attribute.
    pub(super) fn sizes(&self) -> [u64; 6] {
        self.row_sizes().map(|size| size as u64 * u64::from(self.count))
    }
}
